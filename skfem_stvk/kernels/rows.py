"""Destinations of the blocks of node pairs that the element kernels compute: an array of all blocks, or directly the rows of K.

A row of K is complete when the last element of its node has been added. `RowSlots` writes it at that moment, while its blocks are
in the cache. No array of all blocks is needed then, only a few slots. A slot is reused as soon as both rows of its pair are
written. Slots are assigned once, like the registers of a compiler (`topology.assign_slots`). Rows are assembled in a small array,
the staging buffer. Complete cache lines of it are written past the caches.

An element kernel gets an argument `to`, a PairSlots or a RowSlots, and ends each block of lanes with `add_blocks`. The type of `to`
is known at compile time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy import uint64

from .compiled import Ids, Reals, by_type, inlined, kernel
from .lanes import LANES, TRANSPOSED, scatter_blocks
from .llvm import LANES_AT_ONCE, LINE, add_lanes, add_lanes_with_transposes, fence, prefetch_to_write, store_line
from .node_blocks import transposed


class PairSlots(NamedTuple):
    """Slots for the blocks of all pairs.

    Attributes
    ----------
    slots
        (blocks of lanes, m LANES) slots of the pairs of elements.
    marks
        (blocks of lanes + 1,) number of pairs that occur in the preceding blocks of lanes. Block `i` is the first with the pairs
        `marks[i]` ... `marks[i + 1] - 1`, which are set to zero just before it is added.
    blocks
        (9 slots,) `K_ab`, row by row.
    """

    slots: Ids
    marks: Ids
    blocks: Reals


class RowSlots(NamedTuple):
    """Slots for the blocks of the pairs in use, and the rows of K that are assembled from them.

    The row of a node consists of its lower neighbours, the node itself, and its upper neighbours.

    Attributes
    ----------
    slots
        (blocks of lanes, m LANES) slots of the pairs of elements.
    fresh
        (pairs,) slots in the order in which pairs begin to use them.
    marks
        (blocks of lanes + 1,) number of entries of `fresh` that the preceding blocks of lanes begin to use. Block `i` begins to use
        `fresh[marks[i]]` ... `fresh[marks[i + 1] - 1]`, which are set to zero just before it is added.
    done
        (blocks of lanes + 1,) number of rows that are complete before each block of lanes.
    begin
        (rows + 1,) index of the first entry of each row.
    own
        (rows,) index of the entry of the node itself.
    entries
        (m,) slots of the pairs.
    columns
        (m,) offset in K from the first value of the row to the first value of each block.
    first
        (rows,) index in K of the first value of each row.
    strides
        (rows,) offset in K from one row of a node to its next row.
    sizes
        (rows,) number of values of each row in K.
    retained_begin, retained
        (rows + 1,), (m,) for rows of which K holds only a part: the indices of the values that it holds. Other rows have no
        entries.
    first_eight, ninth
        (8 slots,), (slots,) the first eight numbers and the ninth of each block `K_ab`, row by row.
    d
        Number of components of a node.
    data
        Values of K.
    add
        Whether values are added to those of K. Otherwise they are written.
    buffered
        Whether rows go through the staging buffer. Then each row is all that the rows of K of its node contain, and it is written,
        not added.
    scattered
        Whether rows are far apart in K.
    beyond_cache
        Whether the slots exceed the cache of a core. Then each slot is prefetched shortly before a block is added to it.
    largest_row
        Number of values of the largest row of a node.
    """

    slots: Ids
    fresh: Ids
    marks: Ids
    done: Ids
    begin: Ids
    own: Ids
    entries: Ids
    columns: Ids
    first: Ids
    strides: Ids
    sizes: Ids
    retained_begin: Ids
    retained: Ids
    first_eight: Reals
    ninth: Reals
    d: int
    data: Reals
    add: bool
    buffered: bool
    scattered: bool
    beyond_cache: bool
    largest_row: int


class BufferState(NamedTuple):
    """State of the staging buffer: it holds values `offset + begin` to `offset + end` of K; and the trace of the rows so far."""

    offset: int
    begin: int
    end: int
    trace: float


#: Prefetch distance in pairs of a block of lanes. K of 2 000 000 tetrahedra takes 99 ns each with it, and 119 ns without.
PREFETCH_PAIRS = 6

NO_OFFSET = -(2**62)


FORMULAS: dict[tuple[str, type], Any] = {}


def open_rows(to: Any) -> Any:
    """Return the staging buffer and its state `BufferState` before the first call of `add_blocks`."""
    return FORMULAS["open_rows", type(to)](to)


def add_blocks(to: Any, points: Any, buffer: Any, state: Any, block: int, values: Any) -> Any:
    """Add the blocks of the pairs of a block of lanes, `values` (9 m LANES,), and write the rows that they complete.

    Returns the new state of the staging buffer. For elements with a table of `points`, the bit TRANSPOSED of a slot marks blocks
    that are added transposed.
    """
    return FORMULAS["add_blocks", type(to)](to, points, buffer, state, block, values)


def close_rows(to: Any, buffer: Any, state: Any) -> Any:
    """Write the rest of the staging buffer, and return the trace of all rows.

    The trace is not finite if any value is not finite. It is zero for PairSlots.
    """
    return FORMULAS["close_rows", type(to)](to, buffer, state)


@by_type(open_rows, PairSlots, FORMULAS)
def _open_pairs(to):
    return to.blocks[:0], BufferState(NO_OFFSET, 0, 0, 0.0)


@by_type(add_blocks, PairSlots, FORMULAS)
def _add_to_pairs(to, points, buffer, state, block, values):
    to.blocks[9 * to.marks[block] : 9 * to.marks[block + 1]] = 0  # just before they are added to, so that they are in the cache
    scatter_blocks(points, to.slots, block, values, to.blocks)
    return state


@by_type(close_rows, PairSlots, FORMULAS)
def _close_pairs(to, buffer, state):
    return 0.0


@inlined
def _new_buffer(to):
    """Return an array for the staging buffer, followed by space for one row of which K holds a part."""
    lines, row = to.largest_row + LINE if to.buffered else 0, to.largest_row if len(to.retained) > 0 else 0
    return np.empty(lines + row, to.first_eight.dtype)


@by_type(open_rows, RowSlots, FORMULAS)
def _open_rows(to):
    return _new_buffer(to), BufferState(NO_OFFSET, 0, 0, 0.0)


@inlined
def _block(to, slot):
    at, e = uint64(8) * slot, to.first_eight
    return (
        e[at],
        e[at + uint64(1)],
        e[at + uint64(2)],
        e[at + uint64(3)],
        e[at + uint64(4)],
        e[at + uint64(5)],
        e[at + uint64(6)],
        e[at + uint64(7)],
        to.ninth[slot],
    )


@inlined
def _put_block(block, out, at, stride, d, add):
    """Write a block of `d` rows and columns, or add it."""
    if add:
        out[at] += block[0]
        if d > 1:
            out[at + uint64(1)] += block[1]
            out[at + stride] += block[3]
            out[at + stride + uint64(1)] += block[4]
        if d > 2:
            out[at + uint64(2)] += block[2]
            out[at + stride + uint64(2)] += block[5]
            out[at + stride + stride] += block[6]
            out[at + stride + stride + uint64(1)] += block[7]
            out[at + stride + stride + uint64(2)] += block[8]
    else:
        out[at] = block[0]
        if d > 1:
            out[at + uint64(1)] = block[1]
            out[at + stride] = block[3]
            out[at + stride + uint64(1)] = block[4]
        if d > 2:
            out[at + uint64(2)] = block[2]
            out[at + stride + uint64(2)] = block[5]
            out[at + stride + stride] = block[6]
            out[at + stride + stride + uint64(1)] = block[7]
            out[at + stride + stride + uint64(2)] = block[8]


def _without_reassociation(function):
    """Compile without reassociation of sums, so that a row is bitwise identical on every path that writes it."""
    return inlined(function, fastmath={"contract", "nsz"})


@_without_reassociation
def _minus(a, b):
    return (
        a[0] - b[0],
        a[1] - b[1],
        a[2] - b[2],
        a[3] - b[3],
        a[4] - b[4],
        a[5] - b[5],
        a[6] - b[6],
        a[7] - b[7],
        a[8] - b[8],
    )


@_without_reassociation
def _put_row(to, row, out, at, d, add):
    """Write the row of a node to `out`, starting at index `at`, or add it.

    Returns the trace of the diagonal block, over three components.
    """
    zero, stride, entries, columns, own = to.first_eight.dtype.type(0), uint64(to.strides[row]), to.entries, to.columns, to.own[row]
    minus_sum = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    for i in range(to.begin[row], own):
        lower = transposed(_block(to, uint64(entries[uint64(i)])))
        _put_block(lower, out, at + uint64(columns[uint64(i)]), stride, d, add)
        minus_sum = _minus(minus_sum, lower)
    for i in range(own + 1, to.begin[row + 1]):
        upper = _block(to, uint64(entries[uint64(i)]))
        _put_block(upper, out, at + uint64(columns[uint64(i)]), stride, d, add)
        minus_sum = _minus(minus_sum, upper)
    _put_block(minus_sum, out, at + uint64(columns[uint64(own)]), stride, d, add)
    return minus_sum[0] + minus_sum[4] + minus_sum[8]


@inlined
def _put_retained(to, row, buffer, out, at, add):
    """Write the values that K holds of the row at the end of the `buffer`, or add them."""
    first, whole = to.retained_begin[row], len(buffer) - to.largest_row
    for i in range(to.retained_begin[row + 1] - first):
        value = buffer[uint64(whole + to.retained[uint64(first + i)])]
        if add:
            out[uint64(at + i)] += value
        else:
            out[uint64(at + i)] = value


@inlined
def _put_part(to, row, buffer):
    """Write the part of a row that K holds, or add it.

    The whole row is first assembled at the end of the `buffer`. This range is set to zero before, because other terms may
    also have entries in the row.
    """
    whole = len(buffer) - to.largest_row
    for i in range(to.d * to.strides[row]):
        buffer[uint64(whole + i)] = 0
    trace = _put_row(to, row, buffer, uint64(whole), to.d, np.bool_(False))
    _put_retained(to, row, buffer, to.data, to.first[row], to.add)
    return trace


@inlined
def _write(buffer, begin, end, offset, data):
    for i in range(begin, end):
        data[uint64(offset + i)] = buffer[uint64(i)]


@inlined
def _buffer_row(to, buffer, state, row):
    """Append a finished row to the staging buffer and flush complete cache lines."""
    offset, begin, end, trace = state
    data = to.data
    width, first = LINE // data.itemsize, to.first[row]
    if first != offset + end:
        _write(buffer, begin, end, offset, data)
        begin = (first + data.ctypes.data // data.itemsize) % width
        offset, end = first - begin, begin
    partial = to.retained_begin[row] < to.retained_begin[row + 1]
    where = uint64(len(buffer) - to.largest_row if partial else end)
    trace += _put_row(to, row, buffer, where, to.d, np.bool_(False))
    if partial:
        _put_retained(to, row, buffer, buffer, end, False)
    end += to.sizes[row]
    flushed = 0
    if begin > 0 and end >= width:  # the start of this line belongs to another row
        _write(buffer, begin, width, offset, data)
        begin, flushed = 0, width
    while flushed + width <= end:
        store_line(data, offset + flushed, buffer, flushed)
        flushed += width
    if flushed > 0:
        for i in range(width):
            buffer[uint64(i)] = buffer[uint64(flushed + i)]
    return BufferState(offset + flushed, begin, end - flushed, trace)


@inlined
def _prefetch_rows(to, block):
    """Prefetch the destinations of the rows that are complete after a block.

    For rows that are written in complete cache lines, the first and the last line suffice.
    """
    width = LINE // to.data.itemsize
    for row in range(to.done[block], to.done[block + 1]):
        first, size = to.first[row], to.sizes[row]
        if to.buffered:
            prefetch_to_write(to.data, first)
            prefetch_to_write(to.data, first + size)
        else:
            for i in range(0, size + width - 1, width):
                prefetch_to_write(to.data, first + i)


@inlined
def _prefetch_slots(to, at):
    """Prefetch the slots of a pair of a block of lanes."""
    slots = to.slots.reshape(-1)
    if at < len(slots):
        for lane in range(LANES):
            prefetch_to_write(to.first_eight, uint64(8) * uint64(slots[uint64(at + lane)] & ~TRANSPOSED))


@by_type(add_blocks, RowSlots, FORMULAS)
def _add_to_rows(to, points, buffer, state, block, values):
    first_eight, ninth = to.first_eight, to.ninth
    zero = first_eight.dtype.type(0)
    for i in range(to.marks[block], to.marks[block + 1]):
        slot = uint64(to.fresh[uint64(i)])
        for c in range(8):
            first_eight[uint64(8) * slot + uint64(c)] = zero
        ninth[slot] = zero
    pairs = to.slots.shape[1] // LANES
    slots = to.slots[block]
    for pair in range(pairs):
        if to.beyond_cache:
            _prefetch_slots(to, (block * pairs + pair + PREFETCH_PAIRS) * LANES)
        for lane in range(0, LANES, LANES_AT_ONCE):
            if points is None:
                add_lanes(values, 9 * pair * LANES + lane, slots, pair * LANES + lane, first_eight, ninth)
            else:
                add_lanes_with_transposes(values, 9 * pair * LANES + lane, slots, pair * LANES + lane, first_eight, ninth)
    for row in range(to.done[block], to.done[block + 1]):
        if to.sizes[row] == 0:
            continue
        elif to.buffered:
            state = _buffer_row(to, buffer, state, row)
        elif to.retained_begin[row] < to.retained_begin[row + 1]:
            state = BufferState(state.offset, state.begin, state.end, state.trace + _put_part(to, row, buffer))
        else:
            first = uint64(to.first[row])
            more = _put_row(to, row, to.data, first, to.d, to.add)
            state = BufferState(state.offset, state.begin, state.end, state.trace + more)
    if to.scattered and block + 2 < len(to.done):
        _prefetch_rows(to, block + 1)
    return state


@by_type(close_rows, RowSlots, FORMULAS)
def _close_rows(to, buffer, state):
    _write(buffer, state.begin, state.end, state.offset, to.data)
    fence()
    return state.trace


@kernel
def finish_rows(begin: int, end: int, to: RowSlots) -> float:
    """Write rows `begin` to `end`, whose blocks are complete, and return the sum of the traces of their diagonal blocks."""
    trace, buffer = 0.0, _new_buffer(to)
    for row in range(begin, end):
        if to.retained_begin[row] < to.retained_begin[row + 1]:
            trace += _put_part(to, row, buffer)
        elif to.sizes[row] > 0:
            trace += _put_row(to, row, to.data, uint64(to.first[row]), to.d, to.add)
    return trace


@kernel
def fold_slots(begin: int, end: int, starts: Ids, sources: Ids, to: RowSlots) -> None:
    """Add the slots `sources[starts[i]]` ... `sources[starts[i + 1] - 1]` of other parts to slot `i`, for `begin <= i < end`."""
    for slot in range(begin, end):
        for i in range(starts[slot], starts[slot + 1]):
            source = uint64(sources[i])
            for c in range(8):
                to.first_eight[uint64(8 * slot + c)] += to.first_eight[uint64(8) * source + uint64(c)]
            to.ninth[uint64(slot)] += to.ninth[source]
