"""Elements among the cells of a file, and their named groups: physical groups, sets, indicator arrays, material numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import whole
from ..errors import MeshError, name_ids
from .element import ELEMENTS, POINT, Element, linear_simplex, named

if TYPE_CHECKING:
    import meshio

#: Ids within each cell block of the file, by name.
Sets = dict[str, list[NDArray[np.int64]]]
MOST_VALUES = 64
#: Cell array with the number of coordinates, where their values do not determine it: for a flat membrane in space.
DIMENSION = "stvk:dimension"
#: Beginning of the names of point arrays that mark the nodes of a set; the set's name follows.
NODE_SET = "stvk:n:"


def cell_groups(raw: meshio.Mesh, base: Element) -> Sets:
    """Return the named groups; if no element with the corners of `base` is in one, also one for each value of integer arrays."""
    sets = listed_sets(raw) | indicator_sets(raw)
    sets |= {name: ids for name, ids in physical_sets(raw).items() if name not in sets}
    return sets if groups_of_kind(sets, raw, base) else sets | value_sets(raw, base)


def groups_of_kind(sets: Sets, raw: meshio.Mesh, base: Element) -> dict[str, NDArray[np.int32]]:
    """Return the elements with the corners of `base` of each group, counted through their blocks; empty groups are left out."""
    found = {}
    for name, ids_of_block in sets.items():
        start, ids = 0, [np.empty(0, dtype=np.int64)]
        for block, members in zip(raw.cells, ids_of_block, strict=False):
            if is_of(block, base):
                ids.append(np.asarray(members, dtype=np.int64) + start)
                start += len(block)
        found[name] = np.unique(np.concatenate(ids)).astype(np.int32)
    return {name: ids for name, ids in found.items() if len(ids)}


def listed_sets(raw: meshio.Mesh) -> Sets:
    """Return the cell sets of meshio, without Gmsh's own such as the phantom 'gmsh:bounding_entities'."""
    empty = np.empty(0, dtype=np.int64)
    return {
        name: [empty if ids is None else ids for ids in ids_of_block]
        for name, ids_of_block in raw.cell_sets.items()
        if not name.startswith("gmsh:")
    }


def indicator_sets(raw: meshio.Mesh) -> Sets:
    """Return subdomains that scikit-fem's `mesh.save` wrote: arrays 'skfem:s:NAME' that are 1 inside."""
    prefix = "skfem:s:"
    return {
        name.removeprefix(prefix): [np.flatnonzero(marks(name, values, 1, "0 or 1")) for values in arrays]
        for name, arrays in raw.cell_data.items()
        if name.startswith(prefix)
    }


def marks(name: str, values: NDArray[Any], most: int, expected: str) -> NDArray[np.int64]:
    """Return whole numbers, one for each cell, from 0 to `most`."""
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        raise MeshError(f"The array {name!r} has the shape {values.shape}; expected {expected} for each element.")
    if len(bad := np.flatnonzero(~((values >= 0) & (values <= most) & (values == np.floor(values))))):
        raise MeshError(f"The array {name!r} holds something else for {name_ids(bad, 'element')}; expected {expected}.")
    return values.astype(np.int64)


def physical_sets(raw: meshio.Mesh) -> Sets:
    """Return Gmsh's physical groups by tag; a tag without a name is its own name."""
    names = {(int(v[1]), int(v[0])): name for name, v in raw.field_data.items() if np.shape(v) == (2,)}
    sets: Sets = {}
    for i, tags in enumerate(raw.cell_data.get("gmsh:physical", [])):
        for tag in np.unique(tags[tags != 0]).tolist():
            name = names.get((raw.cells[i].dim, tag), str(tag))
            sets.setdefault(name, [np.empty(0, dtype=np.int64)] * len(raw.cells))[i] = np.flatnonzero(tags == tag)
    return sets


def value_sets(raw: meshio.Mesh, base: Element) -> Sets:
    """Return groups 'NAME:VALUE' for integer arrays with few values on elements that have the corners of `base`."""
    sets: Sets = {}
    for name, arrays in raw.cell_data.items():
        if name.startswith(("gmsh:", "skfem:", "stvk:", "vtk", "cell_ids")) or any(
            values.ndim != 1 or values.dtype.kind not in "iu" for values in arrays
        ):
            continue
        found = np.unique(np.concatenate([values for values, block in zip(arrays, raw.cells, strict=True) if is_of(block, base)]))
        if len(found) <= MOST_VALUES:
            present = np.unique(np.concatenate(arrays)).tolist()
            sets |= {f"{name}:{value}": [np.flatnonzero(values == value) for values in arrays] for value in present}
    return sets


def facet_groups(raw: meshio.Mesh, sets: Sets, base: Element) -> dict[str, NDArray[np.int64]]:
    """Return facet corners (m, n) of each group: cells one dimension lower, and scikit-fem's arrays 'skfem:b:NAME'.

    Bit `j` of such an array says that facet `j` of the cell, in scikit-fem's order, is in the boundary.
    """
    facet = named(base.facet)
    facets, t = corners(raw.cells, facet), corners(raw.cells, base)
    boundaries = {name: facets[:, ids] for name, ids in groups_of_kind(sets, raw, facet).items()}
    prefix = "skfem:b:"
    for name, arrays in raw.cell_data.items():
        if name.startswith(prefix):
            most = 2 ** len(base.facets) - 1
            of_block = [values for values, block in zip(arrays, raw.cells, strict=True) if is_of(block, base)]
            bits = marks(name, np.concatenate(of_block), most, f"whole numbers from 0 to {most}")
            found = [t[list(local)][:, bits >> j & 1 == 1] for j, local in enumerate(base.facets)]
            boundaries[name.removeprefix(prefix)] = np.concatenate(found, axis=1)
    return boundaries


def line_groups(raw: meshio.Mesh, sets: Sets, base: Element) -> dict[str, NDArray[np.int64]]:
    """Return segment ends (2, n) of each group in a file of solids, such as cables; on surfaces segments are facets."""
    line = linear_simplex(1)
    segments = corners(raw.cells, line)
    return {name: segments[:, ids] for name, ids in groups_of_kind(sets, raw, line).items()} if base.k == 3 else {}


def node_groups(raw: meshio.Mesh, sets: Sets, base: Element) -> dict[str, NDArray[np.int64]]:
    """Return ascending nodes of each group: node sets, and groups of points, or of curves where facets are surfaces."""
    groups: dict[str, NDArray[np.int64]] = {}
    for kind in (named("points"), linear_simplex(1))[: max(base.k - 1, 1)]:
        blocks = [np.asarray(block.data, dtype=np.int64) for block in raw.cells if is_of(block, kind)]
        for name, ids in groups_of_kind(sets, raw, kind).items():
            ends = np.cumsum([len(block) for block in blocks])
            inside = [
                block[ids[(ids >= end - len(block)) & (ids < end)] - end + len(block)]
                for block, end in zip(blocks, ends, strict=True)
            ]
            groups[name] = np.union1d(groups.get(name, []), np.concatenate([rows.ravel() for rows in inside])).astype(np.int64)
    return groups | {name: np.union1d(groups.get(name, []), ids).astype(np.int64) for name, ids in raw.point_sets.items()}


#: Numbers of corners by the family of a cell in meshio's terms: of the elements, and of two unsupported kinds of cells.
CORNERS = {one.cell.family: one.corners for one in (POINT, *ELEMENTS.values())} | {"pyramid": 5, "wedge": 6}


def as_cells(t: NDArray[Any], element: Element) -> tuple[str, NDArray[Any]]:
    """Return elements `t` (n, nt) as meshio's cells: their type, and nodes (nt, n) in VTK's local order.

    >>> as_cells(np.arange(8)[:, None], named("hexahedra"))
    ('hexahedron', array([[0, 3, 6, 2, 1, 5, 7, 4]]))
    """
    return element.cell_type, t[np.argsort(element.in_cells or range(element.n))].T


def from_cells(kind: str, cells: NDArray[Any]) -> tuple[NDArray[Any], Element]:
    """Return the nodes (n, nt) and the element of cells (nt, n) of a type that `as_cells` gives.

    >>> t, element = from_cells("quad", np.array([[0, 1, 2, 3]]))
    >>> element.name
    'quadrilaterals'
    """
    element = {one.cell_type: one for one in ELEMENTS.values()}[kind]
    return _in_our_order(cells.T, element), element


def linear_kind(cell_type: str) -> str:
    """Return the name of the linear element with the corners of a cell type in meshio's terms; empty for other cells.

    >>> linear_kind("tetra10"), linear_kind("hexahedron"), linear_kind("wedge")
    ('tetrahedra', 'hexahedra', '')
    """
    family = cell_type.rstrip("0123456789")
    return next((one.linear.name for one in (*ELEMENTS.values(), POINT) if family in (one.cell.family, one.cell.lagrange)), "")


def family(block: Any) -> str:
    """Return the type of cells without the number of nodes.

    >>> from meshio import CellBlock
    >>> family(CellBlock("tetra10", [])), family(CellBlock("VTK_LAGRANGE_WEDGE", []))
    ('tetra', 'wedge')
    """
    words = str(block.type).rstrip("0123456789").removeprefix("VTK_LAGRANGE_").lower()
    return {"tetrahedron": "tetra", "quadrilateral": "quad"}.get(words, words)


def node_count(cell_type: str) -> int | None:
    """Return the number of nodes of a cell type in meshio's terms; None if it is unknown, or varies from cell to cell.

    >>> node_count("wedge"), node_count("pyramid"), node_count("tetra10"), node_count("polygon")
    (6, 5, 10, None)
    """
    shape = cell_type.rstrip("0123456789")
    return int(cell_type[len(shape) :] or CORNERS[shape]) if shape in CORNERS else None


def is_of(block: Any, base: Element) -> bool:
    """Return whether there are cells, and they have the corners of a linear element."""
    return len(block) > 0 and linear_kind(block.type) == base.name


def corners(cells: Iterable[Any], base: Element) -> NDArray[Any]:
    """Return corners (m, n) of the cells of the kind of `base`, in scikit-fem's local order, block after block."""
    return nodes(cells, base, base)


def nodes(cells: Iterable[Any], base: Element, element: Element) -> NDArray[Any]:
    """Return the nodes (m, n) of these cells for `element`, which is `base` or has further nodes after the same corners."""
    blocks = [np.asarray(block.data, dtype=np.int64)[:, : element.n] for block in cells if is_of(block, base)]
    return _in_our_order(np.concatenate([np.empty((0, element.n), dtype=np.int64), *blocks]).T, element)


def _in_our_order(t: NDArray[Any], element: Element) -> NDArray[Any]:
    """Return the nodes (n, nt) of cells in the element's own order."""
    return t[list(element.in_cells)] if element.in_cells else t


def inner_nodes(cells: Iterable[Any]) -> NDArray[np.int64]:
    """Return the nodes of elements of higher order that are not corners: on edges, faces or inside."""
    blocks = []
    for block in cells:
        if len(block) and family(block) in CORNERS:
            blocks.append(np.ravel(np.asarray(block.data)[:, CORNERS[family(block)] :]))
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *blocks])).astype(np.int64)


def count_cells(cells: Iterable[Any]) -> str:
    """Return the number of cells of each type, in words.

    >>> from meshio import CellBlock
    >>> count_cells([CellBlock("wedge", [[0] * 6]), CellBlock("quad", [[0] * 4] * 2), CellBlock("wedge", [[0] * 6])])
    '2 wedge and 2 quad cells'
    """
    counts: Counter[str] = Counter()
    for block in cells:
        counts[f"higher-order {family(block)}" if block.type.startswith("VTK_") else block.type] += len(block)
    *most, last = [f"{count} {cell_type}" for cell_type, count in counts.items()]
    return (", ".join(most) + " and " if most else "") + last + " cells"


def flatten(p: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Return the coordinates without the last ones that are the same everywhere, as far as the simplices allow.

    >>> flatten(np.array([[0.0, 1, 0], [0, 0, 1], [5, 5, 5]]), k=2)
    array([[0., 1., 0.],
           [0., 0., 1.]])
    """
    d = len(p)
    while d > k and (p[d - 1] == p[d - 1, 0]).all():
        d -= 1
    return p[:d]


def in_dimension(p: NDArray[np.float64], k: int, dimension: int | None) -> NDArray[np.float64]:
    """Return the coordinates in a space of this dimension; by default in the smallest one, see `flatten`.

    Raises
    ------
    MeshError
        if the dimension is too small for elements of dimension `k` with these coordinates.

    Examples
    --------
    >>> in_dimension(np.array([[0.0, 1, 0], [0, 0, 1]]), 2, 3)
    array([[0., 1., 0.],
           [0., 0., 1.],
           [0., 0., 0.]])
    """
    least = len(flatten(p, k))
    dimension = least if dimension is None else whole("dimension", dimension, "1, 2 or 3 coordinates", 1, 3, MeshError)
    if dimension < least:
        raise MeshError(f"dimension = {dimension}; expected at least {least}: coordinate {'xyz'[least - 1]} is needed.")
    return np.concatenate([p, np.zeros((3, p.shape[1]))])[:dimension] if dimension > len(p) else p[:dimension]
