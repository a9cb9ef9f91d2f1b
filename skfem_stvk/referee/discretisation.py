"""Discretisation of integrals: points, weights and shape functions of each kind of element, and the rest shapes of a mesh.

Points and weights are scikit-fem's, with the order that the reference chooses. The derivatives are implemented independently, in
decimal numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..mesh import ElementMesh
from .reference import KINDS, curved_elements, points_of
from .reference.kinds import LINEAR, Points

Exact = NDArray[Any]


@dataclass(frozen=True)
class Discretisation:
    """Kind of element and integration rule, as in `System`.

    Attributes
    ----------
    kind
        Kind of the elements, one of `reference.KINDS`.
    quadrature
        Integration rule, None for the usual one, or "exact" or "one-point".
    hourglass
        Coefficient of the hourglass control of the "one-point" rule.
    """

    kind: str
    quadrature: str | None = None
    hourglass: float = 0.0

    @classmethod
    def of_simplices(cls, n: int) -> Discretisation:
        """Return the discretisation of linear simplices with `n` vertices."""
        return cls(LINEAR[n - 1])

    @property
    def is_one_point(self) -> bool:
        """Whether the rule uses mean gradients and hourglass control."""
        return self.quadrature == "one-point"

    @property
    def points(self) -> Points:
        """Points (k, nq) and weights (nq,). For mean gradients, these are the points that the means are integrated with."""
        return points_of(self.kind, "exact" if self.quadrature == "exact" else "usual")

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of `System` in addition to mesh and terms."""
        return (
            {"quadrature": self.quadrature, "hourglass": self.hourglass}
            if self.is_one_point
            else ({} if self.quadrature is None else {"quadrature": self.quadrature})
        )

    def described(self) -> str:
        """Return the description of the rule as text.

        >>> Discretisation("quadratic tetrahedra").described()
        '4 points of order 2'
        """
        if self.is_one_point:
            return f"mean gradients, hourglass control {self.hourglass:g}"
        count, order = len(self.points[1]), KINDS[self.kind].orders[self.quadrature == "exact"]
        return f"{count} points of order {order}" if count > 1 else "1 point"


def derivatives(kind: str, xi: Array) -> Exact:
    """Return the derivatives `dN_a/dxi_i` (nq, n, k) in decimal numbers at reference points `xi` (k, nq).

    >>> derivatives("triangles", np.array([[0.25], [0.25]]))[0].astype(int).tolist()
    [[-1, -1], [1, 0], [0, 1]]
    """
    of = KINDS[kind]
    x = np.array([Decimal(value) for value in xi.T.ravel().tolist()], dtype=object).reshape(xi.T.shape)
    return _of_box(of.nodes, x) if of.is_box else _of_simplex(of.nodes, x)


def _of_box(nodes: Array, x: Exact) -> Exact:
    """Return `derivatives` for `N_a`, a product of one polynomial per axis.

    Each polynomial is 1 at the coordinate of the node, and 0 at the other coordinates of nodes.
    """
    values, slopes = np.empty((2, len(x), *nodes.shape), dtype=object)
    for (a, i), at in np.ndenumerate(nodes):
        scales = [(c, Decimal(at - c)) for c in np.unique(nodes[:, i]).tolist() if c != at]
        factors = [_factor(x[:, i], at, c) for c, _ in scales]
        others = [np.prod([*factors[:j], *factors[j + 1 :], 1 + 0 * x[:, i]], axis=0) for j in range(len(factors))]
        values[:, a, i] = np.prod(factors, axis=0)
        slopes[:, a, i] = sum(other / scale for other, (_, scale) in zip(others, scales, strict=True))
    return np.stack([np.prod(np.delete(values, i, axis=2), axis=2) * slopes[:, :, i] for i in range(nodes.shape[1])], axis=2)


def _factor(x: Exact, at: float, other: float) -> Exact:
    """Return `(x - other) / (at - other)`. For nodes at the ends this is `x` or `1 - x`, which avoids another rounding."""
    if {at, other} == {0.0, 1.0}:
        return x if at else 1 - x
    return (x - Decimal(other)) / Decimal(at - other)


def _of_simplex(nodes: Array, x: Exact) -> Exact:
    """Return `derivatives` for `N_a = l_a`, or for `l_a (2 l_a - 1)` at corners and `4 l_a l_b` at mid-edge nodes."""
    k = nodes.shape[1]
    l = np.concatenate([1 - x.sum(axis=1, keepdims=True), x], axis=1)
    dl = np.vstack([-np.ones(k, dtype=int), np.eye(k, dtype=int)]).astype(object)
    table = np.empty((len(x), len(nodes), k), dtype=object)
    for a, node in enumerate(nodes):
        if a > k:
            b, c = np.flatnonzero(np.append(1 - node.sum(), node))
            table[:, a] = 4 * (l[:, [b]] * dl[c] + l[:, [c]] * dl[b])
        else:
            table[:, a] = (l[:, [a]] * 0 + 1 if len(nodes) == k + 1 else 4 * l[:, [a]] - 1) * dl[a]
    return table


# shapes of the elements of a mesh


class Shape:
    """Rest shape of each element of a mesh at the points of a rule, by a QR decomposition of its base vectors `dX/dxi_i`.

    The base vectors of a linear simplex are its edges from the first vertex.

    Attributes
    ----------
    measure
        (nt, nq) length, area or volume that belongs to each point [m^k].
    gradients
        (nt, nq, n, k) gradients of the shape functions in the element's own axes [1/m].
    orientation
        (nt,) mean of the signs of the Jacobian at the points if k = d, else 1.
    steepest
        (nt,) 1/smallest height at any point [1/m].
    longest
        (nt,) longest edge at any point [m].
    aspect
        (nt,) longest edge over smallest height at the worst point: 1.22 for a regular tetrahedron, 1 for a cube.
    """

    def __init__(self, mesh: ElementMesh, discretisation: Discretisation) -> None:
        self.mesh, self.discretisation = mesh, discretisation
        xi, weights = discretisation.points
        table = derivatives(discretisation.kind, xi).astype(float)
        corners = mesh.p.T[mesh.t]
        base_vectors = np.einsum("qai,atc->tqci", table, corners - corners[:1])
        R = np.linalg.qr(base_vectors, mode="r")
        inverse = np.linalg.inv(R)
        self.measure = np.abs(np.prod(np.einsum("tqii->tqi", R), axis=2)) * weights
        self.orientation = np.sign(np.linalg.det(base_vectors)).mean(axis=1) if mesh.k == mesh.d else np.ones(mesh.nt)
        own = inverse if mesh.k < mesh.d else np.linalg.inv(base_vectors)  # in global axes if k = d
        self.gradients = np.einsum("qai,tqij->tqaj", table, own)
        edges, duals = [*np.moveaxis(base_vectors, 3, 0)], [*np.moveaxis(own, 2, 0)]
        if not KINDS[discretisation.kind].is_box:
            edges += [edges[i] - edges[j] for i in range(mesh.k) for j in range(i)]
            duals.append(-sum(duals))
        longest, steepest = (np.linalg.norm(np.stack(of), axis=-1).max(axis=0) for of in (edges, duals))
        self.longest, self.steepest = longest.max(axis=1), steepest.max(axis=1)
        self.aspect = (longest * steepest).max(axis=1)

    @cached_property
    def volume(self) -> Array:
        """Lengths, areas or volumes of the elements by the rule [m^k], (nt,)."""
        return np.asarray(self.measure.sum(axis=1))

    @cached_property
    def pairs(self) -> tuple[Array, Array]:
        """Local indices of the two nodes of each pair."""
        a, b = np.triu_indices(len(self.mesh.t), 1)
        return a, b

    def differences(self, x: Array) -> Array:
        """Return the differences (d, m, nt) of a field `x` (d, nv) between the nodes of each pair in an element."""
        a, b = self.pairs
        return np.asarray(x[:, self.mesh.t[a]] - x[:, self.mesh.t[b]])

    @cached_property
    def node_size(self) -> Array:
        """Shortest distance between two nodes in the elements around each node [m], (nv,)."""
        shortest = np.linalg.norm(self.differences(self.mesh.p), axis=0).min(axis=0)
        size = np.full(self.mesh.nv, np.inf)
        np.minimum.at(size, self.mesh.t, np.broadcast_to(shortest, self.mesh.t.shape))
        return size

    @cached_property
    def curved(self) -> Array:
        """Whether each element has curved edges, (nt,)."""
        return curved_elements(self.mesh.p, self.mesh.t, self.discretisation.kind)


def facet_ids(mesh: ElementMesh) -> NDArray[np.int64]:
    """Return the id of each facet of each element, (m, nt). Facets with the same corners have the same id."""
    facets = np.array(mesh.element.facets)[:, : mesh.facet.corners]  # (m, corners)
    every = np.sort(mesh.t[facets], axis=1)  # (m, corners, nt)
    ids = np.unique(np.swapaxes(every, 1, 2).reshape(-1, every.shape[1]), axis=0, return_inverse=True)[1]
    return np.asarray(ids).reshape(len(facets), mesh.nt)


def boundary_nodes(mesh: ElementMesh) -> NDArray[np.int64]:
    """Return the ids of nodes on facets that belong to one element only."""
    ids, facets = facet_ids(mesh), np.array(mesh.element.facets)
    facet, element = np.nonzero(np.bincount(ids.ravel())[ids] == 1)
    return np.unique(mesh.t[facets[facet], element[:, None]])
