"""What a check says: four outcomes, the measured value, the limit and why it is that, and the worst places."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any


class Outcome(Enum):
    """The four ways in which a check can end; the value is the message."""

    PASSED = "passed"
    FAILED = "failed"
    COULD_NOT_RUN = "could not run"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True)
class Result:
    """One check of one quantity in one state.

    Attributes
    ----------
    check : name of the check, such as "agreement".
    subject : whose W, F or K was checked.
    quantity : "W", "F", "K" or what else was measured.
    state : name of the state.
    outcome : how it ended.
    against : what it was held against.
    measured, limit : relative to `scale`; None where there is nothing to measure.
    scale : value and meaning of what the error is relative to.
    reason : why the limit is what it is; or why the check did not run or does not apply.
    worst : the worst places: dof, vertex, component, elements.
    """

    check: str
    subject: str
    quantity: str
    state: str
    outcome: Outcome
    against: str = ""
    measured: float | None = None
    limit: float | None = None
    scale: str = ""
    reason: str = ""
    worst: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """For JSON: not a number, which JSON does not have, as text."""
        entries = asdict(self) | {"outcome": self.outcome.value}
        if self.measured is not None and not math.isfinite(self.measured):
            entries["measured"] = str(self.measured)
        return entries


def judged(measured: float, limit: float, **entries: Any) -> Result:
    """Passed if `measured <= limit`; a value that is not a number fails.

    >>> judged(float("nan"), 1e-12, check="a", subject="b", quantity="F", state="rest").outcome
    <Outcome.FAILED: 'failed'>
    """
    outcome = Outcome.PASSED if measured <= limit else Outcome.FAILED
    return Result(outcome=outcome, measured=float(measured), limit=limit, **entries)
