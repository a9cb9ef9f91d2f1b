"""Elements of all kinds in files and pictures: VTK's cells and order of nodes, and curved faces drawn as curves."""

import meshio
import numpy as np
import pytest
from bodies import CURVED, EVERY_MESH, state

from skfem_stvk import ElementMesh, StVK, read_mesh
from skfem_stvk.mesh.points import sizes_of
from skfem_stvk.results import Fields
from skfem_stvk.results.picture import Lattice, VisibleMesh, picture_of, visible_faces
from skfem_stvk.results.plotting import animate, plot
from skfem_stvk.results.series import Series
from skfem_stvk.results.vtu import write_vtu

TERM = StVK(young=2.0, poisson=0.3)
TYPES = {"quadratic tetrahedra": (24, 10), "quadratic triangles": (22, 6), "quadratic segments": (21, 3)}
TYPES |= {"quadrilaterals": (9, 4), "hexahedra": (12, 8), "tetrahedra": (10, 4), "triangles": (5, 3), "segments": (3, 2)}


def at(mesh, amount=0.05):
    return Fields(mesh, TERM).at(state(mesh, amount))


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY_MESH)
def test_files_read_back_are_the_same_mesh_with_the_same_values(name, tmp_path):
    mesh = EVERY_MESH[name]
    now = at(mesh)
    path = write_vtu(tmp_path / "body.vtu", now, ["cauchy", "von_mises", "volume_ratio"])
    again, raw = read_mesh(path), meshio.vtu.read(path)
    assert again.element is mesh.element and np.array_equal(again.t, mesh.t)
    assert np.array_equal(again.p, mesh.p if mesh.d > 1 else again.p) and np.array_equal(again.p[0], mesh.p[0])
    assert np.array_equal(raw.point_data["displacement"][:, : mesh.d], now.u)
    assert np.array_equal(raw.cell_data["von_mises_stress"][0], np.asarray(now["von_mises"]))
    assert np.array_equal(raw.point_data["von_mises_stress"], np.asarray(now.at_nodes("von_mises")))
    assert len(raw.cells) == 1 and raw.cells[0].data.shape == (mesh.nt, TYPES[mesh.element.name][1])


@pytest.mark.parametrize("name", [name for name in EVERY_MESH if EVERY_MESH[name].k == EVERY_MESH[name].d > 1])
def test_vtk_itself_finds_the_volumes(name, tmp_path):
    """VTK computes the right volumes from the files. Another order of nodes would fold its cells."""
    vtk = pytest.importorskip("pyvista")
    mesh = EVERY_MESH[name]
    grid = vtk.read(write_vtu(tmp_path / "body.vtu", at(mesh), ["volume_ratio"]))
    assert set(grid.celltypes) == {TYPES[mesh.element.name][0]}
    flat = sizes_of(mesh.p, mesh.t, mesh.element)
    found = np.abs(grid.compute_cell_sizes()["Volume" if mesh.d == 3 else "Area"])
    curved = mesh.element.degree == 2  # VTK cuts curved elements into linear cells
    assert found == pytest.approx(flat, rel=0.25 if curved else 0.02) and found.sum() == pytest.approx(flat.sum(), rel=0.02)


@pytest.mark.parametrize("name", CURVED)
def test_pictures_lie_on_the_faces_and_have_their_values(name):
    mesh = CURVED[name]
    now, x = at(mesh), np.zeros((mesh.nv, 3))
    x[:, : mesh.d] = mesh.p.T
    picture = picture_of(now, mesh.p[0], 1.0, "x [m]")
    assert np.allclose(picture.values, picture.rest[picture.cells, 0], atol=1e-12)
    (local, elements), face = visible_faces(mesh)
    nodes = mesh.t[local, elements]
    lattice = Lattice(face, nodes.shape[1], mesh.d)
    moved = x.copy()
    moved[:, : mesh.d] += now.u
    assert np.allclose(picture.moved, lattice.points(moved[nodes]), atol=1e-12)
    assert set(map(tuple, np.round(moved[nodes].reshape(-1, 3), 9))) <= set(map(tuple, np.round(picture.moved, 9)))


@pytest.mark.parametrize("name", [name for name in CURVED if CURVED[name].k == 2])
def test_the_pieces_of_surfaces_add_up_to_their_area(name):
    mesh = CURVED[name]
    picture = picture_of(at(mesh), mesh.p[0], 1.0, "x [m]")
    a, b, c = picture.rest[picture.cells]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(sizes_of(mesh.p, mesh.t, mesh.element).sum(), rel=2e-3)


def test_outlines_of_curved_bodies_are_curved():
    """The outline of a disc of quadratic triangles has the length of the circle; with straight edges it is shorter."""
    angles = np.arange(6) * np.pi / 3
    p = np.concatenate([[[0, 0]], np.stack([np.cos(angles), np.sin(angles)], axis=1)]).T
    t = np.array([[0] * 6, np.arange(1, 7), np.roll(np.arange(1, 7), -1)])
    straight = ElementMesh(p, t).with_degree(2)
    q, rim = straight.p.copy(), np.unique(straight.surface)
    q[:, rim] /= np.linalg.norm(q[:, rim], axis=0)
    found = []
    for mesh in (straight, ElementMesh(q, straight.t, element=straight.element)):
        picture = VisibleMesh(mesh).picture(np.zeros((mesh.nv, 2)), np.zeros(mesh.t.shape), "", 1.0)
        found.append(np.linalg.norm(np.diff(picture.rest[picture.lines], axis=0), axis=2).sum())
    assert found[0] == pytest.approx(6, rel=1e-12) and found[1] == pytest.approx(2 * np.pi, rel=4e-3)


@pytest.mark.parametrize("name", ["quadratic triangles", "hexahedra", "quadratic cable"])
def test_elements_without_a_value_are_masked(name, tmp_path):
    mesh = CURVED[name]
    half = np.arange(mesh.nt // 2)
    now = Fields(mesh, StVK(young=2.0, poisson=0.3, region=half)).at(state(mesh, 0.05))
    picture = picture_of(now, "von_mises", 1.0, None)
    (_, elements), _ = visible_faces(mesh)
    share = np.isin(elements, half).mean()
    assert 1 - np.ma.getmaskarray(picture.values)[0].mean() == pytest.approx(share)
    plot(now, path=tmp_path / "body.png")
    assert (tmp_path / "body.png").stat().st_size > 5000


@pytest.mark.parametrize("name", ["quadratic tetrahedra", "quadrilaterals"])
def test_films_of_files_and_of_states_are_the_same(name, tmp_path):
    mesh = CURVED[name]
    states = [(t, Fields(mesh, TERM).at(t * state(mesh, 0.1))) for t in (0.0, 1.0)]
    with Series(tmp_path / "run.pvd", ["von_mises"]) as series:
        for t, now in states:
            series.add(now, t)
    one = animate(tmp_path / "run.pvd", tmp_path / "one.gif").read_bytes()
    assert one == animate(states, tmp_path / "other.gif").read_bytes()
