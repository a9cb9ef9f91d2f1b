"""Shapes of elements of any kind: their measures and aspect ratios, and the gradients of their shape functions at points."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..mesh import ElementMesh
from .discretisation import Discretisation, derivatives
from .reference import KINDS, curved_elements


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
