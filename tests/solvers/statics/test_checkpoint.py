"""Checkpoints of paths, and paths that are resumed from them."""

import os
import signal
import subprocess
import sys
import time

import meshio
import numpy as np
import pytest
import skfem
from beams import CRITICAL, LOAD, beam, bent, block, column
from test_arc_length import bar

from skfem_stvk import Corotated, Gravity, InvertibleStVK, NodalLoad, Stop, StVK, System, Traction, solve_static
from skfem_stvk.errors import StvkError
from skfem_stvk.linear import AmgCg, SuperLU
from skfem_stvk.results.monitors import Monitors
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.newton.stopwatch import Stopwatch
from skfem_stvk.solvers.runs.outputs import OutputFiles
from skfem_stvk.solvers.statics import Interrupted, SolveError, Step
from skfem_stvk.solvers.statics import path_checkpoint as checkpoint
from skfem_stvk.solvers.statics.arc_length import ArcLength
from skfem_stvk.solvers.statics.continuation import ContinuationOptions
from skfem_stvk.solvers.statics.equilibrium import Equilibrium
from skfem_stvk.solvers.statics.load_steps import LoadSteps
from skfem_stvk.solvers.statics.stop import StopCriterion
from skfem_stvk.system.signature import Fingerprint

OPTIONS = {"quiet": True, "raise_on_failure": False, "solver": "superlu"}


def same(one, other):
    """Assert that two results agree bitwise, except for times and effort."""
    assert len(one.history) == len(other.history) and one.message == other.message and one.status is other.status
    for a, b in zip(one.history, other.history, strict=True):
        assert (a.t, a.status, a.end, a.negative, a.lowest) == (b.t, b.status, b.end, b.negative, b.lowest)
        assert (a.strain_energy, a.smallest_volume_ratio) == (b.strain_energy, b.smallest_volume_ratio)
        assert a.iterations == b.iterations
        np.testing.assert_array_equal(a.u, b.u)
    assert [repr(point) for point in one.critical_points] == [repr(point) for point in other.critical_points]


class Interruption(Exception):
    pass


def fill_disk(patch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    patch.setattr(np, "savez", full)


def stopped_after(monkeypatch, states, act=Interruption, error=SolveError, **call):
    """Run a solve in which `act` is called, or raised, after the given number of saved states; return its error."""
    add = checkpoint.PathCheckpoint.add
    with monkeypatch.context() as patch:

        def added(self, step, saved):
            add(self, step, saved)
            if self._count == states:
                if isinstance(act, type):
                    raise act
                act(patch)

        patch.setattr(checkpoint.PathCheckpoint, "add", added)
        with pytest.raises(error) as caught:
            solve_static(**call)
    return caught.value


SCENES = {
    "bending": {"steps": 8},
    "crushing": {"steps": 5},
    "snap-through": {"steps": 20, "method": "arc-length"},
    "buckling": {"steps": 4, "method": "arc-length"},
    "a start": {"steps": 8},
}


@pytest.mark.filterwarnings("ignore:From t")
@pytest.mark.parametrize("scene", SCENES)
def test_a_resumed_path_is_the_same_to_the_last_bit(tmp_path, monkeypatch, scene):
    """A path resumed after one of the first states, or from its end, is bitwise identical."""
    system, options = CONTINUATIONS[scene]()
    options |= OPTIONS | SCENES[scene]
    whole = solve_static(system, **options)
    for states in (1, 3):
        call = {"checkpoint": tmp_path / f"path_{states}", **options}
        stopped_after(monkeypatch, states, system=system, **call)
        same(whole, solve_static(CONTINUATIONS[scene]()[0], resume=True, **call))
        assert len(list((tmp_path / f"path_{states}").glob("state_*.npz"))) == len(whole.history)
    same(whole, solve_static(system, resume=True, **call))


@pytest.mark.parametrize(
    ("act", "error", "words"),
    [(fill_disk, SolveError, "No space left"), (KeyboardInterrupt, Interrupted, "Interrupted at t")],
    ids=["full disk", "Ctrl-C"],
)
def test_a_path_that_is_stopped_keeps_its_states(tmp_path, monkeypatch, act, error, words):
    call = {"steps": 8, "checkpoint": tmp_path / "path", **OPTIONS}
    stopped = stopped_after(monkeypatch, 2, act, error, system=bent(), **call)
    assert words in str(stopped) and len(list((tmp_path / "path").glob("*.npz"))) == 2
    same(solve_static(bent(), steps=8, **OPTIONS), solve_static(bent(), resume=True, **call))


def test_a_path_is_resumed_to_another_stop(tmp_path):
    call = {"steps": 20, "method": "arc-length", "checkpoint": tmp_path / "path", "quiet": True, "rtol": 1e-12}
    first = solve_static(bar(), stop=Stop(turns=1), **call)
    further = solve_static(bar(), stop=Stop(turns=2), resume=True, **call)
    assert len(further.history) > len(first.history) and len(further.critical_points) == 2
    np.testing.assert_array_equal(further.history[len(first.history) - 1].u, first.u)


def test_resume_without_states_starts_a_path(tmp_path):
    result = solve_static(bent(), steps=3, checkpoint=tmp_path / "path", resume=True, quiet=True)
    assert result.success and len(list((tmp_path / "path").iterdir())) == len(result.history)


def test_the_series_of_files_is_resumed(tmp_path, monkeypatch):
    call = {"steps": 6, "checkpoint": tmp_path / "path", "save": tmp_path / "bent.pvd", **OPTIONS}
    stopped_after(monkeypatch, 2, system=bent(), **call)
    result = solve_static(bent(), resume=True, **call)
    files = sorted(tmp_path.glob("bent_*.vtu"))
    assert len(files) == len(result.history) and (tmp_path / "bent.pvd").read_text().count("DataSet") == len(files)
    last = meshio.read(files[-1]).point_data["displacement"]
    np.testing.assert_allclose(last.ravel(), result.u, atol=1e-12)


def test_the_series_of_a_snap_through_counts_its_states(tmp_path):
    system = bar()
    result = solve_static(system, steps=20, method="arc-length", save=tmp_path / "bar.pvd", quiet=True)
    assert [t for t, _ in read_list(tmp_path / "bar.pvd")] == list(range(1, len(result.history) + 1))
    assert len(list(tmp_path.glob("bar_*.vtu"))) == len(result.history) and (np.diff(result.history.t) < 0).any()
    result.save(tmp_path / "again.pvd")
    assert len(list(tmp_path.glob("again_*.vtu"))) == len(result.history)


def test_a_fresh_run_replaces_the_states_of_its_own_problem_and_no_others(tmp_path):
    call = {"steps": 20, "method": "arc-length", "checkpoint": tmp_path / "path", "save": tmp_path / "bar.pvd", "quiet": True}
    longer = solve_static(bar(), stop=Stop(turns=2), **call)
    shorter = solve_static(bar(), stop=Stop(turns=1), **call)
    saved_before = {file.name: file.read_bytes() for file in [*tmp_path.glob("bar*"), *(tmp_path / "path").iterdir()]}
    assert len(shorter.history) < len(longer.history) and len(saved_before) == 2 * len(shorter.history) + 1
    for one in ("checkpoint", "save"):
        other = {name: value for name, value in call.items() if name != one} | {"steps": 10}
        with pytest.raises(StvkError, match=r"of another problem: steps was 20 and is 10.*overwrite=True"):
            solve_static(bar(), **other)
    assert saved_before == {file.name: file.read_bytes() for file in [*tmp_path.glob("bar*"), *(tmp_path / "path").iterdir()]}
    fewer = solve_static(bar(), overwrite=True, **call | {"steps": 10})
    assert len(list((tmp_path / "path").iterdir())) == len(fewer.history) == len(list(tmp_path.glob("bar_*.vtu")))
    same(fewer, solve_static(bar(), resume=True, **call | {"steps": 10}))


def test_other_files_are_replaced_only_on_request(tmp_path):
    (tmp_path / "path").mkdir()
    np.savez(tmp_path / "path" / "state_00000.npz", u=np.ones(3))
    (tmp_path / "bent.pvd").write_text("<VTKFile><Collection/></VTKFile>")
    saved_before = (tmp_path / "path" / "state_00000.npz").read_bytes()
    with pytest.raises(StvkError, match=r"state_00000.npz cannot be read as a path of skfem-stvk.*overwrite=True"):
        solve_static(bent(), steps=3, checkpoint=tmp_path / "path", quiet=True)
    with pytest.raises(StvkError, match=r"bent.pvd exists, but does not name its problem.*overwrite=True"):
        solve_static(bent(), steps=3, save=tmp_path / "bent.pvd", quiet=True)
    assert (tmp_path / "path" / "state_00000.npz").read_bytes() == saved_before and "<Collection/>" in (
        tmp_path / "bent.pvd"
    ).read_text()
    both = {"checkpoint": tmp_path / "path", "save": tmp_path / "bent.pvd"}
    result = solve_static(bent(), steps=3, overwrite=True, quiet=True, **both)
    assert len(list((tmp_path / "path").iterdir())) == len(result.history)


def loaded(n=2, moved=0.0, young=1e4, weight=-5.0, pull=LOAD, vertex=50, force=(0, 0, -3.0), move=0.1, **supports):
    """Return a cantilever with a load of each kind; other arguments make another problem."""
    mesh = beam(n)
    p = mesh.p.copy()
    p[:, 40] += moved
    terms = [StVK(young=young, poisson=0.3, density=1.0), Gravity(g=(0, 0, weight)), Traction("tip", pull)]
    supports = {"fixed": {"wall": "xyz"}, "prescribed": {"tip": {"x": move}}} | supports
    mesh = type(mesh)(p, mesh.t, boundaries=dict(mesh.boundaries))
    return System(mesh, [*terms, NodalLoad([vertex], force)], **supports)


@pytest.fixture(scope="module")
def saved_path(tmp_path_factory):
    call = {"steps": 3, "t0": 0.1, "u0": np.full(297, 1e-3), "solver": "superlu", "quiet": True}
    call["checkpoint"] = tmp_path_factory.mktemp("path") / "path"
    solve_static(loaded(), **call)
    return call


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"n": 3}, "the mesh"),
        ({"moved": 1e-4}, "the mesh"),
        ({"young": 1.0001e4}, "the elastic terms"),
        ({"weight": -5.001}, "the loads"),
        ({"pull": (30.0, -20.0, -60.1)}, "the loads"),
        ({"pull": lambda t: LOAD * t**2}, r"the loads at t = 0.5 changed"),
        ({"vertex": 51}, "the loads"),
        ({"force": (0, 0, 3.0)}, "the loads"),
        ({"force": (0, -3.0, 0)}, "the loads"),
        ({"move": -0.1}, "prescribed"),
        ({"prescribed": {"tip": {"x": 0.1, "y": 0.1}}}, "prescribed"),
        ({"fixed": {"wall": "xyz", "tip": "y"}}, "the supports"),
        ({"steps": 4}, "steps was"),
        ({"rtol": 1e-6}, "rtol was"),
        ({"solver": "pardiso"}, "solver was"),
        ({"method": "arc-length"}, "method was"),
        ({"u0": np.full(297, -1e-3)}, "u0"),
        ({"t0": 0.2}, r"t0 was 0\.1 and is 0\.2"),
    ],
)
def test_the_path_of_another_problem_is_refused(saved_path, changed, what):
    of_system = {name: value for name, value in changed.items() if name not in ("steps", "rtol", "solver", "method", "u0", "t0")}
    options = {name: value for name, value in changed.items() if name not in of_system}
    call = saved_path | ({"u0": None} if "n" in changed else {}) | options
    with pytest.raises(StvkError, match=f"another problem: .*{what}"):
        solve_static(loaded(**of_system), resume=True, **call)


@pytest.mark.parametrize("length", [0, 100])
def test_files_that_cannot_be_read_are_named(tmp_path, length):
    call = {"steps": 3, "checkpoint": tmp_path / "path", "quiet": True}
    solve_static(bent(), **call)
    broken = tmp_path / "path" / "state_00001.npz"
    broken.write_bytes(broken.read_bytes()[:length])
    with pytest.raises(StvkError, match=r"state_00001.npz cannot be read.*Remove it and all later states"):
        solve_static(bent(), resume=True, **call)


RUN = """
import sys, time
sys.path[:0] = sys.argv[2:]
from beams import bent
from skfem_stvk import solve_static
solve_static(bent(n=3), steps=60, checkpoint=sys.argv[1], solver="superlu", quiet=True)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no signal that cannot be caught")
def test_a_killed_run_keeps_its_states(tmp_path):
    here = os.path.dirname(os.path.abspath(__file__))
    folder = tmp_path / "path"
    run = subprocess.Popen(
        [sys.executable, "-c", RUN, str(folder), here, os.path.dirname(here), os.path.dirname(os.path.dirname(here))]
    )
    begin = time.time()
    while len(list(folder.glob("state_*.npz"))) < 3 and time.time() - begin < 300 and run.poll() is None:
        time.sleep(0.002)
    run.send_signal(signal.SIGKILL)
    run.wait()
    saved_before = len(list(folder.glob("state_*.npz")))
    assert saved_before >= 3
    options = {"steps": 60, "solver": "superlu", "quiet": True}
    resumed = solve_static(bent(n=3), checkpoint=folder, resume=True, **options)
    assert resumed.success and len(resumed.history) >= saved_before
    same(solve_static(bent(n=3), **options), resumed)


@pytest.mark.parametrize("stop", [{"states": 5}, {"turns": 1}])
def test_a_stop_that_was_passed_ends_the_path_at_once(tmp_path, monkeypatch, stop):
    from skfem_stvk.solvers.statics import stop as stops

    monkeypatch.setattr(stops, "MOST_STATES", 40)
    call = {"steps": 20, "method": "arc-length", "checkpoint": tmp_path / "path", "quiet": True}
    first = solve_static(bar(), stop=Stop(turns=2), **call)
    again = solve_static(bar(), stop=Stop(**stop), resume=True, **call)
    assert len(again.history) == len(first.history)


def test_a_path_with_falling_load_is_resumed_with_its_direction_and_count(tmp_path, monkeypatch):
    call = {"steps": 20, "method": "arc-length", "stop": Stop(states=9), **OPTIONS}
    whole = solve_static(bar(), **call)
    assert whole.history.t[-1] < whole.history.t[-2], "the load factor falls"
    stopped_after(monkeypatch, 8, system=bar(), checkpoint=tmp_path / "path", **call)
    same(whole, solve_static(bar(), checkpoint=tmp_path / "path", resume=True, **call))


def test_a_state_that_is_missing_is_named_and_nothing_is_overwritten(tmp_path):
    call = {"steps": 20, "method": "arc-length", "checkpoint": tmp_path / "path", "quiet": True}
    solve_static(bar(), stop=Stop(turns=1), **call)
    (tmp_path / "path" / "state_00002.npz").unlink()
    saved_before = {file: file.read_bytes() for file in (tmp_path / "path").iterdir()}
    with pytest.raises(StvkError, match=r"no state_00002.npz"):
        solve_static(bar(), stop=Stop(turns=2), resume=True, **call)
    assert saved_before == {file: file.read_bytes() for file in (tmp_path / "path").iterdir()}


def test_a_series_requested_on_resume_has_all_states_and_no_older_ones(tmp_path):
    call = {"steps": 6, "checkpoint": tmp_path / "path", "overwrite": True, "quiet": True}
    solve_static(bent(load=(0, 0, -1.0)), steps=40, save=tmp_path / "bent.pvd", quiet=True)
    for _ in range(2):
        result = solve_static(bent(), resume=True, save=tmp_path / "bent.pvd", **call)
        files = sorted(tmp_path.glob("bent_*.vtu"))
        assert len(files) == len(result.history) == (tmp_path / "bent.pvd").read_text().count("DataSet")
        (tmp_path / "bent.pvd").unlink()
        for file in files:
            file.unlink()


def continuation_of(system, method, steps, u0=None, t0=0.0, solver=None, stability=False):
    problem = Equilibrium(system, solver or SuperLU(), Stopwatch())
    course = ContinuationOptions(1 / steps, 1e-8, Monitors(system), stability, lambda *_: None)
    begin = problem, np.zeros(system.ndofs) if u0 is None else u0, t0, course
    return ArcLength(*begin, StopCriterion(Stop(load=1.0), system)) if method == "arc-length" else LoadSteps(*begin)


def state_of(continuation):
    """Return all numbers and arrays that determine the next states of a continuation."""
    point, numbers = continuation._point, vars(continuation.saved()) | {"t": continuation.t, "allowed": continuation._allowed}
    numbers |= {"point t": point.t, "negative": point.negative, "lowest": point.lowest}
    arrays = {"u": continuation.u, "point u": point.u}
    if isinstance(continuation, LoadSteps):
        numbers["before"], arrays["u before"] = continuation._previous.t, continuation._previous.u
    elif continuation._tangent is not None:
        numbers |= {"rate": continuation._tangent.rate, "ahead": continuation._tangent.negative}
        arrays["direction"] = continuation._tangent.direction
    return numbers, arrays


def mirrored():
    """Return a body, and a start in which the body is reflected at its wall, with all elements inverted."""
    system = bent(load=(1e-3, 0, 0))
    u0 = np.zeros((system.mesh.nv, 3))
    u0[:, 0] = -2 * system.mesh.p[0]
    return system, {"u0": u0.ravel()}


def released():
    """Return a body with loads that return to zero, so that the largest force on the path is not that of the last state."""
    terms = [StVK(young=1e4, poisson=0.3), Traction("tip", lambda t: (0, 0, -200 * t * (1 - t)))]
    return System(bent().mesh, terms, fixed={"wall": "xyz"}), {}


CONTINUATIONS = {
    "bending": lambda: (bent(), {}),
    "crushing": lambda: (block(0.4, n=3), {}),
    "snap-through": lambda: (bar(), {}),
    "buckling": lambda: (column(1.3 * CRITICAL), {}),
    "a start": lambda: (bent(), {"u0": np.full(297, 1e-3), "t0": 0.1}),
    "a mirrored start": mirrored,
    "loads that go": released,
    "eigenvalues": lambda: (column(1.3 * CRITICAL, imperfection=1e-3), {"solver": AmgCg(), "stability": True}),
}


@pytest.mark.few
@pytest.mark.filterwarnings("ignore:From t")
@pytest.mark.parametrize(
    ("scene", "method"),
    [(scene, "load-steps") for scene in CONTINUATIONS]
    + [(scene, "arc-length") for scene in CONTINUATIONS if scene != "eigenvalues"],  # this case uses CG
)
def test_after_each_state_a_restored_continuation_has_the_same_state(tmp_path, scene, method):
    system, options = CONTINUATIONS[scene]()
    continuation, found = continuation_of(system, method, 5, **options), 0
    problem = Fingerprint("path of equilibria", system, {"method": method, "steps": 5, "rtol": 1e-8}, (0.5, 1.0), {})
    keep = checkpoint.PathCheckpoint(tmp_path / "path", system, problem, OutputFiles(None, None, False, False)).__enter__()
    for outcome in continuation.states(resumed=False):
        if not isinstance(outcome, Step):
            continue
        keep.add(outcome, continuation.saved())
        other = continuation_of(CONTINUATIONS[scene]()[0], method, 5, **options)
        keep.__exit__(None, None, None)
        keep = checkpoint.PathCheckpoint(tmp_path / "path", system, problem, OutputFiles(None, None, True, False)).__enter__()
        other.resume(keep.steps, keep.saved)
        (numbers, arrays), (others, other_arrays) = state_of(continuation), state_of(other)
        assert others == numbers and other_arrays.keys() == arrays.keys()
        for name, array in arrays.items():
            np.testing.assert_array_equal(other_arrays[name], array, err_msg=name)
        found += 1
        if found == 12:
            break
    assert found >= 2


@pytest.mark.parametrize("law", [{"rotation": "vertex"}, {"extend": "stress"}])
def test_a_path_of_a_body_without_an_energy_is_resumed(tmp_path, law):
    mesh, kind = beam(1), Corotated if "rotation" in law else InvertibleStVK
    half, others = np.arange(0, mesh.nt, 2), np.arange(1, mesh.nt, 2)
    terms = [kind(young=1e4, poisson=0.3, region=half, **law), StVK(young=1e4, poisson=0.3, region=others)]
    system = System(mesh, [*terms, Traction("tip", (3.0, -2.0, -4.0))], fixed={"wall": "xyz"})
    first = solve_static(system, 3, checkpoint=tmp_path / "path", quiet=True)
    again = solve_static(system, 3, checkpoint=tmp_path / "path", resume=True, quiet=True)
    listed = first.energies()
    assert np.isnan([step.strain_energy for step in first.history]).all() and len(again.history) == len(first.history) > 1
    assert np.isnan(listed[f"{kind.__name__} 0"]) and listed["StVK 1"] > 0
    np.testing.assert_array_equal(again.u, first.u)


@pytest.mark.parametrize("solver", ["amg-cg", "ssor-cg", "block-jacobi-cg"])  # a direct one above
def test_a_path_is_resumed_bitwise_with_each_solver(solver, tmp_path):
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 3, 14), np.linspace(0, 1.1, 5), np.linspace(0, 0.9, 5))
    law = StVK(young=2e6, poisson=0.3, density=1e3)
    body = System(mesh, [law, Gravity((0, 0, -9.0))], fixed=[(lambda x: x[0] == 0, "xyz")])
    whole = solve_static(body, steps=8, solver=solver, checkpoint=tmp_path, quiet=True)
    for file in sorted(tmp_path.glob("state_*.npz"))[3:]:
        file.unlink()
    again = solve_static(body, steps=8, solver=solver, checkpoint=tmp_path, resume=True, quiet=True)
    assert np.array_equal(again.u, whole.u)
