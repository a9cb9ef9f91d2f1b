"""Cells of several kinds are split into simplices with the same volume, whose faces match."""

from itertools import permutations

import meshio
import numpy as np
import pytest

from skfem_stvk import ElementMesh, MeshError, StvkWarning, read_mesh
from skfem_stvk.mesh.split import FACES, tetrahedra

#: Corners of unit cells in VTK's order, and their volumes.
CELLS = {
    "hexahedron": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], 1.0),
    "wedge": ([[0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1], [0, 1, 1], [1, 0, 1]], 0.5),
    "pyramid": ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]], 1 / 3),
    "tetra": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], 1 / 6),
}
NOTE = "are split into .*, which are stiffer in bending. To refuse such files, read them with split=False"


def sizes(points, t):
    x = points[t]
    return np.linalg.det(x[:, 1:] - x[:, :1]) / 6


@pytest.mark.parametrize("family", CELLS)
def test_faces_are_seen_from_within_and_are_all_of_a_cell(family):
    points = np.array(CELLS[family][0])
    for face in FACES[family]:
        x = points[list(face)]
        normal = np.cross(x[1] - x[0], x[2] - x[0])
        inward = 1 if family != "wedge" else -1  # VTK's wedge is mirrored
        assert inward * normal @ (points.mean(axis=0) - x.mean(axis=0)) > 0
    assert len({frozenset(face) for face in FACES[family]}) == len(FACES[family])


@pytest.mark.parametrize("family", ["hexahedron", "wedge", "pyramid"])
def test_all_numbers_of_nodes_give_tetrahedra_of_one_orientation_and_the_same_volume(family):
    corners, volume = np.array(CELLS[family][0]), CELLS[family][1]
    n, rng = len(corners), np.random.default_rng(0)
    orders = list(permutations(range(n))) if n < 7 else [rng.permutation(n) for _ in range(500)]
    for order in orders:
        points = np.empty_like(corners, dtype=float)
        points[list(order)] = corners
        found, rows = tetrahedra(np.array([order]), FACES[family])
        volumes = sizes(points, found)
        assert np.isclose(abs(volumes.sum()), volume) and len({*np.sign(volumes)}) == 1 and (rows == 0).all()
        assert len(found) == {"hexahedron": 6, "wedge": 3, "pyramid": 2}[family] or (family == "hexahedron" and len(found) >= 5)


def write(path, points, cells, **sets):
    meshio.Mesh(np.array(points, dtype=float), cells, cell_sets=sets).write(path)
    return path


def mixed(seed):
    """Return a block of hexahedra, wedges, pyramids and tetrahedra with faces that match, whose nodes have numbers at random."""
    rng = np.random.default_rng(seed)
    grid = np.array([[x, y, z] for z in range(3) for y in range(3) for x in range(3)], dtype=float)
    at = {tuple(x): i for i, x in enumerate(grid)}
    box = np.array(CELLS["hexahedron"][0])
    hexes = [[at[tuple(map(float, x + np.array([i, j, k])))] for x in box] for k in range(2) for j in range(2) for i in range(2)]
    centres = grid[hexes[6]].mean(axis=0), grid[hexes[7]].mean(axis=0)
    points = np.concatenate([grid, centres])
    wedges = [[h[a] for a in ids] for h in hexes[2:4] for ids in ((0, 3, 7, 1, 2, 6), (0, 7, 4, 1, 6, 5))]
    pyramids = [[*(h[a] for a in face), 27 + i] for i, h in enumerate(hexes[6:8]) for face in FACES["hexahedron"]]
    number = rng.permutation(len(points))
    moved = np.empty_like(points)
    moved[number] = points
    boxes = [[h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7]] for h in (*hexes[:2], *hexes[4:6])]
    cells = [("hexahedron", number[boxes]), ("wedge", number[wedges]), ("pyramid", number[pyramids])]
    top = [
        [at[(float(x), float(y), 2.0)] for x, y in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
        for i in range(2)
        for j in range(2)
    ]
    cells.append(("quad", number[top]))
    sets = {"boxes": [[0, 1, 2, 3], [], [], []], "rest": [[], [0, 1, 2, 3], list(range(12)), []], "top": [[], [], [], [0, 1, 2, 3]]}
    return meshio.Mesh(moved, cells, cell_sets={name: [np.array(ids, dtype=int) for ids in found] for name, found in sets.items()})


@pytest.mark.parametrize("seed", range(5))
def test_a_mixed_mesh_fills_its_volume_and_its_faces_match(seed, tmp_path):
    raw = mixed(seed)
    with pytest.warns(StvkWarning, match=f"^4 hexahedron, 4 wedge and 12 pyramid cells {NOTE}"):
        mesh = ElementMesh.of(raw)
    volumes = np.abs(sizes(mesh.p.T, mesh.t.T))
    assert np.isclose(volumes.sum(), 8) and mesh.nv == 29
    assert mesh.surface.shape[1] == 2 * 24 and np.isclose(volumes[mesh.subdomains["boxes"]].sum(), 4)
    assert np.isclose(volumes[mesh.subdomains["rest"]].sum(), 4) and mesh.boundaries["top"].shape == (3, 8)
    found = {frozenset(facet) for facet in mesh.surface.T}
    assert {frozenset(facet) for facet in mesh.boundaries["top"].T} <= found
    with pytest.raises(
        MeshError, match=r"holds 4 hexahedron, 4 wedge and 12 pyramid cells; expected one kind of element.*split=True"
    ):
        read_mesh(write(tmp_path / "mixed.vtu", raw.points, raw.cells), split=False)


def test_hexahedra_with_a_repeated_vertex_are_what_they_are(tmp_path):
    points = np.array(CELLS["hexahedron"][0])
    cells = [("hexahedron", np.array([[0, 1, 2, 2, 4, 5, 6, 6], [0, 2, 3, 3, 4, 6, 7, 7]]))]
    with pytest.warns(StvkWarning, match=r"^2 hexahedron cells \(2 with a repeated vertex\) are split into 6 tetrahedra"):
        mesh = read_mesh(write(tmp_path / "two.vtk", points, cells))
    assert np.isclose(np.abs(sizes(mesh.p.T, mesh.t.T)).sum(), 1)
    with pytest.raises(MeshError, match=r"2 hexahedron cells \(2 with a repeated vertex\); expected one kind"):
        read_mesh(tmp_path / "two.vtk", split=False)


@pytest.mark.parametrize("change", ["flat", "folded"])
def test_cells_that_are_no_sum_of_tetrahedra_are_refused(change, tmp_path):
    corners = np.array(CELLS["hexahedron"][0], dtype=float)
    points = np.concatenate([corners, corners + 5])
    if change == "folded":
        points[14] = 4.0  # a corner is pushed through its cell
    second = [0, 1, 2, 3, 0, 1, 2, 3] if change == "flat" else list(range(8))
    cells = [[0, 1, 2, 2, 4, 5, 6, 6], (8 + np.array(second)).tolist()]
    with pytest.raises(MeshError, match=r"1 hexahedron cell \(1\): the same vertex twice, or folded over itself"):
        read_mesh(write(tmp_path / "bad.vtk", points, [("hexahedron", cells)]))


def test_quadrilaterals_beside_triangles_are_split(tmp_path):
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0]]
    path = write(tmp_path / "shell.vtk", points, [("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2]])])
    with pytest.warns(StvkWarning, match=f"^1 quad cells {NOTE}"):
        mesh = read_mesh(path)
    assert mesh.kind == "triangles in 2D" and mesh.nt == 3
    with pytest.raises(MeshError, match="holds 1 quad cells; expected one kind"):
        read_mesh(path, split=False)


def test_a_quadrilateral_face_beside_two_triangles_is_refused(tmp_path):
    points = [*CELLS["hexahedron"][0], [0.5, 0.5, 2.0]]
    cells = [("hexahedron", [list(range(8))]), ("tetra", [[4, 5, 6, 8], [4, 6, 7, 8]])]
    with pytest.raises(
        MeshError, match=r"a quadrilateral face is next to two triangles, at 4 nodes \(4, 5, 6, 7\).*put pyramids between"
    ):
        read_mesh(write(tmp_path / "tied.vtk", points, cells))
    through = [("hexahedron", [list(range(8))]), ("pyramid", [[4, 5, 6, 7, 8]])]
    with pytest.warns(StvkWarning, match=NOTE):
        mesh = read_mesh(write(tmp_path / "matched.vtk", points, through))
    assert np.isclose(np.abs(sizes(mesh.p.T, mesh.t.T)).sum(), 1 + 1 / 3)


@pytest.mark.parametrize("n", [6, 15])
def test_middle_nodes_of_split_wedges_are_no_vertices(n, tmp_path):
    text = "*NODE\n" + "".join(
        f"{i + 1}, {x[0]}, {x[1]}, {x[2]}\n"
        for i, x in enumerate([*CELLS["wedge"][0], *[(0.1 * i, 0.1, 0.1) for i in range(9)]][:n])
    )
    (tmp_path / "wedge.inp").write_text(text + f"*ELEMENT, TYPE=C3D{n}, ELSET=E\n1, " + ", ".join(map(str, range(1, n + 1))) + "\n")
    with pytest.warns(StvkWarning, match="wedge cells are split into 3 tetrahedra") as caught:
        mesh = read_mesh(tmp_path / "wedge.inp")
    assert len(caught) == 1 and mesh.nv == 6 and mesh.subdomains["E"].size == 3
