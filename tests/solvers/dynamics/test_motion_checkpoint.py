"""Checkpoints of motions on disk."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import is_dataclass
from pathlib import Path

import numpy as np
import pytest
import skfem
from slow import slow

from skfem_stvk import Gravity, NodalLoad, Rayleigh, StVK, StvkError, System, Traction, VelocityVerlet, simulate
from skfem_stvk.results.complete_files import WriteError
from skfem_stvk.solvers.dynamics import motion_checkpoint as module
from skfem_stvk.solvers.dynamics.motion_checkpoint import MotionCheckpoint, SavedMotion, load
from skfem_stvk.solvers.dynamics.motion_setup import FRACTIONS
from skfem_stvk.solvers.dynamics.record import Clock, Counts, HierarchyOrigin, MotionState, Reviews
from skfem_stvk.solvers.newton.problem import Tangent
from skfem_stvk.system.signature import Fingerprint

MESH = skfem.MeshTri().refined(2).with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == 1})
SOFT = StVK(young=1e4, poisson=0.3, density=3.0)


def body(material=SOFT, mesh=MESH, loads=(), fixed=None, prescribed=None):
    return System(mesh, [material, *loads], fixed=fixed or {"wall": "xy"}, prescribed=prescribed)


def call(path, system=None, **options):
    """Run a motion with a checkpoint in a folder."""
    given = {"integrator": VelocityVerlet(1e-3), "until": 0.02, "v0": np.full(2 * MESH.nvertices, 0.1)}
    return simulate(system or body(), checkpoint=path, quiet=True, **(given | options))


def content(steps=3, size=50):
    """Return the record of a checkpoint with typical data that belongs to no motion."""
    rng = np.random.default_rng(steps)
    state = MotionState(1e-300, *rng.normal(size=(4, size)) / 3, rng.normal(size=(2, size)))
    return SavedMotion(
        state=state,
        clock=Clock(0.0, 1 / 3, 0),
        reviews=Reviews(),
        steps=2,
        cuts=0,
        history=(np.arange(3.0), np.array([-np.inf, 1 / 3])),
        good=None,
        origin=HierarchyOrigin(state.a, state.v, 0.1, 2.0, 0.0, Tangent.CLAMPED, True),
        removed=np.arange(steps),
        removed_at=np.full(steps, np.nan),
        counts=Counts(7, 0),
        seconds={"solve": 0.1, "other": -1e-9},
        columns=["time", "A x"],
        rows=rng.normal(size=(steps, 2)),
        probes={"A": np.array([3, 5])},
        reactions={},
        supports={},
        every=10,
    )


def written(path, steps=3):
    """Write a checkpoint with typical data that belongs to no motion."""
    method = {"integrator": {"name": "Verlet", "options": {"dt": 1 / 3}, "objects": {}}, "mass": "lumped"}
    method["damping"] = {"alpha": 0.0, "beta": 0.0, "tau": 0.0}
    checkpoint = MotionCheckpoint(Path(path))
    with checkpoint:
        checkpoint.belongs_to(Fingerprint("motion", body(), method, [0.0, 2.0], {}), overwrite=True)
        checkpoint.replace(content(steps))
    return checkpoint, content(steps)


def same(read, saved):
    assert_equal(read.saved, saved)
    assert_equal(read.ledger.rows(), saved.rows)


def assert_equal(one, other):
    """Assert that two records agree to the last bit, with the types of their arrays."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    elif is_dataclass(one) or isinstance(one, tuple | dict):
        parts = [vars(each) if is_dataclass(each) else each for each in (one, other)]
        pairs = zip(*(each.values() if isinstance(each, dict) else each for each in parts), strict=True)
        assert not isinstance(parts[0], dict) or parts[0].keys() == parts[1].keys()
        for pair in pairs:
            assert_equal(*pair)
    else:
        assert one == other


@pytest.mark.parametrize("steps", [0, 1, 2000])
def test_a_checkpoint_is_read_back_bit_for_bit(tmp_path, steps):
    checkpoint, saved = written(tmp_path / "flag", steps=steps)
    same(load(checkpoint.file), saved)
    assert [file.name for file in (tmp_path / "flag").iterdir()] == ["motion.npz"]


def test_the_ledger_of_a_checkpoint_can_be_extended(tmp_path):
    checkpoint, saved = written(tmp_path / "flag")
    again = load(checkpoint.file).ledger
    again.append([9.0, 8.0])
    assert again.steps == len(saved.rows) + 1 and again["A x"][-1] == 8.0


def others():
    weight, pull = Gravity(g=(0, -2.0)), Traction("tip", lambda t: (0, np.sin(3 * t)))
    base = {"loads": (weight, pull), "prescribed": {"tip": {"x": lambda t: 0.1 * t}}}
    finer = MESH.refined(1).with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == 1})
    moved = skfem.MeshTri(MESH.p + 1e-5 * np.sin(9 * MESH.p[1]), MESH.t).with_boundaries(dict(MESH.boundaries))
    yield "the mesh", base, {"mesh": finer}
    yield "the mesh", base, {"mesh": moved}
    yield "the elastic terms", base, {"material": StVK(young=1.0001e4, poisson=0.3, density=3.0)}
    yield "the masses", {}, {"material": StVK(young=1e4, poisson=0.3, density=3.001)}
    yield "the loads", base, {"loads": (Gravity(g=(0, -2.001)), pull)}
    yield "the loads", base, {"loads": (weight, Traction("tip", lambda t: (0, np.sin(3.01 * t))))}
    yield "the loads", base, {"loads": (weight, pull, NodalLoad([3], (0, 1e-3)))}
    yield "the supports", {}, {"fixed": {"wall": "xy", "tip": "x"}}
    yield "prescribed displacements", base, {"prescribed": {"tip": {"x": lambda t: 0.1 * t**2}}}


@pytest.mark.parametrize("number", range(9))
def test_the_motion_of_another_system_is_neither_resumed_nor_replaced(tmp_path, number):
    what, base, change = list(others())[number]
    base = {"loads": [Gravity(g=(0, -2.0))]} | base
    call(tmp_path / "flag", body(**base), v0=None, save=tmp_path / "flag.pvd", damping=Rayleigh(1.0), u0=None)
    kept = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    other = {"system": body(**(base | change)), "v0": None, "damping": Rayleigh(1.0)}
    with pytest.raises(StvkError, match=rf"motion\.npz is of another problem: .*{what}.* changed"):
        call(tmp_path / "flag", resume=True, until=0.03, **other)
    with pytest.raises(StvkError, match=rf"motion\.npz is of another problem: .*{what}.* changed.*overwrite=True"):
        call(tmp_path / "flag", **other)
    with pytest.raises(StvkError, match=rf"flag\.pvd is the series of another problem: .*{what}.* changed.*overwrite=True"):
        call(tmp_path / "else", save=tmp_path / "flag.pvd", **other)
    assert kept == {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}


def test_a_run_replaces_its_own_motion_and_others_only_with_overwrite(tmp_path):
    files = {"path": tmp_path / "flag", "save": tmp_path / "flag.pvd", "every": 5}
    call(**files)
    assert call(**files, until=0.03).success and len(list(tmp_path.glob("flag_*.vtu"))) == 7
    slower = {"integrator": VelocityVerlet(5e-4)}
    with pytest.raises(StvkError, match=r"integrator was .*dt=0.001.* and is .*dt=0.0005"):
        call(**files, **slower)
    assert call(**files, **slower, overwrite=True).success
    assert call(**files, **slower, resume=True, until=0.03).ledger.steps == 61


def test_fingerprints_use_the_times_of_the_run_and_constant_loads_do_not_ramp(tmp_path):
    asked = set()

    def pull(t):
        asked.add(t)
        return 0, 1.0 + t

    system = body(loads=[Traction("tip", pull)])
    asked.clear()
    problem = Fingerprint("motion", system, {}, [3.0 + fraction * 2.0 for fraction in FRACTIONS], {})
    assert problem.signature.kind == "motion" and (min(asked), max(asked)) == (3.0, 5.0) and len(asked) == 4
    constant, ramping = Traction("tip", (0, 1.0)), Traction("tip", lambda t: (0, t))
    one, other = (Fingerprint("motion", body(loads=[load]), {}, [0.0, 0.62], {}) for load in (constant, ramping))
    assert other.differences(one.signature) == "the loads at t = 0 s, the loads at t = 0.62 s changed"
    assert not one.differences(one.signature)


def test_loads_undefined_at_the_times_of_another_motion_differ_from_its_loads(tmp_path):
    def short(t):
        if 0.02 < t < 0.5:
            raise RuntimeError("no data")
        return 0, t

    call(tmp_path / "flag", until=0.05)
    with pytest.raises(
        StvkError, match=r"another problem: the present loads cannot be evaluated at the times of the file \(.*no data"
    ):
        call(tmp_path / "flag", body(loads=[Traction("tip", short)]))


def test_invalid_files_are_named(tmp_path):
    path = tmp_path / "motion.npz"
    with pytest.raises(StvkError, match=r"no checkpoint .*motion\.npz.*Without resume=True, simulate starts"):
        load(path)
    np.savez(path, u=np.zeros(3))
    for refused in (load, lambda path: call(tmp_path)):
        with pytest.raises(StvkError, match=r"motion\.npz cannot be read as a motion of skfem-stvk.*overwrite=True"):
            refused(path)
    for content in (b"", b"PK", b"not a file of ours", np.arange(9.0).tobytes()):
        path.write_bytes(content)
        with pytest.raises(StvkError, match=r"incomplete, or was not written by this package .*not a complete .npz file") as caught:
            load(path)
        assert "pickle" not in str(caught.value)
    np.save(tmp_path / "flag.npy", np.zeros(3))
    for other in (tmp_path / "flag.npy", tmp_path):
        with pytest.raises(StvkError, match="cannot be read"):
            load(other)
    assert call(tmp_path, overwrite=True).success and load(path).ledger.steps == 21


def test_a_truncated_or_damaged_file_is_never_accepted(tmp_path):
    path, rng = tmp_path / "flag" / "motion.npz", np.random.default_rng(3)
    _, saved = written(tmp_path / "flag")
    whole = path.read_bytes()
    refused = 0
    for trial in range(300):
        data = bytearray(whole)
        if trial % 2:
            del data[rng.integers(len(data)) :]
        else:
            data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(data)
        try:
            same(load(path), saved)  # a bit without meaning, such as in the date of a file
        except StvkError:
            refused += 1
    assert refused > 250


def test_another_version_is_refused(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(MotionCheckpoint, "known", ("motion of skfem-stvk", 7))
        written(tmp_path / "flag")
    with pytest.raises(StvkError, match=r"is of version 7 of the format 'motion of skfem-stvk'; this release reads version 6"):
        load(tmp_path / "flag" / "motion.npz")


def test_unwritable_paths_are_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "no" / "flag", tmp_path / "file"):
        with pytest.raises(StvkError, match="cannot be written"), MotionCheckpoint(path):
            pass
    checkpoint, saved = written(tmp_path / "flag")
    with MotionCheckpoint(checkpoint.folder):  # this checks that the folder is writable, and leaves the file alone
        same(load(checkpoint.file), saved)


def test_writing_checkpoints_is_limited_to_a_share_of_the_time(tmp_path, monkeypatch):
    for cost in (0.001, 0.2, 3.0):
        now = [100.0]
        monkeypatch.setattr(module.time, "perf_counter", lambda now=now: now[0])
        monkeypatch.setattr(np, "savez", lambda file, now=now, cost=cost, **_: now.__setitem__(0, now[0] + cost))
        checkpoint, writes, begin = MotionCheckpoint(tmp_path / "flag"), [], now[0]
        checkpoint.folder.mkdir(exist_ok=True)
        checkpoint.belongs_to(Fingerprint("motion", body(), {}, [0.0], {}), overwrite=True)
        while now[0] < begin + 600:
            if checkpoint.due(now[0]):
                checkpoint.replace(content())
                writes.append(now[0])
            now[0] += 0.01
        assert writes[0] == begin + cost, "the first one is due at once"
        spent = cost * (len(writes) - 1) / (writes[-1] - writes[0])
        assert spent <= 0.05 and np.diff(writes).max() <= max(60.0, 21 * cost) + 0.02


@pytest.mark.skipif(os.name == "nt", reason="no limit on the size of files")
def test_a_full_disk_retains_the_earlier_checkpoint(tmp_path):
    import resource

    checkpoint, saved = written(tmp_path / "flag")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for limit in (0, 100, 900, 20_000):
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
            with pytest.raises(
                WriteError, match=r"motion\.npz could not be written: File too large\. Its previous content.*Free disk space"
            ):
                checkpoint.replace(content(size=100_000))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert [file.name for file in checkpoint.folder.iterdir()] == ["motion.npz"]
        same(load(checkpoint.file), saved)


ENDLESS = """
import sys
import numpy as np
sys.path[:0] = {path!r}
from test_motion_checkpoint import content, written
checkpoint, _ = written({file!r})
ledger = [[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]]
step = 3
while True:
    ledger.append([float(step), 2.0 * step])
    step += 1
    saved = content(size=50_000)
    saved.state.u[:], saved.rows = float(step), np.array(ledger)
    checkpoint.replace(saved)
    print(step, flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no signal that cannot be caught")
@pytest.mark.parametrize("delay", [0.0, slow(0.0007), 0.003, slow(0.008)])
def test_a_killed_run_leaves_a_whole_checkpoint(tmp_path, delay):
    path = tmp_path / "flag"
    code = ENDLESS.format(path=[os.path.dirname(os.path.abspath(__file__)), *sys.path], file=str(path))
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    for _ in range(5):
        done = int(child.stdout.readline())
    time.sleep(delay)
    child.send_signal(signal.SIGKILL)
    child.wait()
    _, _, saved, ledger = load(path / "motion.npz")
    assert ledger.steps >= done and (saved.state.u == ledger.steps).all()
    np.testing.assert_array_equal(ledger["A x"][3:], 2.0 * np.arange(3, ledger.steps))
