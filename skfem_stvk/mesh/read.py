"""Mesh files of all formats that meshio reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, name_ids, warn
from .cells import corners, count_cells, inner_nodes, simplex_dimension
from .files import check_cells, load
from .formats import Damaged
from .groups import cell_groups, facet_groups, node_groups, pick
from .simplices import KINDS, SimplexMesh


def read_mesh(path: str | Path) -> SimplexMesh:
    """The simplices of a mesh file: Gmsh, VTK, VTU, Abaqus and whatever else meshio reads.

    Taken are the simplices of the highest dimension in the file, by their corners, with the vertices in the order of the
    file. Triangles are in 2D if all their z are equal, otherwise membranes in 3D; segments likewise in 1D, 2D or 3D.

    Physical groups, element sets and the subdomains of scikit-fem's `mesh.save` become `subdomains`, or `boundaries`
    where they hold facets. Node sets and physical points (and curves between tetrahedra) become
    `node_sets`. If the simplices are in no such group, arrays of integers with at most 64 values become
    subdomains 'NAME:VALUE'. Elements that Gmsh writes once for each of several groups are taken once.

    Raises
    ------
    MeshError
        if the file is missing, empty, of an unknown format or damaged, needs a package that is not installed, or has no
        simplices of the dimension of its cells.

    Warns
    -----
    StvkWarning
        of cells and vertices that are left out, and of elements of higher order.

    >>> from importlib.resources import files
    >>> sorted(read_mesh(str(files("skfem_stvk.mesh") / "data" / "bracket.msh")).subdomains)
    ['bracket', 'bushing']
    """
    path = Path(path)
    return simplices_of(load(path), str(path))


def simplices_in_memory(raw: meshio.Mesh) -> SimplexMesh:
    """The simplices of a mesh of meshio's, as `read_mesh` takes them of a file."""
    try:
        check_cells(raw)
    except Damaged as error:
        raise MeshError(f"The meshio.Mesh is no whole mesh: {error}.") from error
    return simplices_of(raw, "The meshio.Mesh")


def simplices_of(raw: meshio.Mesh, name: str) -> SimplexMesh:
    """The simplices of what was read, or of a mesh of meshio's that was made in memory; `name` stands for it in messages."""
    k = dimension(raw, name)
    warn_of_cells(raw, k)
    try:
        sets = cell_groups(raw, k)
        t, subdomains = corners(raw.cells, k), pick(sets, raw, k)
        if "gmsh:physical" in raw.cell_data:
            t, subdomains = merge_copies(t, subdomains)
        facets = facet_groups(raw, sets, k)
        whole = SimplexMesh(raw.points.T, t)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from error
    used = np.unique(whole.t)
    inner = inner_nodes(raw.cells)
    warn_of_vertices(whole, used, inner)
    number = np.full(whole.nv, -1, dtype=np.int32)
    number[used] = np.arange(len(used))
    boundaries = {key: number[ids] for key, ids in facets_on(used, facets).items()}
    node_sets = {key: number[ids] for key, ids in nodes_on(used, inner, node_groups(raw, sets, k)).items()}
    return SimplexMesh(flatten(whole.p[:, used], k), number[whole.t], subdomains, boundaries, node_sets)


def dimension(raw: meshio.Mesh, name: str) -> int:
    """The highest dimension of the cells, if there are simplices among those."""
    filled = [block for block in raw.cells if len(block)]
    if not filled:
        raise MeshError(f"{name} holds no cells. Is it cut off, or a cloud of points?")
    k = max(block.dim for block in filled)
    if k > 0 and any(simplex_dimension(block.type) == k for block in filled):
        return k
    raise MeshError(
        f"{name} holds no {KINDS.get(k, 'simplices')}: {count_cells(filled)} came; expected tetrahedra, triangles or segments. "
        "Hexahedra and quadrilaterals can be split: mesh.to_meshtet(), mesh.to_meshtri() in scikit-fem."
    )


def warn_of_cells(raw: meshio.Mesh, k: int) -> None:
    """Warn of cells that carry volume but are no simplices, and of simplices with more than their corners."""
    carriers = [block for block in raw.cells if len(block) and block.dim == k]
    others = [block for block in carriers if simplex_dimension(block.type) != k]
    if others:
        warn(f"{count_cells(others)} are left out: only {KINDS[k]} are used. Split them if the body goes on there.")
    higher = [block for block in carriers if simplex_dimension(block.type) == k and block.data.shape[1] > k + 1]
    if higher:
        warn(
            f"{count_cells(higher)} are of higher order: their corner vertices are used and their curved edges are taken as straight."
        )


def warn_of_vertices(mesh: SimplexMesh, used: NDArray[Any], inner: NDArray[Any]) -> None:
    """Warn of vertices that no element and no element of higher order has."""
    unused = np.setdiff1d(np.arange(mesh.nv), np.union1d(used, inner))
    if len(unused):
        warn(
            f"{name_ids(unused, 'vertex')}: on none of the {KINDS[mesh.k]}, so dropped; the later ones move up. Centres of arcs, or "
            "cells that are left out?"
        )


def merge_copies(t: NDArray[Any], subdomains: dict[str, NDArray[Any]]) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
    """Take once the elements that stand in the file once for each of their groups, as Gmsh 2.2 writes them.

    Copies within one group are left for `check_mesh` to name.
    """
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
        bad = np.flatnonzero(~good)
        if len(bad):
            warn(f"Boundary {name!r}: {name_ids(bad, 'facet')} of {facets.shape[1]} are left out: they have dropped vertices.")
        if good.any():
            kept[name] = facets[:, good]
    return kept


def nodes_on(used: NDArray[Any], inner: NDArray[Any], sets: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The nodes that are used, with a warning of others that are not inside elements of higher order; no empty sets."""
    kept = {}
    for name, nodes in sets.items():
        kept[name] = np.intersect1d(nodes, used)
        lost = np.setdiff1d(nodes, np.union1d(used, inner))
        if len(lost):
            warn(f"Node set {name!r}: {name_ids(lost, 'vertex')} of {len(nodes)} are left out: dropped, since on no element.")
    return {name: nodes for name, nodes in kept.items() if len(nodes)}


def flatten(p: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Without the last coordinates that are the same everywhere, as far as the simplices allow.

    >>> flatten(np.array([[0.0, 1, 0], [0, 0, 1], [5, 5, 5]]), k=2)
    array([[0., 1., 0.],
           [0., 0., 1.]])
    """
    d = len(p)
    while d > k and (p[d - 1] == p[d - 1, 0]).all():
        d -= 1
    return p[:d]
