"""W and F of St. Venant-Kirchhoff in 50 decimal digits: the truth that round-off is measured against.

In the simplex's own oblique axes `D_i = X_i - X_0` (current: `d_i`), with the metric `M_ij = D_i . D_j`:

    e_ij = 1/2 (d_i . d_j - D_i . D_j),    s = lam tr(M^-1 e) M^-1 + 2 mu M^-1 e M^-1,    V = sqrt(det M)/k!
    W = sum V/2 s : e,    F_i = V sum_j s_ij d_j,    F_0 = -sum_i F_i

Python's decimal numbers are exact on every platform (a `longdouble` is a mere double on some), and fast enough for a patch.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DIGITS = 50


def exact_energy_and_force(p: Array, t: NDArray[np.int32], lam: float, mu: float, u: Array) -> tuple[float, Array]:
    """W and F (ndofs,) at `u` (ndofs,), each rounded to double once.

    Parameters
    ----------
    p : (d, nv) coordinates, taken as they are: exact binary fractions.
    t : (k + 1, nt) vertices.
    lam, mu : Lame pair within the simplices' dimensions.
    u : (ndofs,) displacements, taken as they are.
    """
    with localcontext() as context:
        context.prec = DIGITS
        W, F = _energy_and_force(_decimal(p), t, Decimal(lam), Decimal(mu), _decimal(u.reshape(-1, p.shape[0]).T))
        return float(W), F.astype(float).T.ravel()


def exact_product(p: Array, t: NDArray[np.int32], lam: float, mu: float, u: Array, v: Array) -> Array:
    """`K(u) v` (ndofs,): the five-point stencil on F along `v`, which has no truncation error."""
    with localcontext() as context:
        context.prec = DIGITS
        x, dx = (_decimal(a.reshape(-1, p.shape[0]).T) for a in (u, v))
        total = 0 * x
        for s, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            total = total + weight * _energy_and_force(_decimal(p), t, Decimal(lam), Decimal(mu), x + s * dx)[1]
        return (total / 12).astype(float).T.ravel()


def _decimal(array: Array) -> NDArray[Any]:
    return np.array([Decimal(value) for value in array.ravel().tolist()], dtype=object).reshape(array.shape)


def _energy_and_force(
    p: NDArray[Any], t: NDArray[np.int32], lam: Decimal, mu: Decimal, u: NDArray[Any]
) -> tuple[Any, NDArray[Any]]:
    k = len(t) - 1
    D = [p[:, t[i + 1]] - p[:, t[0]] for i in range(k)]  # each (d, nt)
    d = [D[i] + (u[:, t[i + 1]] - u[:, t[0]]) for i in range(k)]
    M = [[(D[i] * D[j]).sum(axis=0) for j in range(k)] for i in range(k)]
    inverse, determinant = _inverse(M)
    e = [[((d[i] * d[j]).sum(axis=0) - M[i][j]) / 2 for j in range(k)] for i in range(k)]
    mixed = _product(inverse, e)
    trace = sum(mixed[i][i] for i in range(k))
    raised = _product(mixed, inverse)
    s = [[lam * trace * inverse[i][j] + 2 * mu * raised[i][j] for j in range(k)] for i in range(k)]
    V = np.array([value.sqrt() for value in determinant], dtype=object) / factorial(k)
    W = sum((V * s[i][j] * e[i][j]).sum() for i in range(k) for j in range(k)) / 2
    F = 0 * u
    for i in range(k):
        f = V * sum(s[i][j] * d[j] for j in range(k))
        for component in range(len(u)):
            np.add.at(F[component], t[i + 1], f[component])
            np.subtract.at(F[component], t[0], f[component])
    return W, F


def _product(A: list[list[Any]], B: list[list[Any]]) -> list[list[Any]]:
    n = range(len(A))
    return [[sum(A[i][m] * B[m][j] for m in n) for j in n] for i in n]


def _inverse(M: list[list[Any]]) -> tuple[list[list[Any]], Any]:
    """Inverse and determinant of symmetric matrices of size 1, 2 or 3, by cofactors."""
    n = len(M)
    if n == 1:
        return [[1 / M[0][0]]], M[0][0]

    def cofactor(i: int, j: int) -> Any:
        r, c = ([m for m in range(n) if m != left_out] for left_out in (i, j))
        minor = M[r[0]][c[0]] if n == 2 else M[r[0]][c[0]] * M[r[1]][c[1]] - M[r[0]][c[1]] * M[r[1]][c[0]]
        return minor if (i + j) % 2 == 0 else -minor

    determinant = sum(M[0][j] * cofactor(0, j) for j in range(n))
    return [[cofactor(j, i) / determinant for j in range(n)] for i in range(n)], determinant
