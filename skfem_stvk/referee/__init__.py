"""Checks of the W, F and K of this package or of any other code. The entry point is the function `verify`."""

from .report import Report
from .results import CheckOutcome, Result
from .verification import verify

__all__ = ["CheckOutcome", "Report", "Result", "verify"]
