"""A command on several ranks of MPI: the first rank prints, and an error on one rank ends them all."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stderr, redirect_stdout
from pathlib import Path

from ... import errors
from ...about import launched
from ...errors import AnalysisError, StvkError
from ...terminal import BAD_INPUT, INTERRUPTED, NOT_PASSED


@contextmanager
def only_first_prints() -> Iterator[None]:
    """Print nothing inside this context on ranks other than the first, and no colours: Open MPI shows it a terminal."""
    rank, size = launched()
    if size > 1:
        os.environ.setdefault("TTY_COMPATIBLE", "0")
    with _printing_to(os.devnull) if rank else nullcontext():
        yield


def run(options: argparse.Namespace) -> int:
    """Run a command on all ranks, and return its exit code.

    The first rank prints an error that all ranks raise. An error that other ranks do not raise ends the job, with the same exit
    code and a message that names the rank.

    Raises
    ------
    StvkError
        if the command is for one machine, or MPI is missing or does not fit the launcher.
    """
    rank, size = launched()
    if not options.on_ranks:
        raise StvkError(f"skfem-stvk {options.command} on {size} ranks: expected one process. Start it without mpiexec or srun.")
    try:
        from ...ranks import job
    except ImportError as error:
        raise StvkError(str(error)) from error
    comm = options.comm = job.world()
    failed, job.guarded = comm.Dup(), True
    with ExitStack() as stack:
        if options.log_ranks:
            errors.on_rank = errors.RankWarnings(prints=True)
            if rank:
                stack.enter_context(_printing_to(log_of(options, rank)))
        try:
            code: int = options.run(options)
        except BaseException as error:
            if not job.all_arrive(failed):
                text = str(error) if exit_code(error) == BAD_INPUT else traceback.format_exc()
                print(f"error on rank {rank} of {size}: {text}", file=sys.__stderr__, flush=True)
                failed.Abort(exit_code(error))
            if rank:
                return exit_code(error)
            raise
    memory = comm.gather(_peak_memory())
    if memory is not None and not options.quiet:
        print(f"peak memory of a rank: {min(memory):.0f} to {max(memory):.0f} MB")
    return int(comm.bcast(code))


def exit_code(error: BaseException) -> int:
    """Return the exit code of a command that an error ends.

    >>> [exit_code(error) for error in (StvkError("poisson = 0.7"), OSError("disk full"), KeyError("x"), KeyboardInterrupt())]
    [2, 2, 1, 130]
    """
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, SystemExit) and isinstance(error.code, int):
        return error.code
    return BAD_INPUT if isinstance(error, StvkError | OSError) and not isinstance(error, AnalysisError) else NOT_PASSED


def log_of(options: argparse.Namespace, rank: int) -> Path:
    """Return the file of a rank's log, next to the folder of results."""
    out = Path(options.scene).with_suffix("") if options.out is None else Path(options.out)
    out.parent.mkdir(parents=True, exist_ok=True)
    return out.with_name(f"{out.name}.rank-{rank}.txt")


@contextmanager
def _printing_to(path: str | Path) -> Iterator[None]:
    """Write what Python prints to a file."""
    with (
        open(path, "w", encoding="utf-8", errors="backslashreplace", buffering=1) as file,
        redirect_stdout(file),
        redirect_stderr(file),
    ):
        yield


def _peak_memory() -> float:
    """Return the largest memory that this process has had [MB]."""
    import resource  # not on Windows, which has none of these launchers

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
