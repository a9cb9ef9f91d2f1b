"""Conjugate gradients with symmetric overrelaxation by vertex as preconditioner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .block_jacobi import BlockJacobiCg


@dataclass(frozen=True)
class SsorCg(BlockJacobiCg):
    """As `BlockJacobiCg`, with a third of its iterations, each half as long again: a sweep over the vertices back and one forth stand for the product.

    The sweeps are those of the compiled loop: they need the blocks of the edges of one term, which are copied, or with `assembled` those of a
    matrix. A body of several terms that is not assembled is solved with diagonal blocks, as by `BlockJacobiCg`.

    >>> import numpy as np
    >>> from scipy.sparse import diags
    >>> from skfem_stvk.linear import Kind, Unknowns
    >>> K = diags([-1.0, 2.5, -1.0], [-1, 0, 1], shape=(60, 60), format="csr")
    >>> unknowns = Unknowns(np.arange(60), np.zeros(60, dtype=int), K.indptr, K.indices)
    >>> b = np.cos(np.arange(60.0))
    >>> solvers = SsorCg(assembled=True), BlockJacobiCg(assembled=True)
    >>> one, other = (solver.analyse(unknowns).factorise(K, Kind.POSITIVE_DEFINITE).solve(b, rtol=1e-8) for solver in solvers)
    >>> one.outcome.value, one.iterations < other.iterations / 2, bool(abs(one.x - other.x).max() < 1e-6)
    ('solved', True, True)
    """

    name: ClassVar[str] = "ssor-cg"
    #: A sixth to an eighth fewer iterations than with 1 in time steps, a quarter fewer in statics; beyond 1.6 they grow.
    omega: ClassVar[float] = 1.4
