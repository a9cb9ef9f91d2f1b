"""Where the blocks of a term stand in the values of K."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..kernels.topology import OWN, stars
from .order import OwnEdges


class Places(Protocol):
    """A pattern of K, as a term sees it."""

    strides: NDArray[np.int32]
    """(nv,) values from a row of a vertex to its next."""

    def places(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.int32]:
        """(n,) place of the first value of each block `(a, b)`."""


class Rows(NamedTuple):
    """The stars of a term's vertices and the places of their blocks (`kernels.blocks.fill_rows`)."""

    begin: NDArray[np.int64]
    entries: NDArray[np.int32]
    places: NDArray[np.int32]
    strides: NDArray[np.int32]


def rows_of(own: OwnEdges, vertices: NDArray[np.int32], pattern: Places) -> Rows:
    """Rows for the edges between `vertices` (n,) of the mesh."""
    begin, others, entries = stars(own.edges[own.number].T, len(vertices))
    upper = entries >= 0
    number = own.number[np.where(upper, entries, -1 - entries) * (entries != OWN)]
    entries = np.where(entries == OWN, OWN, np.where(upper, number, -1 - number))
    mine = np.repeat(vertices, np.diff(begin))
    return Rows(begin, entries.astype(np.int32), pattern.places(mine, vertices[others]), pattern.strides[vertices])
