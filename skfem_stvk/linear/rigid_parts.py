"""Coarse space of conjugate gradients on a divided body: the rigid motions of each of its parts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..kernels import cg as kernels
from .solver import Vector
from .space import Space

#: Eigenvalues below this fraction of the largest are those of dependent motions, or of motions without resistance.
DEPENDENT = 1e-10


class RigidParts:
    """Term `Z E^-1 Z'` of a preconditioner, with `E = Z'K Z`. The columns of Z are the rigid motions of the nodes of each part.

    A node counts in one part, its owner. E has six rows for each part, and all parts solve with it. Motions without resistance, and
    those that depend on others, are left out. `Z'r` needs one reduction, which can be that of the scalar products.

    Parameters
    ----------
    rotations
        (3 rows, 3) displacements due to three rotations of the whole body, zero at constrained components.
    constrained
        Indices of constrained components.
    space
        Space of the vectors (3 rows,).
    multiply
        Function for the product of this part's contribution to K and a vector.
    """

    def __init__(
        self, rotations: Vector, constrained: NDArray[np.int64], space: Space, multiply: Callable[[Vector], Vector]
    ) -> None:
        self._rotations, self._constrained, self._space = rotations.ravel(), constrained, space
        self._rows = len(rotations) // 3
        self._owner = space.share(space.rank * space.counted(np.ones(self._rows))).astype(np.int32)
        E, v = np.zeros((6 * space.size,) * 2), np.empty(len(rotations))
        for i in (6 * np.unique(self._owner)[:, None] + np.arange(6)).ravel():
            v[:] = 0
            self._add_motions(np.arange(len(E)) == i, v)
            E[i] = self._force([(0, self._rows)], multiply(v))
        E = space.total(E)
        self._inverse = space.broadcast(pseudo_inverse(E) if space.leads else None)

    def force(self, r: Vector) -> Vector:
        """Return the contribution of this part to `Z'r` (6 parts,)."""
        return self._force([(own.start // 3, own.stop // 3) for own in self._space.owned], r)

    def add(self, force: Vector, out: Vector) -> float:
        """Add `Z E^-1 force` to `out` (3 rows,), and return `force' E^-1 force`."""
        amounts = np.einsum("ij,j->i", self._inverse, force)  # not by BLAS, see Space.dot
        self._add_motions(amounts, out)
        return float(np.einsum("i,i", amounts, force))

    def _force(self, ranges: list[tuple[int, int]], r: Vector) -> Vector:
        found = np.zeros((self._space.size, 6))
        for begin, end in ranges:
            kernels.add_rigid_forces(begin, end, self._owner, self._rotations, r, found)
        return found.ravel()

    def _add_motions(self, amounts: Vector, out: Vector) -> None:
        of_parts = amounts.astype(np.float64).reshape(-1, 6)
        kernels.add_rigid_motions(self._owner, self._rotations, self._constrained, of_parts, out)


def pseudo_inverse(E: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of a symmetric positive semi-definite matrix, 0 along eigenvectors without a positive eigenvalue.

    Rows and columns are scaled, so that the size of the motions has no effect. It is zero if an entry is not finite, or if the
    matrix is indefinite: then K is, too, and conjugate gradients shall find its direction of negative curvature as without motions.

    >>> pseudo_inverse(np.diag([4.0, 0.0]))
    array([[0.25, 0.  ],
           [0.  , 0.  ]])
    """
    diagonal = np.diag(E)
    if not np.isfinite(E).all():
        return np.zeros_like(E)
    scale = np.where(diagonal > 0, 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1)), 0)
    values, vectors = np.linalg.eigh(scale[:, None] * (E + E.T) / 2 * scale)
    if values[0] < -DEPENDENT * values[-1]:
        return np.zeros_like(E)
    positive = values > DEPENDENT * values[-1]
    columns = scale[:, None] * vectors[:, positive]
    return np.asarray(columns / values[positive] @ columns.T)
