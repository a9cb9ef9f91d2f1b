"""A precomputed response is exact at grid points and has the reported error between them.

The response does not depend on the number of processes.
"""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import skfem_stvk
from skfem_stvk import (
    BodyForce,
    ElementMesh,
    Gravity,
    PrecomputedResponse,
    Pressure,
    RegionError,
    StateError,
    StVK,
    StvkError,
    StvkWarning,
    SupportError,
    System,
    solve_static,
)
from skfem_stvk.mesh import box
from skfem_stvk.solvers.newton.processes import Crashed
from skfem_stvk.solvers.reduced import handle_solves
from skfem_stvk.solvers.reduced import precomputed_response as response
from skfem_stvk.solvers.reduced.precomputed_response import TableFile, _compressed, _weights
from skfem_stvk.solvers.runs.archive import read_archive, write_archive
from skfem_stvk.system.signature import sums

BODY, BEAM = box((2.0, 1.0, 0.8), (3, 2, 2)), box((3.0, 1.0), (6, 2))
AXES = (np.array([-0.1, 0.05, 0.2]), np.array([-0.3, -0.1, 0.0, 0.2, 0.3]), np.array([-0.2, 0.0, 0.25]))
GRIP = "right"


def solid(mesh=BODY, **supports):
    terms = [StVK(young=1e4, poisson=0.3, density=3.0), Gravity((0, 0, -9.81)[-mesh.d :])]
    return System(mesh, terms, **({"fixed": {"left": "xyz"[: mesh.d]}} | supports))


def solved(body, displacement, **options):
    """Return reaction and state for a displacement of the handle, with loads and displacements grown together from rest.

    The path differs from that of the precomputed response; the end is the same.
    """
    nodes = np.unique(body.mesh.boundaries[GRIP])
    components = {letter: float(value) for letter, value in zip("xyz", displacement, strict=False)}
    prescribed = [*(body.made_of["prescribed"] or {}).items(), (nodes, components)]
    result = solve_static(System(body.mesh, **{**body.made_of, "prescribed": prescribed}), quiet=True, rtol=1e-11, **options)
    return result.reaction(GRIP).resultant, result.u


@pytest.fixture(scope="module")
def answers():
    return PrecomputedResponse(solid(), GRIP, AXES, tolerance=1e-12, rtol=1e-11, checks=6, quiet=True)


def test_answers_at_grid_points_are_those_of_solves(answers):
    for point in [(0, 0, 0), (2, 4, 2), (1, 2, 1), (2, 0, 1), (0, 3, 2)]:
        at = [axis[i] for axis, i in zip(AXES, point, strict=True)]
        force, u = answers(at)
        expected, states = solved(solid(), at)
        assert np.abs(force - expected).max() < 1e-8 * np.abs(answers.forces).max() and np.abs(states).max() > 0.04
        assert np.abs(u - states).max() < 1e-8
        assert np.array_equal(force, answers.forces[point])


def test_handle_and_supports_have_exactly_the_prescribed_displacements(answers):
    at = (0.0123, -0.234, 0.111)
    _, u = answers(at)
    moved = u.reshape(-1, 3)
    assert (moved[answers.nodes] == at).all() and not moved[np.unique(BODY.boundaries["left"])].any()


def test_the_reported_error_is_the_difference_from_solves_between_the_points(answers):
    errors = answers.error
    assert len(errors.points) == 6 and 1e-5 < errors.largest_force < 0.05 and 1e-5 < errors.largest_u < 0.05
    k = int(np.argmax(errors.force))
    force, u = answers(errors.points[k])
    expected, states = solved(solid(), errors.points[k])
    largest = np.linalg.norm(answers.forces, axis=-1).max()
    assert np.linalg.norm(force - expected) / largest == pytest.approx(errors.largest_force, rel=1e-4)
    at = [[axis[i] for axis, i in zip(AXES, corner, strict=True)] for corner in np.ndindex(3, 5, 3)]
    most = max(np.abs(answers(one)[1]).max() for one in at)
    apart = np.linalg.norm((u - states).reshape(-1, 3), axis=1).max() / most
    assert apart == pytest.approx(errors.u[k], rel=0.1)
    assert str(errors.points[k][0])[:4] in str(errors) and "of the largest force" in str(errors)


def test_all_midpoints_can_be_measured():
    all_of_them = PrecomputedResponse(solid(BEAM), GRIP, ([0.0], [-0.1, 0.0, 0.1, 0.3]), checks=None, quiet=True)
    assert all_of_them.error.points.tolist() == [[0, -0.05], [0, 0.05], [0, 0.2]]
    none = PrecomputedResponse(solid(BEAM), GRIP, ([0.0], [-0.1, 0.0, 0.1, 0.3]), checks=0, quiet=True)
    assert not len(none.error.points) and np.isnan(none.error.largest_u) and "not measured" in repr(none)
    assert np.array_equal(none.forces, all_of_them.forces)


def test_the_error_falls_with_the_fourth_power_of_the_spacing():
    body, errors = solid(BEAM), []
    for n in (5, 9, 17):
        axes = ([0.0], np.linspace(-0.6, 0.6, n))
        error = PrecomputedResponse(body, GRIP, axes, tolerance=1e-12, rtol=1e-11, checks=None, quiet=True).error
        errors.append([error.largest_force, error.largest_u])
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (orders > 3.5).all() and (orders[-1] < 4.5).all(), orders


@pytest.mark.parametrize("count", [2, 3, 4])
def test_polynomials_of_the_degree_of_the_points_are_found_exactly(count):
    axis = np.array([-1.0, -0.3, 0.0, 0.5, 1.2])
    for value in np.linspace(-1, 1.2, 23):
        begin, weights = _weights(axis, value, "x", count)
        assert weights @ axis[begin : begin + count] ** (count - 1) == pytest.approx(value ** (count - 1), abs=1e-14)
        assert weights.sum() == pytest.approx(1)
        assert axis[begin] <= value <= axis[begin + count - 1]


def test_answers_are_continuous_across_the_sides_of_cells(answers):
    for y in AXES[1][1:-1]:
        before, after = (answers((0.01, y + shift, 0.1)) for shift in (-1e-9, 1e-9))
        assert np.abs(before[0] - after[0]).max() < 1e-6 * np.abs(answers.forces).max()
        assert np.abs(before[1] - after[1]).max() < 1e-8


def test_the_force_is_the_gradient_of_the_potential_energy():
    """The force is the gradient of the potential energy, minimized over all other nodes.

    Sign, components and loads of the force are therefore right.
    """
    body, at, h = solid(BEAM), np.array([0.1, -0.3]), 1e-3
    found = PrecomputedResponse(body, GRIP, ([0.0, at[0]], [at[1], 0.0]), rtol=1e-11, checks=0, quiet=True)

    def potential(displacement):
        return body.potential(solved(body, displacement)[1])

    for c, step in enumerate(np.eye(2) * h):
        slope = sum(w * potential(at + k * step) for k, w in ((-2, 1), (-1, -8), (1, 8), (2, -1))) / (12 * h)
        assert found(at)[0][c] == pytest.approx(slope, rel=1e-6)
        assert abs(slope) > 1


def test_loads_and_displacements_of_the_body_act_in_full():
    """Follower loads, functions of t, and displacements prescribed elsewhere have their values at t = 1."""
    terms = [StVK(young=1e4, poisson=0.3), Pressure("top", 200.0), Pressure("bottom", lambda x, t: 100.0 * t + 0 * x[0])]
    body = System(BEAM, terms, fixed={"left": "x"}, prescribed={"left": {"y": 0.05}})
    found = PrecomputedResponse(body, GRIP, ([0.0, 0.1], [-0.2, -0.1, 0.0]), tolerance=1e-12, rtol=1e-11, checks=1, quiet=True)
    for at in [(0.0, 0.0), (0.1, -0.2)]:
        force, u = found(at)
        expected, states = solved(body, at)
        assert np.allclose(force, expected, rtol=1e-7, atol=1e-6) and np.abs(u - states).max() < 1e-8
        assert u[1 + 2 * np.unique(BEAM.boundaries["left"])] == pytest.approx(0.05)


def test_loads_grow_from_rest_and_act_in_full_on_the_way_from_a_neighbour():
    body = System(BODY, [StVK(young=1e3, poisson=0.3, density=1.0), Gravity((0.0, 0.0, -9.0))])
    driven, u = handle_solves.DrivenSystem.of(body, np.array([0])), np.zeros(body.ndofs)
    full = body.external_force(u)
    assert np.abs(full).max() > 0
    np.testing.assert_allclose(driven.external_force(u, 0.25), full / 4, rtol=1e-13)
    driven.path.from_rest = False
    np.testing.assert_array_equal(driven.external_force(u, 0.25), full)


def test_removed_elements_are_not_in_the_answers():
    body = solid(BEAM)
    whole = PrecomputedResponse(body, GRIP, ([0.0], [-0.1, 0.0]), checks=0, quiet=True).forces
    body = body.without([10, 11])
    less = PrecomputedResponse(body, GRIP, ([0.0], [-0.1, 0.0]), checks=0, quiet=True).forces
    assert abs(less[0, 0, 1] / whole[0, 0, 1] - 1) > 0.01


def test_cables_attached_to_a_solid_are_pulled_with_it():
    cable = np.array([[0, BODY.nv - 1], [BODY.nv - 1, 3]]).T
    terms = [StVK(young=1e4, poisson=0.3), StVK(young=1e5, area=1e-2, simplices=cable)]
    body = System(BODY, terms, fixed={"left": "xyz"})
    found = PrecomputedResponse(body, [BODY.nv - 1], ([0.0, 0.1], [0.0], [0.0]), rtol=1e-11, checks=0, quiet=True)
    without = System(BODY, terms[0], fixed={"left": "xyz"})
    alone = PrecomputedResponse(without, [BODY.nv - 1], ([0.0, 0.1], [0.0], [0.0]), rtol=1e-11, checks=0, quiet=True)
    assert found((0.1, 0, 0))[0][0] > 1.05 * alone((0.1, 0, 0))[0][0] > 1


def test_fewer_vectors_have_the_reported_compression_error(answers):
    rough = PrecomputedResponse(solid(), GRIP, AXES, tolerance=1e-3, checks=0, quiet=True)
    assert 1 < rough.rank < answers.rank and 0 < rough.compression <= 1e-3
    states = np.array([answers([axis[i] for axis, i in zip(AXES, k, strict=True)])[1] for k in np.ndindex(3, 5, 3)])
    rougher = np.array([rough([axis[i] for axis, i in zip(AXES, k, strict=True)])[1] for k in np.ndindex(3, 5, 3)])
    worst = np.linalg.norm(states - rougher, axis=1).max() / np.linalg.norm(states, axis=1).max()
    assert worst <= 1.01 * rough.compression  # constrained degrees of freedom have no error
    basis, amounts, left_out = _compressed(states, 1e-3)
    assert np.linalg.norm(states - amounts @ basis.T, axis=1).max() / np.linalg.norm(states, axis=1).max() == pytest.approx(
        left_out
    )


# displacements outside of the grid, and holes in the grid


def test_outside_of_an_axis_is_refused_by_its_name_and_range(answers):
    with pytest.raises(StateError, match=r"along y = 0\.31, outside of its axis from -0\.3 to 0\.3\."):
        answers((0, 0.31, 0))
    held = PrecomputedResponse(solid(BEAM), GRIP, ([0.01], [-0.1, 0.0]), checks=0, quiet=True)
    with pytest.raises(StateError, match=r"along x = 0, outside of its axis from 0\.01 to 0\.01"):
        held((0.0, -0.05))
    assert held((0.01, -0.05 - 0.05))[0].shape == (2,) and held((0.01, -0.1 - 1e-15))[0].shape == (2,)
    for bad in [(0, 0), (0, np.nan, 0), "x", None, (0, 0, 0, 0)]:
        with pytest.raises(StateError):
            answers(bad)


@pytest.fixture(scope="module")
def holed():
    """Return a response with holes.

    The grid goes so far into compression that the St. Venant-Kirchhoff body has no stable equilibrium.
    """
    body = System(BEAM, StVK(young=1e4, poisson=0.3), fixed={"left": "xy"})
    with pytest.warns(StvkWarning, match=r"No stable equilibrium at 6 of 15 displacements \(\(-2, 0\), .*: Stopped before"):
        return PrecomputedResponse(body, GRIP, ([-2.8, -2.0, -0.1, 0.0, 0.1], [-0.1, 0.0, 0.1]), checks=None, quiet=True)


def test_points_without_equilibrium_are_holes_whose_cells_are_refused(holed):
    assert {at[0] for at in holed.holes} <= {-2.8, -2.0} and all(holed.holes.values()) and (-2.8, 0.0) in holed.holes
    with pytest.raises(StateError, match=r"in a cell with the hole \(-2.*: "):
        holed((-1.9, 0.05))
    assert np.isfinite(holed.forces).all() and "holes" in repr(holed)
    assert len(holed.error.points) == 4 and holed.error.points[:, 0].min() >= -0.1  # only cells without holes


def test_next_to_holes_answers_are_linear_between_the_points(holed):
    force, _ = holed((-0.075, 0.0))
    assert force == pytest.approx(0.75 * holed.forces[2, 1] + 0.25 * holed.forces[3, 1], rel=1e-12)
    assert holed((-0.1, 0.05))[0].shape == (2,)  # on the boundary of a cell with a hole, the neighbouring cell is used


def test_points_behind_a_snap_are_holes():
    """Two flat bars, pulled by a soft bar, snap through. Points behind the snap are holes, because the answer would jump."""
    mesh = ElementMesh(
        p=np.array([[-1.0, 0.0, 1.0, 0.0], [0.0, 0.3, 0.0, -3.0]]),
        t=np.array([[0, 1, 1], [1, 2, 3]]),
        subdomains={"flat": [0, 1], "soft": [2]},
    )
    bars = [StVK(young=1e5, poisson=0.3, area=1e-2, region="flat"), StVK(young=1e5, poisson=0.3, area=1e-3, region="soft")]
    body = System(mesh, bars, fixed=[([0, 2], "xy"), ([1], "x")])
    with pytest.warns(StvkWarning, match="the body snaps"):
        found = PrecomputedResponse(body, [3], ([0.0], np.linspace(-1.0, 0.2, 13)), checks=0, steps=4, quiet=True)
    assert 0 < len(found.holes) < 12 and all(at[1] < -0.2 for at in found.holes)
    assert found((0.0, -0.1))[0][1] < 0
    with pytest.raises(StateError, match=r"snaps|no neighbour"):
        found((0.0, -0.95))


def test_the_first_point_has_to_have_an_equilibrium():
    with pytest.raises(StvkError, match=r"The first displacement .* has no equilibrium: .*(invert|Stopped)"):
        PrecomputedResponse(solid(BEAM), GRIP, ([-3.1, 4.0], [0.0]), quiet=True)
    with pytest.raises(StvkError, match=r"The first displacement .* float64"):
        PrecomputedResponse(System(BEAM, StVK(young=1e4, poisson=0.3), {"left": "xy"}, dtype=np.float32), GRIP, ([0, 1], [0]))


def test_a_crash_is_a_hole_that_the_next_call_fills(tmp_path, monkeypatch):
    axes = ([0.0], [-0.1, 0.0, 0.1])
    whole = PrecomputedResponse(solid(BEAM), GRIP, axes, checks=0, quiet=True)

    def crashing(work, waiting, jobs, each):
        while waiting:
            task = waiting.popleft()
            yield task, Crashed() if task.number == lost else work(task)

    monkeypatch.setattr(response, "threads", lambda: 2)
    monkeypatch.setattr(handle_solves, "in_processes", crashing)
    lost = 2
    with pytest.warns(StvkWarning, match=r"at 1 of 3 displacements \(\(0, 0.1\)\): its process ended abnormally"):
        PrecomputedResponse(solid(BEAM), GRIP, axes, checks=0, jobs=2, checkpoint=tmp_path / "points", quiet=True)
    assert [file.name for file in sorted((tmp_path / "points").glob("*.npz"))] == ["point_000000.npz", "point_000001.npz"]
    monkeypatch.undo()
    assert_same(PrecomputedResponse(solid(BEAM), GRIP, axes, checks=0, checkpoint=tmp_path / "points", quiet=True), whole)
    monkeypatch.setattr(response, "threads", lambda: 2)
    monkeypatch.setattr(handle_solves, "in_processes", crashing)
    lost = 1
    with pytest.raises(StvkError, match="first displacement"):
        PrecomputedResponse(solid(BEAM), GRIP, axes, checks=0, jobs=2, quiet=True)


# order, processes, files


def test_each_point_starts_from_its_solved_neighbour_nearer_to_rest():
    grid = handle_solves.DisplacementGrid(([-1.0, 0.1, 1.0], np.array([-0.2, 0.0, 0.3])))
    assert grid.points[grid.first].tolist() == [0.1, 0.0]
    assert [grid.points[k].tolist() for k in grid.neighbours(grid.number((2, 2)), nearer=True)] == [[1.0, 0.0], [0.1, 0.3]]
    assert [grid.points[k].tolist() for k in grid.neighbours(grid.number((1, 2)), nearer=False)] == [[1.0, 0.3], [-1.0, 0.3]]
    assert sorted(map(grid.steps, range(9))) == [0, 1, 1, 1, 1, 2, 2, 2, 2]


def test_solves_go_around_a_hole_and_their_order_does_not_matter():
    """A toy solver shows that a point behind a hole starts from its other neighbour."""
    axes = (np.arange(-1.0, 3), np.arange(0.0, 3))
    grid, starts = handle_solves.DisplacementGrid(axes), {}

    class Toy:
        def __call__(self, task):
            starts[task.number] = task.start.tolist()
            hole = task.end.tolist() in ([1.0, 0.0], [0.0, 2.0])
            return handle_solves.HandleState(task.end, task.end, "hole" if hole else "")

        _failed = staticmethod(lambda message: handle_solves.HandleState(np.zeros(2), np.zeros(2), message))

    solves = handle_solves.HandleSolves(grid, Toy(), 0, {})
    found = [number for number, _, _ in solves.run(1, 1)]
    assert starts[grid.number((2, 1))] == [0.0, 1.0] and starts[grid.number((1, 0))] == [0, 0]
    assert grid.number((3, 0)) not in found and "no neighbour" in solves.states[grid.number((3, 0))].message
    assert starts[grid.number((2, 2))] == [1.0, 1.0] and len(solves.states) == 12
    done_before = {k: solves.states[k] for k in found[::2]}
    again = handle_solves.HandleSolves(grid, Toy(), 0, done_before)
    assert sorted(number for number, _, _ in again.run(1, 1)) == sorted(found[1::2])
    assert {k: s.message for k, s in again.states.items()} == {k: s.message for k, s in solves.states.items()}


def test_processes_give_the_same_to_the_last_bit(tmp_path):
    script = tmp_path / "response.py"
    script.write_text(SCRIPT.format(jobs=2, checkpoint=str(tmp_path / "points"), n=5))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=HERE)
    assert done.returncode == 0, done.stderr
    alone = PrecomputedResponse(solid(BEAM), GRIP, ([0.0, 0.1], np.linspace(-0.3, 0.3, 5)), checks=2, quiet=True)
    loaded = PrecomputedResponse.load(tmp_path / "answers.npz", solid(BEAM))
    assert_same(loaded, alone)


#: Scripts in other folders import the package that is tested.
HERE = os.environ | {"PYTHONPATH": str(Path(skfem_stvk.__file__).parent.parent)}
SCRIPT = """
import numpy as np
from skfem_stvk import Gravity, PrecomputedResponse, StVK, System
from skfem_stvk.mesh import box

if __name__ == "__main__":
    terms = [StVK(young=1e4, poisson=0.3, density=3.0), Gravity((0, -9.81))]
    body = System(box((3.0, 1.0), (6, 2)), terms, fixed={{"left": "xy"}})
    axes = [0.0, 0.1], np.linspace(-0.3, 0.3, {n})
    answers = PrecomputedResponse(body, "right", axes, checks=2, jobs={jobs}, checkpoint={checkpoint!r})
    answers.save(__file__.replace("response.py", "answers.npz"))
"""


def assert_same(one, other):
    assert np.array_equal(one._table.values, other._table.values) and np.array_equal(one._table.basis, other._table.basis)
    assert np.array_equal(one.error.points, other.error.points) and np.array_equal(one.error.u, other.error.u)
    assert repr(one) == repr(other)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "how, jobs",
    [(signal.SIGKILL, 1), pytest.param(signal.SIGINT, 1, marks=SLOW), pytest.param(signal.SIGINT, 2, marks=SLOW)],
)
def test_a_response_that_was_killed_resumes_to_the_same_table(tmp_path, how, jobs):
    script, points = tmp_path / "response.py", tmp_path / "points"
    script.write_text(SCRIPT.format(jobs=jobs, checkpoint=str(points), n=61))
    process = subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=HERE,
    )
    try:
        begin = time.monotonic()
        while len(list(points.glob("*.npz")) if points.exists() else []) < 4:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() - begin < 300
            time.sleep(0.01)
        os.kill(process.pid, how)
        printed, _ = process.communicate(timeout=300)
    finally:
        process.kill()
        process.wait()
    before = {file.name: file.stat().st_mtime_ns for file in points.glob("*.npz")}
    assert 4 <= len(before) < 124
    assert how == signal.SIGKILL or f"{len(before)} of 124 solves are done: they are in {points}" in printed
    axes = ([0.0, 0.1], np.linspace(-0.3, 0.3, 61))
    resumed = PrecomputedResponse(solid(BEAM), GRIP, axes, checks=2, checkpoint=points, quiet=True)
    after = {file.name: file.stat().st_mtime_ns for file in points.glob("*.npz")}
    assert len(after) == 124 and all(after[name] == before[name] for name in before)
    assert_same(resumed, PrecomputedResponse(solid(BEAM), GRIP, axes, checks=2, quiet=True))


def test_checkpoints_of_another_problem_and_damaged_ones_are_refused(tmp_path):
    axes = ([0.0], [-0.1, 0.0, 0.1])
    PrecomputedResponse(solid(BEAM), GRIP, axes, checks=0, checkpoint=tmp_path / "points", quiet=True)
    for other in [
        {"displacements": ([0.0], [-0.1, 0.0, 0.2])},
        {"handle": [int(np.unique(BEAM.boundaries[GRIP])[0])]},
        {"body": System(BEAM, StVK(young=1e4, poisson=0.3), fixed={"left": "xy"})},
        {"rtol": 1e-6},
    ]:
        options = {"body": solid(BEAM), "handle": GRIP, "displacements": axes} | other
        with pytest.raises(StvkError, match="of another problem"):
            PrecomputedResponse(**options, checks=0, checkpoint=tmp_path / "points", quiet=True)
    file = tmp_path / "points" / "point_000001.npz"
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(StvkError, match=r"point_000001.*Remove it, so that its point is solved again"):
        PrecomputedResponse(solid(BEAM), GRIP, axes, checks=0, checkpoint=tmp_path / "points", quiet=True)


def test_bodies_with_lambdas_do_not_go_to_processes():
    body = System(BEAM, StVK(young=1e4, poisson=0.3), fixed=[(lambda x: x[0] == 0, "xy")])
    with pytest.raises(StvkError, match=r"lambda.*jobs=1"):
        PrecomputedResponse(body, GRIP, ([0.0], [-0.1, 0.0]), jobs=2, quiet=True)


def test_a_saved_response_is_loaded_with_its_own_body_only(answers, tmp_path):
    file = answers.save(tmp_path / "grip.npz")
    loaded = PrecomputedResponse.load(file, solid())
    assert_same(loaded, answers)
    at = (0.1, -0.22, 0.01)
    assert all(np.array_equal(one, other) for one, other in zip(loaded(at), answers(at), strict=True))
    with pytest.raises(StvkError, match=r"elastic terms.*changed"):
        PrecomputedResponse.load(file, System(BODY, StVK(young=2e4, poisson=0.3), fixed={"left": "xyz"}))
    with pytest.raises(StvkError, match="supports changed"):
        PrecomputedResponse.load(file, solid(fixed={"left": "xy"}))
    content = dict(np.load(file))
    for name in ("array values", "array nodes"):
        np.savez(tmp_path / "changed.npz", **(content | {name: content[name] + 1}))
        with pytest.raises(StvkError, match="was changed"):
            PrecomputedResponse.load(tmp_path / "changed.npz", solid())


ALTERED = {
    "missing": lambda array: None,
    "empty": lambda array: array[:0],
    "one shorter": lambda array: array[:-1] if len(array) > 1 else None,
    "of more axes": lambda array: array[None],
    "a scalar": lambda array: array.reshape(-1)[0],
    "complex": lambda array: array.astype(complex),
    "text": lambda array: array.astype(str),
    "numbers of one byte": lambda array: array.astype(np.uint8),
    "NaN": lambda array: np.where(np.ones(array.shape, bool), np.nan, array) if array.dtype.kind == "f" else None,
    "infinite": lambda array: np.full(array.shape, np.inf, array.dtype) if array.dtype.kind == "f" else None,
    "reversed": lambda array: array[::-1] if array.ndim == 1 and array.dtype.kind == "f" and len(array) > 1 else None,
}


@pytest.mark.parametrize("how", ALTERED)
def test_a_file_with_other_arrays_is_refused_though_its_digest_fits(holed, tmp_path, how):
    file = holed.save(tmp_path / "grip.npz")
    header, arrays = read_archive(file, TableFile.known, "")
    for name in [name for name in arrays if how != "reversed" or name.startswith("axes")]:  # errors may be in any order
        altered = ALTERED[how](arrays[name])
        others = arrays | {name: altered} if altered is not None else {one: arrays[one] for one in arrays if one != name}
        write_archive(file, header, others)
        with pytest.raises(StvkError, match=r"grip\.npz is (damaged: .*Compute it again|of another .*handle)"):
            PrecomputedResponse.load(file, holed.body)


@pytest.mark.parametrize("holes", [{"0": ""}, {"no number": "why"}, {"10000": "why"}])
def test_a_file_with_other_holes_is_refused_though_its_digest_fits(holed, tmp_path, holes):
    file = holed.save(tmp_path / "grip.npz")
    header, arrays = read_archive(file, TableFile.known, "")
    write_archive(file, header | {"record": header["record"] | {"holes": holes}}, arrays)
    with pytest.raises(StvkError, match="holes in its header"):
        PrecomputedResponse.load(file, holed.body)


@pytest.mark.parametrize("node", [-1, 10**6])
def test_a_file_with_nodes_that_are_not_in_the_mesh_is_refused(holed, tmp_path, node):
    file = holed.save(tmp_path / "grip.npz")
    header, arrays = read_archive(file, TableFile.known, "")
    nodes = np.append(arrays["nodes"], node)
    header["problem"]["numbers"]["the handle"] = [len(nodes), *sums(nodes)]
    write_archive(file, header, arrays | {"nodes": nodes})
    with pytest.raises(StvkError, match="numbers of nodes from 0 to"):
        PrecomputedResponse.load(file, holed.body)


def test_holes_are_saved(holed, tmp_path):
    loaded = PrecomputedResponse.load(holed.save(tmp_path / "holed.npz"), holed.body)
    assert loaded.holes == holed.holes and loaded.error.unsolved == holed.error.unsolved
    with pytest.raises(StateError, match="cell with the hole"):
        loaded((-1.9, 0.0))


@pytest.mark.parametrize(
    "axes, message",
    [
        (([0.0], [0.1, 0.2]), "y goes from 0.1 to 0.2; expected zero"),
        (([0.0], [0.1, 0.0]), "ascending"),
        (([0.0], []), "at least one"),
        (([0.0], [0.0]), "each axis has one value"),
        (([0.0, 0.1],), "2 axes"),
        (([0.0], "yes"), "displacements: y"),
        (([0.0], [0.0, np.nan]), "not finite"),
        (3, "2 axes"),
    ],
)
def test_invalid_grids_are_refused(axes, message):
    with pytest.raises(StvkError, match=message):
        PrecomputedResponse(solid(BEAM), GRIP, axes, quiet=True)


def test_handles_that_cannot_be_displaced_are_refused():
    with pytest.raises(SupportError, match=r"handle: of 'left', 3 vertices .* fixed or prescribed"):
        PrecomputedResponse(solid(BEAM), "left", ([0.0], [0.0, 0.1]), quiet=True)
    with pytest.raises(RegionError, match=r"handle: .*'grip'"):
        PrecomputedResponse(solid(BEAM), "grip", ([0.0], [0.0, 0.1]), quiet=True)
    with pytest.raises(SupportError, match="rigid"):
        PrecomputedResponse(System(BEAM, StVK(young=1e4, poisson=0.3)), [0], ([0.0], [0.0, 0.1]), quiet=True)


# faults that the checks find


def test_the_check_of_answers_finds_swapped_axes_and_a_wrong_sign(answers, monkeypatch):
    """With exchanged components, or with the force of the body on the hand, the answers are far from those of solves."""
    at = (0.2, -0.3, 0.25)
    true = solved(solid(), at)[0]
    assert np.abs(answers(at)[0] - true).max() < 1e-8 * np.abs(true).max()

    def exchanged(self, x, t):
        return np.repeat(t * self.end[::-1, None], x.shape[1], 1)

    monkeypatch.setattr(handle_solves.HandlePath, "displacements", exchanged)
    swapped = PrecomputedResponse(solid(), GRIP, AXES, checks=0, quiet=True)
    assert np.abs(swapped(at)[0] - true).max() > 0.1 * np.abs(true).max()
    monkeypatch.undo()
    residual = handle_solves.DrivenSystem.residual
    monkeypatch.setattr(handle_solves.DrivenSystem, "residual", lambda self, u, t=1.0: -residual(self, u, t))
    opposite = PrecomputedResponse(solid(), GRIP, AXES, checks=0, quiet=True)
    assert np.abs(opposite(at)[0] - true).max() > 0.1 * np.abs(true).max()


def test_errors_between_points_show_a_wrong_table(monkeypatch):
    """The errors at midpoints grow if the state of one grid point is scaled, as if it were on another branch."""
    call = handle_solves.HandleSolver.__call__

    def elsewhere(self, task):
        state = call(self, task)
        return replace(state, u=0.7 * state.u, force=0.7 * state.force) if task.number == 3 else state

    axes = ([0.0], np.linspace(-0.2, 0.2, 7))
    right = PrecomputedResponse(solid(BEAM), GRIP, axes, checks=None, quiet=True)
    monkeypatch.setattr(handle_solves.HandleSolver, "__call__", elsewhere)
    wrong = PrecomputedResponse(solid(BEAM), GRIP, axes, checks=None, quiet=True)
    assert wrong.error.largest_force > 30 * right.error.largest_force


def test_a_thousand_responses_along_a_motion_of_the_hand_agree_with_static_solves():
    """The work along a closed path is zero, and solves at eight moments between the grid points differ by 1e-4."""
    mesh, terms = box(size=(3.0, 1.0), cells=(18, 6)), [StVK(young=1e4, poisson=0.4), BodyForce((0, -20.0))]
    grid = np.linspace(-0.1, 0.6, 6), np.linspace(-1.0, 1.0, 9)
    bar = System(mesh, terms, fixed={"left": "xy"})
    answers = PrecomputedResponse(bar, handle="right", displacements=grid, quiet=True)
    t = np.linspace(0, 1, 1001)
    hand = np.stack([0.25 + 0.3 * np.sin(2 * np.pi * t), 0.9 * np.sin(4 * np.pi * t)], axis=1)
    forces = np.array([answers(place)[0] for place in hand])
    largest = np.linalg.norm(forces, axis=1).max()
    work = np.sum((forces[1:] + forces[:-1]) / 2 * np.diff(hand, axis=0))
    assert len(forces) == 1001 and not answers.holes
    assert largest == pytest.approx(3524.5, rel=1e-3) and abs(work) < 1e-5 * largest
    for k in range(62, 1000, 125):
        moved = {"right": dict(zip("xy", hand[k], strict=True))}
        found = solve_static(System(mesh, terms, {"left": "xy"}, moved), quiet=True)
        assert np.linalg.norm(forces[k] - found.reaction("right").resultant) < 1e-4 * largest
