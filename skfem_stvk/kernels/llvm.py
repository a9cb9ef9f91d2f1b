"""LLVM instructions that numba does not offer: transposing eight lanes at once, and writing cache lines past the caches.

Each function has an equivalent Python body, which runs when numba is switched off, and the instructions that numba compiles.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import types
from numba.extending import intrinsic, overload

from .compiled import OPTIONS_OF_PIECES, Ids, Reals
from .lanes import LANES, TRANSPOSED

#: Number of bytes of a cache line, which is written at once.
LINE = 64
#: Indices of the first eight numbers of the transpose of a block. The ninth number is the same.
_TRANSPOSE = (0, 3, 6, 1, 4, 7, 2, 5)
#: Number of lanes that are transposed at once.
LANES_AT_ONCE = 8

_WORD, _INDEX = ir.IntType(32), ir.IntType(64)


def add_lanes(values: Reals, at: int, slots: Ids, first: int, first_eight: Reals, ninth: Reals) -> None:
    """Add the blocks of LANES_AT_ONCE lanes to their slots `slots[first]` ...

    The nine numbers of a block begin at `values[at]`, with a stride of LANES. Slot `s` has the first eight numbers of a block in
    `first_eight[8 s]` ..., one cache line, and the ninth in `ninth[s]`. Nine numbers in a row would usually lie in two cache lines.
    """
    for lane in range(LANES_AT_ONCE):
        slot = int(slots[first + lane])
        for i in range(8):
            first_eight[8 * slot + i] += values[at + i * LANES + lane]
        ninth[slot] += values[at + 8 * LANES + lane]


def add_lanes_with_transposes(values: Reals, at: int, slots: Ids, first: int, first_eight: Reals, ninth: Reals) -> None:
    """Add blocks like `add_lanes`, but add the transpose of a block if its slot has the bit TRANSPOSED."""
    for lane in range(LANES_AT_ONCE):
        slot, flagged = int(slots[first + lane] & ~TRANSPOSED), slots[first + lane] >= TRANSPOSED
        for i in range(8):
            of = _TRANSPOSE[i] if flagged else i
            first_eight[8 * slot + i] += values[at + of * LANES + lane]
        ninth[slot] += values[at + 8 * LANES + lane]


def store_line(data: Reals, to: int, buffer: Reals, at: int) -> None:
    """Write a cache line of numbers `buffer[at]` ... to `data[to]` ..., past the caches; `data[to]` must be the start of a line.

    The memory is then not read before it is written, and the contents of the caches remain.
    """
    width = LINE // data.itemsize
    data[to : to + width] = buffer[at : at + width]


def prefetch_to_write(data: Reals, at: int) -> None:
    """Prefetch the cache line of `data[at]` for writing; `at` may lie outside of the array."""


def prefetch_to_read(data: Any, at: int, count: int) -> None:
    """Prefetch the cache lines of `count` numbers from `data[at]` on for reading; the indices may lie outside of the array."""


def fence() -> None:
    """Make the writes of `store_line` visible to other threads."""


def _intrinsic(function: Any) -> Any:
    """Return an intrinsic from `function`, whose first argument is supplied by numba."""
    return intrinsic(function)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, at: Any) -> Any:
    """Return the address of an entry of an array."""
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [at])


def _constant(value: int) -> Any:
    return ir.Constant(_INDEX, value)


def _transpose_vectors(builder: Any, rows: list[Any]) -> list[Any]:
    """Return the transpose of eight vectors of eight numbers."""

    def shuffled(a: Any, b: Any, order: tuple[int, ...]) -> Any:
        return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_WORD, LANES_AT_ONCE), order))

    pairs = []
    for i in range(0, LANES_AT_ONCE, 2):
        pairs.append(shuffled(rows[i], rows[i + 1], (0, 8, 2, 10, 4, 12, 6, 14)))
        pairs.append(shuffled(rows[i], rows[i + 1], (1, 9, 3, 11, 5, 13, 7, 15)))
    columns: list[Any] = [None] * LANES_AT_ONCE
    for odd in (0, 1):
        for later, order in enumerate(((0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15))):
            upper, lower = shuffled(pairs[odd], pairs[2 + odd], order), shuffled(pairs[4 + odd], pairs[6 + odd], order)
            columns[2 * later + odd] = shuffled(upper, lower, (0, 1, 2, 3, 8, 9, 10, 11))
            columns[2 * later + odd + 4] = shuffled(upper, lower, (4, 5, 6, 7, 12, 13, 14, 15))
    return columns


def _adding(kinds: Any, may_transpose: bool) -> Any:
    """Return the signature and the code generator of `add_lanes` or, if `may_transpose`, of `add_lanes_with_transposes`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number, size = context.get_data_type(kinds[0].dtype), kinds[0].dtype.bitwidth // 8
        vector = ir.VectorType(number, LANES_AT_ONCE)

        def pointer(i: int, index: Any) -> Any:
            return _pointer(context, builder, kinds[i], arguments[i], index)

        def eight(address: Any) -> Any:
            return builder.bitcast(address, vector.as_pointer())

        rows = []
        for i in range(8):
            row = builder.load(eight(pointer(0, builder.add(arguments[1], _constant(i * LANES)))))
            row.align = size
            rows.append(row)
        order = ir.Constant(ir.VectorType(_WORD, LANES_AT_ONCE), _TRANSPOSE)
        for lane, block in enumerate(_transpose_vectors(builder, rows)):
            slot = builder.load(pointer(2, builder.add(arguments[3], _constant(lane))))
            if may_transpose:
                bit = ir.Constant(_WORD, int(TRANSPOSED))
                flagged = builder.icmp_unsigned(">=", slot, bit)
                slot = builder.and_(slot, builder.not_(bit))
                block = builder.select(flagged, builder.shuffle_vector(block, block, order), block)
            slot = builder.zext(slot, _INDEX)
            to = eight(pointer(4, builder.shl(slot, _constant(3))))
            before = builder.load(to)
            before.align = size
            builder.store(builder.fadd(before, block), to).align = size
            to = pointer(5, slot)
            ninth = builder.load(pointer(0, builder.add(arguments[1], _constant(8 * LANES + lane))))
            builder.store(builder.fadd(builder.load(to), ninth), to)
        return context.get_dummy_value()

    return types.void(*kinds), generate


@_intrinsic
def _add_lanes(typing: Any, values: Any, at: Any, slots: Any, first: Any, first_eight: Any, ninth: Any) -> Any:
    return _adding((values, types.int64, slots, types.int64, first_eight, ninth), False)


@_intrinsic
def _add_lanes_with_transposes(typing: Any, values: Any, at: Any, slots: Any, first: Any, first_eight: Any, ninth: Any) -> Any:
    return _adding((values, types.int64, slots, types.int64, first_eight, ninth), True)


@_intrinsic
def _store_line(typing: Any, data: Any, to: Any, buffer: Any, at: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        size = signature.args[0].dtype.bitwidth // 8
        vector = ir.VectorType(context.get_data_type(signature.args[0].dtype), LINE // size).as_pointer()
        line = builder.load(builder.bitcast(_pointer(context, builder, signature.args[2], arguments[2], arguments[3]), vector))
        line.align = size
        stored = builder.store(line, builder.bitcast(_pointer(context, builder, signature.args[0], *arguments[:2]), vector))
        stored.align = LINE
        stored.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(_WORD, 1)]))
        return context.get_dummy_value()

    return types.void(data, types.int64, buffer, types.int64), generate


def _prefetching(context: Any, builder: Any, array_type: Any, arguments: Any, write: int) -> Any:
    byte = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [byte, _WORD, _WORD, _WORD])
    function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
    address = builder.bitcast(_pointer(context, builder, array_type, *arguments), byte)
    builder.call(function, [address, *(ir.Constant(_WORD, i) for i in (write, 3, 1))])  # in the data cache of level 1
    return context.get_dummy_value()


@_intrinsic
def _prefetch_to_write(typing: Any, data: Any, at: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _prefetching(context, builder, signature.args[0], arguments, 1)

    return types.void(data, types.int64), generate


@_intrinsic
def _prefetch_to_read(typing: Any, data: Any, at: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _prefetching(context, builder, signature.args[0], arguments, 0)

    return types.void(data, types.int64), generate


@_intrinsic
def _fence(typing: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), generate


@overload(add_lanes, jit_options=OPTIONS_OF_PIECES, strict=False)
def _of_add_lanes(values: Any, at: Any, slots: Any, first: Any, first_eight: Any, ninth: Any) -> Any:
    return lambda values, at, slots, first, first_eight, ninth: _add_lanes(values, at, slots, first, first_eight, ninth)


@overload(add_lanes_with_transposes, jit_options=OPTIONS_OF_PIECES, strict=False)
def _of_add_lanes_with_transposes(values: Any, at: Any, slots: Any, first: Any, first_eight: Any, ninth: Any) -> Any:
    return lambda values, at, slots, first, first_eight, ninth: _add_lanes_with_transposes(
        values, at, slots, first, first_eight, ninth
    )


@overload(store_line, jit_options=OPTIONS_OF_PIECES, strict=False)
def _of_store_line(data: Any, to: Any, buffer: Any, at: Any) -> Any:
    return lambda data, to, buffer, at: _store_line(data, to, buffer, at)


@overload(prefetch_to_read, jit_options=OPTIONS_OF_PIECES, strict=False)
def _of_prefetch_to_read(data: Any, at: Any, count: Any) -> Any:
    width = LINE // (data.dtype.bitwidth // 8)

    def lines(data: Any, at: Any, count: Any) -> None:
        for i in range(0, count, width):
            _prefetch_to_read(data, at + i)

    return lines


@overload(prefetch_to_write, jit_options=OPTIONS_OF_PIECES, strict=False)
def _of_prefetch_to_write(data: Any, at: Any) -> Any:
    return lambda data, at: _prefetch_to_write(data, at)


@overload(fence, jit_options=OPTIONS_OF_PIECES, strict=False)
def _of_fence() -> Any:
    return lambda: _fence()
