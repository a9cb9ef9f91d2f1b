"""The linear solvers that programs are run with: SciPy's own, and PARDISO as its wrapper offers it."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from scipy.sparse.linalg import spsolve

from skfem_stvk.linear.pardiso import pardiso_is_installed

from .cantilever import Array


def superlu(K: Any, b: Array) -> Array:
    """SciPy's default, and with it scikit-fem's and FElupe's."""
    x: Array = spsolve(K, b)
    return x


def forget() -> None:
    """Let PARDISO's wrapper forget the matrix that it factorised last; it would not factorise the same one again."""
    if pardiso_is_installed():
        import_module("pypardiso").scipy_aliases.pypardiso_solver.free_memory(everything=True)


def direct(K: Any, b: Array) -> Array:
    """PARDISO where it is installed, else SuperLU."""
    return pardiso(K, b) if pardiso_is_installed() else superlu(K, b)


def pardiso(K: Any, b: Array) -> Array:
    """`pypardiso.spsolve`, which takes every matrix for an unsymmetric one."""
    x: Array = import_module("pypardiso").spsolve(K.tocsr(), b)
    return x
