"""Single precision has relative errors of 1e-6, also where digits cancel in other forms."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, box, state
from slow import slow

from skfem_stvk import ElementMesh, Isotropic, StVK, StvkWarning, System
from skfem_stvk.mesh.geometry import aspect_ratios
from skfem_stvk.referee.exact import ExactStVK

TERM = StVK(young=2.0, poisson=0.3)
LIMIT = 4e-6


def errors(mesh, terms, u):
    """Return the largest errors of W, F, K and K v in single precision, relative to W and to the largest entries."""
    double, single, v = System(mesh, terms), System(mesh, terms, dtype=np.float32), state(mesh, seed=9)
    wanted = [double.internal_force(u), double.tangent(u).data, double.product(u, v)]
    found = [single.internal_force(u), single.tangent(u).data, single.product(u, v)]
    assert all(array.dtype == np.float32 for array in found)
    energy = double.energy(u)
    return [
        abs(single.energy(u) - energy) / energy,
        *(np.abs(a - b).max() / np.abs(a).max() for a, b in zip(wanted, found, strict=True)),
    ]


def stretched(mesh, strain):
    """Return a smooth displacement field without rotation: the gradient of a potential.

    The strain has all components and the given size.
    """
    x = mesh.p - mesh.p.mean(axis=1, keepdims=True)
    gradient = np.random.default_rng(0).uniform(-1, 1, (mesh.d, mesh.d))
    return (strain * (x.T @ (gradient + gradient.T) / 2 + 0.3 * x.T**2)).ravel()


@pytest.mark.few
@pytest.mark.parametrize("name", [slow(name) if name == "tetrahedra, anisotropic" else name for name in BODIES])
def test_every_body_is_right_to_single_precision(name):
    mesh, terms = BODIES[name]
    assert max(errors(mesh, terms, state(mesh))) < LIMIT


@pytest.mark.few
@pytest.mark.parametrize("strain", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("name", ["tetrahedra, isotropic", "tetrahedra, fibres", "membrane, anisotropic", "triangles, auxetic"])
def test_small_strains_are_accurate(name, strain):
    mesh, terms = BODIES[name]
    assert max(errors(mesh, terms, stretched(mesh, strain))) < LIMIT


@pytest.mark.parametrize("strain", [1e-1, 1e-3, 1e-6])
def test_against_fifty_digits(strain):
    mesh, u = box(2), stretched(box(2), strain)
    young, poisson = 2.0, 0.25
    lam, mu = young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
    v = state(mesh, seed=9)
    body = System(mesh, StVK(young=young, poisson=poisson), dtype=np.float32)
    W, F = ExactStVK(mesh.p, mesh.t, (lam, mu)).energy_and_force(u)
    Kv = ExactStVK(mesh.p, mesh.t, (lam, mu)).product(u, v)
    assert body.energy(u) == pytest.approx(W, rel=LIMIT)
    assert np.abs(body.internal_force(u) - F).max() < LIMIT * np.abs(F).max()
    for product in (body.product(u, v), body.tangent(u) @ v):
        assert np.abs(product - Kv).max() < LIMIT * np.abs(Kv).max()


@pytest.mark.parametrize("offset", [1e3, 1e6])
def test_errors_do_not_grow_far_from_the_origin(offset):
    """Errors do not grow far from the origin, because rest edges and displacements are differences in double precision."""
    mesh = box(3)
    there = ElementMesh(mesh.p + offset, mesh.t)
    for strain in (1e-1, 1e-5):
        assert max(errors(there, TERM, stretched(there, strain))) < LIMIT
    moved = stretched(there, 1e-3) + offset
    assert max(errors(there, TERM, moved)) < LIMIT


@pytest.mark.parametrize("strain", [1e-1, 1e-4])
def test_graded_materials(strain):
    """Errors are small for Young's moduli over six decades and nearly all Poisson's ratios."""
    mesh = box(4)
    young = 10 ** np.random.default_rng(0).uniform(-3, 3, mesh.nt)
    assert max(errors(mesh, StVK(young=young, poisson=np.linspace(-0.3, 0.45, mesh.nt)), stretched(mesh, strain))) < LIMIT


@pytest.mark.filterwarnings("ignore:.*flatter than 1")
@pytest.mark.parametrize("height", [1.0, 0.3, 0.1, 0.03])
def test_flat_elements_cost_their_aspect_ratio(height):
    mesh = box(2)
    flat = ElementMesh(mesh.p * np.array([[height], [1], [1]]), mesh.t)
    aspect = aspect_ratios(flat).max()
    assert max(errors(flat, TERM, stretched(flat, 1e-3))) < 5 * np.finfo(np.float32).eps * aspect


def test_elements_too_flat_for_single_precision_give_a_warning():
    flat = ElementMesh(box(2).p * np.array([[0.002], [1], [1]]), box(2).t)
    with pytest.warns(StvkWarning, match=r"\d+ elements \(.*\): flatter than 1:1000, the flattest 1:11\d\d. In float32"):
        System(flat, TERM, dtype=np.float32)
    System(flat, TERM)  # no warning in double precision


def test_all_results_have_the_requested_type():
    mesh = MESHES["tetrahedra"]
    body, u = System(mesh, TERM, dtype=np.float32), state(mesh)
    energy, force, K = body.linearize(u)
    assert isinstance(energy, float) and isinstance(body.energy(u), float)
    assert body.dtype == force.dtype == K.dtype == body.internal_force(u).dtype == body.tangent(u).dtype == np.float32
    assert body.product(u, u).dtype == body.linear_operator(u).dtype == np.float32


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_displacements_may_be_single_in_either_system(dtype):
    """Displacements in single precision are used exactly, without further rounding."""
    mesh = MESHES["tetrahedra"]
    body, u, v = System(mesh, TERM, dtype=dtype), state(mesh).astype(np.float32), state(mesh, seed=9).astype(np.float32)
    same, w = u.astype(np.float64), v.astype(np.float64)
    assert body.energy(u) == body.energy(same)
    assert np.array_equal(body.internal_force(u), body.internal_force(same))
    assert np.array_equal(body.tangent(u).data, body.tangent(same).data)
    assert np.array_equal(body.product(u, v), body.product(same, w))
    assert body.internal_force(u).dtype == dtype


def test_a_nearly_incompressible_material_is_accurate():
    """A nearly incompressible material has small errors: `r = lam / (2 mu)` is large and in the range of single precision."""
    mesh = MESHES["tetrahedra"]
    term = StVK(Isotropic(2.0, 0.4999))
    assert max(errors(mesh, term, stretched(mesh, 1e-2))) < LIMIT
