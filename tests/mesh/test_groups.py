"""Physical groups of Gmsh and element sets of Abaqus become subdomains and boundaries."""

import meshio
import numpy as np
import pytest
import skfem
from meshfiles import CUBE, FIVE_TETS

from skfem_stvk import MeshError
from skfem_stvk.mesh import read_mesh


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


def test_element_sets_of_abaqus_files_by_gmsh_are_read(two_boxes):
    mesh = read_mesh(two_boxes("boxes.inp"))
    x = mesh.p[0, mesh.t].mean(axis=0)
    assert set(mesh.subdomains) == {"Volume1", "Volume2", "steel", "rubber", "all"}
    assert np.array_equal(mesh.elements("steel"), np.flatnonzero(x < 1))
    assert np.array_equal(mesh.elements("Volume2"), np.flatnonzero(x > 1))
    assert set(mesh.p[0, mesh.boundaries["PhysicalSurface40"]].ravel()) == {0, 1}


@pytest.mark.parametrize(
    ("version", "binary", "parametric"), [(2.2, 0, 0), (2.2, 1, 0), (4.0, 0, 0), (4.0, 0, 1), (4.1, 0, 1), (4.1, 1, 0), (4.1, 1, 1)]
)
def test_options_of_gmsh_do_not_change_the_mesh_and_its_groups(version, binary, parametric, two_boxes):
    """Files with all elements have many blocks without a group; parametric nodes have further numbers."""
    options = {"Mesh_SaveAll": int(version > 3), "Mesh_MshFileVersion": version, "Mesh_Binary": binary}
    mesh = read_mesh(two_boxes("all.msh", **options, Mesh_SaveParametric=parametric))
    plain = read_mesh(two_boxes("boxes.msh"))
    assert np.isclose(volumes(mesh).sum(), 2) and mesh.nt == plain.nt and mesh.subdomains.keys() == {"steel", "rubber", "all"}
    assert all(
        np.isclose(volumes(mesh)[mesh.subdomains[name]].sum(), size) for name, size in (("steel", 1), ("rubber", 1), ("all", 2))
    )
    assert {name: facets.shape[1] for name, facets in mesh.boundaries.items()} == {
        name: facets.shape[1] for name, facets in plain.boundaries.items()
    }


def volumes(mesh):
    return np.abs(np.linalg.det((mesh.p[:, mesh.t[1:]] - mesh.p[:, None, mesh.t[0]]).transpose(2, 0, 1))) / 6


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


def test_copies_of_an_element_in_no_group_are_left_for_the_diagnostics(tmp_path):
    """Gmsh writes an element once per group, so a copy without a group is a fault."""
    t = np.array([*FIVE_TETS, FIVE_TETS[4]])
    tags = [np.array([1, 1, 1, 2, 0, 0])]
    names = {"one": np.array([1, 3]), "two": np.array([2, 3])}
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    given = meshio.Mesh(np.array(CUBE, dtype=float), [("tetra", t)], cell_data=data, field_data=names)
    meshio.write(tmp_path / "mesh.msh", given, file_format="gmsh22")
    mesh = read_mesh(tmp_path / "mesh.msh")
    assert mesh.nt == 6


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


def test_element_sets_of_blocks_are_read_with_unnamed_and_repeated_sets(tmp_path):
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


def test_an_element_set_of_facets_is_a_boundary(tmp_path):
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
        (INP.replace("TYPE=S3", "TYPE=S17"), "could not be read: its elements have the type S17, which is not read"),
        (INP.replace("10, 1, 2", "10, 8, 2"), "could not be read: its elements: 1 node .8. not defined"),
        ("*INCLUDE, INPUT=gone.inp\n", "could not be read: .*gone.inp., which it needs, is missing or not a regular file"),
    ],
)
def test_inconsistent_abaqus_files_are_refused(text, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        subdomains_of(tmp_path, text)
