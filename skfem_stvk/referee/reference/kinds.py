"""Kinds of elements by scikit-fem's own tables: meshes, shape functions, quadrature, and node numbers.

Quadrature rules are chosen independently here, by their order in scikit-fem, so that a wrong table of points or weights elsewhere
is detected.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import skfem
from numpy.typing import NDArray
from skfem.quadrature import get_quadrature

from ...arguments import Array
from ...errors import StvkError

#: Points (k, nq) on the reference element and weights (nq,), as `skfem.Basis(quadrature=...)` takes them.
Points: TypeAlias = tuple[Array, Array]
#: A rule by its name, "usual" or "exact", or by its points and weights.
RuleLike: TypeAlias = str | Points


class ElementKind(NamedTuple):
    """Kind of element of the reference, by scikit-fem's own tables.

    Attributes
    ----------
    k
        Dimension of the element.
    element
        Scalar element of scikit-fem.
    mesh
        Mesh class of scikit-fem for these elements, or for their corners.
    curved
        Mesh class of scikit-fem with curved edges, or None.
    orders
        Order of exactness of the usual and of the exact rule. Order 1 is the rule with the centre as its only point.
    """

    k: int
    element: Callable[[], Any]
    mesh: Any
    curved: Any
    orders: tuple[int, int]

    @property
    def nodes(self) -> Array:
        """Reference coordinates (n, k) of the nodes, in scikit-fem's local order."""
        return np.array(self.element().doflocs, dtype=float)

    @property
    def is_box(self) -> bool:
        """Whether the element is a quadrilateral or hexahedron."""
        return self.mesh in (skfem.MeshQuad1, skfem.MeshHex1)

    @property
    def corners(self) -> int:
        """Number of corners. The corners are the first nodes."""
        return 2**self.k if self.is_box else self.k + 1

    @property
    def is_linear_simplex(self) -> bool:
        """Whether the shape functions have constant gradients."""
        return not self.is_box and self.curved is None


KINDS = {
    "segments": ElementKind(1, skfem.ElementLineP1, skfem.MeshLine1, None, (1, 1)),
    "triangles": ElementKind(2, skfem.ElementTriP1, skfem.MeshTri1, None, (1, 1)),
    "tetrahedra": ElementKind(3, skfem.ElementTetP1, skfem.MeshTet1, None, (1, 1)),
    "quadratic segments": ElementKind(1, skfem.ElementLineP2, skfem.MeshLine1, skfem.MeshLine1, (3, 4)),
    "quadratic triangles": ElementKind(2, skfem.ElementTriP2, skfem.MeshTri1, skfem.MeshTri2, (2, 4)),
    "quadratic tetrahedra": ElementKind(3, skfem.ElementTetP2, skfem.MeshTet1, skfem.MeshTet2, (2, 5)),
    "quadrilaterals": ElementKind(2, skfem.ElementQuad1, skfem.MeshQuad1, skfem.MeshQuad1, (3, 5)),
    "hexahedra": ElementKind(3, skfem.ElementHex1, skfem.MeshHex1, skfem.MeshHex1, (3, 5)),
}
#: The linear simplex of each dimension.
LINEAR = {1: "segments", 2: "triangles", 3: "tetrahedra"}


def points_of(kind: str, rule: RuleLike = "usual") -> Points:
    """Return points (k, nq) and weights (nq,) of a rule of `skfem.quadrature`. For linear simplices the only point is the centre.

    Raises
    ------
    StvkError
        if the rule is unknown.

    Examples
    --------
    >>> [len(points_of(kind, "usual")[1]) for kind in ("tetrahedra", "quadratic tetrahedra", "hexahedra")]
    [1, 4, 8]
    """
    if not isinstance(rule, str):
        return rule
    if rule not in ("usual", "exact"):
        raise StvkError(f"rule = {rule!r}; expected 'usual' or 'exact', or points (k, nq) and weights (nq,).")
    of = KINDS[kind]
    order = of.orders[rule == "exact"]
    points, weights = get_quadrature(of.element().refdom, order)
    if order == 1:  # scikit-fem's rule of order 1 has three points in a triangle
        points, weights = points.mean(axis=1, keepdims=True), weights.sum(keepdims=True)
    return np.asarray(points), np.asarray(weights)


def derivatives(kind: str, rule: RuleLike = "usual") -> Array:
    """Return the derivatives (nq, n, k) of scikit-fem's shape functions at the points of a rule."""
    element, (xi, _) = KINDS[kind].element(), points_of(kind, rule)
    return np.stack([np.broadcast_to(element.lbasis(xi, a)[1], xi.shape).T for a in range(len(element.doflocs))], axis=1)


def numbered(mesh: Any, element: Any, t: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the node (N,) of each degree of freedom of a scalar element, for nodes `t` (n, nt) on the mesh of their corners.

    Raises
    ------
    StvkError
        if two elements share an edge but not its middle, or a middle but not the edge.
    """
    dofs = skfem.Dofs(mesh, element)
    own = np.asarray(dofs.element_dofs)
    node = np.full(dofs.N, -1, dtype=np.int64)
    node[own] = t
    if (node[own] != t).any() or len(np.unique(node)) < len(node):
        raise StvkError("Elements that share an edge do not share the node in its middle, or the other way round.")
    return node


def curved_elements(p: Array, t: NDArray[np.int32], kind: str) -> NDArray[np.bool_]:
    """Return which quadratic elements (nt,) have a curved edge.

    The middle of a curved edge is not half-way between its ends, to within 1e-14 of the coordinates.

    >>> p = np.array([[0, 1, 0, 0.5, 0.5, 0], [0, 0, 1, 0, 0.6, 0.5]])
    >>> curved_elements(p, np.arange(6)[:, None], "quadratic triangles")
    array([ True])
    """
    curved = np.zeros(t.shape[1], dtype=bool)
    rounding = 1e-14 * np.abs(p[:, t]).max(axis=(0, 1))
    for middle, (a, b) in middles(kind):
        off = np.abs(p[:, t[middle]] - (p[:, t[a]] + p[:, t[b]]) / 2).max(axis=0)
        curved |= off > rounding
    return curved


def middles(kind: str) -> list[tuple[int, tuple[int, int]]]:
    """Return the local numbers of the middles of edges, with the two corners of each edge.

    >>> middles("quadratic segments")
    [(2, (0, 1))]
    """
    of = KINDS[kind]
    if of.is_box or of.is_linear_simplex:
        return []
    corners, found = of.nodes[: of.corners], []
    for middle, at in enumerate(of.nodes[of.corners :], of.corners):
        pairs = combinations(range(of.corners), 2)
        found.append((middle, next((a, b) for a, b in pairs if np.array_equal(corners[a] + corners[b], 2 * at))))
    return found
