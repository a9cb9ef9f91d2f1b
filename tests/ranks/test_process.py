"""Ranks end together: one that fails ends the job with one message, errors of all are printed once, and a signal stops all."""

import json
import os
import re
import shutil
import signal
import sys
from pathlib import Path

import pytest

from skfem_stvk.scenes.commands.main import main
from skfem_stvk.solvers.statics import solve

ROOT = Path(__file__).parents[2]
BRACKET = ROOT / "docs" / "scenes" / "bracket.toml"

PROGRAM = """
import os, signal, sys, time
import numpy as np
from mpi4py import MPI
from skfem_stvk import Gravity, NodalLoad, StVK, System, VelocityVerlet, simulate, solve_static
from skfem_stvk.ranks import distribute
from skfem_stvk.mesh import box
rank = MPI.COMM_WORLD.rank
mesh = distribute(box((4.0, 1.0, 1.0), (4, 1, 1)))

def fail():
    {fault}

def pull(t):
    if rank == 1 and 0.1 < t < 1 and {in_load}:
        fail()
    return (0.0, 0.0, -t)

law = StVK(young=1e4, poisson=0.3, density=1.0)
system = System(mesh, [law, NodalLoad("right", pull)], fixed={{"left": "xyz"}})
if rank == 1 and not {in_load}:
    fail()
solve_static(system, 4, solver="block-jacobi-cg")
"""
#: Faults on rank 1 with the exit code of the job, and the words of its message.
FAULTS = {
    "raises": ("raise KeyError('no such rank')", 1, "KeyError: 'no such rank'"),
    "exits": ("sys.exit(3)", 3, "MPI_ABORT was invoked on rank 1"),
    "leaves": ("os._exit(5)", 5, "exit"),
    "is killed": ("os.kill(os.getpid(), signal.SIGKILL)", 137, "signal 9"),
    "cannot write": ("open('/proc/nothing', 'w')", 1, "No such file or directory: '/proc/nothing'"),
}
#: Time after which a job counts as hung [s]; it ends within 3 s, but for compilers and busy machines.
HUNG = 240


@pytest.mark.few(1)
@pytest.mark.parametrize(("fault", "where"), [("raises", "program"), *((fault, "load") for fault in FAULTS)])
def test_a_rank_that_fails_ends_the_job(on_ranks, fault, where):
    """The other rank waits for it in a reduction, or in an exchange of the solve."""
    code, exit_code, words = FAULTS[fault]
    done = on_ranks(2, PROGRAM.format(fault=code, in_load=where == "load"), check=False, timeout=HUNG)
    assert done.returncode == exit_code and words in done.stderr, done.stderr
    assert done.stderr.count("MPI_ABORT was invoked") <= 1 and "t 1 " not in done.stdout


def test_ranks_without_a_hook_are_refused_with_the_line_to_type(on_ranks):
    done = on_ranks(2, PROGRAM.format(fault="pass", in_load=False), check=False, module=False)
    assert done.returncode and re.search(r"distribute on 2 ranks: .* mpiexec -n 2 python -m mpi4py \S*program.py", done.stderr)


@pytest.mark.slow
def test_the_example_on_two_ranks_is_that_on_one(on_ranks, tmp_path):
    """The picture is drawn into a copy of the example's folder."""
    for name in ("scenes/bracket.msh", "programs/ranks.py"):
        (tmp_path / name).parent.mkdir()
        shutil.copy(ROOT / "docs" / name, tmp_path / name)
    done = on_ranks(2, tmp_path / "programs" / "ranks.py", timeout=HUNG)
    assert done.stdout == "2 rank(s): the tip sinks by 1.0243 mm\n"
    assert (tmp_path / "programs" / "ranks.png").stat().st_size > 10_000


# the command

SCENE = """
[mesh]
type = "box"
size = [4.0, 1.0, 1.0]
cells = [4, 1, 1]

[materials.rubber]
model = "isotropic"
young = 1e6
poisson = 0.3
density = 1e3

[[terms]]
type = "stvk"
material = "rubber"

[[terms]]
type = "traction"
on = "right"
traction = [0.0, 0.0, -1e3]

[fixed]
left = "xyz"

[analysis]
type = "static"
steps = 4

[solver]
name = "block-jacobi-cg"

[output]
reactions = { wall = "left" }
file = "beam.pvd"
picture = ""
"""

#: The command with something done on one rank when it has solved a step.
COMMAND = """
import os, signal, sys
from skfem_stvk.scenes.commands.main import main
from skfem_stvk.errors import MeshError, warn
from skfem_stvk.solvers.statics import solve
rank, after, steps = int(os.environ["OMPI_COMM_WORLD_RANK"]), solve.stop_if_requested, []

def at_step(space):
    steps.append(1)
    if {when}:
        {do}
    after(space)

solve.stop_if_requested = at_step
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def scene(tmp_path):
    """Path of a scene that a few dozen nodes solve in four steps."""
    path = tmp_path / "beam.toml"
    path.write_text(SCENE)
    return path


def command(on_ranks, n, *arguments, do="pass", when="rank == 1 and len(steps) == 2", check=True):
    """Run the command on ranks and return the finished process."""
    return on_ranks(n, COMMAND.format(do=do, when=when), *arguments, check=check, module=False, timeout=HUNG)


def summary(folder):
    return json.loads((folder / "summary.json").read_text())


@pytest.mark.slow
def test_the_bracket_on_two_ranks_is_that_on_one_machine(on_ranks, tmp_path):
    """The whole command: the folder of results with its report, the expectation of the scene, and what the header says."""
    values = ("solver.name=block-jacobi-cg", "solver.rtol=1e-9", "analysis.steps=1", "output.file=bracket.vtu")
    same = [part for value in values for part in ("--set", value)]
    assert main(["solve", str(BRACKET), *same, "--out", str(tmp_path / "one"), "--quiet"]) == 0
    done = command(on_ranks, 2, "solve", BRACKET, *same, "--out", tmp_path / "two")
    one, two = (summary(tmp_path / name) for name in ("one", "two"))
    assert two["results"] == pytest.approx(one["results"], rel=1e-8, abs=1e-6 * 600)
    assert two["results"]["tip.z"] == pytest.approx(one["results"]["tip.z"], rel=1e-10)
    assert (
        two["expectations"][0]["passed"]
        and two["ranks"] == "2 ranks with 540 to 540 elements, 50 to 50 shared nodes and 1 thread each"
    )
    assert two["ranks"] in done.stdout and re.search(r"peak memory of a rank: \d+ to \d+ MB", done.stdout)
    assert done.stdout.count("1080 quadratic tetrahedra") == 1 and "as expected bolts.z" in done.stdout
    files = {path.name for path in (tmp_path / "two").iterdir()}
    assert files == {path.name for path in (tmp_path / "one").iterdir()} >= {"picture.png", "plot-path.png", "bracket.vtu"}
    assert "not drawn" not in (tmp_path / "two" / "report.html").read_text()


def test_a_signal_on_one_rank_stops_all_after_the_step_and_the_run_is_resumed(on_ranks, scene):
    """Other than Ctrl-C, it does so however often it arrives: launchers and schedulers both send it."""
    send = "[os.kill(os.getpid(), number) for number in (signal.SIGUSR1, signal.SIGTERM, signal.SIGTERM)]"
    exact, folder = ("--set", "solver.rtol=1e-11"), scene.with_suffix("")
    done = command(on_ranks, 2, "solve", scene, *exact, do=send, check=False)
    assert done.returncode == 130 and "MPI_ABORT" not in done.stderr, done.stderr
    assert done.stderr.count("Interrupted at t = 0.625") == 1 and "mpiexec -n 2 skfem-stvk solve" in done.stderr
    assert summary(folder)["status"] == "interrupted"
    done = command(on_ranks, 3, "solve", scene, *exact, "--resume")
    assert "read from" in done.stdout and "4 iterations" not in done.stdout.split("read from")[0]
    assert main(["solve", str(scene), *exact, "--out", str(scene.parent / "whole"), "--quiet"]) == 0
    assert summary(folder)["results"] == pytest.approx(summary(scene.parent / "whole")["results"], rel=1e-9, abs=1e-7)
    before = {name: (folder / name).read_bytes() for name in ("summary.json", "resolved.toml", "beam.pvd")}
    lost = max((folder / "checkpoint").glob("rank0001_state_*.npz"), key=lambda path: path.name)
    lost.unlink()
    done = command(on_ranks, 3, "solve", scene, *exact, "--resume", check=False)
    assert done.returncode == 2 and "MPI_ABORT" not in done.stderr and done.stderr.count(lost.name) == 1, done.stderr
    assert before == {name: (folder / name).read_bytes() for name in before}


def test_a_signal_stops_the_command_on_one_machine(scene, capsys, monkeypatch):
    handler, signals = signal.getsignal(signal.SIGTERM), iter((signal.SIGTERM, signal.SIGUSR1))
    after = solve.stop_if_requested
    monkeypatch.setattr(solve, "stop_if_requested", lambda space: (os.kill(os.getpid(), next(signals)), after(space)))
    assert main(["solve", str(scene), "--quiet"]) == 130
    assert "Interrupted at t = 0.25. Found so far: 1 state" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGTERM) is handler


@pytest.mark.parametrize(
    ("do", "code", "words"),
    [
        pytest.param("raise MeshError('a bad part')", 2, "error on rank 1 of 2: a bad part", marks=pytest.mark.slow),
        ("raise RuntimeError('a fault')", 1, "RuntimeError: a fault"),
        pytest.param("raise KeyboardInterrupt", 130, "error on rank 1 of 2", marks=pytest.mark.slow),
    ],
)
def test_an_error_on_one_rank_ends_the_command_with_its_exit_code(on_ranks, scene, do, code, words):
    done = command(on_ranks, 2, "solve", scene, do=do, check=False)
    assert done.returncode == code and done.stderr.count("error on rank") == 1 and words in done.stderr, done.stderr


@pytest.mark.slow
def test_a_file_that_one_rank_cannot_write_is_an_error_of_all(on_ranks, scene):
    done = command(on_ranks, 2, "solve", scene, do="setattr(os, 'replace', lambda *names: open('/proc/nothing', 'w'))", check=False)
    assert done.returncode == 2 and done.stderr.count("beam_0002_r0001.vtu could not be written") == 1, done.stderr
    assert "MPI_ABORT" not in done.stderr and summary(scene.with_suffix(""))["status"] == "failed"


@pytest.mark.slow
def test_a_partition_file_is_the_mesh_of_a_scene(on_ranks, tmp_path, capsys):
    h5py = pytest.importorskip("h5py")
    assert main(["partition", str(BRACKET.with_name("bracket.msh")), str(tmp_path / "bracket.h5"), "--parts", "4"]) == 0
    divided = ["solve", str(BRACKET), "--set", f"mesh.file={tmp_path / 'bracket.h5'}", "--out", str(tmp_path / "out")]
    done = command(on_ranks, 2, *divided)
    assert "as expected bolts.z" in done.stdout and "Pictures" in (tmp_path / "out" / "report.html").read_text()
    assert summary(tmp_path / "out")["results"]["tip.z"] == pytest.approx(-1.0229937e-3, rel=1e-6)
    alone = [*divided[:-1], str(tmp_path / "alone")]
    assert main(alone) == 2 and "bracket.h5 is a partition file, for several ranks" in capsys.readouterr().err
    data = bytearray((tmp_path / "bracket.h5").read_bytes())
    with h5py.File(tmp_path / "bracket.h5") as file:
        data[file["parts/3/p"].id.get_offset()] ^= 1  # of the last part, which rank 1 reads
    (tmp_path / "bracket.h5").write_bytes(data)
    done = command(on_ranks, 2, *divided, "--force", check=False)
    assert done.returncode == 2 and "MPI_ABORT" not in done.stderr, done.stderr
    assert done.stderr.count("bracket.h5 is damaged: /parts/3 was changed after it was written") == 1


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["--set", "fixed.left=q"], "fixed.left"),
        (["--set", "terms[1].on=up"], "there is no place 'up'"),
        (["--set", "mesh.size=[1,1]", "--set", "mesh.cells=[1,1]"], "from 1 to the 2 elements"),
        (["--out", "/proc/here"], "cannot be written"),
    ],
)
def test_an_error_of_all_ranks_is_printed_once(on_ranks, scene, settings, words):
    """Errors of the scene, of a location on no rank, of the mesh that one rank has, and of the folder that one rank writes."""
    done = command(on_ranks, 3 if "mesh" in settings[-1] else 2, "solve", scene, *settings, check=False)
    assert done.returncode == 2 and "MPI_ABORT" not in done.stderr, done.stderr
    assert done.stderr.count("error ") == 1 and words in done.stderr.replace("\n", " "), done.stderr


@pytest.mark.slow
def test_warnings_of_all_ranks_are_printed_once_and_each_rank_has_its_log(on_ranks, scene):
    do = "warn('on both ranks'), warn(f'on rank {rank}')"
    done = command(on_ranks, 2, "solve", scene, "--log-ranks", do=do, when="len(steps) == 2")
    for text in ("on both ranks", "on rank 0", "on rank 1"):
        assert done.stderr.count(f"note {text}") == 1
    assert summary(scene.with_suffix(""))["warnings"] == ["on both ranks", "on rank 0", "on rank 1"]
    log = (scene.parent / "beam.rank-1.txt").read_text()
    assert log.count("note on rank 1") == 1 and "note on rank 0" not in log and "t 1 " in log


@pytest.mark.slow
def test_commands_for_one_machine_and_foreign_launchers_are_refused(on_ranks, scene):
    done = command(on_ranks, 2, "sweep", scene, "--set", "analysis.steps=1,2", check=False)
    assert done.returncode == 2 and done.stderr.count("skfem-stvk sweep on 2 ranks: expected one process") == 1
    alone = ["env", "OMPI_COMM_WORLD_SIZE=2", sys.executable, "-m", "skfem_stvk.scenes.commands", "solve", str(scene)]
    done = on_ranks(1, None, command=alone, check=False)
    assert done.returncode == 2 and "ranks = 1; expected 2, the number of processes that were started" in done.stderr


def test_without_mpi4py_the_error_says_how_to_install_it(monkeypatch, capsys, scene):
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    for module in [name for name in sys.modules if name.startswith("skfem_stvk.ranks")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "0")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    assert main(["solve", str(scene)]) == 2
    assert (
        "need mpi4py and a library of MPI: " in (said := capsys.readouterr().err) and 'pip install "skfem-stvk[mpi-wheel]"' in said
    )
