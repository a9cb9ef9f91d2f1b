"""Total Lagrangian tetrahedron of the textbooks: strains as Voigt vectors, and a matrix B from displacements to strains.

    f_a = B_a' V S        K_ab = B_a' V C B_b + (g_a . V S g_b) I        B_a: F_iI g_aI,  F_iI g_aJ + F_iJ g_aI

The code follows the formulation, with three optimisations. B is computed for three vertices, and the fourth follows from sums. V C
B_a uses the zeros of an isotropic C. Diagonal products are symmetric. A row of B is stored as the vector over `i`.
"""

from __future__ import annotations

from typing import Any

from .total_lagrangian import Rest, add_forces, gradient, prepare, stress, tensions
from .vectors import (
    Matrix,
    Vector,
    add_matrix,
    close_rows,
    matrix,
    outer,
    plus,
    shifted,
    subtract_matrix,
    sum_of,
    times,
    transposed,
)

__all__ = ["Rest", "force", "prepare", "tangent"]

#: Rows 11, 22, 33, 23, 13, 12 of `B_a`.
Rows = tuple[Vector, Vector, Vector, Vector, Vector, Vector]


def force(rest: Rest, x: Any, out: Any) -> None:
    """Add F [N] at positions `x` (nv, 3) to `out`: 324 operations per tetrahedron."""
    for n in range(len(rest.t)):
        g = matrix(rest.g, n)
        Ft = gradient(rest, x, n, g)
        S = stress(Ft, rest.half_lam[n], rest.mu[n])
        add_forces(rest, n, pulled(S, strains(Ft, g[0])), pulled(S, strains(Ft, g[1])), pulled(S, strains(Ft, g[2])), out)


def tangent(rest: Rest, x: Any, blocks: Any, diagonal: Any) -> None:
    """Add K [N/m] to its blocks `K_ab` (ne, 3, 3), `a < b`, and `K_aa` (nv, 3, 3)."""
    for n in range(len(rest.t)):
        g, lam, mu = matrix(rest.g, n), rest.half_lam[n], rest.mu[n]
        Ft = gradient(rest, x, n, g)
        S = stress(Ft, lam, mu)
        s11, s22, s33, s12, s13, s23 = tensions(S, g)
        B1, B2, B3 = strains(Ft, g[0]), strains(Ft, g[1]), strains(Ft, g[2])
        lam = lam + lam
        D1, D2, D3 = stresses(B1, lam, mu), stresses(B2, lam, mu), stresses(B3, lam, mu)
        K12 = shifted(product_of_rows(D1, B2), s12)
        K13 = shifted(product_of_rows(D1, B3), s13)
        K23 = shifted(product_of_rows(D2, B3), s23)
        K11 = shifted(square(D1, B1), s11)
        K22 = shifted(square(D2, B2), s22)
        K33 = shifted(square(D3, B3), s33)
        add_matrix(blocks, rest.t2e[n, 1], K12)
        add_matrix(blocks, rest.t2e[n, 4], K13)
        add_matrix(blocks, rest.t2e[n, 5], K23)
        subtract_matrix(blocks, rest.t2e[n, 0], sum_of(sum_of(K11, transposed(K12)), transposed(K13)))
        subtract_matrix(blocks, rest.t2e[n, 2], sum_of(sum_of(K12, K22), transposed(K23)))
        subtract_matrix(blocks, rest.t2e[n, 3], sum_of(sum_of(K13, K23), K33))
    close_rows(rest.ends, blocks, diagonal)


def strains(Ft: Matrix, g: Vector) -> Rows:
    """Return `B_a`: 36 operations."""
    return (
        times(g[0], Ft[0]),
        times(g[1], Ft[1]),
        times(g[2], Ft[2]),
        plus(times(g[2], Ft[1]), times(g[1], Ft[2])),
        plus(times(g[2], Ft[0]), times(g[0], Ft[2])),
        plus(times(g[1], Ft[0]), times(g[0], Ft[1])),
    )


def pulled(S: Matrix, B: Rows) -> Vector:
    """Return `B_a' V S`: 33 operations."""
    normal = plus(plus(times(S[0][0], B[0]), times(S[1][1], B[1])), times(S[2][2], B[2]))
    return plus(plus(plus(normal, times(S[1][2], B[3])), times(S[0][2], B[4])), times(S[0][1], B[5]))


def stresses(B: Rows, lam: Any, mu: Any) -> Rows:
    """Return `V C B_a`: 37 operations."""
    trace, double = times(lam, plus(plus(B[0], B[1]), B[2])), mu + mu
    return (
        plus(times(double, B[0]), trace),
        plus(times(double, B[1]), trace),
        plus(times(double, B[2]), trace),
        times(mu, B[3]),
        times(mu, B[4]),
        times(mu, B[5]),
    )


def product_of_rows(D: Rows, B: Rows) -> Matrix:
    """Return `D' B`: 99 operations."""
    normal = sum_of(sum_of(outer(D[0], B[0]), outer(D[1], B[1])), outer(D[2], B[2]))
    return sum_of(sum_of(sum_of(normal, outer(D[3], B[3])), outer(D[4], B[4])), outer(D[5], B[5]))


def square(D: Rows, B: Rows) -> Matrix:
    """Return `D' B` if it is symmetric: 66 operations."""
    xx, xy, xz = entry(D, B, 0, 0), entry(D, B, 0, 1), entry(D, B, 0, 2)
    yy, yz, zz = entry(D, B, 1, 1), entry(D, B, 1, 2), entry(D, B, 2, 2)
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def entry(D: Rows, B: Rows, r: Any, s: Any) -> Any:
    """Return `(D' B)_rs`: 11 operations."""
    normal = D[0][r] * B[0][s] + D[1][r] * B[1][s] + D[2][r] * B[2][s]
    return normal + D[3][r] * B[3][s] + D[4][r] * B[4][s] + D[5][r] * B[5][s]
