"""Weighted sampled elements replace all elements.

Their weights are nonnegative, and the reported error is that of states that were not fitted.
"""

import numpy as np
import pytest
import skfem

from skfem_stvk import NeoHookean, ReducedSystem, StVK, StvkError, System, VolumePenalty


def bar(*terms):
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 7), np.linspace(0, 1, 3), np.linspace(0, 0.8, 3))
    return System(mesh, list(terms), fixed=[(lambda x: x[0] == 0, "xyz")])


LAW = NeoHookean(young=2.0, poisson=0.3, density=1.0)


def test_few_weighted_elements_replace_all():
    body = bar(LAW)
    full, reduced = ReducedSystem(body, 4, 3, quiet=True), ReducedSystem(body, 4, 3, sampled=60, quiet=True)
    (found,) = reduced.sampling.values()
    assert len(found.elements) <= 60 < body.mesh.nt and (found.weights > 0).all()
    assert found.fitted <= found.unseen < 0.02
    assert abs(found.weights.sum() / body.mesh.nt - 1) < 0.3
    q = np.array([0.3, 0.1, -0.1, 0.05])
    F, K = full.internal_force(q), full.tangent(q)
    assert 1e-12 < np.linalg.norm(reduced.internal_force(q) - F) / np.linalg.norm(F) < 5 * found.unseen
    assert np.linalg.norm(reduced.tangent(q) - K) / np.linalg.norm(K) < 0.1
    assert abs(reduced.energy(q) / full.energy(q) - 1) < 0.05


def test_force_and_tangent_of_sampled_elements_are_derivatives_of_their_energy():
    reduced = ReducedSystem(bar(LAW), 4, 3, sampled=40, quiet=True)
    q, v, h = np.array([0.3, 0.1, -0.1, 0.05]), np.array([0.2, -0.4, 0.1, 0.3]), 1e-4
    _, F, K = reduced.linearize(q)
    assert (reduced.energy(q + h * v) - reduced.energy(q - h * v)) / (2 * h) == pytest.approx(F @ v, rel=1e-6)
    difference = (reduced.internal_force(q + h * v) - reduced.internal_force(q - h * v)) / (2 * h)
    assert np.abs(difference - K @ v).max() < 1e-6 * np.abs(K @ v).max()


def test_more_sampled_elements_make_the_error_smaller():
    errors = [ReducedSystem(bar(LAW), 4, 3, sampled=n, quiet=True).sampling["NeoHookean 0"].unseen for n in (10, 80)]
    assert errors[1] < 0.3 * errors[0]


def test_a_quartic_energy_is_not_sampled():
    reduced = ReducedSystem(bar(StVK(young=2.0, poisson=0.3, density=1.0)), 4, 3, sampled=40, quiet=True)
    assert reduced.quartic and not reduced.sampling


def test_terms_without_a_modulus_are_refused(tmp_path):
    with pytest.raises(StvkError, match="VolumePenalty cannot be sampled"):
        ReducedSystem(bar(StVK(young=2.0, poisson=0.3, density=1.0), VolumePenalty(1.0)), 4, 3, sampled=40, quiet=True)
    with pytest.raises(StvkError, match="not stored in files"):
        ReducedSystem(bar(LAW), 4, 3, sampled=40, quiet=True).save(tmp_path / "bar.npz")
