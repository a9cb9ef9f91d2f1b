"""A mesh file is read completely as declared, or it is refused with the cause."""

import os

import meshio
import numpy as np
import pytest
from meshfiles import TETS, write

from skfem_stvk import MeshError
from skfem_stvk.mesh import read_mesh
from validation.hostile import meshes, runner, tiny_files
from validation.hostile.case import Wrong
from validation.hostile.mesh_formats import FORMATS, written

#: Changed files that can be read in this process, because none of them requests much memory.
SAFE = [case for case in (*meshes.cuts(), *meshes.rows(), *meshes.numbers()) if "random" not in case.name]
SAFE = [case for case in SAFE if " is " not in case.name or case.name.endswith((" is +1", " is -1", " is nan", " is 0"))]


@pytest.mark.parametrize("name", FORMATS)
def test_a_damaged_file_is_refused_or_contains_the_same_mesh(name, tmp_path):
    chosen = [case for case in SAFE if case.name.startswith(f"{name}: ")]
    refused = 0
    for number, case in enumerate(chosen):
        (folder := tmp_path / str(number)).mkdir()
        try:
            mesh = case.attempt(folder)
        except MeshError as error:
            assert "body" in str(error) or "element" in str(error), f"{case.name}: {error}"
            refused += 1
            continue
        try:
            case.judge(mesh)
        except Wrong as wrong:
            raise AssertionError(f"{case.name}: {wrong.why}") from wrong
    assert refused > len(chosen) / 2 > 9


def test_tiny_files_and_special_files_are_refused_without_memory_or_time():
    todo = [case for case in tiny_files.cases() if case.quick]
    assert len(todo) > len(tiny_files.FILES)
    outcomes = [runner.outcome("meshes", case) for case in todo]
    assert not [(one.case, one.verdict, one.why) for one in outcomes if one.verdict.value != "refused"]


MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
5
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
5 1 1 1
$EndNodes
$Elements
2
1 4 2 1 1 1 2 3 4
2 4 2 1 1 2 3 4 5
$EndElements
"""
ELEMENTS = MSH[MSH.index("$Elements") :]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MSH.replace("2 3 4 5", "2 3 4 0"), r"its elements: 1 node \(0\)"),
        (
            MSH.replace("5 1 1 1", "0 1 1 1").replace("2 3 4 5", "2 3 4 0"),
            r"tags from 0 to 4; expected whole numbers from 1",
        ),
        (
            MSH.replace("$Elements\n2", "$Elements\n1"),
            r"2 4 2 1 1 2 3 4 5 follows the entries that \$Elements declares; expected \$EndEl",
        ),
        (
            MSH.replace("$Elements\n2", "$Elements\n3"),
            r"3 elements are declared, 2 were found|contain other text than whole numbers",
        ),
        (MSH.replace("$Nodes\n5", "$Nodes\n4"), r"5 1 1 1 follows the entries that \$Nodes declares; expected \$EndNodes"),
        (MSH.replace("\n5 1 1 1", "\n4 1 1 1"), r"1 node \(4\) more than once"),
        (MSH.replace("\n2 4 2", "\n1 4 2"), r"1 element \(1\) more than once"),
        (MSH.replace("2 3 4 5", "2 3 4 4294967301"), r"its elements: 1 node \(4294967301\)"),
        (MSH.replace("2 3 4 5", "2 3 4 5 1"), "the element '2 4 2 1 1 2 3 4 5 1' has not as many nodes as its type"),
        (MSH.replace("\n2 4 2", "\n2 400 2"), "elements of Gmsh's type 400, which is not supported"),
        (MSH + ELEMENTS, r"\$Elements occurs twice"),
        (MSH.replace("5 1 1 1", "5 1 1 nan"), r"1 vertex \(4\) with coordinates that are not finite"),
        (MSH.replace("$Nodes\n5", "$Nodes\n-5"), "number of nodes = '-5'; expected a whole number"),
        (MSH.replace("2.2 0 8", "7.0 0 8"), "it is of version 7.0; versions 2.0 - 2.2, 4.0 and 4.1 are read"),
    ],
)
def test_inconsistent_gmsh_files_are_refused(text, message, tmp_path):
    (tmp_path / "mesh.msh").write_text(text)
    with pytest.raises(MeshError, match=rf"mesh\.msh could not be read: .*({message})"):
        read_mesh(tmp_path / "mesh.msh")


def test_the_undamaged_gmsh_file_is_read(tmp_path):
    (tmp_path / "mesh.msh").write_text(MSH)
    assert read_mesh(tmp_path / "mesh.msh").t.T.tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]


@pytest.mark.parametrize("fraction", [0.4, 0.8, 0.95])
def test_abaqus_files_that_end_within_a_line_are_refused(fraction, tmp_path):
    content = written("inp").content
    cut = content[: int(fraction * len(content))].rstrip(b"\n")
    (tmp_path / "mesh.inp").write_bytes(cut)
    with pytest.raises(MeshError, match=r"its last line has no end, so it may be cut within a number"):
        read_mesh(tmp_path / "mesh.inp")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("2, 1, 2, 3, 4, 1\n", r"1 element \(2\): not the 4 nodes of the type C3D4"),
        ("2, 1, 2, 3, 4, 3, 1, 3, 2, 4\n", r"1 element \(2\): not the 4 nodes"),
        ("1, 1, 2, 4, 3\n", r"1 element \(1\) more than once"),
        ("2, 1, 2, 3, 4294967300\n", r"its elements: 1 node \(4294967300\)"),
        ("*ELSET, ELSET=part\n1, 77\n", r"Element set 'part': 1 element \(77\) not defined"),
        ("*NSET, NSET=pin\n1, 77\n", r"Node set 'pin': 1 node \(77\)"),
        ("*ELSET, ELSET=part, GENERATE\n9, 1\n", r"GENERATE has '9, 1'; expected the first element, the last one"),
        ("*ELSET, ELSET=part, GENERATE\n5, 100000000\n", r"part': GENERATE has '5, 100000000', and none of these ids is defined"),
        ("*INCLUDE, INPUT=/dev/zero\n", "it includes '/dev/zero', which is not in its folder"),
        ("*INCLUDE, INPUT=mesh.inp\n", "it includes files more than 8 deep, or more than 100: itself"),
    ],
)
def test_inconsistent_abaqus_elements_sets_and_includes_are_refused(lines, message, tmp_path):
    (tmp_path / "mesh.inp").write_text(tiny_files.INP + lines)
    with pytest.raises(MeshError, match=message):
        read_mesh(tmp_path / "mesh.inp")


def test_a_fifo_among_the_files_that_an_input_file_includes_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "mesh.inp").write_text(tiny_files.INP + "*INCLUDE, INPUT=pipe\n")
    with pytest.raises(MeshError, match=r"pipe', which it needs, is missing or not a regular file"):
        read_mesh(tmp_path / "mesh.inp")


def test_vtk_cells_of_unknown_types_are_refused(tmp_path):
    content = written("vtk").content.replace(b"CELL_TYPES 40\n10\n10", b"CELL_TYPES 40\n10\n15")
    (tmp_path / "mesh.vtk").write_bytes(content)
    with pytest.raises(MeshError, match="1 cells are of VTK's types 15, which are not supported"):
        read_mesh(tmp_path / "mesh.vtk")


@pytest.mark.parametrize("ending", ["vtk", "vtu"])
@pytest.mark.parametrize("binary", [True, False])
def test_files_of_pyvista_are_read_with_64_bit_groups_and_without_strings(ending, binary, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    cells = np.column_stack([np.full(TETS.nelements, 4), TETS.t.T]).ravel()
    grid = pyvista.UnstructuredGrid(cells, np.full(TETS.nelements, 10), TETS.p.T)
    grid.cell_data["part"] = np.arange(TETS.nelements) % 2
    grid.cell_data["inside"] = np.arange(TETS.nelements) % 3 == 0
    grid.field_data["note"] = ["text", "in", "lines"]
    grid.save(tmp_path / f"mesh.{ending}", binary=binary)
    assert grid.cell_data["part"].dtype == np.int64
    mesh = read_mesh(tmp_path / f"mesh.{ending}")
    assert np.allclose(mesh.p, TETS.p) and np.array_equal(mesh.t, TETS.t)
    assert set(mesh.subdomains) == {"part:0", "part:1", "inside:0", "inside:1"}
    assert mesh.elements("part:1").tolist() == list(range(1, TETS.nelements, 2))


def test_all_pieces_of_a_vtu_file_are_read(tmp_path):
    text = write(tmp_path / "one.vtu", TETS.p.T, [("tetra", TETS.t.T)]).read_text()
    start, end = text.index("<Piece"), text.index("</Piece>") + len("</Piece>")
    (tmp_path / "two.vtu").write_text(text[:end] + text[start:end] + text[end:])
    mesh = read_mesh(tmp_path / "two.vtu")
    assert (mesh.nt, mesh.nv) == (2 * TETS.nelements, 2 * TETS.nvertices)
    assert np.array_equal(mesh.t[:, TETS.nelements :], TETS.t + TETS.nvertices)


@pytest.mark.parametrize("value", ["nan", "-1", "2", "0.5"])
def test_marks_of_subdomains_other_than_0_and_1_are_refused(value, tmp_path):
    data = {"skfem:s:left": [np.append(np.zeros(TETS.nelements - 1), float(value))]}
    write(tmp_path / "mesh.vtu", TETS.p.T, [("tetra", TETS.t.T)], cell_data=data)
    with pytest.raises(MeshError, match=rf"skfem:s:left.*1 element \({TETS.nelements - 1}\).*expected 0 or 1"):
        read_mesh(tmp_path / "mesh.vtu")


@pytest.mark.parametrize("value", ["nan", "-1", "16", "0.5"])
def test_marks_of_boundaries_that_are_no_bits_of_facets_are_refused(value, tmp_path):
    data = {"skfem:b:wall": [np.append(np.zeros(TETS.nelements - 1), float(value))]}
    write(tmp_path / "mesh.vtu", TETS.p.T, [("tetra", TETS.t.T)], cell_data=data)
    with pytest.raises(MeshError, match=rf"skfem:b:wall.*1 element \({TETS.nelements - 1}\).*expected whole numbers from 0 to 15"):
        read_mesh(tmp_path / "mesh.vtu")


def test_a_file_without_read_permission_is_not_called_damaged(tmp_path, monkeypatch):
    file = write(tmp_path / "mesh.vtu", TETS.p.T, [("tetra", TETS.t.T)])

    def forbidden(*args, **options):
        raise PermissionError(13, "Permission denied", str(file))

    monkeypatch.setattr("pathlib.Path.read_bytes", forbidden)
    with pytest.raises(
        MeshError, match=r"mesh\.vtu cannot be read: Permission denied\. Change its permissions, or copy it"
    ) as caught:
        read_mesh(file)
    assert "cut off" not in str(caught.value)


def test_tetgen_elements_out_of_order_are_refused(tmp_path):
    whole = written("tetgen")
    (tmp_path / "mesh.node").write_bytes(whole.companions[".node"])
    (tmp_path / "mesh.ele").write_bytes(whole.content.replace(b"\n3 ", b"\n33 "))
    with pytest.raises(MeshError, match=r"the ids of its cells are not 0, 1, \.\.\.: 33 instead of 3"):
        read_mesh(tmp_path / "mesh.ele")


def test_cells_that_meshio_leaves_out_are_detected_by_their_number(tmp_path):
    text = written("su2").content.decode()
    first, *rest = text.split("\n10 ")
    (tmp_path / "mesh.su2").write_text(first + "\n10 " + rest[0] + "\n" + "".join("\n10 " + row for row in rest[1:]))
    with pytest.raises(MeshError, match="40 cells are declared, 39 were read"):
        read_mesh(tmp_path / "mesh.su2")


@pytest.mark.parametrize("more", [4, 1_000_000])
def test_a_medit_section_with_a_wrong_end_is_refused(more, tmp_path):
    content = bytearray(written("medit binary").content)
    keyword, end, _, count = np.frombuffer(content, "<i4", 4, 24).tolist()
    assert (keyword, end, count) == (4, 40 + 26 * 28, 26)
    content[28:32] = np.int32(end + more).tobytes()
    (tmp_path / "mesh.meshb").write_bytes(content)
    with pytest.raises(MeshError, match=f"its section 4 of 26 entries ends at byte {end + more} of {len(content)}"):
        read_mesh(tmp_path / "mesh.meshb")


def test_a_repeated_medit_section_is_refused(tmp_path):
    content = written("medit binary").content
    end = int(np.frombuffer(content, "<i4", 1, 28)[0])
    (tmp_path / "mesh.meshb").write_bytes(content[:end] + content[24:end] + content[end:])
    with pytest.raises(MeshError, match="the section 4 occurs twice"):
        read_mesh(tmp_path / "mesh.meshb")


def test_an_invalid_medit_dimension_is_refused(tmp_path):
    content = bytearray(written("medit binary").content)
    assert np.frombuffer(content, "<i4", 1, 20)[0] == 3
    content[20:24] = np.int32(7).tobytes()
    (tmp_path / "mesh.meshb").write_bytes(content)
    with pytest.raises(MeshError, match="its dimension is 7; expected 2 or 3"):
        read_mesh(tmp_path / "mesh.meshb")


def test_binary_faces_with_further_properties_are_refused(tmp_path):
    file = tmp_path / "mesh.ply"
    meshio.write(file, meshio.Mesh(np.eye(3), [("triangle", np.arange(3)[None])]), binary=True)
    file.write_bytes(file.read_bytes().replace(b"end_header", b"property uchar red\nend_header"))
    with pytest.raises(MeshError, match="its faces have more than vertex_indices"):
        read_mesh(file)


def test_an_stl_corner_without_one_coordinate_is_refused(tmp_path):
    corners = ["vertex 0 0 0", "vertex 1 0 0", "vertex 0 1"]
    text = "\n".join(["solid", "facet normal 0 0 1", "outer loop", *corners, "endloop", "endfacet", "endsolid", ""])
    (tmp_path / "mesh.stl").write_text(text)
    with pytest.raises(MeshError, match="its lines are not facets of three vertices each"):
        read_mesh(tmp_path / "mesh.stl")


SU2 = """NDIME= 3
NELEM= 1
10 0 1 2 3 0
NPOIN= 4
0 0 0 0
1 0 0 1
0 1 0 2
0 0 1 3
NMARK= 2
MARKER_TAG= 1
MARKER_ELEMS= 1
5 0 1 2
MARKER_TAG= 2
MARKER_ELEMS= 1
5 0 1 3
"""


def test_markers_of_su2_are_boundaries(tmp_path):
    (tmp_path / "mesh.su2").write_text(SU2)
    mesh = read_mesh(tmp_path / "mesh.su2")
    assert {name: ids.T.tolist() for name, ids in mesh.boundaries.items()} == {"su2:tag:1": [[0, 1, 2]], "su2:tag:2": [[0, 1, 3]]}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("NMARK= 2", "NMARK= 3", "3 markers are declared, 2 were found"),
        ("NMARK= 2\n", "", "0 markers are declared, 2 were found"),
        ("MARKER_ELEMS= 1\n5 0 1 2\n", "", "'MARKER_TAG= 1' was found; expected the beginning of a section"),
        ("5 0 1 2", "5 0 1", "elements have other numbers of nodes than their type or number declares"),
        ("5 0 1 2", "99 0 1 2", "'99' was found; expected the type or the number of nodes of an element"),
        ("0 1 0 2", "0 1 0", "4 nodes are declared, but their numbers contain other text|'3' was found; expected"),
        ("NDIME= 3\n", "NDIME= 3\nNDIME= 3\n", "'NDIME= 3' was found, but NDIME occurred before"),
        ("NDIME= 3\n", "", "it has no NDIME"),
        ("NPOIN= 4", "NPOIN= 4000000000", "4000000000 nodes are declared, more than its .* bytes can hold"),
    ],
)
def test_inconsistent_su2_files_are_refused(old, new, message, tmp_path):
    assert old in SU2
    (tmp_path / "mesh.su2").write_text(SU2.replace(old, new, 1))
    with pytest.raises(MeshError, match=message):
        read_mesh(tmp_path / "mesh.su2")
