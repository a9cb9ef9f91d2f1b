"""The report: all results with what they were measured on, and the verdict."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import arguments
from ..arguments import path
from ..errors import StvkError
from ..results.files import cannot_write, replacing
from .results import Outcome, Result


@dataclass
class Report:
    """What `verify` found.

    Attributes
    ----------
    header : versions, machine, mesh, material, command line, seed.
    results : every check of every quantity in every state.
    precision : rows of error against strain (`checks.precision`).
    speed : rows of time and memory (`checks.speed`).
    errors : errors against 50 digits that the speed is shown against.
    interrupted : whether it was stopped before the end.
    seconds : how long the verification took.
    """

    header: dict[str, Any]
    results: list[Result] = field(default_factory=list)
    precision: list[dict[str, Any]] = field(default_factory=list)
    speed: list[dict[str, Any]] = field(default_factory=list)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    interrupted: bool = False
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether it ran to the end, something was measured, and everything passed or is not applicable by nature."""
        counts = self.counts
        return counts[Outcome.PASSED] > 0 and not (counts[Outcome.FAILED] or counts[Outcome.COULD_NOT_RUN] or self.interrupted)

    @property
    def counts(self) -> Counter[Outcome]:
        """How many checks ended in which way."""
        return Counter(result.outcome for result in self.results)

    def failures(self, subject: str | None = None) -> list[Result]:
        """The results that failed, of one subject or of all.

        Raises
        ------
        StvkError
            if nothing was checked of this subject.
        """
        if subject is not None:
            subject = arguments.choice("subject", subject, {result.subject for result in self.results})
        return [r for r in self.results if r.outcome is Outcome.FAILED and subject in (None, r.subject)]

    def groups(self) -> dict[tuple[str, str, str, str], list[Result]]:
        """The results by check, subject, reference and quantity: the lines of a table."""
        groups: dict[tuple[str, str, str, str], list[Result]] = {}
        checks = list(dict.fromkeys(result.check for result in self.results))
        for result in sorted(self.results, key=lambda result: checks.index(result.check)):
            groups.setdefault((result.check, result.subject, result.against, result.quantity), []).append(result)
        return groups

    def to_dict(self) -> dict[str, Any]:
        """Everything, for JSON."""
        return {
            "passed": self.passed,
            "counts": {outcome.value: self.counts[outcome] for outcome in Outcome},
            "interrupted": self.interrupted,
            "seconds": self.seconds,
            "header": self.header,
            "results": [result.to_dict() for result in self.results],
            "precision": self.precision,
            "speed": self.speed,
            "errors": self.errors,
        }

    def save(self, folder: str | Path) -> Path:
        """Write `report.json` and `report.html` (one file that needs no other) into a folder, made if it is missing.

        Each is written beside its place and renamed into it: what stands there is whole.

        Raises
        ------
        StvkError
            if the folder cannot be written to, or a picture cannot be drawn.
        """
        folder = path("folder", folder, "the path of a folder")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise cannot_write(folder, error) from error
        _write(folder / "report.json", json.dumps(self.to_dict(), indent=1))
        _write(folder / "report.html", self._page())
        return folder

    def _page(self) -> str:
        try:
            from .page import page  # matplotlib is imported only when a page is made
        except (ImportError, ValueError) as error:
            raise StvkError(
                f"report.html needs matplotlib, which cannot be imported: {error}. "
                f"MPLBACKEND = {os.environ.get('MPLBACKEND', '')!r}; 'agg' always works. report.json is written."
            ) from error
        return page(self)

    def __str__(self) -> str:
        from .terminal import as_text

        return as_text(self)


def _write(path: Path, text: str) -> None:
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8", errors="backslashreplace")
