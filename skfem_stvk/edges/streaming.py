"""The values of K row by row, each as soon as the last element of its node has been added: setup and calls of `kernels.rows`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..kernels import rows as row_kernels
from ..kernels.rows import RowSlots
from ..kernels.threads import parts_of, run, threads
from ..kernels.topology import OWN, assign_slots, last_uses
from ..kernels.wide import LINE
from .elements import OwnElements, nbytes
from .pairs import BlockPattern, PairBlocks, Rows
from .topology import Shares

Result = TypeVar("Result")

#: Bytes of a matrix from which on it is written past the caches: a smaller one is read from them afterwards.
PAST_CACHES = 2**21
#: Bytes of slots that a core's own cache holds.
IN_CACHE = 2**20


class RowPlan(NamedTuple):
    """Plan by which threads write the rows of K.

    Attributes
    ----------
    parts : of the blocks of lanes.
    slots : for the kernels, but for the values of K.
    in_work : rows that threads write by themselves; the others have elements of several threads, and are written afterwards.
    starts, sources : the slots in which threads add to the slots of pairs of those others (`kernels.rows.fold_slots`).
    """

    parts: NDArray[np.int64]
    slots: RowSlots
    in_work: int
    starts: NDArray[np.int64]
    sources: NDArray[np.int64]


class RowOrder(NamedTuple):
    """Nodes (n,) in the order of their rows, how many rows threads write by themselves, and how many are done before each block."""

    nodes: NDArray[np.int64]
    in_work: int
    done: NDArray[np.int64]


class RowBlocks(NamedTuple):
    """Blocks of the rows: where those of each begin, their pair of nodes, -1 for the node itself, and their places.

    `first` is the place of the first value of each row, `columns` are places of blocks from there, `strides` as in `Rows`.
    """

    begin: NDArray[np.int64]
    pair_of: NDArray[np.int32]
    first: NDArray[np.int64]
    columns: NDArray[Any]
    strides: NDArray[np.int32]


class ElementRows:
    """Places of the blocks of elements in the values of a matrix.

    Parameters
    ----------
    elements : whose.
    pairs : what is made of their blocks.
    pattern : of the matrix.
    dtype : of its values.
    """

    def __init__(self, elements: OwnElements, pairs: PairBlocks, pattern: BlockPattern, dtype: DTypeLike) -> None:
        self._elements, self._pairs, self._pattern, self._dtype = elements, pairs, pattern, np.dtype(dtype)
        self._plan: tuple[int, RowPlan] | None = None
        self._part: PartOfRows | None = None

    @property
    def size(self) -> int:
        """The number of blocks of this term in the matrix: one for each node, two for each pair of nodes."""
        return len(self._elements.own.vertices) + 2 * self._elements.edges.total

    @cached_property
    def of_all_pairs(self) -> Rows:
        """Places of the blocks of all pairs, for terms that make these first."""
        return self._pairs.rows(self._pattern)

    def fill(self, linearize: Callable[[Any], list[Result]], data: Array, add: bool) -> tuple[list[Result], float]:
        """Have the kernel `linearize` write the values of K, or add them, by slots that it is handed; what it returns for each
        part, and the trace of rows that were written afterwards."""
        plan = self.plan
        # all of K is written, and no other term has a part in it
        whole = not add and self._elements.d**2 * self.size == self._pattern.indptr[-1]
        staged = whole and data.nbytes > PAST_CACHES and bool(data.flags.aligned)
        slots = plan.slots._replace(data=data, add=bool(add), staged=staged)
        found = linearize(slots)
        more = 0.0
        rows = len(slots.first)
        if plan.in_work < rows:
            run(row_kernels.fold_slots, parts_of(len(plan.starts) - 1, 0.1, threads()), plan.starts, plan.sources, slots)
            more = sum(run(row_kernels.finish_rows, plan.in_work + parts_of(rows - plan.in_work, 1, threads()), slots))
        return found, more

    @property
    def plan(self) -> RowPlan:
        """For the number of threads that there are now; that for another number is thrown away."""
        if self._plan is None or self._plan[0] != threads():
            self._plan = threads(), self._made(self._elements.forces)
        return self._plan[1]

    def part(self, places: NDArray[np.int32]) -> PartOfRows:
        """The same for a matrix of the values at these `places` (n,) alone, ascending; that for others is thrown away."""
        part = self._part
        if part is None or part.places is not places:
            self._part = part = PartOfRows(self, places)
        return part

    def _made(self, shares: Shares) -> RowPlan:
        order = self._order(shares)
        blocks = self._blocks(order)
        return self._table(shares, order, blocks)

    def _order(self, shares: Shares) -> RowOrder:
        """Order the rows by the part and the block of lanes after which their nodes are complete."""
        n = len(self._elements.own.vertices)
        part_of, last = last_uses(self._elements.t, shares.parts, n)
        nodes = np.argsort(part_of, kind="stable")
        in_work = int(np.count_nonzero(part_of < len(shares.parts) - 1))
        complete = np.maximum.accumulate(last[nodes[:in_work]])  # one after the other, as they are written
        return RowOrder(nodes, in_work, np.searchsorted(complete, np.arange(len(self._elements.t) + 1)))

    def _blocks(self, order: RowOrder) -> RowBlocks:
        """Place the blocks of each row, its own and those of pairs, in the values of the matrix."""
        pattern, vertices = self._pattern, self._elements.own.vertices
        star, others, entries = self._elements.edges.stars(len(vertices))
        pair_of = np.where(entries == OWN, -1, np.where(entries >= 0, entries, -1 - entries))
        counts = np.diff(star)[order.nodes]
        begin = np.concatenate([[0], np.cumsum(counts)])
        gathered = np.arange(begin[-1]) + np.repeat(star[order.nodes] - begin[:-1], counts)
        mine = vertices[order.nodes]
        first = pattern.indptr[self._elements.d * mine.astype(np.int64)].astype(np.int64)
        columns = pattern.places(np.repeat(mine, counts), vertices[others[gathered]]) - np.repeat(first, counts)
        return RowBlocks(begin, pair_of[gathered], first, columns, pattern.strides[mine])

    def _table(self, shares: Shares, order: RowOrder, blocks: RowBlocks) -> RowPlan:
        """Give each pair a slot for as long as it is needed; the table of the kernels."""
        elements, pairs, parts, in_work = self._elements, self._elements.edges, shares.parts, order.in_work
        first, strides, sizes = blocks.first, blocks.strides, elements.d * blocks.strides
        row_of = np.empty(len(order.nodes), dtype=np.int64)
        row_of[order.nodes] = np.arange(len(order.nodes))
        slots, fresh, marks, slot, targets, size = assign_slots(
            pairs.t2e, pairs.edges, parts, row_of, order.done, blocks.begin, blocks.pair_of
        )
        if pairs.turned.size:
            slots |= pairs.turned
        apart = np.count_nonzero(first[1:in_work] != (first + sizes)[: max(in_work - 1, 0)])
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
            picked=np.zeros(len(order.nodes) + 1, dtype=np.int64),
            picks=np.empty(0, dtype=np.uint32),
            eights=on_lines(8 * size, self._dtype),
            ninths=np.zeros(size, dtype=self._dtype),
            d=elements.d,
            data=np.empty(0, dtype=self._dtype),
            add=False,
            staged=False,
            ahead=bool(apart > len(first) // 8),
            large=8 * size * self._dtype.itemsize > IN_CACHE,
            widest=int(sizes.max(initial=0)),
        )
        lasting = int(slot[(row_of[pairs.edges] >= in_work).any(axis=1)].max(initial=-1)) + 1
        ascending = np.argsort(targets, kind="stable")
        starts = np.searchsorted(targets[ascending], np.arange(lasting + 1))
        return RowPlan(parts, table, in_work, starts, lasting + ascending)

    @property
    def nbytes(self) -> int:
        """The number of bytes that its arrays take."""
        plan = () if self._plan is None else [value for value in self._plan[1].slots if isinstance(value, np.ndarray)]
        return nbytes(plan) + nbytes(self.__dict__.get("of_all_pairs", ()))


class PartOfRows(ElementRows):
    """Places of the blocks of elements in a part of a matrix, such as that of free degrees of freedom.

    Parameters
    ----------
    whole : where they stand in all of it.
    places : of the values that the part has, ascending.
    """

    def __init__(self, whole: ElementRows, places: NDArray[np.int32]) -> None:
        super().__init__(whole._elements, whole._pairs, whole._pattern, whole._dtype)
        self._whole, self.places = whole, places

    def _made(self, shares: Shares) -> RowPlan:
        """Return the plan of the whole matrix without the rows, and the entries of rows, that the part does not have."""
        whole = self._whole.plan
        slots, places = whole.slots, self.places
        first, last = np.searchsorted(places, slots.first), np.searchsorted(places, slots.first + slots.sizes)
        counts = np.where(last - first < slots.sizes, last - first, 0)
        picked = np.concatenate([[0], np.cumsum(counts)])
        of_row = np.arange(picked[-1]) - np.repeat(picked[:-1] - first, counts)
        picks = (places[of_row] - np.repeat(slots.first, counts)).astype(np.uint32)
        return whole._replace(slots=slots._replace(first=first, sizes=last - first, picked=picked, picks=picks))


def on_lines(size: int, dtype: np.dtype[Any]) -> Array:
    """Zeros (size,) that begin where a line of the caches begins."""
    zeros = np.zeros(size + LINE // dtype.itemsize, dtype=dtype)
    skipped = -zeros.ctypes.data % LINE // dtype.itemsize
    return zeros[skipped : skipped + size]
