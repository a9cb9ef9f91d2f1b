"""Checks of anybody's W, F and K behind the function `verify`."""

from .report import Report
from .results import CheckOutcome, Result
from .verification import verify

__all__ = ["CheckOutcome", "Report", "Result", "verify"]
