"""`python -m validation STUDY`: run the studies that the README and the docs quote."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from inspect import signature

from skfem_stvk.errors import StvkError

from . import (
    bench,
    contact,
    distributed,
    dynamics,
    elements,
    fuzz,
    hard,
    hostile,
    models,
    operations,
    part,
    protection,
    reduced,
    solvers,
    stability,
    statics,
)
from .report import catalogue, report

#: Studies. The parameters of their functions are the options of the command.
STUDIES: dict[str, Callable[..., int]] = {
    study.__name__.rpartition(".")[2]: study.main
    for study in (
        *(part, bench, distributed, operations, solvers, statics, hard, stability, dynamics, elements, models, reduced, contact),
        *(hostile, fuzz, protection),
    )
}
#: Parts of a study that `--only` selects.
PARTS = {
    study.__name__.rpartition(".")[2]: study.NAMES
    for study in (statics, hard, stability, dynamics, elements, models, reduced, contact, hostile, protection)
}


def main() -> int:
    """Run one study, or all claims of all parts into one report; the exit code is 0 if all claims hold."""
    parser = argparse.ArgumentParser(
        prog="python -m validation",
        description=f"{__doc__} Without a study: all claims in one report; `report GROUP ...` for some.",
    )
    _report_arguments(parser)
    commands = parser.add_subparsers(dest="study", metavar="STUDY")
    some = commands.add_parser("report", help="the report on some groups", description="the report on some groups")
    some.add_argument("groups", nargs="+", choices=list(catalogue.PARTS), metavar="GROUP", help=", ".join(catalogue.PARTS))
    _report_arguments(some)
    for name, study in STUDIES.items():
        options = signature(study).parameters
        command = commands.add_parser(name, help=study.__doc__, description=study.__doc__)
        if "quick" in options:
            command.add_argument("--quick", action="store_true", help="smaller meshes, as in the tests")
        if "only" in options:
            names = PARTS[name]
            command.add_argument("--only", action="append", default=[], choices=names, metavar="NAME", help=", ".join(names))
        if "case" in options:
            command.add_argument(
                "--case", action="append", default=[], metavar="FAMILY/CASE", help="run this case only, with its full output"
            )
        if "cases" in options:
            command.add_argument(
                "--cases", type=int, default=2000, metavar="N", help="least number of random cases, 2000 by default"
            )
            command.add_argument("--seconds", type=float, metavar="S", help="start no new cases after this time")
            command.add_argument("--seed", type=int, default=0, help="seed of the first cases, 0 by default")
        if "again" in options:
            command.add_argument("--list", action="store_true", dest="listed", help="print the mutants, and run nothing")
            command.add_argument("--again", action="store_true", help="judge mutants again that have a verdict")
        if "out" in options:
            command.add_argument("--out", metavar="FOLDER", help="write pictures and tables to this folder")
    arguments = vars(parser.parse_args())
    name = arguments.pop("study")
    if name not in STUDIES:
        try:
            return report(**arguments)
        except StvkError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    study = STUDIES[name]
    return study(**{option: arguments[option] for option in signature(study).parameters})


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="smaller meshes, a few minutes")
    parser.add_argument("--out", metavar="FOLDER", help="write validation.html and validation.json to this folder")
    parser.add_argument("--speed", action="store_true", help="also run the claims about time and growth")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted run with the same folder --out")
    parser.add_argument("--compare", metavar="FILE", help="validation.json of an earlier run; report the changes")


if __name__ == "__main__":
    sys.exit(main())
