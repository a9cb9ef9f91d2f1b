"""Sparsity pattern of K: its blocks, the indices of their values, and the part over the free degrees of freedom."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from copy import copy
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, check_index_range, plain_array, shown, whole_array
from ..edges.pairs import BlockPattern
from ..errors import StvkError, name_ids
from ..kernels import node_blocks as block_kernels
from ..kernels.simplex_topology import block_indices, expand, lexicographic_order, stars
from ..kernels.threads import parts_of, run, threads
from ..mesh.displacements import finite_vector
from ..space import Space
from ..units import UnitSystem


class Structure:
    """Rows and columns of a CSR matrix with `nnz` values: int32 arrays `indptr` and `indices`, columns sorted, read only."""

    def __init__(self, indptr: NDArray[np.int32], indices: NDArray[np.int32], shape: tuple[int, int]) -> None:
        self.indptr, self.indices, self.shape, self.nnz = indptr, indices, shape, len(indices)
        self.indptr.flags.writeable = self.indices.flags.writeable = False
        self._known: tuple[Any, ...] = ()

    def matrix(self, data: NDArray[Any]) -> csr_matrix:
        """Return a CSR matrix with the values `data` (nnz,), which are not copied.

        The index arrays are copies, so that changes of the matrix in place cannot corrupt the structure.
        """
        return csr_matrix((data, self.indices.copy(), self.indptr.copy()), shape=self.shape)

    def fits(self, matrix: Any, dtype: DTypeLike) -> bool:
        """Return whether `matrix` is a CSR matrix of this type with this structure and with memory for its values.

        The last matrix that fitted is not checked again while it has the same index arrays. Changes inside these arrays are not
        noticed.
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
        """Raise StvkError if `K` is not a matrix of this pattern."""
        if not isinstance(K, csr_matrix) or not self.fits(K, K.dtype):
            raise StvkError(
                f"K = {shown(K)} does not have the pattern of this system's K ({self.shape}, {self.nnz} values). Pass a matrix "
                "that tangent() returned, with its zeros."
            )

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_known": ()}


class Pattern(Structure, BlockPattern):
    """Full block pattern of a matrix with a `d x d` block for each vertex and each pair of vertices on an edge.

    Zeros are stored, so the pattern does not depend on the state, and a symbolic factorisation can be reused.

    Parameters
    ----------
    pairs
        (2, n) vertices `a < b` of each term.
    version
        Number of earlier changes of the pairs by terms.

    Attributes
    ----------
    version
        Version, as passed in; data computed for a pattern are valid for its version only.
    indptr, indices
        Int32 arrays of scipy's CSR format, columns sorted; read only.
    shape
        Shape of K, (ndofs, ndofs).
    nnz
        Number of values.
    strides
        (nv,) number of values between the rows of a vertex.

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

    def block_indices(self, a: NDArray[np.int32], b: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the index (n,) in the CSR values of the first value of each block `(a, b)`.

        The next rows of the block follow after `strides[a]` values each.

        Raises
        ------
        StvkError
            if a block is not in the pattern.
        """
        places = block_indices(self._begin, self._columns, self._d, a, b)
        missing = np.flatnonzero(places < 0)
        if len(missing):
            pairs = [(int(a[i]), int(b[i])) for i in missing[:5]]
            raise StvkError(
                f"{name_ids(missing, 'block')}: not in the pattern of K, vertices {pairs}: no term pairs them. The pattern is "
                "made from the nodes_paired of the terms; a term must name all the pairs it writes to."
            )
        return places.astype(np.int32)

    def memory(self) -> int:
        """Return the bytes of the arrays."""
        return sum(array.nbytes for array in (self._begin, self._columns, self.strides, self.indptr, self.indices))


class HasPattern(Protocol):
    """Object with degrees of freedom and a pattern of K, made on request."""

    units: UnitSystem

    @property
    def ndofs(self) -> int:
        """Number of degrees of freedom."""

    @property
    def pattern(self) -> Pattern:
        """Current version of the pattern of K."""


def _numbers(name: str, value: Any, n: int) -> Array:
    """Return one number or (n,) numbers in their own precision; complex numbers are accepted, such as parts of modes."""
    values, each = plain_array(value), f"{name} degree of freedom"
    if values is not None and values.ndim == 0:
        return finite_vector(name, values.reshape(1), 1, each, kinds="fiuc").reshape(())
    return finite_vector(name, value, n, each, kinds="fiuc")


class FreeDofs:
    """Free degrees of freedom, and K restricted to them by a gather. The gather indices are computed once, on first use.

    Parameters
    ----------
    system
        System of the degrees of freedom.
    fixed
        Constrained degrees of freedom; `System.free_dofs` also takes locations.

    Attributes
    ----------
    free, fixed
        Numbers of the degrees of freedom, ascending; scikit-fem's `I` and `D`.

    Raises
    ------
    StvkError
        if a number is out of range, or none is free.

    Examples
    --------
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

    def __init__(self, system: HasPattern, fixed: ArrayLike) -> None:
        ndofs = system.ndofs
        ids = whole_array(fixed)
        if ids is None or ids.ndim != 1 or ids.dtype.kind == "b":
            raise StvkError(
                f"fixed = {shown(fixed)}; expected a list of degrees of freedom, d * vertex + component: bare integers are those "
                "here, and vertices in System(fixed=...). For a mask use np.flatnonzero(mask)."
            )
        bad = ids[(ids < 0) | (ids >= ndofs)]
        if len(bad):
            raise StvkError(
                f"fixed names {name_ids(bad, 'degree of freedom')} outside 0 ... {ndofs - 1}. Do they belong to another mesh?"
            )
        is_free = np.ones(ndofs, dtype=bool)
        is_free[ids.astype(np.int64)] = False
        self.free, self.fixed = np.flatnonzero(is_free), np.flatnonzero(~is_free)
        space: Space = getattr(system, "space", None) or Space(ndofs)
        if not space.comm.any(len(self.free) > 0):
            raise StvkError(f"All {space.count} degrees of freedom are fixed: there is nothing to solve for.")
        self._system = system
        self._known: tuple[Pattern, Structure, NDArray[np.int32]] | None = None

    def of(self, system: HasPattern) -> FreeDofs:
        """Return the same degrees of freedom for another system with the same pattern of K."""
        other = copy(self)
        other._system = system
        return other

    @property
    def structure(self) -> Structure:
        """Structure of K over the free degrees of freedom."""
        return self.restriction()[0]

    @property
    def pattern(self) -> Pattern:
        """Pattern of the whole K."""
        return self._system.pattern

    @property
    def value_indices(self) -> NDArray[np.int32]:
        """Indices in the values of K of the values of K over the free degrees of freedom, ascending."""
        return self.restriction()[1]

    def restriction(self) -> tuple[Structure, NDArray[np.int32]]:
        """Return the structure of K over the free degrees of freedom, and the indices of its values in those of K.

        Both are cached for each pattern.
        """
        pattern, known = self._system.pattern, self._known
        if known is None or known[0] is not pattern:
            self._known = known = pattern, *self._restricted(pattern)
        return known[1:]

    def _restricted(self, pattern: Pattern) -> tuple[Structure, NDArray[np.int32]]:
        free = self.free
        is_free = np.zeros(pattern.shape[0], dtype=bool)
        is_free[free] = True
        is_retained = is_free[pattern.indices]
        is_retained &= np.repeat(is_free, np.diff(pattern.indptr))
        places = np.flatnonzero(is_retained).astype(np.int32)
        number = np.cumsum(is_free, dtype=np.int32) - 1
        counts = np.add.reduceat(is_retained, pattern.indptr[:-1], dtype=np.int32)[free]
        indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        return Structure(indptr, number[pattern.indices[places]].astype(np.int32), (len(free),) * 2), places

    def matrix(self, K: csr_matrix, out: csr_matrix | None = None) -> csr_matrix:
        """Return `K` (ndofs, ndofs), which has the system's pattern, restricted to the free rows and columns.

        The values are written to `out` if given.

        Raises
        ------
        StvkError
            if `K` or `out` has another pattern.
        """
        self._system.pattern.refuse_other(K)
        structure, places = self.restriction()
        if out is None:
            out = structure.matrix(np.empty(structure.nnz, dtype=K.dtype))
        elif not structure.fits(out, K.dtype):
            raise StvkError(
                f"out = {shown(out)} does not have the pattern and type of the restricted K ({structure.shape}, {structure.nnz} "
                f"values of {K.dtype}); expected a matrix that matrix() or tangent(u, free=...) returned before."
            )
        run(block_kernels.take, parts_of(len(places), 0.02, threads()), places, K.data, out.data)
        return out

    def vector(self, free: ArrayLike, fixed: ArrayLike = 0.0) -> Array:
        """Return a vector (ndofs,) with these values at the free and the fixed degrees of freedom; `x[held.free]` is the inverse.

        Raises
        ------
        StvkError
            if a number of values does not match.
        """
        inner, outer = _numbers("free", free, len(self.free)), _numbers("fixed", fixed, len(self.fixed))
        least = np.complex64 if outer.dtype.kind == "c" else np.float32  # a single number does not raise the precision
        x = np.empty(self._system.ndofs, dtype=np.result_type(inner, outer if outer.ndim else least, least))
        x[self.free], x[self.fixed] = inner, outer
        return x

    def __repr__(self) -> str:
        return f"FreeDofs: {len(self.free)} free, {len(self.fixed)} fixed"


class BareDiagonal:
    """Diagonal of K for `nodes` without elements: a `stiffness` [N/m], the mean diagonal of the whole body at rest.

    This diagonal keeps K positive definite and as well conditioned as before. It has no corresponding force.
    """

    def __init__(self, stiffness: float, nodes: NDArray[np.int64]) -> None:
        self.stiffness, self.nodes = stiffness, nodes

    @classmethod
    def of(cls, blocks: Array) -> BareDiagonal:
        """Return the diagonal for a body with diagonal blocks (nv, d, d) [N/m] at rest, and without bare nodes yet."""
        mean = float(np.einsum("vcc->", blocks.astype(np.float64))) / blocks[..., 0].size
        return cls(mean if np.isfinite(mean) and mean > 0 else 1.0, np.empty(0, dtype=np.int64))

    def write(self, pattern: Pattern, data: Array, free: FreeDofs | None) -> None:
        """Write the diagonal to the values of K, or of K over the `free` degrees of freedom."""
        a = self.nodes.astype(np.int32)
        if not len(a):
            return
        d = pattern.shape[0] // len(pattern.strides)
        places = (pattern.block_indices(a, a)[:, None] + np.arange(d) * (pattern.strides[a][:, None] + 1)).ravel()
        if free is not None:
            at = np.minimum(np.searchsorted(free.value_indices, places), len(free.value_indices) - 1)
            places = at[free.value_indices[at] == places]
        data[places] = self.stiffness


def _union(pairs: Sequence[NDArray[np.int32]], nv: int) -> NDArray[np.int32]:
    """Return the pairs (2, n) of all terms in lexicographic order, without duplicates."""
    every = np.ascontiguousarray(np.concatenate([np.empty((2, 0), dtype=np.int32), *pairs], axis=1), dtype=np.int32)
    (a, b), (c, d) = every[:, :-1], every[:, 1:]
    if len(pairs) == 1 and ((a < c) | ((a == c) & (b < d))).all():
        return every
    every = every[:, lexicographic_order(every, nv)]
    first = np.ones(every.shape[1], dtype=bool)
    first[1:] = (every[:, 1:] != every[:, :-1]).any(axis=0)
    return np.ascontiguousarray(every[:, first])
