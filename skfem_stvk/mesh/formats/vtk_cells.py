"""Cells of VTK's files from their offsets, connectivity and types, every one of them accounted for."""

from __future__ import annotations

import meshio
import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import name_ids
from .cell_types import NODES, VTK
from .source import Damaged


def mesh_of(points: Array, connectivity: Array, ends: Array, types: Array, cell_data: dict[str, Array]) -> meshio.Mesh:
    """The mesh whose cell `i` has the type `types[i]` and the nodes from `ends[i - 1]` to `ends[i]` of the connectivity.

    Raises
    ------
    Damaged
        if cells are of types that are not known, or have not as many nodes as their type, if nodes belong to no cell, or an array has
        not one value for each cell.
    """
    sizes = sizes_of(connectivity, ends, types)
    for name, values in cell_data.items():
        if len(values) != len(types):
            raise Damaged(f"the array {name!r} has {len(values)} values for {len(types)} cells")
    breaks = np.flatnonzero((np.diff(types) != 0) | (np.diff(sizes) != 0)) + 1
    blocks = np.split(np.arange(len(types)), breaks) if len(types) else []
    starts = ends.astype(np.int64) - sizes
    cells = [(VTK[types[ids[0]]], connectivity[starts[ids, None] + order(types[ids[0]], sizes[ids[0]])]) for ids in blocks]
    return meshio.Mesh(points, cells, cell_data={name: [values[ids] for ids in blocks] for name, values in cell_data.items()})


def sizes_of(connectivity: Array, ends: Array, types: Array) -> NDArray[np.int64]:
    """Number of nodes of each cell, as many as its type has."""
    if len(ends) != len(types):
        raise Damaged(f"{len(types)} types of cells are there for {len(ends)} cells")
    sizes = np.diff(ends, prepend=0).astype(np.int64)
    if sizes.sum() != len(connectivity) or (sizes < 0).any():
        raise Damaged(f"its cells have {sizes.sum()} nodes in all, {len(connectivity)} are there")
    unknown = ~np.isin(types, list(VTK))
    if unknown.any():
        kinds = ", ".join(map(str, np.unique(types[unknown])[:5]))
        raise Damaged(f"{unknown.sum()} cells are of VTK's types {kinds}, which are not known here: convert them first")
    expected = np.array([NODES.get(VTK.get(kind, ""), -1) for kind in range(max(VTK) + 1)])[types]
    bad = np.flatnonzero((expected >= 0) & (expected != sizes))
    if len(bad):
        raise Damaged(f"{name_ids(bad, 'cell')}: not as many nodes as the type has")
    return sizes


def order(kind: int, size: int) -> Array:
    """Of a cell's nodes in meshio, where wedges are turned round."""
    return np.array([0, 2, 1, 3, 5, 4]) if VTK[kind] == "wedge" else np.arange(size)
