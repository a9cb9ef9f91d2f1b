"""The quartic of a reduced body is the energy of the body, its force and tangent projected, to rounding."""

import numpy as np
import pytest
from bodies import BODIES, CURVED, MESHES, STRAIGHT, box, some_voigt

from skfem_stvk import Anisotropic, EdgeNetwork, ElasticFoundation, LinearElastic, StVK, System
from skfem_stvk.reduced.quartic import quartic_of


def errors(body, size=4, amount=0.3):
    """Errors of W, F and K in the span of random fields of unlike sizes, at a state that is not small."""
    rng = np.random.default_rng(0)
    fields = rng.standard_normal((body.ndofs, size)) * np.exp(rng.uniform(-1, 1, size))
    z = amount * rng.standard_normal(size)
    quartic, x, u = quartic_of(body, body.bound_terms, fields), np.concatenate([[1.0], z]), fields @ z
    H = quartic.hessian(x)
    F, K = fields.T @ body.internal_force(u), fields.T @ (body.tangent(u) @ fields)
    assert np.abs(F).max() > 0
    return (
        abs(x @ H @ x / 12 / body.energy(u) - 1),
        np.abs((H @ x / 3)[1:] - F).max() / np.abs(F).max(),
        np.abs(H[1:, 1:] - K).max() / np.abs(K).max(),
    )


@pytest.mark.parametrize("name", BODIES)
def test_it_is_the_energy_of_simplices_of_all_kinds_and_materials(name):
    assert max(errors(System(*BODIES[name]))) < 1e-13


@pytest.mark.parametrize("rule", [None, "exact"])
@pytest.mark.parametrize("name", CURVED)
def test_it_is_the_energy_of_elements_with_several_points(name, rule):
    for material in (StVK(young=2.0, poisson=0.3), StVK(Anisotropic(some_voigt(np.random.default_rng(0))))):
        assert max(errors(System(CURVED[name], material, quadrature=rule))) < 1e-13


@pytest.mark.parametrize("name", STRAIGHT)
def test_it_is_the_energy_of_straight_elements_with_several_points(name):
    assert max(errors(System(STRAIGHT[name], StVK(young=2.0, poisson=0.3)))) < 1e-13


@pytest.mark.parametrize("name", ["hexahedra", "quadrilaterals"])
def test_hourglass_modes_are_resisted_as_much(name):
    assert max(errors(System(CURVED[name], StVK(young=2.0, poisson=0.3), quadrature="one-point"))) < 1e-13


def test_terms_that_are_quadratic_and_networks_of_edges_are_in_it():
    mesh, law = box(2), StVK(young=2.0, poisson=0.3)
    for terms in (
        [law, LinearElastic(young=3.0, poisson=0.2)],
        [law, ElasticFoundation(lambda x: x[2] < 2, (1.0, 2.0, 3.0))],
        EdgeNetwork.of(mesh, law),
        EdgeNetwork.of(mesh, law).diagonal(),
    ):
        assert max(errors(System(mesh, terms))) < 1e-12


def test_elements_that_were_taken_out_are_not_in_it():
    body = System(MESHES["tetrahedra"], StVK(young=2.0, poisson=0.3))
    body.remove([3, 7, 30])
    assert max(errors(body)) < 1e-13
