"""Readable twins of the kernels of reduced bodies: quartics of few variables by their whole symmetric tensors."""

from __future__ import annotations

from itertools import combinations_with_replacement, permutations

import numpy as np

from skfem_stvk.kernels.compiled import Reals


def ordered(n: int, factors: int) -> list[tuple[int, ...]]:
    """Return the indices `a <= b <= ...` of products of `factors` of n variables, in the kernels' order.

    The order is by the last index, then by the last but one, and so on.
    """
    return sorted(combinations_with_replacement(range(n), factors), key=lambda indices: indices[::-1])


def distinct_coefficients(C: Reals, T: Reals) -> None:
    """Add each product of two pairs to the coefficient of its four factors."""
    pairs = ordered(int(np.sqrt(2 * len(C))), 2)
    place = {indices: at for at, indices in enumerate(ordered(int(np.sqrt(2 * len(C))), 4))}
    T[:] = 0
    for first, P in enumerate(pairs):
        for second, Q in enumerate(pairs):
            T[place[tuple(sorted(P + Q))]] += C[max(first, second), min(first, second)] / 2


def quartic(T: Reals, x: Reals, p: Reals, Y: Reals, P: Reals, G: Reals, H: Reals) -> float:
    """Return W and write its gradient and second derivatives, from the symmetric tensor S that gives the same quartic."""
    n = len(x)
    S = np.zeros((n,) * 4)
    for value, indices in zip(T, ordered(n, 4), strict=True):
        same = set(permutations(indices))
        for each in same:
            S[each] = value / len(same)
    H[:] = 12 * np.einsum("abcd,c,d", S, x, x)
    G[:] = 4 * np.einsum("abcd,b,c,d", S, x, x, x)
    return float(np.einsum("abcd,a,b,c,d", S, x, x, x, x))
