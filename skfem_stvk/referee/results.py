"""Results of checks, tasks that produce one result each, and explanations of faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

from .implementations import METHODS, ContractViolation, Implementation


class CheckOutcome(Enum):
    """Outcome of a check. The value is the message."""

    PASSED = "passed"
    FAILED = "failed"
    COULD_NOT_RUN = "could not run"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True)
class Result:
    """Result of one check of one quantity in one state.

    Attributes
    ----------
    check
        Name of the check, such as "agreement".
    subject
        Name of the model whose W, F or K was checked.
    quantity
        Quantity "W", "F", "K", or the name of another measured quantity.
    state
        Name of the state.
    outcome
        Outcome of the check.
    against
        Name of the reference.
    measured, limit
        Error and its limit, relative to `scale`; None if nothing was measured.
    scale
        Value and meaning of the scale that the error is relative to.
    reason
        Reason for the limit, or the reason why the check did not run or does not apply.
    worst
        The worst locations: dof, node, component, elements.
    """

    check: str
    subject: str
    quantity: str
    state: str
    outcome: CheckOutcome
    against: str = ""
    measured: float | None = None
    limit: float | None = None
    scale: str = ""
    reason: str = ""
    worst: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the result in JSON types. A measured value that is not finite becomes text."""
        entries = asdict(self) | {"outcome": self.outcome.value}
        if self.measured is not None and not math.isfinite(self.measured):
            entries["measured"] = str(self.measured)
        return entries


def judged(measured: float, limit: float, **entries: Any) -> Result:
    """Return the result of a measurement. It is passed if `measured <= limit`; nan fails.

    >>> judged(float("nan"), 1e-12, check="a", subject="b", quantity="F", state="rest").outcome
    <CheckOutcome.FAILED: 'failed'>
    """
    outcome = CheckOutcome.PASSED if measured <= limit else CheckOutcome.FAILED
    return Result(outcome=outcome, measured=float(measured), limit=limit, **entries)


def largest(results: Iterable[Result]) -> float:
    """Return the largest finite measured error, or 0 if there is none."""
    return max((r.measured for r in results if r.measured is not None and math.isfinite(r.measured)), default=0.0)


class NotApplicable(Exception):
    """Exception of a check that does not apply. The message gives the reason."""


class CannotDecide(Exception):
    """Exception of a check that ran but could not decide. The message gives the reason."""


@dataclass(frozen=True)
class Task:
    """Check of one quantity of one implementation in one state.

    `needs` names the quantities among W, F and K that the implementation must have. `measure` returns the keyword arguments of
    `judged`, at least `measured` and `limit`.
    """

    check: str
    implementation: Implementation
    quantity: str
    state: str
    needs: str
    measure: Callable[[], dict[str, Any]]
    against: str = ""

    @property
    def _labels(self) -> dict[str, Any]:
        labels = {name: getattr(self, name) for name in ("check", "quantity", "state", "against")}
        return labels | {"subject": self.implementation.name}

    def missed(self, reason: str, outcome: CheckOutcome = CheckOutcome.COULD_NOT_RUN) -> Result:
        """Return the result of a task that could not run or does not apply."""
        return Result(outcome=outcome, reason=reason, **self._labels)

    def run(self) -> Result:
        """Return the result of the measurement. Exceptions become results."""
        lacking = [f"{METHODS[quantity]}(u)" for quantity in self.needs if not self.implementation.has(quantity)]
        if lacking:
            return self.missed(f"{self.implementation.name} has no {' and no '.join(lacking)}", CheckOutcome.NOT_APPLICABLE)
        try:
            return judged(**self._labels, **self.measure())
        except NotApplicable as why:
            return self.missed(str(why), CheckOutcome.NOT_APPLICABLE)
        except (ContractViolation, CannotDecide) as why:
            return self.missed(str(why))
        except Exception as error:
            return self.missed(f"{type(error).__name__}: {error}")


@dataclass(frozen=True)
class Explanation:
    """Hypothesis on the fault of a candidate: its name, a sentence, and its largest relative residual."""

    name: str
    words: str
    residual: float


@dataclass
class Naming:
    """Explanations of the candidate's values. Several explanations are equivalent on this body.

    Attributes
    ----------
    explanations
        All hypotheses with a vanishing residual.
    tried
        Number of hypotheses that were tried.
    before
        The largest relative error without a hypothesis.
    smallest
        Text on the smallest failing piece if there is no explanation, or on the unexplained rest if there is a partial one.
    """

    explanations: list[Explanation] = field(default_factory=list)
    tried: int = 0
    before: float = 0.0
    smallest: str = ""

    def explain(self, hypotheses: Iterable[Explanation], limit: float = math.inf) -> bool:
        """Try hypotheses, append those with a finite residual of at most `limit`, and return whether there are any."""
        tried = list(hypotheses)
        fitting = [one for one in tried if one.residual <= limit and math.isfinite(one.residual)]
        self.tried += len(tried)
        self.explanations += fitting
        return bool(fitting)

    @property
    def names(self) -> list[str]:
        """Names of the explanations."""
        return [one.name for one in self.explanations]

    def lines(self) -> list[str]:
        """Return the lines of a report."""
        if not self.explanations:
            smallest = f" {self.smallest}" if self.smallest else ""
            return [f"No hypothesis explains the failure: {self.tried} were tried.{smallest}"]
        one = "This explains" if len(self.explanations) == 1 else "These are equivalent on this body, and explain"
        after = max(explanation.residual for explanation in self.explanations)
        falls = f"; the error falls from {self.before:.1e} to {after:.1e}" if after < self.before else ""
        much, rest = ("a part of it", [self.smallest]) if self.smallest else ("all of it", [])
        return [f"{one} {much}{falls}:", *(f"{e.name}: {e.words}" for e in self.explanations), *rest]

    def to_dict(self) -> dict[str, Any]:
        """Return all attributes in JSON types."""
        names = [vars(explanation) for explanation in self.explanations]
        before = self.before if math.isfinite(self.before) else str(self.before)
        return {"explanations": names, "tried": self.tried, "error before": before, "smallest": self.smallest}
