"""Continuation by arc length: all states on the path, limit points forwards and back, and the end of the path."""

from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from beams import CRITICAL, beam, bent, block, column, free_of, tangent

from skfem_stvk import ElementMesh, NodalLoad, Pressure, Stop, StVK, System, Traction, solve_static
from skfem_stvk.errors import StvkError
from skfem_stvk.linear import SuperLU
from skfem_stvk.solvers.newton.stopwatch import Stopwatch
from skfem_stvk.solvers.statics import CriticalPoint, SolveError, Status
from skfem_stvk.solvers.statics.arc_length import ArcLength, ArcLengthState
from skfem_stvk.solvers.statics.continuation import SMALLEST
from skfem_stvk.solvers.statics.critical import Point
from skfem_stvk.solvers.statics.equilibrium import Equilibrium
from skfem_stvk.space import Space

SPAN, RISE, EA = 1.0, 0.1, 1e3
LENGTH = np.hypot(SPAN, RISE)
LIMIT = EA * RISE**3 / (3 * np.sqrt(3) * LENGTH**3)
DOWN = 0.4  # load at t = 1, beyond the limit of 0.19
OPTIONS = {"method": "arc-length", "quiet": True}


def bar(load=DOWN):
    """Return an inclined bar whose head slides downwards, so that the bar snaps through."""
    p, t = np.array([[-SPAN, 0.0], [0, RISE]]), np.array([[0], [1]])
    return System((p, t), [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([1], (0, -load))], fixed=[([0], "xy"), ([1], "x")])


def force_of(w):
    return EA / (2 * LENGTH**3) * w * (w - RISE) * (w - 2 * RISE)


def test_every_state_of_a_snap_through_is_on_its_curve():
    result = solve_static(bar(), steps=20, **OPTIONS)
    w = -result.history.u[:, 3]
    np.testing.assert_allclose(DOWN * result.history.t, force_of(w), atol=1e-10 * LIMIT)
    assert result.success and result.t == 1 and w[-1] > 2 * RISE
    assert (np.diff(w) > 0).all() and (np.diff(result.history.t) < 0).any()
    between = np.abs(w - RISE) < RISE / np.sqrt(3)
    assert [step.negative for step in result.history] == between.astype(int).tolist()
    assert [step.status.success for step in result.history] == (~between).tolist()
    assert {step.jump for step in result.history} == {None}


def test_limit_points_are_found_to_many_digits():
    result = solve_static(bar(), steps=20, **OPTIONS)
    assert [point.kind for point in result.critical_points] == ["limit point"] * 2
    for point, sign in zip(result.critical_points, (1, -1), strict=True):
        assert point.resolved
        assert DOWN * point.t == pytest.approx(sign * LIMIT, rel=1e-10)
        assert -point.u[3] == pytest.approx(RISE * (1 - sign / np.sqrt(3)), rel=1e-9)
        np.testing.assert_allclose(point.mode, [0, 0, 0, 1], atol=1e-12)


def test_the_path_returns_to_its_start():
    there = solve_static(bar(), steps=20, stop=Stop(turns=2), **OPTIONS)
    back = solve_static(bar(), steps=20, u0=there.u, t0=there.t, stop=Stop(displacement=([1], "y", -0.01)), **OPTIONS)
    w = -back.history.u[:, 3]
    np.testing.assert_allclose(DOWN * back.history.t, force_of(w), atol=1e-10 * LIMIT)
    assert w[-1] == pytest.approx(0.01, abs=1e-15) and (np.diff(w) < 0).all() and len(back.critical_points) == 2
    assert [point.t for point in back.critical_points] == pytest.approx([point.t for point in there.critical_points[::-1]])


@pytest.mark.parametrize("load", [-0.3, 0.3, 1.0])
def test_a_load_is_reached_exactly(load):
    result = solve_static(bar(), steps=7, stop=Stop(load=load), rtol=1e-12, **OPTIONS)
    assert result.t == load and result.success
    assert DOWN * load == pytest.approx(force_of(-result.u[3]), abs=1e-10 * LIMIT)


def test_a_displacement_is_reached_exactly_and_an_unstable_end_does_not_raise():
    result = solve_static(bar(), steps=20, stop=Stop(displacement=([1], "y", -RISE)), **OPTIONS)
    assert result.u[3] == pytest.approx(-RISE, abs=1e-15) and result.t == pytest.approx(0, abs=1e-12)
    assert result.status is Status.UNSTABLE and not result.success and "limit point at t = 0.47" in result.message


def test_the_first_stop_that_is_reached_ends_the_path():
    stop = Stop(load=1.0, displacement=([1], "y", -0.15), turns=2, states=500)
    assert solve_static(bar(), steps=20, stop=stop, **OPTIONS).u[3] == -0.15
    first = solve_static(bar(), steps=20, stop=Stop(load=1.0, turns=1), **OPTIONS)
    assert first.history[-1].negative == 1 and first.history[-2].negative == 0
    assert len(solve_static(bar(), steps=20, stop=Stop(states=3), **OPTIONS).history) == 3


def test_a_path_that_does_not_reach_its_stop_is_reported(monkeypatch):
    from skfem_stvk.solvers.statics import stop

    monkeypatch.setattr(stop, "MOST_STATES", 10)
    with pytest.raises(SolveError, match=r"before its end.*the stop is not reached after 10 states") as failure:
        solve_static(bar(), steps=20, **OPTIONS)
    assert len(failure.value.result.history) == 10


def test_the_states_are_those_of_load_steps_where_there_is_no_limit_point():
    by_steps, by_length = solve_static(bent(), rtol=1e-11, quiet=True), solve_static(bent(), rtol=1e-11, **OPTIONS)
    np.testing.assert_allclose(by_length.u, by_steps.u, atol=1e-9)
    assert by_length.success and not by_length.critical_points


@pytest.mark.filterwarnings("ignore:From t")
def test_prescribed_displacements_have_limit_points():
    """The path of a compressed block ends at a limit point of the prescribed displacement, where load steps stop."""
    result = solve_static(block(0.4), steps=20, stop=Stop(turns=1), **OPTIONS)
    (limit,) = result.critical_points
    stopped = solve_static(block(0.4), steps=20, quiet=True, raise_on_failure=False)
    assert limit.kind == "limit point" and limit.resolved and stopped.t == pytest.approx(limit.t, rel=1e-3) and stopped.t < limit.t
    K = tangent(result.system, limit.u, limit.t)
    values = np.linalg.eigvalsh(K)
    assert abs(values[0]) < 1e-5 * values[-1] and values[1] > 100 * abs(values[0])
    mode = K @ limit.mode[free_of(result.system)]
    assert np.abs(mode).max() < 1e-4 * values[-1]


@pytest.mark.parametrize("solver", ["superlu", "pardiso"])
def test_a_bifurcation_is_found_and_its_mode_leads_to_the_other_path(solver):
    system = column(1.3 * CRITICAL)
    result = solve_static(system, steps=4, solver=solver, **OPTIONS)
    (point,) = result.critical_points
    values = np.linalg.eigvalsh(tangent(system, point.u, point.t))
    assert point.kind == "bifurcation" and point.resolved and abs(values[0]) < 1e-9 * values[-1]
    below = solve_static(system, steps=4, quiet=True, raise_on_failure=False).critical_points
    assert [one.t for one in below] == pytest.approx([point.t], rel=1e-8), "load steps find it too"
    bent_mesh = (system.mesh.p + 0.02 * point.mode.reshape(-1, 2).T, system.mesh.t)
    terms = [system.terms[0], Traction(lambda x: x[0] > 19.9, (-1.3 * CRITICAL, 0))]
    buckled = solve_static(System(bent_mesh, terms, fixed={lambda x: x[0] < 1e-9: "xy"}), quiet=True)
    assert buckled.success and np.abs(buckled.u).max() > 5 and not buckled.critical_points


def arch(n=40):
    """Return the mesh of a shallow arch in plane strain."""
    quads = skfem.MeshQuad.init_tensor(np.linspace(-1, 1, n + 1), np.linspace(-0.01, 0.01, 3))
    mesh = quads.to_meshtri()
    x, y = mesh.p
    p = np.stack([x, y + 0.12 * (1 - x**2)])
    top = mesh.facets[:, mesh.facets_satisfying(lambda x: x[1] == 0.01)]
    return ElementMesh(p, mesh.t, boundaries={"top": top})


def test_under_follower_pressure_between_clamps_an_arch_snaps_and_eigenvalues_are_counted():
    """An arch under follower pressure snaps through, and its negative eigenvalues are counted.

    K is symmetric because the rim of the loaded surface is clamped.
    """
    mesh = arch()
    terms = [StVK(young=1e4, poisson=0.3), Pressure("top", 2.0)]
    system = System(mesh, terms, fixed={lambda x: np.abs(x[0]) == 1: "xy"})
    apex = np.flatnonzero((np.abs(mesh.p[0]) < 1e-9) & (mesh.p[1] > 0.12))
    result = solve_static(system, steps=20, stop=Stop(displacement=(apex, "y", -0.2)), **OPTIONS)
    assert {step.negative for step in result.history} == {0, 1}
    free = free_of(system)
    for step in result.history:
        residual, J = system.residual(step.u, step.t), tangent(system, step.u, step.t)
        assert (np.linalg.eigvalsh((J + J.T) / 2) < 0).sum() == step.negative
        assert np.linalg.norm(residual[free]) < 1e-7 * np.linalg.norm(residual)
    first = result.critical_points[0]
    assert first.kind == "limit point" and first.resolved
    values = np.linalg.svd(tangent(system, first.u, first.t), compute_uv=False)
    assert values[-1] < 1e-7 * values[0] and values[-2] > 100 * values[-1]


def test_an_unstructured_beam_of_negative_orientation_follows_its_load():
    system = System(beam(), [StVK(young=1e4, poisson=0.3), NodalLoad([5], (0, 0, -30.0))], fixed={"wall": "xyz"})
    result = solve_static(system, steps=5, **OPTIONS)
    assert result.success and np.abs(system.residual(result.u)[free_of(system)]).max() < 1e-5


def test_a_start_without_stiffness_is_refused_as_a_mechanism():
    p, t = np.array([[0, 1, 2.0], [0, 0, 0]]), np.array([[0, 1], [1, 2]])
    flat = System((p, t), [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([1], (0, -1.0))], fixed=[([0, 2], "xy")])
    with pytest.raises(SolveError, match=r"mechanism"):
        solve_static(flat, **OPTIONS)


@pytest.mark.few
@pytest.mark.parametrize("load", [0.40, 0.46, 0.473, 0.4739])
@pytest.mark.parametrize("steps", [1, 2, 3, 4, 6, 10, 20])
def test_a_load_just_below_a_limit_point_is_not_skipped(load, steps):
    """A load just below the limit point at 0.47399752 is reached before the limit point, at any length of the steps."""
    result = solve_static(bar(), steps=steps, stop=Stop(load=load), **OPTIONS)
    assert result.t == load and result.success and not result.critical_points
    assert 0 < -result.u[3] < RISE * (1 - 1 / np.sqrt(3))


def test_the_displacement_of_a_location_is_the_mean_of_its_vertices():
    system = bent()
    tip = np.unique(system.mesh.boundaries["tip"])
    result = solve_static(system, steps=4, stop=Stop(displacement=("tip", "z", -0.4)), **OPTIONS)
    assert result.u.reshape(-1, 3)[tip, 2].mean() == pytest.approx(-0.4, abs=1e-12) and 0 < result.t < 1


@pytest.mark.filterwarnings("ignore:From t")
def test_elements_do_not_invert_on_the_path():
    result = solve_static(block(0.4), steps=2, stop=Stop(states=12), **OPTIONS, raise_on_failure=False)
    assert len(result.history) >= 3 and min(step.smallest_volume_ratio for step in result.history) > 0


def test_loads_nonlinear_in_the_load_factor_are_followed():
    """Each state is that of load steps at the same load factor.

    Prescribed displacements and loads are nonlinear in the load factor.
    """
    mesh = beam()

    def move(x, t):
        return np.stack([0.1 * t + 0 * x[0], 0.5 * np.sin(2 * t) * x[1], -2 * t**2 + 0 * x[0]])

    terms = [StVK(young=1e4, poisson=0.3), NodalLoad([40], lambda t: (0, 30 * t**3, 20 * np.sin(3 * t)))]
    system = System(mesh, terms, fixed={"wall": "xyz"}, prescribed={"tip": move})
    result, by_steps = solve_static(system, steps=5, rtol=1e-11, **OPTIONS), solve_static(system, steps=20, rtol=1e-11, quiet=True)
    tip = np.unique(mesh.boundaries["tip"])
    assert result.success and len(result.history) > 3
    for step in [*result.history, *by_steps.history]:
        np.testing.assert_allclose(step.u.reshape(-1, 3)[tip], move(mesh.p[:, tip], step.t).T, atol=1e-14)
    np.testing.assert_allclose(result.u, by_steps.u, atol=1e-8)


def test_the_rate_of_a_path_is_the_derivative_of_its_states():
    """The direction of the path is `du/dt`, with moving supports and loads nonlinear in the load factor."""
    from skfem_stvk.solvers.statics.equilibrium import path_tangent

    def move(x, t):
        return np.stack([0 * x[0], 0.5 * np.sin(2 * t) * x[1], -2 * t**2 + 0 * x[0]])

    terms = [StVK(young=1e4, poisson=0.3), NodalLoad([40], lambda t: (0, 30 * t**3, 20 * np.sin(3 * t)))]
    system = System(beam(), terms, fixed={"wall": "xyz"}, prescribed={"tip": move})
    options = {"steps": 1, "rtol": 1e-12, "quiet": True, "method": "arc-length"}
    first, second = (solve_static(system, stop=Stop(load=t), **options) for t in (0.5 - 1e-4, 0.5 + 1e-4))
    middle = solve_static(system, stop=Stop(load=0.5), **options)
    found = path_tangent(Equilibrium(system, SuperLU(), Stopwatch()), middle.u, 0.5)
    np.testing.assert_allclose(found.direction / found.rate, (second.u - first.u) / 2e-4, atol=1e-5)
    assert np.linalg.norm(found.direction) == pytest.approx(1)


def test_a_path_that_begins_on_a_level_continues_until_it_returns_to_the_level():
    result = solve_static(bar(), steps=20, stop=Stop(load=0.0), **OPTIONS)
    assert result.t == 0 and -result.u[3] == pytest.approx(RISE, rel=1e-9)


@pytest.mark.parametrize("steps", [1, 10])
@pytest.mark.parametrize("stop", [Stop(load=1.0), Stop(displacement=([1], "y", -0.01))])
@pytest.mark.parametrize("sag", [1e-3, 1e-7])
def test_a_cable_that_is_nearly_a_mechanism_stops_at_the_requested_level(sag, stop, steps):
    """A cable that is nearly a mechanism stops at the requested level.

    The tangent at rest leads 5e8 m away at t = 1, where the load would be 1e31. The level was once missed in such a step.
    """
    cable = ElementMesh([[0.0, 1, 2], [0, -sag, 0]], [[0, 1], [1, 2]])
    system = System(cable, [StVK(young=1e5, poisson=0.3, area=1.0), NodalLoad([1], (0, -1.0))], fixed={(0, 2): "xy"})
    result = solve_static(system, steps, stop=stop, **OPTIONS)
    w = -result.u[3]
    assert 1e5 * w * (w + sag) * (w + 2 * sag) / np.hypot(1, sag) ** 3 == pytest.approx(result.t, rel=1e-6)
    assert result.t == 1 if stop.load else w == pytest.approx(0.01)


def test_a_step_that_ends_on_a_level_up_to_rounding_ends_the_path():
    """A step that ends at t = 1 up to rounding ends the path.

    The first step of a hardly strained bar leads to t = 1 or to 1 - 1e-16. No further step crosses the level from there.
    """
    rng = np.random.default_rng(0)
    for _ in range(60):
        p, force = np.array([[0.0, rng.uniform(0.1, 3)]]), 10.0 ** rng.uniform(-4, -1)
        bar = System((p, np.array([[0], [1]])), [StVK(young=1e5, poisson=0.3, area=1.0), NodalLoad([1], (force,))], {(0,): "x"})
        result = solve_static(bar, 1, **OPTIONS)
        assert result.t == 1 and len(result.history) == 1


@pytest.mark.parametrize(("load", "w"), [(0.3, 0.02), (0.4, 0.02), (0.4, 0.03)])
def test_the_first_of_two_levels_in_one_step_ends_the_path(load, w):
    result = solve_static(bar(), steps=2, stop=Stop(load=load, displacement=([1], "y", -w)), **OPTIONS)
    if load < force_of(w) / DOWN:
        assert result.t == load and -result.u[3] < w
    else:
        assert result.t < load and -result.u[3] == pytest.approx(w, abs=1e-15)


def test_more_states_than_the_default_limit_can_be_requested(monkeypatch):
    from skfem_stvk.solvers.statics import stop

    monkeypatch.setattr(stop, "MOST_STATES", 5)
    assert len(solve_static(bar(), steps=20, stop=Stop(states=8), **OPTIONS).history) == 8


def test_the_state_at_the_start_is_counted():
    there = solve_static(bar(), steps=20, stop=Stop(load=0.3), **OPTIONS)
    result = solve_static(bar(), steps=20, u0=there.u, t0=0.3, stop=Stop(states=3), **OPTIONS)
    assert len(result.history) == 3 and result.history[0].t == 0.3


def test_loads_are_not_evaluated_beyond_1():
    evaluated = []

    def load(t):
        evaluated.append(t)
        return (0, -0.1 * t)

    p, t = np.array([[-SPAN, 0.0], [0, RISE]]), np.array([[0], [1]])
    system = System((p, t), [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([1], load)], fixed=[([0], "xy"), ([1], "x")])
    result = solve_static(system, steps=5, quiet=True)
    problem = Equilibrium(system, SuperLU(), Stopwatch())
    for u, factor in ((0 * result.u, 0.0), (result.u, 1.0)):
        problem.factorise(u, factor)
        np.testing.assert_allclose(problem.rate(u, factor)[0], [-0.1], rtol=1e-6)
    assert result.success and min(evaluated) >= 0 and max(evaluated) <= 1


@pytest.mark.parametrize("steps", [3, 10, 20, 100])
def test_load_steps_report_where_the_body_snapped(steps):
    result = solve_static(bar(), steps=steps, quiet=True)
    (snapped,) = (step for step in result.history if step.jumped)
    before = result.history[list(result.history).index(snapped) - 1]
    assert before.t < LIMIT / DOWN < snapped.t and before.u[3] > -RISE < 0 and snapped.u[3] < -2 * RISE
    assert (
        f"Between t = {before.t:.4g} and t = {snapped.t:.4g} it moved" in result.message and "snapped or buckled" in result.message
    )
    assert "jumped" in str(snapped) and "jumped" not in str(before)


def steep_arch():
    """Return a clamped arch on a mesh without symmetry.

    The arch is so steep that its path passes several limit points and bifurcations.
    """
    h, rise = 0.01, 0.08
    strip = skfem.MeshQuad.init_tensor(np.linspace(-0.5, 0.5, 41), np.linspace(-h / 2, h / 2, 3)).to_meshtri()
    x, y = strip.p
    apex = np.flatnonzero((np.abs(x) < 1e-12) & (y == h / 2))
    terms = [StVK(young=70e6, poisson=0.3), NodalLoad(apex, (0, -40.0))]
    mesh = np.stack([x, y + rise * np.cos(np.pi * x) ** 2]), strip.t
    return System(mesh, terms, fixed=[(np.flatnonzero(np.abs(x) == 0.5), "xy")]), apex


@pytest.mark.slow
def test_the_path_of_a_steep_arch_does_not_depend_on_the_steps():
    system, apex = steep_arch()
    paths = [solve_static(system, n, stop=Stop(displacement=(apex, "y", -0.16)), **OPTIONS) for n in (5, 20, 80)]
    points = [[(point.kind, point.resolved) for point in path.critical_points] for path in paths]
    assert len(points[0]) >= 4 and points[0] == points[1] == points[2] and all(resolved for _, resolved in points[0])
    loads = [[point.t for point in path.critical_points] for path in paths]
    np.testing.assert_allclose(loads[1], loads[0], rtol=1e-6)
    np.testing.assert_allclose(loads[2], loads[0], rtol=1e-6)
    np.testing.assert_allclose([path.t for path in paths], paths[0].t, rtol=1e-6)


def test_states_beyond_another_stop_are_not_resumed(tmp_path):
    call = {"steps": 20, "checkpoint": tmp_path / "path", **OPTIONS}
    solve_static(bar(), stop=Stop(displacement=([1], "y", -0.03)), **call)
    passed = r"stop = Stop\(load={}\); .* pass it between {} .* and state \d+ .*begin a new path from {}"
    with pytest.raises(StvkError, match=passed.format(0.3, r"state \d+", r"state \d+")):
        solve_static(bar(), stop=Stop(load=0.3), resume=True, **call)
    with pytest.raises(StvkError, match=passed.format(0.01, "the start", "the start")):
        solve_static(bar(), stop=Stop(load=0.01), resume=True, **call)


@pytest.mark.few
@pytest.mark.parametrize(
    ("before", "after", "resolved", "hopped"),
    [
        (0, 1, [True], False),
        (0, 2, [True, True], False),
        (1, 1, [], False),
        (0, 2, [True, True, True, True], False),  # two of them cancel
        (0, 0, [True], True),
        (0, 2, [True], True),
        (1, 0, [], True),
        (0, 1, [False], True),
        (None, 1, [True], False),
        (0, None, [], False),
    ],
)
def test_a_step_stays_on_the_path_if_its_critical_points_explain_the_change(before, after, resolved, hopped):
    path, u = object.__new__(ArcLength), np.zeros(2)
    path._point = Point(u, 0.0, before, None)
    points = tuple(CriticalPoint("bifurcation", 0.5, u, u, one) for one in resolved)
    assert path._left_the_path(Point(u, 1.0, after, None), points) is hopped


def test_successful_steps_are_never_too_short_to_continue():
    """Repeated sharp bends of the path do not shorten the steps below the smallest size.

    A path with sharp bends at twenty states once ended for its short steps, with the message that nothing was reached.
    """
    path = object.__new__(ArcLength)
    path.problem, path.u, path._initial = SimpleNamespace(states=Space(2)), np.zeros(2), np.zeros(2)
    path._first_load, path.next = 0.1, ArcLengthState(size=1.0, first=1.0)
    for _ in range(20):
        path._adapt(iterations=4, cosine=0.6)
    assert path.next.size == SMALLEST
