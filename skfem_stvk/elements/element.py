"""The elements: nodes on the reference element in scikit-fem's local order, shape functions, edges and facets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem.refdom import RefHex, RefQuad

from ..arguments import Array

Ids = NDArray[np.int32]

#: Local edges of a segment, triangle and tetrahedron, as pairs of local vertices: those of a tetrahedron begin with a triangle's.
LOCAL_EDGES = {1: ((0, 1),), 2: ((0, 1), (1, 2), (0, 2)), 3: ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))}


@dataclass(frozen=True, eq=False)
class Element:
    """A kind of element. Nodes are its corners, then the middles of its edges, in scikit-fem's order.

        linear simplex       N_a = l_a, the barycentric coordinates          l_0 = 1 - xi_1 - ... - xi_k, l_i = xi_i
        quadratic simplex    N_a = l_a (2 l_a - 1) of corners                N_ab = 4 l_a l_b of the middle of the edge ab
        box                  N_a = product over i of xi_i or 1 - xi_i        quadrilateral, hexahedron: 1 at its own corner

    Attributes
    ----------
    name : in words, such as "quadratic tetrahedra".
    k : its dimension.
    degree : of the shape functions of simplices, 1 or 2; 1 for boxes, which are linear along each axis.
    is_box : whether it is a quadrilateral or hexahedron, not a simplex.
    nodes : (n, k) reference coordinates.
    edges : local corners `(a, b)` of its edges, in the order of the middle nodes of quadratic simplices.
    facets : local nodes of its facets, each as the element `facet` has them; scikit-fem's order of facets.
    facet : name of the kind of its facets; that of segments is "points", which have none.

    >>> tet = ELEMENTS["quadratic tetrahedra"]
    >>> tet.n, tet.corners, tet.facets[0], tet.facet
    (10, 4, (0, 1, 2, 4, 5, 6), 'quadratic triangles')
    """

    name: str
    k: int
    degree: int
    is_box: bool
    nodes: Array
    edges: tuple[tuple[int, int], ...]
    facets: tuple[tuple[int, ...], ...]
    facet: str

    @property
    def n(self) -> int:
        """Number of nodes."""
        return len(self.nodes)

    @property
    def corners(self) -> int:
        """Number of corners, the first nodes."""
        return 2**self.k if self.is_box else self.k + 1

    @property
    def is_linear_simplex(self) -> bool:
        """Whether the gradient of what it interpolates is the same everywhere in it."""
        return self.degree == 1 and not self.is_box

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs `(a, b)` of its local nodes that K couples: all; of a linear simplex its edges, in their order."""
        return self.edges if self.is_linear_simplex else tuple(combinations(range(self.n), 2))

    def values(self, xi: Array) -> Array:
        """(nq, n) shape functions at reference points `xi` (nq, k)."""
        if self.is_box:
            return np.asarray(np.prod(self._factors(xi), axis=2))
        l = _barycentric(xi)
        if self.degree == 1:
            return l
        a, b = np.transpose(self.edges)
        return np.concatenate([l * (2 * l - 1), 4 * l[:, a] * l[:, b]], axis=1)

    def derivatives(self, xi: Array) -> Array:
        """(nq, n, k) derivatives `dN_a/dxi_i` at reference points `xi` (nq, k); their sum over the nodes is 0."""
        if self.is_box:
            factors, signs = self._factors(xi), 2 * self.nodes - 1
            others = [np.prod(np.delete(factors, i, axis=2), axis=2) for i in range(self.k)]
            return np.stack(others, axis=2) * signs
        l, dl = _barycentric(xi)[:, :, None], np.vstack([-np.ones(self.k), np.eye(self.k)])
        if self.degree == 1:
            return np.broadcast_to(dl, (len(l), *dl.shape))
        a, b = np.transpose(self.edges)
        return np.concatenate([(4 * l - 1) * dl, 4 * (l[:, a] * dl[b] + l[:, b] * dl[a])], axis=1)

    def _factors(self, xi: Array) -> Array:
        """(nq, n, k) `xi_i` or `1 - xi_i` of each node of a box."""
        return np.where(self.nodes == 1, xi[:, None], 1 - xi[:, None])

    def __repr__(self) -> str:
        return f"Element: {self.name}, {self.n} nodes"


def _barycentric(xi: Array) -> Array:
    """(nq, k + 1) barycentric coordinates `l_a` of reference points `xi` (nq, k)."""
    return np.concatenate([1 - xi.sum(axis=1, keepdims=True), xi], axis=1)


def _simplex(name: str, k: int, degree: int, facet: str) -> Element:
    corners, edges = np.vstack([np.zeros(k), np.eye(k)]), LOCAL_EDGES[k]
    nodes = corners if degree == 1 else np.concatenate([corners, [(corners[a] + corners[b]) / 2 for a, b in edges]])
    facets = []
    for ids in combinations(range(k + 1), k):
        middles = [k + 1 + edges.index((ids[a], ids[b])) for a, b in LOCAL_EDGES[k - 1]] if k > 1 and degree == 2 else []
        facets.append((*ids, *middles))
    if k == 2:  # scikit-fem's facets of a triangle are its edges in their order
        facets = [(*edge, 3 + i) if degree == 2 else edge for i, edge in enumerate(edges)]
    return Element(name, k, degree, False, nodes, edges, tuple(facets), facet)


def _box(name: str, reference: Any, k: int, facet: str) -> Element:
    edges = reference.edges if k == 3 else reference.facets
    facets = tuple(tuple(map(int, ids)) for ids in reference.facets)
    return Element(
        name, k, 1, True, np.array(reference.p).T.astype(float), tuple((int(a), int(b)) for a, b in edges), facets, facet
    )


#: All elements by name.
ELEMENTS: dict[str, Element] = {
    element.name: element
    for element in (
        _simplex("segments", 1, 1, "points"),
        _simplex("triangles", 2, 1, "segments"),
        _simplex("tetrahedra", 3, 1, "triangles"),
        _simplex("quadratic segments", 1, 2, "points"),
        _simplex("quadratic triangles", 2, 2, "quadratic segments"),
        _simplex("quadratic tetrahedra", 3, 2, "quadratic triangles"),
        _box("quadrilaterals", RefQuad, 2, "segments"),
        _box("hexahedra", RefHex, 3, "quadrilaterals"),
    )
}


#: What the ends of segments are: no extension, one node.
POINT = Element("points", 0, 1, False, np.zeros((1, 0)), (), (), "")


def named(name: str) -> Element:
    """The element of this name."""
    return POINT if name == "points" else ELEMENTS[name]


def linear_simplex(k: int) -> Element:
    """The linear simplex of dimension `k`."""
    return ELEMENTS[{1: "segments", 2: "triangles", 3: "tetrahedra"}[k]]


def second_order(element: Element) -> Element:
    """The quadratic simplex that has a linear simplex's corners."""
    return ELEMENTS[f"quadratic {element.name}"]
