"""Cases in child processes with limits of memory and time; a child that dies is replaced."""

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

#: Child processes at a time.
WORKERS = 2
#: How long a child may take to import the package, beside others [s].
START = 120.0
#: One thread each: the machine is shared, and a limit of memory counts the stacks of threads.
ENVIRONMENT = {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"}


class Outcome(NamedTuple):
    """How a case ended."""

    family: str
    case: str
    verdict: Verdict
    why: str
    seconds: float


class Job(NamedTuple):
    """A case, its family, and the module that has it."""

    family: str
    module: str
    case: Case


def jobs(families: dict[str, str], quick: bool = False) -> list[Job]:
    """All cases of these families, given by the module of each; `quick`: those of the quick version."""
    return [
        Job(family, module, case)
        for family, module in families.items()
        for case in cases_of(module).values()
        if case.quick or not quick
    ]


def outcomes(todo: Sequence[Job]) -> Iterator[Outcome]:
    """What comes of these cases, each as soon as it is known."""
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
    """A child process that runs one case after the other, in a folder of its own; begun anew whenever it died."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        self._answers = -1
        folder.mkdir()

    def run(self, job: Job) -> Outcome:
        """The verdict on a case, whatever it does to the child."""
        work = self._folder / "work"
        work.mkdir()
        process = self._alive()
        begin = perf_counter()
        verdict, why = self._asked(process, job, work)
        seconds = perf_counter() - begin
        shutil.rmtree(work, ignore_errors=True)
        return Outcome(job.family, job.case.name, verdict, why, seconds)

    def end(self) -> None:
        """Kill the process, and all that it has started."""
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
                self._tell_where()
            printed = self._printed()
            self.end()
            if hung:
                return Verdict.HANG, f"no end within {job.case.seconds:g} s; it was at: {printed[-2000:]}"
            return Verdict.CRASH, f"the process ended by {_ending(process.returncode)}; it printed: {printed[-2000:]}"
        return Verdict[answer["verdict"]], answer["why"]

    def _answer(self, seconds: float) -> dict[str, Any]:
        """The next line from the child; raises TimeoutError after so many seconds, EOFError if it died."""
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
                    start_new_session=True,  # so that all that a case has started can be ended
                    env=os.environ | ENVIRONMENT | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
                )
            os.close(theirs)
            self._answer(START)  # it is ready
        return self._process

    def _tell_where(self) -> None:
        """Let the process, and those that it has started, print where they are, by `faulthandler`; it ends them."""
        assert self._process is not None
        with suppress(ProcessLookupError, subprocess.TimeoutExpired):
            os.killpg(self._process.pid, signal.SIGABRT)
            self._process.wait(10.0)

    def _printed(self) -> str:
        return (self._folder / "printed").read_text(errors="replace")


def _ending(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
