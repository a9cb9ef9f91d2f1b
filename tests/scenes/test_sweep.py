"""A sweep gives each run its folder and its row, although runs fail, crash, are killed or are interrupted."""

import csv
import json
import os
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes.test_solved_scenes import wait_for

from skfem_stvk import SceneError, StvkError
from skfem_stvk.results import matplotlib_plot
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes.scene import Scene
from skfem_stvk.scenes.sweep import SweepRow, _plot, planned, sweep

BEAM = """
[mesh]
type = "box"
size = [2.0, 1.0]
cells = [4, 2]
[materials.rubber]
model = "isotropic"
young = 1e6
poisson = 0.3
density = 1000
[[terms]]
type = "stvk"
material = "rubber"
[fixed]
left = "xy"
[output]
picture = ""
probes = { tip = "right" }
"""
STATIC = """
[[terms]]
type = "traction"
on = "right"
traction = [0, -1e3]
[analysis]
type = "static"
"""
MOTION = """
[initial]
velocity = [0, 0.5]
[analysis]
type = "dynamic"
dt = 0.0005
until = 0.01
"""
YOUNG = "materials.rubber.young"


def scene(folder, *parts):
    path = folder / "beam.toml"
    path.write_text("".join([BEAM, *parts]))
    return path


def table(folder):
    with (folder / "table.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def without_seconds(rows):
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Run a sweep in which one run does not converge, some are refused, and one does not meet its expectation."""
    path = scene(tmp_path_factory.mktemp("swept"), STATIC, "[expect]\ntip.y = { value = -0.02, atol = 0.01 }\n")
    settings = [f"{YOUNG}=1e6,1e3,4e6", "fixed={left='xy'},{hole='xy'}"]
    code = main(["sweep", str(path), "--set", settings[0], "--set", settings[1], "--jobs", "1", "--quiet"])
    return path, settings, code


def test_a_sweep_is_the_product_of_its_values_and_each_run_equals_a_single_run(swept):
    path, _, code = swept
    rows = table(path.parent / "beam-sweep")
    assert code == 1
    assert [(row[YOUNG], row["fixed"]) for row in rows] == [
        (young, fixed) for young in ("1000000.0", "1000.0", "4000000.0") for fixed in ('{"left": "xy"}', '{"hole": "xy"}')
    ]
    alone = Scene.read(path, [f"{YOUNG}=1e6"]).solve(quiet=True)
    assert float(rows[0]["tip.y"]) == alone.values["tip.y"] != 0
    assert {row["folder"] for row in rows} <= {one.name for one in (path.parent / "beam-sweep").iterdir()} | {
        row["folder"] for row in rows if row["exit_code"] == "2"
    }
    assert rows[0]["folder"] == "young=1e6,fixed=left_xy"


def test_a_quiet_sweep_prints_the_errors_of_failed_runs_alone(tmp_path, capsys):
    path = scene(tmp_path, STATIC)
    capsys.readouterr()
    command = ["sweep", str(path), "--set", "fixed={left='xy'},{hole='xy'}", "--jobs", "1", "--quiet"]
    for _ in range(2):  # computed, then read from the folder of the sweep
        assert main(command) == 1
        printed = capsys.readouterr()
        assert not printed.out and printed.err.count("error") == 1
        assert "fixed=hole_xy: " in printed.err and "'hole'" in printed.err


def test_a_failed_run_has_its_message_in_the_table_and_other_runs_continue(swept):
    rows = table(swept[0].parent / "beam-sweep")
    assert [row["exit_code"] for row in rows] == ["0", "2", "1", "2", "3", "2"]
    assert rows[0]["message"] == ""
    assert "hole" in rows[1]["message"] and rows[1]["status"] == "refused"
    assert rows[2]["status"] != "converged" and rows[2]["message"] and 0 <= float(rows[2]["load"]) < 1
    assert rows[4]["message"].startswith("tip.y = -0.0") and rows[4]["message"].endswith("expected -0.02")


@pytest.mark.slow
def test_the_table_is_the_same_with_two_jobs(swept, tmp_path):
    path, settings, _ = swept
    rows = sweep(path, settings, tmp_path / "two", jobs=2, quiet=True)
    assert without_seconds(table(tmp_path / "two")) == without_seconds(table(path.parent / "beam-sweep"))
    assert [row.done for row in rows] == [True, False, False, False, False, False]
    assert rows[0].results["tip.y"] == float(table(tmp_path / "two")[0]["tip.y"])


@pytest.mark.slow
def test_a_second_call_solves_only_missing_runs(tmp_path, capsys):
    path, out = scene(tmp_path, STATIC), tmp_path / "beam-sweep"
    sweep(path, {YOUNG: [1e6, 2e6]}, jobs=1, quiet=True)
    before = {one: one.read_bytes() for one in out.glob("*/summary.json")}
    shutil.rmtree(out / "young=2e6")
    assert main(["sweep", str(path), "--set", f"{YOUNG}=1e6,2e6,3.5e6", "--jobs", "1"]) == 0
    out_text = capsys.readouterr().out
    assert "3 runs, 1 of them already done" in out_text
    assert "[2/3] young=2e6: converged" in out_text and "[3/3] young=3.5e6" in out_text
    assert (out / "young=1e6" / "summary.json").read_bytes() == before[out / "young=1e6" / "summary.json"]
    assert (out / "young=2e6" / "summary.json").read_bytes() != before[out / "young=2e6" / "summary.json"]
    assert [float(row[YOUNG]) for row in table(out)] == [1e6, 2e6, 3.5e6]
    tips = [float(row["tip.y"]) for row in table(out)]
    assert tips[0] < tips[1] < tips[2] < 0


@pytest.mark.slow
def test_runs_of_another_scene_are_replaced_only_by_force(tmp_path, capsys):
    path, out = scene(tmp_path, STATIC), tmp_path / "beam-sweep"
    (before,) = sweep(path, {YOUNG: [1e6]}, jobs=1, quiet=True)
    path.write_text(path.read_text().replace("-1e3", "-2e3"))
    assert main(["sweep", str(path), "--set", f"{YOUNG}=1e6"]) == 2
    assert "young=1e6 has other files, or results of another scene" in " ".join(capsys.readouterr().err.split())
    assert table(out)[0]["tip.y"] == repr(before.results["tip.y"])
    (after,) = sweep(path, {YOUNG: [1e6]}, jobs=1, quiet=True, force=True)
    assert after.results["tip.y"] == pytest.approx(2 * before.results["tip.y"], rel=0.05)


@pytest.mark.slow
def test_failed_runs_are_solved_again_by_force(tmp_path):
    """A run that does not meet its expectation is solved again only by force; a successful run is never solved again."""
    path, out = scene(tmp_path, STATIC, "[expect]\ntip.y = { value = -0.02, atol = 0.01 }\n"), tmp_path / "beam-sweep"
    values = {YOUNG: [1e6, 4e6]}
    before = sweep(path, values, jobs=1, quiet=True)
    assert [row.exit_code for row in before] == [0, 3]
    stamps = [(out / row.folder.name / "summary.json").stat().st_mtime_ns for row in before]

    def changed():
        return [(out / row.folder.name / "summary.json").stat().st_mtime_ns for row in before] != stamps

    sweep(path, values, jobs=1, quiet=True)
    assert not changed()
    again = sweep(path, values, jobs=1, quiet=True, force=True)
    assert changed() and [row.exit_code for row in again] == [0, 3]
    assert (out / before[0].folder.name / "summary.json").stat().st_mtime_ns == stamps[0]


def test_implausible_values_are_reported_once(tmp_path, capsys):
    path = scene(tmp_path, STATIC)
    sweep(path, {"materials.rubber.young": [1e6, 10.0]}, jobs=1)
    printed = capsys.readouterr().out
    assert printed.count("note materials.rubber.young = 10 Pa is unusual") == 1 and "(in 1 of 2 runs)" in printed


def test_a_folder_with_other_files_is_refused(tmp_path):
    path = scene(tmp_path, STATIC)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    with pytest.raises(StvkError, match=r"such as thesis\.tex"):
        sweep(path, {YOUNG: [1e6]}, tmp_path / "mine")
    (tmp_path / "mine" / "table.csv").write_text("a,b\n1,2\n")
    with pytest.raises(StvkError, match=r"not the table of a sweep"):
        sweep(path, {YOUNG: [1e6]}, tmp_path / "mine")
    assert (tmp_path / "mine" / "table.csv").read_text() == "a,b\n1,2\n"
    with pytest.raises(StvkError, match="it is a file"):
        sweep(path, {YOUNG: [1e6]}, path)


def test_a_product_of_too_many_runs_is_refused_quickly(tmp_path):
    many = list(range(1, 1001))
    with pytest.raises(SceneError, match=r"has 1000000000 runs; expected at most 10000\. Give fewer values"):
        sweep(scene(tmp_path, STATIC), {"analysis.steps": many, "threads": many, YOUNG: many}, quiet=True)


@pytest.mark.parametrize("content", [b"\xff\xfe\0", b"a,\0\n", 200_000 * b"x", b"", "pipe"])
def test_the_table_of_another_program_is_refused(content, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    os.mkfifo(out / "table.csv") if content == "pipe" else (out / "table.csv").write_bytes(content)
    with pytest.raises((StvkError, OSError), match=r"its table\.csv is not the table of a sweep|not a regular file"):
        sweep(scene(tmp_path, STATIC), {YOUNG: [1e6, 2e6]}, out, quiet=True)


@pytest.mark.parametrize(
    "change",
    [
        {"results": {"tip.y": [1]}},
        *(
            pytest.param(change, marks=pytest.mark.slow)
            for change in ({"results": 3}, {"exit_code": 3, "expectations": [{}]}, {"seconds": "x"})
        ),
    ],
)
def test_a_run_with_a_damaged_summary_does_not_count_as_finished(change, tmp_path):
    path, out = scene(tmp_path, STATIC), tmp_path / "beam-sweep"
    sweep(path, {YOUNG: [1e6, 2e6]}, jobs=1, quiet=True)
    summary = out / "young=2e6" / "summary.json"
    summary.write_text(json.dumps(json.loads(summary.read_text()) | change))
    with pytest.raises(StvkError, match=r"young=2e6 has other files, or results of another scene.* --force replaces them"):
        sweep(path, {YOUNG: [1e6, 2e6]}, jobs=1, quiet=True)
    assert [row.done for row in sweep(path, {YOUNG: [1e6, 2e6]}, jobs=1, quiet=True, force=True)] == [True, True]


def test_all_values_are_checked_before_anything_runs(tmp_path):
    path = scene(tmp_path, STATIC)
    with pytest.raises(SceneError) as caught:
        sweep(path, [f"{YOUNG}=1e6,-1", "analysis.steps=2,0", "analysis.stpes=3"])
    message = str(caught.value)
    assert "young, from --set materials.rubber.young=-1: " in message and "(in 2 of 4 runs)" in message
    assert "steps, from --set analysis.steps=0: " in message and "did you mean 'steps'?" in message
    assert len(caught.value.complaints) == 3 and not (tmp_path / "beam-sweep").exists()


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ([], "A sweep needs values"),
        (["analysis.steps"], "expected KEY=VALUE"),
        (["analysis.steps=1,,2"], "without empty values"),
        (["analysis.steps=1,2", "analysis.steps=3"], "set twice"),
        (["analysis.steps=[1,2"], "is not valid"),
        ([f"{YOUNG}=1e6,1.0e6"], r"runs .*young=1e6'.* and .*young=1.0e6'.* are the same scene; give each value once"),
        ([f"{YOUNG}=1e5,2e5,1e5"], "are the same scene; give each value once"),
        ({YOUNG: [1e5, 1e5]}, "are the same scene"),
        ({YOUNG: 1e6}, "expected a list of values"),
        ({YOUNG: "1e6,2e6"}, "expected a list of values"),
        ({YOUNG: []}, "expected a list of values"),
        ({YOUNG: [object()]}, "as in TOML"),
    ],
)
def test_illegal_values_of_a_sweep_are_refused(tmp_path, settings, match):
    with pytest.raises(StvkError, match=match):
        sweep(scene(tmp_path, STATIC), settings)


def test_values_in_python_equal_values_on_the_command_line(tmp_path):
    path = scene(tmp_path, STATIC)
    forces = [[0, -1e3], [0.0, -2e3]]
    first = sweep(path, {"terms[1].traction": forces, "title": ["a, 'b'"], YOUNG: np.array([2.5e5])}, jobs=1, quiet=True)
    again = sweep(path, ["terms[1].traction=[0,-1e3],[0.0, -2e3]", "title=\"a, 'b'\"", f"{YOUNG}=2.5e5"], quiet=True)
    assert again == first and [row.folder.name for row in first] == [f"traction=0_-{n}000,title=a_b_,young=250000" for n in (1, 2)]


def test_names_of_folders_are_unique_for_all_values(tmp_path):
    path = scene(tmp_path, STATIC)
    probes = ["Ä/..", "Ö/..", "a", "A", "long" * 25, "CON", ".."]
    axes, runs = planned(path, {"output.probes.tip": probes, "units": ["SI"], YOUNG: [1e6]})
    names = [run.name for run in runs]
    assert len({name.lower() for name in names}) == len(probes) == len(axes[0].values)
    assert all(len(name) <= 120 and not set(name) & set(' /\\:*?"<>|') and name.startswith("tip=") for name in names)


def test_a_plot_is_drawn_only_for_several_values(tmp_path):
    path = scene(tmp_path, STATIC)
    plot = tmp_path / "beam-sweep" / "sweep.png"
    sweep(path, {YOUNG: [1e6, 2e6]}, jobs=1, quiet=True)
    assert plot.read_bytes().startswith(b"\x89PNG")
    sweep(path, {YOUNG: [1e6]}, jobs=1, quiet=True)
    assert not plot.exists()


def test_lines_of_a_plot_are_in_the_order_of_the_values(tmp_path, monkeypatch):
    """Runs end in any order. The legend has the order of the command, and each line that of its axis."""
    axes, runs = planned(scene(tmp_path, STATIC), {"analysis.steps": [1, 2], YOUNG: [1e6, 1e7, 1e8]})
    axis, others = axes[0], axes[1:]
    values = [(steps, young) for young in (1e7, 1e8, 1e6) for steps in (2, 1)]
    rows = [
        SweepRow({axis.path: steps, others[0].path: young}, tmp_path, "converged", 0, results={"x": steps * young, "same": 1.0})
        for steps, young in values
    ]
    figures = []
    monkeypatch.setattr(matplotlib_plot, "new_figure", lambda *given, **more: figures.append(Figure(*given)) or figures[0])
    _plot(tmp_path, axes, rows, runs[0].scene.sections)
    (panel,) = figures[0].axes
    assert [line.get_label() for line in panel.lines] == ["young = 1e6", "young = 1e7", "young = 1e8"]
    assert [list(line.get_xdata()) for line in panel.lines] == [[1, 2]] * 3


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)])
def test_an_interrupted_or_killed_sweep_is_continued_by_the_next_call(tmp_path, how, started):
    """The next call completes the sweep and gives the same results; the interrupted run is resumed from its checkpoint."""
    path, out = scene(tmp_path, MOTION), tmp_path / "beam-sweep"
    path.write_text(path.read_text().replace("[output]\n", '[output]\nfile = "beam.pvd"\n'))
    until = "analysis.until=0.01,0.3,0.02"
    process = started("sweep", path, "--set", until, "--jobs", "1")
    wait_for(lambda: (out / "until=0.3" / "beam_0004.vtu").exists(), process)
    os.killpg(process.pid, how)
    printed, err = process.communicate(timeout=300)
    rows = table(out)
    assert [float(row["analysis.until"]) for row in rows] == [0.01, 0.3][: 2 if how == signal.SIGINT else 1]
    if how == signal.SIGINT:
        assert process.returncode == 130 and "2 of 3 runs" in printed and "Traceback" not in err
        assert rows[1]["exit_code"] == "130" and 0 < float(rows[1]["time"]) < 0.3
    summary = json.loads((out / "until=0.3" / "summary.json").read_text())
    assert summary["status"] == ("interrupted" if how == signal.SIGINT else "was killed or is running")
    first = (out / "until=0.01" / "summary.json").read_bytes()
    before = (out / "until=0.3" / "beam_0001.vtu").stat().st_mtime_ns
    rows = sweep(path, [until], jobs=1, quiet=True)
    assert (out / "until=0.01" / "summary.json").read_bytes() == first
    if how == signal.SIGINT:  # a killed run resumes from an older checkpoint and may write the state again
        assert (out / "until=0.3" / "beam_0001.vtu").stat().st_mtime_ns == before
    assert [row.exit_code for row in rows] == [0, 0, 0]
    assert rows[1].results == Scene.read(path, ["analysis.until=0.3"]).solve(quiet=True).values


def test_child_processes_end_with_their_parent(tmp_path, started):
    path, states = scene(tmp_path, MOTION), tmp_path / "beam-sweep" / "until=100"
    path.write_text(path.read_text().replace("[output]\n", '[output]\nfile = "beam.pvd"\n'))
    process = started("sweep", path, "--set", "analysis.until=100.0", "--jobs", "1")
    wait_for((states / "beam_0001.vtu").exists, process)
    process.kill()
    process.wait()
    counts = [0, 1]
    while counts[-1] != counts[-2] and len(counts) < 40:  # on a busy machine a child needs some seconds to notice
        time.sleep(1.5)
        counts.append(len(list(states.glob("*.vtu"))))
    assert counts[-1] == counts[-2]


@pytest.mark.slow
def test_a_crashed_process_does_not_end_other_runs(tmp_path, started):
    """A worker that is killed, as by a system without memory, has the status "crashed", and the other runs succeed."""
    path, out = scene(tmp_path, MOTION), tmp_path / "beam-sweep"
    path.write_text(path.read_text().replace("[output]\n", '[output]\nfile = "beam.pvd"\n'))
    process = started("sweep", path, "--set", "analysis.until=0.01,100.0,0.02", "--jobs", "1")
    wait_for((out / "until=100" / "beam_0001.vtu").exists, process)
    children = subprocess.run(["ps", "-ww", "-o", "pid=,args=", "--ppid", str(process.pid)], capture_output=True, text=True).stdout
    workers = [int(line.split()[0]) for line in children.splitlines() if "spawn_main" in line]
    assert workers, children
    for worker in workers:
        os.kill(worker, signal.SIGKILL)
    printed, err = process.communicate(timeout=300)
    rows = table(out)
    assert process.returncode == 1 and "Traceback" not in err, printed + err
    assert [row["exit_code"] for row in rows] == ["0", "", "0"]
    assert rows[1]["status"] == "crashed" and "--set 'analysis.until=100.0'" in rows[1]["message"]


def test_an_undefined_energy_has_an_empty_cell(tmp_path):
    path = scene(tmp_path, STATIC)
    path.write_text(path.read_text().replace('"stvk"', '"corotated"'))
    code = main(["sweep", str(path), "--set", 'terms[0].rotation="element","vertex"', "--jobs", "1", "--quiet"])
    (own, at_vertices) = table(tmp_path / "beam-sweep")
    assert code == 0 and float(own["energy.strain"]) > 0 and at_vertices["energy.strain"] == ""
