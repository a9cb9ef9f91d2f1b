"""Commands on several ranks of MPI: the first rank prints, an error on one ends them all; `partition` divides a mesh for them."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

from ... import errors
from ...about import launched
from ...errors import AnalysisError, StvkError
from ...mesh import read_mesh
from ...terminal import BAD_INPUT, DONE, INTERRUPTED, NOT_PASSED, console, grid, printable

if TYPE_CHECKING:
    from ...ranks.partition_files import PartSizes


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


def partition_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk partition`."""
    parser.add_argument("mesh", help="mesh file, in a format of docs/reference/mesh-files.md")
    parser.add_argument("out", help="partition file to write (.h5)")
    parser.add_argument(
        "--parts",
        type=int,
        default=64,
        help="number of parts, at least that of the ranks and best a multiple; by default 64",
    )
    parser.add_argument(
        "--degree", type=int, help="degree of the shape functions of simplices, 1 or 2; by default that of the mesh"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="factor of the coordinates, as 0.001 for a file in mm")
    parser.add_argument("--dimension", type=int, help="number of coordinates: 3 keeps a flat mesh in space, as a membrane")
    parser.add_argument(
        "--keep", action="append", default=[], metavar="NAME", help="group of facets or segments that terms use as their elements"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def partition(options: argparse.Namespace) -> int:
    """Divide a mesh for ranks: `skfem-stvk partition bracket.msh bracket.h5`, once and on one machine.

    A script opens the file by skfem_stvk.ranks.distribute("bracket.h5"), and no rank holds the whole mesh.
    """
    from ...ranks.partition_files import needed_bytes, write_partition  # only this command needs it

    mesh = read_mesh(Path(options.mesh), options.degree, dimension=options.dimension, keep=options.keep)
    if options.scale != 1.0:
        mesh = mesh.scaled(options.scale)
    out = console()
    if not options.quiet:
        size = f"{mesh.nt} {mesh.kind} with {mesh.nv} {mesh.words}"
        out.print(f"{size}: dividing them takes about {needed_bytes(mesh) / 1e9:.1f} GB of memory", soft_wrap=True)
    sizes = write_partition(mesh, options.out, options.parts)
    if not options.quiet:
        _print_sizes(sizes, Path(options.out))
    return DONE


def _print_sizes(sizes: PartSizes, path: Path) -> None:
    """Print the sizes of the smallest and the largest part, and of the file."""
    table = grid(f"{len(sizes.elements)} parts", "of a part", "smallest", "largest", right=("smallest", "largest"))
    for name, values in (("elements", sizes.elements), ("nodes", sizes.nodes), ("nodes shared with others", sizes.shared)):
        table.add_row(name, str(values.min()), str(values.max()))
    out = console()
    out.print(table)
    out.print(f"{printable(str(path))}: {path.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
