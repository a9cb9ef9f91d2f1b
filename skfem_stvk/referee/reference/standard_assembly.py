"""Reference model by scikit-fem's standard assembly, with which the package is compared.

The reference shares no code with the package. It is written as efficiently as scikit-fem allows, so that a comparison of speed is
fair. All terms that do not depend on the test and trial function are computed once outside of the forms, including the fourth-order
tangent. Linear simplices have one quadrature point, which is sufficient.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from skfem.helpers import ddot

from ...arguments import Array
from .kinds import KINDS, LINEAR, RuleLike, curved_elements, derivatives, numbered, points_of


class ReferenceStVK:
    """Reference model `W = integral of 1/2 E : C : E`, `E = 1/2 (F'F - I)`, `F = I + grad u`, assembled by scikit-fem.

    Elements with k = d are scikit-fem's own: `ElementTetP1`, `ElementTetP2`, `ElementTriP2`, `ElementHex1`, ..., with its mapping
    of straight or curved elements. scikit-fem has no mesh for elements of lower dimension than the space. Linear simplices among
    them are mapped one by one to their own axes. The others, and curved segments on a line, are integrated over reference elements.
    The displacement has all its components, and `F` (d, k) at rest consists of each element's own axes. The result is summed to the
    shared nodes. Nodes of no element get no force.

    Parameters
    ----------
    p
        (d, nv) coordinates of the nodes [m].
    t
        (n, nt) nodes of the elements, in scikit-fem's local order.
    tensor
        (nt, k, k, k, k) or (1, k, k, k, k) elasticity tensor in the elements' own axes times their section (`tensors`), or (nt, nq,
        k, k, k, k) at each point.
    kind
        Kind of the elements, a key of `KINDS`. The default is linear simplices with the number of nodes in `t`.
    rule
        Quadrature rule: "usual", "exact", or points (k, nq) and weights (nq,).

    Attributes
    ----------
    axes
        (nt, d, k) or (nt, nq, d, k) the elements' own axes.
    measure
        (nt, nq) length, area or volume that belongs to each point [m^k].
    """

    def __init__(self, p: Array, t: NDArray[np.int32], tensor: Array, kind: str | None = None, rule: RuleLike = "usual") -> None:
        kind = LINEAR[len(t) - 1] if kind is None else kind
        of, d, points = KINDS[kind], len(p), points_of(kind, rule)
        lies = of.k < d or (of.k == 1 and curved_elements(p, t, kind).any())
        self._rest: Array | None = None  # rest gradients of elements that are integrated over reference elements
        if of.k == d and not lies:
            mesh, nodes = _mesh(p, t, kind)
        elif of.is_linear_simplex:
            mesh, nodes = _disjoint(of, _laid_flat(p, t, simplex_axes(p, t)), t)
        else:
            corners = np.tile(of.nodes[: of.corners].T, t.shape[1])  # element by element
            mesh, nodes = _disjoint(of, corners, t)
        dofs = (d * nodes[:, None] + np.arange(d)).ravel()
        self._gather = None
        if not np.array_equal(dofs, np.arange(p.size)):
            self._gather = csr_matrix((np.ones(len(dofs)), (np.arange(len(dofs)), dofs)), shape=(len(dofs), p.size))
        self.basis = skfem.Basis(mesh, skfem.ElementVector(of.element(), dim=d), quadrature=points)
        self._tensor = tensor if tensor.ndim == 6 else tensor[:, None]
        self.axes, self.measure = element_axes(p, t, kind, points), self.basis.dx
        if of.k < d and of.is_linear_simplex:
            self.axes = self.axes[:, 0]
        elif lies:
            axes, R = _frames(p, t, kind, points)
            self._rest = np.moveaxis(axes, (0, 1), (2, 3))
            self._inverse = np.moveaxis(np.linalg.inv(R), (0, 1), (2, 3))
            self._stretch = np.prod(np.einsum("tqii->tqi", R), axis=2)
            self.measure = self.basis.dx * self._stretch
        self._start = np.moveaxis(self.axes, 0, 2)[..., None] if self._rest is None else self._rest

    def energy(self, u: Array) -> float:
        """Return the strain energy [J]."""
        _, E, S = self._state(u)
        return float(_energy.assemble(self.basis, E=E, S=S if self._rest is None else S * self._stretch))

    def internal_force(self, u: Array) -> Array:
        """Return the internal force [N]."""
        F, _, S = self._state(u)
        P = np.einsum("iM...,MJ...->iJ...", F, S)
        if self._rest is not None:
            P = self._stretch * np.einsum("iM...,JM...->iJ...", P, self._inverse)
        force: Array = _force.assemble(self.basis, P=P)
        return force if self._gather is None else self._gather.T @ force

    def tangent(self, u: Array) -> csr_matrix:
        """Return the tangent stiffness [N/m]. Its pattern depends on the state, because scikit-fem drops zeros."""
        F, _, S = self._state(u)
        A = self._moduli(F, S)
        if self._rest is not None:
            A = self._stretch * np.einsum("iMkN...,JM...,LN...->iJkL...", A, self._inverse, self._inverse, optimize=True)
        K = _tangent.assemble(self.basis, A=A)
        return csr_matrix(K if self._gather is None else self._gather.T @ K @ self._gather)

    def _gradient(self, u: Array) -> Array:
        """Return the gradient (d, k, nt, nq) that scikit-fem interpolates, with respect to its own coordinates."""
        gradient = self.basis.interpolate(u if self._gather is None else self._gather @ u).grad
        n, nq = self.basis.dx.shape
        return np.asarray(gradient).reshape(-1, self._tensor.shape[-1], n, nq)

    def _state(self, u: Array) -> tuple[Array, Array, Array]:
        """Return `F` (d, k, nt, nq), Green-Lagrange strain `E` and second Piola-Kirchhoff stress `S` (k, k, nt, nq)."""
        gradient = self._gradient(u)
        if self._rest is not None:
            gradient = np.einsum("iJ...,JM...->iM...", gradient, self._inverse)
        F = self._start + gradient
        k = F.shape[1]
        E = 0.5 * (np.einsum("mI...,mJ...->IJ...", F, F) - np.eye(k)[..., None, None])
        C = np.moveaxis(self._tensor, (0, 1), (-2, -1))
        return F, E, np.einsum("IJKL...,KL...->IJ...", C, E)

    def _moduli(self, F: Array, S: Array) -> Array:
        """Return `A_iJkL = dP_iJ/dF_kL = F_iM C_MJNL F_kN + delta_ik S_JL` (d, k, d, k, nt, nq)."""
        d, k, n, nq = F.shape
        f = np.ascontiguousarray(F.transpose(2, 3, 0, 1))
        left = (f @ self._tensor.reshape(*self._tensor.shape[:2], k, k**3)).reshape(n, nq, d, k, k, k)  # iJNL
        both = np.swapaxes(left, 4, 5).reshape(n, nq, -1, k) @ np.swapaxes(f, 2, 3)  # iJLk
        A = np.ascontiguousarray(both.reshape(n, nq, d, k, k, d).transpose(2, 3, 5, 4, 0, 1))
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
    """Return the gradient (d, k, nt, nq), also for a one-dimensional field, where scikit-fem omits an axis."""
    gradient = np.asarray(v.grad)
    return gradient.reshape(*like.shape[:2], *like.shape[-2:])


def _mesh(p: Array, t: NDArray[np.int32], kind: str) -> tuple[Any, NDArray[np.int64]]:
    """Return scikit-fem's mesh of elements with k = d, and the node (N,) of each of its degrees of freedom."""
    of = KINDS[kind]
    vertices, own = np.unique(t[: of.corners].astype(np.int64), return_inverse=True)
    own = own.reshape(of.corners, -1).astype(t.dtype)
    mesh = of.mesh(np.ascontiguousarray(p[:, vertices]), own, sort_t=False, validate=False)
    if of.is_linear_simplex:
        return mesh, vertices
    nodes = numbered(mesh, of.element(), t)
    if of.is_box or curved_elements(p, t, kind).any():
        points = np.ascontiguousarray(p[:, nodes] - p[:, nodes[:1]])  # near the origin, to avoid round-off of the mappings
        mesh = of.curved(points, own, sort_t=False, validate=False)
    return mesh, nodes


def _disjoint(of: Any, corners: Array, t: NDArray[np.int32]) -> tuple[Any, NDArray[np.int64]]:
    """Return a mesh of elements that share no nodes, and the node of each unknown.

    `corners` are the coordinates of the corners of each element, (k, nt times the number of corners).
    """
    own = np.arange(corners.shape[1], dtype=np.int32).reshape(-1, of.corners).T.copy()
    mesh = of.mesh(np.ascontiguousarray(corners), own, sort_t=False, validate=False)
    dofs = skfem.Dofs(mesh, of.element())
    nodes = np.empty(dofs.N, dtype=np.int64)
    nodes[dofs.element_dofs] = t
    return mesh, nodes


def element_axes(p: Array, t: NDArray[np.int32], kind: str, rule: RuleLike = "usual") -> Array:
    """Return orthonormal axes of the elements' own lines or surfaces at each point, (nt, nq, d, k).

    The first axis is along the first reference coordinate (Gram-Schmidt). If k = d, the global axes (nt, d, d) are returned.
    """
    if KINDS[kind].k == len(p):
        return np.broadcast_to(np.eye(len(p)), (t.shape[1], len(p), len(p)))
    return _frames(p, t, kind, rule)[0]


def simplex_axes(p: Array, t: NDArray[np.int32]) -> Array:
    """Return the axes (nt, d, k) of linear simplices, which have one point."""
    axes = element_axes(p, t, LINEAR[len(t) - 1])
    return axes if axes.ndim == 3 else axes[:, 0]


def _frames(p: Array, t: NDArray[np.int32], kind: str, rule: RuleLike) -> tuple[Array, Array]:
    """Return axes (nt, nq, d, k) and R (nt, nq, k, k), upper triangular with positive diagonal: `dX/dxi = axes R`."""
    x = p.T[t]
    base_vectors = np.einsum("qai,atc->tqci", derivatives(kind, rule), x - x[:1])
    k = base_vectors.shape[3]
    axes, R = np.empty_like(base_vectors), np.zeros((*base_vectors.shape[:2], k, k))
    for i in range(k):
        vector = base_vectors[..., i]
        for _ in range(2):  # the second pass reduces round-off
            for j in range(i):
                along = (vector * axes[..., j]).sum(axis=2)
                R[..., j, i] += along
                vector = vector - along[..., None] * axes[..., j]
        R[..., i, i] = np.linalg.norm(vector, axis=2)
        axes[..., i] = vector / R[..., i, i, None]
    return axes, R


def _laid_flat(p: Array, t: NDArray[np.int32], axes: Array) -> Array:
    """Return coordinates (k, (k + 1) nt) of each simplex's vertices in its own axes, with its first vertex at the origin."""
    x = p.T[t.T] - p.T[t[0]][:, None]
    return np.ascontiguousarray((x @ axes).reshape(-1, axes.shape[2]).T)
