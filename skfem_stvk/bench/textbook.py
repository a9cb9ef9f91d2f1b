"""The textbook form, in either precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ..mesh import SimplexMesh
from ..terms import StVK


class Textbook:
    """`F` of the edge form with `zeta = |x_a - x_b|^2 - |X_a - X_b|^2` from positions, in NumPy and sparse products.

    Parameters
    ----------
    mesh : of tetrahedra.
    term : its material.
    dtype : of all that it holds and computes.
    """

    def __init__(self, mesh: SimplexMesh, term: StVK, dtype: DTypeLike) -> None:
        form = term.bind(mesh).form
        ne = form.edges.shape[1]
        signs = np.tile([1, -1], ne).astype(dtype)
        self._differences = csr_matrix((signs, form.edges.T.ravel(), 2 * np.arange(ne + 1)), shape=(ne, mesh.nv))
        self._to_vertices = csr_matrix(self._differences.T)
        self._L = form.L.astype(dtype)
        self._X = mesh.p.T.astype(dtype)
        self._rest = self._squares(self._differences @ self._X)

    def internal_force(self, u: NDArray[Any]) -> NDArray[Any]:
        """Internal force (3 nv,) [N]."""
        p = self._differences @ (self._X + u.reshape(self._X.shape))
        tension = self._L @ (self._squares(p) - self._rest)
        force: NDArray[Any] = (self._to_vertices @ (tension[:, None] * p)).ravel()
        return force

    @staticmethod
    def _squares(p: NDArray[Any]) -> NDArray[Any]:
        squares: NDArray[Any] = (p * p).sum(axis=1)
        return squares
