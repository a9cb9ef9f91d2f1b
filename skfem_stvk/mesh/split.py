"""Cells of several kinds, split into simplices: wedges, pyramids, degenerate hexahedra, and what is next to them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, name_ids, warn
from .groups import count_cells, family

Ids = NDArray[np.int64]
#: Faces of solids in VTK's order of nodes, seen from within; a surface element is its own face.
FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)),
}


def split_cells(raw: meshio.Mesh, name: str, split: bool) -> meshio.Mesh:
    """Return the mesh with simplices alone, with a note, if its elements are of several kinds or degenerate; else the mesh itself.

    Raises
    ------
    MeshError
        if `split` is false, or if a quadrilateral face is next to two triangles, which may have the other diagonal.
    """
    filled = [block for block in raw.cells if len(block)]
    solid = max((block.dim for block in filled), default=0) == 3
    boxes = {"hexahedron", "wedge", "pyramid"} if solid else {"quad"}
    found = [block for block in filled if family(block) in boxes]
    degenerate = sum(len(block) - distinct(corners(block)).sum() for block in found)
    kinds = {family(block) for block in filled if family(block) in boxes | ({"tetra"} if solid else {"triangle"})}
    if not found or (len(kinds) == 1 and not degenerate and kinds <= {"hexahedron", "quad"}):
        return raw
    what = count_cells(found) + (f" ({degenerate} with a repeated vertex)" if degenerate else "")
    into = "tetrahedra" if solid else "triangles"
    if not split:
        raise MeshError(
            f"{name} holds {what}; expected one kind of element in a body. Read it with split=True: it splits them into {into}."
        )
    if solid:
        refuse_unmatched(filled, name)
    blocks, origins = [], []
    for block in raw.cells:
        table = corners(block) if len(block) else np.empty((0, 0), dtype=np.int64)
        if len(block) and family(block) in boxes:
            cells, origin = tetrahedra(table, FACES[family(block)]) if solid else triangles(table)
            blocks.append(("tetra" if solid else "triangle", cells))
            refuse_folded(raw.points, cells, origin, block, name)
        elif len(block) and solid and family(block) == "quad":
            cells, origin = triangles(table)
            blocks.append(("triangle", cells))
        else:
            blocks.append((block.type, block.data))
            origin = np.arange(len(block))
        origins.append(origin)
    count = sum(len(cells) for (_, cells), block in zip(blocks, raw.cells, strict=True) if len(block) and family(block) in boxes)
    warn(f"{what} are split into {count} {into}, which are stiffer in bending. To refuse such files, read them with split=False.")
    return meshio.Mesh(
        raw.points,
        blocks,
        point_data=raw.point_data,
        cell_data={
            key: [np.asarray(x)[ids] for x, ids in zip(values, origins, strict=True)] for key, values in raw.cell_data.items()
        },
        field_data=raw.field_data,
        point_sets=raw.point_sets,
        cell_sets={
            key: [np.flatnonzero(np.isin(ids, [] if x is None else x)) for x, ids in zip(sets, origins, strict=False)]
            for key, sets in raw.cell_sets.items()
        },
        info=raw.info,
    )


def corners(block: Any) -> Ids:
    """Return the corners of the cells of a block in VTK's order."""
    return np.asarray(block.data, dtype=np.int64)[
        :, : {"quad": 4, "triangle": 3, "tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}.get(family(block))
    ]


def distinct(cells: Ids) -> NDArray[np.bool_]:
    """Return which rows have no id twice."""
    ordered = np.sort(cells, axis=1)
    return np.asarray((ordered[:, 1:] != ordered[:, :-1]).all(axis=1))


def triangles(quads: Ids) -> tuple[Ids, Ids]:
    """Return two triangles of each quadrilateral, whose diagonal begins at its smallest node, and the row that they are of.

    >>> triangles(np.array([[7, 3, 5, 4]]))[0].tolist()
    [[3, 5, 4], [3, 4, 7]]
    """
    turned = np.take_along_axis(quads, (quads.argmin(axis=1)[:, None] + np.arange(4)) % 4, axis=1)
    both, rows = np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]]), np.tile(np.arange(len(quads)), 2)
    good = distinct(both)
    order = np.argsort(rows[good], kind="stable")
    return both[good][order], rows[good][order]


def tetrahedra(cells: Ids, faces: Sequence[Sequence[int]]) -> tuple[Ids, Ids]:
    """Return tetrahedra from the smallest node of each cell to the faces without it, and the row that they are of.

    All diagonals of faces begin at the smallest node, so that they match those of neighbours (Dompierre and others 1999, "How to
    subdivide pyramids, prisms and hexahedra into tetrahedra").
    """
    least, parts, origins = cells.min(axis=1), [np.empty((0, 4), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for face in faces:
        nodes = cells[:, list(face)]
        base, rows = (nodes, np.arange(len(cells))) if len(face) == 3 else triangles(nodes)
        parts.append(np.column_stack([base, least[rows]]))
        origins.append(rows)
    found, rows = np.concatenate(parts), np.concatenate(origins)
    good = distinct(found)
    order = np.argsort(rows[good], kind="stable")
    return found[good][order], rows[good][order]


def refuse_folded(points: NDArray[np.float64], cells: Ids, rows: Ids, block: Any, name: str) -> None:
    """Refuse cells of which nothing remains, or whose tetrahedra have both orientations."""
    bad = np.setdiff1d(np.arange(len(block)), rows)
    if cells.shape[1] == 4 and points.shape[1] == 3:
        x = points[cells]
        signs = np.sign(np.linalg.det(x[:, 1:] - x[:, :1]))
        least, most = np.full(len(block), 2.0), np.full(len(block), -2.0)
        np.minimum.at(least, rows, signs)
        np.maximum.at(most, rows, signs)
        bad = np.union1d(bad, np.flatnonzero(least * most < 0))
    if len(bad):
        raise MeshError(
            f"{name}: {name_ids(bad, f'{block.type} cell')}: the same vertex twice, or folded over itself, so that it is no sum of "
            "simplices. Correct or remove it."
        )


def refuse_unmatched(blocks: Sequence[Any], name: str) -> None:
    """Refuse a quadrilateral face on the surface of its part next to a triangle on three of its nodes."""
    quads, small = [np.empty((0, 4), dtype=np.int64)], [np.empty((0, 3), dtype=np.int64)]
    for block in blocks:
        for face in FACES.get(family(block), ()):
            (quads if len(face) == 4 else small).append(corners(block)[:, list(face)])
    alone, lone = (single(np.sort(np.concatenate(tables), axis=1)) for tables in (quads, small))
    of_quads = np.concatenate([alone[:, list(ids)] for ids in combinations(range(4), 3)])
    both, counts = np.unique(np.concatenate([np.unique(of_quads, axis=0), lone]), axis=0, return_counts=True)
    if (counts > 1).any():
        ids = name_ids(np.unique(both[counts > 1]), "node")
        raise MeshError(
            f"{name}: a quadrilateral face is next to two triangles, at {ids} of the file, from 0; expected faces that match. "
            "Mesh the parts alike, or put pyramids between hexahedra and tetrahedra."
        )


def single(faces: Ids) -> Ids:
    """Return the rows that occur once."""
    unique, counts = np.unique(faces, axis=0, return_counts=True)
    return np.asarray(unique[counts == 1])
