"""A load step in which the body snaps through is reported, at any size of the step."""

import numpy as np
import pytest
import skfem
from beams import CRITICAL, bent, block, column

from skfem_stvk import NodalLoad, Pressure, StVK, System, solve_static
from skfem_stvk.linear import SuperLU
from skfem_stvk.solvers.newton.stopwatch import Stopwatch
from skfem_stvk.solvers.statics import Status, load_steps
from skfem_stvk.solvers.statics.critical import Point
from skfem_stvk.solvers.statics.equilibrium import Equilibrium
from skfem_stvk.solvers.statics.load_steps import MOST_SOLVES, JumpDetector

OPTIONS = {"quiet": True, "raise_on_failure": False}


def truss(load):
    """Return three bars from feet on a circle to an apex twice as high as the radius, pressed down; its limit point is at 413."""
    angle = 2 * np.pi * np.arange(3) / 3
    p = np.array([[*np.cos(angle), 0], [*np.sin(angle), 0], [0, 0, 0, 2.0]])
    terms = [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([3], (0, 0, -load))]
    return System((p, np.array([[0, 1, 2], [3, 3, 3]])), terms, fixed=[([0, 1, 2], "xyz")])


@pytest.mark.few
@pytest.mark.parametrize("steps", [1, 2, 5, 20])
@pytest.mark.parametrize("load", [500.0, 900.0, 3000.0, 6000.0, 20000.0])
def test_the_snap_of_a_tall_truss_is_reported_in_any_number_of_steps(load, steps):
    """The snap of a tall truss is reported in any number of steps; at 6000 its end is where the tangent at rest points to."""
    result = solve_static(truss(load), steps=steps, **OPTIONS)
    assert result.u[-1] < -4 and result.status is Status.CONVERGED
    assert "snapped or buckled there" in result.message
    (jump,) = result.jumps
    assert jump in list(result.history) and jump.jumped and str(jump).endswith("jumped")


@pytest.mark.parametrize("steps", [1, 2, 5, 20])
def test_no_snap_is_reported_for_smaller_loads(steps):
    result = solve_static(truss(200.0), steps=steps, **OPTIONS)
    assert -0.5 < result.u[-1] < -0.2 and result.status is Status.CONVERGED
    assert "snapped" not in result.message and result.jumps == () and not any(step.jumped for step in result.history)


def test_a_snap_after_a_failed_step_is_reported(monkeypatch):
    """A snap after a failed step is reported, although no prediction from two states exists there."""
    monkeypatch.setattr(load_steps.LoadSteps, "_extrapolated", lambda self, t: None)
    result = solve_static(truss(600.0), steps=5, **OPTIONS)
    assert sum(step.jumped for step in result.history) == 1 and result.history[0].jump is None


def cantilever(load):
    """Return a slender cantilever, which in one step bends far less than its tangent at rest predicts."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 10, 81), np.linspace(0, 0.2, 3))
    return System(
        mesh,
        [StVK(young=1.2e6, poisson=0.3), NodalLoad(np.flatnonzero(mesh.p[0] == 10), (0, -load / 3))],
        fixed={lambda x: x[0] == 0: "xy"},
    )


def inflated():
    """Return a flat sheet in space with a clamped rim, which is inflated; only its own tension resists transverse loads."""
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    p = np.vstack([mesh.p, 0.02 * np.prod(np.sin(np.pi * mesh.p), axis=0)])
    rim = np.unique(mesh.facets[:, mesh.boundary_facets()])
    return System((p, mesh.t), [StVK(young=1e5, poisson=0.3, thickness=1e-2), Pressure(None, 500.0)], fixed=[(rim, "xyz")])


def twisted():
    """Return a bar whose end is rotated by 90 degrees."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 5, 11), *[np.linspace(0, 1, 3)] * 2)

    def twist(x, t):
        y, z, c, s = x[1] - 0.5, x[2] - 0.5, np.cos(t * np.pi / 2), np.sin(t * np.pi / 2)
        return np.stack([0 * y, (c - 1) * y - s * z, s * y + (c - 1) * z])

    return System(mesh, StVK(young=1e5, poisson=0.3), fixed={lambda x: x[0] == 0: "xyz"}, prescribed={lambda x: x[0] == 5: twist})


def late():
    """Return a body with a load that grows as t^4, so that it does not move at the start."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), *[np.linspace(0, 1, 3)] * 2)
    end = np.flatnonzero(mesh.p[0] == 4)
    terms = [StVK(young=1e4, poisson=0.3), NodalLoad(end, lambda t: (0, 0, -10 * t**4))]
    return System(mesh, terms, fixed={lambda x: x[0] == 0: "xyz"})


@pytest.mark.few
@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize(
    "system",
    [lambda: cantilever(60.0), inflated, twisted, late, bent, lambda: block(0.2)],
    ids=["bent far", "inflated", "twisted", "late", "bent", "pressed"],
)
def test_no_snap_is_reported_for_bodies_that_bend_rotate_or_stiffen_in_one_step(system, steps):
    result = solve_static(system(), steps=steps, **OPTIONS)
    assert result.success and not any(step.jumped for step in result.history) and "snapped" not in result.message


def test_a_nearly_perfect_column_buckles_in_one_step():
    result = solve_static(column(3 * CRITICAL, 1e-5), steps=1, **OPTIONS)
    assert np.abs(result.u.reshape(-1, 2)[:, 1]).max() > 5 and "snapped or buckled there" in result.message


def test_no_intermediate_states_are_solved_if_the_response_is_linear(monkeypatch):
    """If the response is linear, which the force along the straight line shows, no intermediate states are solved."""
    calls = []
    monkeypatch.setattr(JumpDetector, "_tangent_response", lambda self, *state: calls.append(state))
    assert solve_static(truss(10.0), steps=1, **OPTIONS).history[0].jump is None and not calls


def test_the_number_of_intermediate_states_is_limited(monkeypatch):
    """The number of intermediate states is limited, also on a path that is far from its predictions at any step size."""
    calls = []
    monkeypatch.setattr(JumpDetector, "_is_straight", lambda self, before, after: False)
    monkeypatch.setattr(JumpDetector, "_tangent_response", lambda self, state, t: np.full(12, t - state.t))
    problem = Equilibrium(truss(1.0), SuperLU(), Stopwatch())
    between = JumpDetector(problem, lambda before, start, t: calls.append(t) or np.full(12, 3 * t))
    assert between.jump(Point(np.zeros(12), 0.0), Point(np.full(12, 3.0), 1.0)) is None and len(calls) == MOST_SOLVES
