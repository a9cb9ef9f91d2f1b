import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET

import meshio
import numpy as np
import pytest
from bodies import MESHES, state
from slow import slow

from skfem_stvk import Gravity, StVK, StvkError, StvkWarning, System, VelocityVerlet, simulate, solve_static
from skfem_stvk.results import Fields, Series
from skfem_stvk.results.complete_files import WriteError
from skfem_stvk.results.series import save_series

MESH = MESHES["triangles"]
FIELDS = Fields(MESH, StVK(young=2.0, poisson=0.3))


def at(factor):
    return FIELDS.at(factor * state(MESH, 0.03))


def listed(path):
    """Return (t, largest displacement) of each step, read from the files."""
    steps = []
    for item in ET.parse(path).iter("DataSet"):
        file = meshio.read(path.parent / item.attrib["file"])
        steps.append((float(item.attrib["timestep"]), np.abs(file.point_data["displacement"]).max()))
    return steps


def run(path, times, **options):
    series = Series(path, ["cauchy"], **options)
    for t in times:
        series.add(at(t), t)
    return series


def expected(times):
    size = np.abs(state(MESH, 0.03)).max()
    return [(t, pytest.approx(t * size, rel=1e-12)) for t in times]


def names(folder):
    return sorted(file.name for file in folder.iterdir())


def test_after_each_step_the_series_is_complete(tmp_path):
    path = tmp_path / "flag.pvd"
    series = Series(path)
    for number, t in enumerate((0.1, 0.3, 1.0)):
        assert series.add(at(t), t).name == f"flag_{number:04d}.vtu"
        assert listed(path) == expected((0.1, 0.3, 1.0)[: number + 1])


def test_a_new_run_replaces_a_longer_one_and_does_not_touch_other_files(tmp_path):
    path = tmp_path / "flag.pvd"
    run(path, (0.1, 0.2, 0.3, 0.4))
    (tmp_path / "flag_9999.vtu").write_text("somebody else's")
    series = Series(path)
    assert len(listed(path)) == 4  # nothing is touched before the first step
    series.add(at(0.5), 0.5)
    series.add(at(1.0), 1.0)
    assert listed(path) == expected((0.5, 1.0))
    assert names(tmp_path) == ["flag.pvd", "flag_0000.vtu", "flag_0001.vtu", "flag_9999.vtu"]


def test_a_resumed_run_retains_the_steps_before_its_first(tmp_path):
    path = tmp_path / "flag.pvd"
    run(path, (0.1, 0.2, 0.3, 0.4))
    run(path, (0.3, 0.35), resume=True)
    assert listed(path) == expected((0.1, 0.2, 0.3, 0.35))
    run(path, (0.15,), resume=True)
    assert listed(path) == expected((0.1, 0.15))
    assert names(tmp_path) == ["flag.pvd", "flag_0000.vtu", "flag_0001.vtu"]
    run(tmp_path / "other.pvd", (0.1,), resume=True)  # no series exists yet
    assert listed(tmp_path / "other.pvd") == expected((0.1,))


def test_a_list_never_names_files_that_are_being_replaced(tmp_path, monkeypatch):
    def killed(path, *_):
        names = [item.attrib["file"] for item in ET.parse(pvd).iter("DataSet")] if pvd.exists() else []
        assert path.name not in names and all((tmp_path / name).exists() for name in names)
        raise KeyboardInterrupt

    for resume in (False, True):
        pvd = tmp_path / "flag.pvd"
        run(pvd, (0.1, 0.2, 0.3))
        monkeypatch.setattr("skfem_stvk.results.series.write_vtu", killed)
        with pytest.raises(KeyboardInterrupt):
            run(pvd, (0.2,), resume=resume)
        monkeypatch.undo()
        assert not resume or listed(pvd) == expected((0.1,))


def test_files_that_a_list_names_elsewhere_are_never_removed(tmp_path):
    precious = tmp_path / "precious.vtu"
    precious.write_text("data")
    path = tmp_path / "flag.pvd"
    path.write_text(
        '<VTKFile><Collection><DataSet timestep="0" file="precious.vtu"/>'
        '<DataSet timestep="0" file="../x.vtu"/></Collection></VTKFile>'
    )
    run(path, (0.1,))
    assert precious.read_text() == "data" and listed(path) == expected((0.1,))


def test_a_damaged_list_is_replaced_but_not_resumed(tmp_path):
    path = tmp_path / "flag.pvd"
    path.write_text("<VTKFile><Coll")
    with pytest.raises(StvkError, match=r"flag\.pvd cannot be resumed as a series"):
        Series(path, resume=True)
    run(path, (0.1,))
    assert listed(path) == expected((0.1,))


def test_bad_paths_fields_and_times_are_refused(tmp_path):
    with pytest.raises(StvkError, match=r"expected a path that ends in .pvd"):
        Series(tmp_path / "flag.vtu")
    with pytest.raises(StvkError, match="no field 'sigma'"):
        Series(tmp_path / "flag.pvd", ["sigma"])
    with pytest.raises(StvkError, match="t = nan; expected a finite load factor or time"):
        Series(tmp_path / "flag.pvd").add(at(1), np.nan)


ENDLESS = """
import sys
sys.path[:0] = {path!r}
from test_series import Series, at
series = Series({file!r})
t = 0.0
while True:
    t += 0.001
    series.add(at(t), t)
    print(t, flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")
@pytest.mark.parametrize("delay", [slow(0.0), 0.003, 0.011, slow(0.02)])
def test_a_killed_run_leaves_a_series_that_opens(tmp_path, delay):
    path = tmp_path / "flag.pvd"
    run(path, np.arange(1, 30) / 100)  # an older and longer run
    code = ENDLESS.format(path=sys.path, file=str(path))
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    for _ in range(5):
        done = float(child.stdout.readline())
    time.sleep(delay)
    child.send_signal(signal.SIGKILL)
    child.wait()
    steps = listed(path)
    assert len(steps) >= round(done / 0.001)
    assert steps == expected([t for t, _ in steps]) and np.allclose(np.diff([t for t, _ in steps]), 0.001)
    run(path, (0.5,))  # partial files do not prevent a new run
    assert listed(path) == expected((0.5,))


def test_a_series_can_be_truncated(tmp_path):
    path = tmp_path / "flag.pvd"
    series = run(path, (0.1, 0.2, 0.3, 0.4))
    series.cut(0.3)
    assert listed(path) == expected((0.1, 0.2)) and len(names(tmp_path)) == 3
    series.add(at(0.25), 0.25)
    assert listed(path) == expected((0.1, 0.2, 0.25)) and names(tmp_path)[-1] == "flag_0002.vtu"
    resumed = Series(path, resume=True)
    resumed.cut(0.1)
    assert listed(path) == expected((0.1, 0.2, 0.25))
    resumed.add(at(0.2), 0.2)
    assert listed(path) == expected((0.1, 0.2))
    resumed.cut(0.0)
    assert names(tmp_path) == []


@pytest.mark.parametrize("number", [1, 3, 5, 2, 6, 99])
def test_a_series_saved_at_once_is_written_completely_or_not_at_all(tmp_path, monkeypatch, number):
    """A full disk at any file of a series leaves the older series unchanged, and no partial files."""
    path = tmp_path / "flag.pvd"
    run(path, (0.1, 0.2, 0.3))
    before, calls, fsync = {file: file.read_bytes() for file in tmp_path.iterdir()}, [], os.fsync

    def full(descriptor):
        calls.append(descriptor)
        if len(calls) == number:
            raise OSError(28, "No space left on device")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    states = [(t, at(t)) for t in (0.5, 1.0)]
    if number in (1, 3, 5):  # the files and the list; other numbers are folders, and some disks cannot sync these
        with pytest.raises(
            WriteError,
            match=r"flag\.pvd could not be written: No space left on device\. Its previous content is unchanged. Free disk space",
        ):
            save_series(path, ["cauchy"], states)
        assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before
    else:
        assert save_series(path, ["cauchy"], states) == path
        assert listed(path) == expected((0.5, 1.0)) and names(tmp_path) == ["flag.pvd", "flag_0000.vtu", "flag_0001.vtu"]


def test_removed_files_of_a_series_are_skipped_with_a_warning_on_resume(tmp_path):
    path = tmp_path / "flag.pvd"
    run(path, (0.1, 0.2, 0.3))
    (tmp_path / "flag_0001.vtu").unlink()
    with pytest.warns(StvkWarning, match=r"lists 1 missing files, the first of them flag_0001\.vtu"):
        run(path, (0.4,), resume=True)
    assert listed(path) == expected((0.1, 0.3, 0.4))


def test_a_second_writer_of_a_series_is_refused(tmp_path):
    path = tmp_path / "flag.pvd"
    with Series(path) as series:
        series.add(at(0.1), 0.1)
        for refused in (lambda: run(path, (0.5,)), lambda: save_series(path, ["cauchy"], []), lambda: Series(path).__enter__()):
            with pytest.raises(StvkError, match=r"flag\.pvd is being written by another run in this process"):
                refused()
        series.add(at(0.2), 0.2)
    assert listed(path) == expected((0.1, 0.2))


def test_analyses_write_the_named_fields(tmp_path):
    held = {lambda x: x[0] < x[0].mean() - 0.3 * np.ptp(x[0]): "xy"}
    body = System(MESH, [StVK(young=2.0, poisson=0.3, density=1.0), Gravity(g=(0.0, -1e-3))], fixed=held)
    solve_static(body, save=tmp_path / "path.pvd", fields=["volume_ratio"], quiet=True)
    simulate(body, VelocityVerlet(), until=0.01, save=tmp_path / "motion.pvd", fields=["volume_ratio"], quiet=True)
    for name, vectors in (("path", {"displacement"}), ("motion", {"displacement", "velocity"})):
        file = meshio.read(tmp_path / f"{name}_0000.vtu")
        assert vectors <= set(file.point_data) and "volume_ratio" in file.cell_data and "von_mises_stress" not in file.cell_data
    with pytest.raises(StvkError, match="'volume'"):
        solve_static(body, save=tmp_path / "other.pvd", fields=["volume"], quiet=True)


def test_a_series_is_not_written_through_symbolic_links(tmp_path):
    mine, files = tmp_path / "mine", ["film.pvd", "film_0000.vtu", ".film.pvd.part", ".film_0001.vtu.part", ".film.pvd.writer"]
    mine.mkdir()
    (mine / "0000.vtu").write_text("mine")
    (tmp_path / ".film.part").symlink_to(mine)
    for name in files:
        (mine / name).write_text("mine")
        (tmp_path / name).symlink_to(mine / name)
    run(tmp_path / "film.pvd", (0.1, 0.2), overwrite=True)
    assert save_series(tmp_path / "film.pvd", ["cauchy"], [(t, at(t)) for t in (0.1, 0.2)]).is_file()
    assert listed(tmp_path / "film.pvd") == expected((0.1, 0.2))
    assert {file.read_text() for file in mine.iterdir()} == {"mine"} and len(names(mine)) == 6
