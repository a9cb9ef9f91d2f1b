"""A run that is killed at a random moment resumes bit for bit."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import meshio
import numba
import numpy as np
import pytest
import skfem
from motions import BOTH, MESHES, clamped, driven, kicked, material, reached, spinning, stretched, velocities, with_ends

from skfem_stvk import Gravity, NodalLoad, StVK, StvkError, StvkWarning, System, simulate
from skfem_stvk.linear import SuperLU, amg
from skfem_stvk.results import Series
from skfem_stvk.results.series import read_list
from skfem_stvk.solvers.dynamics import (
    INTEGRATORS,
    EdgeDamping,
    EnergyMomentum,
    LinearBackwardEuler,
    Newmark,
    SimulationError,
    Status,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics import motion_checkpoint as checkpoint
from skfem_stvk.solvers.dynamics.motion_checkpoint import MotionCheckpoint, load
from skfem_stvk.solvers.runs.archive import read_archive, write_archive
from skfem_stvk.solvers.runs.ledger import LedgerFile

HERE = Path(__file__).parent

#: Scene, integrator and end time by name; runs have some hundred steps, and the last step is short.
RUNS = {
    "superlu": (lambda: driven(3, damping=BOTH), lambda: EnergyMomentum(2e-3, solver="superlu"), 0.3015),
    "ssor-cg": (lambda: clamped(3), lambda: LinearBackwardEuler(2e-3), 0.3015),
    "block-jacobi-cg": (lambda: clamped(2), lambda: LinearBackwardEuler(2e-3, solver="block-jacobi-cg"), 0.3015),
    "amg-cg": (lambda: clamped(2), lambda: LinearBackwardEuler(2e-3, solver="amg-cg"), 0.3015),
    "newton with amg-cg": (lambda: spinning(2), lambda: EnergyMomentum(2e-3, solver="amg-cg"), 0.3015),
    "newmark": (lambda: driven(2, damping=BOTH), lambda: Newmark(2e-3, tangent="rest"), 0.3015),
    "verlet": (lambda: driven(3, damping=BOTH), lambda: VelocityVerlet(2e-3), 0.3015),
    "steps that are found": (lambda: stretched(MESHES[3]), lambda: VelocityVerlet(), 7.0),
    "steps that are halved": (lambda: kicked(3), lambda: VelocityVerlet(), 8.0),
    "two threads": (lambda: stretched(LARGE), lambda: VelocityVerlet(), 0.4),
}
#: Enough tetrahedra for two threads.
LARGE = with_ends(skfem.MeshTet.init_tensor(*(np.linspace(0, length, n) for length, n in ((1.0, 25), (0.5, 9), (0.4, 9)))))
SMALL = [name for name in RUNS if name != "two threads"]
EVERY = 7
PROGRAM = """
import sys
sys.path[:0] = {paths!r}
from skfem_stvk.solvers.dynamics import motion_checkpoint as checkpoint
from test_kill_and_resume import whole
checkpoint.EVERY, checkpoint.SHARE = 0.0, 0.3
print("ready", flush=True)
whole({name!r}, {folder!r}, resume={resume!r})
print("done", flush=True)
"""


def whole(name, folder, resume=False):
    """Make the run of this name, with all output files in a folder."""
    scene, integrator, until = RUNS[name]
    scene, folder = scene(), Path(folder)
    if resume:
        return reached(scene.system, checkpoint=folder / "run", resume=True, until=until)
    files = {"save": folder / "run.pvd", "every": EVERY, "checkpoint": folder / "run", "probes": {"tip": [2]}}
    return scene.run(integrator(), until, **files)


def frames(folder):
    """Return times and displacements of the states listed in the series; all files must be readable."""
    listed = read_list(folder / "run.pvd")
    return [t for t, _ in listed], [meshio.read(folder / name).point_data["displacement"] for _, name in listed]


def same(one, other, folders):
    """Assert that two runs agree to the last bit, in results, messages and files."""
    for name in ("u", "v", "t", "dt", "message", "cuts", "iterations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.ledger.rows(), other.ledger.rows())
    (times, states), (others, other_states) = (frames(folder) for folder in folders)
    assert times == others and times[0] == 0 and times[-1] == one.t
    np.testing.assert_array_equal(states, other_states)
    assert len({(folder / "run.csv").read_bytes() for folder in folders}) == 1
    assert len({tuple(sorted(file.name for file in folder.iterdir())) for folder in folders}) == 1


@pytest.fixture
def folders(tmp_path):
    """Return a folder for the complete run, and one for the killed run."""
    for name in ("whole", "killed"):
        (tmp_path / name).mkdir()
    return tmp_path / "whole", tmp_path / "killed"


class Killed(BaseException):
    pass


def stopped(name, folder, monkeypatch, checkpoints, resume=False):
    """Stop the run as a kill would, after this number of checkpoints, one per step: without cleanup or further output."""
    kept, count = MotionCheckpoint.replace, 0

    def write(self, *content):
        nonlocal count
        kept(self, *content)
        count += 1
        if count == checkpoints:
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "EVERY", 0.0)
        patch.setattr(checkpoint, "SHARE", np.inf)
        patch.setattr(MotionCheckpoint, "replace", write)
        with pytest.raises(Killed):
            whole(name, folder, resume)


@pytest.mark.few
@pytest.mark.parametrize("name", SMALL)
@pytest.mark.filterwarnings("ignore:.*inverted:skfem_stvk.errors.StvkWarning")
def test_a_run_resumes_bit_for_bit_from_any_checkpoint(folders, monkeypatch, name):
    expected = whole(name, folders[0])
    assert expected.ledger.steps > 150 and (np.ptp(np.diff(expected.ledger["time"])[:-1]) > 1e-4) == name.startswith("steps")
    assert ("blew up" in expected.message) == (name == "steps that are halved")
    first, second = np.random.default_rng(len(name)).integers(1, expected.ledger.steps // 2 - 1, 2)
    stopped(name, folders[1], monkeypatch, first)
    stopped(name, folders[1], monkeypatch, second, resume=True)
    same(expected, whole(name, folders[1], resume=True), folders)


def of_many_levels(young=2e4):
    """Return a bar under its weight, whose multigrid hierarchy has more than its coarsest level."""
    mesh = with_ends(skfem.MeshTet.init_tensor(*(np.linspace(0, length, n) for length, n in ((3.0, 14), (1.1, 5), (0.9, 5)))))
    law = StVK(young=young, poisson=0.3, density=1e3)
    return System(mesh, [law, Gravity((0, 0, -9.0))], fixed=[(lambda x: x[0] == 0, "xyz")])


@pytest.mark.few
@pytest.mark.parametrize("solver", ["superlu", "amg-cg", "ssor-cg", "block-jacobi-cg"])
@pytest.mark.parametrize("integrator", [name for name, one in INTEGRATORS.items() if not one.explicit])
def test_each_integrator_resumes_bit_for_bit_with_each_solver(integrator, solver, tmp_path):
    steps, system = INTEGRATORS[integrator](0.02, solver=solver), of_many_levels()
    whole = simulate(system, steps, until=0.32, quiet=True)
    for n in (3, 9):
        simulate(system, steps, until=n * 0.02, checkpoint=tmp_path / str(n), quiet=True)
        again = simulate(system, checkpoint=tmp_path / str(n), resume=True, until=0.32, quiet=True)
        np.testing.assert_array_equal(again.u, whole.u)
        np.testing.assert_array_equal(again.ledger.rows(), whole.ledger.rows())


@pytest.mark.parametrize("integrator", [Newmark, EnergyMomentum])
def test_a_replaced_hierarchy_is_rebuilt_after_a_resume(integrator, tmp_path, monkeypatch):
    monkeypatch.setattr(amg, "GROWTH", 0.95)  # so that most of them count as slow
    steps, system = integrator(0.02, solver="amg-cg"), of_many_levels(young=2e7)
    whole = simulate(system, steps, until=0.32, quiet=True)
    simulate(system, steps, until=0.14, checkpoint=tmp_path / "run", quiet=True)
    origin = load(tmp_path / "run" / "motion.npz").saved.origin
    assert origin.t > 0.02 and origin.pace > 0
    again = simulate(system, checkpoint=tmp_path / "run", resume=True, until=0.32, quiet=True)
    np.testing.assert_array_equal(again.u, whole.u)


def test_a_checkpoint_with_a_hierarchy_whose_origin_is_not_finite_is_refused(tmp_path):
    steps = LinearBackwardEuler(0.02, solver="amg-cg")
    simulate(of_many_levels(), steps, until=0.06, checkpoint=tmp_path / "run", quiet=True)
    header, arrays = read_archive(tmp_path / "run" / "motion.npz", MotionCheckpoint.known, "")
    assert header["record"]["origin"]["t"] == 0.02
    arrays["origin w"] = np.full_like(arrays["origin w"], np.nan)
    write_archive(tmp_path / "run" / "motion.npz", header, arrays)
    with pytest.raises(StvkError, match=r"damaged: .*origin w"):
        simulate(of_many_levels(), checkpoint=tmp_path / "run", resume=True, until=0.1, quiet=True)


def killed(name, folder, threads, moment, resume=False):
    """Run this in a process that is killed `moment` seconds after its first checkpoint; return whether it was still running."""
    program = PROGRAM.format(paths=[str(HERE), str(HERE.parents[1])], name=name, folder=str(folder), resume=resume)
    environment = os.environ | {"NUMBA_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout.readline() == "ready\n"
        limit = time.monotonic() + 300
        while not (folder / "run" / "motion.npz").exists() and process.poll() is None and time.monotonic() < limit:
            time.sleep(0.001)
        time.sleep(moment)
        process.kill()
        return process.wait() == -signal.SIGKILL


@pytest.mark.slow
@pytest.mark.parametrize(("name", "threads"), [("superlu", 1), ("two threads", 2)])
def test_a_killed_process_loses_nothing_that_was_written(folders, name, threads):
    before, threads = numba.get_num_threads(), min(threads, numba.config.NUMBA_NUM_THREADS)
    numba.set_num_threads(threads)
    try:
        expected = whole(name, folders[0])
        moments = np.random.default_rng(threads).uniform(0, 0.5, 2)  # the moment in the run depends on how busy the machine is
        print(f"killed after {moments} s")
        assert killed(name, folders[1], threads, moments[0])
        times, _ = frames(folders[1])
        times = [t for t in times if t != expected.t]  # it may have been killed after its last frame
        assert times == list(expected.ledger["time"][: EVERY * len(times) : EVERY])
        killed(name, folders[1], threads, moments[1], resume=True)
        assert set(frames(folders[1])[0]) <= {*expected.ledger["time"][::EVERY], expected.t}
        same(expected, whole(name, folders[1], resume=True), folders)
    finally:
        numba.set_num_threads(before)


def test_a_finished_run_resumes_to_a_later_end(folders):
    scene = driven(3, damping=BOTH)
    integrator = EnergyMomentum(0.01)
    for folder, ends in zip(folders, ([0.2], [0.055, 0.1, 0.2]), strict=True):
        run = scene.run(integrator, ends[0], save=folder / "run.pvd", every=EVERY, checkpoint=folder / "run")
        for end in ends[1:]:
            run = simulate(scene.system, integrator, checkpoint=folder / "run", resume=True, until=end, quiet=True)
        if folder is folders[0]:
            expected = run
    same(expected, run, folders)


def test_a_checkpoint_contains_the_last_whole_step(tmp_path):
    spinning(2).run(EnergyMomentum(0.01), 0.055, checkpoint=tmp_path / "run")
    with pytest.raises(StvkError, match=r"until = 0.04 s; expected an end after t = 0.05 s"):
        simulate(spinning(2).system, checkpoint=tmp_path / "run", resume=True, until=0.04)
    assert simulate(spinning(2).system, checkpoint=tmp_path / "run", resume=True, until=0.05).t == 0.05


@pytest.mark.parametrize("integrator", [EnergyMomentum(0.1), VelocityVerlet(0.001)])
def test_a_motion_at_its_end_is_returned_unchanged(integrator, tmp_path):
    """The end may be rounded: 3 * 0.1 is above 0.3."""
    options = {"until": 0.3, "save": tmp_path / "run.pvd", "checkpoint": tmp_path / "run", "quiet": True}
    finished = simulate(spinning(2).system, integrator, v0=spinning(2).v0, **options)
    files = {file: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}
    again = simulate(spinning(2).system, resume=True, **options)
    assert (again.t, again.status, again.message, again.iterations) == (
        finished.t,
        finished.status,
        finished.message,
        finished.iterations,
    )
    np.testing.assert_array_equal(again.u, finished.u)
    np.testing.assert_array_equal(again.ledger.rows(), finished.ledger.rows())
    assert files == {file: file.read_bytes() for file in tmp_path.iterdir() if file.is_file()}


def test_output_files_may_change_when_a_run_resumes(tmp_path):
    scene = spinning(2)
    scene.run(EnergyMomentum(0.01), 0.1, checkpoint=tmp_path / "a")
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    run = simulate(scene.system, until=0.2, save=tmp_path / "b.pvd", every=5, checkpoint=tmp_path / "b", resume=True, quiet=True)
    assert [t for t, _ in read_list(tmp_path / "b.pvd")] == pytest.approx([0.1, 0.15, 0.2])
    further = [simulate(scene.system, checkpoint=tmp_path / name, resume=True, until=0.3, quiet=True) for name in ("a", "b")]
    np.testing.assert_array_equal(further[0].u, further[1].u)
    assert run.t == pytest.approx(0.2) and further[0].ledger.steps == 31


V0 = velocities(MESHES[2])
CALL = {"integrator": EnergyMomentum(0.01, solver="superlu"), "v0": V0, "probes": {"tip": [2]}, "damping": BOTH}


@pytest.fixture
def saved(tmp_path):
    system = clamped(2).system
    simulate(system, until=0.1, checkpoint=tmp_path / "run", quiet=True, **CALL)
    return system, tmp_path / "run"


@pytest.mark.few
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"u0": np.full(V0.size, 1e-3)}, "another problem: u0 changed. Pass the same, or leave it out"),
        ({"v0": 2 * V0, "mass": "consistent"}, "mass was 'lumped' and is 'consistent'; v0 changed"),
        ({"damping": EdgeDamping(1.0)}, "damping was .* and is"),
        ({"probes": {"tip": [1]}}, r"probes = \['tip'\]; expected those of .*, \['tip'\]"),
        ({"reactions": {"A": "left"}}, r"reactions = \['A'\]; expected those of .*, \[\]"),
        ({"t0": 0.1}, "t0 changed"),
        (
            {"integrator": EnergyMomentum(0.02, solver="superlu")},
            r"integrator was EnergyMomentum\(dt=0.01, .* and is EnergyMomentum\(dt=0.02",
        ),
        ({"integrator": EnergyMomentum(0.01)}, "solver='superlu'"),
        ({"integrator": VelocityVerlet(0.01)}, "was EnergyMomentum.* and is VelocityVerlet"),
        ({"until": 0.05}, "until = 0.05 s; expected an end after t = 0.1 s"),
        ({"every": 0}, "every = 0; expected"),
    ],
)
def test_a_run_resumes_only_with_the_same_problem(saved, options, message):
    system, path = saved
    kept = (path / "motion.npz").read_bytes()
    with pytest.raises(StvkError, match=message):
        simulate(**{"system": system, "checkpoint": path, "resume": True, "until": 0.2, "quiet": True} | options)
    assert (path / "motion.npz").read_bytes() == kept


def test_omitted_arguments_are_taken_from_the_checkpoint(saved, tmp_path):
    system, path = saved
    shutil.copytree(path, tmp_path / "other")
    whole = simulate(system, until=0.2, quiet=True, **CALL)
    for place, given in ((path, CALL), (tmp_path / "other", {})):
        again = simulate(system, until=0.2, checkpoint=place, resume=True, quiet=True, **given)
        np.testing.assert_array_equal(again.ledger.rows(), whole.ledger.rows())
        np.testing.assert_array_equal(again.u, whole.u)


def test_resume_starts_a_run_without_checkpoint(tmp_path):
    system = clamped(2).system
    run = simulate(system, until=0.05, checkpoint=tmp_path / "run", resume=True, quiet=True, **CALL)
    assert run.ledger.steps == 6 and [file.name for file in (tmp_path / "run").iterdir()] == ["motion.npz"]


def moved(tmp_path):
    """Return the scene of a run with a series, and the folder to which its checkpoint was moved."""
    scene = spinning(2)
    (tmp_path / "old").mkdir()
    scene.run(EnergyMomentum(0.01), 0.1, save=tmp_path / "old" / "run.pvd", every=3, checkpoint=tmp_path / "old" / "run")
    (tmp_path / "old").rename(tmp_path / "new")
    return scene, tmp_path / "new"


def test_a_series_continues_next_to_a_moved_checkpoint(tmp_path):
    scene, new = moved(tmp_path)
    run = simulate(scene.system, checkpoint=new / "run", resume=True, until=0.2, quiet=True)
    assert run.series == new / "run.pvd" and not (tmp_path / "old").exists()
    assert frames(new)[0] == [run.ledger["time"][row] for row in (0, 3, 6, 9, 12, 15, 18, 20)]


def test_the_path_of_a_missing_series_is_requested(tmp_path):
    """The message names the checkpoint's path, and no series is started without a warning."""
    scene, new = moved(tmp_path)
    kept = {file.name: file.read_bytes() for file in new.rglob("*") if file.is_file()}
    (tmp_path / "run").mkdir()
    shutil.copy(new / "run" / "motion.npz", tmp_path / "run")
    with pytest.raises(StvkError, match=r"saved the series '.*old.run\.pvd', but there is no run.pvd in .*save="):
        simulate(scene.system, checkpoint=tmp_path / "run", resume=True, until=0.2, quiet=True)
    assert kept == {file.name: file.read_bytes() for file in new.rglob("*") if file.is_file()}
    with pytest.warns(
        StvkWarning, match=r"other\.pvd does not exist, so it begins at t = 0\.1 s\. Earlier states are in the series of the run"
    ):
        run = simulate(scene.system, save=tmp_path / "other.pvd", checkpoint=tmp_path / "run", resume=True, until=0.2, quiet=True)
    assert [t for t, _ in read_list(run.series)] == [run.ledger["time"][row] for row in (12, 15, 18, 20)]
    shutil.copy(new / "run" / "motion.npz", tmp_path / "run")
    run = simulate(scene.system, save=new / "run.pvd", checkpoint=tmp_path / "run", resume=True, until=0.2, quiet=True)
    assert len(frames(new)[0]) == 8


def test_a_solver_object_has_to_be_passed_again(tmp_path):
    scene, integrator = spinning(2), EnergyMomentum(0.01, solver=SuperLU())
    whole = scene.run(integrator, 0.2)
    scene.run(integrator, 0.1, checkpoint=tmp_path / "run")
    with pytest.raises(StvkError, match=r"whose solver was an object: its options are not in the file. Pass the same integrator"):
        simulate(scene.system, checkpoint=tmp_path / "run", resume=True, until=0.2, quiet=True)
    again = simulate(
        scene.system, EnergyMomentum(0.01, solver=SuperLU()), checkpoint=tmp_path / "run", resume=True, until=0.2, quiet=True
    )
    np.testing.assert_array_equal(again.u, whole.u)


@pytest.mark.parametrize("what", ["checkpoint", "table", "state"])
def test_a_full_disk_ends_a_run_without_losing_results(folders, monkeypatch, what):
    expected = whole("superlu", folders[0])
    owner, method = {"checkpoint": (MotionCheckpoint, "replace"), "table": (LedgerFile, "write"), "state": (Series, "add")}[what]
    kept, count = getattr(owner, method), 0

    def full(self, *content):
        nonlocal count
        count += 1
        if count == 9:
            raise OSError(errno.ENOSPC, "No space left on device")
        return kept(self, *content)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "EVERY", 0.0)
        patch.setattr(checkpoint, "SHARE", np.inf)
        patch.setattr(owner, method, full)
        with pytest.raises(
            SimulationError, match=r"interrupted at t = .*: results could not be written .*No space left on device.*Free disk space"
        ) as caught:
            whole("superlu", folders[1])
    run = caught.value.run
    assert run.status is Status.INTERRUPTED and isinstance(caught.value.__cause__, OSError)
    row = int(np.flatnonzero(expected.ledger["time"] == run.t)[0])
    np.testing.assert_array_equal(run.ledger.rows(), expected.ledger.rows()[: row + 1])
    same(expected, whole("superlu", folders[1], resume=True), folders)


@pytest.mark.filterwarnings("ignore::skfem_stvk.errors.StvkWarning")
def test_a_resumed_run_that_blows_up_retains_earlier_states(tmp_path):
    mesh = MESHES[2]
    system = System(mesh, [material(mesh), NodalLoad((1, 5), lambda t: (0.0, 0.0) if t <= 1 else (1e5, 3e5))])
    options = {"save": tmp_path / "run.pvd", "every": 10, "checkpoint": tmp_path / "run", "quiet": True}
    simulate(system, VelocityVerlet(0.01), until=1.0, v0=0.1 * velocities(mesh), **options)
    run = simulate(system, checkpoint=tmp_path / "run", resume=True, until=5.0, quiet=True, raise_on_failure=False)
    times, _ = frames(tmp_path)
    assert run.status is Status.BLEW_UP and times == pytest.approx([0.1 * number for number in range(11)]) and run.t == times[-1]
