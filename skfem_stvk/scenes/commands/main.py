"""The command `skfem-stvk`."""

from __future__ import annotations

import argparse
import io
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from typing import Any

from rich.console import Console

from ...about import launched
from ...errors import AnalysisError, StvkError, StvkWarning
from ...terminal import BAD_INPUT, INTERRUPTED, console, printable, unfailing_output
from . import budget, referee, scenes, warm_up
from . import on_several_ranks as ranks


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code.

    The code is 0 for success, 1 if a check failed or a solve did not converge, and 2 for bad input. It is 3 if a scene does not
    meet its expectations, and 130 if the command was interrupted.
    """
    with ranks.only_first_prints():
        options = _parser().parse_args(arguments)
        with unfailing_output() if options.to_files else nullcontext():
            return _run(options)


def _run(options: argparse.Namespace) -> int:
    """Run a command on this process or all ranks, print its warnings and its error, and return its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files may be invalid text
    notes = console(stderr=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", StvkWarning)
            warnings.showwarning = partial(_show, notes, warnings.showwarning)
            code: int = ranks.run(options) if launched()[1] > 1 else options.run(options)
            return code
    except AnalysisError:  # an unforeseen error interrupted the analysis
        raise
    except (StvkError, OSError) as error:
        notes.print(f"[bold red]error[/] {printable(_with_options(str(error)))}", soft_wrap=True)
        return BAD_INPUT
    except KeyboardInterrupt:
        notes.print("[yellow]interrupted[/]")
        return INTERRUPTED


def _with_options(text: str) -> str:
    """Return a message of the library with the options of the command line in place of arguments in Python.

    >>> _with_options("Start again: overwrite=True, without resume.")
    'Start again: --force, without --resume.'
    """
    return text.replace("overwrite=True", "--force").replace("without resume", "without --resume")


def _show(notes: Console, otherwise: Callable[..., None], message: Warning | str, *details: Any, **more: Any) -> None:
    """Print a warning of this package as a note, and any other as Python shows it."""
    if isinstance(message, StvkWarning):
        notes.print(f"[yellow]note[/] {printable(str(message))}", soft_wrap=True)
    else:
        otherwise(message, *details, **more)


@dataclass(frozen=True)
class Command:
    """Command `skfem-stvk NAME`: the function that runs it and returns the exit code, its line of help, the function that adds its
    arguments, and whether it runs on several ranks. A command whose results are files goes on if it cannot print.
    """

    run: Callable[[argparse.Namespace], int]
    help: str
    add_arguments: Callable[[argparse.ArgumentParser], None] | None = None
    on_ranks: bool = False
    to_files: bool = False


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="skfem-stvk", description="St. Venant-Kirchhoff elasticity from edges, and its referee.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, command in COMMANDS.items():
        one = commands.add_parser(name, help=command.help, description=command.run.__doc__)
        if command.add_arguments is not None:
            command.add_arguments(one)
        one.set_defaults(run=command.run, command=name, on_ranks=command.on_ranks, to_files=command.to_files)
    return parser


#: All commands, by their names.
COMMANDS = {
    "init": Command(scenes.init, "print a commented example of a scene", scenes.init_arguments),
    "solve": Command(
        scenes.solve, "solve a scene: a whole job in one TOML file", scenes.solve_arguments, on_ranks=True, to_files=True
    ),
    "sweep": Command(
        scenes.solve_product,
        "solve a scene for all combinations of values, in parallel processes",
        scenes.sweep_arguments,
        to_files=True,
    ),
    "partition": Command(
        ranks.partition, "divide a mesh for ranks of MPI, into one file", ranks.partition_arguments, to_files=True
    ),
    "verify": Command(referee.check, "check W, F and K against scikit-fem's on a mesh", referee.verify_arguments),
    "verify-law": Command(
        referee.check_law, "check W(F), stress and tangent of a law, without a mesh", referee.verify_law_arguments
    ),
    "export": Command(referee.export, "write test vectors for codes that are not Python", referee.export_arguments, to_files=True),
    "bench": Command(
        referee.name_the_benchmark,
        "print the command of the benchmark, which needs a checkout of the project",
        referee.bench_arguments,
    ),
    "budget": Command(budget.budget, "measure what fits in a time step: full and reduced bodies of a mesh", budget.add_arguments),
    "warm-up": Command(warm_up.warm_up, "compile kernels ahead, on all cores", warm_up.add_arguments, to_files=True),
    "info": Command(
        scenes.info, "inspect a scene or a mesh, and report its faults; without a file: versions", scenes.info_arguments
    ),
}


if __name__ == "__main__":
    sys.exit(main())
