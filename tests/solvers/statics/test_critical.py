"""Bifurcations: their number, loads and modes."""

import itertools

import numpy as np
import pytest
import skfem
from beams import CRITICAL, column, tangent, two_bars
from slow import slow

from skfem_stvk import Isotropic, NodalLoad, Stop, StVK, StvkWarning, System, Traction, VolumePenalty, solve_static
from skfem_stvk.solvers.statics import Status, critical
from skfem_stvk.solvers.statics.critical import Point

OPTIONS = {"quiet": True, "raise_on_failure": False}


def lowest(system, u, t, count=3):
    return np.linalg.eigvalsh(tangent(system, u, t))[:count]


def strut(load, sides=(1.0, 1.0)):
    """Return a strut in space on a mesh with two planes of symmetry.

    With equal sides it buckles in two directions at the same load.
    """
    mesh = skfem.MeshHex.init_tensor(np.linspace(0, 10, 11), *[np.linspace(-side / 2, side / 2, 3) for side in sides])
    middle = mesh.p[:, mesh.t].mean(axis=1)
    p, t, centres = [mesh.p, middle], [], {}
    n = mesh.nvertices + mesh.nelements
    for element, corners in enumerate(mesh.t.T):
        offset = mesh.p[:, corners] - middle[:, element, None]
        for axis, side in itertools.product(range(3), (-1, 1)):
            face = corners[side * offset[axis] > 0]
            key = tuple(np.sort(face))
            if key not in centres:
                centres[key] = n
                p.append(mesh.p[:, face].mean(axis=1)[:, None])
                n += 1
            d = np.delete(mesh.p[:, face] - mesh.p[:, face].mean(axis=1, keepdims=True), axis, axis=0)
            ring = face[np.argsort(np.arctan2(*d))]
            t += [(mesh.nvertices + element, centres[key], a, b) for a, b in zip(ring, np.roll(ring, -1), strict=True)]
    return System(
        (np.hstack(p), np.array(t).T),
        [StVK(Isotropic(1e4, 0.0)), Traction(lambda x: x[0] > 9.99, (-load / np.prod(sides), 0, 0))],
        fixed={lambda x: x[0] < 1e-9: "xyz"},
    )


@pytest.mark.parametrize("method", ["load-steps", "arc-length"])
def test_both_modes_of_a_strut_with_equal_sides_are_found(method):
    system = strut(60.0)
    result = solve_static(system, steps=3, method=method, solver="superlu", **OPTIONS)
    assert [step.negative for step in result.history][-1] == 2
    first, second = result.critical_points
    assert first.kind == second.kind == "bifurcation" and first.resolved and second.resolved
    assert first.t == pytest.approx(second.t, rel=1e-6)
    values = lowest(system, first.u, first.t)
    assert (np.abs(values[:2]) < 1e-6 * values[2]).all()
    one, other = first.mode, second.mode
    assert abs(one @ other) < 1e-3 * np.linalg.norm(one) * np.linalg.norm(other)
    for mode in (one, other):
        assert np.abs(mode).max() == 1
        assert np.abs(mode.reshape(-1, 3)[:, 0]).max() < 0.3, "it bends"


def test_two_bifurcations_in_one_step_are_both_found():
    system = strut(70.0, (1.0, 1.2))
    result = solve_static(system, steps=1, method="arc-length", solver="superlu", **OPTIONS)
    assert result.history[0].negative == 2
    weak, strong = result.critical_points
    assert weak.resolved and strong.resolved and strong.t > 1.2 * weak.t
    for point, across in ((weak, 1), (strong, 2)):
        assert np.abs(lowest(system, point.u, point.t)).min() < 1e-6
        assert np.abs(point.mode.reshape(-1, 3)).max(axis=0).argmax() == across


def test_the_same_point_is_found_with_falling_load():
    up = solve_static(column(1.3 * CRITICAL), steps=4, method="arc-length", **OPTIONS)
    down = solve_static(column(1.3 * CRITICAL), steps=4, method="arc-length", u0=up.u, t0=1.0, stop=Stop(load=0.2), **OPTIONS)
    assert down.success and down.history[0].negative == 1 and down.history[-1].negative == 0
    assert [point.t for point in down.critical_points] == pytest.approx([point.t for point in up.critical_points], rel=1e-9)


def test_a_bifurcation_in_the_first_step_from_rest_is_found():
    system = column(1.3 * CRITICAL)
    result = solve_static(system, steps=1, **OPTIONS)
    assert len(result.history) == 1 and [point.resolved for point in result.critical_points] == [True]


def test_the_lowest_eigenvalue_of_each_state_is_that_of_its_tangent():
    system = column(1.3 * CRITICAL)
    result = solve_static(system, steps=4, solver="amg-cg", stability=True, **OPTIONS)
    for step in result.history:
        assert step.negative is None
        assert step.lowest == pytest.approx(lowest(system, step.u, step.t)[0], rel=1e-4)
    (near,) = result.critical_points
    exact = solve_static(system, steps=4, **OPTIONS).critical_points[0]
    assert not near.resolved and near.t == pytest.approx(exact.t, rel=1e-3)
    cosine = near.mode @ exact.mode / np.linalg.norm(near.mode) / np.linalg.norm(exact.mode)
    assert abs(cosine) > 0.99 and "near t" in str(near)


def test_an_iterative_solver_computes_eigenvalues_only_on_request():
    result = solve_static(column(0.5 * CRITICAL), steps=2, solver="amg-cg", quiet=True)
    assert {step.lowest for step in result.history} == {None} and not result.critical_points


def test_a_path_that_jumps_has_at_most_unresolved_points():
    """All critical points of a path that jumps have finite states and load factors.

    A load that drops suddenly pushes two bars through, so that no path connects two of the states.
    """
    result = solve_static(two_bars(0.1, lambda t: (0, -0.72 * t if t <= 0.5 else -0.5)), steps=2, **OPTIONS)
    assert all(np.isfinite(point.u).all() and np.isfinite(point.t) for point in result.critical_points)


@pytest.mark.parametrize(
    ("negative", "value", "unstable"), [(0, None, False), (2, None, True), (None, -1.0, True), (None, 1.0, False)]
)
def test_what_makes_a_state_unstable(negative, value, unstable):
    assert Point(np.zeros(1), 0.0, negative, value).unstable is unstable


@pytest.mark.parametrize("options", [{"method": "arc-length"}, {}, {"solver": "amg-cg", "stability": True}])
@pytest.mark.parametrize("rtol", [slow(1e-4), 1e-3])
def test_states_without_iterations_are_judged_by_their_own_tangents(rtol, options):
    """States without iterations are judged by their own tangents.

    The path of a straight column is nearly linear, so that the predicted states are solutions.
    """
    system = column(1.3 * CRITICAL)
    result = solve_static(system, steps=20, rtol=rtol, **({"solver": "superlu"} | options), **OPTIONS)
    assert 0 in [len(step.iterations) for step in result.history]
    for step in result.history:
        assert step.status.success == (lowest(system, step.u, step.t)[0] > 0)
    assert not result.success and [point.kind for point in result.critical_points] == ["bifurcation"]


@pytest.mark.parametrize("method", ["load-steps", "arc-length"])
def test_a_start_off_the_path_gives_no_critical_point(method):
    system = column(1e-3)
    u0 = np.zeros((system.mesh.nv, 2))
    u0[:, 0] = -0.05 * system.mesh.p[0]
    assert lowest(system, u0.ravel(), 0.0)[0] < 0
    result = solve_static(system, steps=3, u0=u0.ravel(), method=method, solver="superlu", **OPTIONS)
    assert result.success and not result.critical_points


@pytest.mark.filterwarnings("ignore:From t")
@pytest.mark.parametrize(("rise", "kinds"), [(1.5, ["limit point", "bifurcation"]), (2.0, ["bifurcation", "limit point"])])
@pytest.mark.parametrize("steps", [1, 2, 3, 40])
def test_limit_points_and_bifurcations_in_one_step_are_distinguished(rise, kinds, steps):
    """Limit points and bifurcations in one step are distinguished and ordered.

    Two steep bars buckle sideways as well as downwards.
    """
    stop = Stop(displacement=([1], "y", -rise))
    result = solve_static(two_bars(rise, (0, -300.0)), steps=steps, method="arc-length", stop=stop, **OPTIONS)
    assert [point.kind for point in result.critical_points] == kinds
    down = [-point.u[3] for point in result.critical_points]
    assert down == sorted(down)
    for point in result.critical_points:
        sideways = abs(point.mode[2]) > abs(point.mode[3])
        assert point.resolved and sideways == (point.kind == "bifurcation")
        assert abs(lowest(result.system, point.u, point.t)).min() < 1e-5


def test_the_message_names_three_points_and_the_number_of_further_ones():
    from types import SimpleNamespace

    from skfem_stvk.solvers.statics.message import _critical

    points = [f"point {i}" for i in range(5)]
    assert "point 0; point 1; point 2; ..." in _critical(SimpleNamespace(critical_points=points))
    assert "point 0; point 1; point 2 (" in _critical(SimpleNamespace(critical_points=points[:3]))


@pytest.mark.parametrize("steps", [1, 5, 40])
def test_a_cable_that_is_pulled_taut_has_no_bifurcation(steps):
    """A cable has no bifurcation: tangents during the iterations are indefinite, that of the state is not."""
    p, t = np.array([[0, 1, 2.0], [0, 0, 0]]), np.array([[0, 1], [1, 2]])
    cable = System((p, t), [StVK(young=1e5, poisson=0.3, area=1e-2), NodalLoad([1], (0, -1.0))], fixed=[([0, 2], "xy")])
    result = solve_static(cable, steps=steps, quiet=True)
    assert {step.negative for step in result.history} == {0} and not result.critical_points


@pytest.mark.parametrize("steps", [1, 5, 20])
def test_a_nearly_flattened_cube_ends_with_a_message(steps):
    cube = System(
        skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3),
        [StVK(young=1e5, poisson=0.3), VolumePenalty()],
        fixed={lambda x: x[2] == 0: "xyz"},
        prescribed={lambda x: x[2] == 1: {"z": -0.999}},
    )
    with pytest.warns(StvkWarning, match="compressed"):
        result = solve_static(cube, steps=steps, **OPTIONS)
    assert result.status is not Status.INTERRUPTED


def test_prescribed_displacements_are_not_recommended_if_used():
    mesh = column(1.0).mesh
    pressed = {lambda x: x[0] == 20: {"x": -0.2}}
    result = solve_static(
        System(mesh, StVK(young=1e4, poisson=0.3), fixed={lambda x: x[0] == 0: "xy"}, prescribed=pressed), **OPTIONS
    )
    assert result.status is Status.UNSTABLE
    assert "prescribe displacements" not in result.message and "critical_points[0].mode as an imperfection" in result.message


def test_a_nearby_state_replaces_one_with_an_exactly_singular_tangent(monkeypatch):
    chord, calls = object.__new__(critical._Chord), []

    def corrected(self, f):
        calls.append(f)
        return None if f == 0.5 else (np.zeros(2), f)

    monkeypatch.setattr(critical._Chord, "_corrected", corrected)
    assert 0 < abs(chord.at(0.5)[1] - 0.5) < 1e-7 and calls[0] == 0.5
    monkeypatch.setattr(critical._Chord, "_corrected", lambda self, f: None)
    with pytest.raises(critical._PathLost):
        chord.at(0.5)


def test_a_point_without_a_mode_is_not_resolved(monkeypatch):
    monkeypatch.setattr(critical._Chord, "mode", lambda self, f, without: None)
    (point,) = solve_static(column(1.3 * CRITICAL), steps=4, **OPTIONS).critical_points
    assert not point.resolved and np.isfinite(point.mode).all() and "near t" in str(point)
