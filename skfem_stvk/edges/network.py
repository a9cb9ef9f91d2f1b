"""W, F and K of networks: edges and pairs of edges with constant coefficients from any source."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..kernels import networks as network_kernels
from ..kernels import node_blocks as block_kernels
from ..kernels.lanes import TRANSPOSED
from ..kernels.networks import EDGES, SPARE
from ..kernels.simplex_topology import lexicographic_order
from ..kernels.threads import locked, parts_of, run, threads
from .bound_term import BoundTerm
from .elements import KernelVertices, nbytes
from .pairs import ALL, PairBlocks, PairTerm, Tensions
from .topology import Ids, KernelEdges, Shares, shares_of, vertex_order

#: Work of an edge, and of a pair of edges, in linear simplices.
EDGE, PAIR = 0.25, 0.1


AnyElementNetwork = TypeVar("AnyElementNetwork", bound="ElementNetwork")


class Network(PairTerm, BoundTerm):
    """Energy `W = 1/2 sum A_ij z_i z_j` over edges and pairs of edges, with an elongation `z` of each edge (`kernels.networks`).

    Parameters
    ----------
    p
        (d, nv) rest coordinates of all vertices of the mesh [m].
    edges
        (2, ne) vertices `a < b`, each edge once.
    pairs
        (2, n) edges `i < j`, each pair once.
    own, between
        (ne,) and (n,) coefficients `A_ii` of edges and `A_ij` of pairs.
    dtype
        Type of results and of stored numbers.
    """

    has_mean_force = damped = True
    by_length: ClassVar[bool]

    def __init__(self, p: Array, edges: Ids, pairs: Ids, own: Array, between: Array, *, dtype: DTypeLike = np.float64) -> None:
        self.d = len(p)
        vertices = vertex_order(edges, p.shape[1])
        #: Whether vectors of the mesh are in the kernels' order, so that no copy is needed: a copy takes a sixth of the time of
        #: springs.
        self._in_mesh_order = self.d == 3 and np.array_equal(vertices, np.arange(p.shape[1]))
        self.own = KernelVertices(vertices, dtype)
        super().__init__(self.own.lock)
        number = np.empty(p.shape[1], dtype=np.int32)
        number[vertices] = np.arange(len(vertices), dtype=np.int32)
        ends = np.sort(number[edges], axis=0)
        order = lexicographic_order(ends, len(vertices))
        self.order, filling = order, -len(order) % EDGES
        self.edges = np.pad(ends[:, order].T, ((0, filling), (0, 0)))
        X = np.zeros((p.shape[1], 3))
        X[:, : self.d] = p.T
        a, b = vertices[self.edges].T
        self._rest = (X[a] - X[b]).reshape(-1, EDGES, 3).transpose(0, 2, 1).ravel()
        inverse = np.empty_like(order)
        inverse[order] = np.arange(len(order), dtype=np.int32)
        coupled = np.sort(inverse[pairs], axis=0)
        sorting = lexicographic_order(coupled, max(len(order), 1)) if coupled.shape[1] else np.empty(0, dtype=np.int64)
        self.coupled = np.ascontiguousarray(coupled[:, sorting].T)
        self._sorting = sorting
        self._set_coefficients(own, between)
        self._joined, self._to = self._find_blocks()
        self._blocks = PairBlocks(self.own, self._joined, self.d)

    def _set_coefficients(self, own: Array, between: Array) -> None:
        """Use the coefficients (ne,) and (n,), in the user's order of edges and pairs."""
        filling = len(self.edges) - len(self.order)
        self._own = np.pad(own[self.order], (0, filling)).astype(self.own.dtype)
        self._between = between[self._sorting].astype(self.own.dtype)

    @property
    def nodes_paired(self) -> NDArray[np.int32]:
        """Pairs of vertices `a < b` (2, n) of the mesh that K couples."""
        return np.sort(self.own.vertices[self._joined.edges].T, axis=0)

    @property
    def pairs(self) -> PairBlocks:
        return self._blocks

    def _find_blocks(self) -> tuple[KernelEdges, NDArray[np.uint32]]:
        """Return the pairs of vertices that K couples, edges first, and the blocks (n, 4) to which pairs of edges add."""
        ne, n = len(self.order), len(self.own.vertices)
        edges = self.edges[:ne]
        starts = np.searchsorted(edges[:, 0], np.arange(n + 1)).astype(np.int64)
        to = np.empty((len(self.coupled), 4), dtype=np.uint32)
        parts = parts_of(len(to), PAIR, 1)
        missing = sum(run(network_kernels.find_blocks, parts, edges, starts, self.coupled, to)) if len(to) else 0
        joined = edges
        if missing:  # ends of two paired edges without an edge between them
            every = np.stack([edges[self.coupled[:, 0]][:, [0, 0, 1, 1]], edges[self.coupled[:, 1]][:, [0, 1, 0, 1]]])
            lost = (to & ~TRANSPOSED) == ne + SPARE
            ends = np.sort(every[:, lost], axis=0).astype(np.int64)
            codes, found = np.unique(ends[0] * n + ends[1], return_inverse=True)
            to[lost] = (to[lost] & TRANSPOSED) | (ne + found).astype(np.uint32)
            to[every[0] == every[1]] += np.uint32(len(codes))  # the indices of diagonal blocks shift behind the new blocks
            joined = np.concatenate([edges, np.stack(np.divmod(codes, n), axis=1).astype(np.int32)])
        number = lexicographic_order(np.ascontiguousarray(joined.T), max(n, 1))
        return KernelEdges(joined, number, np.empty((0, 0), dtype=np.uint32), np.zeros(1, dtype=np.int64)), to

    @property
    def _force_shares(self) -> Shares:
        """Shares of threads in the sums of blocks of edges at vertices."""
        blocks = self.edges.reshape(-1, 2 * EDGES)
        return self.own.share("F of edges", lambda n: shares_of(blocks, len(self.own.vertices), EDGE * EDGES, n))

    @property
    def _tension_shares(self) -> Shares:
        """Shares of threads in the sums of pairs at edges."""
        return self.own.share("pairs", lambda n: shares_of(self.coupled, len(self.edges), PAIR, n))

    @property
    def _block_shares(self) -> Shares:
        """Shares of threads in the sums of pairs in blocks."""

        def shares(n: int) -> Shares:
            made = shares_of((self._to & ~TRANSPOSED).astype(np.int64), self._joined.total + SPARE, PAIR, n)
            return made._replace(slots=made.slots.astype(np.uint32) | (self._to & TRANSPOSED).ravel())

        return self.own.share("K of pairs", shares)

    def _gathered(self, u: Array) -> Array:
        """Return the displacements (3 n,) of the vertices in their own order."""
        if self._in_mesh_order and u.dtype == np.float64 and u.flags.c_contiguous:
            return u.reshape(-1)
        return self.own.gathered("u of edges", u, np.float64)

    @contextmanager
    def _force_slots(self, force: Array | None) -> Iterator[tuple[Shares, Array]]:
        """Yield shares and slots, and add the slots to `force` (nv, d) in the end; yield empty slots if `force` is None."""
        shares, f = self._force_shares, np.empty(0, dtype=self.own.dtype)
        if force is None:
            yield shares, f
        elif self._in_mesh_order and not len(shares.extra) and force.dtype == f.dtype and force.flags.c_contiguous:
            yield shares, force.reshape(-1)
        else:
            f = self.own.slots("F of edges", shares)
            yield shares, f
            self.own.add(f, shares, force)

    def _elongate(self, u: Array, name: str = "") -> tuple[Array, Array, Array]:
        """Return `z` (ne,), `g` (3 ne,) and `1/l` (ne,) at displacements `u` (nv, d), in arrays of this name."""
        ne, dtype = len(self.edges), self.own.dtype
        z, g, inverse_lengths = (
            self.own.scratch(f"{what}{name}", size, dtype) for what, size in (("z", ne), ("g", 3 * ne), ("1/l", ne))
        )
        arrays = self.edges, self._rest, self._gathered(u), z, g, inverse_lengths
        run(network_kernels.elongate, self._force_shares.parts, self.by_length, *arrays)
        return z, g, inverse_lengths

    def _tensions(self, z: Array, name: str = "s") -> Array:
        """Return the tensions `s = A z` (ne,) of the edges, from their elongations `z` (ne,)."""
        ne, shares = len(self.edges), self._tension_shares
        s = self.own.scratch(name, ne + len(shares.extra), self.own.dtype)
        np.multiply(self._own, z, out=s[:ne])
        if len(self.coupled):
            s[ne:] = 0
            run(network_kernels.couple, shares.parts, self.coupled, shares.slots.reshape(-1, 2), self._between, z, s)
            block_kernels.fold(s, ne, shares.extra, 1)
        return s[:ne]

    def _pull(self, z: Array, s: Array, g: Array, force: Array | None) -> float:
        """Return `1/2 s . z`; add `s g` to `force` (nv, d)."""
        with self._force_slots(force) as (shares, f):
            return sum(run(network_kernels.pull, shares.parts, shares.slots.reshape(-1, 2), z, s, g, f))

    @locked
    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        if len(self.coupled):
            z, g, _ = self._elongate(u)
            return self._pull(z, self._tensions(z), g, force)
        with self._force_slots(force) as (shares, f):
            arrays = self.edges, shares.slots.reshape(-1, 2), self._rest, self._own, self._gathered(u)
            return sum(run(network_kernels.springs, shares.parts, self.by_length, *arrays, f))

    @locked
    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        z, g, inverse_lengths = self._elongate(u)
        s, to, total = self._tensions(z), self._block_shares, self._joined.total
        size = 9 * (total + SPARE + len(to.extra))
        blocks = np.empty(size, dtype=self.own.dtype) if out is None or len(out) != size else out
        blocks[9 * len(self.order) :] = 0
        own = self.by_length, self._own, s, g, inverse_lengths, float(kept.positive), float(kept.negative)
        run(network_kernels.put_blocks, parts_of(len(self.order), EDGE, threads()), *own, blocks)
        if len(self.coupled):
            run(network_kernels.couple_blocks, to.parts, self.coupled, to.slots.reshape(-1, 4), self._between, g, blocks)
            block_kernels.fold(blocks, total + SPARE, to.extra, 9)
        return self._pull(z, s, g, force), blocks

    @locked
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the force of the mean tensions of two states, along the edges in between, to `force` (nv, d) [N].

            s = A (w0 z(u0) + w1 z(u1))        along the mean slopes that take z(u0) to z(u1)

        Returns `1/2 dz' A dz` [J], `dz = z(u1) - z(u0)`.
        """
        start, first = (x.copy() for x in self._elongate(u0)[::2])
        end, _, last = (x.copy() for x in self._elongate(u1))
        _, g, between = self._elongate(u0 + theta * (u1 - u0))
        g = self._mean_slopes(g, first, last, between)
        change = end - start
        R = float(change @ self._tensions(change)) / 2
        z = weights[0] * start + weights[1] * end
        self._pull(z, self._tensions(z), g, force)
        return R

    @abstractmethod
    def _mean_slopes(self, g: Array, first: Array, last: Array, between: Array) -> Array:
        """Return slopes (3 ne,) whose products with changes of edges are changes of `z`, from `g` in between and `1/l` of three
        states.
        """

    @locked
    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add the Gauss-Newton tangent at `u` times `v` to `force` (nv, d), `s = A dz/dt`; return half the dissipated power [W]."""
        _, g, _ = self._elongate(u)
        rate = np.einsum("nc,nc->n", g.reshape(-1, 3), self._differences(v)).astype(self.own.dtype)
        return self._pull(rate, self._tensions(rate), g, force)

    def _differences(self, v: Array) -> Array:
        """Return the differences (ne, 3) of a field `v` (nv, d) between the ends of the edges."""
        V = np.zeros((len(self.own.vertices), 3))
        V[:, : self.d] = v[self.own.vertices]
        a, b = self.edges.T
        return V[a] - V[b]

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        arrays = self.edges, self.coupled, self.order, self._rest, self._own, self._between, self._to, self._joined
        return {"edges and pairs": nbytes(arrays)} | self.own.memory()


class ElementNetwork(Network):
    """Network of elements that can be removed: `remaining(removed)` returns the coefficients without a mask (n,) of elements."""

    removable = True

    def __init__(self, *network: Any, remaining: Callable[[NDArray[np.bool_]], tuple[Array, Array]], **options: Any) -> None:
        self._remaining = remaining
        super().__init__(*network, **options)

    def without(self: AnyElementNetwork, removed: NDArray[np.bool_]) -> AnyElementNetwork:
        """Return the network without the elements of the mask `removed` (n,), in the region's order."""
        other = copy(self)
        other._set_coefficients(*self._remaining(removed))
        return other

    @property
    def nodes_joined(self) -> NDArray[np.int32]:
        """Vertices (2, n) of the edges that have a stiffness."""
        ne = len(self.order)
        return np.sort(self.own.vertices[self.edges[:ne][self._own[:ne] != 0].T], axis=0)


class QuarticNetwork(Network):
    """Network with `z = |p|^2 - |P|^2` and `A = L/2`: `W = 1/4 sum L_ij z_i z_j`, a quartic along any line."""

    by_length = False
    quartic = True

    def _mean_slopes(self, g: Array, first: Array, last: Array, between: Array) -> Array:
        return g

    @locked
    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """Return the coefficients (5,) of the energy along `u + s v`: `z + s z' + s^2 z''` with `z' = 2 p . V`, `z'' = |V|^2`."""
        (z, g, _), V = self._elongate(u), self._differences(v)
        first, second = np.einsum("nc,nc->n", g.reshape(-1, 3), V), np.einsum("nc,nc->n", V, V)
        s, t, w = (self._tensions(x.astype(self.own.dtype)).astype(np.float64) for x in (z.copy(), first, second))
        return np.array([z @ s / 2, s @ first, s @ second + t @ first / 2, t @ second, w @ second / 2])


class HookeanNetwork(ElementNetwork):
    """Network with `z = l - L` and `A = k`: springs that resist changes of length, `W = 1/2 sum k_ij z_i z_j`."""

    by_length = True

    def _mean_slopes(self, g: Array, first: Array, last: Array, between: Array) -> Array:
        """Return the edges in between, divided by the mean of both lengths: `l1 - l0 = (p0 + p1) . (p1 - p0) / (l0 + l1)`."""
        lengths = [np.divide(1, x, out=np.zeros_like(x), where=x > 0) for x in (first, last, between)]
        mean = (lengths[0] + lengths[1]) / 2
        scale = np.divide(lengths[2], mean, out=np.zeros_like(mean), where=mean > 0)
        return (g.reshape(-1, 3) * scale[:, None]).ravel()
