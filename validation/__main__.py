"""`python -m validation STUDY`: the studies whose figures stand in the README and the docs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from . import (
    aspect,
    clamp,
    dynamics,
    elements,
    hard,
    hostile,
    kernels,
    models,
    operations,
    part,
    reduced,
    response,
    rows,
    solvers,
    stability,
    statics,
)

#: Studies and the options that they take.
STUDIES: dict[str, tuple[Callable[..., int], tuple[str, ...]]] = {
    "part": (part.main, ()),
    "aspect": (aspect.main, ()),
    "clamp": (clamp.main, ("quick",)),
    "kernels": (kernels.main, ("quick",)),
    "operations": (operations.main, ()),
    "response": (response.main, ("quick",)),
    "rows": (rows.main, ("quick",)),
    "solvers": (solvers.main, ("quick",)),
    "statics": (statics.main, ("quick", "only", "out")),
    "hard": (hard.main, ("quick", "only", "out")),
    "stability": (stability.main, ("quick", "only", "out")),
    "dynamics": (dynamics.main, ("quick", "only", "out")),
    "elements": (elements.main, ("quick", "only", "out")),
    "models": (models.main, ("quick", "only", "out")),
    "reduced": (reduced.main, ("quick", "only", "out")),
    "hostile": (hostile.main, ("quick", "only", "case")),
}

#: Parts of a study that `--only` picks.
PARTS = {
    "statics": (*statics.NAMES, *statics.ON_DEMAND),
    "hard": hard.NAMES,
    "stability": stability.NAMES,
    "dynamics": dynamics.NAMES,
    "elements": elements.NAMES,
    "models": models.NAMES,
    "reduced": reduced.NAMES,
    "hostile": hostile.NAMES,
}


def main() -> int:
    """Run one study; the exit code is 0 if it ended as it must."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    commands = parser.add_subparsers(dest="study", required=True, metavar="STUDY")
    for name, (study, options) in STUDIES.items():
        command = commands.add_parser(name, help=study.__doc__, description=study.__doc__)
        if "quick" in options:
            command.add_argument("--quick", action="store_true", help="smaller meshes, as the tests run it")
        if "only" in options:
            names = PARTS[name]
            command.add_argument("--only", action="append", default=[], choices=names, metavar="NAME", help=", ".join(names))
        if "case" in options:
            command.add_argument(
                "--case", action="append", default=[], metavar="FAMILY/CASE", help="just this one, with all that it says"
            )
        if "out" in options:
            command.add_argument("--out", metavar="FOLDER", help="write pictures and tables there")
    arguments = vars(parser.parse_args())
    study, _ = STUDIES[arguments.pop("study")]
    return study(**arguments)


if __name__ == "__main__":
    sys.exit(main())
