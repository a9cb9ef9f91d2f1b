"""The command `skfem-stvk`."""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType

from ..bench import FULL, QUICK, bench, page
from ..errors import StvkError, StvkWarning
from ..mesh import ElementMesh, embedded_mesh, read_mesh
from ..referee.terminal import WIDTH, printable, rendered
from ..referee.verification import verify
from ..terms import StVK
from . import scenes

#: Materials of the embedded mesh: a bracket of aluminium with a bushing of rubber; Poisson's ratios such that lambda != mu.
EMBEDDED = [StVK(young=70e9, poisson=0.33, region="bracket"), StVK(young=5e6, poisson=0.45, region="bushing")]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit code is 0 if all went well, 1 if a check did not pass or a solve did not converge, 2 for bad
    input, 3 if a scene is not as expected, 130 if it was interrupted."""
    options = _parser().parse_args(arguments)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be text
    console = Console(stderr=True, highlight=False)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", StvkWarning)
            warnings.showwarning = partial(_show, console, warnings.showwarning)
            code: int = options.run(options)
            return code
    except (StvkError, OSError) as error:
        console.print(f"[bold red]error[/] {printable(str(error))}", soft_wrap=True)
        return 2
    except KeyboardInterrupt:
        console.print("[yellow]interrupted[/]")
        return 130


def _show(console: Console, otherwise: Callable[..., None], message: Warning | str, *details: Any, **more: Any) -> None:
    """Our warnings as notes, all others as Python shows them."""
    if isinstance(message, StvkWarning):
        console.print(f"[yellow]note[/] {printable(str(message))}", soft_wrap=True)
    else:
        otherwise(message, *details, **more)


@dataclass(frozen=True)
class Command:
    """What `skfem-stvk NAME` runs, which gives the exit code; the line of the help; and what adds its arguments."""

    run: Callable[[argparse.Namespace], int]
    help: str
    add_arguments: Callable[[argparse.ArgumentParser], None] | None = None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="skfem-stvk", description="St. Venant-Kirchhoff elasticity from edges, and its referee.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        one = commands.add_parser(name, help=command.help, description=command.run.__doc__)
        if command.add_arguments is not None:
            command.add_arguments(one)
        one.set_defaults(run=command.run)
    return parser


def _verify_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mesh", nargs="?", help="mesh file that meshio reads; by default an embedded bracket of two materials")
    parser.add_argument("--young", type=float, help="Young's modulus [Pa]")
    parser.add_argument("--poisson", type=float, help="Poisson's ratio")
    parser.add_argument("--degree", type=int, help="1 or 2: of the shape functions of simplices, by default the mesh's")
    parser.add_argument("--quadrature", help="exact, or one-point for quadrilaterals and hexahedra; by default the usual rule")
    parser.add_argument("--hourglass", type=float, help="coefficient of the hourglass control of one-point elements")
    parser.add_argument("--out", metavar="FOLDER", help="write report.json and report.html there")
    parser.add_argument("--seed", type=int, default=0, help="of the random states, 0 by default")


def _verify(options: argparse.Namespace) -> int:
    """Hold W, F and K against scikit-fem's standard assembly and against what must be true; exit code 0 if all passed."""
    if options.out is not None:
        _refuse_unwritable(options.out)
    mesh, terms = _body(options)
    how = {name: getattr(options, name) for name in ("degree", "quadrature", "hourglass")}
    report = verify(mesh, terms, **how, seed=options.seed)
    report.header["mesh"]["source"] = "embedded bracket" if options.mesh is None else options.mesh
    _give(partial(rendered, report), WIDTH, report.save, options.out, "report.json and report.html")
    return 0 if report.passed else 1


def _bench_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="under two minutes; the full run takes about a quarter of an hour")
    parser.add_argument("--out", metavar="FOLDER", help="write benchmark.md, its pictures and benchmark.json there")


def _bench(options: argparse.Namespace) -> int:
    """Measure time, memory and errors of W, F, K and K v, of this package and of what else is installed; exit code 0 if all ran."""
    if options.out is not None:
        _refuse_unwritable(options.out)
    results = bench(QUICK if options.quick else FULL)
    files = "benchmark.md, its pictures and benchmark.json"
    _give(lambda width: page.rendered(results), page.WIDTH, partial(page.save, results), options.out, files)
    return 130 if results.interrupted else 1 if results.failures else 0


Rendering = Callable[[int], RenderableType]


def _give(rendering: Rendering, width: int, save: Callable[[str], object], folder: str | None, files: str) -> None:
    """Write results before anything is printed, as a closed pipe ends the program; what goes wrong waits until they are printed.

    Standard output is as wide as the terminal, or `width` if it is none.
    """
    failure = None
    try:
        if folder is not None:
            save(folder)
    except (StvkError, OSError) as error:
        failure = error
    console = Console(highlight=False)
    console = console if console.is_terminal else Console(highlight=False, width=width)
    console.print(rendering(console.width))
    if failure is not None:
        raise failure
    if folder is not None:
        console.print(f"{files} are in {printable(folder)}", soft_wrap=True)


def _body(options: argparse.Namespace) -> tuple[ElementMesh, list[StVK]]:
    given = options.young is not None or options.poisson is not None
    if options.mesh is not None and not given:
        raise StvkError("A mesh needs a material: add --young (Pa) and --poisson, e.g. --young 70e9 --poisson 0.33.")
    terms = [StVK(young=options.young, poisson=options.poisson)] if given else EMBEDDED
    return embedded_mesh() if options.mesh is None else read_mesh(options.mesh), terms


def _refuse_unwritable(name: str) -> None:
    """Before the work, say so if its results could not be written; nothing is made yet."""
    if not name:
        raise StvkError("--out is empty; expected the name of a folder, which is made if it is missing.")
    folder = Path(name)
    nearest = next(parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise StvkError(f"--out {folder}: {nearest} is a file; expected a folder, which is made if it is missing.")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise StvkError(f"--out {folder}: {nearest} cannot be written to. Choose another folder, or change its permissions.")


#: All commands, by their names.
COMMANDS = {
    "init": Command(scenes.init, "print a commented example of a scene", scenes.init_arguments),
    "solve": Command(scenes.solve, "solve a scene: a whole job in one TOML file", scenes.solve_arguments),
    "sweep": Command(scenes.solve_product, "solve a scene with the product of values, in processes", scenes.sweep_arguments),
    "verify": Command(_verify, "hold W, F and K against scikit-fem's on a mesh", _verify_arguments),
    "bench": Command(_bench, "time and memory of W, F, K and K v, against targets", _bench_arguments),
    "info": Command(
        scenes.info, "what would be built of a scene or a mesh, and what is wrong with it; alone: versions", scenes.info_arguments
    ),
}


if __name__ == "__main__":
    sys.exit(main())
