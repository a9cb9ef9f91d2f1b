"""W, F and K of elements in plain NumPy, from whatever tables and moduli it is given: what faults and hypotheses alter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ..arguments import Array
from ..mesh import ElementMesh
from ..terms import StVK
from .bodies import elasticity
from .discretisation import Discretisation, derivatives


def unchanged(F: Array) -> Array:
    """(nt, nq) ones: every point counts as what it is."""
    return np.ones(F.shape[:2])


@dataclass(frozen=True)
class ElementModel:
    """W, F and K of elements that fill the space.

    Attributes
    ----------
    p : (d, nv) coordinates that displacements belong to.
    X : (n, nt, d) rest positions of the nodes of each element.
    t : (n, nt) nodes of the elements.
    table : (nq, n, d) derivatives of the shape functions.
    weights : (nq,) of the points.
    tensor : (1 or nt, d, d, d, d) elasticity tensors, in which `S = C : E`.
    counted : factors (nt, nq) of the points at deformation gradients (nt, nq, d, d).
    initial : how much of the initial stress is in K.
    """

    p: Array
    X: Array
    t: NDArray[np.int32]
    table: Array
    weights: Array
    tensor: Array
    counted: Callable[[Array], Array] = unchanged
    initial: float = 1.0

    def energy(self, u: Array) -> float:
        """Strain energy [J]."""
        _, measure, _, E, S = self._state(u)
        return float((measure * (E * S).sum(axis=(2, 3))).sum() / 2)

    def internal_force(self, u: Array) -> Array:
        """Internal force (ndofs,) [N]."""
        gradients, measure, F, _, S = self._state(u)
        force = np.zeros(self.p.T.shape)
        np.add.at(force, self.t, np.einsum("tq,tqiM,tqMJ,tqaJ->ati", measure, F, S, gradients, optimize=True))
        return force.ravel()

    def tangent(self, u: Array) -> csr_matrix:
        """Tangent stiffness [N/m]."""
        g, measure, F, _, S = self._state(u)
        tensor = np.broadcast_to(self.tensor, (self.t.shape[1], *self.tensor.shape[1:]))
        K = np.einsum("tq,tqiM,tMJNL,tqkN,tqaJ,tqbL->taibk", measure, F, tensor, F, g, g, optimize=True)
        initial = self.initial * np.einsum("tq,tqJL,tqaJ,tqbL->tab", measure, S, g, g, optimize=True)
        d = len(self.p)
        for i in range(d):
            K[:, :, i, :, i] += initial
        dofs = d * self.t.T[:, :, None] + np.arange(d)
        rows, columns = np.broadcast_to(dofs[:, :, :, None, None], K.shape), np.broadcast_to(dofs[:, None, None], K.shape)
        return csr_matrix(coo_matrix((K.ravel(), (rows.ravel(), columns.ravel())), shape=(self.p.size,) * 2))

    def _state(self, u: Array) -> tuple[Array, ...]:
        """Gradients (nt, nq, n, d), measures (nt, nq), `F`, `E` and `S` (nt, nq, d, d)."""
        spokes = np.einsum("qai,atc->tqci", self.table, self.X)
        gradients = np.einsum("qai,tqic->tqac", self.table, np.linalg.inv(spokes))
        D = np.einsum("ati,tqaJ->tqiJ", u.reshape(self.p.T.shape)[self.t], gradients)
        F = np.eye(len(self.p)) + D
        E = (D + np.swapaxes(D, 2, 3) + np.swapaxes(D, 2, 3) @ D) / 2
        tensor = np.broadcast_to(self.tensor, (self.t.shape[1], *self.tensor.shape[1:]))
        S = np.einsum("tIJKL,tqKL->tqIJ", tensor, E, optimize=True)
        return gradients, np.abs(np.linalg.det(spokes)) * self.weights * self.counted(F), F, E, S


def model_of(mesh: ElementMesh, terms: Sequence[StVK]) -> ElementModel:
    """A right model of a body whose elements fill the space, by their usual rule."""
    how = Discretisation(mesh.element.name)
    points, weights = how.points
    table = derivatives(how.kind, points).astype(float)
    return ElementModel(mesh.p, mesh.p.T[mesh.t], mesh.t, table, weights, elasticity(mesh, terms, how))
