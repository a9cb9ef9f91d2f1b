"""One report on all claims: is the mathematics coded right, are its solutions resolved, and do they meet published values?"""

from .job import Claim, Kind
from .report import report

__all__ = ["Claim", "Kind", "report"]
