"""What W, F and K are held against: scikit-fem's assembly, and 50 digits for the flattest elements, where it loses digits too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..mesh import SimplexMesh
from ..mesh.geometry import aspect_ratios
from ..reference import ReferenceStVK
from .exact import ExactStVK

#: Longest edge over smallest height beyond which round-off may cost more than 1e-12; and how many such elements are computed in 50 digits.
FLAT, MOST = 20.0, 200


class Truth:
    """W, F and K of a body with elasticity tensors as `ReferenceStVK` takes them.

    Attributes
    ----------
    exact : elements that are computed in 50 digits: the flattest `MOST` of those with an aspect ratio beyond `FLAT`.
    """

    def __init__(self, mesh: SimplexMesh, tensor: Array) -> None:
        aspect = aspect_ratios(mesh)
        flattest = np.argsort(-aspect, kind="stable")[:MOST]
        self.exact = flattest[aspect[flattest] > FLAT]
        others = np.setdiff1d(np.arange(mesh.nt), self.exact)
        each = np.broadcast_to(tensor, (mesh.nt, *tensor.shape[1:]))
        self._parts: list[_Part | ExactStVK] = []
        if len(others):
            self._parts.append(_Part(mesh, others, tensor if len(tensor) == 1 else each[others]))
        if len(self.exact):
            self._parts.append(ExactStVK(mesh.p, mesh.t[:, self.exact], each[self.exact]))

    def described(self) -> str:
        """How it is computed, for the head of a report."""
        count = len(self.exact)
        return "scikit-fem" + (
            f"; the {count} flattest elements in 50 digits" if count > 1 else "; the flattest element in 50 digits" * count
        )

    def energy(self, u: Array) -> float:
        """Strain energy [J]."""
        return sum(part.energy(u) for part in self._parts)

    def internal_force(self, u: Array) -> Array:
        """Internal force (ndofs,) [N]."""
        return np.sum([part.internal_force(u) for part in self._parts], axis=0)

    def tangent(self, u: Array) -> csr_matrix:
        """Tangent stiffness [N/m]."""
        K, *more = (part.tangent(u) for part in self._parts)
        return csr_matrix(sum(more, K))


class _Part:
    """scikit-fem's assembly of some elements, on their own vertices: it takes no others."""

    def __init__(self, mesh: SimplexMesh, elements: NDArray[np.int64], tensor: Array) -> None:
        used, t = np.unique(mesh.t[:, elements], return_inverse=True)
        self._model = ReferenceStVK(mesh.p[:, used], t.reshape(len(mesh.t), -1).astype(np.int32), tensor)
        dofs = (mesh.d * used[:, None] + np.arange(mesh.d)).ravel()
        self._gather = csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), mesh.p.size))

    def energy(self, u: Array) -> float:
        return self._model.energy(self._gather @ u)

    def internal_force(self, u: Array) -> Array:
        return np.asarray(self._gather.T @ self._model.internal_force(self._gather @ u))

    def tangent(self, u: Array) -> csr_matrix:
        return csr_matrix(self._gather.T @ self._model.tangent(self._gather @ u) @ self._gather)
