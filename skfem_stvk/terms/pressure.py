"""Pressure on the deformed surface, which turns and grows with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LoadError, name_ids
from ..mesh import SimplexMesh
from ..mesh.facets import find_facets, turned_alike
from ..mesh.places import Where, describe, facets_at, in_order
from .body import Body
from .follower import FollowerPressure
from .load import Load, Value
from .spread import Spread


@dataclass(frozen=True, eq=False)
class Pressure(Load):
    """Follower pressure: `f_a = - integral of N_a p n da` over the deformed surface, `n` its outward normal. It has no potential.

    On tetrahedra it acts on boundary facets; on triangles in the plane on boundary edges, times thickness. Triangles in space are the
    surface themselves: it pushes against their normal by the right-hand rule round their vertices; neighbours that are turned the other way
    count as turned like the first triangle of their connected piece.

    Parameters
    ----------
    where : as of `Traction`; for triangles in space the name of a subdomain, element ids or a mask, or None for all.
    pressure : `p` per deformed area [N/m^2], positive pushes inwards: a number, or (n,) values at the vertices, in the order of vertex ids as
        given, otherwise ascending; these ramp with the load factor. Or a function of t or of (x, t), taken as it is, `x` reference coordinates.
        Interpolated linearly between vertices.

    Raises
    ------
    RegionError
        when it is bound, if there is no facet or element.
    LoadError
        when it is bound: if `pressure` is not finite or no number; for segments, which have no surface; if facets are not on the boundary,
        so that both sides are inside; if triangles in space have no two sides, as on a Moebius strip.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), Pressure(lambda x: x[0] == 1, 2e6)])
    >>> stretched = np.array([0, 0.5, 0]) * cube.mesh.p.T
    >>> cube.external_force(stretched.ravel()).reshape(-1, 3).sum(axis=0)
    array([-3000000.,        0.,        0.])
    """

    where: Where | None
    pressure: Any

    def bind(self, body: Body) -> FollowerPressure:
        mesh = body.mesh
        if mesh.k == 1:
            raise LoadError(f"Pressure: the mesh has {mesh.kind}, which have no surface. Use Traction or NodalLoad.")
        if mesh.k < mesh.d:
            what = "Pressure" if self.where is None else f"Pressure on {describe(self.where)}"
            surface, vertices = _membrane(mesh, self.where, what), None
        else:
            what = f"Pressure on {describe(self.where)}"
            surface = _outwards(mesh, self.where, what)
            vertices = in_order(mesh, self.where, surface)
        thickness = body.facet_sections(surface) if mesh.d == 2 else np.ones(surface.shape[1])
        spread = Spread(mesh, surface, thickness, vertices)
        return FollowerPressure(mesh, surface, spread, Value(self.pressure, (), spread.x, what, name="pressure"))


def _outwards(mesh: SimplexMesh, where: Any, what: str) -> NDArray[np.int32]:
    """(k, n) the boundary facets there, turned outwards."""
    found = find_facets(facets_at(mesh, where, what), mesh.surface, mesh.nv)
    bad = np.flatnonzero(found < 0)
    if len(bad):
        raise LoadError(
            f"{what}: {name_ids(bad, 'facet')} of {len(found)} are not on the boundary, so it is ambiguous which side it pushes on. Name "
            "facets of the outer surface only; dead forces on inner facets are a Traction."
        )
    return mesh.surface[:, found]


def _membrane(mesh: SimplexMesh, where: Any, what: str) -> NDArray[np.int32]:
    """(3, n) triangles in space, all turned alike."""
    if callable(where):
        raise LoadError(
            f"{what}: triangles in space are the surface themselves; expected the name of a subdomain, element ids or a mask, or None."
        )
    ids = mesh.elements(where)
    t = mesh.t[:, ids]
    turned, two_sided = turned_alike(t, mesh.nv)
    if not two_sided.all():
        raise LoadError(
            f"{what}: {name_ids(ids[~two_sided], 'element')} are a surface without two sides, like a Moebius strip, so pressure has no "
            "direction there. Leave some of them out."
        )
    t[:2, turned] = t[1::-1, turned]
    return t
