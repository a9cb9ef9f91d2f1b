"""The simplices that a mesh of meshio's holds: their dimension, their groups, and warnings of what is left out."""

from __future__ import annotations

from typing import Any, NamedTuple

import meshio
import numpy as np
from numpy.typing import NDArray

from ..arguments import real_array
from ..errors import MeshError, name_ids, warn
from .formats import Damaged
from .formats.source import NODES
from .groups import KINDS, cell_groups, corners, count_cells, facet_groups, inner_nodes, node_groups, pick, simplex_dimension


class Content(NamedTuple):
    """What `ElementMesh` is made of."""

    p: NDArray[np.float64]
    t: NDArray[Any]
    subdomains: dict[str, NDArray[Any]]
    boundaries: dict[str, NDArray[Any]]
    node_sets: dict[str, NDArray[Any]]


def content_in_memory(raw: meshio.Mesh, name: str) -> Content:
    """The simplices of a mesh of meshio's, as `read_mesh` takes them from a file; `name` stands for it in messages."""
    try:
        check_cells(raw)
    except Damaged as error:
        raise MeshError(f"{name} is no whole mesh: {error}.") from error
    return content_of(raw, name)


def content_of(raw: meshio.Mesh, name: str) -> Content:
    """The simplices of what was read, whose cells have been checked; `name` stands for it in messages."""
    k = dimension(raw, name)
    warn_of_cells(raw, k)
    try:
        sets = cell_groups(raw, k)
        t, subdomains = corners(raw.cells, k), pick(sets, raw, k)
        if "gmsh:physical" in raw.cell_data:
            t, subdomains = merge_copies(t, subdomains)
        facets = facet_groups(raw, sets, k)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from error
    used, count = np.unique(t), len(raw.points)
    inner = inner_nodes(raw.cells)
    warn_of_vertices(count, k, used, inner)
    number = np.full(count, -1, dtype=np.int32)
    number[used] = np.arange(len(used))
    boundaries = {key: number[ids] for key, ids in facets_on(used, facets).items()}
    node_sets = {key: number[ids] for key, ids in nodes_on(used, inner, node_groups(raw, sets, k)).items()}
    p = np.asarray(raw.points, dtype=np.float64).T[:, used]
    return Content(flatten(p, k), number[t], subdomains, boundaries, node_sets)


def check_cells(mesh: meshio.Mesh) -> None:
    """Refuse cells that do not have the nodes of their type or name nodes that are not there, and ids that stand twice."""
    points = real_array(mesh.points)
    if points is None or points.ndim != 2:
        raise Damaged("its points are not rows of real numbers")
    if len(bad := np.flatnonzero(~np.isfinite(points).all(axis=1))):
        raise Damaged(f"it has {name_ids(bad, 'vertex')} with coordinates that are not finite")
    for block in mesh.cells:
        if not isinstance(block.data, np.ndarray) or not len(block):
            continue
        if block.data.dtype.kind not in "iu" or block.data.ndim != 2:
            raise Damaged(f"its {block.type} cells are not rows of vertex ids")
        if block.type in NODES and block.data.shape[1:] != (NODES[block.type],):
            raise Damaged(f"its {block.type} cells have {block.data.shape[1]} nodes")
        if len(bad := np.flatnonzero(((block.data < 0) | (block.data >= len(mesh.points))).any(axis=1))):
            raise Damaged(f"it has {name_ids(bad, f'{block.type} cell')} with vertex ids outside 0 ... {len(mesh.points) - 1}")
    for what, ids in (("node", getattr(mesh, "points_id", [])), ("element", np.concatenate([[], *getattr(mesh, "cells_id", [])]))):
        if len(np.unique(ids)) < len(ids):
            raise Damaged(f"ids of {what}s stand more than once")


def dimension(raw: meshio.Mesh, name: str) -> int:
    """The highest dimension of the cells, if there are simplices among those."""
    filled = [block for block in raw.cells if len(block)]
    if not filled:
        raise MeshError(f"{name} holds no cells. Is it cut off, or a cloud of points?")
    k = max(block.dim for block in filled)
    if k > 0 and any(simplex_dimension(block.type) == k for block in filled):
        return k
    raise MeshError(
        f"{name} holds no {KINDS.get(k, 'simplices')}; expected tetrahedra, triangles or segments, got {count_cells(filled)}. "
        "Hexahedra and quadrilaterals can be split: mesh.to_meshtet(), mesh.to_meshtri() in scikit-fem."
    )


def warn_of_cells(raw: meshio.Mesh, k: int) -> None:
    """Warn of cells that carry volume but are no simplices, and of simplices with more than their corners."""
    carriers = [block for block in raw.cells if len(block) and block.dim == k]
    if others := [block for block in carriers if simplex_dimension(block.type) != k]:
        warn(f"{count_cells(others)} are left out: only {KINDS[k]} are used. Split them if the body goes on there.")
    higher = [block for block in carriers if simplex_dimension(block.type) == k and block.data.shape[1] > k + 1]
    if higher:
        cells = count_cells(higher)
        warn(f"{cells} are of higher order: their corner vertices are used and their curved edges are taken as straight.")


def warn_of_vertices(count: int, k: int, used: NDArray[Any], inner: NDArray[Any]) -> None:
    """Warn of vertices, of which there are `count`, that no element and no element of higher order has."""
    if len(unused := np.setdiff1d(np.arange(count), np.union1d(used, inner))):
        warn(
            f"{name_ids(unused, 'vertex')}: on none of the {KINDS[k]}, so dropped; the later ones move up. Centres of arcs, or "
            "cells that are left out?"
        )


def merge_copies(t: NDArray[Any], subdomains: dict[str, NDArray[Any]]) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
    """Merge elements that Gmsh 2.2 writes once for each of their groups; copies within one are left for `check_mesh` to name."""
    order = np.lexsort(t)
    starts = np.append(True, (t[:, order[1:]] != t[:, order[:-1]]).any(axis=0))
    first = np.empty_like(order)
    first[order] = order[starts][np.cumsum(starts) - 1]
    kept, number = np.unique(first, return_inverse=True)
    merged = {name: np.unique(number[ids]).astype(np.int32) for name, ids in subdomains.items()}
    grouped = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *subdomains.values()]))
    if grouped.size < t.shape[1] or any(len(merged[name]) < len(ids) for name, ids in subdomains.items()):
        return t, subdomains
    return t[:, kept], merged


def facets_on(used: NDArray[Any], boundaries: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The facets whose vertices are all used, with a warning of the others."""
    kept = {}
    for name, facets in boundaries.items():
        good = np.isin(facets, used).all(axis=0)
        if len(bad := np.flatnonzero(~good)):
            warn(f"Boundary {name!r}: {name_ids(bad, 'facet')} of {facets.shape[1]} are left out: they have dropped vertices.")
        if good.any():
            kept[name] = facets[:, good]
    return kept


def nodes_on(used: NDArray[Any], inner: NDArray[Any], sets: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The nodes that are used, with a warning of others that are not inside elements of higher order; no empty sets."""
    kept = {}
    for name, nodes in sets.items():
        kept[name] = np.intersect1d(nodes, used)
        if len(lost := np.setdiff1d(nodes, np.union1d(used, inner))):
            warn(f"Node set {name!r}: {name_ids(lost, 'vertex')} of {len(nodes)} are left out: dropped, since on no element.")
    return {name: nodes for name, nodes in kept.items() if len(nodes)}


def flatten(p: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """The coordinates without the last ones that are the same everywhere, as far as the simplices allow.

    >>> flatten(np.array([[0.0, 1, 0], [0, 0, 1], [5, 5, 5]]), k=2)
    array([[0., 1., 0.],
           [0., 0., 1.]])
    """
    d = len(p)
    while d > k and (p[d - 1] == p[d - 1, 0]).all():
        d -= 1
    return p[:d]
