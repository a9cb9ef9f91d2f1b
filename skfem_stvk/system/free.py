"""K, F and u restricted to the free degrees of freedom."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, plain_array, shown, whole_array
from ..errors import StvkError, name_ids
from ..kernels import blocks as block_kernels
from ..kernels.threads import parts_of, run, threads
from ..mesh.displacements import finite_vector
from .pattern import Pattern, Structure


class Patterned(Protocol):
    """What has degrees of freedom and, when it is asked for, a pattern of K."""

    @property
    def ndofs(self) -> int:
        """Number of degrees of freedom."""

    @property
    def pattern(self) -> Pattern:
        """Of K."""


def _numbers(name: str, given: Any, n: int) -> Array:
    """A number, or (n,) of them, in the precision in which they are given; complex ones as well, such as parts of modes."""
    values, each = plain_array(given), f"{name} degree of freedom"
    if values is not None and values.ndim == 0:
        return finite_vector(name, values.reshape(1), 1, each, kinds="fiuc").reshape(())
    return finite_vector(name, given, n, each, kinds="fiuc")


class FreeDofs:
    """The degrees of freedom that are not held, and K restricted to them by a gather that is computed once, when it is first needed.

    Parameters
    ----------
    system : whose they are.
    fixed : degrees of freedom that are held; `System.free_dofs` also takes places.

    Attributes
    ----------
    free, fixed : their numbers, ascending; scikit-fem's `I` and `D`.

    Raises
    ------
    StvkError
        if a number is out of range, or none is free.

    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTet().refined(2)
    >>> body = System(mesh, StVK(young=1e5, poisson=0.3))
    >>> held = body.free_dofs(skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1())).get_dofs(lambda x: x[0] == 0))
    >>> K = body.tangent(np.zeros(body.ndofs))
    >>> Kff = held.matrix(K)
    >>> bool(abs(Kff - K[held.free][:, held.free]).max() == 0)
    True
    >>> held.matrix(body.tangent(held.vector(np.full(len(held.free), 0.01)), out=K), out=Kff) is Kff    # each Newton step
    True
    """

    def __init__(self, system: Patterned, fixed: ArrayLike) -> None:
        ndofs = system.ndofs
        ids = whole_array(fixed)
        if ids is None or ids.ndim != 1 or ids.dtype.kind == "b":
            raise StvkError(
                f"fixed = {shown(fixed)}; expected a list of degrees of freedom, d * vertex + component: bare "
                "integers are those here, and vertices in System(fixed=...). Of a mask take np.flatnonzero(mask)."
            )
        bad = ids[(ids < 0) | (ids >= ndofs)]
        if len(bad):
            raise StvkError(
                f"fixed names {name_ids(bad, 'degree of freedom')} outside 0 ... {ndofs - 1}. Are they of another mesh?"
            )
        is_free = np.ones(ndofs, dtype=bool)
        is_free[ids.astype(np.int64)] = False
        self.free, self.fixed = np.flatnonzero(is_free), np.flatnonzero(~is_free)
        if not len(self.free):
            raise StvkError(f"All {ndofs} degrees of freedom are fixed: there is nothing to solve for.")
        self._system = system

    @property
    def structure(self) -> Structure:
        """Of K over the free degrees of freedom."""
        return self._restriction[0]

    @cached_property
    def _restriction(self) -> tuple[Structure, NDArray[np.int32]]:
        """The structure of K over the free degrees of freedom, and where its values stand in those of K."""
        pattern, free = self._system.pattern, self.free
        is_free = np.zeros(pattern.shape[0], dtype=bool)
        is_free[free] = True
        kept = is_free[pattern.indices]
        kept &= np.repeat(is_free, np.diff(pattern.indptr))
        places = np.flatnonzero(kept).astype(np.int32)
        number = np.cumsum(is_free, dtype=np.int32) - 1
        counts = np.add.reduceat(kept, pattern.indptr[:-1], dtype=np.int32)[free]
        indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        return Structure(indptr, number[pattern.indices[places]].astype(np.int32), (len(free),) * 2), places

    def matrix(self, K: csr_matrix, out: csr_matrix | None = None) -> csr_matrix:
        """`K` (ndofs, ndofs) of the system's pattern restricted to the free rows and columns; `out` is filled anew.

        Raises
        ------
        StvkError
            if `K` or `out` has another pattern.
        """
        pattern = self._system.pattern
        if not isinstance(K, csr_matrix) or not pattern.fits(K, K.dtype):
            raise StvkError(
                f"K = {shown(K)} does not have the pattern of this system's K ({pattern.shape}, "
                f"{pattern.nnz} values). Hand in what tangent() returned, zeros kept."
            )
        structure, places = self._restriction
        if out is None:
            out = structure.matrix(np.empty(structure.nnz, dtype=K.dtype))
        elif not structure.fits(out, K.dtype):
            raise StvkError(
                f"out = {shown(out)} does not have the pattern and type of the restricted K "
                f"({structure.shape}, {structure.nnz} values of {K.dtype}); expected a matrix that matrix() returned before."
            )
        run(block_kernels.pick, parts_of(len(places), 0.02, threads()), places, K.data, out.data)
        return out

    def vector(self, free: ArrayLike, fixed: ArrayLike = 0.0) -> Array:
        """(ndofs,) vector with these values at the free and at the fixed degrees of freedom; `x[held.free]` goes the other way.

        Raises
        ------
        StvkError
            if there are not as many values.
        """
        inner, outer = _numbers("free", free, len(self.free)), _numbers("fixed", fixed, len(self.fixed))
        least = np.complex64 if outer.dtype.kind == "c" else np.float32  # one number for all does not ask for more precision
        x = np.empty(self._system.ndofs, dtype=np.result_type(inner, outer if outer.ndim else least, least))
        x[self.free], x[self.fixed] = inner, outer
        return x

    def __repr__(self) -> str:
        return f"FreeDofs: {len(self.free)} free, {len(self.fixed)} fixed"
