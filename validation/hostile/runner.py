"""Execution of cases in child processes with limits of memory and time. A child that dies is replaced."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, NamedTuple

from .case import Case, Verdict
from .worker import cases_of

#: Number of simultaneous child processes.
WORKERS = 2
#: Largest time that a child may need to import the package [s].
START = 120.0
#: Environment of the children. They use one thread, because they share the machine and the memory limit counts thread stacks.
ENVIRONMENT = {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"}


class Outcome(NamedTuple):
    """Verdict on a case."""

    family: str
    case: str
    verdict: Verdict
    why: str
    seconds: float


class Job(NamedTuple):
    """Case with its family and its module."""

    family: str
    module: str
    case: Case


def jobs(families: dict[str, str], quick: bool = False) -> list[Job]:
    """Return all cases of these families, given with their modules; if `quick`, only the cases of the quick version."""
    return [
        Job(family, module, case)
        for family, module in families.items()
        for case in cases_of(module).values()
        if case.quick or not quick
    ]


def outcomes(todo: Sequence[Job]) -> Iterator[Outcome]:
    """Yield the outcome of each case as soon as the case ends."""
    free: SimpleQueue[Child] = SimpleQueue()
    with TemporaryDirectory(prefix="hostile-") as folder:
        children = [Child(Path(folder) / str(number)) for number in range(min(WORKERS, len(todo)))]
        for child in children:
            free.put(child)

        def run(job: Job) -> Outcome:
            child = free.get()
            try:
                return child.run(job)
            finally:
                free.put(child)

        try:
            with ThreadPoolExecutor(len(children) or 1) as pool:
                waiting = [pool.submit(run, job) for job in todo]
                try:
                    for done in as_completed(waiting):
                        yield done.result()
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
        finally:
            for child in children:
                child.end()


class Child:
    """Child process that runs cases one after the other in its own folder. It is restarted after its death."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        self._answers = -1
        folder.mkdir()

    def run(self, job: Job) -> Outcome:
        """Run a case and return its outcome, even if the child dies."""
        work = self._folder / "work"
        work.mkdir()
        process = self._alive()
        begin = perf_counter()
        verdict, why = self._asked(process, job, work)
        seconds = perf_counter() - begin
        shutil.rmtree(work, ignore_errors=True)
        return Outcome(job.family, job.case.name, verdict, why, seconds)

    def end(self) -> None:
        """Kill the process and all processes that it has started."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            for stream in (self._process.stdin, self._process.stdout):
                if stream is not None:
                    stream.close()
            os.close(self._answers)
            self._process = None

    def _asked(self, process: subprocess.Popen[str], job: Job, work: Path) -> tuple[Verdict, str]:
        assert process.stdin is not None
        try:
            print(json.dumps({"module": job.module, "case": job.case.name, "folder": str(work)}), file=process.stdin, flush=True)
            answer = self._answer(job.case.seconds)
        except (TimeoutError, EOFError, BrokenPipeError) as error:
            hung = isinstance(error, TimeoutError)
            if hung:
                self._print_stack()
            printed = self._printed()
            self.end()
            if hung:
                return Verdict.HANG, f"the case did not end within {job.case.seconds:g} s; its stack: {printed[-2000:]}"
            return Verdict.CRASH, f"the process ended by {_ending(process.returncode)}; its output: {printed[-2000:]}"
        return Verdict[answer["verdict"]], answer["why"]

    def _answer(self, seconds: float) -> dict[str, Any]:
        """Return the next answer of the child. Raise TimeoutError after `seconds`, and EOFError if the child died."""
        text, end = b"", perf_counter() + seconds
        while not text.endswith(b"\n"):
            if not select.select([self._answers], [], [], max(0.0, end - perf_counter()))[0]:
                raise TimeoutError
            more = os.read(self._answers, 1 << 16)
            if not more:
                assert self._process is not None
                self._process.wait()
                raise EOFError
            text += more
        answer: dict[str, Any] = json.loads(text)
        return answer

    def _alive(self) -> subprocess.Popen[str]:
        if self._process is None:
            self._answers, theirs = os.pipe()
            with (self._folder / "printed").open("wb") as printed:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "validation.hostile.worker", str(theirs)],
                    stdin=subprocess.PIPE,
                    stdout=printed,
                    stderr=subprocess.STDOUT,
                    text=True,
                    pass_fds=[theirs],
                    start_new_session=True,  # so that `end` can kill all processes of a case
                    env=os.environ | ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
                )
            os.close(theirs)
            self._answer(START)  # the first answer says that the child is ready
        return self._process

    def _print_stack(self) -> None:
        """End the process and its children by SIGABRT, for which `faulthandler` prints the stack."""
        assert self._process is not None
        with suppress(ProcessLookupError, subprocess.TimeoutExpired):
            os.killpg(self._process.pid, signal.SIGABRT)
            self._process.wait(10.0)

    def _printed(self) -> str:
        return (self._folder / "printed").read_text(errors="replace")


def _ending(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
