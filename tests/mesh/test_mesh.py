"""ElementMesh accepts all meshes of known elements, and refuses other arguments with the cause."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import skfem
from meshfiles import CUBE, FIVE_TETS, curved

from skfem_stvk import ElementMesh, MeshError, RegionError, StVK, StvkWarning, System, arguments
from skfem_stvk.arguments import check_index_range
from skfem_stvk.edges.topology import kernel_edges, pairs_of
from skfem_stvk.mesh.element import ELEMENTS, LOCAL_EDGES
from skfem_stvk.mesh.facets import facets_of, outer_facets, pairs_in

TRIANGLES = skfem.MeshTri().refined(2).with_subdomains({"left": lambda x: x[0] < 0.5})


@pytest.mark.parametrize(
    ("p", "t", "message"),
    [
        (np.zeros(3), [[0], [1]], r"p has shape \(3,\); expected \(d, nv\).*Transpose"),
        (np.zeros((4, 3)), [[0], [1]], r"p has shape \(4, 3\); expected \(d, nv\) with d = 1, 2 or 3"),
        (np.zeros((2, 4)), [[0], [1], [2], [3]], r"t has shape \(4, 1\) in a space of 2 dimensions; .* 1 <= k <= 2"),
        (np.zeros((3, 4)), [0, 1, 2, 3], r"t has shape \(4,\).*Transpose"),
        (np.zeros((3, 4)), [[0]], r"t has shape \(1, 1\)"),
        (np.zeros((3, 4)), np.zeros((4, 0), dtype=int), "has no elements"),
        (np.zeros((1, 2)), [[0.0], [1.0]], "t has dtype float64; expected integers"),
        (np.zeros((1, 2)), [[True], [False]], "t has dtype bool; expected integers"),
        (np.zeros((1, 2)), [[1, 0], [2, 1]], r"1 element \(0\): vertex ids outside 0 \.\.\. 1\. Are the ids counted from 1"),
        (np.zeros((1, 2)), [[1, 0, -1], [0, 1, 1]], r"1 element \(2\): vertex ids outside"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused_with_the_expected_shape(p, t, message):
    with pytest.raises(MeshError, match=message):
        ElementMesh(p, t)


def test_counts_beyond_32_bit_indices_are_refused():
    check_index_range(2**31 - 1, "elements")
    with pytest.raises(MeshError, match=r"2147483648 elements are more than 32-bit indices can count \(2147483647\)"):
        check_index_range(2**31, "elements")


@pytest.mark.parametrize("kind", ["tetrahedra", "quadratic triangles", "hexahedra"])
def test_counts_of_facets_and_pairs_beyond_the_largest_index_are_refused_before_they_are_made(kind, monkeypatch):
    """Indices wrapped above 537 million tetrahedra."""
    quadratic = ElementMesh.of(TRIANGLES).with_degree(2)
    mesh = {"tetrahedra": skfem.MeshTet().refined(1), "hexahedra": skfem.MeshHex().refined(1)}.get(kind, quadratic)
    mesh = ElementMesh.of(mesh)
    element, n = mesh.element, mesh.nt
    calls = {
        "facets": (len(element.facets), lambda: facets_of(mesh.t, mesh.nv, element), lambda: outer_facets(mesh)),
        "pairs of nodes": (len(element.pairs), lambda: kernel_edges(mesh.t, element), lambda: pairs_of(mesh.t, element)),
    }
    for what, (each, *makers) in calls.items():
        for make in makers:
            monkeypatch.setattr(arguments, "LARGEST_INDEX", each * n)
            make()
            monkeypatch.setattr(arguments, "LARGEST_INDEX", each * n - 1)
            with pytest.raises(MeshError, match=rf"{each * n} {what} of elements are more than 32-bit indices can count"):
                make()
    many = np.broadcast_to(np.arange(4, dtype=np.int32)[:, None], (4, 540_000_000))
    with pytest.raises(MeshError, match="2160000000 facets of elements are more than 32-bit"):
        facets_of(many, 4)
    with pytest.raises(MeshError, match="3240000000 pairs of nodes of elements are more than 32-bit"):
        pairs_in(many, LOCAL_EDGES[3], 4)


@pytest.mark.parametrize(("cls", "k"), [(skfem.MeshLine, 1), (skfem.MeshTri, 2), (skfem.MeshTet, 3)])
def test_a_scikit_fem_mesh_keeps_its_vertices_elements_and_subdomains(cls, k):
    given = cls().refined(2).with_subdomains({"left": lambda x: x[0] < 0.5})
    mesh = ElementMesh.of(given)
    assert (mesh.k, mesh.d, mesh.nv, mesh.nt) == (k, k, given.nvertices, given.nelements)
    assert np.array_equal(mesh.p, given.p) and np.array_equal(mesh.t, given.t)
    assert np.array_equal(mesh.elements("left"), given.subdomains["left"])


@pytest.mark.parametrize("cls", [skfem.MeshTet2, skfem.MeshTri2, skfem.MeshHex, skfem.MeshQuad])
def test_nodes_are_scikit_fems_degrees_of_freedom_and_edges_stay_curved(cls):
    given = curved(cls)
    mesh = ElementMesh.of(given)
    assert np.array_equal(mesh.p, given.doflocs) and np.array_equal(mesh.t, given.dofs.element_dofs)
    assert mesh.element.name.split()[-1] in {"tetrahedra", "triangles", "hexahedra", "quadrilaterals"}
    assert np.array_equal(mesh.corners, given.t)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_straight_quadratic_simplices_are_numbered_as_scikit_fems_element_is(k):
    straight = [skfem.MeshLine, skfem.MeshTri, skfem.MeshTet][k - 1]().refined(2)
    element = [skfem.ElementLineP2(), skfem.ElementTriP2(), skfem.ElementTetP2()][k - 1]
    basis = skfem.Basis(straight, element)
    mesh = ElementMesh.of(straight).with_degree(2)
    assert np.array_equal(mesh.t, basis.dofs.element_dofs) and np.allclose(mesh.p, basis.doflocs, atol=1e-15)


@pytest.mark.parametrize("cls", [skfem.MeshQuad2, skfem.MeshHex2, skfem.MeshWedge1])
def test_other_cells_are_refused_by_name_with_an_alternative(cls):
    with pytest.raises(MeshError, match=rf"^{cls.__name__} is .*(MeshHex1|MeshQuad1)\(mesh|to_meshtet\(\)"):
        ElementMesh.of(cls())


def test_a_pair_of_arrays_is_a_mesh_and_a_mesh_is_returned_unchanged():
    mesh = ElementMesh.of(([[0, 1, 2], [0, 0, 1], [0, 0, 1]], [[0, 1], [1, 2]]))
    assert repr(mesh) == "ElementMesh: 2 segments in 3D, 3 vertices"
    assert ElementMesh.of(mesh) is mesh


@pytest.mark.parametrize("given", ["mesh.msh", 3, (1, 2, 3), None])
def test_objects_that_are_no_mesh_are_refused(given):
    with pytest.raises(MeshError, match=r"mesh = .*; expected a scikit-fem mesh.*Read files with read_mesh"):
        ElementMesh.of(given)


def test_the_arrays_of_the_caller_are_copied():
    p, t = np.array([[0.0, 1.0]]), np.array([[0], [1]], dtype=np.int32)
    mesh = ElementMesh(p, t)
    p[:], t[:] = 7, 0
    assert mesh.p.tolist() == [[0, 1]] and mesh.t.tolist() == [[0], [1]]


def test_a_region_is_a_name_ids_a_mask_or_everything():
    mesh = ElementMesh.of(TRIANGLES)
    left = TRIANGLES.subdomains["left"]
    mask = np.isin(np.arange(mesh.nt), left)
    for region in ("left", left, left.tolist(), mask):
        assert np.array_equal(mesh.elements(region), left)
    assert np.array_equal(mesh.elements(None), np.arange(mesh.nt))


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ("right", "no subdomain 'right'; known: 'left'"),
        ([], r"The region is \[\]; expected a list of at least one element id"),
        ([0.0, 1.0], r"The region is \[0\.0, 1\.0\]; expected a list"),
        ([[0, 1]], r"The region is \[\[0, 1\]\]"),
        (np.zeros((1, 2), dtype=int), r"The region is an array of shape \(1, 2\) and dtype int64; expected a list"),
        ([[0, 1], [2]], r"The region is \[\[0, 1\], \[2\]\]"),
        (np.zeros(32, dtype=bool), "a mask with no True; expected at least one element"),
        (np.ma.masked_equal([0, 1], 1), "The region is an array of shape"),
        (np.ones(7, dtype=bool), r"mask of shape \(7,\); expected one value for each of the 32 elements"),
        ([0, 32, -1], r"names 2 elements \(32, -1\) outside 0 \.\.\. 31"),
        ([4, 5, 5, 4, 3], r"names 2 elements \(4, 5\) more than once"),
    ],
)
def test_an_invalid_region_is_refused_with_its_ids(region, message):
    with pytest.raises(RegionError, match=message):
        ElementMesh.of(TRIANGLES).elements(region)


def test_a_subdomain_that_is_out_of_range_is_refused_by_its_name():
    mesh = ElementMesh([[0, 1]], [[0], [1]], {"rod": [0, 1], "hole": []})
    with pytest.raises(RegionError, match=r"Subdomain 'rod' names 1 element \(1\) outside 0 \.\.\. 0"):
        mesh.elements("rod")
    with pytest.raises(RegionError, match=r"Subdomain 'hole' is \[\]; expected"):
        mesh.elements("hole")


def test_an_unknown_subdomain_of_a_mesh_without_subdomains_is_refused():
    with pytest.raises(RegionError, match="no subdomain 'rod'; known: none"):
        ElementMesh([[0, 1]], [[0], [1]]).elements("rod")


@pytest.mark.parametrize(
    ("p", "t", "message"),
    [
        (np.eye(3, 4) * (1 + 1j), [[0], [1], [2], [3]], r"p = .*complex128; expected \(d, nv\) real numbers"),
        ([["0", "1"]], [[0], [1]], r"p = \[\['0', '1'\]\]; expected \(d, nv\) real numbers"),
        ([[False, True]], [[0], [1]], "p = .*; expected .* real numbers"),
        ([[0, 1], [1]], [[0], [1]], r"p = \[\[0, 1\], \[1\]\]; expected .* real numbers"),
        (np.ma.masked_equal([[0.0, 1.0, 2.0]], 2.0), [[0], [1]], "p = .*; expected .* real numbers"),
        ([[0.0, 1.0]], [[0], [1, 0]], r"t = \[\[0\], \[1, 0\]\]; expected \(k \+ 1, nt\) whole numbers"),
        ([[0.0, 1.0]], np.ma.masked_equal([[0, 1], [1, 0]], 0), "t = .*; expected .* whole numbers"),
        ([[0.0, 1.0]], [["0"], ["1"]], "t has dtype <U1; expected integers"),
    ],
)
def test_coordinates_and_ids_of_wrong_types_are_refused(p, t, message):
    with pytest.raises(MeshError, match=message):
        ElementMesh(p, t)


def test_arrays_may_be_given_as_a_list():
    mesh = ElementMesh.of([TRIANGLES.p, TRIANGLES.t])
    assert np.array_equal(mesh.p, TRIANGLES.p) and np.array_equal(mesh.t, TRIANGLES.t)


def test_a_mesh_of_meshio_is_converted_like_its_file():
    tags = [np.array([7, 7, 7, 9, 9]), np.array([4])]
    given = meshio.Mesh(np.array(CUBE, dtype=float), [("tetra", FIVE_TETS), ("triangle", [[0, 1, 3]])], cell_data={"part": tags})
    mesh = ElementMesh.of(given)
    assert mesh.t.T.tolist() == FIVE_TETS and mesh.p.T.tolist() == CUBE
    assert mesh.elements("part:9").tolist() == [3, 4] and mesh.boundaries["part:4"].T.tolist() == [[0, 1, 3]]


@pytest.mark.parametrize(
    ("points", "tets", "message"),
    [
        (CUBE, [[0, 1, 3, 8]], r"1 tetra cell \(0\) with vertex ids outside 0 \.\.\. 7"),
        (CUBE, [[0, 1, 3, -4]], r"1 tetra cell \(0\) with vertex ids outside"),
        (CUBE, [[0.0, 1.0, 3.0, 4.0]], "its tetra cells are not rows of vertex ids"),
        (np.array(CUBE) * 1j, FIVE_TETS, "its points are not rows of real numbers"),
        (np.array(CUBE) * np.nan, FIVE_TETS, "8 vertices .* with coordinates that are not finite"),
    ],
)
def test_an_inconsistent_mesh_of_meshio_is_refused(points, tets, message):
    with pytest.raises(MeshError, match=f"^The meshio.Mesh is not a valid mesh: .*{message}"):
        ElementMesh.of(meshio.Mesh(np.array(points), [("tetra", np.array(tets))]))


def test_periodic_meshes_are_refused_with_a_remedy():
    periodic = skfem.MeshTri1DG.periodic(skfem.MeshTri().refined(1), [0], [1])
    with pytest.raises(MeshError, match=r"MeshTri1DG is periodic or discontinuous.*Use the mesh that it was made of"):
        ElementMesh.of(periodic)


@pytest.mark.parametrize("cls", [skfem.MeshTet2, skfem.MeshTri2])
def test_a_curved_mesh_of_degree_one_has_its_corners_and_a_warning(cls):
    curved_mesh = ElementMesh.of(curved(cls))
    sets, rope = {"some": np.array([0, curved_mesh.nv - 1])}, curved_mesh.t[[0, 1, curved_mesh.element.corners], :1]
    curved_mesh = replace(curved_mesh, node_sets=sets, lines={"rope": rope})
    n, ne = curved_mesh.nvertices, curved_mesh.nv - curved_mesh.nvertices
    with pytest.warns(
        StvkWarning, match=rf"reduced to their corners, {n} vertices: {ne} of their {ne} edges are curved and become"
    ):
        mesh = curved_mesh.with_degree(1)
    assert np.array_equal(mesh.p, curved_mesh.p[:, :n]) and np.array_equal(mesh.t, curved_mesh.corners)
    assert np.array_equal(mesh.boundaries["wall"], curved_mesh.boundaries["wall"][: mesh.k]) and mesh.boundaries["wall"].size
    assert mesh.node_sets["some"].tolist() == [0] and np.array_equal(mesh.elements("left_half"), curved_mesh.elements("left_half"))
    again = mesh.with_degree(2)
    assert mesh.lines["rope"].tolist() == rope[:2].tolist() and again.lines["rope"].tolist() == rope.tolist()
    assert np.array_equal(again.t, curved_mesh.t) and again.with_degree(2) is again
    with pytest.warns(StvkWarning, match=": 0 of their"):
        again.with_degree(1)


@pytest.mark.parametrize("lazy", [True, False])
@pytest.mark.parametrize(("cls", "k"), [(skfem.MeshLine, 1), (skfem.MeshTri, 2), (skfem.MeshTet, 3)])
def test_boundaries_and_node_sets_of_degree_two_contain_middles_of_edges(cls, k, lazy):
    mesh = ElementMesh.of(cls().refined(2).with_boundaries({"wall": lambda x: x[0] == 0}))
    wall = np.flatnonzero(mesh.p[0] == 0)
    boundaries = mesh.boundaries if lazy else {"wall": mesh.boundaries["wall"][::-1]}
    mesh = ElementMesh(mesh.p, mesh.t, {}, boundaries, {"face": wall, "mask": mesh.p[0] == 0, "one": wall[:1], "none": []})
    quadratic = mesh.with_degree(2)
    at_wall = np.flatnonzero(quadratic.p[0] == 0)
    facets = quadratic.boundaries["wall"]
    assert len(facets) == quadratic.facet.n and np.array_equal(np.unique(facets), at_wall)
    for i, (a, b) in enumerate(quadratic.facet.edges if k > 1 else ()):
        assert np.array_equal(quadratic.p[:, facets[k + i]], quadratic.p[:, facets[[a, b]]].mean(axis=1))
    assert quadratic.node_sets["face"].tolist() == quadratic.node_sets["mask"].tolist() == at_wall.tolist()
    assert quadratic.node_sets["one"].tolist() == wall[:1].tolist() and set(quadratic.node_sets) == {"face", "mask", "one"}


@pytest.mark.parametrize("degree", [0, 3, 1.0, True, None, "2"])
def test_another_degree_is_refused(degree):
    with pytest.raises(MeshError, match=r"degree = .*; expected 1 or 2"):
        ElementMesh.of(TRIANGLES).with_degree(degree)


def test_boxes_have_no_second_degree():
    boxes = ElementMesh.of(skfem.MeshHex())
    assert boxes.with_degree(1) is boxes
    with pytest.raises(MeshError, match=r"degree = 2, but the elements are hexahedra.*Leave the degree out, or split them"):
        boxes.with_degree(2)


@pytest.mark.parametrize("numbers", [[1, 0, 2, 3, 4, 5], [3, 4, 5, 0, 1, 2], [0, 1, 2, 4, 3, 5]])
def test_quadratic_simplices_with_other_numbers_are_refused_with_the_expected_order(numbers):
    mesh = ElementMesh([[0, 1, 0], [0, 0, 1]], [[0], [1], [2]]).with_degree(2)
    rows = np.array([0, 1, 2, *mesh.t[3:, 0]])[numbers]
    with pytest.raises(MeshError, match=r"1 element \(0\): nodes are not numbered as scikit-fem.*order of mesh.facets"):
        ElementMesh(mesh.p, rows[:, None], element=mesh.element)


def test_nodes_that_do_not_fit_the_element_are_refused():
    with pytest.raises(
        MeshError, match=r"t has shape \(3, 1\) in a space of 2 dimensions; expected \(6, nt\), the nodes of quadratic"
    ):
        ElementMesh([[0, 1, 0], [0, 0, 1]], [[0], [1], [2]], element=ELEMENTS["quadratic triangles"])


@pytest.mark.parametrize("name", ["tetrahedra", "quadratic tetrahedra", "quadratic triangles", "quadratic segments", "hexahedra"])
def test_a_renumbered_mesh_is_the_same_body(name):
    """The numbering is still scikit-fem's, names remain, and the matrix has a smaller bandwidth."""
    rng, s = np.random.default_rng(0), np.linspace(0, 1, 5)
    given = {
        "tet": skfem.MeshTet.init_tensor(s, s, s),
        "hex": skfem.MeshHex.init_tensor(s, s, s),
        "tri": skfem.MeshTri().refined(3),
    }
    mesh = ElementMesh.of(given.get(name.split()[-1][:3], (s[None], [[0, 1, 2, 3], [1, 2, 3, 4]])))
    mesh = replace(mesh.with_boundaries({"left": lambda x: x[0] == 0}), node_sets={"some": [1, 3]})
    order = rng.permutation(mesh.nv).astype(np.int32)
    number = np.argsort(order).astype(np.int32)
    boundaries = {key: number[facets] for key, facets in mesh.boundaries.items()}
    sets = {key: number[np.asarray(ids)] for key, ids in mesh.node_sets.items()}
    lines = {"rope": number[mesh.t[:2, :2]]} if mesh.k > 1 else {}
    shuffled = replace(mesh, p=mesh.p[:, order], t=number[mesh.t], boundaries=boundaries, node_sets=sets, lines=lines)
    if name.startswith("quadratic"):
        shuffled = shuffled.with_degree(2)
    new, nodes = shuffled.renumbered()
    np.testing.assert_array_equal(new.p, shuffled.p[:, nodes])
    np.testing.assert_array_equal(nodes[new.t], shuffled.t)
    for key in ("left",):
        np.testing.assert_array_equal(nodes[new.boundaries[key]], shuffled.boundaries[key])
    for key in lines:
        np.testing.assert_array_equal(nodes[new.lines[key]], shuffled.lines[key])
    assert set(nodes[new.node_sets["some"]]) == set(shuffled.node_sets["some"])
    width = [np.abs(np.diff(m.corners, axis=0)).max() for m in (new, shuffled)]
    assert width[0] < width[1] or mesh.k == 1
    terms = StVK(young=1.0, poisson=0.3)
    u = 0.1 * rng.normal(size=shuffled.p.T.shape)
    F = [System(m, terms).internal_force(x.ravel()).reshape(-1, mesh.d) for m, x in ((new, u[nodes]), (shuffled, u))]
    np.testing.assert_allclose(F[0], F[1][nodes], atol=1e-14 * np.abs(F[1]).max())


@pytest.mark.parametrize(
    ("d", "shape", "words"),
    [
        (2, (4, 1), r"Are they quadrilaterals\? .*element=ELEMENTS\['quadrilaterals'\]\)"),
        (3, (8, 1), "Are they hexahedra"),
        (2, (6, 1), "Are they quadratic triangles"),
        (3, (10, 2), "Are they quadratic tetrahedra"),
        (3, (5, 2), "tetrahedra. Transpose"),
    ],
)
def test_arrays_of_other_elements_are_refused_with_the_right_call(d, shape, words):
    with pytest.raises(MeshError, match=words):
        ElementMesh(np.random.default_rng(0).random((d, 12)), np.zeros(shape, dtype=int))


def test_a_vertex_among_the_middles_is_refused_with_its_element():
    with pytest.raises(MeshError, match=r"^1 element \(1\): nodes are not numbered as scikit-fem"):
        ElementMesh([[0.0, 2, 1, 4, 3]], [[0, 1], [1, 3], [2, 4]], element=ELEMENTS["quadratic segments"])
