"""Total Lagrangian tetrahedron, optimised as far as possible, element by element.

    F = sum_a d_a (x) g_a,   d_a = x_a - x_0        2 E = F'F - I        V S = V lam tr(E) I + 2 V mu E        f_a = F V S g_a
    K_ab = V [ lam h_a (x) h_b + mu h_b (x) h_a + mu G_ab F F' ] + (g_a . V S g_b) I,        h_a = F g_a

The forces of three vertices are computed, the fourth follows from the sum. `V lam / 2`, `V mu` and `V mu G_ab` are constants. Every
symmetry is used. Diagonal blocks are the row sums of the assembled K. The vertices of an element are in ascending order, so that
its blocks can be added to the blocks of the edges without transposition.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .body import Body
from .vectors import (
    Matrix,
    Vector,
    add,
    add_matrix,
    close_rows,
    combination,
    dot,
    gram,
    matrix,
    minus,
    outer,
    plus,
    product,
    shifted,
    subtract,
    sum_of,
    times,
    transposed,
    vector,
)


class Rest(NamedTuple):
    """Constants: `g` (nt, 3, 3) gradients of vertices 1 to 3, `half_lam`, `mu` (nt,) times V, `mu_gram` (nt, 6) `V mu G_ab`."""

    ends: NDArray[np.int32]
    t: NDArray[np.int32]
    t2e: NDArray[np.int32]
    g: NDArray[np.float64]
    half_lam: NDArray[np.float64]
    mu: NDArray[np.float64]
    mu_gram: NDArray[np.float64]


def force(rest: Rest, x: Any, out: Any) -> None:
    """Add F [N] at positions `x` (nv, 3) to `out`: 207 operations per tetrahedron."""
    for n in range(len(rest.t)):
        g = matrix(rest.g, n)
        Ft = gradient(rest, x, n, g)
        P = product_of(stress(Ft, rest.half_lam[n], rest.mu[n]), Ft)
        add_forces(rest, n, combination(g[0], P), combination(g[1], P), combination(g[2], P), out)


def tangent(rest: Rest, x: Any, blocks: Any, diagonal: Any) -> None:
    """Add K [N/m] to its blocks `K_ab` (ne, 3, 3), `a < b`, and `K_aa` (nv, 3, 3)."""
    for n in range(len(rest.t)):
        g, lam, mu = matrix(rest.g, n), rest.half_lam[n], rest.mu[n]
        Ft = gradient(rest, x, n, g)
        s11, s22, s33, s12, s13, s23 = tensions(stress(Ft, lam, mu), g)
        s01, s02, s03 = s11 + s12 + s13, s12 + s22 + s23, s13 + s23 + s33  # with the opposite sign, as h0
        h1, h2, h3 = product_of(g, Ft)
        h0 = plus(plus(h1, h2), h3)
        A = gram(transposed(Ft))
        lam = lam + lam
        l0, l1, l2 = times(lam, h0), times(lam, h1), times(lam, h2)
        m0, m1, m2 = times(mu, h0), times(mu, h1), times(mu, h2)
        add_matrix(blocks, rest.t2e[n, 0], block(pulled(l0, m0, h1), rest.mu_gram[n, 0], A, s01, True))
        add_matrix(blocks, rest.t2e[n, 2], block(pulled(l0, m0, h2), rest.mu_gram[n, 2], A, s02, True))
        add_matrix(blocks, rest.t2e[n, 3], block(pulled(l0, m0, h3), rest.mu_gram[n, 3], A, s03, True))
        add_matrix(blocks, rest.t2e[n, 1], block(pulled(l1, m1, h2), rest.mu_gram[n, 1], A, s12, False))
        add_matrix(blocks, rest.t2e[n, 4], block(pulled(l1, m1, h3), rest.mu_gram[n, 4], A, s13, False))
        add_matrix(blocks, rest.t2e[n, 5], block(pulled(l2, m2, h3), rest.mu_gram[n, 5], A, s23, False))
    close_rows(rest.ends, blocks, diagonal)


def gradient(rest: Any, x: Any, n: Any, g: Matrix) -> Matrix:
    """Return the columns of the deformation gradient `F`: 54 operations."""
    x0 = vector(x, rest.t[n, 0])
    d = (
        minus(vector(x, rest.t[n, 1]), x0),
        minus(vector(x, rest.t[n, 2]), x0),
        minus(vector(x, rest.t[n, 3]), x0),
    )
    return product_of(transposed(g), d)


def product_of(A: Matrix, B: Matrix) -> Matrix:
    """Return `A B`: 45 operations."""
    return combination(A[0], B), combination(A[1], B), combination(A[2], B)


def stress(Ft: Matrix, half_lam: Any, mu: Any) -> Matrix:
    """Return `V S`, the second Piola-Kirchhoff stress times the volume: 45 operations."""
    C = gram(Ft)
    xx, yy, zz = C[0][0] - 1.0, C[1][1] - 1.0, C[2][2] - 1.0
    pressure = half_lam * (xx + yy + zz)
    xy, xz, yz = mu * C[0][1], mu * C[0][2], mu * C[1][2]
    return (mu * xx + pressure, xy, xz), (xy, mu * yy + pressure, yz), (xz, yz, mu * zz + pressure)


def tensions(S: Matrix, g: Matrix) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return `g_a . V S g_b` for ab = 11, 22, 33, 12, 13, 23: 75 operations."""
    s1, s2, s3 = product(S, g[0]), product(S, g[1]), product(S, g[2])
    return dot(s1, g[0]), dot(s2, g[1]), dot(s3, g[2]), dot(s1, g[1]), dot(s1, g[2]), dot(s2, g[2])


def pulled(la: Vector, ma: Vector, hb: Vector) -> Matrix:
    """Return `V lam h_a (x) h_b + V mu h_b (x) h_a`: 27 operations."""
    return sum_of(outer(la, hb), outer(hb, ma))


def block(pull: Matrix, mu_gram: Any, A: Matrix, s: Any, fourth: Any) -> Matrix:
    """Return `pull + V mu G_ab F F' + s I`. If `fourth`, subtract `pull` and `s`: 18 operations."""
    xx, yy, zz = mu_gram * A[0][0], mu_gram * A[1][1], mu_gram * A[2][2]
    xy, xz, yz = mu_gram * A[0][1], mu_gram * A[0][2], mu_gram * A[1][2]
    if fourth:
        symmetric = (xx - s, xy, xz), (xy, yy - s, yz), (xz, yz, zz - s)
        return minus(symmetric[0], pull[0]), minus(symmetric[1], pull[1]), minus(symmetric[2], pull[2])
    return sum_of(shifted(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), s), pull)


def add_forces(rest: Any, n: Any, f1: Vector, f2: Vector, f3: Vector, out: Any) -> None:
    """Add the forces of an element to its vertices; the force on the first follows from the sum: 18 operations."""
    add(out, rest.t[n, 1], f1)
    add(out, rest.t[n, 2], f2)
    add(out, rest.t[n, 3], f3)
    subtract(out, rest.t[n, 0], plus(plus(f1, f2), f3))


def prepare(body: Body) -> Rest:
    """Return the constants of the elements."""
    V, g = body.geometry.volume, body.geometry.gradients
    a, b = np.array(((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))).T
    return Rest(
        ends=body.edges.T.copy(),
        t=body.t.T.copy(),
        t2e=body.t2e.T.copy(),
        g=g[:, 1:].copy(),
        half_lam=V * body.lam / 2,
        mu=V * body.mu,
        mu_gram=(V * body.mu)[:, None] * body.geometry.gram[:, a, b],
    )
