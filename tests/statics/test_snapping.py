"""Whether a step of the load that snapped the body through says so, however large the step is."""

import numpy as np
import pytest
import skfem
from scenes import bent, block, column

from skfem_stvk import NodalLoad, Pressure, StVK, System, solve_static
from skfem_stvk.linear import SuperLU
from skfem_stvk.nonlinear.stopwatch import Stopwatch
from skfem_stvk.statics import Status, load_steps
from skfem_stvk.statics.equilibrium import Equilibrium
from skfem_stvk.statics.load_steps import MOST, Between, OnPath

OPTIONS = {"quiet": True, "raise_on_failure": False}


def truss(load):
    """Three bars from feet on a circle to an apex twice as high as wide, pressed down: its limit point is at 413."""
    angle = 2 * np.pi * np.arange(3) / 3
    p = np.array([[*np.cos(angle), 0], [*np.sin(angle), 0], [0, 0, 0, 2.0]])
    terms = [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([3], (0, 0, -load))]
    return System((p, np.array([[0, 1, 2], [3, 3, 3]])), terms, fixed=[([0, 1, 2], "xyz")])


@pytest.mark.parametrize("steps", [1, 2, 5, 20])
@pytest.mark.parametrize("load", [500.0, 900.0, 3000.0, 6000.0, 20000.0])
def test_a_tall_truss_that_snaps_through_says_so_in_any_number_of_steps(load, steps):
    """At 6000 it lands where the tangent at rest points to."""
    result = solve_static(truss(load), steps=steps, **OPTIONS)
    assert result.u[-1] < -4 and result.status is Status.CONVERGED
    assert "snapped or buckled there" in result.message
    assert sum(step.jumped for step in result.history) == 1
    assert str(next(step for step in result.history if step.jumped)).endswith("jumped")


@pytest.mark.parametrize("steps", [1, 2, 5, 20])
def test_a_truss_that_is_loaded_less_does_not_say_so(steps):
    result = solve_static(truss(200.0), steps=steps, **OPTIONS)
    assert -0.5 < result.u[-1] < -0.2 and result.status is Status.CONVERGED
    assert "snapped" not in result.message and not any(step.jumped for step in result.history)


def test_a_step_after_one_that_failed_is_looked_at_too(monkeypatch):
    """From it no two states point anywhere."""
    monkeypatch.setattr(load_steps.LoadSteps, "_pointed", lambda self, t: None)
    result = solve_static(truss(600.0), steps=5, **OPTIONS)
    assert sum(step.jumped for step in result.history) == 1 and result.history[0].jump is None


def cantilever(load):
    """Slender: in one step it bends to where its tangent at rest points past many times."""
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 10, 81), np.linspace(0, 0.2, 3))
    return System(
        mesh,
        [StVK(young=1.2e6, poisson=0.3), NodalLoad(np.flatnonzero(mesh.p[0] == 10), (0, -load / 3))],
        fixed={lambda x: x[0] == 0: "xy"},
    )


def inflated():
    """A flat sheet in space that is blown up, its rim held; only its own stretching holds it across."""
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    p = np.vstack([mesh.p, 0.02 * np.prod(np.sin(np.pi * mesh.p), axis=0)])
    rim = np.unique(mesh.facets[:, mesh.boundary_facets()])
    return System((p, mesh.t), [StVK(young=1e5, poisson=0.3, thickness=1e-2), Pressure(None, 500.0)], fixed=[(rim, "xyz")])


def turned():
    """A bar whose end is turned by 90 degrees in one step."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 5, 11), *[np.linspace(0, 1, 3)] * 2)

    def turn(x, t):
        y, z, c, s = x[1] - 0.5, x[2] - 0.5, np.cos(t * np.pi / 2), np.sin(t * np.pi / 2)
        return np.stack([0 * y, (c - 1) * y - s * z, s * y + (c - 1) * z])

    return System(mesh, StVK(young=1e5, poisson=0.3), fixed={lambda x: x[0] == 0: "xyz"}, prescribed={lambda x: x[0] == 5: turn})


def late():
    """A load that grows with the fourth power of t: at the start nothing moves."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 4, 9), *[np.linspace(0, 1, 3)] * 2)
    end = np.flatnonzero(mesh.p[0] == 4)
    terms = [StVK(young=1e4, poisson=0.3), NodalLoad(end, lambda t: (0, 0, -10 * t**4))]
    return System(mesh, terms, fixed={lambda x: x[0] == 0: "xyz"})


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize(
    "system",
    [lambda: cantilever(60.0), inflated, turned, late, bent, lambda: block(0.2)],
    ids=["bent far", "inflated", "turned", "late", "bent", "pressed"],
)
def test_bodies_that_bend_turn_or_tighten_in_one_step_do_not_say_that_they_snapped(system, steps):
    result = solve_static(system(), steps=steps, **OPTIONS)
    assert result.success and not any(step.jumped for step in result.history) and "snapped" not in result.message


def test_a_column_that_is_all_but_perfect_buckles_in_one_step():
    euler = np.pi**2 * (1e4 / (1 - 0.3**2)) / 12 / (4 * 20**2)
    result = solve_static(column(3 * euler, 1e-5), steps=1, **OPTIONS)
    assert np.abs(result.u.reshape(-1, 2)[:, 1]).max() > 5 and "snapped or buckled there" in result.message


def test_where_the_answer_is_linear_nothing_is_solved_for(monkeypatch):
    """The force along the straight way says so."""
    asked = []
    monkeypatch.setattr(Between, "_answer", lambda self, *state: asked.append(state))
    assert solve_static(truss(10.0), steps=1, **OPTIONS).history[0].jump is None and not asked


def test_states_in_between_are_few(monkeypatch):
    """Also on a path that is nowhere near what its tangents say, however small the steps."""
    asked = []
    monkeypatch.setattr(Between, "_is_straight", lambda self, before, after: False)
    monkeypatch.setattr(Between, "_answer", lambda self, state, t: np.full(12, t - state.t))
    problem = Equilibrium(truss(1.0), SuperLU(), Stopwatch())
    between = Between(problem, lambda before, start, t: asked.append(t) or np.full(12, 3 * t))
    assert between.jump(OnPath(0.0, np.zeros(12)), OnPath(1.0, np.full(12, 3.0))) is None and len(asked) == MOST
