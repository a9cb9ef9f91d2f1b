"""An analysis does not depend on whether its text can be printed: the disk may be full, and the pipe closed."""

import json
import os
import subprocess
import sys

import pytest
from scenes.test_sweep import BEAM

from skfem_stvk import terminal

SCENE = f"""{BEAM}
[[terms]]
type = "gravity"
g = [0.0, -9.81]
"""
ANALYSES = {
    "static": '[analysis]\ntype = "static"\nsteps = 4\n',
    "dynamic": '[analysis]\ntype = "dynamic"\ndt = 1e-3\nuntil = 5e-3\n',
}
SCRIPT = """
import skfem
from skfem_stvk import EnergyMomentum, Gravity, StVK, System, simulate, solve_static
from skfem_stvk.terminal import note
law = StVK(young=1e5, poisson=0.3, density=1e3)
body = System(skfem.MeshTri().refined(1), [law, Gravity((0, -1))], {lambda x: x[0] == 0: "xy"})
note("compiling kernels")
solve_static(body)
run = simulate(body, EnergyMomentum(dt=1e-3), until=3e-3)
open("ended", "w").write(str(run.t))
"""


def broken_pipe():
    """Return the writing end of a pipe whose reader has gone, as `| head -1` leaves it."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


def full():
    if not os.path.exists("/dev/full"):
        pytest.skip("there is no device that is full")
    return os.open("/dev/full", os.O_WRONLY)


SINKS = {"full disk": full, "closed pipe": broken_pipe}


def ran(arguments, folder, **streams):
    """Return the finished process of Python with these arguments and streams."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | streams
    return subprocess.run([sys.executable, *arguments], cwd=folder, text=True, timeout=300, **options)


def without_notes(text):
    """Return the lines without those on the compilation of kernels."""
    return [line for line in text.splitlines() if not line.startswith("skfem_stvk: ")]


@pytest.mark.few(2)
@pytest.mark.parametrize("streams", [("stdout",), ("stdout", "stderr")], ids="+".join)
@pytest.mark.parametrize("sink", SINKS)
@pytest.mark.parametrize("analysis", ANALYSES)
def test_a_run_goes_on_and_keeps_its_results_if_it_cannot_print(analysis, sink, streams, tmp_path):
    (tmp_path / "body.toml").write_text(SCENE + ANALYSES[analysis])
    done = ran(["-m", "skfem_stvk.scenes.commands", "solve", "body.toml"], tmp_path, **{name: SINKS[sink]() for name in streams})
    summary = json.loads((tmp_path / "body" / "summary.json").read_text())
    assert (done.returncode, summary["exit_code"]) == (0, 0) and summary["status"] in ("converged", "finished")
    assert {"resolved.toml", "report.html", "checkpoint"} <= {file.name for file in (tmp_path / "body").iterdir()}
    assert "stderr" in streams or without_notes(done.stderr) == []


@pytest.mark.slow
@pytest.mark.parametrize("sink", SINKS)
def test_a_sweep_goes_on_if_it_cannot_print(sink, tmp_path):
    (tmp_path / "body.toml").write_text(SCENE + ANALYSES["static"])
    command = ["-m", "skfem_stvk.scenes.commands", "sweep", "body.toml", "--set", "materials.rubber.young=1e6,2e6", "--jobs", "1"]
    done = ran(command, tmp_path, stdout=SINKS[sink]())
    assert (done.returncode, without_notes(done.stderr)) == (0, [])
    assert (tmp_path / "body-sweep" / "table.csv").read_text().count("converged") == 2


@pytest.mark.few(1)
@pytest.mark.parametrize("sink", SINKS)
def test_bad_input_remains_an_error_if_it_cannot_be_printed(sink, tmp_path):
    (tmp_path / "body.toml").write_text(SCENE)
    done = ran(["-m", "skfem_stvk.scenes.commands", "solve", "body.toml"], tmp_path, stdout=SINKS[sink](), stderr=SINKS[sink]())
    assert done.returncode == 2


def test_a_text_that_is_the_result_of_a_command_is_not_lost_in_silence(tmp_path):
    assert ran(["-m", "skfem_stvk.scenes.commands", "init", "--type", "static"], tmp_path, stdout=full()).returncode != 0


@pytest.mark.few(1)
@pytest.mark.parametrize("sink", SINKS)
def test_an_analysis_in_python_goes_on_if_it_cannot_print(sink, tmp_path):
    ran(["-c", SCRIPT], tmp_path, stdout=SINKS[sink](), stderr=SINKS[sink]())
    assert float((tmp_path / "ended").read_text()) == pytest.approx(3e-3)


def test_text_that_can_be_printed_is_printed_and_the_streams_are_given_back(tmp_path):
    code = "import sys\nfrom skfem_stvk.terminal import note, say, unfailing_output\nbefore = sys.stdout, sys.stderr\n"
    code += "with unfailing_output():\n    say('ä \\udcff', False)\n    note('what')\n    assert sys.stdout is not before[0]\n"
    code += "assert (sys.stdout, sys.stderr) == before\nprint('end')\n"
    done = ran(["-c", code], tmp_path)
    assert done.returncode == 0 and done.stdout == "ä \\udcff\nend\n" and done.stderr == "skfem_stvk: what\n"


def test_streams_in_memory_and_closed_streams_are_left_alone(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stderr", None)
    stdout = sys.stdout
    with terminal.unfailing_output():
        assert sys.stdout is stdout and sys.stderr is None
        terminal.say("line", False)
    assert capsys.readouterr().out == "line\n"
