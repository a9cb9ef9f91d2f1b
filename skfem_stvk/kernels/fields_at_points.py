"""Stress and energy density of laws at points, for fields. The formulas are those of the element kernels, chosen by the law.

The numbers of a law are per unit of rest volume, one set for each point, in blocks of lanes.
"""

from __future__ import annotations

from typing import Any

from numpy import uint64

from .compiled import Reals, inlined, kernel
from .discrete_gradient import response_to_strain
from .lanes import LANES, add
from .laws import law_size, strain
from .principal import stretch_response
from .svd import decompose


@inlined
def _numbers_at(law, i):
    """Return the index of the first number of the law at point `i`."""
    return uint64(i // LANES * LANES * law_size(law) + i % LANES)


@inlined
def _rows(a):
    """Return the rows of a matrix (3, 3) as vectors."""
    return (a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2])


@kernel
def stress_by_strain(law: Any, k: int, M: Reals, W: Reals, S: Reals) -> None:
    """Write energy densities `W` (n,) and second Piola-Kirchhoff stresses `S` (n, 3, 3) for strains `M = 2 E` (n, 3, 3).

    The elements have `k` dimensions and are not inverted. Components of strains and stresses are along the axes of the elements.
    """
    zero, one = law.D.dtype.type(0), law.D.dtype.type(1)
    second, third = one if k > 1 else zero, one if k > 2 else zero
    for i in range(len(W)):
        m = (M[i, 0, 0], M[i, 1, 1], M[i, 2, 2], M[i, 0, 1], M[i, 0, 2], M[i, 1, 2])
        w, s = response_to_strain(law, _numbers_at(law, i), one, m, one, one, second, third, one)
        W[i] = w / 4
        S[i, 0, 0], S[i, 1, 1], S[i, 2, 2] = s[0], s[1], s[2]
        S[i, 0, 1], S[i, 0, 2], S[i, 1, 2] = s[3], s[4], s[5]
        S[i, 1, 0], S[i, 2, 0], S[i, 2, 1] = s[3], s[4], s[5]


@kernel
def response_to_stretches(law: Any, flat: Any, Q: Reals, h: Reals, W: Reals, e: Reals, p: Reals, V: Reals) -> None:
    """Write energy densities `W` (n,), elongations `e = s - 1` and slopes `p = dW/ds` (n, 3) of a law of principal stretches.

    Rows of `Q` (n, 3, 3) are the axes at rest and rows of `h` their displacements. Columns of `V` (n, 3, 3) are the principal axes.
    `flat` is the kind of elements. In plane strain the law of solids applies, and the out-of-plane stretch is 1.
    """
    one = law.D.dtype.type(1)
    for i in range(len(W)):
        (Q1, Q2, Q3), (h1, h2, h3) = _rows(Q[i]), _rows(h[i])
        q1, q2, q3 = add(Q1, h1), add(Q2, h2), add(Q3, h3)
        M = strain(h1, h2, h3, Q1, Q2, Q3, q1, q2, q3)
        _, _, _, v1, v2, v3, _, x = decompose(flat, law.D, (Q1, Q2, Q3), (q1, q2, q3), M)
        W[i], slopes, _, _ = stretch_response(law, _numbers_at(law, i), one, (one + x[0], one + x[1], one + x[2]), x)
        for j in range(3):
            e[i, j], p[i, j] = x[j], slopes[j]
            V[i, j, 0], V[i, j, 1], V[i, j, 2] = v1[j], v2[j], v3[j]
