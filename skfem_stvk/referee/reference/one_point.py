"""Quadrilaterals and hexahedra with mean gradients and hourglass control, in plain NumPy on scikit-fem's shape functions."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ...arguments import Array
from .kinds import KINDS, points_of


class ReferenceOnePoint:
    """Reference model with mean gradients and hourglass control.

    `W = sum of V/2 E : C : E + W_h` with `F = I + sum_a u_a g_a'` and the mean gradients `g_a = int dN_a/dX dV / V`.

        W_h = control/16 V sum_a |g_a|^2 sum_k |gamma_k' u|^2        gamma_k = h_k - sum_i (h_k' X_i) g_i

    The hourglass shapes `h_k` are the products of two and of three reference coordinates in -1 ... 1. Quadrilaterals have one,
    hexahedra four. Source: Flanagan, Belytschko 1981; Joldes, Wittek, Miller 2008.

    Parameters
    ----------
    p
        (d, nv) coordinates of the nodes [m].
    t
        (2^d, nt) nodes of the elements, in scikit-fem's local order.
    tensor
        (nt, d, d, d, d) or (1, d, d, d, d) elasticity tensor times section.
    control
        (nt,) or (1,) coefficient of the hourglass control times `lam + 2 mu` times section.
    """

    def __init__(self, p: Array, t: NDArray[np.int32], tensor: Array, control: Array) -> None:
        self.d, self.ndofs, self.t, self._tensor = len(p), p.size, t, tensor
        kind = {2: "quadrilaterals", 3: "hexahedra"}[self.d]
        self.gradients, self.volume = mean_gradients(p, t, kind)
        shapes = hourglass_shapes(KINDS[kind].nodes)
        X = p[:, t] - p[:, t[:1]]  # (d, n, nt)
        along = np.einsum("kn,int->kit", shapes, X)
        self.gamma = shapes[:, :, None] - np.einsum("kit,nit->knt", along, self.gradients)
        self._stiffness = control / 8 * self.volume * (self.gradients**2).sum(axis=(0, 1))

    def energy(self, u: Array) -> float:
        """Return the strain energy [J]."""
        _, E, S = self._state(u)
        return float((self.volume * (E * S).sum(axis=(0, 1))).sum() / 2 + u @ (self._control @ u) / 2)

    def internal_force(self, u: Array) -> Array:
        """Return the internal force [N]."""
        F, _, S = self._state(u)
        f = np.einsum("t,iMt,MJt,aJt->ait", self.volume, F, S, self.gradients, optimize=True)
        force = np.zeros((self.ndofs // self.d, self.d))
        np.add.at(force, self.t, np.swapaxes(f, 1, 2))
        return np.asarray(force.ravel() + self._control @ u)

    def tangent(self, u: Array) -> csr_matrix:
        """Return the tangent stiffness [N/m]."""
        F, _, S = self._state(u)
        C, g = np.broadcast_to(np.moveaxis(self._tensor, 0, -1), (*4 * (self.d,), self.t.shape[1])), self.gradients
        K = np.einsum("t,iMt,MJNLt,kNt,aJt,bLt->aibkt", self.volume, F, C, F, g, g, optimize=True)
        initial = np.einsum("t,JLt,aJt,bLt->abt", self.volume, S, g, g, optimize=True)
        for i in range(self.d):
            K[:, i, :, i] += initial
        return csr_matrix(self._assembled(K) + self._control)

    @cached_property
    def _control(self) -> csr_matrix:
        """Constant part of K from the hourglass control, (ndofs, ndofs)."""
        blocks = np.einsum("t,kat,kbt->abt", self._stiffness, self.gamma, self.gamma, optimize=True)
        return self._assembled(np.einsum("abt,ij->aibjt", blocks, np.eye(self.d)))

    def _assembled(self, K: Array) -> csr_matrix:
        dofs = self.d * self.t[:, None] + np.arange(self.d)[:, None]  # (n, d, nt)
        rows, columns = np.broadcast_to(dofs[:, :, None, None], K.shape), np.broadcast_to(dofs, K.shape)
        return csr_matrix(coo_matrix((K.ravel(), (rows.ravel(), columns.ravel())), shape=(self.ndofs,) * 2))

    def _state(self, u: Array) -> tuple[Array, Array, Array]:
        """Return `F`, `E` and `S` (d, d, nt)."""
        F = np.eye(self.d)[:, :, None] + np.einsum("nti,njt->ijt", u.reshape(-1, self.d)[self.t], self.gradients)
        E = 0.5 * (np.einsum("mIt,mJt->IJt", F, F) - np.eye(self.d)[:, :, None])
        return F, E, np.einsum("IJKLt,KLt->IJt", np.moveaxis(self._tensor, 0, -1), E)


def mean_gradients(p: Array, t: NDArray[np.int32], kind: str) -> tuple[Array, Array]:
    """Return exact mean gradients (n, d, nt) of scikit-fem's shape functions over each element, and volumes (nt,)."""
    of = KINDS[kind]
    vertices, own = np.unique(t, return_inverse=True)
    mesh = of.mesh(np.ascontiguousarray(p[:, vertices] - p[:, vertices[:1]]), own.reshape(t.shape).astype(t.dtype), validate=False)
    basis = skfem.Basis(mesh, of.element(), quadrature=points_of(kind))
    volume = basis.dx.sum(axis=1)
    gradients = [(np.asarray(functions[0].grad) * basis.dx).sum(axis=2) / volume for functions in basis.basis]
    return np.stack(gradients), volume


def hourglass_shapes(nodes: Array) -> Array:
    """Return products (1 or 4, n) of two, and of three, of the reference coordinates of the nodes (n, k) in -1 ... 1.

    >>> hourglass_shapes(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
    array([[ 1., -1.,  1., -1.]])
    """
    signs = 2.0 * nodes - 1
    k = signs.shape[1]
    return np.array([np.prod(signs[:, of], axis=1) for m in range(2, k + 1) for of in map(list, combinations(range(k), m))])
