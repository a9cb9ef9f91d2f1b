"""Written meshes are read back unchanged."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import skfem

from skfem_stvk import ElementMesh, MeshError, StvkError, embedded_mesh, read_mesh, write_mesh
from skfem_stvk.mesh import box, cylinder


def crooked(mesh):
    """Return the mesh with displaced nodes, so that no coordinate has a short decimal representation."""
    rng = np.random.default_rng(3)
    return replace(mesh, p=mesh.p / 3 + 0.02 * rng.random(mesh.p.shape))


def named(mesh):
    """Return the mesh with overlapping subdomains, overlapping boundaries in another order, and node sets."""
    last = np.flatnonzero(mesh.p[0] == mesh.p[0].max())
    backwards = {name: np.asarray(facets)[:, ::-1] for name, facets in mesh.boundaries.items()}
    return replace(
        mesh,
        boundaries=backwards | {"both & <one>": np.concatenate([backwards["right"], backwards["left"]], axis=1)},
        subdomains={"first": [0, 1], "left": [1], 'all "of" it': np.arange(mesh.nt)},
        node_sets={"tip": last, "one": [int(last[0])]},
    )


BODIES = {
    "segments": lambda: named(box(2.0, 5)),
    "triangles": lambda: named(box((2, 1), (3, 2))),
    "quadrilaterals": lambda: named(box((2, 1), (3, 2), "quadrilaterals")),
    "tetrahedra": lambda: named(box((2, 1, 1), (2, 1, 1))),
    "hexahedra": lambda: named(box((2, 1, 1), (2, 1, 2), "hexahedra")),
    "quadratic segments": lambda: named(box(2.0, 5)).with_degree(2),
    "quadratic triangles": lambda: named(box((2, 1), (3, 2))).with_degree(2),
    "quadratic tetrahedra": lambda: named(box((2, 1, 1), (2, 1, 1))).with_degree(2),
    "cylinder": lambda: cylinder(1.0, 2.0, (2, 2), inner_radius=0.5),
    "bracket": embedded_mesh,
}


def in_space(mesh, heights):
    return replace(mesh, p=np.append(mesh.p, np.broadcast_to(heights, (3 - mesh.d, mesh.nv)), axis=0))


def assert_same(again, mesh):
    assert again.element == mesh.element and again.d == mesh.d
    assert np.array_equal(again.p, mesh.p) and np.array_equal(again.t, mesh.t)
    assert set(again.subdomains) == set(mesh.subdomains) and set(again.boundaries) == set(mesh.boundaries)
    for name in mesh.subdomains:
        assert np.array_equal(again.elements(name), np.sort(mesh.elements(name))), name
    for name, facets in mesh.boundaries.items():
        if mesh.k == 1:
            facets = np.sort(facets)
            assert np.array_equal(np.sort(again.boundaries[name]), facets), name
        else:
            assert np.array_equal(again.boundaries[name], facets), name
    assert {name: list(ids) for name, ids in again.node_sets.items()} == {name: sorted(ids) for name, ids in mesh.node_sets.items()}


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_a_written_mesh_is_read_back_bitwise(name, tmp_path):
    mesh = crooked(BODIES[name]())
    again = read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh))
    assert_same(again, mesh)
    again = read_mesh(write_mesh(tmp_path / "again.vtu", again))
    assert_same(again, mesh)
    assert (tmp_path / "again.vtu").read_bytes() == (tmp_path / "mesh.vtu").read_bytes()


@pytest.mark.parametrize("height", [0.0, 7.5, "not flat"])
@pytest.mark.parametrize("name", ["segments", "quadrilaterals", "quadratic triangles"])
def test_meshes_in_space_stay_in_space(name, height, tmp_path):
    mesh = BODIES[name]()
    mesh = in_space(mesh, mesh.p[0] ** 2 if height == "not flat" else height)
    assert_same(read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh)), mesh)


def test_a_straight_cable_in_a_plane_stays_in_the_plane(tmp_path):
    mesh = ElementMesh(p=[[0.0, 1.0, 3.0], [2.0, 2.0, 2.0]], t=[[0, 1], [1, 2]])
    assert_same(read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh)), mesh)


def test_boundaries_of_scikit_fem_are_written(tmp_path):
    mesh = ElementMesh.of(skfem.MeshHex().refined(1).with_defaults())
    again = read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh))
    assert_same(again, mesh)


def test_a_net_of_segments_marks_each_joint_once(tmp_path):
    star = ElementMesh(p=[[0, 1, -1, 0.0], [0, 0, 0, 1]], t=[[1, 2, 0], [0, 0, 3]], boundaries={"ends": [[3, 0, 1]]})
    again = read_mesh(write_mesh(tmp_path / "mesh.vtu", star))
    assert sorted(again.boundaries["ends"][0]) == [0, 1, 3]


@pytest.mark.parametrize("degree", [1, 2])
def test_lines_are_written(degree, tmp_path):
    straight = box((2, 1, 1), (2, 1, 1))
    mesh = replace(straight, lines={"rope": straight.t[[2, 0], 4:1:-2], "other": straight.t[1:3, :1]})
    mesh = crooked(mesh.with_degree(degree))
    again = read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh))
    assert set(again.lines) == {"rope", "other"}
    for name, ends in mesh.lines.items():
        assert np.array_equal(again.lines[name], ends if degree == 1 else ends[:, np.argsort(ends[2])]), name


def test_node_sets_on_lines_and_boundaries_are_read_back_by_name(tmp_path):
    cube = box((2, 1, 1), (2, 1, 1))
    points = np.concatenate([cube.p, [[0, 3.0], [0, 1], [2, 2]]], axis=1)
    mesh = replace(cube, p=points, lines={"rope": [[0], [12]]}, boundaries={"sail": [[11], [13], [9]]})
    again = read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh), keep=["rope", "sail"])
    assert np.array_equal(again.p, mesh.p) and np.array_equal(again.lines["rope"], mesh.lines["rope"])
    assert np.array_equal(again.boundaries["sail"], mesh.boundaries["sail"])
    with pytest.raises(MeshError, match=r"1 vertex \(13\): on no element"):
        write_mesh(tmp_path / "mesh.vtu", replace(mesh, boundaries={}))


def test_node_sets_are_not_subdomains(tmp_path):
    mesh = replace(box((1, 1), 2), boundaries={}, node_sets={"corner": [8, 0]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = read_mesh(write_mesh(tmp_path / "mesh.vtu", mesh))
    assert_same(again, mesh)
    assert not again.subdomains


def test_invalid_meshes_are_refused(tmp_path):
    mesh = box((1, 1), 2)
    with pytest.raises(StvkError, match=r"expected a path that ends in \.vtu"):
        write_mesh(tmp_path / "mesh.msh", mesh)
    with pytest.raises(MeshError, match=r"expected an ElementMesh: ElementMesh\.of"):
        write_mesh(tmp_path / "mesh.vtu", skfem.MeshTri())
    with pytest.raises(MeshError, match=r"1 vertex \(9\): on no element, so the file would lose them"):
        write_mesh(tmp_path / "mesh.vtu", replace(mesh, p=np.append(mesh.p, [[5.0], [5.0]], axis=1)))
    assert not list(tmp_path.iterdir())


def test_node_sets_of_files_with_several_pieces_are_shifted(tmp_path):
    path = write_mesh(tmp_path / "mesh.vtu", replace(box((1, 1), 1), boundaries={}, node_sets={"corner": [1]}))
    text = path.read_text()
    piece = text[text.index("<Piece") : text.index("</Piece>") + len("</Piece>")]
    path.write_text(text.replace(piece, piece + piece))
    assert read_mesh(path).node_sets["corner"].tolist() == [1, 5]
