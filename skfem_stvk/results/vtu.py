"""Results and meshes as VTU, the file format of ParaView, through meshio; of a divided body, a file of each part and their list."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from glob import escape as literal
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unicodedata import category
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, shown
from ..errors import MeshError, StvkError, name_ids
from ..mesh import ElementMesh
from ..mesh.groups import DIMENSION, NODE_SET, as_cells, flatten
from ..mesh.locations import checked_facets, checked_lines, vertices_at
from ..space import Space
from .complete_files import in_all_parts, of_leader, output_path, replacing
from .fields import State, checked_state
from .law_on_elements import in_space
from .table import NODAL, Field, find_all

if TYPE_CHECKING:
    import meshio

Arrays = dict[str, NDArray[Any]]
#: Names of the numbers of nodes and of elements in the whole mesh.
NODES, ELEMENTS = "GlobalNodeIds", "GlobalElementIds"
#: Names of types in VTK's files.
KINDS = {"f": "Float", "i": "Int", "u": "UInt"}
#: VTK's order of the components of a symmetric tensor: XX, YY, ZZ, XY, YZ, XZ.
VTK = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
#: Names of the rank of each element, and ends of the names of masks.
RANK, MISSING = "rank", "_missing"
DEFAULT = ("cauchy_stress", "von_mises_stress", "green_strain", "volume_ratio")


def write_vtu(path: str | os.PathLike[str], state: State, fields: Sequence[str] = DEFAULT) -> Path:
    """Write the mesh at rest, the displacements and these fields, by cell and averaged to the points, under their full names.

    ========================  ==============================================================================================
    points                    at rest, padded to three components; "Warp By Vector" with `displacement` gives the deformed body
    `displacement`            [m], three components; a body in motion also has `velocity` [m/s]
    `contact_force`           [N], only with contacts: the sum of their forces on each node
    `contact_pressure`        [Pa], only with contacts: the largest of their pressures on each node, at rest
    `gap`                     [m], only with contacts: the smallest of their gaps, see `ContactState`
    symmetric tensors         six components in VTK's order XX, YY, ZZ, XY, YZ, XZ
    other tensors             nine components, row by row
    `NAME_missing`            only if values are missing: 1 where `NAME` has no value, and is zero
    `region`                  only if the mesh has subdomains: 1 for the first in its order, 0 for none; the last one counts
    `skfem:s:NAME`            1 in the subdomain, as scikit-fem writes it: `read_mesh` gives the subdomains back; control characters
                              in a name are escaped, such as \\x1b
    ========================  ==============================================================================================

    Quadratic simplices are VTK's quadratic cells, and hexahedra are in VTK's order of nodes. For elements with several points,
    fields by cell are means, and fields at nodes are extrapolated. Elements that are removed from the body are left out; their
    nodes stay. Elements of lower dimensions, such as cables, are cells after those of the mesh. Nodes have their values where no
    element of the mesh has one. Arrays have their units in the system of units of the body as VTK's key UNITS_LABEL. The file is
    renamed to its final name when it is complete.

    For a body that is divided into parts, the path ends in .pvtu. All parts call this function together, and each writes a file of
    its own next to it, `NAME_r0000.vtu`, `NAME_r0001.vtu`, ..., with the field `rank` of its elements.

    Raises
    ------
    StvkError
        for an unknown field, or a path that cannot be written, before any work.
    """
    wanted, space = find_all(fields), checked_state(state).fields.mesh.space
    path = output_path(path, ".pvtu" if space.comm.divided else ".vtu")
    mesh, system = _with_fields(state, wanted), state.fields.units
    units = {"Points": "m"} | NODAL | {field.name: field.unit for field in wanted if field.unit != "-"}
    units = {name: system.of(unit) for name, unit in units.items()}
    if space.comm.divided:
        write_pieces(path, mesh, space, units)
    else:
        write_grid(path, mesh, units)
    return path


def read_vtu(file: Path) -> meshio.Mesh:
    """Return the content of a .vtu or .pvtu file that this package wrote, in the order of the user's mesh.

    Raises StvkError if it is missing or damaged.
    """
    try:
        if file.exists() and not file.is_file():
            raise OSError("it is not a regular file")
        from meshio import vtu

        if file.suffix.lower() == ".pvtu":
            return joined([vtu.read(piece) for piece in pieces_of(file)])
        read = vtu.read(file)
        return joined([read]) if NODES in read.point_data else read
    except Exception as error:  # meshio raises many kinds of errors for damaged files
        raise StvkError(f"{file} cannot be read ({error}). Check that the .pvd file lists the right path.") from error


def _with_fields(state: State, fields: Sequence[Field]) -> meshio.Mesh:
    import meshio

    mesh, kinds = state.fields.mesh, [(body_state, ~body_state.fields.removed) for body_state in (state, *state.beside)]
    with in_all_parts(mesh.space.comm):
        parts = [_by_cell(body_state, fields) for body_state, _ in kinds]
    points: Arrays = {}
    for name, values in state.nodal.items():
        points |= _arrays(name, values if values.ndim == 1 else in_space(values))
    for field in fields:
        points |= _arrays(field.name, _at_nodes(state, field.name), field.symmetric)
    elements = [as_cells(body_state.fields.mesh.t[:, present], body_state.fields.mesh.element) for body_state, present in kinds]
    cells: dict[str, list[NDArray[Any]]] = {}
    for name, values in {name: values for part in reversed(parts) for name, values in part.items()}.items():
        cells[name] = [
            part[name][present] if name in part else np.zeros((np.count_nonzero(present), *values.shape[1:]), dtype=values.dtype)
            for part, (_, present) in zip(parts, kinds, strict=True)
        ]
    if mesh.space.comm.divided or not np.array_equal(mesh.node_numbers, np.arange(mesh.nv)):
        points |= {name: np.zeros(mesh.nv, dtype=np.uint8) for name in _masks_elsewhere(points, mesh.space)}
        for name in _masks_elsewhere(cells, mesh.space):
            cells[name] = [np.zeros(len(t), dtype=np.uint8) for _, t in elements]
        points[NODES] = mesh.node_numbers
        cells[ELEMENTS] = [body_state.fields.mesh.element_numbers[present] for body_state, present in kinds]
        cells[RANK] = [np.full(len(t), mesh.space.comm.rank, dtype=np.int32) for _, t in elements]
    return meshio.Mesh(in_space(mesh.p.T), elements, points, cells)


def _masks_elsewhere(names: Iterable[str], space: Space) -> list[str]:
    """Return the names of masks of missing values that only other parts of a divided body have."""
    every = space.comm.each([name for name in names if name.endswith(MISSING)])
    return sorted({name for found in every for name in found}.difference(names))


def _by_cell(state: State, fields: Sequence[Field]) -> Arrays:
    """Return the values of the elements of one kind."""
    cells = _regions(state.fields.mesh)
    for field in fields:
        cells |= _arrays(field.name, state[field.name], field.symmetric)
    return cells


def _at_nodes(state: State, name: str) -> Array:
    """Return averages at the nodes: over the elements of the highest dimension, and elsewhere over those of lower dimensions."""
    values = state.at_nodes(name)
    for other in state.beside:
        missing = np.ma.getmaskarray(values)
        if state.fields.mesh.space.comm.any(bool(missing.any())):
            values = np.ma.where(missing, other.at_nodes(name), values)
    return values


def _arrays(name: str, values: Array, symmetric: bool = False) -> Arrays:
    """Return the components by name, and a mask of missing ones."""
    filled = np.ma.filled(values, 0.0)
    arrays: Arrays = {name: _components(filled, symmetric)}
    if np.ma.is_masked(values):
        arrays[f"{name}{MISSING}"] = np.ma.getmaskarray(values).reshape(len(values), -1)[:, 0].astype(np.uint8)
    return arrays


def _components(values: Array, symmetric: bool) -> Array:
    if not symmetric:
        return values.reshape(len(values), prod(values.shape[1:])) if values.ndim > 1 else values  # there may be no elements
    i, j = np.array(VTK).T
    return values[:, i, j]


def _regions(mesh: ElementMesh) -> Arrays:
    arrays: Arrays = {}
    if mesh.subdomains:
        region = np.zeros(mesh.nt, dtype=np.int32)
        for number, name in enumerate(mesh.subdomains, start=1):
            elements = mesh.elements(name)
            region[elements] = number
            arrays[f"skfem:s:{as_attribute(name)}"] = np.isin(np.arange(mesh.nt), elements).astype(np.uint8)
        arrays["region"] = region
    return arrays


def as_attribute(name: str) -> str:
    r"""Return a name as an XML attribute, which meshio writes without escaping; characters that XML does not allow are escaped.

    >>> print(as_attribute('left "<half>" \x1b'))
    left &quot;&lt;half&gt;&quot; \x1b
    """
    legal = "".join(repr(letter)[1:-1] if category(letter) in ("Cc", "Cs", "Cn") else letter for letter in name)
    return escape(legal, {'"': "&quot;"}).encode("ascii", "xmlcharrefreplace").decode()


def write_mesh(path: str | os.PathLike[str], mesh: ElementMesh) -> Path:
    """Write a mesh as `read_mesh` reads it: the same numbers of nodes and elements, subdomains, boundaries and node sets.

    ==========================  ============================================================================================
    elements                    VTK's cells in double precision, quadratic ones with their midside nodes
    boundaries                  facets as cells after the elements, in their order; for segments scikit-fem's `skfem:b:NAME`
    lines                       segments as cells after these
    `skfem:s:NAME`              1 for cells in the subdomain, boundary or lines
    `stvk:n:NAME`               1 for nodes in the node set
    `stvk:dimension`            for flat surfaces and straight cables in space: whether their last coordinates count
    ==========================  ============================================================================================

    Sets are read back in ascending order, facets of boundaries in their own. Empty sets are left out, and control characters in
    their names are escaped. The file is renamed to its final name when it is complete.

    Parameters
    ----------
    path
        Path of the file, ending in .vtu.
    mesh
        The mesh, with its subdomains, boundaries, node sets and lines.

    Returns
    -------
    pathlib.Path
        Path of the file.

    Raises
    ------
    StvkError
        if the path cannot be written.
    MeshError
        for anything other than a whole `ElementMesh`, and for nodes without an element, which the file would lose.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from skfem_stvk import read_mesh
    >>> from skfem_stvk.mesh import box
    >>> mesh = box((2.0, 1.0), (4, 2)).with_degree(2)
    >>> with TemporaryDirectory() as folder:
    ...     again = read_mesh(write_mesh(folder + "/box.vtu", mesh))
    >>> again, bool((again.p == mesh.p).all() and (again.t == mesh.t).all()), sorted(again.boundaries)
    (ElementMesh: 16 quadratic triangles in 2D, 45 nodes, True, ['bottom', 'left', 'right', 'top'])
    """
    path = output_path(path, ".vtu")
    if not isinstance(mesh, ElementMesh):
        raise MeshError(f"mesh = {shown(mesh)}; expected an ElementMesh: ElementMesh.of(mesh) makes one.")
    if mesh.space.comm.divided:
        raise MeshError(f"mesh = {mesh!r}; expected a whole mesh. Write the mesh that was distributed.")
    of_groups = [np.ravel(ids) for groups in (mesh.boundaries, mesh.lines) if mesh.element.degree == 1 for ids in groups.values()]
    if len(unused := np.setdiff1d(np.arange(mesh.nv), np.concatenate([mesh.t.ravel(), *of_groups]))):
        raise MeshError(f"{name_ids(unused, mesh.word)}: on no element, so the file would lose them. Remove them.")
    write_grid(path, _mesh_content(mesh), {})
    return path


def _mesh_content(mesh: ElementMesh) -> meshio.Mesh:
    from meshio import Mesh

    facets = {name: checked_facets(mesh, name) for name in mesh.boundaries if np.size(mesh.boundaries[name])}
    members = {name: mesh.elements(name) for name in mesh.subdomains if np.size(mesh.subdomains[name])}
    sets = {name: vertices_at(mesh, np.asarray(ids), f"Node set {name!r}") for name, ids in mesh.node_sets.items() if len(ids)}
    blocks, inside = [as_cells(mesh.t, mesh.element)], [members]
    cells: dict[str, list[NDArray[Any]]] = {}
    if mesh.k == 1:
        cells |= {f"skfem:b:{as_attribute(name)}": [_ends_marked(mesh, ids[0])] for name, ids in facets.items()}
        facets = {}
    lines = {name: checked_lines(mesh, name) for name in mesh.lines}
    for groups, element in ((facets, mesh.facet), (lines, mesh.element.edge)):
        if groups:
            blocks.append(as_cells(np.concatenate(list(groups.values()), axis=1), element))
            ends = np.cumsum([0, *(ids.shape[1] for ids in groups.values())])
            inside.append({name: np.arange(ends[i], ends[i + 1]) for i, name in enumerate(groups)})
    none = np.empty(0, dtype=np.int64)
    for name in {name: None for groups in inside for name in groups}:
        cells[f"skfem:s:{as_attribute(name)}"] = [
            _mask(len(block), groups.get(name, none)) for (_, block), groups in zip(blocks, inside, strict=True)
        ]
    points = in_space(mesh.p.T)
    if len(flatten(points.T, mesh.k)) != mesh.d:
        cells[DIMENSION] = [np.full(len(block), mesh.d, dtype=np.uint8) for _, block in blocks]
    marked = {NODE_SET + as_attribute(name): _mask(mesh.nv, ids) for name, ids in sets.items()}
    return Mesh(points, blocks, marked, cells)


def _mask(count: int, ids: Any) -> NDArray[np.uint8]:
    """Return 1 for these ids, 0 for others."""
    return np.isin(np.arange(count), ids).astype(np.uint8)


def _ends_marked(mesh: ElementMesh, nodes: NDArray[Any]) -> NDArray[np.uint8]:
    """Return a bit `j` for each segment with end `j` at one of these nodes; a node marks only one segment."""
    marked = np.zeros(mesh.nt, dtype=np.uint8)
    ends = mesh.corners.ravel()
    ids, first = np.unique(ends, return_index=True)
    end, element = np.divmod(first[np.isin(ids, nodes)], mesh.nt)
    np.bitwise_or.at(marked, element, (1 << end).astype(np.uint8))
    return marked


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
        for piece in file.parent.glob(f"{literal(file.stem)}_r[0-9]*.vtu"):
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
