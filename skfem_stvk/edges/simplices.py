"""Simplices as the kernels read them: in blocks of lanes and in an order of their own, with vectors to work in."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..kernels import blocks as block_kernels
from ..kernels.lanes import LANES
from ..kernels.threads import Turn, threads
from ..kernels.topology import lexicographic_order
from .topology import OwnEdges, OwnOrder, Shares, in_lanes, out_of_lanes, own_edges, shares_of


class OwnVertices:
    """Vertices (n,) in the kernels' order: vectors of three components for each, and how threads share what they add to them.

    Python threads take `turn`s, since the vectors are in use during a call.
    """

    def __init__(self, vertices: NDArray[np.int32], dtype: DTypeLike) -> None:
        self.vertices, self.dtype, self.turn = vertices, np.dtype(dtype), Turn()
        self._threads = 0
        self._shared: dict[str, Shares] = {}
        self._kept: dict[str, Array] = {}

    def share(self, name: str, make: Callable[[int], Shares]) -> Shares:
        """Shares for numba's number of threads, made once; those for another number are thrown away."""
        if threads() != self._threads:
            self._threads, self._shared = threads(), {}
        if name not in self._shared:
            self._shared[name] = make(self._threads)
        return self._shared[name]

    def room(self, name: str, size: int, dtype: DTypeLike) -> Array:
        """A vector to work in, kept from call to call; a new one is zero."""
        if name not in self._kept or len(self._kept[name]) != size:
            self._kept[name] = np.zeros(size, dtype=dtype)
        return self._kept[name]

    def gathered(self, name: str, x: Array, dtype: DTypeLike) -> Array:
        """A field `x` (nv, d) of the mesh in the kernels' order, (3 n,)."""
        own = self.room(name, 3 * len(self.vertices), dtype)
        block_kernels.gather(x, self.vertices, own)
        return own

    def slots(self, name: str, shares: Shares) -> Array:
        """Zeros for what the shares add to vertices."""
        slots = self.room(name, 3 * (len(self.vertices) + len(shares.extra)), self.dtype)
        slots[:] = 0
        return slots

    def add(self, f: Array, shares: Shares, out: Array) -> None:
        """Add what stands in the slots to `out` (nv, d) of the mesh."""
        block_kernels.fold(f, len(self.vertices), shares.extra, 3)
        block_kernels.add_scattered(f, self.vertices, out)

    def memory(self) -> dict[str, int]:
        """Bytes of its arrays, by part."""
        return {
            "shares of threads": nbytes([value for value in self._shared.values() if len(value.parts) > 2]),
            "vectors": nbytes(list(self._kept.values())),
        }


class Simplices:
    """Simplices in blocks of lanes. What only K needs is made at the first K, and vectors when they are first used.

    They have `k` dimensions in a space of `d` and the vertices `own`; `elements` (nt,) are their positions in the order as given,
    `t` (blocks, 4 LANES) their vertices; `X`, `u` (3 n,) are rest coordinates and the displacements that were gathered last.
    """

    def __init__(self, p: NDArray[np.float64], order: OwnOrder, dtype: DTypeLike) -> None:
        self.k, self.d = len(order.t) - 1, len(p)
        self.own, self.elements = OwnVertices(order.vertices, dtype), order.elements
        self.t = in_lanes(order.t[[*range(self.k + 1), *[0] * (3 - self.k)]].astype(np.uint32))
        self.X, self.u = np.zeros(3 * len(order.vertices)), np.zeros(3 * len(order.vertices))
        block_kernels.gather(np.ascontiguousarray(p.T), order.vertices, self.X)

    @cached_property
    def edges(self) -> OwnEdges:
        """Their edges in the kernels' order."""
        return own_edges(out_of_lanes(self.t, len(self.elements))[: self.k + 1].astype(np.int32))

    @cached_property
    def lexicographic(self) -> NDArray[np.int32]:
        """(ne,) places in the kernels' order of the edges in the mesh's lexicographic order."""
        ends = np.sort(self.own.vertices[self.edges.edges].T, axis=0)
        return lexicographic_order(ends, int(ends.max()) + 1)

    @property
    def forces(self) -> Shares:
        """How threads share what simplices add to vertices."""
        return self.own.share("F", lambda n: shares_of(self.t, len(self.own.vertices), LANES, n))

    @property
    def blocks(self) -> Shares:
        """How threads share what simplices add to edges."""
        return self.own.share("K", lambda n: shares_of(self.edges.t2e, self.edges.total, LANES, n))

    def gather(self, u: Array) -> None:
        """Take displacements `u` (nv, d) of the mesh."""
        block_kernels.gather(u, self.own.vertices, self.u)

    def in_their_order(self, own: Array) -> Array:
        """(nt,) values of the simplices in the order in which they were given."""
        values = np.empty(len(self.elements))
        values[self.elements] = own[: len(values)]
        return values

    def memory(self) -> dict[str, int]:
        """Bytes of its arrays, by part."""
        made = [self.__dict__.get(name, ()) for name in ("edges", "lexicographic")]
        own = self.t, self.own.vertices, self.elements, self.X, self.u
        return {"simplices": nbytes(own), "own edges": nbytes(made)} | self.own.memory()


def nbytes(arrays: Any) -> int:
    """Bytes of an array, or of a tree of arrays."""
    return arrays.nbytes if isinstance(arrays, np.ndarray) else sum(map(nbytes, arrays))
