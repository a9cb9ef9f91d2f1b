"""Outcome of a scene: the result, the curves of probes and reactions, and the comparison with expectations."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan
from pathlib import Path
from typing import Any, NamedTuple

from ..arguments import Array
from ..terminal import DONE, INTERRUPTED, NOT_AS_EXPECTED, NOT_PASSED, duration
from .build import Built


class Curve(NamedTuple):
    """Curve over time: the mean displacement of a probe, or the force of supports at a location."""

    t: Array  # (n,) times, or load factors
    values: Array  # (n, d) components
    dimension: str  # "length" or "force"


class ComparedResult(NamedTuple):
    """Result with its expectation."""

    name: str  # as `tip.z`
    got: float | None  # None where it does not exist
    expected: float
    allowed: float  # the largest difference
    passed: bool


class SummaryRow(NamedTuple):
    """Result that matters most, in words."""

    name: str  # as "largest displacement"
    value: str  # with its unit
    where: str = ""  # its location


def as_printed(value: float | None) -> str:
    """Return a result with nine digits; "-" for one that does not exist."""
    return "-" if value is None or isnan(value) else f"{value:.9g}"


@dataclass(frozen=True, eq=False)
class SceneOutcome:
    """Outcome of a scene.

    Attributes
    ----------
    built
        The scene with its system.
    result
        Result of the analysis, a `StaticResult`, `Run` or `Modes`.
    success, status, message
        Whether the analysis succeeded, its status in a word, and the full message.
    curves
        Probes and reactions by name, over the times or load factors.
    values
        Results at the end by dotted name, such as `energy.strain` and `tip.z`. NaN for an energy that does not exist.
    judged
        Results with their expectations.
    summary
        Results that matter most, with units and locations.
    seconds
        Duration of the analysis.
    folder
        Folder of results, if they were written.
    warnings
        Texts of the warnings on the way.
    ranks
        Number of ranks and the sizes of their parts; empty on one machine.
    """

    built: Built
    result: Any
    success: bool
    status: str
    message: str
    curves: dict[str, Curve]
    values: dict[str, float]
    judged: tuple[ComparedResult, ...]
    summary: tuple[SummaryRow, ...]
    seconds: float
    folder: Path | None = None
    warnings: tuple[str, ...] = field(default=())
    ranks: str = ""

    @property
    def headline(self) -> str:
        """Status and message; the status only where the message does not say it."""
        said = self.status.split()[0] in self.message.lower()
        return self.message if said else f"{self.status}: {self.message}"

    @property
    def seconds_by_stage(self) -> str:
        """Duration of the analysis, and of its parts where they were measured."""
        parts = ", ".join(f"{name} {duration(seconds)}" for name, seconds in getattr(self.result, "seconds", {}).items() if seconds)
        return duration(self.seconds) + (f" ({parts})" if parts else "")

    @property
    def exit_code(self) -> int:
        """Exit code: 0 if the analysis converged and all expectations hold, 1 if it did not converge, 3 if an expectation failed,
        130 if interrupted.
        """
        if self.status == "interrupted":
            return INTERRUPTED
        if not self.success:
            return NOT_PASSED
        return DONE if all(one.passed for one in self.judged) else NOT_AS_EXPECTED
