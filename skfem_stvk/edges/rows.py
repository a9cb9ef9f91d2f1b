"""Where the blocks of a term stand in the values of K."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..kernels.topology import stars


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


def rows_of(edges: NDArray[np.int32], vertices: NDArray[np.int32], pattern: Places) -> Rows:
    """Rows for `edges` (2, ne) between `vertices` (n,) of the mesh."""
    begin, others, entries = stars(edges, len(vertices))
    own = np.repeat(vertices, np.diff(begin))
    return Rows(begin, entries, pattern.places(own, vertices[others]), pattern.strides[vertices])
