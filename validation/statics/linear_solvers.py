"""Linear solvers for the programs: SciPy's SuperLU, and PARDISO through its wrapper pypardiso."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from scipy.sparse.linalg import spsolve

from skfem_stvk.arguments import Array
from skfem_stvk.linear.pardiso import pardiso_is_installed


def superlu(K: Any, b: Array) -> Array:
    """Solve with SuperLU, the default of SciPy, scikit-fem and FElupe."""
    x: Array = spsolve(K, b)
    return x


def forget() -> None:
    """Free the last factorization of pypardiso, which would not factorise the same matrix again."""
    if pardiso_is_installed():
        import_module("pypardiso").scipy_aliases.pypardiso_solver.free_memory(everything=True)


def direct(K: Any, b: Array) -> Array:
    """Solve with PARDISO if it is installed, otherwise with SuperLU."""
    return pardiso(K, b) if pardiso_is_installed() else superlu(K, b)


def pardiso(K: Any, b: Array) -> Array:
    """Solve with `pypardiso.spsolve`, which treats every matrix as unsymmetric."""
    x: Array = import_module("pypardiso").spsolve(K.tocsr(), b)
    return x
