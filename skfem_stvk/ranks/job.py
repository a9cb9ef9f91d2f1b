"""Ranks of MPI as one job: where they come from, work of the first rank, and the end of all ranks if one fails."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TypeVar, cast

from ..about import launched
from ..errors import StvkError

try:
    from mpi4py import MPI
except (ImportError, RuntimeError) as error:  # RuntimeError if there is no MPI library
    raise ImportError(
        f"Bodies on ranks need mpi4py and a library of MPI: {str(error).splitlines()[0]}. Install both: "
        'pip install "skfem-stvk[mpi-wheel]". On a cluster load its module of MPI, and: pip install "skfem-stvk[mpi]".'
    ) from error

Result = TypeVar("Result")

#: Time that ranks have to raise the same error [s]. After it the job is ended.
PATIENCE = 3.0
#: Whether an error on one rank ends the job, as it does for commands of this package.
guarded = False


def world() -> MPI.Comm:
    """Return the communicator of all ranks.

    Raises
    ------
    StvkError
        if the process was started with others, and mpi4py does not find them.
    """
    expected = launched()[1]
    if MPI.COMM_WORLD.size == 1 < expected:
        library = MPI.Get_library_version().partition("\n")[0].partition(",")[0]
        raise StvkError(
            f"ranks = 1; expected {expected}, the number of processes that were started. mpi4py uses {library}, and the launcher "
            "is probably that of another MPI library. Use the mpiexec of mpi4py's library, or install mpi4py again: pip install "
            "--no-binary mpi4py --force-reinstall mpi4py."
        )
    return MPI.COMM_WORLD


def refuse_unguarded(comm: MPI.Comm) -> None:
    """Refuse several ranks if an error on one rank would make the others wait forever."""
    if comm.size > 1 and not (guarded or "mpi4py.run" in sys.modules or "mpi4py.run" in sys.orig_argv):
        program = sys.argv[0] if sys.argv[0] not in ("", "-c") else "run.py"
        raise StvkError(
            f"distribute on {comm.size} ranks: expected a program that ends all ranks if one of them fails; the others would wait "
            f"forever. Start it with mpi4py's runner: mpiexec -n {comm.size} python -m mpi4py {program}"
        )


def on_each(comm: MPI.Comm, work: Callable[[], Result]) -> Result:
    """Return the result of `work` on each rank. The error of the first rank that has one is raised on all ranks.

    `work` is for one rank: it does not communicate.
    """
    found, error = None, None
    try:
        found = work()
    except (StvkError, OSError, ImportError) as caught:
        error = caught
    error = next(filter(None, comm.allgather(error)), None)
    if error is not None:
        raise error
    return cast(Result, found)


def on_first(comm: MPI.Comm, work: Callable[[], Result]) -> Result | None:
    """Return the result of `work` on the first rank, and None on other ranks. Its errors are raised on all ranks."""
    return on_each(comm, lambda: work() if comm.rank == 0 else None)


def all_arrive(comm: MPI.Comm) -> bool:
    """Return whether all ranks call this function within a few seconds."""
    request, end = comm.Ibarrier(), time.monotonic() + PATIENCE
    while not request.Test():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True
