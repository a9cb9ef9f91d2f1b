"""A motion on disk."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import skfem

from skfem_stvk import Gravity, NodalLoad, StVK, StvkError, System, Traction
from skfem_stvk.dynamics import checkpoint as module
from skfem_stvk.dynamics.checkpoint import Checkpoint, load
from skfem_stvk.dynamics.ledger import Ledger

MESH = skfem.MeshTri().refined(2).with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == 1})
SOFT = StVK(young=1e4, poisson=0.3, density=3.0)


def body(material=SOFT, mesh=MESH, loads=(), fixed=None, prescribed=None):
    return System(mesh, [material, *loads], fixed=fixed or {"wall": "xy"}, prescribed=prescribed)


def written(path, system=None, times=(0.0, 2.0), steps=3):
    """A checkpoint with something to lose in it."""
    system = system or body()
    rng = np.random.default_rng(steps)
    ledger = Ledger(["time", "A x"], rng.normal(size=(steps, 2)))
    arrays = {"u": rng.normal(size=system.ndofs) / 3, "picked": np.arange(steps), "on": np.array([True, False])}
    about = {"integrator": "Verlet", "dt": 1 / 3, "step": steps, "nested": {"t": [0.1, 1e-300]}}
    checkpoint = Checkpoint(path, system, times)
    checkpoint.write(about, arrays, ledger)
    return checkpoint, about, arrays, ledger


def same(saved, about, arrays, ledger):
    assert saved.about == about and saved.arrays.keys() == arrays.keys() and saved.ledger.names == ledger.names
    for name, array in arrays.items():
        assert saved.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(saved.arrays[name], array)
    np.testing.assert_array_equal(saved.ledger.rows(), ledger.rows())


@pytest.mark.parametrize("steps", [0, 1, 2000])
def test_a_checkpoint_gives_back_every_bit(tmp_path, steps):
    _, *content = written(tmp_path / "flag.npz", steps=steps)
    same(load(tmp_path / "flag.npz", body()), *content)
    assert [file.name for file in tmp_path.iterdir()] == ["flag.npz"]


def test_the_ledger_of_a_checkpoint_goes_on(tmp_path):
    _, _, _, ledger = written(tmp_path / "flag.npz")
    again = load(tmp_path / "flag.npz", body()).ledger
    again.append([9.0, 8.0])
    assert again.steps == ledger.steps + 1 and again["A x"][-1] == 8.0


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
def test_the_motion_of_another_system_is_refused(tmp_path, number):
    what, base, change = list(others())[number]
    written(tmp_path / "flag.npz", body(**base))
    load(tmp_path / "flag.npz", body(**base))
    with pytest.raises(StvkError, match=rf"flag\.npz holds the motion of another system: .*{what}.* changed"):
        load(tmp_path / "flag.npz", body(**(base | change)))


def test_constant_loads_do_not_ramp_and_times_are_those_of_the_run(tmp_path):
    asked = set()

    def pull(t):
        asked.add(t)
        return 0, 1.0 + t

    system = body(loads=[Traction("tip", pull)])
    asked.clear()
    written(tmp_path / "flag.npz", system, times=(3.0, 5.0))
    assert (min(asked), max(asked)) == (3.0, 5.0) and len(asked) == 4
    constant, ramping = Traction("tip", (0, 1.0)), Traction("tip", lambda t: (0, t))
    written(tmp_path / "flag.npz", body(loads=[constant]))
    with pytest.raises(StvkError, match=r"the loads at t = 0 s, the loads at t = 0\.62 s"):
        load(tmp_path / "flag.npz", body(loads=[ramping]))


def test_files_that_are_none_are_named(tmp_path):
    path = tmp_path / "flag.npz"
    with pytest.raises(StvkError, match=r"no checkpoint .*flag\.npz.*leave out resume"):
        load(path, body())
    np.savez(path, u=np.zeros(3))
    with pytest.raises(StvkError, match=r"flag\.npz cannot be read as the checkpoint of a motion"):
        load(path, body())
    for content in (b"", b"PK", b"not a file of ours", np.arange(9.0).tobytes()):
        path.write_bytes(content)
        with pytest.raises(StvkError, match=r"incomplete, or was not written here .*no whole .npz file") as caught:
            load(path, body())
        assert "pickle" not in str(caught.value)
    np.save(tmp_path / "flag.npy", np.zeros(3))
    with pytest.raises(StvkError, match="cannot be read"):
        load(tmp_path / "flag.npy", body())
    with pytest.raises(StvkError, match="cannot be read"):
        load(tmp_path, body())


def test_a_file_that_is_cut_or_damaged_is_never_believed(tmp_path):
    path, rng = tmp_path / "flag.npz", np.random.default_rng(3)
    _, *content = written(path)
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
            same(load(path, body()), *content)  # a bit that means nothing, such as a file's date
        except StvkError:
            refused += 1
    assert refused > 250


def test_another_version_is_refused(tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(module, "VERSION", 7)
        written(tmp_path / "flag.npz")
    with pytest.raises(StvkError, match=r"is of version 7 of checkpoints; this release reads version 3"):
        load(tmp_path / "flag.npz", body())


def test_places_that_cannot_be_written_are_refused_before_any_work(tmp_path):
    for path, message in ((tmp_path / "flag.zip", r"does not end in .npz"), (tmp_path / "no" / "flag.npz", "does not exist")):
        with pytest.raises(StvkError, match=message):
            Checkpoint(path, body(), (0.0, 1.0))
    checkpoint, *content = written(tmp_path / "flag.npz")
    Checkpoint(checkpoint.path, body(), (0.0, 1.0))  # looks whether it can write, and leaves the file alone
    same(load(checkpoint.path, body()), *content)


def test_writing_takes_no_more_than_its_share_of_the_time(tmp_path, monkeypatch):
    for cost in (0.001, 0.2, 3.0):
        now = [100.0]
        monkeypatch.setattr(module.time, "perf_counter", lambda now=now: now[0])
        monkeypatch.setattr(module.np, "savez", lambda file, now=now, cost=cost, **_: now.__setitem__(0, now[0] + cost))
        checkpoint, writes, begin = Checkpoint(tmp_path / "flag.npz", body(), (0.0, 1.0)), [], now[0]
        while now[0] < begin + 600:
            if checkpoint.due(now[0]):
                checkpoint.write({}, {}, Ledger(["time"]))
                writes.append(now[0])
            now[0] += 0.01
        assert writes[0] == begin + cost, "the first one is due at once"
        spent = cost * (len(writes) - 1) / (writes[-1] - writes[0])
        assert spent <= 0.05 and np.diff(writes).max() <= max(60.0, 21 * cost) + 0.02


@pytest.mark.skipif(os.name == "nt", reason="no limit on the size of files")
def test_a_full_disk_keeps_the_checkpoint_that_is_there(tmp_path):
    import resource

    checkpoint, about, arrays, ledger = written(tmp_path / "flag.npz")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for room in (0, 100, 900, 20_000):
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
            with pytest.raises(OSError, match="too large"):
                checkpoint.write(about, {"u": np.zeros(100_000)}, ledger)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert [file.name for file in tmp_path.iterdir()] == ["flag.npz"]
        same(load(checkpoint.path, body()), about, arrays, ledger)


ENDLESS = """
import sys
import numpy as np
sys.path[:0] = {path!r}
from test_motion_checkpoint import Checkpoint, Ledger, body
checkpoint, ledger, step = Checkpoint({file!r}, body(), (0.0, 2.0)), Ledger(["time", "A x"]), 0
while True:
    ledger.append([step, 2.0 * step])
    step += 1
    checkpoint.write({{"step": step}}, {{"u": np.full(50_000, float(step))}}, ledger)
    print(step, flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no signal that cannot be caught")
@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.003, 0.008])
def test_a_killed_run_leaves_a_checkpoint_that_is_whole(tmp_path, delay):
    path = tmp_path / "flag.npz"
    code = ENDLESS.format(path=[os.path.dirname(os.path.abspath(__file__)), *sys.path], file=str(path))
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    for _ in range(5):
        done = int(child.stdout.readline())
    time.sleep(delay)
    child.send_signal(signal.SIGKILL)
    child.wait()
    about, arrays, ledger = load(path, body())
    assert about["step"] >= done and (arrays["u"] == about["step"]).all()
    np.testing.assert_array_equal(ledger["A x"], 2.0 * np.arange(about["step"]))
