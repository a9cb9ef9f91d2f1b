"""Values of K row by row, each row written once the last element of its node is added: setup and calls of `kernels.rows`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..kernels import rows as row_kernels
from ..kernels.llvm import LINE
from ..kernels.rows import RowSlots
from ..kernels.simplex_topology import OWN, assign_slots, last_uses
from ..kernels.threads import parts_of, run, threads
from .elements import KernelElements, nbytes
from .pairs import BlockPattern, PairBlocks, Rows
from .topology import Shares

Result = TypeVar("Result")

#: Size in bytes from which a matrix is written past the caches; a smaller one is read from the caches afterwards.
PAST_CACHES = 2**21
#: Bytes of slots that fit into a core's own cache.
IN_CACHE = 2**20


class RowPlan(NamedTuple):
    """Plan by which threads write the rows of K.

    Attributes
    ----------
    parts
        Parts of the blocks of lanes, one per thread.
    slots
        Arguments of the kernels except the values of K.
    in_parallel
        Number of rows that threads write by themselves; the others have elements of several threads, and are written afterwards.
    starts, sources
        Slots in which threads add to the pair slots of those other rows (`kernels.rows.fold_slots`).
    """

    parts: NDArray[np.int64]
    slots: RowSlots
    in_parallel: int
    starts: NDArray[np.int64]
    sources: NDArray[np.int64]


class RowOrder(NamedTuple):
    """Nodes (n,) in the order of their rows, the number of rows that threads write by themselves, and of rows done before each
    block.
    """

    nodes: NDArray[np.int64]
    in_parallel: int
    done: NDArray[np.int64]


class RowBlocks(NamedTuple):
    """Blocks of the rows: the first of each row, their pair of nodes (-1 for the node itself), and their indices in the values.

    `first` is the index of the first value of each row, `columns` are indices of blocks from there, `strides` as in `Rows`.
    """

    begin: NDArray[np.int64]
    pair_of: NDArray[np.int32]
    first: NDArray[np.int64]
    columns: NDArray[Any]
    strides: NDArray[np.int32]


class ElementRows:
    """Indices of the blocks of elements in the values of a matrix.

    Parameters
    ----------
    elements
        The elements.
    pairs
        Blocks of node pairs of the elements.
    pattern
        Pattern of the matrix.
    dtype
        Type of its values.
    """

    def __init__(self, elements: KernelElements, pairs: PairBlocks, pattern: BlockPattern, dtype: DTypeLike) -> None:
        self._elements, self._pairs, self._pattern, self._dtype = elements, pairs, pattern, np.dtype(dtype)
        self._plan: tuple[int, RowPlan] | None = None
        self._part: PartOfRows | None = None

    @property
    def size(self) -> int:
        """Number of blocks of this term in the matrix: one for each node, two for each pair of nodes."""
        return len(self._elements.own.vertices) + 2 * self._elements.edges.total

    @cached_property
    def of_all_pairs(self) -> Rows:
        """Indices of the blocks of all pairs, for terms that make all blocks first."""
        return self._pairs.rows(self._pattern)

    def fill(self, linearize: Callable[[Any], list[Result]], data: Array, add: bool) -> tuple[list[Result], float]:
        """Write or add the values of K with the kernel `linearize`, which is called with the slots. Return its result for each
        part, and the trace of rows that are written afterwards.
        """
        plan = self.plan
        # all of K is written, and no other term has a part in it
        whole = not add and self._elements.d**2 * self.size == self._pattern.indptr[-1]
        buffered = whole and data.nbytes > PAST_CACHES and bool(data.flags.aligned)
        slots = plan.slots._replace(data=data, add=bool(add), buffered=buffered)
        found = linearize(slots)
        more = 0.0
        rows = len(slots.first)
        if plan.in_parallel < rows:
            run(row_kernels.fold_slots, parts_of(len(plan.starts) - 1, 0.1, threads()), plan.starts, plan.sources, slots)
            more = sum(run(row_kernels.finish_rows, plan.in_parallel + parts_of(rows - plan.in_parallel, 1, threads()), slots))
        return found, more

    @property
    def plan(self) -> RowPlan:
        """Plan for numba's present number of threads; a plan for another number is discarded."""
        if self._plan is None or self._plan[0] != threads():
            self._plan = threads(), self._make_plan(self._elements.force_shares)
        return self._plan[1]

    def part(self, indices: NDArray[np.int32]) -> PartOfRows:
        """Return the rows of a matrix of only the values `indices` (n,), ascending; rows for other values are discarded."""
        part = self._part
        if part is None or part.indices is not indices:
            self._part = part = PartOfRows(self, indices)
        return part

    def _make_plan(self, shares: Shares) -> RowPlan:
        order = self._order(shares)
        blocks = self._blocks(order)
        return self._table(shares, order, blocks)

    def _order(self, shares: Shares) -> RowOrder:
        """Order the rows by the part and the block of lanes after which their nodes are complete."""
        n = len(self._elements.own.vertices)
        part_of, last = last_uses(self._elements.t, shares.parts, n)
        nodes = np.argsort(part_of, kind="stable")
        in_parallel = int(np.count_nonzero(part_of < len(shares.parts) - 1))
        complete = np.maximum.accumulate(last[nodes[:in_parallel]])  # rows are written one after the other
        return RowOrder(nodes, in_parallel, np.searchsorted(complete, np.arange(len(self._elements.t) + 1)))

    def _blocks(self, order: RowOrder) -> RowBlocks:
        """Find the indices of each row's blocks, its own and those of pairs, in the values of the matrix."""
        pattern, vertices = self._pattern, self._elements.own.vertices
        star, others, entries = self._elements.edges.stars(len(vertices))
        pair_of = np.where(entries == OWN, -1, np.where(entries >= 0, entries, -1 - entries))
        counts = np.diff(star)[order.nodes]
        begin = np.concatenate([[0], np.cumsum(counts)])
        gathered = np.arange(begin[-1]) + np.repeat(star[order.nodes] - begin[:-1], counts)
        mine = vertices[order.nodes]
        first = pattern.indptr[self._elements.d * mine.astype(np.int64)].astype(np.int64)
        columns = pattern.block_indices(np.repeat(mine, counts), vertices[others[gathered]]) - np.repeat(first, counts)
        return RowBlocks(begin, pair_of[gathered], first, columns, pattern.strides[mine])

    def _table(self, shares: Shares, order: RowOrder, blocks: RowBlocks) -> RowPlan:
        """Assign a slot to each pair for as long as it is needed, and return the table of the kernels."""
        elements, pairs, parts, in_parallel = self._elements, self._elements.edges, shares.parts, order.in_parallel
        first, strides, sizes = blocks.first, blocks.strides, elements.d * blocks.strides
        row_of = np.empty(len(order.nodes), dtype=np.int64)
        row_of[order.nodes] = np.arange(len(order.nodes))
        slots, fresh, marks, slot, targets, size = assign_slots(
            pairs.t2e, pairs.edges, parts, row_of, order.done, blocks.begin, blocks.pair_of
        )
        if pairs.transposed.size:
            slots |= pairs.transposed
        apart = np.count_nonzero(first[1:in_parallel] != (first + sizes)[: max(in_parallel - 1, 0)])
        table = RowSlots(
            slots=slots,
            fresh=fresh,
            marks=marks,
            done=order.done,
            begin=blocks.begin,
            own=np.flatnonzero(blocks.pair_of < 0),
            entries=np.where(blocks.pair_of < 0, 0, slot[blocks.pair_of]).astype(np.uint32),
            columns=blocks.columns.astype(np.uint32 if strides.max(initial=0) > np.iinfo(np.uint16).max else np.uint16),
            first=first,
            strides=strides,
            sizes=sizes.astype(np.int64),
            retained_begin=np.zeros(len(order.nodes) + 1, dtype=np.int64),
            retained=np.empty(0, dtype=np.uint32),
            first_eight=on_lines(8 * size, self._dtype),
            ninth=np.zeros(size, dtype=self._dtype),
            d=elements.d,
            data=np.empty(0, dtype=self._dtype),
            add=False,
            buffered=False,
            scattered=bool(apart > len(first) // 8),
            beyond_cache=8 * size * self._dtype.itemsize > IN_CACHE,
            largest_row=int(sizes.max(initial=0)),
        )
        lasting = int(slot[(row_of[pairs.edges] >= in_parallel).any(axis=1)].max(initial=-1)) + 1
        ascending = np.argsort(targets, kind="stable")
        starts = np.searchsorted(targets[ascending], np.arange(lasting + 1))
        return RowPlan(parts, table, in_parallel, starts, lasting + ascending)

    @property
    def nbytes(self) -> int:
        """Number of bytes of its arrays."""
        plan = () if self._plan is None else [value for value in self._plan[1].slots if isinstance(value, np.ndarray)]
        return nbytes(plan) + nbytes(self.__dict__.get("of_all_pairs", ()))


class PartOfRows(ElementRows):
    """Indices of the blocks of elements in a part of a matrix, such as that of free degrees of freedom.

    Parameters
    ----------
    whole
        Indices of the rows in the whole matrix.
    indices
        Indices of the values in the part, ascending.
    """

    def __init__(self, whole: ElementRows, indices: NDArray[np.int32]) -> None:
        super().__init__(whole._elements, whole._pairs, whole._pattern, whole._dtype)
        self._whole, self.indices = whole, indices

    def _make_plan(self, shares: Shares) -> RowPlan:
        """Return the plan of the whole matrix without the rows, and the entries of rows, outside the part."""
        whole = self._whole.plan
        slots, indices = whole.slots, self.indices
        first, last = np.searchsorted(indices, slots.first), np.searchsorted(indices, slots.first + slots.sizes)
        counts = np.where(last - first < slots.sizes, last - first, 0)
        retained_begin = np.concatenate([[0], np.cumsum(counts)])
        of_row = np.arange(retained_begin[-1]) - np.repeat(retained_begin[:-1] - first, counts)
        retained = (indices[of_row] - np.repeat(slots.first, counts)).astype(np.uint32)
        return whole._replace(
            slots=slots._replace(first=first, sizes=last - first, retained_begin=retained_begin, retained=retained)
        )


def on_lines(size: int, dtype: np.dtype[Any]) -> Array:
    """Return zeros (size,) that begin at the start of a cache line."""
    zeros = np.zeros(size + LINE // dtype.itemsize, dtype=dtype)
    skipped = -zeros.ctypes.data % LINE // dtype.itemsize
    return zeros[skipped : skipped + size]
