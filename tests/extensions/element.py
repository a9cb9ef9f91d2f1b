"""A toy element: the hexahedron with 27 nodes, quadratic along each axis, and its facets with 9 nodes."""

import numpy as np
import skfem

from skfem_stvk.mesh.element import ELEMENTS, HEXAHEDRON, QUADRILATERAL, Element, ShapeFunctions
from skfem_stvk.referee.reference.kinds import ElementKind


def lagrange(s):
    """Return the quadratic polynomials that are 1 at 0, 1/2 and 1, (3, ...), and their derivatives, (3, ...)."""
    values = np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)])
    return values, np.stack([4 * s - 3, 4 - 8 * s, 4 * s - 1])


def products(cell):
    """Return products of `lagrange` along the axes, with nodes at corners and the middles of edges, faces and the cell."""
    means = (*cell.edges, *(cell.facets if len(cell.facets[0]) > 2 else ()), tuple(range(len(cell.corners))))
    nodes = np.array([*cell.corners, *(cell.corners[list(ids)].mean(axis=0) for ids in means)])
    which, k = (2 * nodes).astype(int), nodes.shape[1]

    def along(xi):
        return [[of[which[:, i], :, i].T for of in lagrange(xi)] for i in range(k)]

    def values(xi):
        return np.prod([value for value, _ in along(xi)], axis=0)

    def derivatives(xi):
        every = along(xi)
        return np.stack([np.prod([every[j][i == j] for j in range(k)], axis=0) for i in range(k)], axis=2)

    return ShapeFunctions(means, values, derivatives, lumped_by_rows=True)


def in_cells():
    """Return the index of each node of the hexahedron in VTK's cell: corners, then middles of edges, of faces, of the cell."""
    corners = [(i,) for i in range(8)]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    faces = [(0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)]
    ours = np.argsort(ELEMENTS["hexahedra"].in_cells)  # the corners of VTK's cell, by scikit-fem's numbers
    cell = [frozenset(ours[list(ids)].tolist()) for ids in [*corners, *edges, *faces, range(8)]]
    return tuple(cell.index(frozenset(ids)) for ids in [*corners, *products(HEXAHEDRON).means])


QUAD9 = Element(
    "biquadratic quadrilaterals",
    QUADRILATERAL,
    products,
    "quadratic segments",
    (5, 9, 7),
    "quad9",
    skfem.ElementQuad2,
    skfem.MeshQuad2,
)
HEX27 = Element(
    "triquadratic hexahedra",
    HEXAHEDRON,
    products,
    QUAD9.name,
    (5, 9, 7),
    "hexahedron27",
    skfem.ElementHex2,
    skfem.MeshHex2,
    in_cells=in_cells(),
)
#: scikit-fem's element, independently of this package, for the referee.
KIND = ElementKind(3, skfem.ElementHex2, skfem.MeshHex1, skfem.MeshHex2, (5, 9))
