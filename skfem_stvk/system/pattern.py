"""The pattern of K: which blocks there are, where their values stand, and which of them belong to free degrees of freedom."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from copy import copy
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, plain_array, shown, whole_array
from ..errors import StvkError, name_ids
from ..kernels import blocks as block_kernels
from ..kernels.threads import parts_of, run, threads
from ..kernels.topology import expand, first_places, lexicographic_order, stars
from ..mesh.displacements import finite_vector
from ..mesh.mesh import check_index_range


class Structure:
    """Rows and columns of a CSR matrix of `nnz` values: int32 arrays `indptr` and `indices`, columns sorted; read only."""

    def __init__(self, indptr: NDArray[np.int32], indices: NDArray[np.int32], shape: tuple[int, int]) -> None:
        self.indptr, self.indices, self.shape, self.nnz = indptr, indices, shape, len(indices)
        self.indptr.flags.writeable = self.indices.flags.writeable = False
        self._known: tuple[Any, ...] = ()

    def matrix(self, data: NDArray[Any]) -> csr_matrix:
        """A CSR matrix around the values `data` (nnz,), which it does not copy.

        Its index arrays are copies, so that changing the matrix in place cannot harm the structure.
        """
        return csr_matrix((data, self.indices.copy(), self.indptr.copy()), shape=self.shape)

    def fits(self, matrix: Any, dtype: DTypeLike) -> bool:
        """Whether this is a CSR matrix of this type that still has this structure, and room for its values.

        What was found to fit last is not looked through again while it holds the same index arrays: edits of those go unnoticed.
        """
        if not isinstance(matrix, csr_matrix) or matrix.dtype != dtype or matrix.shape != self.shape or matrix.nnz != self.nnz:
            return False
        if matrix.data.shape != (self.nnz,) or not matrix.data.flags.c_contiguous or not matrix.data.flags.writeable:
            return False
        known = self._known
        if known and known[0]() is matrix and known[1] is matrix.indices and known[2] is matrix.indptr:
            return True
        fits: bool = np.array_equal(matrix.indptr, self.indptr) and np.array_equal(matrix.indices, self.indices)
        if fits:
            self._known = weakref.ref(matrix), matrix.indices, matrix.indptr
        return fits

    def refuse_other(self, K: Any) -> None:
        """Refuse what is no matrix of this pattern."""
        if not isinstance(K, csr_matrix) or not self.fits(K, K.dtype):
            raise StvkError(
                f"K = {shown(K)} does not have the pattern of this system's K ({self.shape}, {self.nnz} values). Hand in what "
                "tangent() returned, zeros kept."
            )

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_known": ()}


class Pattern(Structure):
    """The full block pattern of a matrix with a `d x d` block for each vertex and each pair of vertices on an edge.

    Zeros are kept, so the pattern does not depend on the state, and a symbolic factorisation can be reused.

    Parameters
    ----------
    pairs : of each term, (2, n) vertices `a < b`.
    version : how often terms have changed their pairs before.

    Attributes
    ----------
    version : as given; what is worked out for a pattern is good for its version alone.
    indptr, indices : int32 arrays of scipy's CSR format, columns sorted; read only.
    shape : (ndofs, ndofs).
    nnz : number of values.
    strides : (nv,) values from a row of a vertex to its next.

    Raises
    ------
    MeshError
        if there are more values than 32-bit indices can count.
    """

    def __init__(self, nv: int, d: int, pairs: Sequence[NDArray[np.int32]], version: int = 0) -> None:
        self._d, self.version = d, version
        self._begin, self._columns, _ = stars(_union(pairs, nv), nv)
        check_index_range(d * d * len(self._columns), "values of K")
        self.strides = (d * np.diff(self._begin)).astype(np.int32)
        super().__init__(*expand(self._begin, self._columns, d), (d * nv, d * nv))

    def places(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.int32]:
        """(n,) place in the CSR values of the first value of each block `(a, b)`; its next rows follow after `strides[a]`.

        Raises
        ------
        StvkError
            if a block is not in the pattern.
        """
        places = first_places(self._begin, self._columns, self._d, a, b)
        missing = np.flatnonzero(places < 0)
        if len(missing):
            pairs = [(int(a[i]), int(b[i])) for i in missing[:5]]
            raise StvkError(
                f"{name_ids(missing, 'block')}: not in the pattern of K, vertices {pairs}: no term pairs them. The pattern is "
                "made from the nodes_paired of the terms; a term must name all the pairs it writes to."
            )
        return places.astype(np.int32)

    def memory(self) -> int:
        """Bytes of its arrays."""
        return sum(array.nbytes for array in (self._begin, self._columns, self.strides, self.indptr, self.indices))


class Patterned(Protocol):
    """What has degrees of freedom and, when it is asked for, a pattern of K."""

    @property
    def ndofs(self) -> int:
        """Number of degrees of freedom."""

    @property
    def pattern(self) -> Pattern:
        """The pattern of K, of the version that is good now."""


def _numbers(name: str, given: Any, n: int) -> Array:
    """A number, or (n,) of them, in the precision in which they are given; complex ones as well, such as parts of modes."""
    values, each = plain_array(given), f"{name} degree of freedom"
    if values is not None and values.ndim == 0:
        return finite_vector(name, values.reshape(1), 1, each, kinds="fiuc").reshape(())
    return finite_vector(name, given, n, each, kinds="fiuc")


class FreeDofs:
    """The degrees of freedom that are not held, and K restricted to them by a gather that is computed once, when it is first
    needed.

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
    >>> body.tangent(held.vector(np.full(len(held.free), 0.01)), out=Kff, free=held) is Kff    # each Newton step
    True
    """

    def __init__(self, system: Patterned, fixed: ArrayLike) -> None:
        ndofs = system.ndofs
        ids = whole_array(fixed)
        if ids is None or ids.ndim != 1 or ids.dtype.kind == "b":
            raise StvkError(
                f"fixed = {shown(fixed)}; expected a list of degrees of freedom, d * vertex + component: bare integers are those "
                "here, and vertices in System(fixed=...). Of a mask take np.flatnonzero(mask)."
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
        self._known: tuple[int, Structure, NDArray[np.int32]] | None = None

    def of(self, system: Patterned) -> FreeDofs:
        """The same degrees of freedom of a system that shares the pattern of K."""
        other = copy(self)
        other._system = system
        return other

    @property
    def structure(self) -> Structure:
        """Structure of K over the free degrees of freedom."""
        return self._restriction()[0]

    @property
    def pattern(self) -> Pattern:
        """The pattern of all of K."""
        return self._system.pattern

    @property
    def places(self) -> NDArray[np.int32]:
        """Where the values of K over the free degrees of freedom stand in those of K, ascending."""
        return self._restriction()[1]

    def _restriction(self) -> tuple[Structure, NDArray[np.int32]]:
        """Structure of K over the free degrees of freedom, and where its values stand in those of K: once for each version."""
        pattern, known = self._system.pattern, self._known
        if known is None or known[0] != pattern.version:
            self._known = known = pattern.version, *self._restricted(pattern)
        return known[1:]

    def _restricted(self, pattern: Pattern) -> tuple[Structure, NDArray[np.int32]]:
        free = self.free
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
        self._system.pattern.refuse_other(K)
        structure, places = self._restriction()
        if out is None:
            out = structure.matrix(np.empty(structure.nnz, dtype=K.dtype))
        elif not structure.fits(out, K.dtype):
            raise StvkError(
                f"out = {shown(out)} does not have the pattern and type of the restricted K ({structure.shape}, {structure.nnz} "
                f"values of {K.dtype}); expected a matrix that matrix() or tangent(u, free=...) returned before."
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


class BareDiagonal:
    """The diagonal of K for `nodes` without elements: a `stiffness` [N/m], the mean of the diagonal of the whole body at rest.

    With it K stays positive definite, and as well conditioned as it was. There is no force to it.
    """

    def __init__(self, stiffness: float, nodes: NDArray[np.int64]) -> None:
        self.stiffness, self.nodes = stiffness, nodes

    @classmethod
    def of(cls, blocks: Array) -> BareDiagonal:
        """The diagonal of a body with diagonal blocks (nv, d, d) [N/m] at rest; no node is without elements yet."""
        mean = float(np.einsum("vcc->", blocks.astype(np.float64))) / blocks[..., 0].size
        return cls(mean if np.isfinite(mean) and mean > 0 else 1.0, np.empty(0, dtype=np.int64))

    def write(self, pattern: Pattern, data: Array, free: FreeDofs | None) -> None:
        """Write it to the values of K, or of K over the `free` degrees of freedom."""
        a = self.nodes.astype(np.int32)
        if not len(a):
            return
        d = pattern.shape[0] // len(pattern.strides)
        places = (pattern.places(a, a)[:, None] + np.arange(d) * (pattern.strides[a][:, None] + 1)).ravel()
        if free is not None:
            at = np.minimum(np.searchsorted(free.places, places), len(free.places) - 1)
            places = at[free.places[at] == places]
        data[places] = self.stiffness


def _union(pairs: Sequence[NDArray[np.int32]], nv: int) -> NDArray[np.int32]:
    """(2, n) the pairs of all terms in lexicographic order, each once."""
    every = np.ascontiguousarray(np.concatenate([np.empty((2, 0), dtype=np.int32), *pairs], axis=1), dtype=np.int32)
    (a, b), (c, d) = every[:, :-1], every[:, 1:]
    if len(pairs) == 1 and ((a < c) | ((a == c) & (b < d))).all():
        return every
    every = every[:, lexicographic_order(every, nv)]
    first = np.ones(every.shape[1], dtype=bool)
    first[1:] = (every[:, 1:] != every[:, :-1]).any(axis=0)
    return np.ascontiguousarray(every[:, first])
