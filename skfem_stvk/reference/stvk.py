"""scikit-fem's standard assembly of the same model: what the edge form is held against.

It shares no code with the edge path, and is written as well as scikit-fem allows, so that a comparison of speed is fair: all that
does not depend on the test and trial function is computed once outside of the forms, the fourth-order tangent included, and one
quadrature point is enough for P1.
"""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from skfem.helpers import ddot

from ..arguments import Array


class ReferenceStVK:
    """`W = sum of V/2 E : C : E` with `E = 1/2 (F'F - I)`, `F = I + grad u`, assembled by scikit-fem.

    Simplices of lower dimension than the space, for which scikit-fem has no mesh, are laid flat one by one; the displacement keeps
    all its components, `F` (d, k) starts from the simplices' own axes, and the result is summed to the shared vertices. Vertices
    that belong to no simplex get no force.

    Parameters
    ----------
    p : (d, nv) coordinates [m].
    t : (k + 1, nt) vertices of the simplices.
    tensor : (nt, k, k, k, k) or (1, k, k, k, k) elasticity tensor in the simplices' own axes times their section (`tensors`).
    """

    def __init__(self, p: Array, t: NDArray[np.int32], tensor: Array) -> None:
        k, d = t.shape[0] - 1, p.shape[0]
        self.axes = simplex_axes(p, t)
        element = {1: skfem.ElementLineP1, 2: skfem.ElementTriP1, 3: skfem.ElementTetP1}[k]()
        make = {1: skfem.MeshLine1, 2: skfem.MeshTri1, 3: skfem.MeshTet1}[k]
        if k == d:
            vertices, own = np.unique(t, return_inverse=True)
            points, own = np.ascontiguousarray(p[:, vertices]), own.reshape(t.shape).astype(t.dtype)
        else:
            vertices, own = t.T.ravel(), np.arange(t.size).reshape(-1, k + 1).T.copy()
            points = _laid_flat(p, t, self.axes)
        mesh = make(points, own, validate=False)
        dofs = (d * vertices[:, None] + np.arange(d)).ravel()
        self._gather = None
        if not np.array_equal(dofs, np.arange(p.size)):
            self._gather = csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), p.size))
        centre = np.full((k, 1), 1 / (k + 1)), np.array([1 / factorial(k)])  # intorder=1 takes three points of a triangle
        self.basis = skfem.Basis(mesh, skfem.ElementVector(element, dim=d), quadrature=centre)
        self._tangent_axes = np.moveaxis(self.axes, 0, 2)[..., None]  # (d, k, nt, 1): the gradient of the rest position
        self._tensor = tensor

    def energy(self, u: Array) -> float:
        """Strain energy [J]."""
        _, E, S = self._state(u)
        return float(_energy.assemble(self.basis, E=E, S=S))

    def internal_force(self, u: Array) -> Array:
        """Internal force [N]."""
        F, _, S = self._state(u)
        force: Array = _force.assemble(self.basis, P=np.einsum("iM...,MJ...->iJ...", F, S))
        return force if self._gather is None else self._gather.T @ force

    def tangent(self, u: Array) -> csr_matrix:
        """Tangent stiffness [N/m]; its pattern depends on the state, for scikit-fem drops zeros."""
        F, _, S = self._state(u)
        K = _tangent.assemble(self.basis, A=self._moduli(F, S))
        return csr_matrix(K if self._gather is None else self._gather.T @ K @ self._gather)

    def _state(self, u: Array) -> tuple[Array, Array, Array]:
        """`F` (d, k, nt, 1), Green-Lagrange strain `E` and second Piola-Kirchhoff stress `S` (k, k, nt, 1)."""
        gradient = self.basis.interpolate(u if self._gather is None else self._gather @ u).grad
        F = self._tangent_axes + np.asarray(gradient).reshape(self._tangent_axes.shape)
        k = F.shape[1]
        E = 0.5 * (np.einsum("mI...,mJ...->IJ...", F, F) - np.eye(k)[..., None, None])
        C = np.moveaxis(self._tensor, 0, -1)[..., None]
        return F, E, np.einsum("IJKL...,KL...->IJ...", C, E)

    def _moduli(self, F: Array, S: Array) -> Array:
        """`A_iJkL = dP_iJ/dF_kL = F_iM C_MJNL F_kN + delta_ik S_JL` (d, k, d, k, nt, 1)."""
        d, k, n, _ = F.shape
        f = np.ascontiguousarray(np.moveaxis(F[..., 0], 2, 0))
        left = (f @ self._tensor.reshape(-1, k, k**3)).reshape(n, d, k, k, k)  # iJNL
        both = np.swapaxes(left, 3, 4).reshape(n, -1, k) @ np.swapaxes(f, 1, 2)  # iJLk
        A = np.ascontiguousarray(both.reshape(n, d, k, k, d).transpose(1, 2, 4, 3, 0))[..., None]
        A[range(d), :, range(d)] += S
        return A


@skfem.Functional
def _energy(w: Any) -> Array:
    return 0.5 * ddot(w.S, w.E)


@skfem.LinearForm
def _force(v: Any, w: Any) -> Array:
    return np.einsum("iJ...,iJ...->...", w.P, _gradient(v, w.P))


@skfem.BilinearForm
def _tangent(u: Any, v: Any, w: Any) -> Array:
    stress = np.einsum("iJkL...,kL...->iJ...", w.A, _gradient(u, w.A))
    return np.einsum("iJ...,iJ...->...", stress, _gradient(v, stress))


def _gradient(v: Any, like: Array) -> Array:
    """The gradient (d, k, nt, 1), also of a one-dimensional field, for which scikit-fem leaves an axis out."""
    gradient = np.asarray(v.grad)
    return gradient.reshape(*like.shape[:2], *like.shape[-2:])


def simplex_axes(p: Array, t: NDArray[np.int32]) -> Array:
    """(nt, d, k) orthonormal axes of the simplices' own line or plane (Gram-Schmidt), the global ones for `k = d`."""
    k, d = t.shape[0] - 1, p.shape[0]
    if k == d:
        return np.broadcast_to(np.eye(d), (t.shape[1], d, d))
    axes = np.empty((t.shape[1], d, k))
    for i in range(k):
        vector = (p[:, t[i + 1]] - p[:, t[0]]).T
        for j in range(i):
            vector = vector - (vector * axes[:, :, j]).sum(axis=1, keepdims=True) * axes[:, :, j]
        axes[:, :, i] = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return axes


def _laid_flat(p: Array, t: NDArray[np.int32], axes: Array) -> Array:
    """(k, (k + 1) nt) coordinates of each simplex's vertices in its own axes, first vertex at the origin."""
    x = p.T[t.T] - p.T[t[0]][:, None]
    return np.ascontiguousarray((x @ axes).reshape(-1, axes.shape[2]).T)
