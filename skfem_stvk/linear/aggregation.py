"""Which vertices share a coarse one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..errors import StvkError
from .blocks import BlockStructure, Ids, Reals

#: Nodes are strongly coupled if `|A_ij| >= STRONG sqrt(|A_ii| |A_jj|)`: about what slender elements and jumps of stiffness need.
STRONG = 0.05

#: Aggregates of fewer nodes on average make coarse levels expensive; then weaker couplings count as strong, too.
FEWEST = 5


def aggregates(graph: csr_matrix, structure: BlockStructure, blocks: Reals) -> NDArray[np.int32]:
    """(nodes,) number of the aggregate of each node, by pyamg's standard aggregation of strongly coupled nodes.

    `structure`, `blocks` are a matrix with as many block rows a node as there are to each of the graph.
    """
    norms, diagonal = _norms(graph, structure, blocks)
    row = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr))
    strength = norms / np.sqrt(diagonal[row] * diagonal[graph.indices])
    for least in (STRONG, STRONG / 2, STRONG / 4, 0.0):
        numbers = _aggregates(graph, row, (strength >= least) | (row == graph.indices))
        if numbers.max() + 1 <= graph.shape[0] / FEWEST:
            break
    return numbers


def _norms(graph: csr_matrix, structure: BlockStructure, blocks: Reals) -> tuple[Reals, Reals]:
    """Frobenius norms of the blocks of the graph's entries, and of its diagonal."""
    squares = np.einsum("ij,ij->i", blocks.reshape(-1, 9), blocks.reshape(-1, 9), dtype=np.float64)
    each = structure.n // graph.shape[0]
    if each > 1:
        places = structure.row_of_each() // each, structure.columns // each
        joined = csr_matrix((squares, places), shape=graph.shape)
        joined.sort_indices()
        squares = joined.data
    norms = np.sqrt(squares)
    own = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr)) == graph.indices
    return norms, norms[own]


def _aggregates(graph: csr_matrix, row: Ids, kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Of the graph's entries that are kept; a node without neighbours is an aggregate of its own."""
    rows = np.concatenate([[0], np.cumsum(kept)])[graph.indptr].astype(np.int32)
    strong = csr_matrix((np.ones(rows[-1]), graph.indices[kept], rows), shape=graph.shape)
    found, _ = _standard_aggregation()(strong)
    numbers = found.shape[1] + np.arange(graph.shape[0])
    numbers[np.diff(found.indptr) > 0] = found.indices
    return np.unique(numbers, return_inverse=True)[1].astype(np.int32)


def _standard_aggregation() -> Callable[[csr_matrix], tuple[csr_matrix, Ids]]:
    """pyamg's, imported when it is needed: `python -OO` takes the docstrings away that pyamg adds to."""
    try:
        from pyamg.aggregation.aggregate import standard_aggregation
    except TypeError as error:
        raise StvkError(
            f"pyamg, whose aggregation solver='amg-cg' takes, cannot be imported: {error}. It needs docstrings: "
            "run Python without -OO, or choose solver='superlu', 'pardiso' or 'ssor-cg'."
        ) from error
    aggregation: Callable[[csr_matrix], tuple[csr_matrix, Ids]] = standard_aggregation
    return aggregation
