"""Child process that runs cases for `runner.py`: `python -m validation.hostile.worker DESCRIPTOR`.

The process reads a line of JSON for each case from standard input, and writes a line with the verdict to the descriptor.
"""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import sys
import traceback
import warnings
from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import identity

from .case import Case, NotRun, Verdict, Wrong

#: Largest length of the message of a verdict [characters].
LONGEST = 20_000


def serve(descriptor: int) -> None:
    """Run the cases that standard input names, until it ends."""
    faulthandler.enable()  # prints the stack of a case that does not end
    _load_libraries()
    with os.fdopen(descriptor, "w", encoding="utf-8") as answers:
        print("{}", file=answers, flush=True)  # ready: the limits of a case do not include imports
        for line in sys.stdin:
            request = json.loads(line)
            os.chdir(request["folder"])  # first, because the folder of the previous case is deleted
            case = cases_of(request["module"])[request["case"]]
            verdict, why = outcome(case, Path(request["folder"]))
            print(json.dumps({"verdict": verdict.name, "why": why[:LONGEST]}), file=answers, flush=True)


def _load_libraries() -> None:
    """Load libraries that need much address space at their first use, so that the limits of a case do not include them."""
    with suppress(ImportError):
        import pypardiso

        pypardiso.spsolve(identity(3, format="csr"), np.ones(3))


@lru_cache
def cases_of(module: str) -> dict[str, Case]:
    """Return the cases of a family by name."""
    named: dict[str, Case] = {}
    for case in import_module(module).cases():
        if case.name in named:
            raise ValueError(f"{module} has two cases with the name {case.name!r}; expected unique names.")
        named[case.name] = case
    return named


def outcome(case: Case, folder: Path) -> tuple[Verdict, str]:
    """Run a case with limited memory and return the verdict and its reason."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_address_space() + int(case.gigabytes * 2**30), most))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _judged(case, folder)
    except Wrong as fault:
        return fault.verdict, fault.why
    except NotRun as reason:
        return Verdict.NOT_RUN, str(reason)
    except BaseException:
        return Verdict.TRACEBACK, f"the judge failed: {traceback.format_exc()}"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _judged(case: Case, folder: Path) -> tuple[Verdict, str]:
    try:
        result: Any = case.attempt(folder)
    except (Wrong, NotRun):
        raise
    except BaseException as error:
        if _out_of_memory(error):
            return Verdict.MEMORY, f"more than {case.gigabytes:g} GB: {_last_lines()}"
        if case.refused(error):
            return Verdict.REFUSED, f"{type(error).__name__}: {error}"
        return Verdict.TRACEBACK, _last_lines()
    case.judge(result)
    return Verdict.RIGHT, ""


def _out_of_memory(error: BaseException | None) -> bool:
    """Return whether the error is a `MemoryError`, or was caused by one."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _last_lines() -> str:
    return traceback.format_exc()[-LONGEST // 2 :]


def _address_space() -> int:
    """Return the bytes of address space that this process has mapped."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


if __name__ == "__main__":
    serve(int(sys.argv[1]))
