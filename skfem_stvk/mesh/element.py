"""The elements, each a row of a table: cell, nodes, shape functions, orders of rules, facets, and names in other packages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import skfem
from skfem.refdom import RefHex, RefLine, RefQuad, RefTet, RefTri

from ..arguments import Array

#: Local numbers of some corners of an element.
Corners = tuple[int, ...]

#: Local edges of a segment, triangle and tetrahedron, as pairs of local vertices: those of a tetrahedron begin with a triangle's.
LOCAL_EDGES = {1: ((0, 1),), 2: ((0, 1), (1, 2), (0, 2)), 3: ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))}


@dataclass(frozen=True, eq=False)
class Cell:
    """A reference cell, which all elements with the same corners share.

    Attributes
    ----------
    family
        Meshio's word for cells with these corners; a number of nodes may follow, as in tetra10.
    lagrange
        Meshio's word for cells of any degree with these corners.
    reference
        Reference domain of scikit-fem.
    corners
        (m, k) reference coordinates of the corners.
    edges
        Pairs of corners, in scikit-fem's order.
    facets
        Corners of each facet, in scikit-fem's order of facets.
    reversed
        The corners in an order of the opposite orientation, with the first two exchanged.
    """

    family: str
    lagrange: str
    reference: Any
    corners: Array
    edges: tuple[tuple[int, int], ...]
    facets: tuple[Corners, ...]
    reversed: Corners


class ShapeFunctions(NamedTuple):
    """Shape functions of an element.

    Attributes
    ----------
    means
        The corners between which each further node is, in scikit-fem's order: first edges, then faces, then the cell.
    values
        Values `N_a` (nq, n) at reference points `xi` (nq, k).
    derivatives
        Derivatives `dN_a/dxi_i` (nq, n, k) at reference points `xi` (nq, k); their sum over the nodes is 0.
    lumped_by_rows
        Whether masses are lumped by row sums, which are all positive then; else by diagonals (`spread.lumped_shares`).
    one_point
        Whether one point with mean gradients and hourglass control is enough where the element fills the space.
    """

    means: tuple[Corners, ...]
    values: Callable[[Array], Array]
    derivatives: Callable[[Array], Array]
    lumped_by_rows: bool = False
    one_point: bool = False


@dataclass(frozen=True, eq=False)
class Element:
    """A kind of element. Nodes are its corners, then further nodes in the middle of edges, faces and the cell.

        linear simplex       N_a = l_a, the barycentric coordinates          l_0 = 1 - xi_1 - ... - xi_k, l_i = xi_i
        quadratic simplex    N_a = l_a (2 l_a - 1) of corners                N_ab = 4 l_a l_b of the middle of the edge ab
        box                  N_a = product over i of xi_i or 1 - xi_i        quadrilateral, hexahedron: 1 at its own corner

    Attributes
    ----------
    name
        Name in words, such as "quadratic tetrahedra".
    cell
        Reference cell of the element.
    functions
        Shape functions on that cell.
    facet
        Name of the kind of its facets; the facets of segments are "points", which have none.
    orders
        Orders of exactness, as scikit-fem counts them, of the usual rule, of the exact one, and of the one for masses (`rule_of`).
    cell_type
        Meshio's type of cells with its nodes.
    scikit_fem
        Scalar element of scikit-fem with the same nodes.
    mesh
        Mesh class of scikit-fem for such elements, if it has one.
    in_cells
        The index of each node among those of a cell, which has them in VTK's order; empty if that is the same.

    Examples
    --------
    >>> tet = ELEMENTS["quadratic tetrahedra"]
    >>> tet.n, tet.corners, tet.facets[0], tet.facet
    (10, 4, (0, 1, 2, 4, 5, 6), 'quadratic triangles')
    """

    name: str
    cell: Cell
    functions: Callable[[Cell], ShapeFunctions]
    facet: str
    orders: tuple[int, int, int]
    cell_type: str
    scikit_fem: Any = None
    mesh: Any = None
    in_cells: tuple[int, ...] = ()

    @cached_property
    def shape(self) -> ShapeFunctions:
        """Shape functions on the reference cell."""
        return self.functions(self.cell)

    @cached_property
    def means(self) -> tuple[Corners, ...]:
        """Corners between which each further node lies."""
        return self.shape.means

    @cached_property
    def nodes(self) -> Array:
        """Reference coordinates of the nodes, (n, k)."""
        corners = self.cell.corners
        return np.array([*corners, *(corners[list(ids)].mean(axis=0) for ids in self.means)]).reshape(-1, self.k)

    @cached_property
    def k(self) -> int:
        """Dimension of the reference cell."""
        return self.cell.corners.shape[1]

    @cached_property
    def n(self) -> int:
        """Number of nodes."""
        return len(self.cell.corners) + len(self.means)

    @cached_property
    def corners(self) -> int:
        """Number of corners, which are the first nodes."""
        return len(self.cell.corners)

    @cached_property
    def degree(self) -> int:
        """Degree of the shape functions along an edge: 2 if the element has nodes besides its corners, else 1."""
        return 2 if self.means else 1

    @cached_property
    def is_simplex(self) -> bool:
        """Whether the element is a segment, triangle or tetrahedron of any degree, so that each facet is opposite to a corner."""
        return self.corners == self.k + 1

    @cached_property
    def is_linear_simplex(self) -> bool:
        """Whether the element is a simplex without further nodes, so that the shape functions have constant gradients."""
        return self.n == self.k + 1

    @property
    def edges(self) -> tuple[tuple[int, int], ...]:
        """Edges as pairs of corners `(a, b)`."""
        return self.cell.edges

    @property
    def linear(self) -> Element:
        """Element with the same corners and no further nodes."""
        return self if not self.means else next(one for one in ELEMENTS.values() if one.cell is self.cell and not one.means)

    @property
    def quadratic(self) -> Element | None:
        """Element with the same corners and further nodes; None if there is no such element."""
        return next((one for one in ELEMENTS.values() if one.cell is self.cell and one.means), None)

    @property
    def edge(self) -> Element:
        """Element of the edges: a segment of the same degree."""
        return self if self.k == 1 else named(self.facet).edge

    @cached_property
    def facets(self) -> tuple[Corners, ...]:
        """Local nodes of the facets in scikit-fem's order, each facet numbered as the element `facet`."""
        further = {frozenset(ids): self.corners + i for i, ids in enumerate(self.means)}
        means = named(self.facet).means if self.facet else ()
        return tuple((*ids, *(further[frozenset(ids[a] for a in of)] for of in means)) for ids in self.cell.facets)

    @cached_property
    def reversed(self) -> list[int]:
        """Local nodes in the order of an element with the opposite orientation: the first two corners are exchanged."""
        corners = self.cell.reversed
        further = [frozenset(ids) for ids in self.means]
        return [*corners, *(self.corners + further.index(frozenset(corners[a] for a in ids)) for ids in self.means)]

    @cached_property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs `(a, b)` of local nodes that K couples: the edges of a linear simplex in their order, else all pairs."""
        return self.edges if self.is_linear_simplex else tuple(combinations(range(self.n), 2))

    def values(self, xi: Array) -> Array:
        """Return the shape functions (nq, n) at reference points `xi` (nq, k)."""
        return self.shape.values(xi)

    def derivatives(self, xi: Array) -> Array:
        """Return the derivatives `dN_a/dxi_i` (nq, n, k) at reference points `xi` (nq, k); their sum over the nodes is 0."""
        return self.shape.derivatives(xi)

    def __reduce__(self) -> tuple[Callable[[str], Element], tuple[str]]:
        """Return the constructor and its arguments for copies and pickles, which are the same row of the table."""
        return named, (self.name,)

    def __repr__(self) -> str:
        return f"Element: {self.name}, {self.n} nodes"


def _simplex(k: int, family: str, lagrange: str, reference: Any) -> Cell:
    facets: tuple[Corners, ...] = tuple(combinations(range(k + 1), k))
    facets = LOCAL_EDGES[k] if k == 2 else facets  # scikit-fem's facets of a triangle are its edges in their order
    return Cell(family, lagrange, reference, np.vstack([np.zeros(k), np.eye(k)]), LOCAL_EDGES[k], facets, (1, 0, *range(2, k + 1)))


def _box(family: str, lagrange: str, reference: Any, reversed: Corners) -> Cell:
    facets = tuple(tuple(map(int, ids)) for ids in reference.facets)
    edges = tuple((int(a), int(b)) for a, b in getattr(reference, "edges", None) or reference.facets)
    return Cell(family, lagrange, reference, np.array(reference.p).T.astype(float), edges, facets, reversed)


def _barycentric(xi: Array) -> Array:
    """Return the barycentric coordinates `l_a` (nq, k + 1) of reference points `xi` (nq, k)."""
    return np.concatenate([1 - xi.sum(axis=1, keepdims=True), xi], axis=1)


def _P1(cell: Cell) -> ShapeFunctions:
    """Return barycentric coordinates as shape functions of a simplex."""
    k = cell.corners.shape[1]
    slopes = np.vstack([-np.ones(k), np.eye(k)])
    return ShapeFunctions((), _barycentric, lambda xi: np.broadcast_to(slopes, (len(xi), *slopes.shape)))


def _P2(cell: Cell) -> ShapeFunctions:
    """Return quadratic functions on a simplex with nodes in the middle of its edges."""
    k = cell.corners.shape[1]
    a, b = np.transpose(cell.edges)
    slopes = np.vstack([-np.ones(k), np.eye(k)])

    def values(xi: Array) -> Array:
        l = _barycentric(xi)
        return np.concatenate([l * (2 * l - 1), 4 * l[:, a] * l[:, b]], axis=1)

    def derivatives(xi: Array) -> Array:
        l = _barycentric(xi)[:, :, None]
        return np.concatenate([(4 * l - 1) * slopes, 4 * (l[:, a] * slopes[b] + l[:, b] * slopes[a])], axis=1)

    return ShapeFunctions(cell.edges, values, derivatives)


def _Q1(cell: Cell) -> ShapeFunctions:
    """Return products of linear functions along the axes of a box."""
    corners = cell.corners

    def factors(xi: Array) -> Array:
        """Return `xi_i` or `1 - xi_i` of each corner, (nq, n, k)."""
        return np.where(corners == 1, xi[:, None], 1 - xi[:, None])

    def derivatives(xi: Array) -> Array:
        every = factors(xi)
        others = [np.prod(np.delete(every, i, axis=2), axis=2) for i in range(corners.shape[1])]
        return np.stack(others, axis=2) * (2 * corners - 1)

    return ShapeFunctions((), lambda xi: np.asarray(np.prod(factors(xi), axis=2)), derivatives, lumped_by_rows=True, one_point=True)


NO_EXTENT = Cell("vertex", "vertex", None, np.zeros((1, 0)), (), (), (0,))
SEGMENT = _simplex(1, "line", "VTK_LAGRANGE_CURVE", RefLine)
TRIANGLE = _simplex(2, "triangle", "VTK_LAGRANGE_TRIANGLE", RefTri)
TETRAHEDRON = _simplex(3, "tetra", "VTK_LAGRANGE_TETRAHEDRON", RefTet)
QUADRILATERAL = _box("quad", "VTK_LAGRANGE_QUADRILATERAL", RefQuad, (1, 0, 3, 2))
HEXAHEDRON = _box("hexahedron", "VTK_LAGRANGE_HEXAHEDRON", RefHex, (1, 0, 4, 5, 2, 3, 7, 6))


#: All elements by name.
ELEMENTS: dict[str, Element] = {
    element.name: element
    for element in (
        Element("segments", SEGMENT, _P1, "points", (1, 1, 2), "line", skfem.ElementLineP1, skfem.MeshLine1),
        Element("triangles", TRIANGLE, _P1, "segments", (1, 1, 2), "triangle", skfem.ElementTriP1, skfem.MeshTri1),
        Element("tetrahedra", TETRAHEDRON, _P1, "triangles", (1, 1, 2), "tetra", skfem.ElementTetP1, skfem.MeshTet1),
        Element("quadratic segments", SEGMENT, _P2, "points", (3, 4, 4), "line3", skfem.ElementLineP2),
        Element(
            "quadratic triangles", TRIANGLE, _P2, "quadratic segments", (2, 4, 4), "triangle6", skfem.ElementTriP2, skfem.MeshTri2
        ),
        Element(
            "quadratic tetrahedra",
            TETRAHEDRON,
            _P2,
            "quadratic triangles",
            (2, 5, 6),
            "tetra10",
            skfem.ElementTetP2,
            skfem.MeshTet2,
        ),
        Element("quadrilaterals", QUADRILATERAL, _Q1, "segments", (3, 5, 5), "quad", skfem.ElementQuad1, skfem.MeshQuad1),
        Element(
            "hexahedra",
            HEXAHEDRON,
            _Q1,
            "quadrilaterals",
            (3, 5, 5),
            "hexahedron",
            skfem.ElementHex1,
            skfem.MeshHex1,
            in_cells=(0, 4, 3, 1, 7, 5, 2, 6),
        ),
    )
}
#: The ends of segments: no extension, one node.
POINT = Element("points", NO_EXTENT, _P1, "", (1, 1, 1), "vertex")


def named(name: str) -> Element:
    """Return the element of this name."""
    return POINT if name == "points" else ELEMENTS[name]


def linear_simplex(k: int) -> Element:
    """Return the linear simplex of dimension `k`."""
    return ELEMENTS[{1: "segments", 2: "triangles", 3: "tetrahedra"}[k]]
