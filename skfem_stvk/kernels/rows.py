"""Where the blocks of node pairs go that elements have: into an array of all, or straight into the rows of K.

A row of K is complete when the last element of its node has been added. Written then, while its blocks are in the cache, it needs
no array of all blocks, but a few slots, which other pairs have as soon as both rows of a pair are written: assigned once, like
registers (`topology.assign_slots`). Rows are put together in a small array, the `stage`, and leave it in whole lines past the
caches.

A kernel on elements is handed `to`, PairSlots or RowSlots, and ends each block of lanes with `add_blocks`; which of the two it is
is known when it is compiled.
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
    marks : (blocks of lanes + 1,) pairs that those before are the first to have: they are set to zero just before.
    blocks : (9 slots,) `K_ab`, row by row.
    """

    slots: Ids
    marks: Ids
    blocks: Reals


class RowSlots(NamedTuple):
    """Slots for the blocks of those pairs that are in work, and the rows of K that are made of them.

    A row of a node is its lower neighbours, itself, and its upper neighbours.

    Attributes
    ----------
    slots : (blocks of lanes, m LANES) slots of the pairs of elements.
    fresh : (pairs,) slots in the order in which pairs begin to use them.
    marks : (blocks of lanes + 1,) how many of them those before begin to use: they are set to zero just before.
    done : (blocks of lanes + 1,) rows that are complete before each.
    begin : (rows + 1,) where their entries begin.
    own : (rows,) the entry of the node itself.
    entries : (m,) slots of the pairs.
    columns : (m,) values from the first of the row of K to the first of each block.
    first : (rows,) the first value of each in K.
    strides : (rows,) values from a row of a node to its next.
    sizes : (rows,) values of each in K.
    picked, picks : (rows + 1,), (m,) of rows that K has a part of: which of their values it has. Others have none.
    eights, ninths : (8 slots,), (slots,) the first eight numbers and the ninth of each block `K_ab`, row by row.
    d : components of a node.
    data : values of K.
    add : whether they are added to; else written.
    staged : whether rows go through the stage: each is all there is of the rows of K of its node, and is written.
    ahead : whether rows are far apart in K.
    large : whether there are more slots than a core's cache holds, so that they are brought there soon before they are added to.
    widest : values in the largest row of a node.
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
    """What the stage of a part holds: the values of K from `base + low` to `base + high`; and the trace of the rows up to now."""

    base: int
    low: int
    high: int
    trace: float


#: How many pairs of lanes before they are added to: K of 2 000 000 tetrahedra took 119 ns each without it, and 99 with it.
SOON = 6

NOWHERE = -(2**62)


FORMULAS: dict[tuple[str, type], Any] = {}


def open_rows(to: Any) -> Any:
    """The stage, and what it holds for `add_blocks` of the first block."""
    return FORMULAS["open_rows", type(to)](to)


def add_blocks(to: Any, points: Any, stage: Any, at: Any, block: int, values: Any) -> Any:
    """Add the blocks of the pairs of a block of lanes, `values` (9 m LANES,), and write rows that are complete then; what the stage
    holds after that.

    Of elements with a table of `points` slots have the bit TRANSPOSED where blocks are added transposed.
    """
    return FORMULAS["add_blocks", type(to)](to, points, stage, at, block, values)


def close_rows(to: Any, stage: Any, at: Any) -> Any:
    """Write what the stage still holds; the trace of all rows, which is not finite if any value is not; zero without rows."""
    return FORMULAS["close_rows", type(to)](to, stage, at)


@by_type(open_rows, PairSlots, FORMULAS)
def _open_pairs(to):
    return to.blocks[:0], Staged(NOWHERE, 0, 0, 0.0)


@by_type(add_blocks, PairSlots, FORMULAS)
def _add_to_pairs(to, points, stage, at, block, values):
    to.blocks[9 * to.marks[block] : 9 * to.marks[block + 1]] = 0  # while it is in the cache
    scatter_blocks(points, to.slots, block, values, to.blocks)
    return at


@by_type(close_rows, PairSlots, FORMULAS)
def _close_pairs(to, stage, at):
    return 0.0


@inlined
def _room(to):
    """Room for the stage, and behind it for a row of which K has a part."""
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
    """Compile without regrouping of sums: a row is the same to the last bit whichever way it is written."""
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
    """Write the row of a node to `out[at]` ...; the sum of the diagonal of its diagonal block, of three components."""
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
    """Write what K has of a row that stands at the end of the stage."""
    first, whole = to.picked[row], len(stage) - to.widest
    for i in range(to.picked[row + 1] - first):
        value = stage[I(whole + to.picks[I(first + i)])]
        if add:
            out[I(at + i)] += value
        else:
            out[I(at + i)] = value


@inlined
def _put_part(to, row, stage):
    """Write the part of a row that K has, or add it, by way of the end of the stage: other terms may have places in it, too."""
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
    """Put a row behind those on the stage, and have whole lines leave it."""
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
    if low > 0 and high >= width:  # the line that another row begins
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
    """Prefetch where the rows that are complete after a block are to go: of those that go in whole lines, the two ends."""
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
    """Have the slots of a pair of a block of lanes brought into the cache."""
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
    """Write rows `begin` to `end`, whose blocks are complete; the sum of the diagonals of their diagonal blocks."""
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
