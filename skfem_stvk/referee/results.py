"""What a check says, how a task turns one measurement into that whatever happens, and all that a verification has found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any

from .. import arguments
from .players import METHODS, Foul, Player


class CheckOutcome(Enum):
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
    outcome: CheckOutcome
    against: str = ""
    measured: float | None = None
    limit: float | None = None
    scale: str = ""
    reason: str = ""
    worst: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The result in types that JSON has: what is not a number or infinite becomes text."""
        entries = asdict(self) | {"outcome": self.outcome.value}
        if self.measured is not None and not math.isfinite(self.measured):
            entries["measured"] = str(self.measured)
        return entries


def judged(measured: float, limit: float, **entries: Any) -> Result:
    """The result of a measurement: passed if `measured <= limit`; a value that is not a number fails.

    >>> judged(float("nan"), 1e-12, check="a", subject="b", quantity="F", state="rest").outcome
    <CheckOutcome.FAILED: 'failed'>
    """
    outcome = CheckOutcome.PASSED if measured <= limit else CheckOutcome.FAILED
    return Result(outcome=outcome, measured=float(measured), limit=limit, **entries)


def largest(results: Iterable[Result]) -> float:
    """The largest finite error that was measured; 0 if there is none."""
    return max((r.measured for r in results if r.measured is not None and math.isfinite(r.measured)), default=0.0)


class NotApplicable(Exception):
    """The check has no meaning here, by nature; the message says why."""


class CannotTell(Exception):
    """The check ran and could not decide; the message says why."""


@dataclass(frozen=True)
class Task:
    """One check of one quantity of one player in one state.

    `needs` are those of W, F, K that the player must have. `measure` returns what `judged` takes, at least `measured` and `limit`.
    """

    check: str
    player: Player
    quantity: str
    state: str
    needs: str
    measure: Callable[[], dict[str, Any]]
    against: str = ""

    @property
    def _who(self) -> dict[str, Any]:
        same = {name: getattr(self, name) for name in ("check", "quantity", "state", "against")}
        return same | {"subject": self.player.name}

    def missed(self, reason: str, outcome: CheckOutcome = CheckOutcome.COULD_NOT_RUN) -> Result:
        """The result of a task that could not run, or has no meaning here."""
        return Result(outcome=outcome, reason=reason, **self._who)

    def run(self) -> Result:
        """The result of the measurement, whatever it raises."""
        lacking = [f"{METHODS[quantity]}(u)" for quantity in self.needs if not self.player.has(quantity)]
        if lacking:
            return self.missed(f"{self.player.name} has no {' and no '.join(lacking)}", CheckOutcome.NOT_APPLICABLE)
        try:
            return judged(**self._who, **self.measure())
        except NotApplicable as why:
            return self.missed(str(why), CheckOutcome.NOT_APPLICABLE)
        except (Foul, CannotTell) as why:
            return self.missed(str(why))
        except Exception as error:
            return self.missed(f"{type(error).__name__}: {error}")


@dataclass(frozen=True)
class Explanation:
    """A hypothesis on what is wrong with a candidate: its name, a sentence, and the largest relative error that it leaves."""

    name: str
    words: str
    residual: float


@dataclass
class Naming:
    """What explains the candidate's values; several explanations are one on this body.

    Attributes
    ----------
    explanations : all hypotheses that make the residual vanish; none if there is none.
    tried : how many were tried.
    before : the largest relative error without a hypothesis.
    smallest : where nothing explains it, the least that still fails, or where the explanations hold for a part, the rest; in words.
    """

    explanations: list[Explanation] = field(default_factory=list)
    tried: int = 0
    before: float = 0.0
    smallest: str = ""

    def explain(self, hypotheses: Iterable[Explanation], limit: float = math.inf) -> bool:
        """Try hypotheses, keep those that leave a finite error of at most `limit`, and return whether there are any."""
        tried = list(hypotheses)
        fitting = [one for one in tried if one.residual <= limit and math.isfinite(one.residual)]
        self.tried += len(tried)
        self.explanations += fitting
        return bool(fitting)

    @property
    def names(self) -> list[str]:
        """The names of the explanations."""
        return [one.name for one in self.explanations]

    def lines(self) -> list[str]:
        """What a report says."""
        if not self.explanations:
            smallest = f" {self.smallest}" if self.smallest else ""
            return [f"No hypothesis explains it: {self.tried} were tried.{smallest}"]
        one = "This explains" if len(self.explanations) == 1 else "These are one thing on this body, and explain"
        after = max(explanation.residual for explanation in self.explanations)
        falls = f"; the error falls from {self.before:.1e} to {after:.1e}" if after < self.before else ""
        much, rest = ("a part of it", [self.smallest]) if self.smallest else ("all of it", [])
        return [f"{one} {much}{falls}:", *(f"{e.name}: {e.words}" for e in self.explanations), *rest]

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON has."""
        names = [vars(explanation) for explanation in self.explanations]
        before = self.before if math.isfinite(self.before) else str(self.before)
        return {"explanations": names, "tried": self.tried, "error before": before, "smallest": self.smallest}


@dataclass
class Findings:
    """What a verification has found so far.

    Attributes
    ----------
    header : versions, machine, mesh, material, command line, seed.
    results : every check of every quantity in every state.
    precision : rows of error against strain (`checks.precision.precision_table`).
    speed : rows of time and memory (`checks.precision.speed_table`).
    errors : errors against 50 digits that the speed is shown against.
    named : what explains a candidate that does not agree; None where none was looked for.
    interrupted : whether it was stopped before the end.
    seconds : how long the verification took.
    """

    header: dict[str, Any]
    results: list[Result] = field(default_factory=list)
    precision: list[dict[str, Any]] = field(default_factory=list)
    speed: list[dict[str, Any]] = field(default_factory=list)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    named: Naming | None = None
    interrupted: bool = False
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether it ran to the end, something was measured, and everything passed or is not applicable by nature."""
        counts = self.counts
        stopped = counts[CheckOutcome.COULD_NOT_RUN] or self.interrupted
        return counts[CheckOutcome.PASSED] > 0 and not (counts[CheckOutcome.FAILED] or stopped)

    @property
    def counts(self) -> Counter[CheckOutcome]:
        """Number of checks by the way they ended."""
        return Counter(result.outcome for result in self.results)

    def failures(self, subject: str | None = None) -> list[Result]:
        """The results that failed, of one subject or of all.

        Raises
        ------
        StvkError
            if nothing was checked of this subject.
        """
        if subject is not None:
            subject = arguments.choice("subject", subject, {result.subject for result in self.results})
        return [r for r in self.results if r.outcome is CheckOutcome.FAILED and subject in (None, r.subject)]

    def groups(self) -> dict[tuple[str, str, str, str], list[Result]]:
        """The results by check, subject, reference and quantity: the lines of a table."""
        groups: dict[tuple[str, str, str, str], list[Result]] = {}
        checks = list(dict.fromkeys(result.check for result in self.results))
        for result in sorted(self.results, key=lambda result: checks.index(result.check)):
            groups.setdefault((result.check, result.subject, result.against, result.quantity), []).append(result)
        return groups

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON has."""
        return {
            "passed": self.passed,
            "counts": {outcome.value: self.counts[outcome] for outcome in CheckOutcome},
            "interrupted": self.interrupted,
            "seconds": self.seconds,
            "header": self.header,
            "results": [result.to_dict() for result in self.results],
            "precision": self.precision,
            "speed": self.speed,
            "errors": self.errors,
            "named": None if self.named is None else self.named.to_dict(),
        }
