"""Vectors and matrices of size three as tuples, without loops, so that a compiler keeps them in registers.

A matrix is a tuple of its three rows.
"""

from __future__ import annotations

from typing import Any

Vector = tuple[Any, Any, Any]
Matrix = tuple[Vector, Vector, Vector]


def vector(x: Any, i: Any) -> Vector:
    """Return row `i` of `x` (n, 3)."""
    return x[i, 0], x[i, 1], x[i, 2]


def plus(a: Vector, b: Vector) -> Vector:
    """Return `a + b`: 3 operations."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def minus(a: Vector, b: Vector) -> Vector:
    """Return `a - b`: 3 operations."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def times(s: Any, a: Vector) -> Vector:
    """Return `s a`: 3 operations."""
    return s * a[0], s * a[1], s * a[2]


def dot(a: Vector, b: Vector) -> Any:
    """Return `a . b`: 5 operations."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def product(A: Matrix, b: Vector) -> Vector:
    """Return `A b`: 15 operations."""
    return dot(A[0], b), dot(A[1], b), dot(A[2], b)


def combination(c: Vector, A: Matrix) -> Vector:
    """Return `c_0 A_0 + c_1 A_1 + c_2 A_2` with the rows of A: 15 operations."""
    return plus(plus(times(c[0], A[0]), times(c[1], A[1])), times(c[2], A[2]))


def outer(a: Vector, b: Vector) -> Matrix:
    """Return `a (x) b`: 9 operations."""
    return times(a[0], b), times(a[1], b), times(a[2], b)


def transposed(A: Matrix) -> Matrix:
    """Return `A'`: no operation."""
    return (A[0][0], A[1][0], A[2][0]), (A[0][1], A[1][1], A[2][1]), (A[0][2], A[1][2], A[2][2])


def sum_of(A: Matrix, B: Matrix) -> Matrix:
    """Return `A + B`: 9 operations."""
    return plus(A[0], B[0]), plus(A[1], B[1]), plus(A[2], B[2])


def shifted(A: Matrix, s: Any) -> Matrix:
    """Return `A + s I`: 3 operations."""
    return (A[0][0] + s, A[0][1], A[0][2]), (A[1][0], A[1][1] + s, A[1][2]), (A[2][0], A[2][1], A[2][2] + s)


def gram(A: Matrix) -> Matrix:
    """Return `A A'`, which is symmetric: 30 operations."""
    xx, yy, zz = dot(A[0], A[0]), dot(A[1], A[1]), dot(A[2], A[2])
    xy, xz, yz = dot(A[0], A[1]), dot(A[0], A[2]), dot(A[1], A[2])
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def matrix(x: Any, i: Any) -> Matrix:
    """Return block `i` of `x` (n, 3, 3)."""
    return (
        (x[i, 0, 0], x[i, 0, 1], x[i, 0, 2]),
        (x[i, 1, 0], x[i, 1, 1], x[i, 1, 2]),
        (x[i, 2, 0], x[i, 2, 1], x[i, 2, 2]),
    )


def put(out: Any, i: Any, a: Vector) -> None:
    """Set `out_i = a`: no operation."""
    out[i, 0], out[i, 1], out[i, 2] = a


def add(out: Any, i: Any, a: Vector) -> None:
    """Compute `out_i += a`: 3 operations."""
    out[i, 0] += a[0]
    out[i, 1] += a[1]
    out[i, 2] += a[2]


def subtract(out: Any, i: Any, a: Vector) -> None:
    """Compute `out_i -= a`: 3 operations."""
    out[i, 0] -= a[0]
    out[i, 1] -= a[1]
    out[i, 2] -= a[2]


def add_matrix(out: Any, i: Any, A: Matrix) -> None:
    """Compute `out_i += A` for blocks `out` (n, 3, 3): 9 operations."""
    block = out[i]
    add(block, 0, A[0])
    add(block, 1, A[1])
    add(block, 2, A[2])


def subtract_matrix(out: Any, i: Any, A: Matrix) -> None:
    """Compute `out_i -= A` for blocks `out` (n, 3, 3): 9 operations."""
    block = out[i]
    subtract(block, 0, A[0])
    subtract(block, 1, A[1])
    subtract(block, 2, A[2])


def close_rows(ends: Any, blocks: Any, diagonal: Any) -> None:
    """Add `-sum_b K_ab` to `K_aa`, because a translation needs no force: 12 operations per edge.

    The sums are symmetric, so 6 entries are computed per end.
    """
    for i in range(len(ends)):
        K, A, B = blocks[i], diagonal[ends[i, 0]], diagonal[ends[i, 1]]
        for r in range(3):
            for s in range(r, 3):
                A[r, s] -= K[r, s]
                B[r, s] -= K[s, r]
    for a in range(len(diagonal)):
        D = diagonal[a]
        D[1, 0], D[2, 0], D[2, 1] = D[0, 1], D[0, 2], D[1, 2]
