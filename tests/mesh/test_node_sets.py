"""Node sets of files: *NSET of Abaqus, physical points and curves of Gmsh, point sets of meshio."""

import meshio
import numpy as np
import pytest
from meshfiles import CUBE, FIVE_TETS
from test_groups import INP

from skfem_stvk import MeshError, StvkWarning
from skfem_stvk.mesh import read_mesh


def node_sets_of(tmp_path, text):
    (tmp_path / "mesh.inp").write_text(text)
    return {name: ids.tolist() for name, ids in read_mesh(tmp_path / "mesh.inp").node_sets.items()}


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("*NSET, NSET=few\n30, 6, 1\n", {"few": [0, 2, 5]}),
        ("*NSET, NSET=few\n30,\n6\n", {"few": [2, 5]}),
        ("*NSET, NSET=few, GENERATE\n1, 5, 4\n", {"few": [0, 4]}),
        ("*nset, nset=one\n1\n*NSET, NSET=two\n2\n*NSET, NSET=both\nONE, two\n", {"one": [0], "two": [1], "both": [0, 1]}),
        ("*NSET, NSET=few\n1\n*NSET, NSET=FEW\n2, 1\n", {"few": [0, 1]}),
        ("*NSET, NSET=few\n", {}),
    ],
)
def test_node_sets_are_lists_ranges_or_other_sets(lines, expected, tmp_path):
    assert node_sets_of(tmp_path, INP + lines) == expected


def test_nodes_may_name_their_set_and_an_included_file_too(tmp_path):
    (tmp_path / "body.inp").write_text(INP.replace("*NODE", "*NODE, NSET=all") + "*NSET, NSET=pin\n30\n")
    assert node_sets_of(tmp_path, "*INCLUDE, INPUT=body.inp\n") == {"all": [0, 1, 2, 3, 4, 5], "pin": [2]}


def test_a_reference_to_an_undefined_set_is_refused(tmp_path):
    with pytest.raises(
        MeshError, match=r"Node set 'few' names the set 'Wood', which is not defined above it\. Move or add its \*NSET"
    ):
        node_sets_of(tmp_path, INP + "*NSET, NSET=few\nWood\n")


def test_nodes_on_no_element_are_removed_from_their_set_with_a_warning(tmp_path):
    text = INP.replace("6, 2., 1., 1.\n", "6, 2., 1., 1.\n7, 9., 9., 9.\n").replace(
        "30, 0., 1., 0.\n", "8, 9., 9., 9.\n30, 0., 1., 0.\n"
    )
    text += "*NSET, NSET=pin\n30, 7\n*NSET, NSET=reference\n8\n"
    with (
        pytest.warns(StvkWarning, match=r"Node set 'pin': 1 vertex \(7\) of 2 are left out, because they are on no element"),
        pytest.warns(StvkWarning, match=r"Node set 'reference': 1 vertex \(2\) of 1"),
        pytest.warns(StvkWarning, match=r"^2 vertices \(2, 7\): dropped, because they are on none of the tetrahedra"),
    ):
        assert node_sets_of(tmp_path, text) == {"pin": [2]}


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("order", [1, 2])
def test_physical_points_and_curves_of_gmsh_are_node_sets(version, order, gmsh, tmp_path):
    gmsh.initialize(interruptible=False)
    model = gmsh.model
    model.occ.addBox(0, 0, 0, 1, 1, 1)
    model.occ.synchronize()
    points = {tag: model.getValue(0, tag, []) for _, tag in model.getEntities(0)}
    edges = [tag for _, tag in model.getEntities(1) if abs(model.getBoundingBox(1, tag)[3]) < 1e-6]
    model.addPhysicalGroup(3, [1], name="body")
    model.addPhysicalGroup(0, [tag for tag, x in points.items() if x[0] == 0], name="pins")
    model.addPhysicalGroup(0, [tag for tag, x in points.items() if x[0] == x[2] == 1], tag=7)
    model.addPhysicalGroup(1, edges, name="rim")
    for option, value in {"General.Terminal": 0, "Mesh.MshFileVersion": version, "Mesh.ElementOrder": order}.items():
        gmsh.option.setNumber(option, value)
    model.mesh.generate(3)
    gmsh.write(str(tmp_path / "box.msh"))
    gmsh.finalize()
    mesh = read_mesh(tmp_path / "box.msh")
    corners = ((mesh.p == 0) | (mesh.p == 1)).all(axis=0)
    on_edge = ((mesh.p[1:] == 0) | (mesh.p[1:] == 1)).any(axis=0)
    assert set(mesh.node_sets) == {"pins", "7", "rim"}
    assert np.array_equal(mesh.node_sets["pins"], np.flatnonzero(corners & (mesh.p[0] == 0)))
    assert np.array_equal(mesh.node_sets["7"], np.flatnonzero(corners & (mesh.p[0] == 1) & (mesh.p[2] == 1)))
    assert len(edges) == 4 and np.array_equal(mesh.node_sets["rim"], np.flatnonzero(on_edge & (np.abs(mesh.p[0]) < 1e-9)))


def test_point_sets_of_meshio_become_node_sets(tmp_path, monkeypatch):
    raw = meshio.Mesh(np.array(CUBE, dtype=float), [("tetra", np.array(FIVE_TETS))], point_sets={"pin": np.array([3, 1])})
    (tmp_path / "mesh.cgns").write_text("data")
    monkeypatch.setattr("meshio.read", lambda path: raw)
    assert read_mesh(tmp_path / "mesh.cgns").node_sets["pin"].tolist() == [1, 3]


def test_middle_nodes_are_in_their_set_or_removed_without_a_further_warning(tmp_path, monkeypatch):
    middle = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    raw = meshio.Mesh(
        np.concatenate([corners, corners[middle].mean(axis=1)]),
        [("tetra10", np.arange(10)[None])],
        point_sets={"edge": np.array([0, 1, 4])},
    )
    (tmp_path / "mesh.cgns").write_text("data")
    monkeypatch.setattr("meshio.read", lambda path: raw)
    assert read_mesh(tmp_path / "mesh.cgns").node_sets["edge"].tolist() == [0, 1, 4]
    with pytest.warns(StvkWarning, match="of higher order") as caught:
        mesh = read_mesh(tmp_path / "mesh.cgns", degree=1)
    assert len(caught) == 1 and mesh.node_sets["edge"].tolist() == [0, 1]
