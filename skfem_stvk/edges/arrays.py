"""The arrays that the kernels read and write."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..kernels import blocks as block_kernels
from ..kernels.simplices import LANES
from ..kernels.threads import Turn, threads
from ..kernels.topology import lexicographic_order
from .lanes import in_lanes, out_of_lanes
from .order import OwnEdges, OwnOrder, own_edges, own_order
from .sharing import Shares, shares_of


class OwnArrays:
    """Simplices in blocks of lanes, in an order of their own; how threads share them; vectors to work in.

    What only K needs is made at the first K, and vectors when they are first used.

    Parameters
    ----------
    p : (d, nv) rest coordinates of all vertices of the mesh [m].
    t : (k + 1, nt) vertices of the simplices.
    edges : (2, ne) their edges, `a < b` in lexicographic order.
    stored : what the kernels store of the simplices in their own order, (m, nt) from its vertices of the mesh (k + 1, nt) and the order.
    dtype : of results and of what is stored, which is computed in double and rounded then.

    Attributes
    ----------
    k, d : dimension of the simplices, and of the space.
    """

    def __init__(
        self,
        p: NDArray[np.float64],
        t: NDArray[np.int32],
        edges: NDArray[np.int32],
        stored: Callable[[NDArray[np.int32], OwnOrder], NDArray[np.float64]],
        dtype: DTypeLike = np.float64,
    ) -> None:
        self.edges, self.dtype = edges, np.dtype(dtype)
        self.k, self.d = len(t) - 1, len(p)
        order = own_order(t, edges)
        self.vertices, self._elements = order.vertices, order.elements
        n = len(order.elements)
        D = in_lanes(stored(order.vertices[order.t], order).astype(self.dtype))
        D.reshape(len(D), -1, LANES)[-1, :, n - (len(D) - 1) * LANES :] = 0  # what only fills the last block has no stiffness
        self._D = D
        self._t = in_lanes(order.t[[*range(self.k + 1), *[0] * (3 - self.k)]].astype(np.uint32))
        self._X, self._u = np.zeros(3 * len(order.vertices)), np.zeros(3 * len(order.vertices))
        block_kernels.gather(np.ascontiguousarray(p.T), self.vertices, self._X)
        self._threads = 0
        self._shared: dict[str, Shares] = {}
        self._kept: dict[str, Array] = {}
        self._turn = Turn()

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""
        return {
            "edges of the mesh": _bytes(self.edges),
            "simplices": _bytes((self._t, self._D, self.vertices, self._elements, self._X, self._u)),
            "own edges": _bytes([self.__dict__.get(name, ()) for name in ("_own", "_lexicographic")]),
            "shares of threads": _bytes([value for value in self._shared.values() if len(value.parts) > 2]),
            "blocks of edges": _bytes(self._kept.get("blocks", ())),
            "vectors": _bytes([vector for name, vector in self._kept.items() if name != "blocks"]),
        }

    @cached_property
    def _own(self) -> OwnEdges:
        return own_edges(out_of_lanes(self._t, len(self._elements))[: self.k + 1].astype(np.int32))

    @cached_property
    def _lexicographic(self) -> NDArray[np.int32]:
        """(ne,) places in the own order of the edges of the mesh."""
        ends = np.sort(self.vertices[self._own.edges].T, axis=0)
        return lexicographic_order(ends, int(ends.max()) + 1)

    @property
    def _forces(self) -> Shares:
        return self._share("F", lambda n: shares_of(self._t, len(self.vertices), LANES, n))

    @property
    def _blocks(self) -> Shares:
        return self._share("K", lambda n: shares_of(self._own.t2e, self._own.total, LANES, n))

    @property
    def _products(self) -> Shares:
        return self._share("K v", lambda n: shares_of(self._own.edges, len(self.vertices), 0.25, n))

    def _share(self, name: str, make: Callable[[int], Shares]) -> Shares:
        """Shares for numba's number of threads; those for another number are thrown away."""
        if threads() != self._threads:
            self._threads, self._shared = threads(), {}
        if name not in self._shared:
            self._shared[name] = make(self._threads)
        return self._shared[name]

    def _room(self, name: str, size: int, dtype: DTypeLike) -> Array:
        """A vector to work in, kept from call to call; a new one is zero."""
        if name not in self._kept or len(self._kept[name]) != size:
            self._kept[name] = np.zeros(size, dtype=dtype)
        return self._kept[name]

    def _gathered(self, name: str, x: Array, dtype: DTypeLike) -> Array:
        """A field `x` (nv, d) in the kernels' order, (3 nv,)."""
        own = self._room(name, self._X.size, dtype)
        block_kernels.gather(x, self.vertices, own)
        return own

    def _slots(self, name: str, shares: Shares) -> Array:
        """Zeros for what the shares add to vertices."""
        slots = self._room(name, 3 * (len(self.vertices) + len(shares.extra)), self.dtype)
        slots[:] = 0
        return slots

    def _add(self, f: Array, shares: Shares, out: Array) -> None:
        """Add what stands in the slots to `out` (nv, d) of the mesh."""
        block_kernels.fold(f, len(self.vertices), shares.extra, 3)
        block_kernels.add_scattered(f, self.vertices, out)


def _bytes(arrays: Any) -> int:
    return arrays.nbytes if isinstance(arrays, np.ndarray) else sum(map(_bytes, arrays))
