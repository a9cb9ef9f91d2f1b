"""Cases with one hostile input each, and their verdicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, NoReturn

from skfem_stvk.errors import AnalysisError, StvkError

#: Control characters that must not appear in output that does not go to a terminal.
CONTROL = {chr(code) for code in (*range(32), 127, *range(128, 160))} - {"\n", "\r"}


class Verdict(Enum):
    """End of a case: a readable error, a correct result, or a fault."""

    REFUSED = "refused"
    RIGHT = "right"
    TRACEBACK = "traceback"
    SILENT = "silent"
    HANG = "hang"
    MEMORY = "memory"
    CRASH = "crash"
    LOSS = "loss"

    @property
    def wrong(self) -> bool:
        """Whether the verdict is a fault."""
        return self not in (Verdict.REFUSED, Verdict.RIGHT)


class Wrong(Exception):
    """Fault that a case or its judge has found: `raise Wrong(Verdict.LOSS, "state 7 is missing")`."""

    def __init__(self, verdict: Verdict, why: str) -> None:
        super().__init__(why)
        self.verdict, self.why = verdict, why


def accepted(result: Any) -> NoReturn:
    """Raise `Wrong` for any result: the judge of a case that must be refused."""
    raise Wrong(Verdict.SILENT, f"accepted: {result!r:.200}")


def is_readable(error: BaseException) -> bool:
    """Return whether an error is a readable error of this package: a StvkError, no AnalysisError, more than three words."""
    return isinstance(error, StvkError) and not isinstance(error, AnalysisError) and len(str(error).split()) > 3


@dataclass(frozen=True)
class Case:
    """Hostile input. The name contains all parameters, such as the seed, so that the input can be repeated.

    Attributes
    ----------
    name
        Name, unique in its family, for example "msh: cut at 40 %".
    attempt
        Function of the path of an empty folder, which is the working folder. `refused` judges its exceptions, `judge` its result.
        It may raise `Wrong` to give a verdict itself.
    judge
        Function of the result of `attempt`; raises `Wrong` if the result is not correct. The default refuses every result, because
        most inputs must raise an error.
    refused
        Function that returns whether an exception is a readable refusal. Other exceptions count as raw tracebacks. Errors caused by
        a `MemoryError` have the verdict `Verdict.MEMORY`.
    seconds
        Time limit [s].
    gigabytes
        Limit of the address space that the case may use in addition [GiB].
    quick
        Whether the case belongs to the quick version, which the tests run.
    """

    name: str
    attempt: Callable[[Path], Any]
    judge: Callable[[Any], None] = accepted
    refused: Callable[[BaseException], bool] = is_readable
    seconds: float = 60.0
    gigabytes: float = 1.0
    quick: bool = False
