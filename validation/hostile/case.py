"""One hostile input, and what may come of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, NoReturn

from skfem_stvk.errors import AnalysisError, StvkError


class Verdict(Enum):
    """How a case ended: with an error in words, a right result, or what must never be."""

    REFUSED = "refused"
    RIGHT = "right"
    NOT_RUN = "not run"
    TRACEBACK = "traceback"
    SILENT = "silent"
    HANG = "hang"
    MEMORY = "memory"
    CRASH = "crash"
    LOSS = "loss"

    @property
    def wrong(self) -> bool:
        """Whether it must never be."""
        return self not in (Verdict.REFUSED, Verdict.RIGHT, Verdict.NOT_RUN)


class Wrong(Exception):
    """What a case raises, or its judge, when it sees a fault itself: `raise Wrong(Verdict.LOSS, "state 7 is gone")`."""

    def __init__(self, verdict: Verdict, why: str) -> None:
        super().__init__(why)
        self.verdict, self.why = verdict, why


class NotRun(Exception):
    """Raised by a case that cannot run here, with the reason, such as a package that is not installed."""


def accepted(result: Any) -> NoReturn:
    """The judge of a case that has to be refused: whatever comes back is a silent acceptance."""
    raise Wrong(Verdict.SILENT, f"accepted: {result!r:.200}")


def in_words(error: BaseException) -> bool:
    """Whether an error is one of this package, but for failed analyses, and says more than a word or two."""
    return isinstance(error, StvkError) and not isinstance(error, AnalysisError) and len(str(error).split()) > 3


@dataclass(frozen=True)
class Case:
    """A hostile input by its name, which says how to make it again: seeds are part of it.

    Attributes
    ----------
    name : unique in its family, such as "msh: cut at 40 %".
    attempt : called in a child process with the path of an empty folder, which is the working folder too. What it raises is judged
        by `refused`, what it returns by `judge`. `Wrong` and `NotRun` are verdicts of its own.
    judge : called with what `attempt` returned; raises `Wrong` if that is not right. By default nothing is: the input has to be
        refused.
    refused : whether an exception is a refusal in words; any other is a raw traceback. One that stems from a `MemoryError` is
        neither.
    seconds : limit of time.
    gigabytes : limit of address space above what the child process has before the case.
    quick : whether it belongs to the quick version, which the tests run.
    """

    name: str
    attempt: Callable[[Path], Any]
    judge: Callable[[Any], None] = accepted
    refused: Callable[[BaseException], bool] = in_words
    seconds: float = 20.0
    gigabytes: float = 1.0
    quick: bool = False
