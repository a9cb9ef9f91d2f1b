"""Suite of requirements for all loads."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from bodies import MESHES, state
from springs import PointSpring
from terms.toys import Vortex

from skfem_stvk import BodyForce, ElementMesh, Gravity, LoadError, NodalLoad, Pressure, StVK, System, Traction
from skfem_stvk.edges.pairs import AccumulatedBlocks
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MotionState
from skfem_stvk.system import Pattern
from skfem_stvk.terms import Body
from skfem_stvk.terms.loads.load import Moment, bound_load

T = Moment(0.6, 0.8)


class Case(NamedTuple):
    """Load on a mesh, and its expected properties."""

    mesh: ElementMesh
    load: Any
    has_potential: bool = True
    dead: bool = True
    steady: bool = True


def cases():
    found = {}
    for name, mesh in MESHES.items():
        d = mesh.d
        g, there = np.arange(1.0, d + 1), lambda x: x[0] < 0.5
        everywhere = None if mesh.k < d else there
        found |= {
            f"Gravity, {name}": Case(mesh, Gravity(g)),
            f"BodyForce of x, {name}": Case(mesh, BodyForce(lambda x, t: (1 + t) * x), steady=False),
            f"NodalLoad, {name}": Case(mesh, NodalLoad([2, 1], g)),
            f"NodalLoad of time, {name}": Case(mesh, NodalLoad([2, 1], lambda t, g=g: g * np.cos(t)), steady=False),
            f"Traction, {name}": Case(mesh, Traction(there, g)),
            f"PointSpring, {name}": Case(mesh, PointSpring([2, 1, 4], 3 * g, 1.7), dead=False),
            f"PointSpring with a length, {name}": Case(mesh, PointSpring([2, 1, 4], 3 * g, 1.7, 0.8), dead=False),
            f"PointSpring of time, {name}": Case(mesh, PointSpring([2, 4], 2 * g, lambda t: 1 + t, 0.5), dead=False, steady=False),
        }
        if mesh.k > 1:
            found[f"Pressure, {name}"] = Case(mesh, Pressure(everywhere, 1.5), has_potential=False, dead=False)
            of_time = Pressure(everywhere, lambda x, t: t * (1 + x[0]))
            found[f"Pressure of x, {name}"] = Case(mesh, of_time, has_potential=False, dead=False, steady=False)
    found["Vortex"] = Case(MESHES["tetrahedra"], Vortex([1, 4, 6], 2.0), has_potential=False, dead=False)
    return found


CASES = cases()
WITH_POTENTIAL = [name for name, case in CASES.items() if case.has_potential]
WITHOUT = [name for name in CASES if name not in WITH_POTENTIAL]
DEAD = [name for name, case in CASES.items() if case.dead]
NOT_DEAD = [name for name in CASES if name not in DEAD]
ELASTIC = StVK(young=1.0, poisson=0.3, density=1.3)


def bound(case):
    return bound_load(case.load.bind(Body(case.mesh, [ELASTIC])))


def force(load, u, t=T):
    out = np.zeros(u.shape)
    load.add_force(u, t, out)
    return out


def derivative(f, h):
    """Return the derivative of `f` at 0 by a seven-point stencil."""
    weights = {1: 45, 2: -9, 3: 1}
    return sum(w * (f(n * h) - f(-n * h)) for n, w in weights.items()) / (60 * h)


def stiffness(case, load, u):
    pattern, of = Pattern(*u.shape, [load.nodes_paired]), AccumulatedBlocks(load, *u.shape, np.float64)
    data = np.zeros(pattern.nnz)
    of.add_stiffness(u, T, of.pairs.rows(pattern), data)
    return pattern.matrix(data)


def two_states(case):
    u = 0.3 * state(case.mesh).reshape(-1, case.mesh.d)
    return u, state(case.mesh, seed=4).reshape(-1, case.mesh.d)


@pytest.mark.few
@pytest.mark.parametrize("name", CASES)
def test_declared_properties_hold(name):
    case = CASES[name]
    load = bound(case)
    assert (load.has_potential, load.dead, load.steady) == (case.has_potential, case.dead, case.steady)
    u, v = two_states(case)
    assert np.array_equal(force(load, u), force(load, u + v)) == case.dead
    assert np.array_equal(force(load, u, Moment(0.1, 0.8)), force(load, u)) == case.steady
    assert np.abs(force(load, u)).max() > 1e-3 and sum(load.memory().values()) > 0


@pytest.mark.parametrize("name", WITH_POTENTIAL)
def test_the_force_is_minus_the_gradient_of_the_potential(name):
    case = CASES[name]
    load, (u, v) = bound(case), two_states(case)
    f = force(load, u)
    slope = derivative(lambda s: load.potential(u + s * v, T), 1e-3)
    assert slope == pytest.approx(-np.vdot(f, v), abs=1e-9 * (np.abs(f) * np.abs(v)).sum())


@pytest.mark.parametrize("name", WITHOUT)
def test_a_load_without_potential_refuses_to_return_it(name):
    case = CASES[name]
    with pytest.raises(LoadError, match="has no potential"):
        bound(case).potential(two_states(case)[0], T)


@pytest.mark.parametrize("name", NOT_DEAD)
def test_the_stiffness_is_minus_the_derivative_of_the_force(name):
    case = CASES[name]
    load, (u, v) = bound(case), two_states(case)
    K = stiffness(case, load, u)
    expected = -derivative(lambda s: force(load, u + s * v), 1e-3)
    assert (K @ v.ravel()).reshape(v.shape) == pytest.approx(expected, abs=1e-8 * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-3
    asymmetry = abs(K - K.T).max() / abs(K).max()
    assert (asymmetry < 1e-14, asymmetry > 1e-3) == (case.has_potential, not case.has_potential)


@pytest.mark.few
@pytest.mark.parametrize("name", CASES)
def test_loads_add_to_earlier_values_on_a_larger_pattern(name):
    case = CASES[name]
    load, (u, _) = bound(case), two_states(case)
    out = np.full(u.shape, 2.0)
    load.add_force(u, T, out)
    assert out - 2 == pytest.approx(force(load, u), abs=1e-14 * np.abs(out).max())
    with_it, without = (
        System(case.mesh, [ELASTIC, case.load]).jacobian(u.ravel(), T),
        System(case.mesh, ELASTIC).jacobian(u.ravel(), T),
    )
    own = 0 * without if case.dead else stiffness(case, load, u)
    assert abs(with_it - without - own).max() <= 1e-13 * abs(with_it).max()


@pytest.mark.few
@pytest.mark.parametrize("name", CASES)
def test_a_system_has_the_properties_of_its_load(name):
    case = CASES[name]
    system, u = System(case.mesh, [ELASTIC, case.load]), two_states(case)[0]
    assert (system.conservative, system.dead) == (case.has_potential, case.dead)
    kept = case.steady and case.has_potential
    motion = Motion(system, "lumped", None)
    assert (motion.constant_loads is not None) == (case.steady and case.dead) and motion.driven != kept
    potential = motion.add_up(MotionState.at(0.4, u.ravel(), 0 * u.ravel()), np.zeros(8))
    assert potential == pytest.approx(bound(case).potential(u, motion.moment(0.4)) if kept else 0, rel=1e-13)


@pytest.mark.few
@pytest.mark.parametrize("name", NOT_DEAD)
def test_load_stiffness_is_that_of_conservative_loads(name):
    case = CASES[name]
    system, u = System(case.mesh, [ELASTIC, case.load]), two_states(case)[0]
    found, size = system.load_stiffness(u.ravel(), T), abs(stiffness(case, bound(case), u)).max()
    missing = stiffness(case, bound(case), u) - (0 if found is None else found)
    assert (abs(missing).max() <= 1e-14 * size, found is None) == (case.has_potential, not case.has_potential)
