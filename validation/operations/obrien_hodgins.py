"""Element of O'Brien and Hodgins (1999): Green's strain from the matrix `beta` of barycentric coordinates, force by a double loop.

    dx/dX = P beta        eps = (dx/dX)' (dx/dX) - I        sigma = lam tr(eps) I + 2 mu eps
    f_i = c vol sum_j p_j sum_k sum_l beta_jl beta_ik sigma_kl,        P = (p_0 ... p_3)

The forces of all four vertices are computed from positions. The strain is twice Green's strain; the factor `c vol` is included in
`lam` and `mu`. `force` forms `sum_j p_j beta_jl = dx/dX` once, `force_as_printed` does not. The paper uses explicit time steps and
gives no tangent stiffness.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .body import Body
from .total_lagrangian import product_of, stress
from .vectors import Matrix, Vector, add, combination, plus, times, vector


class Rest(NamedTuple):
    """Constants: `beta` (nt, 4, 3), `half_lam` and `mu` (nt,) times the volume."""

    t: NDArray[np.int32]
    beta: NDArray[np.float64]
    half_lam: NDArray[np.float64]
    mu: NDArray[np.float64]


def force(rest: Rest, x: Any, out: Any) -> None:
    """Add F [N] at positions `x` (nv, 3) to `out`: 225 operations per tetrahedron."""
    for n in range(len(rest.t)):
        Ft = gradient(rest, x, n)
        P = product_of(stress(Ft, rest.half_lam[n], rest.mu[n]), Ft)
        for i in range(4):
            add(out, rest.t[n, i], combination(vector(rest.beta[n], i), P))


def force_as_printed(rest: Rest, x: Any, out: Any) -> None:
    """Add F [N] at positions `x` (nv, 3) to `out`, by the double loop over vertices."""
    for n in range(len(rest.t)):
        beta, S = rest.beta[n], stress(gradient(rest, x, n), rest.half_lam[n], rest.mu[n])
        for i in range(4):
            b = vector(beta, i)
            f = times(double_sum(vector(beta, 0), b, S), vector(x, rest.t[n, 0]))
            for j in range(1, 4):
                f = plus(f, times(double_sum(vector(beta, j), b, S), vector(x, rest.t[n, j])))
            add(out, rest.t[n, i], f)


def gradient(rest: Any, x: Any, n: Any) -> Matrix:
    """Return the columns of `dx/dX = P beta`: 63 operations."""
    beta, t = rest.beta[n], rest.t[n]
    return column(beta, x, t, 0), column(beta, x, t, 1), column(beta, x, t, 2)


def column(beta: Any, x: Any, t: Any, l: Any) -> Vector:
    """Return `sum_j p_j beta_jl`: 21 operations."""
    first = plus(times(beta[0, l], vector(x, t[0])), times(beta[1, l], vector(x, t[1])))
    return plus(plus(first, times(beta[2, l], vector(x, t[2]))), times(beta[3, l], vector(x, t[3])))


def double_sum(bj: Vector, bi: Vector, S: Matrix) -> Any:
    """Return `sum_k sum_l beta_jl beta_ik sigma_kl`, term by term: 26 operations."""
    first = bj[0] * bi[0] * S[0][0] + bj[1] * bi[0] * S[0][1] + bj[2] * bi[0] * S[0][2]
    second = bj[0] * bi[1] * S[1][0] + bj[1] * bi[1] * S[1][1] + bj[2] * bi[1] * S[1][2]
    return first + second + (bj[0] * bi[2] * S[2][0] + bj[1] * bi[2] * S[2][1] + bj[2] * bi[2] * S[2][2])


def prepare(body: Body) -> Rest:
    """Return the constants of the elements."""
    V = body.geometry.volume
    return Rest(t=body.t.T.copy(), beta=body.geometry.gradients, half_lam=V * body.lam / 2, mu=V * body.mu)
