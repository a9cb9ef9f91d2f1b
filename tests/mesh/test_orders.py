"""Elements of second order, hexahedra and quadrilaterals are read: orders of nodes, groups, and refused cells."""

import meshio
import numpy as np
import pytest
import skfem
from bodies import element_sizes
from meshfiles import CUBE, curved, same_facets, write

from skfem_stvk import ElementMesh, MeshError, StvkWarning
from skfem_stvk.mesh import read_mesh
from skfem_stvk.mesh.diagnostics import check_mesh
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.facets import find_facets
from skfem_stvk.mesh.points import are_straight

#: Edges whose middle nodes follow the corners, as drawn in the manuals of the programs.
EDGES = {
    "segments": [(0, 1)],
    "triangles": [(0, 1), (1, 2), (2, 0)],
    "tetrahedra": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}
GMSH_TET = [(0, 1), (1, 2), (2, 0), (0, 3), (2, 3), (1, 3)]
#: Corners of a box in the order of all these programs: around the bottom, then around the top.
BOX = {"quadrilaterals": [[0, 0], [1, 0], [1, 1], [0, 1]], "hexahedra": CUBE}
TYPES = {
    "inp": {"segments": "T3D3", "triangles": "CPS6", "tetrahedra": "C3D10", "quadrilaterals": "CPS4", "hexahedra": "C3D8"},
    "msh": {"segments": 8, "triangles": 9, "tetrahedra": 11, "quadrilaterals": 3, "hexahedra": 5},
    "vtk": {"segments": 21, "triangles": 22, "tetrahedra": 24, "quadrilaterals": 9, "hexahedra": 12},
    "lagrange.vtu": {"segments": 68, "triangles": 69, "tetrahedra": 71, "quadrilaterals": 70, "hexahedra": 72},
}


def in_words(rows):
    return "\n".join(" ".join(map(str, row)) for row in np.asarray(rows).tolist())


def one_cell(folder, ending, kind, points):
    """Write a file with one cell; its nodes are these points in this order, with shuffled ids."""
    n, number = len(points), np.random.default_rng(0).permutation(len(points))
    x = np.zeros((n, 3))
    x[number, : points.shape[1]] = points
    of_type = TYPES[ending][kind]
    if ending == "inp":
        nodes = "\n".join(f"{i + 1}, {a!r}, {b!r}, {c!r}" for i, (a, b, c) in enumerate(x.tolist()))
        text = f"*NODE\n{nodes}\n*ELEMENT, TYPE={of_type}\n1, {', '.join(map(str, number + 1))}\n"
    elif ending == "msh":
        text = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{n}\n"
        text += "\n".join(f"{i + 1} {a!r} {b!r} {c!r}" for i, (a, b, c) in enumerate(x.tolist()))
        text += f"\n$EndNodes\n$Elements\n1\n1 {of_type} 2 1 1 {' '.join(map(str, number + 1))}\n$EndElements\n"
    elif ending == "vtk":
        text = f"# vtk DataFile Version 3.0\none\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {n} double\n{in_words(x)}\n"
        text += f"CELLS 1 {n + 1}\n{n} {' '.join(map(str, number))}\nCELL_TYPES 1\n{of_type}\n"
    else:
        array = '<DataArray type="{}" Name="{}" NumberOfComponents="{}" format="ascii">{}</DataArray>'.format
        cells = array("Int64", "connectivity", 1, " ".join(map(str, number))) + array("Int64", "offsets", 1, n)
        text = f'<VTKFile type="UnstructuredGrid"><UnstructuredGrid><Piece NumberOfPoints="{n}" NumberOfCells="1">'
        text += (
            f"<Points>{array('Float64', 'p', 3, in_words(x))}</Points><Cells>{cells}{array('UInt8', 'types', 1, of_type)}</Cells>"
        )
        text += "</Piece></UnstructuredGrid></VTKFile>\n"
    (folder / f"mesh.{ending}").write_text(text)
    return folder / f"mesh.{ending}"


@pytest.mark.few
@pytest.mark.parametrize("ending", TYPES)
@pytest.mark.parametrize("kind", EDGES)
def test_a_single_curved_edge_is_read_as_the_same_local_edge(kind, ending, tmp_path):
    k = {"segments": 1, "triangles": 2, "tetrahedra": 3}[kind]
    corners = np.array([[0, 0, 0], [2, 0.1, 0.2], [0.3, 1.5, 0.1], [0.2, 0.4, 1.0]])[: k + 1, : max(k, 2)]
    edges = GMSH_TET if (ending, kind) == ("msh", "tetrahedra") else EDGES[kind]
    for curved_edge in range(len(edges)):
        middles = np.array([(corners[a] + corners[b]) / 2 for a, b in edges])
        middles[curved_edge] += 0.05 * np.arange(1, max(k, 2) + 1)
        mesh = read_mesh(one_cell(tmp_path, ending, kind, np.concatenate([corners, middles])))
        assert mesh.element.name == f"quadratic {kind}" and mesh.nv == len(corners) + len(middles)
        check_mesh(mesh)
        for (a, b), node in zip(mesh.element.edges, mesh.t[k + 1 :, 0], strict=True):
            ends = {tuple(mesh.p[:, mesh.t[i, 0]]) for i in (a, b)}
            (found,) = [i for i, (c, d) in enumerate(edges) if {tuple(corners[c]), tuple(corners[d])} == ends]
            assert np.array_equal(mesh.p[:, node], middles[found])


@pytest.mark.parametrize("ending", TYPES)
@pytest.mark.parametrize("kind", BOX)
def test_corners_of_boxes_are_read_in_scikit_fems_local_order(kind, ending, tmp_path):
    """The cell is a parallelepiped only if each corner has the right index."""
    reference = np.array(BOX[kind], dtype=float)
    k = reference.shape[1]
    slanted = reference @ np.array([[2, 0.3, 0.1], [0.2, 1, -0.4], [0.5, 0.1, 1.5]])[:k, :k] + 0.25
    mesh = read_mesh(one_cell(tmp_path, ending, kind, slanted))
    assert mesh.element is ELEMENTS[kind] and are_straight(mesh.p, mesh.t, mesh.element).all() and mesh.d == k
    check_mesh(mesh)


@pytest.mark.few
@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh"])
@pytest.mark.parametrize("cls", [skfem.MeshTet2, skfem.MeshTri2, skfem.MeshHex, skfem.MeshQuad])
def test_files_of_scikit_fem_are_read_with_groups_and_curved_edges(cls, ending, tmp_path):
    given = curved(cls)
    given.save(tmp_path / f"mesh.{ending}")
    mesh = read_mesh(tmp_path / f"mesh.{ending}")
    assert np.array_equal(mesh.p, given.doflocs) and np.array_equal(mesh.t, given.dofs.element_dofs)
    assert np.array_equal(mesh.elements("left_half"), given.subdomains["left_half"])
    one, other = mesh.boundaries["wall"], ElementMesh.of(given).boundaries["wall"]
    assert {frozenset(facet) for facet in one.T.tolist()} == {frozenset(facet) for facet in other.T.tolist()}
    assert len(one) == len(other) and one.size == other.size


#: Formats in which meshio writes elements of second order.
SECOND = {"bdf": ["tetra10"], "inp": ["tetra10"], "vtk": ["tetra10", "triangle6", "line3"],
          "vtu": ["tetra10", "triangle6", "line3"]}  # fmt: skip


@pytest.mark.parametrize(("ending", "kind"), [(ending, kind) for ending, kinds in SECOND.items() for kind in kinds])
def test_numbers_of_nodes_in_a_file_do_not_matter(ending, kind, tmp_path):
    """Node ids are shuffled, with vertices among the middle nodes.

    Vertices keep their order in the file, and middle nodes get scikit-fem's.
    """
    given = {"tetra10": lambda: curved(skfem.MeshTet2), "triangle6": lambda: curved(skfem.MeshTri2)}
    if kind == "line3":
        chain = ElementMesh([[0, 1, 3]], [[0, 1], [1, 2]]).with_degree(2)
        x, t = np.vstack([chain.p, chain.p**2 / 9]), chain.t
    else:
        x, t = given[kind]().doflocs, given[kind]().dofs.element_dofs
    x, number = x + 1, np.random.default_rng(1).permutation(x.shape[1])  # meshio writes no negative numbers into a .bdf
    points = np.zeros((x.shape[1], 3))
    points[number, : len(x)] = x.T
    file = write(tmp_path / f"mesh.{ending}", points, [(kind, number[t].T)])
    if ending == "bdf":  # meshio writes its own name of the type, which no other program knows
        file.write_text(file.read_text().replace("CTETRA_", "CTETRA "))
    mesh = read_mesh(file)
    assert mesh.element.degree == 2 and np.allclose(mesh.p[:, mesh.t], x[:, t], atol=1e-6)
    n = mesh.nvertices
    assert np.allclose(mesh.p[:, :n], points[np.sort(number[np.unique(t[: mesh.element.corners])])].T[: mesh.d], atol=1e-6)


@pytest.mark.parametrize("kind", ["tetra10", "hexahedron"])
def test_exodus_files_have_the_same_order(kind, tmp_path):
    shift = 0.1 * np.random.default_rng(0).random((10, 3))
    points = TEN + shift if kind == "tetra10" else np.array(CUBE) + shift[:8]
    mesh = read_mesh(write(tmp_path / "mesh.exo", points, [(kind, np.arange(len(points))[None])]))
    check_mesh(mesh)
    if kind == "tetra10":
        assert np.allclose(mesh.p[:, mesh.t[:, 0]].T, points, atol=1e-12)
    else:
        edges = {frozenset(map(tuple, mesh.p[:, mesh.t[list(edge), 0]].T.round(9))) for edge in mesh.element.edges}
        around = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
        assert edges == {frozenset(map(tuple, points[list(edge)].round(9))) for edge in around}


@pytest.fixture(scope="module")
def ball(gmsh, tmp_path_factory):
    """Return a function that writes half a ball of radius 1 of second order, with four groups.

    The groups are the body, its curved side, its flat side, and the rim between them.
    """
    folder = tmp_path_factory.mktemp("ball")

    def save(ending, order=2, **options):
        gmsh.initialize(interruptible=False)
        model, occ = gmsh.model, gmsh.model.occ
        occ.addSphere(0, 0, 0, 1, angle1=0)
        occ.synchronize()
        faces = {tag: model.occ.getMass(2, tag) for _, tag in model.getEntities(2)}
        dome = max(faces, key=faces.get)
        model.addPhysicalGroup(3, [1], name="body")
        model.addPhysicalGroup(2, [dome], name="dome")
        model.addPhysicalGroup(2, [tag for tag in faces if tag != dome], name="floor")
        rim = [abs(tag) for _, tag in model.getBoundary([(2, tag) for tag in faces if tag != dome], combined=False)]
        model.addPhysicalGroup(1, rim, name="rim")
        every = {"General.Terminal": 0, "Mesh.ElementOrder": order, "Mesh.MeshSizeMax": 0.5, **options}
        for option, value in every.items():
            gmsh.option.setNumber(option.replace("_", "."), value)
        model.mesh.generate(3)
        gmsh.write(str(folder / f"ball.{ending}"))
        gmsh.finalize()
        return folder / f"ball.{ending}"

    return save


@pytest.mark.parametrize("options", [{"Mesh_MshFileVersion": 2.2}, {"Mesh_MshFileVersion": 4.1}, {"Mesh_Binary": 1}])
def test_a_gmsh_ball_is_round_and_has_curved_facets_and_rim_nodes(ball, options):
    mesh = read_mesh(ball("msh", **options))
    check_mesh(mesh)
    assert mesh.element.name == "quadratic tetrahedra" and len(mesh.elements("body")) == mesh.nt
    radius = np.linalg.norm(mesh.p, axis=0)
    dome, floor = mesh.boundaries["dome"], mesh.boundaries["floor"]
    assert len(dome) == len(floor) == 6 and np.allclose(radius[dome], 1, atol=1e-6) and np.abs(mesh.p[2, floor]).max() < 1e-12
    assert dome.shape[1] + floor.shape[1] == mesh.surface.shape[1]
    on_rim = np.flatnonzero((np.abs(radius - 1) < 1e-6) & (np.abs(mesh.p[2]) < 1e-9))
    assert np.array_equal(mesh.node_sets["rim"], on_rim)
    volume = 2 / 3 * np.pi
    with pytest.warns(StvkWarning, match=r"reduced to their corners, \d+ vertices: \d+ of their \d+ edges are curved"):
        straight = mesh.with_degree(1)
    assert abs(element_sizes(mesh).sum() / volume - 1) < 0.1 * abs(element_sizes(straight).sum() / volume - 1)
    with pytest.warns(StvkWarning, match="tetra10 cells are of higher order: their corner vertices are used"):
        reduced = read_mesh(ball("msh", **options), degree=1)
    assert np.array_equal(reduced.p, straight.p) and np.array_equal(reduced.t, straight.t)
    assert np.array_equal(reduced.boundaries["dome"], straight.boundaries["dome"])
    assert np.array_equal(reduced.node_sets["rim"], straight.node_sets["rim"])


def test_a_ball_in_a_med_file_of_gmsh_is_round(ball):
    mesh = read_mesh(ball("med"))
    check_mesh(mesh)
    radius = np.linalg.norm(mesh.p[:, mesh.surface], axis=0)
    dome = (np.abs(mesh.p[2, mesh.surface]) > 1e-9).any(axis=0)
    assert mesh.element.name == "quadratic tetrahedra" and np.abs(radius[:, dome] - 1).max() < 1e-6
    assert element_sizes(mesh).sum() == pytest.approx(2 / 3 * np.pi, rel=1e-3)


def test_c3d10_files_have_middles_in_node_sets_and_surfaces_of_six_nodes(ball):
    mesh = read_mesh(ball("inp", Mesh_SaveGroupsOfElements=-1111, Mesh_SaveGroupsOfNodes=-1111))
    assert mesh.element.name == "quadratic tetrahedra"
    dome = mesh.boundaries["dome"]
    assert len(dome) == 6 and np.allclose(np.linalg.norm(mesh.p[:, dome], axis=0), 1, atol=1e-6)
    assert np.array_equal(mesh.node_sets["body"], np.arange(mesh.nv))


def test_node_sets_of_a_file_keep_their_middles(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    middles = np.array([(points[a] + points[b]) / 2 for a, b in EDGES["tetrahedra"]])
    path = one_cell(tmp_path, "inp", "tetrahedra", np.concatenate([points, middles]))
    ids = np.random.default_rng(0).permutation(10) + 1
    path.write_text(path.read_text() + f"*NSET, NSET=edge\n{ids[0]}, {ids[1]}, {ids[4]}\n")
    mesh = read_mesh(path)
    assert {tuple(x) for x in mesh.p[:, mesh.node_sets["edge"]].T} == {(0, 0, 0), (1, 0, 0), (0.5, 0, 0)}
    assert mesh.node_sets["edge"].tolist() == sorted(mesh.node_sets["edge"].tolist())
    with pytest.warns(StvkWarning, match="higher order"):
        assert len(read_mesh(path, degree=1).node_sets["edge"]) == 2


@pytest.mark.parametrize("middle", [1, 2])
def test_an_abaqus_truss_of_three_nodes_may_have_its_middle_between_or_after_the_ends(middle, tmp_path):
    nodes = [1, 2, 3] if middle == 2 else [1, 3, 2]
    (tmp_path / "mesh.inp").write_text(
        f"*NODE\n1, 0., 0., 0.\n2, 2., 0., 0.\n3, 1.2, 0.3, 0.\n*ELEMENT, TYPE=T3D3\n1, {', '.join(map(str, nodes))}\n"
    )
    mesh = read_mesh(tmp_path / "mesh.inp")
    assert sorted(mesh.p[0, mesh.t[:2, 0]]) == [0, 2] and mesh.p[:, mesh.t[2, 0]].tolist() == [1.2, 0.3]


TEN = np.concatenate([np.eye(4, 3, -1), [(np.eye(4, 3, -1)[a] + np.eye(4, 3, -1)[b]) / 2 for a, b in EDGES["tetrahedra"]]])


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (
            [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 3, 10, 5, 9, 11, 12, 13, 14]],
            r"1 element \([01]\): an edge has another midpoint",
        ),
        (
            [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 3, 9, 5, 9, 8, 12, 13, 14]],
            r"Nodes are both corners and edge midpoints.*: 1 node \(9\) of the file",
        ),
        ([[0, 1, 2, 3, 4, 5, 6, 7, 8, 8]], r"Several edges have the same midpoint: 1 node \(8\) of the file"),
    ],
)
def test_inconsistent_middle_nodes_are_refused_with_their_ids(cells, message):
    points = np.concatenate([TEN, np.random.default_rng(0).random((5, 3)) + 1])
    with pytest.raises(MeshError, match=message):
        ElementMesh.of(meshio.Mesh(points, [("tetra10", np.array(cells))]))


def test_quadratic_segments_on_quadratic_elements_are_sorted_by_their_middles():
    cells = [("tetra10", np.arange(10)[None]), ("line3", np.array([[3, 2, 9], [1, 0, 4], [0, 2, 6]]))]
    mesh = ElementMesh.of(meshio.Mesh(TEN, cells, cell_sets={"rope": [[], [0, 1, 2]]}))
    rope = mesh.lines["rope"]
    assert sorted(rope.T[:, :2].tolist()) == [[0, 2], [1, 0], [3, 2]] and (np.diff(rope[2]) > 0).all()
    assert ElementMesh(mesh.p, rope, element=mesh.element.edge).nt == 3


def test_linear_facets_of_quadratic_elements_get_middles_or_are_left_out():
    cells = [("tetra10", np.arange(10)[None]), ("triangle", np.array([[2, 1, 0], [0, 1, 3]]))]
    mesh = ElementMesh.of(meshio.Mesh(TEN, cells, cell_sets={"wall": [[], [0, 1]]}))
    wall = mesh.boundaries["wall"]
    for i, (a, b) in enumerate(mesh.facet.edges):
        assert np.array_equal(mesh.p[:, wall[3 + i]], mesh.p[:, wall[[a, b]]].mean(axis=1))
    two = np.concatenate([np.arange(10), np.arange(10, 20)]).reshape(2, 10)
    cells = [("tetra10", two), ("triangle", np.array([[0, 1, 12], [0, 1, 3]]))]
    points = np.concatenate([TEN, TEN + 5])
    with pytest.warns(StvkWarning, match=r"Boundary 'wall': 1 facet \(0\) of 2 are left out: their edges are on no element"):
        mesh = ElementMesh.of(meshio.Mesh(points, cells, cell_sets={"wall": [[], [0, 1]]}))
    assert mesh.boundaries["wall"].shape == (6, 1)


@pytest.mark.parametrize(
    ("kind", "element", "more"),
    [
        ("hexahedron20", "hexahedra", ""),
        ("hexahedron27", "hexahedra", ""),
        ("quad8", "quadrilaterals", ""),
        ("quad9", "quadrilaterals", ""),
        ("tetra20", "tetrahedra", " Quadratic tetrahedra are used"),
        ("triangle10", "triangles", " Quadratic triangles are used"),
    ],
)
def test_other_elements_of_higher_order_are_reduced_to_corners_with_a_warning(kind, element, more):
    base = ELEMENTS[element]
    n = meshio._common.num_nodes_per_cell[kind]
    points = np.random.default_rng(0).random((n, 3))
    with pytest.warns(StvkWarning, match=f"^1 {kind} cells are of higher order: their corner vertices are used.*straight.{more}"):
        mesh = ElementMesh.of(meshio.Mesh(points, [(kind, np.arange(n)[None])]))
    assert mesh.element is base and mesh.nv == base.n
    assert np.array_equal(np.sort(mesh.p, axis=1), np.sort(points[: base.n].T, axis=1))


def test_a_file_with_some_quadratic_elements_is_reduced_to_corners():
    points = np.concatenate([TEN, [[1, 1, 1.0]]])
    with pytest.warns(
        StvkWarning, match="1 tetra10 cells are of higher order.*Quadratic tetrahedra are used if all elements are quadratic"
    ):
        mesh = ElementMesh.of(meshio.Mesh(points, [("tetra10", np.arange(10)[None]), ("tetra", np.array([[1, 2, 3, 10]]))]))
    assert (mesh.nt, mesh.nv, mesh.element.name) == (2, 5, "tetrahedra")


@pytest.mark.parametrize("degree", [0, 3, "2", True])
def test_another_degree_is_refused_before_the_file_is_read(degree, tmp_path):
    with pytest.raises(MeshError, match=r"degree = .*expected 1 or 2"):
        read_mesh(tmp_path / "none.msh", degree=degree)


def test_a_file_of_linear_elements_may_be_read_as_quadratic_ones(tmp_path):
    file = write(tmp_path / "mesh.vtu", CUBE, [("tetra", [[0, 1, 3, 4], [1, 2, 3, 6]])])
    with pytest.warns(StvkWarning, match="on none of the tetrahedra"):
        mesh = read_mesh(file, degree=2)
    assert mesh.element.name == "quadratic tetrahedra" and are_straight(mesh.p, mesh.t, mesh.element).all()
    file = write(tmp_path / "boxes.vtu", CUBE, [("hexahedron", [list(range(8))])])
    assert read_mesh(file, degree=1).nt == 1
    with pytest.raises(MeshError, match="degree = 2, but the elements are hexahedra"):
        read_mesh(file, degree=2)


def test_facets_of_hexahedra_have_cyclic_order(tmp_path):
    given = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 3)] * 3)
    floor = meshio.CellBlock("quad", np.array([[0, 1, 2, 3]]))
    mesh = ElementMesh.of(
        meshio.Mesh(np.array(CUBE, float), [("hexahedron", np.arange(8)[None]), floor], cell_sets={"a": [[], [0]]})
    )
    assert mesh.boundaries["a"].T.tolist() == [[0, 1, 2, 3]]
    assert same_facets(ElementMesh.of(given.with_boundaries({"x": lambda x: x[0] == 0})), "x",
                       given.with_boundaries({"x": lambda x: x[0] == 0}), "x")  # fmt: skip


@pytest.mark.parametrize("ending", ["msh", "inp"])
def test_hexahedra_of_gmsh_have_their_groups(ending, gmsh, tmp_path):
    gmsh.initialize(interruptible=False)
    model = gmsh.model
    model.occ.addBox(0, 0, 0, 1, 2, 3)
    model.occ.synchronize()
    left = [tag for _, tag in model.getEntities(2) if abs(model.getBoundingBox(2, tag)[3]) < 1e-6]
    model.addPhysicalGroup(3, [1], name="body")
    model.addPhysicalGroup(2, left, name="left")
    for dim, tag in model.getEntities():
        if dim == 1:
            model.mesh.setTransfiniteCurve(tag, 4)
        if dim == 2:
            model.mesh.setTransfiniteSurface(tag)
            model.mesh.setRecombine(2, tag)
    model.mesh.setTransfiniteVolume(1)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.SaveGroupsOfElements", -1111)
    model.mesh.generate(3)
    gmsh.write(str(tmp_path / f"box.{ending}"))
    gmsh.finalize()
    mesh = read_mesh(tmp_path / f"box.{ending}")
    check_mesh(mesh)
    assert (mesh.kind, mesh.nt, mesh.nv) == ("hexahedra in 3D", 27, 64) and len(mesh.elements("body")) == 27
    (walls,) = [facets for name, facets in mesh.boundaries.items() if name == "left"]
    assert walls.shape == (4, 9) and np.abs(mesh.p[0, walls]).max() < 1e-12
    assert element_sizes(mesh).sum() == pytest.approx(6) and (find_facets(walls, mesh.surface, mesh.nv) >= 0).all()
