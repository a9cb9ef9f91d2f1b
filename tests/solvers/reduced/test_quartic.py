"""W, F and K of the quartic of a reduced body equal the projected W, F and K of the body, up to rounding."""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from bodies import BODIES, CURVED, MESHES, STRAIGHT, box, some_voigt
from slow import slow

from skfem_stvk import Anisotropic, EdgeNetwork, ElasticFoundation, LinearElastic, StVK, System
from skfem_stvk.kernels import reduced as kernels
from skfem_stvk.solvers.reduced import quartic as of_quartic
from skfem_stvk.solvers.reduced.quartic import coefficients, quartic_of


def errors(body, size=4, amount=0.3):
    """Return the errors of W, F and K in the span of random fields of different sizes, at a state of finite displacements."""
    rng = np.random.default_rng(0)
    fields = rng.standard_normal((body.ndofs, size)) * np.exp(rng.uniform(-1, 1, size))
    z = amount * rng.standard_normal(size)
    quartic, x, u = quartic_of(body, body.bound_terms, fields), np.concatenate([[1.0], z]), fields @ z
    W, G, H = quartic.linearize(x)
    F, K = fields.T @ body.internal_force(u), fields.T @ (body.tangent(u) @ fields)
    assert np.abs(F).max() > 0
    return (
        abs(W / body.energy(u) - 1),
        np.abs(G[1:] - F).max() / np.abs(F).max(),
        np.abs(H[1:, 1:] - K).max() / np.abs(K).max(),
    )


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_quartic_is_the_energy_of_simplices_of_all_kinds_and_materials(name):
    for size in (1, 4, 9):
        assert max(errors(System(*BODIES[name]), size)) < 1e-13


@pytest.mark.few(2)
@pytest.mark.parametrize("rule", [None, "exact"])
@pytest.mark.parametrize("name", CURVED)
def test_the_quartic_is_the_energy_of_elements_with_several_points(name, rule):
    for material in (StVK(young=2.0, poisson=0.3), StVK(Anisotropic(some_voigt(np.random.default_rng(0))))):
        assert max(errors(System(CURVED[name], material, quadrature=rule))) < 1e-13


@pytest.mark.parametrize("name", STRAIGHT)
def test_the_quartic_is_the_energy_of_straight_elements_with_several_points(name):
    assert max(errors(System(STRAIGHT[name], StVK(young=2.0, poisson=0.3)))) < 1e-13


@pytest.mark.parametrize("name", [slow("hexahedra"), "quadrilaterals"])
def test_the_quartic_includes_the_hourglass_resistance(name):
    assert max(errors(System(CURVED[name], StVK(young=2.0, poisson=0.3), quadrature="one-point"))) < 1e-13


def test_the_quartic_includes_quadratic_terms_and_edge_networks():
    mesh, law = box(2), StVK(young=2.0, poisson=0.3)
    for terms in (
        [law, LinearElastic(young=3.0, poisson=0.2)],
        [law, ElasticFoundation(lambda x: x[2] < 2, (1.0, 2.0, 3.0))],
        EdgeNetwork.of(mesh, law),
        EdgeNetwork.of(mesh, law).diagonal(),
    ):
        assert max(errors(System(mesh, terms))) < 1e-12


def test_the_quartic_excludes_removed_elements():
    body = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3))
    body = body.without([3, 7, 30])
    assert max(errors(body)) < 1e-13


def ordered(n):
    """Return the indices `a <= b <= c <= d` of products of four of n variables, in the kernels' order: by the last, and so on."""
    return sorted(combinations_with_replacement(range(n), 4), key=lambda indices: indices[::-1])


def test_a_change_of_any_coefficient_changes_the_energy():
    """Each coefficient contributes to W, to the gradient and to the second derivatives at a state without zeros."""
    n = 4
    x, work, zero = np.arange(1.0, n + 1), (np.empty(10), np.empty((n, 10)), np.empty(10)), np.zeros(coefficients(n))
    for i, indices in enumerate(ordered(n)):
        T, G, H = zero.copy(), np.empty(n), np.empty((n, n))
        T[i] = 1
        assert kernels.quartic(T, x, *work, G, H) == pytest.approx(np.prod(x[list(indices)]), rel=1e-14)
        assert np.flatnonzero(G).tolist() == sorted(set(indices))


def test_scratch_memory_of_the_quartic_does_not_grow_with_the_mesh(monkeypatch):
    """The rows of strains are computed in blocks, and all blocks use the same array."""
    monkeypatch.setattr(of_quartic, "BLOCK", 8 * 15 * 60)
    sizes = []
    for n in (2, 4):
        body = System(box(n), StVK(young=2.0, poisson=0.3))
        term, fields = body.bound_terms[0], np.random.default_rng(0).standard_normal((body.mesh.nv, 3, 4))
        rows = list(term.strain_products(fields, 60))
        assert sum(map(len, rows)) == 6 * body.mesh.nt and len({id(one.base) for one in rows}) == 1
        sizes.append(max(one.nbytes for one in rows))
        assert max(errors(body)) < 1e-13
    assert sizes[0] == sizes[1] == 8 * 15 * 60
