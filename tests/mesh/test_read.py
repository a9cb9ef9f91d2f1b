"""Mesh files of many formats come in with their vertices, simplices and groups, or with what is wrong and what to do."""

import sys

import meshio
import numpy as np
import pytest
import skfem

from skfem_stvk import MeshError, StvkWarning
from skfem_stvk.mesh import read_mesh

LEFT = {"left_half": lambda x: x[0] < 0.5, "right:half": lambda x: x[0] > 0.5}
TETS = skfem.MeshTet().refined(2).with_subdomains(LEFT).with_boundaries({"wall": lambda x: x[0] == 0})
TRIANGLES = skfem.MeshTri().refined(2).with_subdomains(LEFT).with_boundaries({"wall": lambda x: x[0] == 0})
SEGMENTS = skfem.MeshLine().refined(2).with_subdomains(LEFT).with_boundaries({"wall": lambda x: x[0] == 0})

CUBE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
HEXAHEDRON = [list(range(8))]
FIVE_TETS = [[0, 1, 3, 4], [1, 2, 3, 6], [1, 4, 5, 6], [3, 4, 6, 7], [1, 3, 4, 6]]


def write(path, points, cells, **more):
    meshio.Mesh(np.array(points, dtype=float), cells, **more).write(path)
    return path


def same_facets(mesh, boundary, given, name):
    """Do the facets join the same vertices, whatever their order?"""
    one, other = np.sort(mesh.boundaries[boundary], axis=0), np.sort(given.facets[:, given.boundaries[name]], axis=0)
    return sorted(one.T.tolist()) == sorted(other.T.tolist())


# formats


@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh"])
@pytest.mark.parametrize("given", [TETS, TRIANGLES], ids=["tetrahedra", "triangles"])
def test_what_scikit_fem_saves_comes_back_with_its_groups(given, ending, tmp_path, capfd):
    given.save(tmp_path / f"mesh.{ending}")
    capfd.readouterr()
    mesh = read_mesh(tmp_path / f"mesh.{ending}")
    assert np.array_equal(mesh.p, given.p) and np.array_equal(mesh.t, given.t)
    assert list(mesh.subdomains) == list(LEFT)
    assert all(np.array_equal(mesh.elements(name), given.subdomains[name]) for name in LEFT)
    assert same_facets(mesh, "wall", given, "wall")
    assert capfd.readouterr() == ("", "")


def test_segments_that_scikit_fem_saves_come_back_with_their_groups(tmp_path):
    SEGMENTS.save(tmp_path / "mesh.vtu")
    mesh = read_mesh(str(tmp_path / "mesh.vtu"))
    assert (mesh.k, mesh.d) == (1, 1)
    assert np.array_equal(mesh.elements("left_half"), SEGMENTS.subdomains["left_half"])
    assert mesh.p[:, mesh.boundaries["wall"]].tolist() == [[[0]]]


@pytest.mark.parametrize("ending", ["avs", "bdf", "f3grid", "inp", "mesh", "meshb", "msh", "su2", "vol", "vtk", "vtu"])
def test_tetrahedra_come_back_from_every_format(ending, tmp_path):
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


def test_an_array_of_many_integers_is_no_group(tmp_path):
    file = write(tmp_path / "mesh.vtu", TETS.p.T, [("tetra", TETS.t.T)], cell_data={"id": [np.arange(TETS.nelements)]})
    assert not read_mesh(file).subdomains


# groups of Gmsh


@pytest.fixture(scope="module")
def two_boxes(tmp_path_factory):
    """Write two boxes that touch, with overlapping groups of volumes and one of surfaces without a name, in many ways."""
    gmsh = pytest.importorskip("gmsh")
    folder = tmp_path_factory.mktemp("gmsh")

    def save(name, **options):
        gmsh.initialize(interruptible=False)
        model, occ = gmsh.model, gmsh.model.occ
        occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(1, 0, 0, 1, 1, 1))])
        occ.synchronize()
        for group, volumes in {"steel": [1], "rubber": [2], "all": [1, 2]}.items():
            model.addPhysicalGroup(3, volumes, name=group)
        model.addPhysicalGroup(2, [1, 2], tag=40)
        for option, value in {"General.Terminal": 0, "Mesh.SaveGroupsOfElements": -1111, **options}.items():
            gmsh.option.setNumber(option.replace("_", "."), value)
        model.mesh.generate(3)
        gmsh.write(str(folder / name))
        gmsh.finalize()
        return folder / name

    return save


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_physical_groups_may_overlap_and_need_no_name(two_boxes, version, binary, capfd):
    file = two_boxes("boxes.msh", Mesh_MshFileVersion=version, Mesh_Binary=binary)
    capfd.readouterr()
    mesh = read_mesh(file)
    assert capfd.readouterr() == ("", "")
    assert set(mesh.subdomains) == {"steel", "rubber", "all"}
    x = mesh.p[0, mesh.t].mean(axis=0)
    assert np.array_equal(mesh.elements("steel"), np.flatnonzero(x < 1))
    assert np.array_equal(mesh.elements("rubber"), np.flatnonzero(x > 1))
    assert np.array_equal(mesh.elements("all"), np.arange(mesh.nt))
    assert len(np.unique(np.sort(mesh.t, axis=0), axis=1).T) == mesh.nt
    assert set(mesh.boundaries) == {"40"}
    assert set(mesh.p[0, mesh.boundaries["40"]].ravel()) == {0, 1}


def test_gmsh_writes_abaqus_files_whose_element_sets_come_in(two_boxes):
    mesh = read_mesh(two_boxes("boxes.inp"))
    x = mesh.p[0, mesh.t].mean(axis=0)
    assert set(mesh.subdomains) == {"Volume1", "Volume2", "steel", "rubber", "all"}
    assert np.array_equal(mesh.elements("steel"), np.flatnonzero(x < 1))
    assert np.array_equal(mesh.elements("Volume2"), np.flatnonzero(x > 1))
    assert set(mesh.p[0, mesh.boundaries["PhysicalSurface40"]].ravel()) == {0, 1}


def test_gmsh_files_that_mix_grouped_and_other_cells_say_how_to_write_them(two_boxes):
    file = two_boxes("all.msh", Mesh_SaveAll=1, Mesh_MshFileVersion=4.1)
    with pytest.raises(MeshError, match=r"could not be read: ValueError: Incompatible cell data.*from Gmsh with Mesh\.SaveAll = 0"):
        read_mesh(file)


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_scikit_fem_loads_the_same_vertices_elements_and_subdomains(two_boxes, version):
    file = two_boxes("boxes.msh", Mesh_MshFileVersion=version)
    mesh = read_mesh(file)
    if version == 4.1:
        other = skfem.MeshTet.load(file)
        assert np.array_equal(mesh.p, other.p) and np.array_equal(mesh.t, other.t)
        assert all(np.array_equal(mesh.elements(name), other.subdomains[name]) for name in ("steel", "rubber"))
    else:  # scikit-fem keeps the copies of elements in two groups
        assert skfem.MeshTet.load(file).nelements == 2 * mesh.nt


def test_copies_within_one_physical_group_are_left_for_the_diagnostics(tmp_path):
    tags = [np.array([1, 1, 2, 2, 2, 1])]
    file = tmp_path / "mesh.msh"
    given = meshio.Mesh(
        np.array(CUBE, dtype=float),
        [("tetra", [*FIVE_TETS, FIVE_TETS[0]])],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"skin": np.array([1, 2]), "core": np.array([2, 3])},
    )
    meshio.write(file, given, file_format="gmsh22")
    mesh = read_mesh(file)
    assert mesh.nt == 6
    assert {name: ids.tolist() for name, ids in mesh.subdomains.items()} == {"1": [0, 1, 5], "core": [2, 3, 4]}


# element sets of Abaqus

INP = """*HEADING
*NODE
1, 0., 0., 0.
2, 1., 0., 0.
30, 0., 1., 0.
4, 0., 0., 1.
5, 1., 1., 1.
6, 2., 1., 1.
** the blocks below are in the order of the file
*ELEMENT, TYPE=S3
1, 1, 2, 30
*ELEMENT, type=C3D4, ELSET=Steel
10, 1, 2, 30, 4
11, 2, 30, 4, 5
*ELEMENT, type=C3D4, ELSET=Rubber
20, 2, 5, 4,
6
*ELEMENT, TYPE=C3D4, ELSET=STEEL
21, 2, 30, 5, 6
"""


def subdomains_of(tmp_path, text):
    (tmp_path / "mesh.inp").write_text(text)
    return {name: ids.tolist() for name, ids in read_mesh(tmp_path / "mesh.inp").subdomains.items()}


def test_element_sets_of_blocks_come_in_though_a_block_names_none_and_a_name_comes_twice(tmp_path):
    assert subdomains_of(tmp_path, INP) == {"Steel": [0, 1, 3], "Rubber": [2]}


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("*ELSET, ELSET=few\n11, 20\n", [1, 2]),
        ("*ELSET, ELSET=few, GENERATE\n11, 21, 10\n", [1, 3]),
        ("*ELSET, ELSET=few\nRubber, STEEL\n", [0, 1, 2, 3]),
        ("*ELSET, ELSET=few\n1, 10\n", [0]),
    ],
)
def test_element_sets_are_lists_ranges_or_other_sets(lines, expected, tmp_path):
    assert subdomains_of(tmp_path, INP + lines) == {"Steel": [0, 1, 3], "Rubber": [2], "few": expected}


def test_an_element_set_that_holds_facets_is_a_boundary(tmp_path):
    subdomains_of(tmp_path, INP + "*ELSET, ELSET=floor\n1\n")
    mesh = read_mesh(tmp_path / "mesh.inp")
    assert mesh.boundaries["floor"].T.tolist() == [[0, 1, 2]]
    assert "floor" not in mesh.subdomains


def test_an_included_file_is_read_with_its_element_sets(tmp_path):
    (tmp_path / "body.inp").write_text(INP)
    assert subdomains_of(tmp_path, "*INCLUDE, INPUT=body.inp\n") == {"Steel": [0, 1, 3], "Rubber": [2]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (INP + "*ELSET, ELSET=few\nSteel, Wood\n", "Element set 'few' names the set 'Wood', which is not defined above it"),
        (INP + "*NODE\n7, 0., 0., 0.\n", r"has 2 \*NODE sections; expected one. An assembly of several parts\?"),
        (INP.replace("TYPE=S3", "TYPE=S17"), "could not be read: Element type not available: S17"),
        (INP.replace("10, 1, 2", "10, 8, 2"), "could not be read: KeyError: .*8"),
        ("*INCLUDE, INPUT=gone.inp\n", "could not be read: FileNotFoundError.*gone.inp"),
    ],
)
def test_abaqus_files_that_do_not_hold_together_are_refused(text, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        subdomains_of(tmp_path, text)


# dimensions of the space


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


def test_a_vertex_that_is_dropped_does_not_lift_the_rest_into_space(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]
    with pytest.warns(StvkWarning, match=r"1 vertex \(3\): on none of the triangles, so dropped"):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", points, [("triangle", [[0, 1, 2]])]))
    assert (mesh.d, mesh.nv) == (2, 3)


# other cells, higher order, unused vertices


def test_cells_that_mark_boundaries_are_not_worth_a_warning(tmp_path):
    cells = [("vertex", [[0]]), ("line", [[0, 1]]), ("quad", [[0, 1, 2, 3]]), ("triangle", [[0, 1, 3]]), ("tetra", FIVE_TETS)]
    mesh = read_mesh(write(tmp_path / "mesh.vtu", CUBE, cells))
    assert (mesh.k, mesh.nt, mesh.nv) == (3, 5, 8)


def test_hexahedra_and_wedges_among_tetrahedra_are_left_out_with_a_warning(tmp_path):
    points = [*CUBE, [0.5, 0.5, 2]]
    cells = [("hexahedron", HEXAHEDRON), ("tetra", [[4, 5, 7, 8], [5, 6, 7, 8]]), ("wedge", [[0, 1, 3, 4, 5, 7]] * 2)]
    with (
        pytest.warns(StvkWarning, match="^1 hexahedron and 2 wedge cells are left out: only tetrahedra are used"),
        pytest.warns(StvkWarning, match=r"^4 vertices \(0, 1, 2, 3\): on none of the tetrahedra, so dropped.*left out\?"),
    ):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", points, cells))
    assert mesh.t.T.tolist() == [[0, 1, 3, 4], [1, 2, 3, 4]]


def test_quadrilaterals_among_triangles_are_left_out_with_a_warning(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    cells = [("quad", [[0, 1, 2, 3]]), ("triangle", [[0, 1, 2], [0, 2, 3]])]
    with pytest.warns(StvkWarning, match="^1 quad cells are left out: only triangles are used"):
        assert read_mesh(write(tmp_path / "mesh.vtu", points, cells)).nt == 2


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ([("hexahedron", HEXAHEDRON)], r"no tetrahedra: 1 hexahedron cells came; .*mesh.to_meshtet\(\)"),
        ([("hexahedron", HEXAHEDRON), ("quad", [[0, 1, 2, 3]]), ("line", [[0, 1]])], "1 hexahedron, 1 quad and 1 line cells came"),
        ([("quad", [[0, 1, 2, 3]]), ("line", [[0, 1]])], r"no triangles: 1 quad and 1 line cells came.*mesh.to_meshtri\(\)"),
        ([("vertex", [[0], [1]])], "no simplices: 2 vertex cells came; expected tetrahedra, triangles or segments"),
    ],
)
def test_a_file_without_simplices_is_refused_with_what_came(cells, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read_mesh(write(tmp_path / "mesh.vtu", CUBE, cells))


def test_a_file_without_cells_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"holds no cells\. Is it cut off, or a cloud of points\?"):
        read_mesh(write(tmp_path / "mesh.mesh", CUBE, []))


@pytest.mark.parametrize("ending", ["vtu", "msh"])
@pytest.mark.parametrize(("cls", "straight"), [(skfem.MeshTet2, TETS), (skfem.MeshTri2, TRIANGLES)], ids=["tetra10", "triangle6"])
def test_elements_of_second_order_are_reduced_to_their_corners_with_a_warning(cls, straight, ending, tmp_path):
    cls.from_mesh(straight).save(tmp_path / f"mesh.{ending}")
    count = straight.nelements
    with pytest.warns(
        StvkWarning, match=f"^{count} (tetra10|triangle6) cells are of higher order: their corner vertices are used"
    ) as said:
        mesh = read_mesh(tmp_path / f"mesh.{ending}")
    assert len(said) == 1
    assert np.array_equal(mesh.p, straight.p) and np.array_equal(mesh.t, straight.t)


@pytest.mark.parametrize("order", [2, 3])
def test_gmsh_elements_of_higher_order_keep_their_groups_without_their_inner_nodes(two_boxes, order):
    file = two_boxes("curved.msh", Mesh_ElementOrder=order, Mesh_MshFileVersion=2.2)
    with pytest.warns(StvkWarning, match=r"tetra\d+ cells are of higher order") as said:
        mesh = read_mesh(file)
    assert len(said) == 1
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
        StvkWarning, match=r"^3 vertices \(0, 4, 10\): on none of the tetrahedra, so dropped; the later ones move up"
    ):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", points, cells, cell_data=data))
    assert mesh.p.T.tolist() == CUBE and mesh.t.T.tolist() == FIVE_TETS
    assert mesh.subdomains["part:2"].tolist() == [4]
    assert mesh.boundaries["part:2"].T.tolist() == [[1, 2, 3]]


def test_facets_on_dropped_vertices_leave_their_boundary_with_a_warning(tmp_path):
    cells = [("triangle", [[0, 1, 3], [0, 1, 8]]), ("tetra", FIVE_TETS)]
    data = {"part": [np.array([1, 1]), np.array([1, 1, 1, 1, 1])]}
    with (
        pytest.warns(StvkWarning, match=r"1 vertex \(8\): on none of the tetrahedra"),
        pytest.warns(StvkWarning, match=r"Boundary 'part:1': 1 facet \(1\) of 2 are left out: they have dropped vertices"),
    ):
        mesh = read_mesh(write(tmp_path / "mesh.vtu", [*CUBE, [9, 9, 9]], cells, cell_data=data))
    assert mesh.boundaries["part:1"].T.tolist() == [[0, 1, 3]]


# files that cannot be read


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(MeshError, match=r"gone\.msh is no file; expected the path of a mesh file"):
        read_mesh(tmp_path / "gone.msh")


def test_an_unknown_extension_is_refused_with_the_known_ones(tmp_path):
    file = tmp_path / "mesh.step"
    file.touch()
    with pytest.raises(MeshError, match=r"unknown extension '\.step'; known: .*\.inp.*\.msh.*\.vtu.*convert it"):
        read_mesh(file)


@pytest.mark.parametrize("ending", ["msh", "vtu", "vtk", "inp"])
def test_an_empty_file_is_refused(ending, tmp_path):
    (tmp_path / f"mesh.{ending}").touch()
    with pytest.raises(MeshError, match=r"is empty\. Did the program that writes it fail"):
        read_mesh(tmp_path / f"mesh.{ending}")


@pytest.mark.parametrize(("ending", "package"), [("med", "h5py"), ("h5m", "h5py"), ("exo", "netCDF4")])
def test_a_format_that_needs_another_package_names_it(ending, package, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / f"mesh.{ending}").write_text("data")
    with pytest.raises(MeshError, match=rf"Reading \.{ending} files needs the package {package}.*: pip install {package}"):
        read_mesh(tmp_path / f"mesh.{ending}")


@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.9])
@pytest.mark.parametrize(
    ("ending", "options"),
    [
        ("msh", {"file_format": "gmsh"}),
        ("msh", {"file_format": "gmsh", "binary": False}),
        ("msh", {"file_format": "gmsh22"}),
        ("msh", {"file_format": "gmsh22", "binary": False}),
        ("vtu", {}),
        ("vtk", {}),
        ("inp", {}),
    ],
)
def test_a_file_that_is_cut_off_is_refused_and_nothing_is_printed(ending, options, part, tmp_path, capfd):
    file = tmp_path / f"mesh.{ending}"
    meshio.write(file, meshio.Mesh(TETS.p.T, [("tetra", TETS.t.T)]), **options)
    file.write_bytes(file.read_bytes()[: int(part * file.stat().st_size)])
    capfd.readouterr()
    with pytest.raises(MeshError, match=rf"mesh\.{ending}.*(Is it cut off, or|outside 0)"):
        read_mesh(file)
    assert capfd.readouterr() == ("", "")


def test_gmsh_files_that_end_between_their_sections_are_refused(tmp_path):
    file = tmp_path / "mesh.msh"
    meshio.write(file, meshio.Mesh(TETS.p.T, [("tetra", TETS.t.T)]), file_format="gmsh22", binary=False)
    file.write_text(file.read_text().replace("$EndElements\n", ""))
    with pytest.raises(MeshError, match=r"\$Elements not closed by \$EndElements"):
        read_mesh(file)


def test_indices_beyond_the_vertices_are_refused_by_the_name_of_the_file(tmp_path):
    file = write(tmp_path / "mesh.vtu", CUBE, [("tetra", [*FIVE_TETS, [0, 1, 2, 8]])])
    with pytest.raises(MeshError, match=r"mesh\.vtu: 1 element \(5\): vertex ids outside 0 \.\.\. 7"):
        read_mesh(file)


def test_copies_of_an_element_in_no_group_are_left_for_the_diagnostics(tmp_path):
    """Gmsh writes an element once a group; a copy without a group is not one of those."""
    t = np.array([*FIVE_TETS, FIVE_TETS[4]])
    tags = [np.array([1, 1, 1, 2, 0, 0])]
    names = {"one": np.array([1, 3]), "two": np.array([2, 3])}
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    given = meshio.Mesh(np.array(CUBE, dtype=float), [("tetra", t)], cell_data=data, field_data=names)
    meshio.write(tmp_path / "mesh.msh", given, file_format="gmsh22")
    mesh = read_mesh(tmp_path / "mesh.msh")
    assert mesh.nt == 6


def test_empty_blocks_do_not_count(tmp_path):
    from skfem_stvk.mesh import read

    raw = meshio.Mesh(np.array(CUBE, dtype=float), [("triangle", [[0, 1, 2], [0, 2, 3]]), ("tetra", np.empty((0, 4), dtype=int))])
    assert read.dimension(raw, tmp_path) == 2
