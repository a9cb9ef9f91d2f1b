"""Mesh files of many formats are read with vertices and elements; everything left out is reported."""

import re

import meshio
import numpy as np
import pytest
import skfem
from meshfiles import CUBE, FIVE_TETS, HEXAHEDRON, LEFT, SEGMENTS, TETS, TRIANGLES, same_facets, write

from skfem_stvk import MeshError, StvkWarning
from skfem_stvk.mesh import content, read_mesh
from skfem_stvk.mesh.formats import CHECKS


@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh"])
@pytest.mark.parametrize("given", [TETS, TRIANGLES], ids=["tetrahedra", "triangles"])
def test_files_of_scikit_fem_are_read_with_their_groups(given, ending, tmp_path, capfd):
    given.save(tmp_path / f"mesh.{ending}")
    capfd.readouterr()
    mesh = read_mesh(tmp_path / f"mesh.{ending}")
    assert np.array_equal(mesh.p, given.p) and np.array_equal(mesh.t, given.t)
    assert list(mesh.subdomains) == list(LEFT)
    assert all(np.array_equal(mesh.elements(name), given.subdomains[name]) for name in LEFT)
    assert same_facets(mesh, "wall", given, "wall")
    assert capfd.readouterr() == ("", "")


def test_segments_of_scikit_fem_are_read_with_their_groups(tmp_path):
    SEGMENTS.save(tmp_path / "mesh.vtu")
    mesh = read_mesh(str(tmp_path / "mesh.vtu"))
    assert (mesh.k, mesh.d) == (1, 1)
    assert np.array_equal(mesh.elements("left_half"), SEGMENTS.subdomains["left_half"])
    assert mesh.p[:, mesh.boundaries["wall"]].tolist() == [[[0]]]


@pytest.mark.parametrize("ending", ["bdf", "ele", "inp", "mesh", "meshb", "msh", "su2", "vtk", "vtu"])
def test_tetrahedra_are_read_from_every_format(ending, tmp_path):
    mesh = read_mesh(write(tmp_path / f"mesh.{ending}", TETS.p.T, [("tetra", TETS.t.T)]))
    assert np.allclose(mesh.p, TETS.p, atol=1e-9)
    assert np.array_equal(np.sort(mesh.t, axis=0), np.sort(TETS.t, axis=0))


@pytest.mark.parametrize(("ending", "name"), [("vtu", "MaterialIDs"), ("vtk", "MaterialIDs"), ("mesh", "medit:ref")])
def test_an_array_of_a_few_integers_becomes_subdomains_and_boundaries(ending, name, tmp_path):
    file = tmp_path / f"mesh.{ending}"
    data = {name: [np.array([7, 7, -2, 7, 9]), np.array([9, 4])], "temperature": [np.ones(5), np.ones(2)]}
    write(file, CUBE, [("tetra", FIVE_TETS), ("triangle", [[0, 1, 3], [1, 2, 3]])], cell_data=data)
    mesh = read_mesh(file)
    assert {key: ids.tolist() for key, ids in mesh.subdomains.items()} == {
        f"{name}:-2": [2],
        f"{name}:7": [0, 1, 3],
        f"{name}:9": [4],
    }
    assert {key: ids.T.tolist() for key, ids in mesh.boundaries.items()} == {f"{name}:4": [[1, 2, 3]], f"{name}:9": [[0, 1, 3]]}


def test_scalars_of_a_vtk_file_may_state_their_number_of_components(tmp_path):
    file = tmp_path / "mesh.vtk"
    meshio.Mesh(np.array(CUBE, dtype=float), [("tetra", FIVE_TETS)]).write(file, "vtk", binary=False)
    with file.open("a") as text:
        text.write("CELL_DATA 5\nSCALARS part int 1\nLOOKUP_TABLE default\n1 1 2 2 2\n")
    assert {key: ids.tolist() for key, ids in read_mesh(file).subdomains.items()} == {"part:1": [0, 1], "part:2": [2, 3, 4]}


@pytest.mark.parametrize("stated", [True, False])
def test_an_xdmf_file_may_state_the_number_of_its_elements(stated, tmp_path):
    file = write(tmp_path / "mesh.xdmf", CUBE, [("tetra", FIVE_TETS)])
    if not stated:
        file.write_text(re.sub(r' NumberOfElements="\d+"', "", file.read_text()))
    assert CHECKS[".xdmf"](file) == (None, 5 if stated else None)
    assert read_mesh(file).nt == 5


def test_an_array_of_many_integers_is_no_group(tmp_path):
    file = write(tmp_path / "mesh.vtu", TETS.p.T, [("tetra", TETS.t.T)], cell_data={"id": [np.arange(TETS.nelements)]})
    assert not read_mesh(file).subdomains


@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh", "inp"])
def test_a_membrane_in_space_keeps_its_third_coordinate(ending, tmp_path):
    points = np.column_stack([TRIANGLES.p.T, TRIANGLES.p[0] ** 2])
    mesh = read_mesh(write(tmp_path / f"mesh.{ending}", points, [("triangle", TRIANGLES.t.T)]))
    assert (mesh.k, mesh.d) == (2, 3)
    assert np.array_equal(mesh.p.T, points)


def test_an_upright_wall_is_a_membrane_in_space(tmp_path):
    x, z = TRIANGLES.p
    mesh = read_mesh(write(tmp_path / "mesh.vtu", np.column_stack([x, 0 * x, z]), [("triangle", TRIANGLES.t.T)]))
    assert mesh.d == 3


def test_triangles_at_one_height_are_in_the_plane(tmp_path):
    points = np.column_stack([TRIANGLES.p.T, np.full(TRIANGLES.nvertices, 2.5)])
    mesh = read_mesh(write(tmp_path / "mesh.vtu", points, [("triangle", TRIANGLES.t.T)]))
    assert np.array_equal(mesh.p, TRIANGLES.p)


@pytest.mark.parametrize(("last", "d"), [([0, 0, 0], 1), ([0, 1, 0], 2), ([0, 1, 1], 3), ([0, 0, 1], 3)])
def test_segments_are_in_as_many_dimensions_as_they_need(last, d, tmp_path):
    mesh = read_mesh(write(tmp_path / "mesh.vtu", [[0, 0, 0], [1, 0, 0], [2, *last[1:]]], [("line", [[0, 1], [1, 2]])]))
    assert (mesh.k, mesh.d) == (1, d)


@pytest.mark.parametrize("ending", ["vtu", "msh"])
def test_triangles_at_one_height_stay_in_space_on_request(ending, tmp_path):
    points = np.column_stack([TRIANGLES.p.T, np.full(TRIANGLES.nvertices, 2.5)])
    mesh = read_mesh(write(tmp_path / f"mesh.{ending}", points, [("triangle", TRIANGLES.t.T)]), dimension=3)
    assert np.array_equal(mesh.p.T, points)


def test_a_straight_cable_has_the_requested_number_of_dimensions(tmp_path):
    file = write(tmp_path / "mesh.vtu", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [("line", [[0, 1], [1, 2]])])
    for d in (1, 2, 3):
        assert read_mesh(file, dimension=d).d == d


def test_a_dimension_that_is_too_small_is_refused(tmp_path):
    file = write(tmp_path / "mesh.vtu", [[0, 0, 0], [1, 0, 0], [1, 1, 0]], [("line", [[0, 1], [1, 2]])])
    with pytest.raises(MeshError, match=r"mesh.vtu: dimension = 1; expected at least 2: coordinate y is needed"):
        read_mesh(file, dimension=1)
    with pytest.raises(MeshError, match="dimension = 4; expected"):
        read_mesh(file, dimension=4)


#: A cube with two ropes from its top to two hooks. A third rope follows an edge of a tetrahedron, and a sail joins an edge and a
#: hook.
HOOKED = [*CUBE, [9, 9, 9], [0, 0, 3], [1, 0, 3]]
ROPES, EDGE, SAIL = [[9, 4], [5, 10]], [[0, 1]], [[4, 5, 9]]


def hooked(path):
    cells = [("line", np.array(ROPES)), ("line", np.array(EDGE)), ("triangle", np.array(SAIL)), ("vertex", np.array([[9], [10]]))]
    cells.append(("tetra", np.array(FIVE_TETS)))
    tags = {"gmsh:physical": [np.full(len(block), tag) for tag, (_, block) in enumerate(cells, start=1)]}
    tags["gmsh:geometrical"] = tags["gmsh:physical"]
    names = {"ropes": [1, 1], "stiffener": [2, 1], "sail": [3, 2], "hooks": [4, 0], "cube": [5, 3]}
    data = {name: np.array(values) for name, values in names.items()}
    meshio.Mesh(np.array(HOOKED, dtype=float), cells, cell_data=tags, field_data=data).write(path, file_format="gmsh22")
    return path


def test_nodes_of_ropes_and_sails_are_retained_by_keep(tmp_path):
    file = hooked(tmp_path / "mesh.msh")
    with pytest.warns(StvkWarning, match=r"^1 vertex \(8\): dropped, because they are on none of the tetrahedra"):
        mesh = read_mesh(file, keep=["ropes", "sail"])
    assert mesh.p.T.tolist() == [*CUBE, *HOOKED[9:]]
    assert {name: ends.T.tolist() for name, ends in mesh.lines.items()} == {"ropes": [[8, 4], [5, 9]], "stiffener": EDGE}
    assert mesh.boundaries["sail"].T.tolist() == [[4, 5, 8]] and mesh.node_sets["hooks"].tolist() == [8, 9]


def test_nodes_of_ropes_and_sails_are_dropped_without_keep(tmp_path):
    with pytest.warns(StvkWarning) as caught:
        mesh = read_mesh(hooked(tmp_path / "mesh.msh"))
    assert any("3 vertices (8, 9, 10)" in str(one.message) and "keep=[names]" in str(one.message) for one in caught)
    assert mesh.p.T.tolist() == CUBE and list(mesh.lines) == ["stiffener"] and "hooks" not in mesh.node_sets


def test_ropes_to_hooks_make_a_flat_sheet_three_dimensional(tmp_path):
    cells = [("line", np.array([[0, 3]])), ("triangle", np.array([[0, 1, 2]]))]
    tags = {"gmsh:physical": [np.array([1]), np.array([2])], "gmsh:geometrical": [np.array([1]), np.array([2])]}
    names = {"rope": np.array([1, 1]), "sheet": np.array([2, 2])}
    file = tmp_path / "mesh.msh"
    raw = meshio.Mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2.0]]), cells, cell_data=tags, field_data=names)
    raw.write(file, file_format="gmsh22")
    mesh = read_mesh(file, keep="rope")
    assert (mesh.d, mesh.nv, mesh.boundaries["rope"].tolist()) == (3, 4, [[0], [3]])


def test_ropes_and_sails_of_quadratic_elements_are_on_their_edges(tmp_path):
    """A middle node of an edge of no quadratic element has no number in scikit-fem's numbering."""
    with pytest.warns(StvkWarning, match="1 vertex"):
        straight = read_mesh(hooked(tmp_path / "mesh.msh"), keep=["ropes", "sail"])
    with pytest.raises(MeshError, match=r"degree = 2, but 1 element \(0\) of 'sail' is on no edge of the other elements"):
        straight.with_degree(2)
    with pytest.warns(StvkWarning):
        mesh = read_mesh(hooked(tmp_path / "mesh.msh"), degree=2)
    assert mesh.lines["stiffener"][:2].T.tolist() == EDGE
    assert mesh.p[:, mesh.lines["stiffener"][2]].T.tolist() == [[0.5, 0, 0]]
    raw = meshio.read(write(tmp_path / "mesh.vtu", mesh.p.T, [("tetra10", mesh.t.T), ("line3", [[0, 1, 8], [0, 6, 9]])]))
    raw.cell_sets = {"ropes": [np.array([], dtype=int), np.array([0, 1])]}
    with pytest.raises(MeshError, match=r"Lines 'ropes': 1 segment \(1\) of 2 are on no edge of the quadratic elements"):
        content.content_of(raw, "mesh", keep=["ropes"])


def test_a_dropped_vertex_does_not_make_a_flat_mesh_three_dimensional(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]
    with pytest.warns(StvkWarning, match=r"1 vertex \(3\): dropped, because they are on none of the triangles"):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", points, [("triangle", [[0, 1, 2]])]))
    assert (mesh.d, mesh.nv) == (2, 3)


def test_cells_that_mark_boundaries_cause_no_warning(tmp_path):
    cells = [("vertex", [[0]]), ("line", [[0, 1]]), ("quad", [[0, 1, 2, 3]]), ("triangle", [[0, 1, 3]]), ("tetra", FIVE_TETS)]
    mesh = read_mesh(write(tmp_path / "mesh.vtu", CUBE, cells))
    assert (mesh.k, mesh.nt, mesh.nv) == (3, 5, 8)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (
            [("hexahedron", HEXAHEDRON), ("tetra", [[4, 5, 7, 8], [5, 6, 7, 8]])],
            r"a quadrilateral face is next to two triangles, at 4 nodes \(4, 5, 6, 7\) of the file",
        ),
    ],
)
def test_two_kinds_of_elements_in_one_file_are_refused_by_name(cells, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read_mesh(write(tmp_path / "mesh.vtu", [*CUBE, [0.5, 0.5, 2]], cells))


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([("vertex", [[0], [1]])], "no elements; expected tetrahedra, hexahedra, .* or segments, got 2 vertex cells"),
    ],
)
def test_a_file_without_elements_is_refused_with_its_contents(cells, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read_mesh(write(tmp_path / "mesh.vtu", CUBE, cells))


def test_a_file_without_cells_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"holds no cells\. Is it cut off, or a cloud of points\?"):
        read_mesh(write(tmp_path / "mesh.mesh", CUBE, []))


@pytest.mark.parametrize("ending", ["vtu", "msh"])
@pytest.mark.parametrize(("cls", "straight"), [(skfem.MeshTet2, TETS), (skfem.MeshTri2, TRIANGLES)], ids=["tetra10", "triangle6"])
def test_quadratic_elements_are_reduced_to_corners_on_request_with_a_warning(cls, straight, ending, tmp_path):
    cls.from_mesh(straight).save(tmp_path / f"mesh.{ending}")
    count = straight.nelements
    with pytest.warns(
        StvkWarning, match=f"^{count} (tetra10|triangle6) cells are of higher order: their corner vertices are used"
    ) as caught:
        mesh = read_mesh(tmp_path / f"mesh.{ending}", degree=1)
    assert len(caught) == 1
    assert np.array_equal(mesh.p, straight.p) and np.array_equal(mesh.t, straight.t)


def test_gmsh_elements_of_third_order_keep_their_groups_without_their_inner_nodes(two_boxes):
    file = two_boxes("curved.msh", Mesh_ElementOrder=3, Mesh_MshFileVersion=2.2)
    with pytest.warns(StvkWarning, match=r"tetra\d+ cells are of higher order") as caught:
        mesh = read_mesh(file)
    assert len(caught) == 1
    straight = read_mesh(two_boxes("straight.msh", Mesh_MshFileVersion=2.2))
    assert (mesh.nv, mesh.nt) == (straight.nv, straight.nt)
    assert {name: len(ids) for name, ids in mesh.subdomains.items()} == {
        name: len(ids) for name, ids in straight.subdomains.items()
    }
    assert mesh.boundaries["40"].shape == straight.boundaries["40"].shape


def test_vertices_on_no_element_are_dropped_and_the_groups_renumbered(tmp_path):
    points = np.insert(np.array(CUBE, dtype=float), [0, 3, 8], 9.0, axis=0)
    number = np.delete(np.arange(11), [0, 4, 10])
    cells = [("triangle", number[[[0, 1, 3], [1, 2, 3]]]), ("tetra", number[FIVE_TETS])]
    data = {"part": [np.array([1, 2]), np.array([1, 1, 1, 1, 2])]}
    with pytest.warns(
        StvkWarning,
        match=r"^3 vertices \(0, 4, 10\): dropped, because they are on none of the tetrahedra; later vertices are renumbered",
    ):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", points, cells, cell_data=data))
    assert mesh.p.T.tolist() == CUBE and mesh.t.T.tolist() == FIVE_TETS
    assert mesh.subdomains["part:2"].tolist() == [4]
    assert mesh.boundaries["part:2"].T.tolist() == [[1, 2, 3]]


def test_facets_on_dropped_vertices_leave_their_boundary_with_a_warning(tmp_path):
    cells = [("triangle", [[0, 1, 3], [0, 1, 8]]), ("tetra", FIVE_TETS)]
    data = {"part": [np.array([1, 1]), np.array([1, 1, 1, 1, 1])]}
    with (
        pytest.warns(StvkWarning, match=r"1 vertex \(8\): dropped, because they are on none of the tetrahedra"),
        pytest.warns(StvkWarning, match=r"Boundary 'part:1': 1 facet \(1\) of 2 are left out: they have dropped vertices"),
    ):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", [*CUBE, [9, 9, 9]], cells, cell_data=data))
    assert mesh.boundaries["part:1"].T.tolist() == [[0, 1, 3]]


def test_empty_blocks_do_not_count(tmp_path):
    raw = meshio.Mesh(np.array(CUBE, dtype=float), [("triangle", [[0, 1, 2], [0, 2, 3]]), ("tetra", np.empty((0, 4), dtype=int))])
    assert content.base_of(raw, "mesh").name == "triangles"


@pytest.mark.parametrize("path", [None, 3, "", "a\0.msh", "x" * 300 + ".msh", 5_000 * "x"])
def test_an_invalid_path_is_refused(path):
    with pytest.raises(MeshError, match=r"^path = .*; expected the path of a mesh file"):
        read_mesh(path)
