"""Self-test of the referee: every check runs on every planted fault, and each fault must be detected and named."""

from __future__ import annotations

import io
import json
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console, Group, RenderableType

from ..arguments import flag, whole
from ..system import System
from ..terminal import CountedProgress, as_text, grid, printable
from .faults import FAULTS, bodies
from .report import folder_for, write
from .verification import failures_of, name_of

#: Columns of the matrix: the name of each check, and the meaning of the letters in its cells.
CHECKS = {
    "agreement": "W, F, K",
    "derivatives": "F, K",
    "memory": "W, F, K",
    "invariance": "W, F, K",
    "balance": "f: sum of forces, t: sum of torques",
    "symmetry": "K",
    "rigid modes": "K",
    "no further zero mode": "K",
    "closed forms": "W, P",
    "patch test": "F",
    "precision": "F",
}
SHORT_NAMES = {
    "agreement": "agree",
    "derivatives": "deriv.",
    "memory": "mem.",
    "invariance": "invar.",
    "symmetry": "symm.",
    "rigid modes": "rigid",
    "no further zero mode": "zero",
    "closed forms": "closed",
    "patch test": "patch",
    "precision": "digits",
}
LETTERS = {"sum of forces": "f", "sum of torques": "t"}
#: Checks that need not detect a fault alone, with the checks that they replace where these cannot decide, and the situation.
#: Without the replaced checks, each must detect at least one fault alone.
BACKS_UP: dict[str, tuple[tuple[str, ...], str]] = {
    "derivatives": (("agreement",), "for other laws, which have no reference"),
    "invariance": (("agreement", "derivatives", "closed forms", "precision"), "if only W of another law is known"),
    "balance": (("agreement", "derivatives", "invariance", "closed forms", "precision"), "it identifies the fault of F"),
    "symmetry": (("agreement", "derivatives", "invariance", "rigid modes"), "if only K of another law is known"),
    "rigid modes": (("agreement", "derivatives", "invariance"), "if only K at rest is known"),
    "no further zero mode": (("agreement", "derivatives", "invariance"), "if only K at rest is known"),
    "closed forms": (("agreement", "precision"), "which need a reference"),
    "patch test": (("agreement", "closed forms", "precision"), "for other laws, whose closed forms are not known"),
}


@dataclass
class SelfTest:
    """Result of the self-test: the faults that each check detects.

    Attributes
    ----------
    caught
        Quantities that failed by fault and check, as in `"WFK"`.
    named
        Names that a report gives each fault.
    false_alarms
        Quantities of the correct model that failed, by body and check. There must be none, or the test is invalid.
    seconds
        Duration of the test [s].
    """

    caught: dict[str, dict[str, str]] = field(default_factory=dict)
    false_alarms: dict[str, dict[str, str]] = field(default_factory=dict)
    named: dict[str, list[str]] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def missed(self) -> list[str]:
        """Faults that no check detects."""
        return [name for name, checks in self.caught.items() if not checks]

    @property
    def unnamed(self) -> list[str]:
        """Faults that have a name but do not get it."""
        return [fault for fault, names in self.named.items() if FAULTS[fault].named and FAULTS[fault].named not in names]

    @property
    def wrong_names(self) -> dict[str, list[str]]:
        """Wrong names that each fault gets, by fault."""
        wrong = {fault: [name for name in names if name != FAULTS[fault].named] for fault, names in self.named.items()}
        return {fault: names for fault, names in wrong.items() if names}

    def alone(self, check: str, without: tuple[str, ...] = ()) -> list[str]:
        """Return the faults that only this check detects if the checks `without` are ignored."""
        return [name for name, checks in self.caught.items() if set(checks) - set(without) == {check}]

    @property
    def idle(self) -> list[str]:
        """Checks that detect no fault alone, even without the checks that they back up."""
        return [check for check in CHECKS if not (self.alone(check) or self.alone(check, *BACKS_UP.get(check, ())[:1]))]

    @property
    def passed(self) -> bool:
        """Whether every fault is detected and named, no check is idle, and correct models pass."""
        wrong = self.missed or self.idle or any(self.false_alarms.values()) or self.unnamed or self.wrong_names
        return bool(self.caught) and not wrong

    def __str__(self) -> str:
        return as_text(self.rendered())

    def rendered(self, width: int = 124) -> RenderableType:
        """Return the matrix of faults and checks for a rich console."""
        table = grid(
            "Planted faults, and what fails of each check", "fault", "body", *(SHORT_NAMES.get(check, check) for check in CHECKS)
        )
        for name, checks in self.caught.items():
            table.add_row(name, FAULTS[name].body, *(checks.get(check, "") for check in CHECKS))
        lines = [f"[bold]{check}[/] ({letters}): {printable(self._use(check))}" for check, letters in CHECKS.items()]
        false_alarms = [
            f"[bold red]the correct model fails[/] on {body}: {checks}" for body, checks in self.false_alarms.items() if checks
        ]
        missed = [f"[bold red]not caught[/]: {printable(name)}" for name in self.missed]
        named = [f"[bold red]not named[/]: {printable(name)}" for name in self.unnamed]
        wrong = [f"[bold red]wrong name[/]: {printable(f'{fault}: {names}')}" for fault, names in self.wrong_names.items()]
        return Group(table, *lines, *false_alarms, *missed, *named, *wrong, self._names(), self._verdict())

    def _names(self) -> str:
        nameable = [fault for fault in self.named if FAULTS[fault].named]
        others = len(self.named) - len(nameable)
        wrong = sum(map(len, self.wrong_names.values()))
        return (
            f"[bold]names[/]: {len(nameable) - len(self.unnamed)} of {len(nameable)} faults get their name; "
            f"{others} have no name; wrong names: {wrong}"
        )

    def _use(self, check: str) -> str:
        caught, alone = sum(check in checks for checks in self.caught.values()), self.alone(check)
        words = f"catches {caught}"
        if alone:
            words += f", alone: {', '.join(alone)}"
        if check in BACKS_UP:
            others, where = BACKS_UP[check]
            words += f"; backs up {', '.join(others)}: {where}; without them alone {len(self.alone(check, others))}"
        return words

    def _verdict(self) -> str:
        word, style = ("PASSED", "bold green") if self.passed else ("NOT PASSED", "bold red")
        caught = len(self.caught) - len(self.missed)
        return f"[{style}]{word}[/]: {caught} of {len(self.caught)} faults caught by {len(CHECKS)} checks in {self.seconds:.0f} s"

    def to_dict(self) -> dict[str, Any]:
        """Return all results in JSON types."""
        faults = {
            name: {
                "description": FAULTS[name].description,
                "body": FAULTS[name].body,
                "caught by": checks,
                "named": self.named.get(name, []),
            }
            for name, checks in self.caught.items()
        }
        uses = {check: {"letters": letters, "use": self._use(check)} for check, letters in CHECKS.items()}
        return {"passed": self.passed, "seconds": self.seconds, "faults": faults, "checks": uses, "right": self.false_alarms}

    def save(self, folder: str | Path) -> Path:
        """Write `self-test.json` and `self-test.html` into a folder, and return its path.

        The folder is created if it is missing. Errors are those of `Report.save`.
        """
        folder = folder_for(folder)
        write(folder / "self-test.json", json.dumps(self.to_dict(), indent=1))
        console = Console(record=True, width=140, file=io.StringIO(), highlight=False)
        console.print(self.rendered(140))
        write(folder / "self-test.html", console.export_html())
        return folder


def self_test(*, seed: int = 0, quiet: bool = False) -> SelfTest:
    """Run every check of `verify` against every planted fault.

    A fault is a copy of the model with one error. It replaces this package in all checks, on a small body on which the error has an
    effect. Correct models must pass on all bodies.

    Raises
    ------
    StvkError
        if an argument is invalid.

    Examples
    --------
    >>> from skfem_stvk.referee.self_test import SelfTest
    >>> SelfTest(caught={"a fault": {}}).missed
    ['a fault']
    """
    seed, quiet = whole("seed", seed, "a whole number from 0"), flag("quiet", quiet)
    started, found, test_bodies = time.perf_counter(), SelfTest(), bodies()
    with CountedProgress("verify --self-test", len(FAULTS) + len(test_bodies), quiet) as progress:
        for name, body in test_bodies.items():
            progress.step(f"correct model, {name}")
            found.false_alarms[name] = _letters(
                failures_of(partial(System, **body.options), body.mesh, body.terms, body.options, seed)
            )
        for name, fault in FAULTS.items():
            progress.step(name)
            body = test_bodies[fault.body]
            found.caught[name] = _letters(failures_of(fault.make, body.mesh, body.terms, body.options, seed))
            found.named[name] = name_of(fault.make, body.mesh, body.terms, body.options, seed).names
    found.seconds = time.perf_counter() - started
    return found


def _letters(results: list[Any]) -> dict[str, str]:
    """Return the quantities that failed, by check, in the order of the columns."""
    found: dict[str, str] = {}
    for check in CHECKS:
        quantities = dict.fromkeys(LETTERS.get(r.quantity, r.quantity) for r in results if r.check == check)
        if quantities:
            found[check] = "".join(sorted(quantities, key="WFKPft".index))
    return found
