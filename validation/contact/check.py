"""Measured numbers with their expected values and allowed errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..study import Study


class Check(NamedTuple):
    """Measured number of a case, with the expected number or without.

    Attributes
    ----------
    case
        Case and quantity, in words.
    measured, expected
        Measured value, and expected value.
    allowed
        Largest error.
    """

    case: str
    measured: float
    expected: float | None = None
    allowed: float = float("inf")

    @property
    def error(self) -> float:
        """Error relative to the expected value; absolute if that is zero, and zero without an expected value."""
        return 0.0 if self.expected is None else (self.measured - self.expected) / (self.expected or 1.0)

    @property
    def row(self) -> tuple[str, ...]:
        """Cells of the table."""
        others = ("",) * 3 if self.expected is None else (f"{self.expected:.6g}", f"{self.error:+.1e}", f"{self.allowed:g}")
        return self.case, f"{self.measured:.6g}", *others


def study_of(name: str, claim: str, checks: Sequence[Check], *notes: str) -> Study:
    """Return the study of these numbers. It fails where an error is larger than allowed, or not a number."""
    failures = [
        f"{one.case}: {one.measured:.6g}; expected {one.expected:.6g}, error {one.error:+.1e}, allowed {one.allowed:g}"
        for one in checks
        if not abs(one.error) <= one.allowed
    ]
    columns = ("case", "measured", "expected", "error", "allowed")
    return Study(name, claim, columns, tuple(one.row for one in checks), tuple(failures), notes)
