"""Pressure on the deformed surface, which rotates and grows with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, Quantity
from ...edges import NodeBlocks
from ...errors import LoadError, name_ids
from ...kernels.simplex_topology import edges_of_simplices
from ...mesh import ElementMesh
from ...mesh.facets import faces_to_reverse, find_facets
from ...mesh.locations import Where, describe, facets_at, in_value_order
from ...mesh.points import base_vectors_at, normals_of, rule_of
from ..body import Body
from ..connectivity import simplices_of
from .load import BoundLoad, Load, Time, Value
from .spread import Spread

#: Row and column of each component of an axial vector in the matrix of a cross product; the transposed entry is its negative.
AXIAL = {2: ((1, 0),), 3: ((2, 1), (0, 2), (1, 0))}


@dataclass(frozen=True, eq=False)
class Pressure(Load):
    """Follower pressure: `f_a = - integral of N_a p n da` over the deformed surface, `n` its outward normal. It has no potential.

    On solids the pressure acts on boundary facets; on triangles and quadrilaterals in the plane on boundary edges, times thickness.
    In space it acts on surface elements, against their normal by the right-hand rule around their corners. Neighbours of opposite
    orientation count as oriented like the first element of their connected piece.

    Parameters
    ----------
    where
        Location as in `Traction`; for surfaces in space the name of a subdomain, element ids or a mask, or None for all.
    pressure
        Force `p` per deformed area [N/m^2], positive pushes inwards: a number, or (n,) values at the nodes, in the order of
        user-supplied node ids, otherwise ascending; these ramp with the load factor. Or a function of t or of (x, t), used without
        a ramp, `x` reference coordinates. Interpolated between nodes by their shape functions.
    simplices
        Surface in space outside the mesh, such as a membrane on tetrahedra: (3, n) nodes of its triangles, or the name of a
        boundary. Then `where` is ids of these triangles, or None for all.

    Raises
    ------
    MeshError
        when it is bound, if `simplices` are not elements of a surface on these nodes.
    RegionError
        when it is bound, if there is no facet or element.
    LoadError
        if `pressure` is not finite or not a number; when it is bound: for segments, which have no surface; if facets are not on
        the boundary, so that both sides are inside; if a surface in space has only one side, such as a Moebius strip.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), Pressure(lambda x: x[0] == 1, 2e6)])
    >>> stretched = np.array([0, 0.5, 0]) * cube.mesh.p.T
    >>> cube.external_force(stretched.ravel()).reshape(-1, 3).sum(axis=0)
    array([-3000000.,        0.,        0.])
    """

    given_by, on_elements, per_element = "pressure", True, True

    where: Annotated[Where | None, Quantity(None, "Place of the boundary facets; of surfaces in space a subdomain, or all.")]
    pressure: Annotated[Any, Quantity("stress", "Force per deformed area, positive inwards.")]
    simplices: Annotated[Any, Quantity(None, "A loaded surface in space, on nodes of the mesh: the simplices of its law.")] = None

    def bind(self, body: Body) -> FollowerPressure:
        mesh, removed = body.mesh, body.removed
        if self.simplices is not None:
            t, element = simplices_of(self.simplices, mesh.p, mesh.element.degree, mesh, "Pressure: simplices")
            mesh, removed = mesh.beside(t, element), np.zeros(t.shape[1], dtype=bool)
        if mesh.k == 1:
            raise LoadError(f"Pressure: the mesh has {mesh.kind}, which have no surface. Use Traction or NodalLoad.")
        if mesh.k < mesh.d:
            what = "Pressure" if self.where is None else f"Pressure on {describe(self.where)}"
            surface, ids = _membrane(mesh, self.where, what)
            sizes, vertices, element = np.where(removed[ids], 0.0, 1.0), None, mesh.element
        else:
            what = f"Pressure on {describe(self.where)}"
            surface, element = _outwards(mesh, self.where, what), body.facet
            vertices, sizes = in_value_order(mesh, self.where, surface), body.facet_sections(surface)  # 1 of solids
        spread = Spread(mesh, element, surface, sizes, vertices)
        return FollowerPressure(mesh, surface, spread, self.value(mesh, spread.x, what, ()))


class FollowerPressure(BoundLoad):
    """Pressure on facets that move with their nodes, at the points of a rule, with base vectors `x_i = sum_a dN_a/dxi_i x_a`.

        f_a = - sum_q w_aq A_q(x),     w_aq = weight_q N_a(q) p(q)
        A = x_1 x x_2                              surfaces in space
        A = h (y_1, -x_1)                          edges in the plane, of thickness h at rest

    In space the force is quadratic in the displacements, in the plane linear. Its stiffness `-df_a/du_b = sum_q w_aq dA_q/du_b` is
    a cross product with `dN_b/dxi_1 x_2 - dN_b/dxi_2 x_1`. The stiffness is not symmetric, unless the surface is closed. With a
    constant pressure the rules are exact, for curved facets too. Linear simplices need one point.

    Nodes of the facets `surface` (m, n) are counterclockwise when seen from the side of the pressure. In the plane the body is on
    their left. The `spread` has the same facets, with thickness as their sizes.
    """

    has_potential = dead = symmetric = balanced = False

    def __init__(self, mesh: ElementMesh, surface: NDArray[np.int32], spread: Spread, value: Value) -> None:
        element = spread.element
        self._surface, self._spread, self._value = surface, spread, value
        self.steady = value.constant is not None
        self._rule = rule_of(element, "usual" if element.is_linear_simplex else "mass")
        self._slopes = element.derivatives(self._rule.points)
        self._rest = self._base_vectors(mesh.p.T)
        pairs = np.array(element.pairs)
        self.nodes_paired, sides = edges_of_simplices(np.ascontiguousarray(surface), pairs, mesh.nv)
        self.nodes = spread.vertices
        m, ne = len(surface), self.nodes_paired.shape[1]
        self._block = np.empty((m, m, surface.shape[1]), dtype=np.int64)
        self._block[range(m), range(m)] = 2 * ne + spread.nodes
        for side, (i, j) in zip(sides, pairs, strict=True):
            turned = surface[i] > surface[j]
            self._block[i, j], self._block[j, i] = side + ne * turned, side + ne * ~turned

    def potential(self, u: Array, t: Time) -> float:
        """Refuse, since follower pressure has no potential."""
        raise LoadError("Follower pressure has no potential: its work depends on the path.")

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        areas, weights = normals_of((self._rest + self._base_vectors(u)).transpose(3, 2, 1, 0)), self._weights(t)
        sums = [self._spread.add(np.einsum("aqn,qn->an", weights, area)) for area in areas.transpose(2, 1, 0)]
        out[self._spread.vertices] -= np.stack(sums, axis=1)

    def add_blocks(self, u: Array, t: Time, blocks: NodeBlocks) -> None:
        assert blocks.reverse is not None and blocks.own is not None
        weights, every = self._weights(t), (blocks.pairs, blocks.reverse, blocks.own)
        base_vectors, counts = self._rest + self._base_vectors(u), [len(part) for part in every]
        for axis, (row, column) in enumerate(AXIAL[u.shape[1]]):
            values = np.einsum("aqn,qbn->abn", weights, _axial(self._slopes, base_vectors, axis))
            sums = np.bincount(self._block.ravel(), weights=values.ravel(), minlength=sum(counts))
            for part, own in zip(every, np.split(sums, np.cumsum(counts[:-1])), strict=True):
                part[:, row, column] += own
                part[:, column, row] -= own

    def memory(self) -> dict[str, int]:
        arrays = self._surface, self._rest, self.nodes_paired, self._block
        return {"loads": sum(array.nbytes for array in arrays) + self._spread.memory()}

    def _weights(self, t: Time) -> NDArray[np.float64]:
        """Return the weights (m, nq, n) times `N_a p` at each point, times thickness."""
        spread, values, weights = self._spread, self._value.at(t)[None], self._rule.weights
        if spread.element.is_linear_simplex:
            return np.asarray(spread.shares(values)[0][:, None] * weights)
        N = spread.element.values(self._rule.points)
        return np.einsum("q,qa,qn->aqn", weights, N, spread.interpolated(values)[0] * spread.sizes)

    def _base_vectors(self, x: Array) -> Array:
        """Return the base vectors (d, k, nq, n) of the facets at the points, from `x` (nv, d)."""
        return base_vectors_at(x.T, self._surface, self._spread.element, self._rule.points).transpose(3, 2, 1, 0)


def _outwards(mesh: ElementMesh, where: Any, what: str) -> NDArray[np.int32]:
    """Return the boundary facets (k, n) at this location, oriented outwards."""
    found = find_facets(facets_at(mesh, where, what), mesh.surface, mesh.nv)
    bad = np.flatnonzero(found < 0)
    if len(bad):
        raise LoadError(
            f"{what}: {name_ids(bad, 'facet')} of {len(found)} are not on the boundary, so it is ambiguous which side it pushes "
            "on. Name facets of the outer surface only; dead forces on inner facets are a Traction."
        )
    return mesh.surface[:, found]


def _membrane(mesh: ElementMesh, where: Any, what: str) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return surface elements (m, n) in space, all with the same orientation, and their ids."""
    if callable(where):
        raise LoadError(
            f"{what}: {mesh.element.name} in space are the surface themselves; expected the name of a subdomain, element ids or a "
            "mask, or None."
        )
    if mesh.space.comm.divided:
        raise LoadError(
            f"{what}: the mesh of {mesh.kind} is divided among ranks, so the side of elements on other ranks is not known; "
            "expected a solid, whose outside is known, or one rank."
        )
    ids = mesh.elements(where)
    t = mesh.t[:, ids]
    reverse, two_sided = faces_to_reverse(mesh.corners[:, ids], mesh.nv)
    if not two_sided.all():
        raise LoadError(
            f"{what}: {name_ids(ids[~two_sided], 'element')} are a surface without two sides, like a Moebius strip, so pressure "
            "has no direction there. Leave some of them out."
        )
    t[:, reverse] = t[mesh.element.reversed][:, reverse]
    return t, ids


def _axial(slopes: Array, base_vectors: Array, axis: int) -> Array:
    """Return a component (nq, m, n) of the axial vectors `-dA/dx_b` of the area vectors, from `dN_b/dxi` (nq, m, k) and base
    vectors.
    """
    if len(base_vectors) == 2:
        return np.broadcast_to(-slopes, (*slopes.shape[:2], base_vectors.shape[3]))
    x, y = base_vectors[axis]
    return np.asarray(slopes[:, :, 1:] * x[:, None] - slopes[:, :, :1] * y[:, None])
