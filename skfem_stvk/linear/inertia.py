"""How many eigenvalues of a symmetric matrix are negative, by factorisation, and how many have the sign of rounding only."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from .choose import direct
from .solver import Kind, Unknowns
from .superlu import SuperLU

#: Unknowns up to which a factorisation is worth a count: 0.1 s for triangles, 4 s for a cube of tetrahedra by SuperLU.
COUNTED = 20_000
#: What factorisations make of eigenvalues: so many times `eps |K|`, below which their signs are rounding.
ROUNDING = 8 * float(np.finfo(float).eps)


class Inertia(NamedTuple):
    """Numbers of eigenvalues of a symmetric matrix below `-8 eps |K|`, and of those up to `8 eps |K|`: rounding has their sign."""

    negative: int
    unsigned: int


def inertia(K: csr_matrix, unknowns: Unknowns) -> Inertia | None:
    """The inertia of K, whose rows and columns are scaled so that its diagonal is one; None if no direct solver can tell.

    By Sylvester's law scaling changes no sign. It makes `|K|`, the largest sum of a row, one that soft parts beside stiff ones are
    not lost against.

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
    """How many eigenvalues of a symmetric matrix are below `shift`; None if no direct solver can tell."""
    moved, first = shifted(K, shift), direct(unknowns.n)
    for solver in (first,) if first.name == SuperLU.name else (first, SuperLU()):  # PARDISO may replace pivots: no signs then
        count = solver.analyse(unknowns).factorise(moved, Kind.SYMMETRIC).negative_pivots
        if count is not None:
            return count
    return None


def shifted(K: csr_matrix, shift: float) -> csr_matrix:
    """`K - shift I`, of the same pattern."""
    values = K.data.copy()
    values[np.repeat(np.arange(K.shape[0]), np.diff(K.indptr)) == K.indices] -= shift
    return csr_matrix((values, K.indices, K.indptr), shape=K.shape)


def transposition(K: csr_matrix) -> NDArray[np.int64]:
    """Where the values of K' stand among those of K, whose pattern is symmetric and sorted."""
    places = np.arange(len(K.data))
    return np.asarray(csr_matrix((places, K.indices, K.indptr), shape=K.shape).T.tocsr().data)


def _scaled(K: csr_matrix) -> csr_matrix:
    """K with a diagonal of ones, or minus one."""
    size, row = np.abs(K.diagonal()), np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    scale = 1 / np.sqrt(np.where(size > 0, size, size.max() if size.max() > 0 else 1.0))
    return csr_matrix((K.data * scale[row] * scale[K.indices], K.indices, K.indptr), shape=K.shape)
