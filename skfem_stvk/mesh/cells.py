"""The simplices among the cell blocks of a file, of whatever order, and their corners."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Dimension of each family of simplices; a number after the name, as in tetra10, tells the order.
FAMILIES = {
    "vertex": 0,
    "line": 1,
    "triangle": 2,
    "tetra": 3,
    "VTK_LAGRANGE_CURVE": 1,
    "VTK_LAGRANGE_TRIANGLE": 2,
    "VTK_LAGRANGE_TETRAHEDRON": 3,
}


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
    """Does the block hold simplices of dimension `k`?"""
    return len(block) > 0 and simplex_dimension(block.type) == k


def inner_nodes(cells: Iterable[Any]) -> NDArray[np.int64]:
    """Nodes of simplices of higher order that are not corners: on edges, faces or inside."""
    blocks = [np.ravel(block.data[:, block.dim + 1 :]) for block in cells if len(block) and simplex_dimension(block.type) > 0]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *blocks]))


def count_cells(cells: Iterable[Any]) -> str:
    """How many cells of each type.

    >>> from meshio import CellBlock
    >>> count_cells([CellBlock("wedge", [[0] * 6]), CellBlock("quad", [[0] * 4] * 2), CellBlock("wedge", [[0] * 6])])
    '2 wedge and 2 quad cells'
    """
    counts: Counter[str] = Counter()
    for block in cells:
        counts[block.type] += len(block)
    *most, last = [f"{count} {cell_type}" for cell_type, count in counts.items()]
    return (", ".join(most) + " and " if most else "") + last + " cells"
