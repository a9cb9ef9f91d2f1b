"""Kinds of elements as a user chooses them, with meshes of a square or cube and of a quarter of a ring or tube."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray

from skfem_stvk import ElementMesh
from skfem_stvk.arguments import Array

from ..statics.meshes import moved_box


class Family(NamedTuple):
    """Choice of elements.

    Attributes
    ----------
    degree
        Degree of simplices, 1 or 2.
    boxes
        Whether they are quadrilaterals or hexahedra.
    options
        Further options of `System`.
    orders
        Orders of convergence in L2 and in H1.
    """

    degree: int
    boxes: bool = False
    options: dict[str, Any] = {}  # noqa: RUF012
    orders: tuple[float, float] = (2.0, 1.0)

    def mesh(self, d: int, n: int, bent: bool = False, straight: bool = False) -> ElementMesh:
        """Return the unit square or cube in `n^d` cells, with inner vertices moved at random.

        The mesh has the boundary "loaded" at x = 1, and the node sets "inner" at x = 0 and "held" on all other faces. `bent` maps
        the mesh to a quarter of a ring or tube with x as radial coordinate. `straight` keeps the edges straight there.
        """
        mesh = _moved_boxes(d, n) if self.boxes else moved_box(d, n)
        mesh = mesh.with_boundaries({"loaded": lambda x: x[0] == 1})
        if self.degree == 2 and not straight:
            mesh = mesh.with_degree(2)
        inner = mesh.p[0] == 0
        held = ((mesh.p == 0) | (mesh.p == 1))[1:].any(axis=0) & ~inner
        sets = {"inner": numbers_of(inner), "held": numbers_of(held)}
        mesh = replace(mesh, p=ring(mesh.p) if bent else mesh.p, node_sets=sets)
        return mesh.with_degree(self.degree) if self.degree == 2 else mesh


P1, P2 = Family(1), Family(2, orders=(3.0, 2.0))
EXACT = P2._replace(options={"quadrature": "exact"})
BOXES = Family(1, boxes=True)
ONE_POINT = BOXES._replace(options={"quadrature": "one-point", "hourglass": 0.05})


def numbers_of(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the indices at which a mask is true."""
    return np.flatnonzero(mask).astype(np.int32)


def ring(x: Array) -> Array:
    """Map the unit square or cube to a quarter of a ring or tube of radii 1 and 2: x is the radial coordinate, y the angle."""
    radius, angle = 1 + x[0], np.pi / 2 * x[1]
    return np.stack([radius * np.sin(angle), radius * np.cos(angle), *x[2:]])


def onto(radius: float, x: Array) -> Array:
    """Project points (d, n) radially onto the ring of this radius."""
    return np.concatenate([radius * outwards(x)[:2], x[2:]])


def outwards(x: Array) -> Array:
    """Return the unit normals of the ring's outer side at points on it, (d, n)."""
    radial = np.concatenate([x[:2], np.zeros_like(x[2:])])
    return np.asarray(radial / np.linalg.norm(radial, axis=0))


def of_scikit_fem(mesh: ElementMesh, intorder: int) -> skfem.Basis:
    """Return scikit-fem's basis of the same elements with the same degrees of freedom."""
    kind, element = BASES[mesh.element.name]
    corners = kind.__name__[-1] == "2"
    return skfem.Basis(kind(mesh.p, mesh.corners if corners else mesh.t), skfem.ElementVector(element()), intorder=intorder)


BASES: dict[str, tuple[Any, Any]] = {
    "triangles": (skfem.MeshTri1, skfem.ElementTriP1),
    "tetrahedra": (skfem.MeshTet1, skfem.ElementTetP1),
    "quadratic triangles": (skfem.MeshTri2, skfem.ElementTriP2),
    "quadratic tetrahedra": (skfem.MeshTet2, skfem.ElementTetP2),
    "quadrilaterals": (skfem.MeshQuad1, skfem.ElementQuad1),
    "hexahedra": (skfem.MeshHex1, skfem.ElementHex1),
}


def _moved_boxes(d: int, n: int, amount: float = 0.2, seed: int = 1) -> ElementMesh:
    lines, rng = [np.linspace(0, 1, n + 1)] * d, np.random.default_rng(seed)
    mesh = {2: skfem.MeshQuad, 3: skfem.MeshHex}[d].init_tensor(*lines)
    inner = ((mesh.p > 0) & (mesh.p < 1)).all(axis=0)
    made = ElementMesh.of(mesh)
    return replace(made, p=mesh.p + amount / n * inner * rng.uniform(-1, 1, mesh.p.shape), boundaries={})
