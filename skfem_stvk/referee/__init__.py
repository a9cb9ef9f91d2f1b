"""Checks of anybody's W, F and K behind the function `verify`."""

from .report import Report
from .results import Outcome, Result
from .verification import verify

__all__ = ["Outcome", "Report", "Result", "verify"]
