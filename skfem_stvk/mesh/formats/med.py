"""MED files (.med) of Salome and code_aster, through h5py: groups of elements and of nodes, which families combine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np

from .sides import CellsOfFile, Ids, mesh_of
from .stream import CutOff, Damaged

#: Types of cells in meshio's terms, and their nodes in VTK's order; solids are mirrored in MED.
KINDS: dict[str, tuple[str, tuple[int, ...]]] = {
    "PO1": ("vertex", ()),
    "SE2": ("line", ()),
    "SE3": ("line3", ()),
    "TR3": ("triangle", ()),
    "TR6": ("triangle6", ()),
    "QU4": ("quad", ()),
    "QU8": ("quad8", ()),
    "QU9": ("quad9", ()),
    "TE4": ("tetra", (0, 2, 1, 3)),
    "T10": ("tetra10", (0, 2, 1, 3, 6, 5, 4, 7, 9, 8)),
    "HE8": ("hexahedron", (0, 3, 2, 1, 4, 7, 6, 5)),
    "H20": ("hexahedron20", (0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17)),
    "PE6": ("wedge", (0, 2, 1, 3, 5, 4)),
    "P15": ("wedge15", (0, 2, 1, 3, 5, 4, 8, 7, 6, 11, 10, 9, 12, 14, 13)),
    "PY5": ("pyramid", (0, 3, 2, 1, 4)),
    "P13": ("pyramid13", (0, 3, 2, 1, 4, 8, 7, 6, 5, 9, 12, 11, 10)),
}


def read(path: Path) -> meshio.Mesh:
    """Read nodes and elements, and their groups as sets. A family is in several groups; family 0 is in none."""
    import h5py

    try:
        file = h5py.File(path)
    except OSError as error:
        raise CutOff("it is not an HDF5 file, or a part of one") from error
    with file:
        if len(file["ENS_MAA"]) != 1:
            raise Damaged(
                f"it has {len(file['ENS_MAA'])} meshes ({', '.join(file['ENS_MAA'])[:60]}); expected one. Export it alone"
            )
        ((name, mesh),) = file["ENS_MAA"].items()
        families = file["FAS"][name] if name in file.get("FAS", {}) else {}
        d, mesh = int(mesh.attrs["ESP"]), mesh if "NOE" in mesh else mesh[sorted(mesh)[0]]
        points = rows(mesh["NOE"]["COO"], d)
        node_sets = members(families.get("NOEUD", {}), family_of(mesh["NOE"], len(points)))
        blocks, of_elements, first = list[CellsOfFile](), [np.empty(0, dtype=np.int64)], 0
        for type, group in mesh.get("MAI", {}).items():
            if type not in KINDS:
                raise Damaged(f"its elements {type[:20]} are not read. Write the mesh without them")
            kind, order = KINDS[type]
            cells = rows(group["NOD"]).astype(np.int64) - 1
            blocks.append(CellsOfFile(kind, first, cells[:, order] if order else cells))
            of_elements.append(family_of(group, len(cells)))
            first += len(cells)
        groups = members(families.get("ELEME", {}), np.concatenate(of_elements))
    return mesh_of(points, blocks, node_sets, {name: {"elements": ids} for name, ids in groups.items()})


def rows(data: Any, columns: int | None = None) -> Any:
    """Return an array that MED stores column after column."""
    return np.asarray(data[()]).reshape(int(data.attrs["NBR"]), columns or -1, order="F")


def family_of(group: Any, count: int) -> Ids:
    """Return the number of the family of each node or element; 0 where none is written."""
    return np.asarray(group["FAM"][()], dtype=np.int64) if "FAM" in group else np.zeros(count, dtype=np.int64)


def members(families: Any, numbers: Ids) -> dict[str, Ids]:
    """Return the indices of the members of each group: those of all families that are in it."""
    of_group: dict[str, list[int]] = {}
    for family in families.values():
        for name in family["GRO"]["NOM"][()] if "GRO" in family else ():
            text = np.asarray(name).astype(np.int8).tobytes().partition(b"\0")[0]
            of_group.setdefault(decoded(text).strip(), []).append(int(family.attrs["NUM"]))
    return {name: np.flatnonzero(np.isin(numbers, found)) for name, found in of_group.items()}


def decoded(text: bytes) -> str:
    """Return a name in UTF-8, or else in Latin-1."""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("latin-1")
