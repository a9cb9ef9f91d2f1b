"""Surfaces of bodies that may touch something, and the stiffness of the elements behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, shown
from ...errors import ContactError, RegionError, name_ids, name_known
from ...mesh.element import Element
from ...mesh.facets import Cells, facets_of, find_facets, outer_facets
from ...mesh.locations import Where, describe, facets_at
from ..body import Body
from ..connectivity import simplices_of

#: Triangles of facets in space, and segments of those in the plane, by the number of their nodes: corners, then midpoints of edges.
PIECES: dict[int, dict[int, list[tuple[int, ...]]]] = {
    3: {3: [(0, 1, 2)], 4: [(0, 1, 2), (0, 2, 3)], 6: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]},
    2: {2: [(0, 1)], 3: [(0, 2), (2, 1)]},
}


def pieces_of(facets: NDArray[np.int32], d: int) -> NDArray[np.int32]:
    """Return the vertices (m, d) of the triangles, or in the plane of the segments, that represent facets (nodes, n)."""
    return np.concatenate([facets[list(corners)].T for corners in PIECES[d][len(facets)]])


def surface_at(body: Body, where: Where | None, label: str, simplices: Any = None) -> tuple[NDArray[np.int32], Element]:
    """Return the facets (m, n) at a location, or all of the surface, and their kind; for surfaces in space, their elements.

    A location is as in `Traction`, or the name of a subdomain of solids, which means the part of the surface that belongs to it.
    `simplices` are those of a surface in space on nodes of the mesh. `label` begins messages.

    Raises
    ------
    ContactError
        if the body has no surface.
    RegionError
        if there is no facet.
    """
    mesh: Any = body.mesh
    if simplices is not None:
        t, element = simplices_of(simplices, mesh.p, mesh.element.degree, mesh, f"{label}: simplices")
        mesh = mesh.beside(t, element)
    if mesh.k == 1 < mesh.d:
        raise ContactError(f"{label}: the mesh has {mesh.kind}, which have no surface; expected solids or membranes.")
    if mesh.k == mesh.d:
        marked = {*mesh.boundaries, *mesh.node_sets}
        if isinstance(where, str) and where not in marked:
            if where not in mesh.subdomains:
                raise RegionError(
                    f"{label}: the mesh has no boundary, node set or subdomain {shown(where)}; "
                    f"{name_known(where, {*marked, *mesh.subdomains})}"
                )
            return mesh.surface[:, np.isin(elements_behind(body, None, mesh.surface), mesh.elements(where))], body.facet
        return (mesh.surface if where is None else facets_at(mesh, where, f"{label} on {describe(where)}")), body.facet
    if callable(where):
        raise ContactError(
            f"{label}: {mesh.element.name} in space are the surface themselves; expected the name of a subdomain, element ids or a "
            "mask, or None."
        )
    return mesh.t[:, mesh.elements(where)], mesh.element


def elements_behind(body: Body, where: Any, facets: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the element (n,) behind each of the facets (m, n) of `surface_at(body, where)`."""
    mesh = body.mesh
    if mesh.k < mesh.d:
        return mesh.elements(where)
    every, t2f = facets_of(mesh.t, mesh.nv, mesh.element)
    owner = np.empty(every.shape[1], dtype=np.int64)
    owner[t2f.ravel()] = np.tile(np.arange(mesh.nt), len(t2f))
    return owner[find_facets(facets, every, mesh.nv)]


def remaining_surface(
    body: Body, where: Any, facets: NDArray[np.int32], behind: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the facets (m, n) of `surface_at(body, where)` after removals, with the element behind each.

    The whole surface, and that of a subdomain, contain the faces that removed elements leave; a boundary does not.
    """
    mesh, kept = body.mesh, np.flatnonzero(~body.removed)
    region = isinstance(where, str) and where not in {*mesh.boundaries, *mesh.node_sets}
    if len(kept) == mesh.nt or mesh.k < mesh.d or not (where is None or region):
        there = ~body.removed[behind]
        return facets[:, there], behind[there]
    facets, local = outer_facets(Cells(mesh.p, mesh.t[:, kept], mesh.element))
    there = np.isin(kept[local], mesh.elements(where))
    return facets[:, there], kept[local[there]]


def young_of(body: Body, elements: NDArray[np.int64], label: str, expected: str) -> Array:
    """Return Young's modulus (n,) [Pa] of elements, from all terms on each; raise ContactError with what is expected without it."""
    E = body.young[elements]
    if np.isnan(E).any():
        raise ContactError(
            f"{label}: {name_ids(np.unique(elements[np.isnan(E)]), 'element')} without Young's modulus, from which the default "
            f"stiffness is; expected {expected}."
        )
    return E
