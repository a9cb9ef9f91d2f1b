"""Runs that are killed, interrupted, out of disk space, or simultaneous: after resuming, results equal those of an undisturbed run.

The comparison is bit for bit.
"""

from __future__ import annotations

import errno
import os
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from skfem_stvk.errors import AnalysisError, StvkError

from .case import Case, Verdict, Wrong, is_readable
from .runs_on_disk import KINDS, RUNS, check_same, whole

#: Number of trials of each type, for each kind of run.
KILLS, CTRL_C, FULL, FAILING, TWO = 25, 25, 15, 15, 4
#: Exit codes of forked runs.
FINISHED, READABLE, INTERRUPTED, RAW = 0, 40, 41, 42
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS)


def cases() -> Iterator[Case]:
    """Yield all interruptions of all runs."""
    for name in RUNS:
        done, quick = partial(_done, name), name in ("verlet", "load steps")
        for seed in range(KILLS):
            yield Case(f"{name}: kill -9, seed {seed}", partial(killed, name, seed), done, seconds=60, quick=quick and seed == 0)
        for seed in range(CTRL_C):
            yield Case(f"{name}: Ctrl-C, seed {seed}", partial(ctrl_c, name, seed), done, seconds=60, quick=quick and seed == 0)
        for seed in range(FULL):
            yield Case(f"{name}: files of limited size, seed {seed}", partial(limited, name, seed), done, seconds=60)
        for seed in range(FAILING):
            yield Case(
                f"{name}: the disk fails, seed {seed}", partial(failing, name, seed), done, seconds=60, quick=quick and seed == 0
            )
        for other in (False, True):
            for seed in range(TWO):
                kind = "another problem's" if other else "the same problem's"
                yield Case(f"{name}: two writers, {kind}, seed {seed}", partial(two, name, other, seed), done, seconds=60)


def _done(name: str, folder: Path | None) -> None:
    """Resume the run, and raise `Wrong` unless result and files equal those of an uninterrupted run."""
    if folder is None:
        return
    check_same(name, KINDS[name].run(folder, resume=True), folder)


class Forked:
    """Run in a forked child process, which reports its end."""

    def __init__(self, run: Callable[[], object]) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        self._reading, writing = os.pipe()
        self.process = os.fork()
        if not self.process:
            try:
                code, why = _outcome(run)
                os.write(writing, why.encode(errors="replace")[-5000:])
                os._exit(code)
            finally:
                os._exit(RAW)
        os.close(writing)

    def ended(self) -> tuple[int, str]:
        """Return the exit code, or minus the number of the signal, and the message. Raise `Wrong` for an unreadable error."""
        with os.fdopen(self._reading, errors="replace") as reading:
            why = reading.read()
        code = os.waitstatus_to_exitcode(os.waitpid(self.process, 0)[1])
        if code == RAW:
            raise Wrong(Verdict.TRACEBACK, f"the run ended with a raw error: {why}")
        return code, why


def _outcome(run: Callable[[], object]) -> tuple[int, str]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run()
        return FINISHED, ""
    except KeyboardInterrupt as error:
        return INTERRUPTED, str(error)
    except StvkError as error:
        words = is_readable(error) or len(str(error).split()) > 5
        return (READABLE, str(error)) if words else (RAW, traceback.format_exc())
    except BaseException:
        return RAW, traceback.format_exc()


def killed(name: str, seed: int, folder: Path) -> Path:
    """Kill a run at a random time, resume it and kill it again."""
    return _ended_twice(name, seed, folder, signal.SIGKILL)


def ctrl_c(name: str, seed: int, folder: Path) -> Path:
    """Interrupt a run by Ctrl-C at a random time, resume it and interrupt it again."""
    return _ended_twice(name, seed, folder, signal.SIGINT)


def _ended_twice(name: str, seed: int, folder: Path, by: signal.Signals) -> Path:
    rng, resume = np.random.default_rng(seed), False
    for _ in range(2):
        moment = float(rng.uniform(0, whole(name).seconds))
        child = Forked(partial(KINDS[name].run, folder, often=True, resume=resume))
        time.sleep(moment)
        os.kill(child.process, by)
        child.ended()
        resume = True
    return folder


def limited(name: str, seed: int, folder: Path) -> Path:
    """Run with a random limit of the file size, as on a full disk."""
    largest = max(len(content) for content in whole(name).files.values() if content is not None)
    size = int(np.random.default_rng([2, seed]).uniform(0, 1.5 * largest))

    def run() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        KINDS[name].run(folder, often=True)

    Forked(run).ended()
    return folder


def failing(name: str, seed: int, folder: Path) -> Path:
    """Run with a disk that fails from a random call on."""
    rng = np.random.default_rng([3, seed])
    call, number, error = str(rng.choice(["fsync", "replace", "open"])), int(rng.integers(1, 30)), int(rng.choice(ERRORS))

    def run() -> None:
        original, count = getattr(os, call), 0

        def fails(*arguments: Any, **options: Any) -> Any:
            nonlocal count
            count += 1
            if count >= number:
                raise OSError(error, os.strerror(error))
            return original(*arguments, **options)

        setattr(os, call, fails)
        KINDS[name].run(folder, often=True)

    Forked(run).ended()
    return folder


def two(name: str, other: bool, seed: int, folder: Path) -> Path | None:
    """Start two simultaneous runs in one folder: one of them must be refused and must not change the files of the other."""
    kind = KINDS[name]
    system = kind.system(young=3.3) if other else kind.system()
    first = Forked(partial(kind.run, folder, often=True))
    time.sleep(float(np.random.default_rng([4, seed]).uniform(0, whole(name).seconds)))
    second = Forked(partial(kind.run, folder, system, often=True))
    codes, messages = zip(first.ended(), second.ended(), strict=True)
    if FINISHED not in codes:
        raise Wrong(Verdict.LOSS, f"neither of the two runs reached its end: {messages}")
    if not other or codes[1] != FINISHED:
        return folder
    if codes[0] == FINISHED:
        raise Wrong(Verdict.LOSS, "the files of one problem were replaced by those of another")
    try:
        kind.run(folder, resume=True)
    except AnalysisError:
        raise
    except StvkError:
        return None
    raise Wrong(Verdict.SILENT, "the files of another problem were resumed")
