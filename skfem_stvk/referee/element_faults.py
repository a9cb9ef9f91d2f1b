"""Planted faults of elements with several points: what is easily got wrong in their tables, and the checks that must say so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ..arguments import Array
from ..mesh import ElementMesh
from ..reference import ReferenceOnePoint
from ..reference.kinds import middles
from ..terms import StVK
from .bodies import elasticity, hourglass_control
from .discretisation import Discretisation, derivatives
from .faults import Fault, checks


@dataclass(frozen=True)
class ElementModel:
    """W, F and K of elements that fill the space, in plain NumPy from whatever tables it is given.

    Attributes
    ----------
    p : (d, nv) coordinates that displacements belong to.
    X : (n, nt, d) rest positions of the nodes of each element.
    t : (n, nt) nodes of the elements.
    table : (nq, n, d) derivatives of the shape functions.
    weights : (nq,) of the points.
    tensor : (d, d, d, d) elasticity tensor.
    """

    p: Array
    X: Array
    t: NDArray[np.int32]
    table: Array
    weights: Array
    tensor: Array

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
        K = np.einsum("tq,tqiM,MJNL,tqkN,tqaJ,tqbL->taibk", measure, F, self.tensor, F, g, g, optimize=True)
        initial = np.einsum("tq,tqJL,tqaJ,tqbL->tab", measure, S, g, g, optimize=True)
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
        F = np.eye(len(self.p)) + np.einsum("ati,tqaJ->tqiJ", u.reshape(self.p.T.shape)[self.t], gradients)
        E = (np.swapaxes(F, 2, 3) @ F - np.eye(len(self.p))) / 2
        return gradients, np.abs(np.linalg.det(spokes)) * self.weights, F, E, np.einsum("IJKL,tqKL->tqIJ", self.tensor, E)


def model_of(mesh: ElementMesh, term: StVK) -> ElementModel:
    """A right model of a homogeneous body."""
    how = Discretisation(mesh.element.name)
    points, weights = how.points
    table = derivatives(how.kind, points).astype(float)
    return ElementModel(mesh.p, mesh.p.T[mesh.t], mesh.t, table, weights, elasticity(mesh, [term], how)[0])


def _altered(change: Callable[[ElementModel], dict[str, Any]], mesh: ElementMesh, term: StVK) -> ElementModel:
    right = model_of(mesh, term)
    return ElementModel(**(vars(right) | change(right)))


def _point_dropped(model: ElementModel) -> dict[str, Any]:
    return {"table": model.table[:-1], "weights": model.weights[:-1]}


def _wrong_weight(model: ElementModel) -> dict[str, Any]:
    return {"weights": model.weights * np.where(np.arange(len(model.weights)) == 0, 1 + 1e-6, 1)}


def _last_two_exchanged(model: ElementModel) -> dict[str, Any]:
    order = [*range(len(model.t) - 2), len(model.t) - 1, len(model.t) - 2]
    return {"X": model.X[order], "t": model.t[order]}


def _straightened(mesh: ElementMesh, term: StVK) -> ElementModel:
    right = model_of(mesh, term)
    X = right.X.copy()
    for middle, (a, b) in middles(mesh.element.name):
        X[middle] = (X[a] + X[b]) / 2
    return ElementModel(**(vars(right) | {"X": X}))


def _without_control(mesh: ElementMesh, term: StVK) -> ReferenceOnePoint:
    how = Discretisation(mesh.element.name, "one-point", 0.0)
    return ReferenceOnePoint(mesh.p, mesh.t, elasticity(mesh, [term], how), hourglass_control(mesh, [term], how))


def _gradients_at_the_centre(mesh: ElementMesh, term: StVK) -> ElementModel:
    centre = np.full((mesh.k, 1), 0.5)
    table = derivatives(mesh.element.name, centre).astype(float)
    right = model_of(mesh, term)
    return ElementModel(**(vars(right) | {"table": table, "weights": np.ones(1)}))


_AGREEMENT = {"agreement": "W,F,K"}

#: Faults of elements with several points that fill the space, by name.
TABLE_FAULTS: dict[str, Fault] = {
    "one point dropped": Fault(
        "the last quadrature point is left out", partial(_altered, _point_dropped), checks(**_AGREEMENT, closed_forms="W,P")
    ),
    "a wrong weight": Fault(
        "the first weight is off by a millionth", partial(_altered, _wrong_weight), checks(**_AGREEMENT, closed_forms="W,P")
    ),
}
#: Faults of quadratic elements, on a body with curved edges.
QUADRATIC_FAULTS: dict[str, Fault] = {
    "middles exchanged": Fault(
        "the last two middles are exchanged, as between the orders of Gmsh and VTK",
        partial(_altered, _last_two_exchanged),
        checks(**_AGREEMENT, closed_forms="W"),
    ),
    "curved taken as straight": Fault(
        "gradients and weights are those of elements with straight edges", _straightened, checks(**_AGREEMENT, closed_forms="W,P")
    ),
}
#: Faults of quadrilaterals and hexahedra with one point.
ONE_POINT_FAULTS: dict[str, Fault] = {
    "no hourglass control": Fault(
        "modes that the mean gradients do not see cost nothing",
        _without_control,
        checks(**_AGREEMENT, no_further_zero_mode="K"),
    ),
    "gradients at the centre": Fault(
        "gradients and volume of the centre instead of their means",
        _gradients_at_the_centre,
        checks(**_AGREEMENT, patch_test="F"),
    ),
}
