"""Simplices among the cells of a file, and their named groups: physical groups, sets, indicator arrays, material numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import meshio
import numpy as np
import skfem.refdom
from numpy.typing import NDArray

from ..errors import MeshError, name_ids

#: Ids within each cell block of the file, by name.
Sets = dict[str, list[NDArray[np.int64]]]
MOST_VALUES = 64
REFERENCE = {1: skfem.refdom.RefLine, 2: skfem.refdom.RefTri, 3: skfem.refdom.RefTet}


def cell_groups(raw: meshio.Mesh, k: int) -> Sets:
    """Named groups, or where simplices of dimension `k` are in none, one for each value of the arrays of integers."""
    sets = listed_sets(raw) | indicator_sets(raw)
    sets |= {name: ids for name, ids in physical_sets(raw).items() if name not in sets}
    return sets if pick(sets, raw, k) else sets | value_sets(raw, k)


def pick(sets: Sets, raw: meshio.Mesh, k: int) -> dict[str, NDArray[np.int32]]:
    """The simplices of dimension `k` of each group, counted through their blocks; groups without any are left out."""
    picked = {}
    for name, ids_of_block in sets.items():
        start, ids = 0, [np.empty(0, dtype=np.int64)]
        for block, members in zip(raw.cells, ids_of_block, strict=False):
            if is_simplex(block, k):
                ids.append(np.asarray(members, dtype=np.int64) + start)
                start += len(block)
        picked[name] = np.unique(np.concatenate(ids)).astype(np.int32)
    return {name: ids for name, ids in picked.items() if len(ids)}


def listed_sets(raw: meshio.Mesh) -> Sets:
    """The cell sets of meshio, without Gmsh's own such as the phantom 'gmsh:bounding_entities'."""
    empty = np.empty(0, dtype=np.int64)
    return {
        name: [empty if ids is None else ids for ids in ids_of_block]
        for name, ids_of_block in raw.cell_sets.items()
        if not name.startswith("gmsh:")
    }


def indicator_sets(raw: meshio.Mesh) -> Sets:
    """Subdomains as scikit-fem's `mesh.save` writes them: arrays 'skfem:s:NAME' that are 1 inside."""
    prefix = "skfem:s:"
    return {
        name.removeprefix(prefix): [np.flatnonzero(marks(name, values, 1, "0 or 1")) for values in arrays]
        for name, arrays in raw.cell_data.items()
        if name.startswith(prefix)
    }


def marks(name: str, values: NDArray[Any], most: int, expected: str) -> NDArray[np.int64]:
    """Whole numbers, one for each cell, from 0 to `most`."""
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        raise MeshError(f"The array {name!r} has the shape {values.shape}; expected {expected} for each element.")
    if len(bad := np.flatnonzero(~((values >= 0) & (values <= most) & (values == np.floor(values))))):
        raise MeshError(f"The array {name!r} holds something else for {name_ids(bad, 'element')}; expected {expected}.")
    return values.astype(np.int64)


def physical_sets(raw: meshio.Mesh) -> Sets:
    """Gmsh's physical groups by tag; a tag without a name is its own name."""
    names = {(int(v[1]), int(v[0])): name for name, v in raw.field_data.items() if np.shape(v) == (2,)}
    sets: Sets = {}
    for i, tags in enumerate(raw.cell_data.get("gmsh:physical", [])):
        for tag in np.unique(tags[tags != 0]).tolist():
            name = names.get((raw.cells[i].dim, tag), str(tag))
            sets.setdefault(name, [np.empty(0, dtype=np.int64)] * len(raw.cells))[i] = np.flatnonzero(tags == tag)
    return sets


def value_sets(raw: meshio.Mesh, k: int) -> Sets:
    """A group 'NAME:VALUE' for each value of an array of integers that has few values on simplices of dimension `k`."""
    sets: Sets = {}
    for name, arrays in raw.cell_data.items():
        if name.startswith(("gmsh:", "skfem:", "vtk", "cell_ids")) or any(
            values.ndim != 1 or values.dtype.kind not in "iu" for values in arrays
        ):
            continue
        found = np.unique(np.concatenate([values for values, block in zip(arrays, raw.cells, strict=True) if is_simplex(block, k)]))
        if len(found) <= MOST_VALUES:
            present = np.unique(np.concatenate(arrays)).tolist()
            sets |= {f"{name}:{value}": [np.flatnonzero(values == value) for values in arrays] for value in present}
    return sets


def facet_groups(raw: meshio.Mesh, sets: Sets, k: int) -> dict[str, NDArray[np.int64]]:
    """(k, n) vertices of the facets of each group: cells one dimension lower, and scikit-fem's arrays 'skfem:b:NAME'.

    Bit `j` of such an array says that facet `j` of the cell, in scikit-fem's order, is in the boundary.
    """
    facets, t = corners(raw.cells, k - 1), corners(raw.cells, k)
    boundaries = {name: facets[:, ids] for name, ids in pick(sets, raw, k - 1).items()}
    prefix = "skfem:b:"
    for name, arrays in raw.cell_data.items():
        if name.startswith(prefix):
            most = 2 ** (k + 1) - 1
            of_block = [values for values, block in zip(arrays, raw.cells, strict=True) if is_simplex(block, k)]
            bits = marks(name, np.concatenate(of_block), most, f"whole numbers from 0 to {most}")
            found = [t[local][:, bits >> j & 1 == 1] for j, local in enumerate(REFERENCE[k].facets)]
            boundaries[name.removeprefix(prefix)] = np.concatenate(found, axis=1)
    return boundaries


def node_groups(raw: meshio.Mesh, sets: Sets, k: int) -> dict[str, NDArray[np.int64]]:
    """Vertices of each group, ascending: node sets, and groups of points, or curves where facets are surfaces, such as Gmsh's."""
    groups: dict[str, NDArray[np.int64]] = {}
    for j in range(max(k - 1, 1)):
        cells = corners(raw.cells, j)
        for name, ids in pick(sets, raw, j).items():
            groups[name] = np.union1d(groups.get(name, []), cells[:, ids]).astype(np.int64)
    return groups | {name: np.union1d(groups.get(name, []), ids).astype(np.int64) for name, ids in raw.point_sets.items()}


#: Simplices in words, by their dimension.
KINDS = {1: "segments", 2: "triangles", 3: "tetrahedra"}
#: Dimension of each family of simplices; a number after the name, as in tetra10, tells the order.
FAMILIES = {"vertex": 0, "line": 1, "triangle": 2, "tetra": 3}
FAMILIES |= {"VTK_LAGRANGE_CURVE": 1, "VTK_LAGRANGE_TRIANGLE": 2, "VTK_LAGRANGE_TETRAHEDRON": 3}


def simplex_dimension(cell_type: str) -> int:
    """Dimension of a type of simplex in meshio's words, -1 for other cells.

    >>> simplex_dimension("tetra10"), simplex_dimension("hexahedron")
    (3, -1)
    """
    return FAMILIES.get(cell_type.rstrip("0123456789"), -1)


def corners(cells: Iterable[Any], k: int) -> NDArray[Any]:
    """(k + 1, n) corner vertices of the simplices of dimension `k`, block after block."""
    blocks = [np.asarray(block.data, dtype=np.int64)[:, : k + 1] for block in cells if is_simplex(block, k)]
    return np.concatenate([np.empty((0, k + 1), dtype=np.int64), *blocks]).T


def is_simplex(block: Any, k: int) -> bool:
    """Whether the block holds simplices of dimension `k`."""
    return len(block) > 0 and simplex_dimension(block.type) == k


def inner_nodes(cells: Iterable[Any]) -> NDArray[np.int64]:
    """Nodes of simplices of higher order that are not corners: on edges, faces or inside."""
    blocks = [np.ravel(block.data[:, block.dim + 1 :]) for block in cells if len(block) and simplex_dimension(block.type) > 0]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *blocks]))


def count_cells(cells: Iterable[Any]) -> str:
    """The number of cells of each type, in words.

    >>> from meshio import CellBlock
    >>> count_cells([CellBlock("wedge", [[0] * 6]), CellBlock("quad", [[0] * 4] * 2), CellBlock("wedge", [[0] * 6])])
    '2 wedge and 2 quad cells'
    """
    counts: Counter[str] = Counter()
    for block in cells:
        counts[block.type] += len(block)
    *most, last = [f"{count} {cell_type}" for cell_type, count in counts.items()]
    return (", ".join(most) + " and " if most else "") + last + " cells"
