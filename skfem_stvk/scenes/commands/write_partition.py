"""The command `skfem-stvk partition`: divide a mesh for ranks, into a file of which each rank reads its part."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...mesh import read_mesh
from ...terminal import DONE, console, grid, printable

if TYPE_CHECKING:
    from ...ranks.partition_files import PartSizes


def add_arguments(parser: argparse.ArgumentParser) -> None:
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
        _print(sizes, Path(options.out))
    return DONE


def _print(sizes: PartSizes, path: Path) -> None:
    """Print the sizes of the smallest and the largest part, and of the file."""
    table = grid(f"{len(sizes.elements)} parts", "of a part", "smallest", "largest", right=("smallest", "largest"))
    for name, values in (("elements", sizes.elements), ("nodes", sizes.nodes), ("nodes shared with others", sizes.shared)):
        table.add_row(name, str(values.min()), str(values.max()))
    out = console()
    out.print(table)
    out.print(f"{printable(str(path))}: {path.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
