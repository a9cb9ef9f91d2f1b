"""Loads and foundations in a system: the residual is the gradient of the potential, the Jacobian that of the residual."""

import numpy as np
import pytest
from bodies import MESHES, box, sheet, state

from skfem_stvk import BodyForce, ElasticFoundation, Gravity, NodalLoad, Pressure, StVK, System, Traction
from skfem_stvk.errors import LoadError, StateError, SupportError
from skfem_stvk.terms.loads.load import Moment

SECTION = {1: {"area": 0.3}, 2: {"thickness": 0.3}, 3: {}}


def left(x):
    return x[0] < 0.4


def loaded(mesh, pressure=False, dtype=np.float64):
    d = mesh.d
    terms = [
        StVK(young=2.0, poisson=0.3, density=1.5, **SECTION[mesh.k]),
        Gravity(g=np.arange(1.0, d + 1)),
        Traction(left, lambda x, t: t**2 * x),
        BodyForce(np.ones(d)),
        NodalLoad([0, 1], 2 * np.ones(d)),
        ElasticFoundation(left, 3.0),
    ]
    if pressure:
        terms.insert(2, Pressure(None if mesh.k < d else left, 1.5))
    return System(mesh, terms, dtype=dtype)


@pytest.mark.parametrize("name", MESHES)
def test_the_residual_is_the_gradient_of_the_potential(name):
    """The residual is the gradient of the potential.

    The potential is a quartic along a line, for which the stencil of four points is exact.
    """
    mesh = MESHES[name]
    system, t = loaded(mesh), 0.7
    u, v = state(mesh), state(mesh, seed=5)
    W = {s: system.potential(u + s * v, t) for s in (-2, -1, 1, 2)}
    slope = (8 * (W[1] - W[-1]) - (W[2] - W[-2])) / 12
    scale = max(map(abs, W.values()))
    assert system.residual(u, t) @ v == pytest.approx(slope, abs=1e-12 * scale)
    assert system.residual(u, t) == pytest.approx(system.internal_force(u) - system.external_force(u, t))


@pytest.mark.parametrize("name", [name for name, mesh in MESHES.items()])
def test_the_jacobian_is_the_derivative_of_the_residual(name):
    """The Jacobian is the derivative of the residual, which is a cubic, so that the stencil is exact."""
    mesh = MESHES[name]
    system, t = loaded(mesh, pressure=mesh.k > 1), 0.7
    u, v = state(mesh), state(mesh, seed=5)
    r = {s: system.residual(u + s * v, t) for s in (-2, -1, 1, 2)}
    slope = (8 * (r[1] - r[-1]) - (r[2] - r[-2])) / 12
    K = system.jacobian(u, t)
    assert K @ v == pytest.approx(slope, abs=1e-12 * max(np.abs(f).max() for f in r.values()))
    asymmetry = abs(K - K.T).max() / abs(K).max()
    assert (asymmetry > 1e-4) == (mesh.k > 1) == (not system.conservative)


def test_pressure_has_no_potential():
    with pytest.raises(LoadError, match="Pressure has no potential: its work depends on the path"):
        loaded(MESHES["tetrahedra"], pressure=True).potential(np.zeros(192))


@pytest.mark.parametrize("name", MESHES)
def test_single_precision_is_single_precision(name):
    mesh = MESHES[name]
    exact, single = (loaded(mesh, mesh.k > 1, dtype) for dtype in (np.float64, np.float32))
    u = 0.1 * state(mesh)
    one, other = exact.residual(u), single.residual(u)
    assert np.abs(one - other).max() < 1e-5 * np.abs(one).max()
    one, other = exact.jacobian(u), single.jacobian(u)
    assert abs(one - other).max() < 1e-5 * abs(one).max()


def test_a_foundation_of_a_sheet_includes_its_thickness():
    mesh = sheet()
    thin, thick = (System(mesh, [StVK(young=1.0, poisson=0.3, thickness=h), ElasticFoundation(left, 2.0)]) for h in (0.1, 0.3))
    u = np.ones(mesh.p.size)
    assert thin.energy(u) > 0 and thick.energy(u) == pytest.approx(3 * thin.energy(u), rel=1e-10)


def test_a_foundation_constrains_a_body_without_supports():
    mesh = MESHES["tetrahedra"]
    body = StVK(young=1.0, poisson=0.3)
    with pytest.raises(SupportError, match="6 rigid modes left"):
        System(mesh, body).check_held()
    System(mesh, [body, ElasticFoundation(left, 1e-6)]).check_held()
    with pytest.raises(SupportError, match="1 rigid mode left, translation along y"):
        System(mesh, [body, ElasticFoundation(left, (1, 0, 1))]).check_held()


@pytest.mark.parametrize("loads", [[], [BodyForce((0, 0, -1.0))]], ids=["no load", "a load"])
@pytest.mark.parametrize("name", ["external_force", "residual", "potential", "jacobian", "energies"])
def test_invalid_times_are_refused(name, loads):
    system = System(box(), [StVK(young=2.0, poisson=0.3), *loads])
    for t in (np.nan, np.inf, None, "1", "a", 1j, [0.5], (0.5, 1.0), True, 10**400, Moment(0.5, np.nan), Moment(None, 1.0)):
        with pytest.raises(StateError, match=r"t = .*; expected a finite load factor"):
            getattr(system, name)(np.zeros(system.ndofs), t)
        with pytest.raises(StateError, match=r"t = .*; expected a finite load factor"):
            system.supports.values(t)


def test_numbers_of_all_kinds_are_times():
    system = System(box(), [StVK(young=2.0, poisson=0.3), BodyForce((0, 0, -1.0))])
    u = np.zeros(system.ndofs)
    for t in (1, np.float32(1), np.array(1.0), np.int64(1), Moment(1, 1)):
        assert np.array_equal(system.residual(u, t), system.residual(u))
