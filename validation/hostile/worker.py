"""A child process that runs cases: `python -m validation.hostile.worker DESCRIPTOR`, driven by `runner.py`.

It reads a line of JSON for each case from standard input, and writes one with the verdict to the descriptor.
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

#: What a verdict says at most [characters].
LONGEST = 20_000


def serve(descriptor: int) -> None:
    """Run what standard input names, until it ends."""
    faulthandler.enable()  # so that a case that never ends can say where it is
    _load_libraries()
    with os.fdopen(descriptor, "w", encoding="utf-8") as answers:
        print("{}", file=answers, flush=True)  # ready: imports have no part in the limits of a case
        for line in sys.stdin:
            asked = json.loads(line)
            os.chdir(asked["folder"])  # first: the folder of the case before is gone
            case = cases_of(asked["module"])[asked["case"]]
            verdict, why = outcome(case, Path(asked["folder"]))
            print(json.dumps({"verdict": verdict.name, "why": why[:LONGEST]}), file=answers, flush=True)


def _load_libraries() -> None:
    """What is loaded at its first use, and takes much address space, is no part of the limits of a case."""
    with suppress(ImportError):
        import pypardiso

        pypardiso.spsolve(identity(3, format="csr"), np.ones(3))


@lru_cache
def cases_of(module: str) -> dict[str, Case]:
    """The cases of a family by name."""
    named: dict[str, Case] = {}
    for case in import_module(module).cases():
        if case.name in named:
            raise ValueError(f"{module} has two cases of the name {case.name!r}.")
        named[case.name] = case
    return named


def outcome(case: Case, folder: Path) -> tuple[Verdict, str]:
    """The verdict on a case, and what speaks for it, with limited memory."""
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
    """Whether it is a `MemoryError`, or stems from one."""
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def _last_lines() -> str:
    return traceback.format_exc()[-LONGEST // 2 :]


def _address_space() -> int:
    """Bytes that this process has mapped."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


if __name__ == "__main__":
    serve(int(sys.argv[1]))
