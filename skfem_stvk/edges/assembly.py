"""W, F and K of an edge form on the arrays that the kernels read."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..kernels import blocks as block_kernels
from ..kernels import simplices as simplex_kernels
from ..kernels.simplices import LANES
from ..kernels.threads import Turn, in_turn, parts_of, run, threads
from .form import EdgeForm
from .lanes import in_lanes, out_of_lanes
from .order import OwnEdges, own_edges, own_order
from .rows import Places, Rows, rows_of
from .sharing import Shares, shares_of

Array = NDArray[np.floating[Any]]

AXES = {1: (0,), 2: (0, 1), 3: (0, 1, 2)}


class Linearized(NamedTuple):
    """What a tangent comes with.

    Attributes
    ----------
    energy : strain energy [J].
    total : a sum that is not finite if any value of K is not.
    """

    energy: float
    total: float


class Assembly:
    """The simplices of an edge form in blocks of lanes, in an order of their own, and the calls of the kernels.

    What only K needs is made at the first K. Its arrays are in use during a call: Python threads take turns.

    Parameters
    ----------
    form : the edge form.
    dtype : of results and of coefficients, which are computed in double and rounded then.
    """

    def __init__(self, form: EdgeForm, dtype: DTypeLike = np.float64) -> None:
        self.form, self.dtype = form, np.dtype(dtype)
        order = own_order(form.t, form.edges)
        self.vertices = order.vertices
        k, n = len(order.t) - 1, len(order.elements)
        t = order.vertices[order.t]
        stored = form.stiffness.stored(form.p, t, order.elements, order.local)
        D = in_lanes(stored.astype(self.dtype))
        D.reshape(len(D), -1, LANES)[-1, :, n - (len(D) - 1) * LANES :] = 0  # what only fills the last block has no stiffness
        self._D = D.ravel() if len(stored) == 7 else D
        self._t = in_lanes(order.t[[*range(k + 1), *[0] * (3 - k)]].astype(np.uint32))
        self._n, self._X, self._u = n, np.zeros(3 * len(order.vertices)), np.zeros(3 * len(order.vertices))
        block_kernels.gather(np.ascontiguousarray(form.p.T), self.vertices, self._X)
        self._threads = 0
        self._shared: dict[str, Any] = {}
        self._turn = Turn()

    @property
    def edges(self) -> NDArray[np.int32]:
        """(2, ne) pairs of vertices `a < b` of the mesh that are coupled."""
        return self.form.edges

    @in_turn
    def energy(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J] at displacements `u` (nv, d) [m]; adds the internal force `dW/du` [N] to `force` (nv, d)."""
        shares = self._forces
        f = self._slots(shares) if force is not None else np.empty(0, dtype=self.dtype)
        block_kernels.gather(u, self.vertices, self._u)
        W = run(simplex_kernels.energy_and_force, shares.parts, self._t.ravel(), shares.slots, self._D, self._X, self._u, f)
        if force is not None:
            self._add(f, shares, force)
        return sum(W)

    @in_turn
    def edge_blocks(self, u: Array, force: Array | None = None, out: Array | None = None) -> tuple[float, Array]:
        """The energy [J] and the blocks `K_ab` (9 ne,) of the edges at `u` (nv, d), with room for what threads add to them.

        Adds the internal force to `force` (nv, d). `out` are blocks that this method returned before, to be filled anew.
        """
        shares, to = self._forces, self._blocks
        size = 9 * (self._own.total + len(to.extra))
        blocks = np.empty(size, dtype=self.dtype) if out is None or len(out) != size else out
        f = self._slots(shares) if force is not None else np.empty(0, dtype=self.dtype)
        block_kernels.gather(u, self.vertices, self._u)
        edge_slots = to.slots.reshape(len(self._t), -1)
        simplices = self._t.ravel(), shares.slots, edge_slots, self._own.marks, self._D, self._X
        blocks[9 * self._own.total :] = 0
        W = run(simplex_kernels.linearize, shares.parts, *simplices, self._u, f, blocks)
        block_kernels.fold(blocks, self._own.total, to.extra, 9)
        if force is not None:
            self._add(f, shares, force)
        return sum(W), blocks

    def rows(self, pattern: Places) -> Rows:
        """Where the blocks stand in the values of a matrix of this pattern."""
        return rows_of(self._own, self.vertices, pattern)

    @in_turn
    def tangent(self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None) -> Linearized:
        """Write the tangent stiffness [N/m] to the CSR values `data`, or add it to them; adds the force to `force` (nv, d)."""
        W, blocks = self.edge_blocks(u, force, out=self._shared.get("blocks"))
        self._shared["blocks"] = blocks
        parts = parts_of(len(self.vertices), 1, self._threads)
        totals = run(block_kernels.fill_rows, parts, *rows, blocks, AXES[u.shape[1]], add, data)
        return Linearized(W, sum(totals))

    @in_turn
    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        """Add `K v` to `out` (nv, d), for the `blocks` of the edges and `v` (nv, d)."""
        shares = self._products
        x, y = np.zeros(3 * len(self.vertices), dtype=self.dtype), self._slots(shares)
        block_kernels.gather(v, self.vertices, x)
        run(block_kernels.multiply, shares.parts, self._own.edges, shares.slots.reshape(-1, 2), blocks, x, y)
        self._add(y, shares, out)

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""
        shared = {name: value for name, value in self._shared.items() if name != "blocks"}
        return {
            "edges of the mesh": _bytes(self.edges),
            "simplices": _bytes((self._t, self._D, self.vertices, self._X, self._u)),
            "own edges": _bytes(self.__dict__.get("_own", ())),
            "shares of threads": _bytes([value for value in shared.values() if len(value.parts) > 2]),
            "blocks of edges": _bytes(self._shared.get("blocks", ())),
        }

    @cached_property
    def _own(self) -> OwnEdges:
        return own_edges(out_of_lanes(self._t, self._n)[: len(self.form.t)].astype(np.int32))

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
        shares: Shares = self._shared[name]
        return shares

    def _slots(self, shares: Shares) -> Array:
        return np.zeros(3 * (len(self.vertices) + len(shares.extra)), dtype=self.dtype)

    def _add(self, f: Array, shares: Shares, out: Array) -> None:
        """Add what stands in the slots to `out` (nv, d) of the mesh."""
        block_kernels.fold(f, len(self.vertices), shares.extra, 3)
        block_kernels.add_scattered(f, self.vertices, out)


def _bytes(arrays: Any) -> int:
    return arrays.nbytes if isinstance(arrays, np.ndarray) else sum(map(_bytes, arrays))
