"""Broken meshes are refused with the ids of the faults; sound meshes of any shape pass."""

import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import skfem
from bodies import jacobians
from meshfiles import curved

from skfem_stvk import ElementMesh, MeshError, StVK, StvkWarning, System, read_mesh, write_mesh
from skfem_stvk.mesh import box
from skfem_stvk.mesh.diagnostics import check_mesh, flat_elements, folded_elements, parts, straightened
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.points import rule_of

CUBE = skfem.MeshTet().refined(2)
SQUARE = skfem.MeshTri().refined(2)
UNIT_TET = [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def with_points(mesh, changed):
    p = mesh.p.copy()
    for vertex, x in changed.items():
        p[:, vertex] = x
    return ElementMesh(p, mesh.t)


def with_elements(mesh, *more):
    return ElementMesh(mesh.p, np.column_stack([mesh.t, *more]))


BROKEN = {
    "a coordinate that is not a number": (
        with_points(CUBE, {7: np.nan, 30: (0, np.inf, 0)}),
        r"2 vertices \(7, 30\): coordinates that are not finite.*scaled",
    ),
    "a tetrahedron that repeats a vertex": (
        with_elements(CUBE, [3, 5, 3, 9]),
        r"1 element \(320\): the same vertex twice.*Collapsed cells",
    ),
    "a triangle that repeats a vertex": (
        with_elements(SQUARE, [3, 3, 5], [0, 1, 1]),
        r"2 elements \(32, 33\): the same vertex",
    ),
    "a segment from a vertex to itself": (ElementMesh([[0, 1]], [[0, 1], [1, 1]]), r"1 element \(1\): the same vertex"),
    "a copy of an element": (with_elements(CUBE, CUBE.t[:, 11]), r"1 element \(320\): the same vertices as an earlier element"),
    "copies in another vertex order": (
        with_elements(CUBE, CUBE.t[[1, 0, 2, 3], 11], CUBE.t[::-1, 4], CUBE.t[[2, 0, 1, 3], 11]),
        r"3 elements \(320, 321, 322\): the same vertices.*count twice.*Remove the copies",
    ),
    "vertices on no element": (
        ElementMesh(np.column_stack([[[5.0]] * 3, CUBE.p, [[6.0]] * 3]), CUBE.t + 1),
        rf"2 vertices \(0, {CUBE.nvertices + 1}\): on no element, so K would have zero rows.*remove_unused_nodes",
    ),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_mesh_is_refused_with_the_ids_of_its_faults(what):
    mesh, message = BROKEN[what]
    with pytest.raises(MeshError, match=message):
        check_mesh(mesh)


def rotated(p, seed=1):
    d = len(p)
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(d, d)))[0] @ p


FLAT = {
    "a tetrahedron in a plane": ([[0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 0]], "plane"),
    "a tetrahedron in a line": ([[0, 1, 2, 3], [0, 0, 0, 0], [0, 0, 0, 0]], "plane"),
    "a triangle in a line": ([[0, 1, 3], [0, 1, 3]], "line"),
    "a triangle in a line in space": ([[0, 1, 3], [0, 1, 3], [0, 2, 6]], "line"),
    "a segment in a point": ([[2, 2], [1, 1], [0, 0]], "point"),
    "a triangle in a point": ([[1, 1, 1], [1, 1, 1]], "line"),
}


@pytest.mark.parametrize("offset", [0, 1, 1e6])
@pytest.mark.parametrize("scale", [1e-9, 1, 1e9])
@pytest.mark.parametrize("what", FLAT)
def test_an_element_without_volume_is_refused_at_any_size_and_position(what, scale, offset):
    p, where = FLAT[what]
    p = scale * (rotated(np.array(p, dtype=float)) + offset)
    good = np.vstack([np.eye(len(p)), np.zeros(len(p))]).T[:, : p.shape[1]] * scale
    mesh = ElementMesh(np.hstack([good, p]), np.arange(2 * p.shape[1]).reshape(2, -1).T)
    with pytest.raises(MeshError, match=rf"1 element \(1\): no volume, all vertices lie in one {where} to within rounding"):
        check_mesh(mesh)


def tent(degrees):
    """Return two faces that meet at this angle along an edge: a sliver with one dihedral angle near 0."""
    height = np.tan(np.radians(degrees))
    return ElementMesh([[0, 1, 0.5, 0.5], [0, 0, 1, 1], [0, 0, 0, height]], [[0], [1], [2], [3]])


def cube(stretch=(1, 1, 1), offset=0.0, scale=1.0):
    return ElementMesh(rotated(CUBE.p * np.reshape(stretch, (3, 1)) + offset) * scale, CUBE.t)


GOOD = {
    "half of the elements are negative": ElementMesh.of(skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)),
    "all elements are negative": ElementMesh(UNIT_TET, [[1], [0], [2], [3]]),
    "a sliver has an angle of 1 degree": tent(1),
    "a needle has an angle of 1 degree": ElementMesh([[0, 1, 1], [0, 0, np.tan(np.radians(1))]], [[0], [1], [2]]),
    "the elements are 1000 times longer than thick": cube(stretch=(1000, 1, 1)),
    "the elements are 1000 times flatter than wide": cube(stretch=(1000, 1000, 1)),
    "the mesh is 1e6 times its size away": cube(offset=1e6),
    "the mesh is tiny": cube(scale=1e-9),
    "the mesh is tiny and far away": cube(scale=1e-9, offset=1e6),
    "the mesh is huge": cube(scale=1e9, offset=1e6),
    "triangles stand in space": ElementMesh(rotated(np.vstack([SQUARE.p, 0 * SQUARE.p[:1]])), SQUARE.t),
    "a cable hangs in space": ElementMesh([[0, 1, 2], [0, 0, 1], [0, 0, 1]], [[0, 1], [1, 2]]),
    "parts touch in one vertex": ElementMesh([[0, 1, 0, -1, 0], [0, 0, 1, 0, -1]], [[0, 0], [1, 3], [2, 4]]),
}


@pytest.mark.few
@pytest.mark.parametrize("what", GOOD)
def test_a_sound_mesh_passes(what):
    check_mesh(GOOD[what])


def test_coincident_vertices_are_named_in_a_warning():
    mesh = skfem.MeshTri().refined(1)
    p = np.hstack([mesh.p, mesh.p + np.array([[1 + 1e-9], [0]])])
    with (
        pytest.warns(StvkWarning, match="in 2 parts that are not connected"),
        pytest.warns(StvkWarning, match=r"3 vertices \(\d+, \d+, \d+\): at the same point as another.*not connected"),
    ):
        check_mesh(ElementMesh(p, np.hstack([mesh.t, mesh.t + mesh.nvertices])))


def test_parts_that_are_not_connected_are_counted_with_their_sizes():
    p = np.hstack([*(np.array(UNIT_TET) + np.array([[3.0 * i], [0], [0]]) for i in range(7)), [[0], [0], [-1]]])
    t = np.column_stack([np.arange(28).reshape(7, 4).T, [0, 1, 2, 28]])
    mesh = ElementMesh(p, t)
    with pytest.warns(
        StvkWarning, match=r"in 7 parts that are not connected \(5, 4, 4, 4, 4, \.\.\. vertices\): each needs its own"
    ):
        check_mesh(mesh)
    assert np.bincount(parts((mesh,))).tolist() == [5, 4, 4, 4, 4, 4, 4]


def test_straight_needles_are_not_flat():
    """Needles of relative width 1e-6, well-shaped in the cross-section, are not flat."""
    p = np.array([[0, 0, 0], [1, 0, 0], [0, 1e-6, 0], [0, 0, 1e-6]]).T
    assert len(flat_elements(ElementMesh(p, np.arange(4)[:, None]))) == 0


CORNER = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.3, 1.0]])


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [3, 0, 1, 2], [2, 3, 0, 1], [1, 2, 3, 0]])
@pytest.mark.parametrize(("height", "flat"), [(1e-10, False), (1e-13, True)])
def test_flat_is_a_height_of_1e_12_of_the_longest_edge(order, height, flat):
    """The result does not depend on the vertex that is near the plane of the others."""
    p = CORNER * [1, 1, height]
    assert len(flat_elements(ElementMesh(p[order].T, np.arange(4)[:, None]))) == flat


def test_a_tetrahedron_far_away_does_not_make_the_others_flat():
    """The tolerance of an element depends only on its own coordinates."""
    p = np.concatenate([1e-9 * CORNER, 1e9 + CORNER * 1e3])
    assert len(flat_elements(ElementMesh(p.T, np.arange(8).reshape(2, 4).T))) == 0


FLUSHED = """
import ctypes, subprocess, sys, tempfile, pathlib
import numpy as np
folder = pathlib.Path(tempfile.mkdtemp())
(folder / "x.c").write_text("int x;")
if subprocess.run(["cc", "-ffast-math", "-shared", "-fPIC", str(folder / "x.c"), "-o", str(folder / "x.so")]).returncode:
    sys.exit(77)
ctypes.CDLL(str(folder / "x.so"))
if np.nextafter(0, 1) * 1.0 != 0:
    sys.exit(77)
from skfem_stvk import embedded_mesh
from skfem_stvk.mesh.diagnostics import check_mesh
check_mesh(embedded_mesh())
"""


def test_a_mesh_is_checked_where_denormal_numbers_are_flushed_to_zero():
    """A library linked by GCC with -ffast-math flushes denormal numbers to zero; scipy's tree then took all memory."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    run = subprocess.run([sys.executable, "-c", FLUSHED], timeout=60, check=False)
    if run.returncode == 77:
        pytest.skip("this compiler does not flush")
    assert run.returncode == 0


@pytest.mark.parametrize("exponent", [40, -40])
@pytest.mark.parametrize("mesh", [CUBE, SQUARE], ids=["tetrahedra", "triangles"])
def test_soundness_and_energy_density_do_not_depend_on_the_unit_of_length(mesh, exponent):
    size, d = 10.0**exponent, mesh.dim()
    u = 0.03 * np.cos(np.arange(mesh.p.size))
    energies = [
        System((scale * mesh.p, mesh.t), StVK(young=3.0, poisson=0.3)).energy(scale * u) / scale**d for scale in (1.0, size)
    ]
    assert energies[0] > 1e-3 and np.isclose(energies[0], energies[1], rtol=1e-13, atol=0)


@pytest.mark.few
@pytest.mark.parametrize("exponent", [60, 150, 300, -60, -150, -300])
@pytest.mark.parametrize("mesh", [CUBE, SQUARE, skfem.MeshLine().refined(2)], ids=["tetrahedra", "triangles", "segments"])
def test_lengths_out_of_range_are_not_reported_as_missing_volume(mesh, exponent):
    with pytest.raises(MeshError, match=rf"The elements are from 1e-?\d+ to 1e{exponent - 1}|1e{exponent}") as caught:
        check_mesh(ElementMesh(10.0**exponent * mesh.p, mesh.t))
    assert "no volume" not in str(caught.value) and "Choose another unit of length" in str(caught.value)


@pytest.mark.parametrize("size", [1e40, 1e-40, 1e150, 1e-150])
def test_flat_elements_are_found_in_any_unit_of_length(size):
    flat = ElementMesh(size * np.array([[0, 1, 0, 1, 0], [0, 0, 1, 1, 0], [0, 0, 0, 0, 1.0]]), [[0, 0], [1, 1], [2, 2], [3, 4]])
    assert flat_elements(flat).tolist() == [0]


CURVED = {cls: ElementMesh.of(curved(cls)) for cls in (skfem.MeshTet2, skfem.MeshTri2, skfem.MeshHex, skfem.MeshQuad)}
LIFTED = {  # membranes in space and a cable
    "membrane": (CURVED[skfem.MeshTri2], lambda x: [*x, 0.2 * x[0] ** 2]),
    "shell": (CURVED[skfem.MeshQuad], lambda x: [*x, 0.2 * x[0] * x[1]]),
    "cable": (ElementMesh([[0, 1, 2]], [[0, 1], [1, 2]]).with_degree(2), lambda x: [x[0], 0.1 * x[0] ** 2, 0.2 * x[0]]),
}
ALL = [*CURVED.values(), *(ElementMesh(f(mesh.p), mesh.t, element=mesh.element) for mesh, f in LIFTED.values())]


@pytest.mark.few
@pytest.mark.parametrize("mesh", ALL, ids=lambda mesh: mesh.kind)
@pytest.mark.parametrize("scale", [1e-9, 1, 1e9])
def test_curved_elements_and_boxes_are_sound_at_any_size_and_orientation(mesh, scale):
    for mirror in (1, -1):
        p = mesh.p * scale * np.array([[mirror], *[[1]] * (mesh.d - 1)])
        check_mesh(ElementMesh(p, mesh.t, element=mesh.element))
        check_mesh(ElementMesh(rotated(p) + 1e3 * scale, mesh.t, element=mesh.element))


@pytest.mark.parametrize("mesh", ALL, ids=lambda mesh: mesh.kind)
def test_elements_that_fold_over_themselves_are_refused_with_their_ids(mesh):
    """A node of the last element is moved beyond its far side; neighbours at the node may fold, too."""
    node = mesh.t[-1, -1]
    p = mesh.p.copy()
    if mesh.k == 1:
        p[:, node] = p[:, mesh.t[0, -1]] - 0.1
    p[:, node] += 2.5 * (mesh.p[:, mesh.t[:, -1]].mean(axis=1) - p[:, node])
    with pytest.raises(MeshError, match=r"Jacobian vanishes or changes its sign.*in another order") as caught:
        check_mesh(ElementMesh(p, mesh.t, element=mesh.element))
    assert str(mesh.nt - 1) in str(caught.value) or "..." in str(caught.value)
    folded = folded_elements(ElementMesh(p, mesh.t, element=mesh.element))
    assert mesh.nt - 1 in folded and np.isin(folded, np.flatnonzero((mesh.t == node).any(axis=0))).all()


@pytest.mark.parametrize("name", ["quadratic triangles", "quadratic tetrahedra"])
@pytest.mark.parametrize(("past", "sound"), [(-1e-4, True), (0, False), (1e-4, False)])
def test_an_edge_may_be_curved_until_the_jacobian_vanishes_at_a_node(name, past, sound):
    """A middle node at a quarter of a straight edge makes the Jacobian zero at the end, and at no inner point."""
    element = ELEMENTS[name]
    straight = ElementMesh(element.nodes[: element.corners].T, np.arange(element.corners)[:, None]).with_degree(2)
    p = straight.p.copy()
    p[0, straight.t[element.corners]] = 0.25 - past
    mesh = ElementMesh(p, straight.t, element=element)
    points = np.concatenate([rule_of(element, kind).points for kind in ("usual", "exact")])
    assert jacobians(mesh, points).min() > 0
    assert len(folded_elements(mesh)) == (not sound)


def test_a_hexahedron_in_meshios_order_is_refused():
    element = ELEMENTS["hexahedra"]
    mesh = ElementMesh(element.nodes[[0, 4, 3, 1, 7, 5, 2, 6]].T, np.arange(8)[:, None], element=element)
    with pytest.raises(MeshError, match=r"1 element \(0\): the Jacobian.*their vertices in another order \(scikit-fem's RefHex"):
        check_mesh(mesh)


@pytest.mark.parametrize("mesh", [skfem.MeshTet2, skfem.MeshHex])
def test_faulty_nodes_of_quadratic_and_hexahedral_meshes_are_named(mesh):
    good = CURVED[mesh]
    p = good.p.copy()
    p[0, [3, 9]] = np.nan
    words = good.words
    with pytest.raises(MeshError, match=rf"2 {words} \(3, 9\): coordinates that are not finite"):
        check_mesh(ElementMesh(p, good.t, element=good.element))
    with pytest.raises(MeshError, match=r"1 element \(\d+\): the same vertices as an earlier element"):
        check_mesh(ElementMesh(good.p, np.column_stack([good.t, good.t[:, 5]]), element=good.element))


@pytest.mark.parametrize("path", [None, "mesh.vtu"])
def test_elements_that_fold_are_straightened_alone(path, tmp_path):
    """Other elements stay curved, and nodes that neighbours share move once."""
    whole = box((1.0, 1.0, 1.0), (2, 2, 2)).with_degree(2)
    p = whole.p.copy()
    middles = np.arange(whole.nvertices, whole.nv)
    p[:, middles] += 0.02 * np.random.default_rng(0).standard_normal((3, len(middles)))  # curved everywhere
    corner = whole.t[4, 7]
    p[:, corner] = p[:, whole.t[2, 7]]  # the middle of an edge, at another corner
    mesh = replace(whole, p=p)
    folded = folded_elements(mesh)
    assert 0 < len(folded) < whole.nt
    with pytest.raises(MeshError, match=r"fold over themselves.*read_mesh\(path, straighten=True\)"):
        check_mesh(mesh)
    with pytest.warns(StvkWarning, match=f"^{len(folded)} elements .*: straightened, because they fold over themselves"):
        found = read_mesh(write_mesh(tmp_path / path, mesh), straighten=True) if path else straightened(mesh)
    check_mesh(found)
    straight = np.setdiff1d(whole.t[4:, folded], [])
    assert np.allclose(found.p[:, straight], whole.p[:, straight]) and np.array_equal(
        found.p[:, : whole.nvertices], p[:, : whole.nvertices]
    )
    others = np.setdiff1d(middles, straight)
    assert len(others) and np.array_equal(found.p[:, others], p[:, others]) and straightened(whole) is whole
