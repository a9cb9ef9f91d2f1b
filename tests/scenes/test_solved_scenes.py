"""Solved scenes give the results of the same program, survive interruptions, and return the documented exit codes."""

import cProfile
import json
import os
import pstats
import re
import resource
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import skfem

from skfem_stvk import (
    EnergyMomentum,
    Gravity,
    SceneError,
    StVK,
    StvkError,
    StvkWarning,
    System,
    Traction,
    modes,
    simulate,
    solve_static,
)
from skfem_stvk.errors import AnalysisError
from skfem_stvk.mesh import ElementMesh, box
from skfem_stvk.results.complete_files import OneWriter
from skfem_stvk.results.vtu import read_vtu, write_mesh
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.scenes.folder import Folder
from skfem_stvk.scenes.scene import Scene
from skfem_stvk.scenes.sweep import _solve, _start, planned

BEAM = """
[mesh]
type = "box"
size = [4.0, 1.0, 1.0]
cells = [8, 2, 2]
[materials.rubber]
model = "isotropic"
young = 1e6
poisson = 0.45
density = 1100
[[terms]]
type = "stvk"
material = "rubber"
[fixed]
left = "xyz"
"""
STATIC = """
[[terms]]
type = "traction"
on = "right"
traction = [0, 0, -2e3]
[analysis]
type = "static"
steps = 4
"""
MOTION = """
[[terms]]
type = "gravity"
g = [0, 0, -9.81]
[initial]
velocity = [0, 0.5, 0]
[analysis]
type = "dynamic"
dt = 0.01
until = 0.2
"""
MODES = """
[analysis]
type = "modes"
n = 4
"""
FOLLOWED = """
[output]
file = "beam.pvd"
every = 3
probes = { tip = "right" }
reactions = { wall = "left" }
"""


def scene(folder, *parts, name="beam.toml"):
    path = folder / name
    path.write_text("".join([BEAM, *parts]))
    return path


def body(*loads):
    axes = np.linspace(0, 4, 9), np.linspace(0, 1, 3), np.linspace(0, 1, 3)
    mesh = skfem.MeshTet.init_tensor(*axes).with_defaults()
    return System(mesh, [StVK(young=1e6, poisson=0.45, density=1100.0), *loads], fixed={"left": "xyz"})


def test_a_static_scene_equals_the_program_bit_for_bit(tmp_path):
    outcome = Scene.read(scene(tmp_path, STATIC, FOLLOWED)).solve(quiet=True)
    result = solve_static(body(Traction("right", (0, 0, -2e3))), steps=4, quiet=True)
    assert outcome.success and outcome.exit_code == 0
    assert outcome.result.u.tobytes() == result.u.tobytes()
    assert outcome.values["wall.z"] == result.reaction("left").resultant[2]
    assert outcome.curves["tip"].values.shape == (len(result.history), 3)
    assert outcome.values["tip.z"] < -0.1


def test_a_motion_equals_the_program_bit_for_bit(tmp_path):
    outcome = Scene.read(scene(tmp_path, MOTION, FOLLOWED)).solve(quiet=True)
    system = body(Gravity(g=(0, 0, -9.81)))
    v0 = np.tile([0, 0.5, 0], system.mesh.nv)
    v0[system.supports.held] = 0
    run = simulate(
        system, EnergyMomentum(dt=0.01), until=0.2, v0=v0, probes={"tip": "right"}, reactions={"wall": "left"}, quiet=True
    )
    assert outcome.result.u.tobytes() == run.u.tobytes() and outcome.result.v.tobytes() == run.v.tobytes()
    assert outcome.values["tip.y"] == run.ledger["tip y"][-1]
    assert outcome.curves["wall"].values[:, 2].tobytes() == run.ledger["reaction wall z"].tobytes()


SHARING = """
[places]
side = { type = "plane", point = [0, 0, 0], normal = [0, 1, 0] }
below = { type = "box", low = [0, 0, 0], high = [4, 1, 0] }
ends = { type = "nodes", ids = [0, 1, 2] }
[output.reactions]
a = "left"
b = "side"
c = "below"
d = "ends"
every = { type = "box", low = [0, 0, 0], high = [4, 1, 1] }
"""


@pytest.mark.parametrize("analysis", [STATIC, MOTION], ids=["static", "dynamic"])
def test_reactions_of_supports_that_share_nodes_add_up(tmp_path, analysis):
    path = scene(tmp_path, analysis, SHARING)
    path.write_text(path.read_text().replace('left = "xyz"', 'left = "x"\nside = "y"\nbelow = "yz"\nends = "xy"'))
    curves = Scene.read(path).solve(tmp_path / "beam", quiet=True).curves
    whole = curves.pop("every").values
    np.testing.assert_allclose(sum(one.values for one in curves.values()), whole, rtol=0, atol=1e-9 * np.abs(whole).max())
    assert not curves["a"].values[:, 1:].any() and not curves["d"].values[:, 2].any() and curves["d"].values[-1, 0] != 0


@pytest.mark.parametrize("analysis", [STATIC, MOTION], ids=["static", "dynamic"])
def test_saved_states_contain_the_requested_fields(tmp_path, analysis):
    path = scene(tmp_path, analysis, FOLLOWED, 'fields = ["volume_ratio"]\n')
    Scene.read(path).solve(tmp_path / "beam", quiet=True)
    assert list(read_vtu(tmp_path / "beam" / "beam_0000.vtu").cell_data) == ["volume_ratio"]
    with pytest.raises(SceneError, match=r"output.fields.1., .*There is no field 'volume'"):
        Scene.read(path, ["output.fields=['volume_ratio', 'volume']"])


def test_modes_equal_those_of_the_program(tmp_path):
    outcome = Scene.read(scene(tmp_path, MODES)).solve(quiet=True)
    assert [outcome.values[f"frequency.{n}"] for n in range(4)] == modes(body(), 4).frequencies.tolist()


@pytest.mark.parametrize("parts", [(STATIC, FOLLOWED), (MOTION, FOLLOWED), (MODES,)], ids=["static", "dynamic", "modes"])
def test_the_resolved_scene_gives_the_same_results(tmp_path, parts):
    first = Scene.read(scene(tmp_path, *parts)).solve(tmp_path / "first", quiet=True)
    resolved = Scene.read(tmp_path / "first" / "resolved.toml")
    second = resolved.solve(tmp_path / "second", quiet=True)
    assert second.values == first.values
    assert resolved.data["solver"]["name"] != "auto" and resolved.data["threads"] >= 1
    text = (tmp_path / "second" / "resolved.toml").read_text()
    assert text == (tmp_path / "first" / "resolved.toml").read_text()


@pytest.mark.parametrize("analysis", [STATIC, MOTION], ids=["static", "dynamic"])
def test_solve_prints_the_results_that_matter_with_their_locations(tmp_path, capsys, analysis):
    assert main(["solve", str(scene(tmp_path, analysis, FOLLOWED))]) == 0
    out = capsys.readouterr().out
    outcome = Scene.read(tmp_path / "beam.toml").solve(quiet=True)
    result, rows = outcome.result, dict(re.findall(r"^  (\S.*?)  +(.*)$", out, re.MULTILINE))
    lengths, stress = np.linalg.norm(result.u.reshape(-1, 3), axis=1), result.state["von_mises_stress"]
    node, element = lengths.argmax(), stress.argmax()
    point, centre = result.system.mesh.p[:, node], result.system.mesh.p[:, result.system.mesh.t[:, element]].mean(axis=1)
    assert rows["largest displacement"] == f"{lengths[node]:.6g} m   node {node} at {in_parentheses(point)}"
    assert rows["largest von Mises stress"] == f"{stress[element]:.6g} Pa   mean of element {element} at {in_parentheses(centre)}"
    assert outcome.values["stress.largest"] == stress[element]
    assert rows["reaction of wall"] == rows["reaction of all supports"]
    assert float(rows["reaction of wall"].split()[2].rstrip(")")) == pytest.approx(result.reaction().resultant[2], rel=1e-5)
    assert rows["strain energy"].endswith(" J") and ("kinetic energy" in rows) == (analysis is MOTION)
    assert "body" in rows["time"] and "assemble" in rows["time"] and "report" in rows["time"]
    assert out.endswith(f"report: {tmp_path / 'beam' / 'report.html'}\n")
    assert out.lower().count("converged") <= 1


def in_parentheses(x):
    return f"({', '.join(f'{value:.4g}' for value in x)})"


BUCKLED = """
mesh = { type = "box", size = [10.0, 1.0], cells = [20, 2] }
materials.rubber = { model = "isotropic", young = 1e5, poisson = 0.3 }
fixed = { left = "xy" }
analysis = { type = "static", steps = 10 }
output = { picture = "" }
expect.jumps = { value = 0, atol = 0 }
[[terms]]
type = "stvk"
material = "rubber"
[[terms]]
type = "traction"
on = "right"
traction = [-680.0, 0.2]
"""


def test_a_column_that_buckled_has_a_jump_in_its_results(tmp_path, capsys):
    """Three times its critical load: it is in equilibrium, and load steps have passed the critical point."""
    (tmp_path / "column.toml").write_text(BUCKLED)
    assert main(["solve", str(tmp_path / "column.toml"), "--quiet"]) == 3
    summary = json.loads((tmp_path / "column" / "summary.json").read_text())
    assert "the body snapped or buckled there" in summary["message"] and summary["results"]["jumps"] == 1.0
    assert main(["solve", str(tmp_path / "column.toml"), "--quiet", "--force", "--set", "terms[1].traction=[-68.0, 0.2]"]) == 0
    assert json.loads((tmp_path / "column" / "summary.json").read_text())["results"]["jumps"] == 0.0


def test_results_are_judged_by_the_expectations(tmp_path, capsys):
    good = "[expect]\nwall.z = { value = 2000, rtol = 1e-6 }\nload = { value = 1, atol = 0 }\n"
    assert main(["solve", str(scene(tmp_path, STATIC, FOLLOWED, good, name="good.toml")), "--quiet"]) == 0
    bad = "[expect]\nwall.z = { value = 2000, rtol = 1e-6 }\ntip.z = { value = 1, atol = 0.5 }\n"
    assert main(["solve", str(scene(tmp_path, STATIC, FOLLOWED, bad, name="bad.toml"))]) == 3
    assert "not as expected tip.z" in capsys.readouterr().out
    summary = json.loads((tmp_path / "bad" / "summary.json").read_text())
    assert [one["passed"] for one in summary["expectations"]] == [True, False] and summary["exit_code"] == 3


#: A bar with a velocity towards its clamped end: explicit steps gain 15 % of the energy at 20 m/s, and diverge once at 25 m/s.
THROWN = """
[[terms]]
type = "volume-penalty"
kind = "compression"
[initial]
velocity = [{v}, {w}, -{v}]
[analysis]
type = "dynamic"
integrator = "velocity-verlet"
until = 0.05
[expect]
energy_gained = {{ value = 0, atol = 0.05 }}
blow_ups = {{ value = 0, atol = 0 }}
"""


@pytest.mark.parametrize(
    ("speed", "message", "failed"),
    [
        (20, r"^The steps gained 1\d % of the energy\. Use a smaller dt", {"energy_gained"}),
        (25, r"^The motion blew up once, and its steps (gained|lost) \S+ % of the energy", {"blow_ups"}),
    ],
)
def test_a_gain_of_energy_is_a_warning_and_can_fail_an_expectation(speed, message, failed, tmp_path):
    path = tmp_path / "thrown.toml"
    beam = BEAM.replace("poisson = 0.45\ndensity = 1100", "poisson = 0.3\ndensity = 1000")
    path.write_text(beam + THROWN.format(v=speed, w=0.3 * speed))
    with pytest.warns(StvkWarning, match=message) as warnings_:
        outcome = Scene.read(path).solve(quiet=True)
    assert outcome.success and outcome.warnings == tuple(str(one.message) for one in warnings_)
    assert {one.name for one in outcome.judged if not one.passed} == failed and outcome.exit_code == 3
    assert outcome.values["energy_gained"] == outcome.result.gained and outcome.values["blow_ups"] == outcome.result.blow_ups


def test_names_of_results_are_printed_without_control_characters(tmp_path, capsys):
    probes = '[output]\nprobes = { "\\u001b[31mtip" = "right" }\n[expect."\\u001b[31mtip"]\nz = { value = 9, rtol = 0.1 }\n'
    assert main(["solve", str(scene(tmp_path, STATIC, probes))]) == 3
    captured = capsys.readouterr()
    assert "\\x1b" in captured.out and "\x1b" not in captured.out + captured.err


@pytest.mark.parametrize("parts", [STATIC, MOTION])
def test_a_full_disk_is_reported_in_the_summary(parts, tmp_path, capsys):
    """With a limit of the file size that allows the summary but no state, the summary says that the run was interrupted."""
    path = scene(tmp_path, parts, FOLLOWED)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, before[1]))
    try:
        code = main(["solve", str(path), "--quiet"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    summary = json.loads((tmp_path / "beam" / "summary.json").read_text())
    assert summary["status"] == "interrupted" and "beam_0000.vtu could not be written" in summary["message"]
    err = " ".join(capsys.readouterr().err.split())
    assert code == 2 or (code == 130 and "beam_0000.vtu could not be written" in err and "--resume" in err)
    assert main(["solve", str(path), "--quiet", "--force"]) == 0


def test_an_overflowing_velocity_is_reported_as_a_failure(tmp_path):
    outcome = Scene.read(scene(tmp_path, MOTION.replace("[0, 0.5, 0]", "[1e308, 1e308, 1e308]"))).solve(
        tmp_path / "out", quiet=True
    )
    assert not outcome.success and outcome.exit_code == 1 and outcome.message


@pytest.mark.parametrize("content", ["pipe", "/dev/zero", '{"status": "finished", "results": 3}', 2_000 * "[", "\0"])
def test_an_unreadable_summary_is_an_error(content, tmp_path, capsys):
    out = tmp_path / "beam"
    out.mkdir()
    if content == "pipe":
        os.mkfifo(out / "summary.json")
    elif content == "/dev/zero":
        (out / "summary.json").symlink_to(content)
    else:
        (out / "summary.json").write_text(content)
    assert main(["solve", str(scene(tmp_path, STATIC)), "--quiet"]) == 2
    assert "holds the results of a run that has no readable summary. --force replaces them" in " ".join(
        capsys.readouterr().err.split()
    )


@pytest.mark.parametrize("name", ["summary.json", "resolved.toml"])
def test_an_endless_file_of_an_earlier_run_is_replaced_without_reading_it(name, tmp_path):
    path = scene(tmp_path, MODES)
    assert main(["solve", str(path), "--quiet"]) == 0
    with (tmp_path / "beam" / name).open("wb") as file:
        file.truncate(2**40)
    assert main(["solve", str(path), "--quiet"]) == 2
    assert main(["solve", str(path), "--quiet", "--force"]) == 0
    assert all((tmp_path / "beam" / one).stat().st_size < 10**6 for one in ("summary.json", "resolved.toml"))


def test_the_work_for_contacts_grows_with_their_number():
    """The number of calls of functions, which unlike a time is the same on each machine."""

    def calls(count):
        contact = {"type": "rigid-contact", "on": "left", "shape": {"type": "plane", "normal": [1.0, 0.0]}}
        contacts = [contact | {"name": f"c{n}", "shape": contact["shape"] | {"point": [-1.0 - n, 0.0]}} for n in range(count)]
        data = {
            "mesh": {"type": "box", "size": [1.0, 1.0], "cells": [2, 2]},
            "materials": {"m": {"model": "isotropic", "young": 1.0, "poisson": 0.3, "density": 1.0}},
            "terms": [{"type": "stvk", "material": "m"}, {"type": "traction", "on": "top", "traction": [0.0, 0.1]}, *contacts],
            "fixed": {"bottom": "xy"},
            "analysis": {"type": "static", "steps": 1},
        }
        with cProfile.Profile() as profile:
            outcome = Scene.of_data(data).solve(quiet=True)
        assert outcome.success and outcome.values[f"c{count - 1}.x"] == 0.0
        return pstats.Stats(profile).total_calls

    calls(2)
    few, some, many = calls(20), calls(40), calls(80)
    assert many - some < 2.1 * (some - few)


def test_a_solve_without_convergence_is_reported_and_retains_its_states(tmp_path):
    path = scene(tmp_path, STATIC.replace("-2e3", "-2e7"), FOLLOWED)
    assert main(["solve", str(path), "--quiet"]) == 1
    summary = json.loads((tmp_path / "beam" / "summary.json").read_text())
    assert summary["status"] == "stopped before the end" and 0 < summary["results"]["load"] < 1
    assert (tmp_path / "beam" / "beam_0000.vtu").is_file()


def test_results_of_another_run_are_replaced_only_by_force(tmp_path, capsys):
    path = scene(tmp_path, STATIC, FOLLOWED)
    assert main(["solve", str(path), "--quiet"]) == 0
    before = (tmp_path / "beam" / "summary.json").read_bytes()
    assert main(["solve", str(path), "--quiet"]) == 2
    assert "--force replaces them" in capsys.readouterr().err
    assert (tmp_path / "beam" / "summary.json").read_bytes() == before
    assert main(["solve", str(path), "--quiet", "--force"]) == 0
    assert main(["solve", str(path), "--quiet", "--force", "--set", "analysis.steps=3"]) == 0
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("mine")
    assert main(["solve", str(path), "--quiet", "--force", "--out", str(tmp_path / "other")]) == 2
    assert "thesis.tex" in capsys.readouterr().err


def test_two_simultaneous_runs_cannot_write_into_one_folder(tmp_path, capsys):
    path = scene(tmp_path, STATIC)
    (tmp_path / "beam").mkdir()
    with OneWriter(tmp_path / "beam"):
        assert main(["solve", str(path), "--quiet", "--force"]) == 2
        assert main(["sweep", str(path), "--quiet", "--set", "analysis.steps=2,3", "--out", str(tmp_path / "beam")]) == 2
    err = capsys.readouterr().err
    assert err.count("is being written by") == 2
    assert main(["solve", str(path), "--quiet"]) == 0


def test_a_refused_run_does_not_block_its_folder(tmp_path, capsys):
    path = scene(tmp_path, STATIC)
    assert main(["solve", str(path), "--quiet", "--set", 'fixed={ left = "x" }']) == 2
    assert "rigid modes left" in capsys.readouterr().err
    assert json.loads((tmp_path / "beam" / "summary.json").read_text())["status"] == "refused"
    assert main(["solve", str(path), "--quiet"]) == 0


def test_resume_without_a_checkpoint_is_an_error(tmp_path, capsys):
    path = scene(tmp_path, MOTION)
    assert main(["solve", str(path), "--quiet", "--resume"]) == 2
    assert "nothing to resume" in capsys.readouterr().err and not (tmp_path / "beam").exists()
    assert main(["solve", str(path), "--quiet", "--set", "output.checkpoint=false"]) == 0
    assert main(["solve", str(path), "--quiet", "--resume"]) == 2
    assert main(["solve", str(scene(tmp_path, MODES, name="modes.toml")), "--quiet", "--resume"]) == 2


def test_a_checkpoint_of_another_problem_is_refused_with_the_difference(tmp_path, capsys):
    path = scene(tmp_path, MOTION)
    assert main(["solve", str(path), "--quiet"]) == 0
    assert main(["solve", str(path), "--quiet", "--resume", "--set", "materials.rubber.young=2e6"]) == 2
    text = capsys.readouterr().err
    assert "elastic terms changed" in text and "--force, without --resume" in text and "overwrite=True" not in text
    assert main(["solve", str(path), "--quiet", "--resume", "--set", "analysis.until=0.3"]) == 0


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "analysis, options",
    [
        (MOTION, ("--resume", "--set", "analysis.until=0.1")),
        (MOTION, ("--resume", "--set", "materials.rubber.young=2e6")),
        (STATIC, ("--force", "--set", "fixed={ left = 'x' }")),
    ],
)
def test_a_refused_run_does_not_change_existing_results(tmp_path, capsys, analysis, options):
    path = scene(tmp_path, analysis, FOLLOWED)
    assert main(["solve", str(path), "--quiet"]) == 0
    before = contents(tmp_path / "beam")
    assert main(["solve", str(path), "--quiet", *options]) == 2
    assert contents(tmp_path / "beam") == before
    assert main(["solve", str(path), "--quiet", *options[1:]]) == 2
    assert "--force replaces them" in capsys.readouterr().err
    assert contents(tmp_path / "beam") == before


def test_results_of_a_failed_run_are_not_replaced(tmp_path, monkeypatch, capsys):
    path = scene(tmp_path, STATIC, FOLLOWED)

    def fails(built, folder, quiet):
        (folder.path / "beam_0000.vtu").write_text("a state")
        raise StvkError("No space left on device.")

    monkeypatch.setattr("skfem_stvk.scenes.scene.solve", fails)
    assert main(["solve", str(path), "--quiet"]) == 2
    monkeypatch.undo()
    assert main(["solve", str(path), "--quiet"]) == 2
    assert "holds the results of a run that failed" in capsys.readouterr().err
    assert (tmp_path / "beam" / "beam_0000.vtu").read_text() == "a state"


def test_results_of_a_run_that_ends_during_the_setup_of_another_are_not_replaced(tmp_path, monkeypatch):
    slow, fast = Scene.read(scene(tmp_path, STATIC)), Scene.read(scene(tmp_path, STATIC.replace("-2e3", "-1e3")))
    look = Folder.open

    def look_before_the_other_run(folder, sections):
        look(folder, sections)
        monkeypatch.undo()
        fast.solve(tmp_path / "out", quiet=True)

    monkeypatch.setattr(Folder, "open", look_before_the_other_run)
    with pytest.raises(StvkError, match="holds the results of a run that converged"):
        slow.solve(tmp_path / "out", quiet=True)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["scene_hash"] == fast.hash


def test_force_removes_all_files_of_the_previous_run_and_no_others(tmp_path):
    path = scene(tmp_path, MOTION, FOLLOWED, 'plots = ["tip", "ledger"]\nanimation = "beam.gif"\n')
    assert main(["solve", str(path), "--quiet"]) == 0
    (tmp_path / "beam" / "plot-mine.png").write_text("mine")
    (tmp_path / "beam" / "beam_notes.vtu").write_text("mine")
    other = scene(tmp_path, MODES, '[output]\nfile = "bar.pvd"\n', name="other.toml")
    assert main(["solve", str(other), "--quiet", "--force", "--out", str(tmp_path / "beam")]) == 0
    assert main(["solve", str(other), "--quiet", "--out", str(tmp_path / "alone")]) == 0
    left = {name for name in contents(tmp_path / "beam") if not name.startswith("checkpoint")}
    assert left == {*contents(tmp_path / "alone"), "plot-mine.png", "beam_notes.vtu"}


def test_nothing_is_written_through_symbolic_links(tmp_path):
    path, folder = scene(tmp_path, MODES), tmp_path / "beam"
    assert main(["solve", str(path), "--quiet"]) == 0
    names = sorted(contents(folder))
    for file in [*names, *(f".{name}.part" for name in names), ".lock", ".writer"]:
        (folder / file).unlink(missing_ok=True)
        (tmp_path / f"target of {file}").write_text('{"status": "mine"}')
        (folder / file).symlink_to(tmp_path / f"target of {file}")
    main(["solve", str(path), "--quiet", "--force"])
    (folder / ".lock").unlink(missing_ok=True)
    assert main(["solve", str(path), "--quiet", "--force"]) == 0
    assert {file.read_text() for file in tmp_path.glob("target of *")} == {'{"status": "mine"}'}
    assert sorted(contents(folder)) == names and not any((folder / name).is_symlink() for name in names)


def wait_for(condition, process):
    begin = time.monotonic()
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() - begin < 300
        time.sleep(0.02)


LONG = MOTION.replace("until = 0.2", "until = 0.6").replace("dt = 0.01", "dt = 0.002")
#: A path that saves each state as soon as it is found.
PATH = STATIC.replace('type = "static"', 'type = "arc-length"').replace("steps = 4", "steps = 200\nstop = { states = 120 }")


@pytest.mark.parametrize(
    "how, analysis, until",
    [
        pytest.param(signal.SIGINT, LONG, "beam_0004.vtu", marks=pytest.mark.slow),
        (signal.SIGKILL, PATH, "checkpoint/state_00005.npz"),
    ],
)
def test_an_interrupted_or_killed_run_is_resumed_from_the_command_line(tmp_path, started, how, analysis, until):
    whole = Scene.read(scene(tmp_path, analysis, FOLLOWED, name="whole.toml")).solve(quiet=True)
    path = scene(tmp_path, analysis, FOLLOWED)
    process = started("solve", path)
    wait_for((tmp_path / "beam" / until).exists, process)
    os.kill(process.pid, how)
    out, err = process.communicate(timeout=300)
    summary = json.loads((tmp_path / "beam" / "summary.json").read_text())
    if how == signal.SIGINT:
        assert process.returncode == 130, out + err
        assert summary["status"] == "interrupted" and f"skfem-stvk solve {path} --out {tmp_path / 'beam'} --resume" in err
        assert 0 < summary["results"]["time"] < 0.6
    else:
        assert summary["status"] == "was killed or is running"
    before = {file.name: file.stat().st_mtime_ns for file in (tmp_path / "beam" / "checkpoint").glob("state_*.npz")}
    resumed = started("solve", path, "--resume")
    out, err = resumed.communicate(timeout=300)
    assert resumed.returncode == 0, out + err
    assert json.loads((tmp_path / "beam" / "summary.json").read_text())["results"] == pytest.approx(
        whole.values, rel=1e-9, abs=1e-9
    )
    after = {name: (tmp_path / "beam" / "checkpoint" / name).stat().st_mtime_ns for name in before}
    assert after == before and (how == signal.SIGINT or len(before) > 5)  # saved states are not solved again


def test_a_scene_of_data_is_identified_by_its_data():
    data = {
        "mesh": {"type": "box", "size": [1.0, 1.0], "cells": [2, 2]},
        "materials": {"m": {"model": "isotropic", "young": 1.0, "poisson": 0.3}},
        "terms": [{"type": "stvk", "material": "m"}, {"type": "traction", "on": "top", "traction": [0.0, 0.1]}],
        "fixed": {"bottom": "xy"},
        "analysis": {"type": "static"},
    }
    assert Scene.of_data(data).solve(quiet=True).success
    with pytest.raises(StvkError, match="resume and force need a folder"):
        Scene.of_data(data).solve(resume=True)
    assert Scene.of_data(data).hash == Scene.of_data(dict(reversed(data.items()))).hash
    assert Scene.of_data(data).hash != Scene.of_data(data | {"fixed": {"bottom": "y"}}).hash


PRESSED = """
mesh = { type = "box", size = [1.0, 1.0, 0.3], cells = [3, 3, 1], origin = [0.0, 0.0, 0.0] }
materials.m = { model = "isotropic", young = 1e5, poisson = 0.3, density = 1e3 }
terms = [
    { type = "stvk", material = "m" },
    { type = "gravity", g = [0.0, 0.0, -9.81] },
    { type = "mesh-contact", first = "front", second = { type = "rigid-mesh", file = "die.vtu" }, distance = 0.06 },
]
fixed = { left = "xy", right = "xy" }
analysis = { type = "static", steps = 4 }
output = { picture = "" }
"""


def write_die(path, z):
    die = box((0.6, 0.6, 0.25), (2, 2, 1))
    write_mesh(path, ElementMesh(die.p + np.array([[0.2], [0.2], [z]]), die.surface))


def test_a_moved_rigid_mesh_changes_the_hash_and_the_resolved_scene_finds_its_file(tmp_path):
    path = tmp_path / "pressed.toml"
    path.write_text(PRESSED)
    hashes, lifts = [], []
    for z in (-0.3, -0.28):
        write_die(tmp_path / "die.vtu", z)
        outcome = Scene.read(path).solve(tmp_path / "out" / "there", force=True, quiet=True)
        resolved = Scene.read(tmp_path / "out" / "there" / "resolved.toml")
        again = resolved.solve(quiet=True)
        assert outcome.success and again.result.u.tobytes() == outcome.result.u.tobytes()
        hashes += [Scene.read(path).hash, resolved.hash]
        lifts.append(outcome.result.u.reshape(-1, 3)[:, 2].mean())
        copied = Scene.read(tmp_path / "out" / "there" / "resolved.toml").write(tmp_path / "copy.toml")
        assert (copied.parent / Scene.read(copied).data["terms"][2]["second"]["file"]).resolve() == tmp_path / "die.vtu"
    assert len(set(hashes)) == 4 and lifts[1] - lifts[0] > 0.01


def test_a_run_of_a_sweep_is_repeated_after_its_rigid_mesh_moved(tmp_path):
    path = tmp_path / "pressed.toml"
    path.write_text(PRESSED)
    write_die(tmp_path / "die.vtu", -0.3)
    runs = planned(path, ["analysis.steps=4"])[1]
    runs[0].scene.solve(tmp_path / "runs" / runs[0].name, quiet=True)
    assert _start(runs[0], tmp_path / "runs", False) is None
    write_die(tmp_path / "die.vtu", -0.28)
    with pytest.raises(StvkError, match="results of another scene"):
        _start(planned(path, ["analysis.steps=4"])[1][0], tmp_path / "runs", False)


LISTED = "<VTKFile><Collection>{}</Collection></VTKFile>".format(
    "".join(f'<DataSet timestep="{t}" file="last_{t}.vtu"/>' for t in (0, 1))
)


@pytest.mark.parametrize(
    "setting, name, text, part, other",
    [
        ("mesh={{ file = '{}' }}", "a.inp", "*NODE\n *Include , input=b.inp\n", "b.inp", "c.inp"),
        ("mesh={{ file = '{}' }}", "a.inp", "*INCLUDE, INPUT=between.inp\n", "b.inp", "c.inp"),
        ("mesh={{ file = '{}' }}", "a.ele", "", "a.node", "b.node"),
        ("mesh={{ file = '{}' }}", "a.node", "", "a.ele", "b.ele"),
        ("mesh={{ file = '{}' }}", "a.xdmf", '<Xdmf><DataItem Format="HDF">a.h5:/x</DataItem></Xdmf>', "a.h5", "b.h5"),
        ("initial.file='{}'", "a.pvd", LISTED, "last_1.vtu", "last_0.vtu"),
        ("initial={{ file = '{}', at = 0.0 }}", "a.pvd", LISTED, "last_0.vtu", "last_1.vtu"),
    ],
)
def test_a_changed_companion_file_changes_the_hash_of_the_scene(tmp_path, setting, name, text, part, other):
    path = scene(tmp_path, STATIC)
    (tmp_path / "between.inp").write_text("*NODE\n** *INCLUDE, INPUT=c.inp\n*INCLUDE,INPUT=b.inp\n")
    for file in (part, other, name):
        (tmp_path / file).write_text(text if file == name else "1")
    before = Scene.read(path, [setting.format(name)]).hash
    (tmp_path / other).write_text("2")
    assert Scene.read(path, [setting.format(name)]).hash == before
    (tmp_path / part).write_text("2")
    assert Scene.read(path, [setting.format(name)]).hash != before


def test_a_mesh_file_that_includes_itself_has_a_hash(tmp_path):
    (tmp_path / "a.inp").write_text("*INCLUDE, INPUT=a.inp\n")
    assert Scene.read(scene(tmp_path, STATIC), ["mesh={ file = 'a.inp' }"]).hash


def test_relative_paths_are_relative_to_the_scene(tmp_path, monkeypatch):
    path = Path(__file__).parents[2] / "docs" / "scenes" / "arch.toml"
    monkeypatch.chdir(tmp_path)
    assert (
        main(["solve", str(path), "--out", "there/arch", "--quiet", "--set", "analysis.stop={states=3}", "--set", "expect={}"]) == 0
    )
    again = Scene.read(tmp_path / "there" / "arch" / "resolved.toml")
    assert again.system().mesh.nt == 240


@pytest.mark.parametrize("law", ["corotated'\nrotation = 'vertex", "invertible-stvk'\nextend = 'stress"])
def test_an_undefined_energy_is_a_dash_in_all_outputs_of_a_scene(tmp_path, capsys, law):
    """An undefined energy is a dash in tables and null in the summary; an expectation of it is refused before the analysis."""
    parts = [MOTION, 'plots = ["ledger"]\n'.join([FOLLOWED, "[expect]\n"])]
    path = scene(tmp_path, *parts, "energy.closure = { value = 0, atol = 1 }\n")
    path.write_text(path.read_text().replace('"stvk"', f"'{law}'"))
    assert main(["solve", str(path)]) == 0
    assert "J   strain -   total -   closure" in capsys.readouterr().out
    results = json.loads((tmp_path / "beam" / "summary.json").read_text())["results"]
    assert [name for name, value in results.items() if value is None] == ["energy.strain", "energy.total"]
    page = (tmp_path / "beam" / "report.html").read_text()
    assert all(f'<td>energy.{name}</td><td class="n">-</td>' in page for name in ("strain", "total"))
    assert 'class="failed"' not in page and (tmp_path / "beam" / "plot-ledger.png").is_file()
    path.write_text(path.read_text().replace("energy.closure", "energy.total"))
    assert main(["solve", str(path), "--force"]) == 2
    assert "expect.energy.total" in (err := capsys.readouterr().err) and " 0 has no energy" in err


@pytest.mark.parametrize("parts", [STATIC, MOTION], ids=["static", "dynamic"])
def test_an_unexpected_error_is_not_reported_as_bad_input(tmp_path, monkeypatch, parts):
    """An unexpected error is an `AnalysisError` with its traceback, and the summary says that the run has started."""

    def fault(*given):
        raise KeyError("a fault")

    monkeypatch.setattr(System, "advanced", fault)
    path = scene(tmp_path, parts)
    with pytest.raises(AnalysisError, match="a fault"):
        main(["solve", str(path), "--quiet"])
    assert json.loads((tmp_path / "beam" / "summary.json").read_text())["status"] == "was killed or is running"
    failure = _solve((path, (), tmp_path / "swept", "new"))
    assert failure[0] == "crashed" and "a fault" in failure[2]
