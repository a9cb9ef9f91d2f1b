"""Exodus files: blocks, side sets and node sets keep their names, or have their IDs."""

import numpy as np
import pytest

from skfem_stvk import MeshError, StVK, StvkWarning, System, Traction, read_mesh, solve_static
from skfem_stvk.mesh import box
from skfem_stvk.mesh.formats.exodus import SIDES

netCDF4 = pytest.importorskip("netCDF4")
#: Corners of reference cells, in Exodus' order.
CORNERS = {
    "tetra": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "hexahedron": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    "wedge": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]],
    "pyramid": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]],
}


def write(path, points, blocks, sides=(), nodes=(), apart=False):
    """Write a file of `blocks` (name, type, nodes), `sides` (name, elements, sides from 1) and `nodes` (name, nodes)."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as file:
        for name, size in (("len_string", 33), ("num_dim", points.shape[1]), ("num_nodes", len(points))):
            file.createDimension(name, size)
        if apart:
            for x, values in zip("xyz", points.T, strict=False):
                file.createVariable(f"coord{x}", "f8", ("num_nodes",))[:] = values
        else:
            file.createVariable("coord", "f8", ("num_dim", "num_nodes"))[:] = points.T
        for of, groups in (("eb", blocks), ("ss", sides), ("ns", nodes)):
            if groups:
                file.createDimension(f"num_{of}", len(groups))
                names = file.createVariable(f"{of}_names", "S1", (f"num_{of}", "len_string"))
                for i, (name, *_) in enumerate(groups):
                    names[i, : len(name.encode())] = np.frombuffer(name.encode(), "S1")
                file.createVariable(f"{of}_prop1", "i4", (f"num_{of}",))[:] = 10 + np.arange(len(groups))

        def add(name, values):
            for axis, size in enumerate(values.shape):
                file.createDimension(f"{name}_{axis}", size)
            variable = file.createVariable(name, "i4", tuple(f"{name}_{axis}" for axis in range(values.ndim)))
            variable[:] = values
            return variable

        for i, (_, kind, cells) in enumerate(blocks, start=1):
            add(f"connect{i}", np.asarray(cells) + 1).elem_type = kind
        for i, (_, elements, numbers) in enumerate(sides, start=1):
            add(f"elem_ss{i}", np.asarray(elements) + 1)
            add(f"side_ss{i}", np.asarray(numbers))
        for i, (_, ids) in enumerate(nodes, start=1):
            add(f"node_ns{i}", np.asarray(ids) + 1)
    return path


def two_blocks(path, **options):
    """Write the tetrahedra of a bar in two blocks, with its end as a side set."""
    mesh = box((2.0, 1.0, 1.0), (4, 2, 2))
    half, opposite = mesh.nt // 2, {frozenset(face): number for number, face in enumerate(SIDES["tetra"], start=1)}
    ends = [
        (e, opposite[frozenset({1, 2, 3, 4} - {i + 1})])
        for e in range(mesh.nt)
        for i in range(4)
        if (mesh.p[0, np.delete(mesh.t[:, e], i)] == 2).all()
    ]
    blocks = [("steel", "TETRA4", mesh.t.T[:half]), ("", "tet4", mesh.t.T[half:])]
    left, right = (np.flatnonzero(mesh.p[0] == x) for x in (0, 2))
    nodes = [("", left), ("", right), ("left é", left)]
    return mesh, write(path, mesh.p.T, blocks, [("end", *np.array(ends).T)], nodes, **options)


@pytest.mark.parametrize("suffix, apart", [(".e", False), (".exo", True), (".g", True), (".gen", False), (".ex2", False)])
def test_a_file_is_solved_with_a_load_on_a_named_side_set(suffix, apart, tmp_path):
    mesh, path = two_blocks(tmp_path / f"bar{suffix}", apart=apart)
    read = read_mesh(path)
    assert np.array_equal(read.p, mesh.p) and np.array_equal(read.t, mesh.t)
    assert {name: ids.size for name, ids in read.subdomains.items()} == {"steel": mesh.nt // 2, "block_2": mesh.nt - mesh.nt // 2}
    assert {name: ids.size for name, ids in read.node_sets.items()} == {"10": 9, "11": 9, "left é": 9}
    load = Traction("end", (0.0, 0.0, -3.0))
    body = System(read, [StVK(young=1e5, poisson=0.3), load], fixed={"left é": "xyz"})
    assert body.external_force(np.zeros(body.ndofs)).reshape(-1, 3).sum(axis=0) == pytest.approx([0, 0, -3.0])  # 3 Pa on 1 m^2
    assert solve_static(body, quiet=True).success


@pytest.mark.parametrize("family", ["tetra", "hexahedron"])
def test_sides_of_solids_are_the_facets_that_face_outwards(family, tmp_path):
    points = np.array(CORNERS[family], dtype=float)
    for number, corners in enumerate(SIDES[family], start=1):
        x = points[np.array(corners) - 1]
        normal = np.cross(x[1] - x[0], x[2] - x[0])
        assert normal @ (x.mean(axis=0) - points.mean(axis=0)) > 0, number
        path = write(tmp_path / f"{number}.e", points, [("", family[:3].upper(), [range(len(points))])], [("s", [0], [number])])
        read = read_mesh(path)
        assert {tuple(p) for p in read.p[:, read.boundaries["s"][:, 0]].T} == {tuple(p) for p in x}


@pytest.mark.parametrize("family", ["wedge", "pyramid"])
def test_sides_of_wedges_and_pyramids_are_all_of_their_faces(family):
    points = np.array(CORNERS[family], dtype=float)
    for corners in SIDES[family]:
        x = points[np.array(corners) - 1]
        normal = np.cross(x[1] - x[0], x[2] - x[0])
        assert normal @ (x.mean(axis=0) - points.mean(axis=0)) > 0
        assert all(normal @ (p - x[0]) <= 1e-12 for p in points)
    assert len({frozenset(corners) for corners in SIDES[family]}) == 5


def test_shells_have_two_sides_and_edges_and_points_are_left_out(tmp_path):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]])
    blocks = [("shell", "SHELL4", [[0, 1, 2, 3]]), ("mass", "SPHERE", [[2]])]
    path = write(tmp_path / "shell.e", points, blocks, [("front", [0], [1]), ("edge", [0], [3])])
    with pytest.warns(StvkWarning, match="1 SPHERE elements of the block 'mass' are left out: they have no volume"):
        read = read_mesh(path)
    assert read.subdomains["front"].size == 1 and read.boundaries["edge"].T.tolist() == [[0, 1]] and read.d == 3


@pytest.mark.parametrize(
    ("blocks", "sides", "nodes", "message"),
    [
        ([("", "TET", [[0, 1, 2, 3, 0, 1, 2]])], [], [], "elements TET with 7 nodes are not read"),
        ([("", "NGON", [[0, 1, 2, 3]])], [], [], "elements NGON with 4 nodes are not read"),
        ([("", "TET", [[0, 1, 2, 3]])], [("top", [0], [5])], [], "side set 'top' has the side 5 of a tetra, which has 4 sides"),
        ([("", "TET", [[0, 1, 2, 3]])], [("top", [7], [1])], [], r"Side set 'top': 1 element \(7\) not defined"),
        ([("", "TET", [[0, 1, 2, 3]])], [], [("pin", [9])], r"Node set 'pin': 1 node \(9\) not defined"),
        ([("", "TET", [[0, 1, 2, 8]])], [], [], "vertex ids outside 0"),
    ],
)
def test_inconsistent_files_are_refused(blocks, sides, nodes, message, tmp_path):
    with pytest.raises(MeshError, match=message):
        read_mesh(write(tmp_path / "bad.e", np.array(CORNERS["tetra"], dtype=float), blocks, sides, nodes))
