"""Numbers of negative eigenvalues, and of eigenvalues within round-off of zero, of a symmetric matrix, by factorisation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from .choose import direct
from .solver import Kind, Unknowns
from .superlu import SuperLU

#: Largest number of unknowns for which a count is worth a factorisation: 0.1 s for triangles, 4 s for a cube of tetrahedra
#: (SuperLU).
COUNTED = 20_000
#: Error of eigenvalues by factorisation, relative to `|K|`. The signs of smaller eigenvalues are not significant.
ROUNDING = 8 * float(np.finfo(float).eps)


class Inertia(NamedTuple):
    """Numbers of eigenvalues of a symmetric matrix below `-8 eps |K|`, and between `-8 eps |K|` and `8 eps |K|`.

    The signs of the latter are those of round-off.
    """

    negative: int
    unsigned: int


def inertia(K: csr_matrix, unknowns: Unknowns) -> Inertia | None:
    """Return the inertia of K, scaled so that its diagonal is one; None if no direct solver can count the eigenvalues.

    By Sylvester's law, scaling rows and columns changes no sign. `|K|` is the largest sum of a row of the scaled matrix. Hence soft
    parts are not lost in the round-off of stiff parts.

    >>> K = csr_matrix(np.array([[2.0, -1, 0], [-1, -2, 1], [0, 1, 3]]))
    >>> inertia(K, Unknowns(np.arange(3), np.zeros(3, dtype=int), K.indptr, K.indices))
    Inertia(negative=1, unsigned=0)
    """
    scaled = _scaled(K)
    floor = ROUNDING * float(abs(scaled).sum(axis=1).max())
    high = eigenvalues_below(scaled, floor, unknowns)
    low = eigenvalues_below(scaled, -floor, unknowns) if high else high
    return None if low is None or high is None else Inertia(low, max(high - low, 0))


def eigenvalues_below(K: csr_matrix, shift: float, unknowns: Unknowns) -> int | None:
    """Return the number of eigenvalues of a symmetric matrix below `shift`; None if no direct solver can count them."""
    moved, first = shifted(K, shift), direct(unknowns.n)
    for solver in (first,) if first.name == SuperLU.name else (first, SuperLU()):  # PARDISO may replace pivots: no signs
        count = solver.analyse(unknowns).factorise(moved, Kind.SYMMETRIC).negative_pivots
        if count is not None:
            return count
    return None


def shifted(K: csr_matrix, shift: float) -> csr_matrix:
    """Return `K - shift I`, with the same pattern."""
    values = K.data.copy()
    values[np.repeat(np.arange(K.shape[0]), np.diff(K.indptr)) == K.indices] -= shift
    return csr_matrix((values, K.indices, K.indptr), shape=K.shape)


def transposition(K: csr_matrix) -> NDArray[np.int64]:
    """Return the indices of the values of K' among those of K, whose pattern is symmetric and sorted."""
    indices = np.arange(len(K.data))
    return np.asarray(csr_matrix((indices, K.indices, K.indptr), shape=K.shape).T.tocsr().data)


def _scaled(K: csr_matrix) -> csr_matrix:
    """Return K with diagonal entries 1 or -1."""
    size, row = np.abs(K.diagonal()), np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    scale = 1 / np.sqrt(np.where(size > 0, size, size.max() if size.max() > 0 else 1.0))
    return csr_matrix((K.data * scale[row] * scale[K.indices], K.indices, K.indptr), shape=K.shape)
