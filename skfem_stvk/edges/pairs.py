"""Blocks of node pairs, the stored form of a stiffness. Its rows, values, product, diagonal and norms are made of them here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..errors import StvkError, name_ids
from ..kernels import node_blocks as block_kernels
from ..kernels.simplex_topology import lexicographic_order
from ..kernels.threads import CopyableLock, locked, parts_of, run, threads
from .elements import KernelVertices, nbytes
from .topology import KernelEdges, Shares, shares_of

AXES = {1: (0,), 2: (0, 1), 3: (0, 1, 2)}


class Tensions(NamedTuple):
    """Factors of the tensions of edges in `K = 2 J' L J + sum_ab g_ab t_ab Lap_ab (x) I`; `g` depends on the sign of `t`.

    The forces do not depend on these factors. The pressure of a `VolumePenalty` counts as a negative tension.

        ALL         the exact tangent
        TENSILE     clamped: without negative tensions, positive semi-definite
        NONE        Gauss-Newton, `2 J' L J`: positive semi-definite
        WARPED      K(0) rotated with each element by the rotation nearest to its F: positive semi-definite. Terms without
                    rotated elements use `NONE`

    Attributes
    ----------
    positive, negative
        Factors of tensions `t > 0` and `t < 0`.
    warped
        Whether the rotated K(0) replaces the part that does not depend on tensions.
    damped
        Factor of `2 J' L J` of the terms that `EdgeDamping` damps. Contacts, foundations and others have no damping force.

    Examples
    --------
    >>> Tensions(1.0, 0.0) == TENSILE
    True
    """

    positive: float
    negative: float
    warped: bool = False
    damped: float = 1.0

    def of(self, term: Any) -> tuple[float, Tensions]:
        """Return the factor of a term's K, and the tensions in that K. The product has the tensions without the factor `damped`."""
        whole = self._replace(damped=1.0)
        if self.damped == 1 or not term.damped:
            return 1.0, whole
        return self.damped, whole._replace(positive=self.positive / self.damped, negative=self.negative / self.damped)


ALL = Tensions(1.0, 1.0)
TENSILE = Tensions(1.0, 0.0)
NONE = Tensions(0.0, 0.0)
WARPED = Tensions(0.0, 0.0, warped=True)


class Linearized(NamedTuple):
    """Energy, and a number that shows whether K overflowed, as found while the values of K are filled.

    Attributes
    ----------
    energy
        Strain energy [J].
    total
        Sum that is not finite if any value of K is not.
    """

    energy: float
    total: float


class BlockPattern(ABC):
    """Pattern of K in blocks of node pairs.

    Attributes
    ----------
    indptr
        Index (rows + 1,) of the first value of each row.
    strides
        Number of values (nv,) from one row of a vertex to its next row.
    """

    indptr: NDArray[np.int32]
    strides: NDArray[np.int32]

    @abstractmethod
    def block_indices(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the index (n,) of the first value of each block `(a, b)`."""


class Rows(NamedTuple):
    """Indices of blocks in the values of K: the stars of vertices (`kernels.blocks.fill_rows`), or single blocks.

    Attributes
    ----------
    begin
        (n + 1,) index of the first entry of each star; empty for single blocks.
    entries
        (m,) block at each entry.
    indices
        (m,) index of the first value of each block.
    strides
        Number of values from one row of a vertex, or of a block, to its next row.
    """

    begin: NDArray[np.int64]
    entries: NDArray[np.int32]
    indices: NDArray[np.int32]
    strides: NDArray[np.int32]

    @property
    def size(self) -> int:
        """Number of blocks that are written to the matrix."""
        return len(self.entries)


@dataclass
class NodeBlocks:
    """Arrays to which a term adds its blocks [N/m].

    Attributes
    ----------
    pairs
        (n, d, d) `K_ab` of its `nodes_paired`.
    reverse
        (n, d, d) `K_ba`; None for symmetric terms.
    own
        (m, d, d) `K_aa` of its `nodes`; None for balanced terms.
    """

    pairs: Array
    reverse: Array | None
    own: Array | None


class PairBlocks:
    """Symmetric and balanced blocks: `K_ba = K_ab'` and `K_aa = -sum_b K_ab`.

    All methods are linear in the `blocks` (9 n,). These belong to the pairs `edges` of the vertices `own`, in their order, with `d`
    components.
    """

    def __init__(self, own: KernelVertices, edges: KernelEdges, d: int) -> None:
        self.own, self.d, self._edges, self._lock = own, d, edges, own.lock

    @property
    def size(self) -> int:
        """Number of values in the blocks."""
        return 9 * self._edges.total

    @property
    def edges(self) -> NDArray[np.int32] | None:
        """Pairs (n, 2) of indices into `own.vertices`, in the order of the blocks, if there are no other blocks; else None."""
        return self._edges.edges

    def of_vertices(self, blocks: Array) -> tuple[NDArray[np.int32], Array] | None:
        """Return the vertices (m,) and their blocks (m, d, d), if the blocks couple each vertex with itself alone; else None."""
        return None

    def move_to(self, first: PairBlocks, blocks: Array, of_first: Array) -> None:
        """Move the blocks of pairs that `first` has, too, to `of_first`, its blocks; if all are, `of_vertices` has the rest."""

    def zeroed(self, blocks: Array) -> NodeBlocks:
        """Set the `blocks` to zero and return views into them, to which a term adds."""
        blocks[:] = 0
        return NodeBlocks(blocks.reshape(-1, 3, 3)[:, : self.d, : self.d], None, None)

    def complete(self, blocks: Array) -> None:
        """Write the blocks that follow from those of a term, such as diagonal blocks."""

    def rows(self, pattern: BlockPattern) -> Rows:
        """Return the indices of the blocks in the values of a matrix of this pattern."""
        vertices = self.own.vertices
        begin, others, entries = self._edges.stars(len(vertices))
        mine = np.repeat(vertices, np.diff(begin))
        return Rows(begin, entries, pattern.block_indices(mine, vertices[others]), pattern.strides[vertices])

    def fill(self, rows: Rows, blocks: Array, add: bool, data: Array) -> float:
        """Write K [N/m] to the CSR values `data`, or add it to them; return a sum that is not finite if any value is not."""
        parts = parts_of(len(self.own.vertices), 1, threads())
        return sum(run(block_kernels.fill_rows, parts, *rows, blocks, AXES[self.d], add, data))

    @locked
    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        """Add `K v` to `out` (nv, d), for `v` (nv, d)."""
        shares = self.products
        x, y = self.own.gathered("factor", v, self.own.dtype), self.own.slots("K v", shares)
        run(block_kernels.multiply, shares.parts, self._edges.edges, shares.slots.reshape(-1, 2), blocks, x, y)
        self.own.add(y, shares, out)

    def add_diagonal(self, blocks: Array, out: Array) -> None:
        """Add the diagonal blocks `K_aa` to `out` (nv, d, d)."""
        block_kernels.add_diagonal(self._edges.edges, self.own.vertices, blocks, out)

    def add_norms(self, blocks: Array, x: Array, out: Array) -> None:
        """Add `sum_b |K_ab| x_b` over the other vertices `b` to `out` (nv,), for `x` (nv,), with Frobenius norms."""
        block_kernels.add_norms(self._edges.edges, self.own.vertices, blocks, self.d, x, out)

    @property
    def products(self) -> Shares:
        """Shares of threads in the sums of pairs at vertices."""
        return self.own.share("K v", lambda n: shares_of(self._edges.edges, len(self.own.vertices), 0.25, n))

    def memory(self) -> int:
        """Return the bytes of its arrays, without those of `own`."""
        return nbytes(self._edges)


class GeneralBlocks(PairBlocks):
    """Blocks that are not symmetric, or not balanced: `K_ab` of the pairs, `K_ba`, and `K_aa`.

    The term supplies the `K_aa` of vertices `nodes` (m,) of the mesh. Without `nodes` they are `-sum_b K_ab` of all vertices of
    pairs.
    """

    def __init__(self, own: KernelVertices, edges: KernelEdges, d: int, nodes: NDArray[np.int32] | None, symmetric: bool) -> None:
        super().__init__(own, edges, d)
        self._symmetric, self._balanced = symmetric, nodes is None
        self._nodes = np.arange(len(own.vertices)) if nodes is None else np.searchsorted(own.vertices, nodes)
        a, b = edges.edges.T
        self._row, self._column = np.concatenate([a, b, self._nodes]), np.concatenate([b, a, self._nodes])
        self._moved_to: PairBlocks | None = None
        self._places: tuple[NDArray[np.intp], NDArray[np.bool_]] | None = None

    @property
    def size(self) -> int:
        return self.d**2 * len(self._row)

    @property
    def edges(self) -> None:
        return None

    def of_vertices(self, blocks: Array) -> tuple[NDArray[np.int32], Array] | None:
        alone = self._symmetric and not self._balanced and (self._places is not None or not self._edges.total)
        return (self.own.vertices[self._nodes], self._views(blocks)[2]) if alone else None

    def zeroed(self, blocks: Array) -> NodeBlocks:
        blocks[:] = 0
        pairs, reverse, own = self._views(blocks)
        return NodeBlocks(pairs, None if self._symmetric else reverse, None if self._balanced else own)

    def move_to(self, first: PairBlocks, blocks: Array, of_first: Array) -> None:
        if not self._symmetric or self._balanced or not self._edges.total:
            return
        if self._moved_to is not first:
            self._moved_to, self._places = first, self._places_in(first)
        if self._places is None:
            return
        (places, turned), (pairs, reverse, own) = self._places, self._views(blocks)
        if not pairs.any():
            return
        into = of_first[: first.size].reshape(-1, 3, 3)[:, : self.d, : self.d]
        into[places] += np.where(turned[:, None, None], reverse, pairs)
        others = 2 * self._edges.total  # rows of `first` sum to zero, so these blocks also enter its diagonal, with the other sign
        sums = self._to_rows[:, :others] @ blocks[: others * self.d**2].reshape(others, -1)
        own += sums[self._nodes].reshape(own.shape)
        pairs[:] = reverse[:] = 0

    def _places_in(self, first: PairBlocks) -> tuple[NDArray[np.intp], NDArray[np.bool_]] | None:
        """Return indices (n,) of the pairs among those of `first`, and whether their order is the other one; None if some miss."""
        if first.edges is None:
            return None
        own, all_edges = self.own.vertices[self._edges.edges].astype(np.int64), first.own.vertices[first.edges].astype(np.int64)
        count = int(first.own.vertices.max()) + 1
        keys, wanted = (edges.min(axis=1) * count + edges.max(axis=1) for edges in (all_edges, own))
        order = np.argsort(keys)
        places = order[np.minimum(np.searchsorted(keys[order], wanted), len(order) - 1)]
        if (own >= count).any() or not np.array_equal(keys[places], wanted):
            return None
        return places, all_edges[places, 0] != own[:, 0]

    def complete(self, blocks: Array) -> None:
        pairs, reverse, own = self._views(blocks)
        if self._symmetric:
            reverse[:] = pairs.transpose(0, 2, 1)
        if self._balanced:
            both = blocks[: pairs.size + reverse.size].reshape(-1, self.d**2)
            own[:] = -(self._to_rows[:, : len(both)] @ both).reshape(own.shape)

    def rows(self, pattern: BlockPattern) -> Rows:
        vertices = self.own.vertices
        row, column = vertices[self._row], vertices[self._column]
        every = np.arange(len(row), dtype=np.int32)
        return Rows(np.empty(0, dtype=np.int64), every, pattern.block_indices(row, column), pattern.strides[row])

    def fill(self, rows: Rows, blocks: Array, add: bool, data: Array) -> float:
        every = blocks.reshape(-1, self.d, self.d)
        for r, c in np.ndindex(self.d, self.d):
            indices = rows.indices + r * rows.strides + c
            data[indices] = data[indices] + every[:, r, c] if add else every[:, r, c]
        return float(blocks.sum())

    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        x = v[self.own.vertices[self._column]]
        out[self.own.vertices] += self._to_rows @ np.einsum("nij,nj->ni", blocks.reshape(-1, self.d, self.d), x)

    def add_diagonal(self, blocks: Array, out: Array) -> None:
        out[self.own.vertices[self._nodes]] += self._views(blocks)[2]

    def add_norms(self, blocks: Array, x: Array, out: Array) -> None:
        others = 2 * self._edges.total
        norms = np.linalg.norm(blocks.reshape(-1, self.d**2)[:others], axis=1)
        out[self.own.vertices] += self._to_rows[:, :others] @ (norms * x[self.own.vertices[self._column[:others]]])

    @cached_property
    def _to_rows(self) -> csr_matrix:
        """Matrix (vertices, blocks) of ones where a block is in the row of a vertex."""
        n = len(self._row)
        return csr_matrix((np.ones(n), (self._row, np.arange(n))), shape=(len(self.own.vertices), n))

    def _views(self, blocks: Array) -> tuple[Array, Array, Array]:
        every, n = blocks.reshape(-1, self.d, self.d), self._edges.total
        return every[:n], every[n : 2 * n], every[2 * n :]

    def memory(self) -> int:
        return super().memory() + nbytes([self._row, self._column, self._nodes])


def blocks_between(term: Any, nv: int, d: int, dtype: DTypeLike) -> PairBlocks:
    """Return blocks of the `nodes_paired` (2, n) of a term, each once and in its own order, and of its `nodes` unless it is
    `balanced`.
    """
    pairs = np.ascontiguousarray(term.nodes_paired, dtype=np.int32)
    if pairs.ndim != 2 or len(pairs) != 2:
        raise StvkError(f"{type(term).__name__}: nodes_paired has shape {pairs.shape}; expected (2, n) pairs of vertices.")
    a, b = pairs
    nodes = None if term.balanced else np.asarray(term.nodes, dtype=np.int32)
    bad = np.flatnonzero((a < 0) | (a >= b) | (b >= nv))
    if len(bad):
        raise StvkError(f"{type(term).__name__}: {name_ids(bad, 'pair')} of nodes_paired; expected vertices 0 <= a < b < {nv}.")
    number = lexicographic_order(pairs, nv)
    twice = np.flatnonzero((np.diff(pairs[:, number], axis=1) == 0).all(axis=0))
    if len(twice):
        raise StvkError(f"{type(term).__name__}: {name_ids(number[twice], 'pair')} of nodes_paired twice; expected each once.")
    vertices = np.unique(np.concatenate([a, b, *([] if nodes is None else [nodes])])).astype(np.int32)
    local = np.searchsorted(vertices, pairs.T).astype(np.int32)
    own = KernelVertices(vertices, dtype)
    edges = KernelEdges(np.ascontiguousarray(local), number, np.empty((0, 0), dtype=np.uint32), np.zeros(1, dtype=np.int64))
    if term.symmetric and nodes is None:
        return PairBlocks(own, edges, d)
    return GeneralBlocks(own, edges, d, nodes, term.symmetric)


class PairTerm(ABC):
    """Term with a stiffness in blocks of node pairs. Calls wait for its `lock`, because its arrays are in use during a call."""

    damped: bool

    def __init__(self, lock: CopyableLock) -> None:
        self._lock = lock
        self._scratch: dict[str, Array] = {}  # values of the blocks that `fill` used last; the term at another time shares them

    @property
    @abstractmethod
    def pairs(self) -> PairBlocks:
        """Products and matrices of the blocks."""

    @abstractmethod
    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        """Return the energy [J] and the blocks at `u` (nv, d); add the internal force to `force` (nv, d).

        Without `force`, the energy may be 0. `out` are blocks that this method returned before; they are overwritten. `kept`: which
        tensions of edges K includes.
        """

    def rows(self, pattern: BlockPattern) -> Any:
        """Return the indices of the blocks in the values of a matrix of this pattern, for `fill`; `size` is their number."""
        return self.pairs.rows(pattern)

    @locked
    def fill(self, u: Array, rows: Any, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL) -> Linearized:
        """Write the tangent stiffness [N/m] to the CSR values `data`, or add it to them; the other arguments as in `blocks`."""
        W, filled = self.blocks(u, force, self._scratch.get("blocks"), kept)
        self._scratch["blocks"] = filled
        return Linearized(W, self.pairs.fill(rows, filled, add, data))

    def with_blocks(self, nv: int, d: int, dtype: DTypeLike) -> PairTerm:
        """Return the term itself, as in `BoundTerm`."""
        return self

    def with_term(self, term: Any) -> PairTerm:
        """Return the blocks of another `term` that couples the same pairs."""
        other: PairTerm = term
        return other

    def own_memory(self) -> int:
        """Return the bytes of arrays of blocks that the term itself does not report."""
        return 0

    def by_rows(self, kept: Tensions) -> bool:
        """Return whether `fill` makes K row by row. If so, it also writes a part of K, with `rows(pattern).part(indices)`."""
        return False

    def add_magnitudes(self, u: Array, out: Array) -> None:
        """Add `|F|` and `sum_b |K_ab| |u_b|` at `u` to `out`, both (nv, d) [N]: at least the sum of all summands of a smooth F."""
        force, sizes, diagonal = np.zeros(u.shape), np.zeros(len(u)), np.zeros((*u.shape, u.shape[1]))
        _, blocks = self.blocks(u, force)
        lengths = np.linalg.norm(u, axis=1)
        self.pairs.add_norms(blocks, lengths, sizes)
        self.pairs.add_diagonal(blocks, diagonal)
        sizes += np.linalg.norm(diagonal, axis=(1, 2)) * lengths
        out += np.abs(force) + sizes[:, None]


Own = TypeVar("Own", bound="AccumulatedBlocks")


class AccumulatedBlocks:
    """Term or load with arrays in which the blocks of its pairs are accumulated; made again when it couples other pairs."""

    def __init__(self, term: Any, nv: int, d: int, dtype: DTypeLike) -> None:
        self.term, self._space = term, (nv, d, dtype)
        self._made = {term.pattern_version: blocks_between(term, *self._space)}  # the last one; the term at another time shares it

    @property
    def pairs(self) -> PairBlocks:
        """Products and matrices of the blocks."""
        version, made = self.term.pattern_version, self._made
        pairs = made.get(version)
        if pairs is None:
            pairs = blocks_between(self.term, *self._space)
            made.clear()
            made[version] = pairs
        return pairs

    def with_term(self: Own, term: Any) -> Own:
        """Return the same pairs and scratch arrays, with another term or load that always couples the same pairs."""
        other = copy(self)
        other.term = term
        return other

    def own_memory(self) -> int:
        """Return the bytes of its arrays, without those of the term."""
        return self.pairs.memory() + sum(self.pairs.own.memory().values()) + self.pairs.own.vertices.nbytes

    def add_stiffness(self, u: Array, t: Any, rows: Rows, data: Array) -> None:
        """Add `-d force/du` [N/m] of a load at `u` (nv, d) and `t` to CSR values."""
        pairs = self.pairs
        blocks = np.empty(pairs.size, dtype=pairs.own.dtype)
        self.term.add_blocks(u, t, pairs.zeroed(blocks))
        pairs.complete(blocks)
        pairs.fill(rows, blocks, True, data)
