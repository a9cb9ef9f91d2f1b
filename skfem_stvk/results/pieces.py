"""Files of a divided body: a .vtu of each part, the .pvtu that lists them, and their join."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..space import Space
from .complete_files import in_all_parts, of_leader, replacing

if TYPE_CHECKING:
    import meshio

#: Names of the numbers of nodes and of elements in the whole mesh.
NODES, ELEMENTS = "GlobalNodeIds", "GlobalElementIds"
#: Names of types in VTK's files.
KINDS = {"f": "Float", "i": "Int", "u": "UInt"}


def write_grid(path: Path, mesh: meshio.Mesh, units: Mapping[str, str]) -> None:
    """Write a .vtu file, as `replacing` does, with the units of arrays by name: VTK's key UNITS_LABEL, which other readers skip."""
    from meshio import vtu  # imported only for writing

    with replacing(path) as part:
        vtu.write(part, mesh, compression=None)
        written, done = part.read_bytes(), 0
        with part.open("wb") as file:
            for array in re.finditer(rb' Name="([^"]*)"[^>]*>[^<]*', written):
                if unit := units.get(array[1].decode()):
                    file.write(written[done : (done := array.end())])
                    file.write(f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{unit}</InformationKey>\n'.encode())
            file.write(written[done:])


def write_pieces(path: Path, mesh: meshio.Mesh, space: Space, units: Mapping[str, str]) -> None:
    """Write the file of each part next to a .pvtu, and then the .pvtu. All parts call this function together."""
    names = [f"{path.stem}_r{rank:04d}.vtu" for rank in range(space.comm.size)]
    with in_all_parts(space.comm):
        write_grid(path.with_name(names[space.comm.rank]), mesh, units)
    of_leader(space.comm, lambda: _write_list(path, names, mesh))


def _write_list(path: Path, names: Sequence[str], mesh: meshio.Mesh) -> None:
    """Write the .pvtu of files with the arrays of `mesh`."""
    root = ET.Element("VTKFile", type="PUnstructuredGrid", version="0.1", byte_order="LittleEndian")
    grid = ET.SubElement(root, "PUnstructuredGrid", GhostLevel="0")
    _declare(ET.SubElement(grid, "PPoints"), {"Points": mesh.points})
    _declare(ET.SubElement(grid, "PPointData"), mesh.point_data)
    _declare(ET.SubElement(grid, "PCellData"), {name: blocks[0] for name, blocks in mesh.cell_data.items()})
    for name in names:
        ET.SubElement(grid, "Piece", Source=name)
    ET.indent(root)
    with replacing(path) as part:
        ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _declare(parent: ET.Element, arrays: dict[str, NDArray[Any]]) -> None:
    for name, values in arrays.items():
        kind = f"{KINDS[values.dtype.kind]}{8 * values.dtype.itemsize}"
        width = {"NumberOfComponents": str(values.shape[1])} if values.ndim > 1 else {}
        ET.SubElement(parent, "PDataArray", {"type": kind, "Name": name, **width})


def pieces_of(path: Path) -> list[Path]:
    """Return the files that a .pvtu lists, which are next to it."""
    return [path.with_name(Path(piece.attrib["Source"]).name) for piece in ET.parse(path).iter("Piece")]


def remove_state(file: Path) -> None:
    """Remove a .vtu file, or a .pvtu file and the files of the parts, if they exist."""
    file.unlink(missing_ok=True)
    if file.suffix == ".pvtu":
        for piece in file.parent.glob(f"{escape(file.stem)}_r[0-9]*.vtu"):
            piece.unlink(missing_ok=True)


def joined(pieces: Sequence[meshio.Mesh]) -> meshio.Mesh:
    """Return the whole mesh from its parts, without the numbers of nodes and elements, which give the order.

    Raises ValueError if nodes are missing.
    """
    from meshio import Mesh

    numbers = [piece.point_data[NODES] for piece in pieces]
    ids, first = np.unique(np.concatenate(numbers), return_index=True)
    if not np.array_equal(ids, np.arange(len(ids))):
        raise ValueError(f"the files of its parts have {len(ids)} of {int(ids.max()) + 1} nodes")

    def at_nodes(arrays: Sequence[NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate(arrays)[first]

    points = {name: at_nodes([piece.point_data[name] for piece in pieces]) for name in pieces[0].point_data if name != NODES}
    cells: dict[str, list[NDArray[Any]]] = {name: [] for name in pieces[0].cell_data if name != ELEMENTS}
    elements = []
    for kind in dict.fromkeys(block.type for piece in pieces for block in piece.cells):
        blocks = [(rank, i) for rank, piece in enumerate(pieces) for i, block in enumerate(piece.cells) if block.type == kind]
        of_kind = {name: np.concatenate([pieces[rank].cell_data[name][i] for rank, i in blocks]) for name in [ELEMENTS, *cells]}
        order = np.argsort(of_kind.pop(ELEMENTS), kind="stable")
        elements.append((kind, np.concatenate([numbers[rank][pieces[rank].cells[i].data] for rank, i in blocks])[order]))
        for name, values in of_kind.items():
            cells[name].append(values[order])
    return Mesh(at_nodes([piece.points for piece in pieces]), elements, points, cells)
