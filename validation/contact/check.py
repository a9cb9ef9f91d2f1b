"""Measured numbers with their expected values and allowed errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..statics.study import Study


class Check(NamedTuple):
    """Measured number of a case.

    Attributes
    ----------
    case
        Case and quantity, in words.
    measured, expected
        Measured value, and expected value; NaN for a value that is published without an expectation.
    allowed
        Largest error, relative to the expected value if that is not zero.
    """

    case: str
    measured: float
    expected: float = float("nan")
    allowed: float = float("inf")

    @property
    def error(self) -> float:
        """Error of the measured value, relative to the expected value if that is not zero."""
        return (self.measured - self.expected) / (self.expected or 1.0)

    @property
    def is_published_only(self) -> bool:
        """Whether the value has no expectation."""
        return self.expected != self.expected

    @property
    def row(self) -> tuple[str, ...]:
        """Cells of the table."""
        if self.is_published_only:
            return self.case, f"{self.measured:.6g}", "", "", ""
        return self.case, f"{self.measured:.6g}", f"{self.expected:.6g}", f"{self.error:+.1e}", f"{self.allowed:g}"


def study_of(name: str, claim: str, checks: Sequence[Check], *notes: str) -> Study:
    """Return the study of these numbers. It fails where an error is larger than allowed, or not a number."""
    failures = [
        f"{one.case}: {one.measured:.6g}; expected {one.expected:.6g} to {one.allowed:g}"
        for one in checks
        if not (one.is_published_only or abs(one.error) <= one.allowed)
    ]
    columns = ("case", "measured", "expected", "error", "allowed")
    return Study(name, claim, columns, tuple(one.row for one in checks), tuple(failures), notes)
