"""Real eigenvalues of a tangent that is not symmetric: where one passes through zero, a body diverges from its equilibrium."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

from ..arguments import Array
from ..linear import Factors, Kind, SuperLU, Unknowns
from ..linear.choose import direct
from ..linear.inertia import COUNTED, ROUNDING, eigenvalues_below, inertia, transposition

#: Unknowns up to which all eigenvalues are worked out; of more, so many nearest to zero, and so many at most.
DENSE, FIRST, MOST = 200, 6, 24
#: An imaginary part below this part of an eigenvalue is what rounding leaves of two real ones that are nearly the same.
REAL = float(np.sqrt(np.finfo(float).eps))


class RealEigenvalues(NamedTuple):
    """Numbers of real eigenvalues.

    Attributes
    ----------
    negative : below `-8 eps |K|`, those that were found; at least 1 where the determinant is negative.
    unsigned : between `-8 eps |K|` and `8 eps |K|`.
    all_of_them : whether no others can be negative.
    looked_at : how many eigenvalues, those nearest to zero.
    """

    negative: int
    unsigned: int
    all_of_them: bool
    looked_at: int


def real_eigenvalues(K: csr_matrix, unknowns: Unknowns) -> RealEigenvalues:
    """Of `K`, whose pattern is symmetric and whose values are not.

    Every real eigenvalue lies above the lowest one of the symmetric part `S = (K + K')/2`: where that is positive definite, none is negative.
    Otherwise the determinant, the product of all, is negative where their number is odd; and those nearest to zero are found by ARPACK, by
    inverse iteration (shift and invert at 0). They are all within a circle; no others are negative if S has no eigenvalue beyond it.
    """
    n = unknowns.n
    S = csr_matrix(((K.data + K.data[transposition(K)]) / 2, K.indices, K.indptr), shape=K.shape)
    counts = inertia(S, unknowns)
    if counts is not None and not counts.negative and not counts.unsigned:
        return RealEigenvalues(0, 0, True, n)
    floor = ROUNDING * float(abs(K).sum(axis=1).max())
    if n <= DENSE:
        return _counted(np.linalg.eigvals(K.toarray()), floor, True)
    factors, odd = _factors(K, unknowns)
    inverse = LinearOperator((n, n), matvec=lambda b: factors.solve(np.ravel(b), 1e-10).x, dtype=np.float64)
    number = FIRST
    while True:
        values = _nearest(K, inverse, number)
        reach = float(np.abs(values).max(initial=0.0))
        found = _counted(values, floor, bool(reach) and eigenvalues_below(S, -reach, unknowns) == 0)
        if found.negative or found.unsigned or found.all_of_them or number == MOST:
            break
        number *= 2
    return found._replace(negative=found.negative + 1) if odd and not found.negative % 2 else found


def _factors(K: csr_matrix, unknowns: Unknowns) -> tuple[Factors, bool | None]:
    """Factors of K, and whether its determinant is negative; None if they do not say."""
    if unknowns.n > COUNTED:
        return direct(unknowns.n).analyse(unknowns).factorise(K, Kind.GENERAL), None
    factors = SuperLU().analyse(unknowns).factorise(K, Kind.GENERAL)
    return factors, factors.negative_determinant


def _counted(values: Array, floor: float, all_of_them: bool) -> RealEigenvalues:
    real = values.real[np.abs(values.imag) <= np.maximum(REAL * np.abs(values), floor)]
    negative, unsigned = int((real < -floor).sum()), int((np.abs(real) <= floor).sum())
    return RealEigenvalues(negative, unsigned, all_of_them, len(values))


def _nearest(K: csr_matrix, inverse: LinearOperator, number: int) -> Array:
    """So many eigenvalues nearest to zero, or those of them that were found."""
    start = np.random.default_rng(0).standard_normal(K.shape[0])
    try:
        values = eigs(K, number, sigma=0.0, OPinv=inverse, v0=start, tol=1e-8, return_eigenvectors=False)
    except ArpackNoConvergence as error:
        values = error.eigenvalues
    return np.asarray(values)
