"""Report on all claims: code verification, solution verification, and validation against published values."""

from .job import Claim, Kind
from .report import report

__all__ = ["Claim", "Kind", "report"]
