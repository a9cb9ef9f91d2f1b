"""Destinations of the blocks of node pairs that the element kernels compute: an array of all blocks, or directly the rows of K.

A row of K is complete when the last element of its node has been added. `RowSlots` writes it at that moment, while its blocks are
in the cache. No array of all blocks is needed then, only a few slots. A slot is reused as soon as both rows of its pair are
written. Slots are assigned once, like the registers of a compiler (`topology.assign_slots`). Rows are assembled in a small array,
the staging buffer `stage`. Complete cache lines of it are written past the caches.

An element kernel gets an argument `to`, a PairSlots or a RowSlots, and ends each block of lanes with `add_blocks`. The type of `to`
is known at compile time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .blocks import transposed
from .compiled import Ids, Reals, by_type, inlined, kernel
from .lanes import LANES, TRANSPOSED, I, scatter_blocks
from .wide import LINE, WIDE, add_lanes, add_turned_lanes, fence, prefetch, store_line


class PairSlots(NamedTuple):
    """Slots for the blocks of all pairs.

    Attributes
    ----------
    slots : (blocks of lanes, m LANES) slots of the pairs of elements.
    marks : (blocks of lanes + 1,) number of pairs that occur in the preceding blocks of lanes. Block `i` is the first with the
        pairs `marks[i]` ... `marks[i + 1] - 1`, which are set to zero just before it is added.
    blocks : (9 slots,) `K_ab`, row by row.
    """

    slots: Ids
    marks: Ids
    blocks: Reals


class RowSlots(NamedTuple):
    """Slots for the blocks of the pairs in use, and the rows of K that are assembled from them.

    The row of a node consists of its lower neighbours, the node itself, and its upper neighbours.

    Attributes
    ----------
    slots : (blocks of lanes, m LANES) slots of the pairs of elements.
    fresh : (pairs,) slots in the order in which pairs begin to use them.
    marks : (blocks of lanes + 1,) number of entries of `fresh` that the preceding blocks of lanes begin to use. Block `i` begins
        to use `fresh[marks[i]]` ... `fresh[marks[i + 1] - 1]`, which are set to zero just before it is added.
    done : (blocks of lanes + 1,) number of rows that are complete before each block of lanes.
    begin : (rows + 1,) index of the first entry of each row.
    own : (rows,) index of the entry of the node itself.
    entries : (m,) slots of the pairs.
    columns : (m,) offset in K from the first value of the row to the first value of each block.
    first : (rows,) index in K of the first value of each row.
    strides : (rows,) offset in K from one row of a node to its next row.
    sizes : (rows,) number of values of each row in K.
    picked, picks : (rows + 1,), (m,) for rows of which K holds only a part: the indices of the values that it holds. Other rows
        have no entries.
    eights, ninths : (8 slots,), (slots,) the first eight numbers and the ninth of each block `K_ab`, row by row.
    d : number of components of a node.
    data : values of K.
    add : whether values are added to those of K. Otherwise they are written.
    staged : whether rows go through the staging buffer. Then each row is all that the rows of K of its node contain, and it is
        written, not added.
    ahead : whether rows are far apart in K.
    large : whether the slots exceed the cache of a core. Then each slot is prefetched shortly before a block is added to it.
    widest : number of values of the largest row of a node.
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
    picked: Ids
    picks: Ids
    eights: Reals
    ninths: Reals
    d: int
    data: Reals
    add: bool
    staged: bool
    ahead: bool
    large: bool
    widest: int


class Staged(NamedTuple):
    """State of the staging buffer: it holds values `base + low` to `base + high` of K; and the trace of the rows so far."""

    base: int
    low: int
    high: int
    trace: float


#: Prefetch distance in pairs of a block of lanes. K of 2 000 000 tetrahedra takes 99 ns each with it, and 119 ns without.
SOON = 6

NOWHERE = -(2**62)


FORMULAS: dict[tuple[str, type], Any] = {}


def open_rows(to: Any) -> Any:
    """Return the staging buffer and its state `Staged` before the first call of `add_blocks`."""
    return FORMULAS["open_rows", type(to)](to)


def add_blocks(to: Any, points: Any, stage: Any, at: Any, block: int, values: Any) -> Any:
    """Add the blocks of the pairs of a block of lanes, `values` (9 m LANES,), and write the rows that they complete.

    Returns the new state of the staging buffer. For elements with a table of `points`, the bit TRANSPOSED of a slot marks blocks
    that are added transposed.
    """
    return FORMULAS["add_blocks", type(to)](to, points, stage, at, block, values)


def close_rows(to: Any, stage: Any, at: Any) -> Any:
    """Write the rest of the staging buffer, and return the trace of all rows.

    The trace is not finite if any value is not finite. It is zero for PairSlots.
    """
    return FORMULAS["close_rows", type(to)](to, stage, at)


@by_type(open_rows, PairSlots, FORMULAS)
def _open_pairs(to):
    return to.blocks[:0], Staged(NOWHERE, 0, 0, 0.0)


@by_type(add_blocks, PairSlots, FORMULAS)
def _add_to_pairs(to, points, stage, at, block, values):
    to.blocks[9 * to.marks[block] : 9 * to.marks[block + 1]] = 0  # just before they are added to, so that they are in the cache
    scatter_blocks(points, to.slots, block, values, to.blocks)
    return at


@by_type(close_rows, PairSlots, FORMULAS)
def _close_pairs(to, stage, at):
    return 0.0


@inlined
def _room(to):
    """Return an array for the staging buffer, followed by space for one row of which K holds a part."""
    staged, picked = to.widest + LINE if to.staged else 0, to.widest if len(to.picks) > 0 else 0
    return np.empty(staged + picked, to.eights.dtype)


@by_type(open_rows, RowSlots, FORMULAS)
def _open_rows(to):
    return _room(to), Staged(NOWHERE, 0, 0, 0.0)


@inlined
def _block(to, slot):
    at, e = I(8) * slot, to.eights
    return (
        e[at],
        e[at + I(1)],
        e[at + I(2)],
        e[at + I(3)],
        e[at + I(4)],
        e[at + I(5)],
        e[at + I(6)],
        e[at + I(7)],
        to.ninths[slot],
    )


@inlined
def _put_block(block, out, at, stride, d, add):
    """Write a block of `d` rows and columns, or add it."""
    if add:
        out[at] += block[0]
        if d > 1:
            out[at + I(1)] += block[1]
            out[at + stride] += block[3]
            out[at + stride + I(1)] += block[4]
        if d > 2:
            out[at + I(2)] += block[2]
            out[at + stride + I(2)] += block[5]
            out[at + stride + stride] += block[6]
            out[at + stride + stride + I(1)] += block[7]
            out[at + stride + stride + I(2)] += block[8]
    else:
        out[at] = block[0]
        if d > 1:
            out[at + I(1)] = block[1]
            out[at + stride] = block[3]
            out[at + stride + I(1)] = block[4]
        if d > 2:
            out[at + I(2)] = block[2]
            out[at + stride + I(2)] = block[5]
            out[at + stride + stride] = block[6]
            out[at + stride + stride + I(1)] = block[7]
            out[at + stride + stride + I(2)] = block[8]


def _in_order(function):
    """Compile without reassociation of sums, so that a row is bitwise identical on every path that writes it."""
    return inlined(function, fastmath={"contract", "nsz"})


@_in_order
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


@_in_order
def _put_row(to, row, out, at, d, add):
    """Write the row of a node to `out`, starting at index `at`, or add it.

    Returns the trace of the diagonal block, over three components.
    """
    zero, stride, entries, columns, own = to.eights.dtype.type(0), I(to.strides[row]), to.entries, to.columns, to.own[row]
    minus_sum = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    for i in range(to.begin[row], own):
        lower = transposed(_block(to, I(entries[I(i)])))
        _put_block(lower, out, at + I(columns[I(i)]), stride, d, add)
        minus_sum = _minus(minus_sum, lower)
    for i in range(own + 1, to.begin[row + 1]):
        upper = _block(to, I(entries[I(i)]))
        _put_block(upper, out, at + I(columns[I(i)]), stride, d, add)
        minus_sum = _minus(minus_sum, upper)
    _put_block(minus_sum, out, at + I(columns[I(own)]), stride, d, add)
    return minus_sum[0] + minus_sum[4] + minus_sum[8]


@inlined
def _pick(to, row, stage, out, at, add):
    """Write the values that K holds of the row at the end of the buffer `stage`, or add them."""
    first, whole = to.picked[row], len(stage) - to.widest
    for i in range(to.picked[row + 1] - first):
        value = stage[I(whole + to.picks[I(first + i)])]
        if add:
            out[I(at + i)] += value
        else:
            out[I(at + i)] = value


@inlined
def _put_part(to, row, stage):
    """Write the part of a row that K holds, or add it.

    The whole row is first assembled at the end of the buffer `stage`. This range is set to zero before, because other terms may
    also have entries in the row.
    """
    whole = len(stage) - to.widest
    for i in range(to.d * to.strides[row]):
        stage[I(whole + i)] = 0
    trace = _put_row(to, row, stage, I(whole), to.d, np.bool_(False))
    _pick(to, row, stage, to.data, to.first[row], to.add)
    return trace


@inlined
def _write(stage, low, high, base, data):
    for i in range(low, high):
        data[I(base + i)] = stage[I(i)]


@inlined
def _stage_row(to, stage, at, row):
    """Append a finished row to the staging buffer and flush complete cache lines."""
    base, low, high, trace = at
    data = to.data
    width, first = LINE // data.itemsize, to.first[row]
    if first != base + high:
        _write(stage, low, high, base, data)
        low = (first + data.ctypes.data // data.itemsize) % width
        base, high = first - low, low
    picked = to.picked[row] < to.picked[row + 1]
    where = I(len(stage) - to.widest if picked else high)
    trace += _put_row(to, row, stage, where, to.d, np.bool_(False))
    if picked:
        _pick(to, row, stage, stage, high, False)
    high += to.sizes[row]
    gone = 0
    if low > 0 and high >= width:  # the start of this line belongs to another row
        _write(stage, low, width, base, data)
        low, gone = 0, width
    while gone + width <= high:
        store_line(data, base + gone, stage, gone)
        gone += width
    if gone > 0:
        for i in range(width):
            stage[I(i)] = stage[I(gone + i)]
    return Staged(base + gone, low, high - gone, trace)


@inlined
def _have_brought(to, block):
    """Prefetch the destinations of the rows that are complete after a block.

    For rows that are written in complete cache lines, the first and the last line suffice.
    """
    width = LINE // to.data.itemsize
    for row in range(to.done[block], to.done[block + 1]):
        first, size = to.first[row], to.sizes[row]
        if to.staged:
            prefetch(to.data, first)
            prefetch(to.data, first + size)
        else:
            for i in range(0, size + width - 1, width):
                prefetch(to.data, first + i)


@inlined
def _bring_slots(to, at):
    """Prefetch the slots of a pair of a block of lanes."""
    slots = to.slots.reshape(-1)
    if at < len(slots):
        for lane in range(LANES):
            prefetch(to.eights, I(8) * I(slots[I(at + lane)] & ~TRANSPOSED))


@by_type(add_blocks, RowSlots, FORMULAS)
def _add_to_rows(to, points, stage, at, block, values):
    eights, ninths = to.eights, to.ninths
    zero = eights.dtype.type(0)
    for i in range(to.marks[block], to.marks[block + 1]):
        slot = I(to.fresh[I(i)])
        for c in range(8):
            eights[I(8) * slot + I(c)] = zero
        ninths[slot] = zero
    pairs = to.slots.shape[1] // LANES
    slots = to.slots[block]
    for pair in range(pairs):
        if to.large:
            _bring_slots(to, (block * pairs + pair + SOON) * LANES)
        for lane in range(0, LANES, WIDE):
            if points is None:
                add_lanes(values, 9 * pair * LANES + lane, slots, pair * LANES + lane, eights, ninths)
            else:
                add_turned_lanes(values, 9 * pair * LANES + lane, slots, pair * LANES + lane, eights, ninths)
    for row in range(to.done[block], to.done[block + 1]):
        if to.sizes[row] == 0:
            continue
        elif to.staged:
            at = _stage_row(to, stage, at, row)
        elif to.picked[row] < to.picked[row + 1]:
            at = Staged(at.base, at.low, at.high, at.trace + _put_part(to, row, stage))
        else:
            first = I(to.first[row])
            more = _put_row(to, row, to.data, first, to.d, to.add)
            at = Staged(at.base, at.low, at.high, at.trace + more)
    if to.ahead and block + 2 < len(to.done):
        _have_brought(to, block + 1)
    return at


@by_type(close_rows, RowSlots, FORMULAS)
def _close_rows(to, stage, at):
    _write(stage, at.low, at.high, at.base, to.data)
    fence()
    return at.trace


@kernel
def finish_rows(begin: int, end: int, to: RowSlots) -> float:
    """Write rows `begin` to `end`, whose blocks are complete, and return the sum of the traces of their diagonal blocks."""
    trace, room = 0.0, _room(to)
    for row in range(begin, end):
        if to.picked[row] < to.picked[row + 1]:
            trace += _put_part(to, row, room)
        elif to.sizes[row] > 0:
            trace += _put_row(to, row, to.data, I(to.first[row]), to.d, to.add)
    return trace


@kernel
def fold_slots(begin: int, end: int, starts: Ids, sources: Ids, to: RowSlots) -> None:
    """Add the slots `sources[starts[i]]` ... `sources[starts[i + 1] - 1]` of other parts to slot `i`, for `begin <= i < end`."""
    for slot in range(begin, end):
        for i in range(starts[slot], starts[slot + 1]):
            source = I(sources[i])
            for c in range(8):
                to.eights[I(8 * slot + c)] += to.eights[I(8) * source + I(c)]
            to.ninths[I(slot)] += to.ninths[source]
