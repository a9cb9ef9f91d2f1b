"""Locations by name, ids, masks and predicates."""

import numpy as np
import pytest
import skfem
from bodies import MESHES, box, sheet
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, MeshError, RegionError
from skfem_stvk.mesh.facets import boundary_facets, facets_of, find_facets
from skfem_stvk.mesh.locations import describe, facets_at, vertices_at

MESH = box()
LEFT = np.flatnonzero(MESH.p[0] < 0.5)


def as_sets(facets):
    return {tuple(sorted(facet)) for facet in facets.T.tolist()}


@pytest.mark.parametrize("name", MESHES)
def test_a_predicate_ids_a_mask_and_a_node_set_are_equivalent(name):
    mesh = MESHES[name]
    mask = mesh.p[0] < 0.6
    ids = np.flatnonzero(mask)
    mesh = ElementMesh(mesh.p, mesh.t, node_sets={"left": ids[::-1]})
    for where in (lambda x: x[0] < 0.6, ids, ids[::-1].tolist(), tuple(ids), mask, "left"):
        found = vertices_at(mesh, where)
        assert np.array_equal(found, ids[::-1] if isinstance(where, list) else ids)  # listed ids keep their order
        assert np.array_equal(facets_at(mesh, where), mesh.surface[:, mask[mesh.surface].all(axis=0)])


def test_facets_of_a_predicate_are_those_of_scikit_fem():
    mesh = skfem.MeshTet().refined(2)
    expected = mesh.facets_satisfying(lambda x: x[0] == 0, boundaries_only=True)
    assert as_sets(facets_at(ElementMesh.of(mesh), lambda x: x[0] == 0)) == as_sets(mesh.facets[:, expected])


def test_a_boundary_gives_its_facets_once_and_their_vertices():
    facets = MESH.surface[:, [4, 2, 4]]
    mesh = ElementMesh(MESH.p, MESH.t, boundaries={"some": np.concatenate([facets, facets[::-1]], axis=1)})
    assert facets_at(mesh, "some").shape == (3, 2)
    assert as_sets(facets_at(mesh, "some")) == as_sets(facets)
    assert np.array_equal(vertices_at(mesh, "some"), np.unique(facets))


def test_a_name_of_a_boundary_and_of_a_node_set_must_mean_the_same_vertices():
    facets = MESH.surface[:, :2]
    same = ElementMesh(MESH.p, MESH.t, boundaries={"a": facets}, node_sets={"a": np.unique(facets)})
    assert np.array_equal(vertices_at(same, "a"), np.unique(facets))
    other = ElementMesh(MESH.p, MESH.t, boundaries={"a": facets}, node_sets={"a": [1, 2]})
    with pytest.raises(
        RegionError, match=r"fixed: 'a' is the name of a boundary with \d vertices and of a node set with 2 others.*Say which"
    ):
        vertices_at(other, "a", "fixed")


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("Wal", r"^It: the mesh has no boundary or node set 'Wal'; known: 'tip', 'wall'\. Did you mean 'wall'\?$"),
        ("TIP", r"known: 'tip', 'wall'\. Did you mean 'tip'\?$"),
        ("steel", r"known: 'tip', 'wall'\. It is a subdomain: for its vertices, np\.unique\("),
        ("empty", r"It: no vertex there\. 'empty' is empty"),
        ("wall", r"Boundary 'wall' has shape \(2, 1\) and dtype int64; expected \(3, n\), n > 0"),
        ([], r"It: no vertex there"),
        ([1, 64], r"It: the vertices name 1 vertex \(64\) outside 0 \.\.\. 63"),
        ([-1], r"name 1 vertex \(-1\) outside"),
        (
            [0.5],
            r"are \[0\.5\]; expected the name of a boundary or of a node set, a list of vertex ids, a mask, a predicate",
        ),
        (3, r"the vertices are 3; expected the name"),
        ([[3], [4, 5]], r"the vertices are \[\[3\], \[4, 5\]\]; expected the name"),
        (None, r"the vertices are None; expected the name of a boundary"),
        (np.ma.masked_equal([1, 2], 2), r"expected the name of a boundary"),
        ([7, 3, 7, 3, 1], r"the vertices name 2 vertices \(3, 7\) more than once"),
        (np.ones(3, dtype=bool), r"a mask of shape \(3,\); expected one value for each of the 64 vertices"),
        (
            lambda x: x[0] == 99,
            r"none of the 64 vertices satisfies the predicate '<lambda>'\. The mesh has x\[0\] from -0\.\d+ to 1\.\d+.*np\.isclose",
        ),
        (lambda x: x[3] == 0, r"failed with IndexError.*It gets coordinates x of shape \(3, 64\): x\[0\] \.\.\. x\[2\]"),
        (lambda x: x[0], r"returned shape \(64,\) and dtype float64; expected a mask \(64,\)"),
        (lambda x: True, r"returned shape \(\) and dtype bool; expected a mask"),
    ],
)
def test_an_invalid_or_empty_location_is_refused_with_the_cause(where, message):
    mesh = ElementMesh(MESH.p, MESH.t, {"steel": [0]}, {"wall": np.array([[0], [1]])}, {"tip": [5]})
    if isinstance(where, str) and where == "empty":
        mesh = ElementMesh(MESH.p, MESH.t, node_sets={"empty": []})
    with pytest.raises(RegionError, match=message):
        vertices_at(mesh, where, "It")


def test_facets_of_a_boundary_outside_the_mesh_are_refused():
    mesh = ElementMesh(MESH.p, MESH.t, boundaries={"wall": np.array([[0, 1], [1, 2], [2, 64]])})
    with pytest.raises(RegionError, match=r"Boundary 'wall': 1 facet \(1\) with vertex ids outside 0 \.\.\. 63"):
        facets_at(mesh, "wall")


def test_vertices_without_a_facet_are_counted_in_the_message():
    with pytest.raises(
        RegionError, match=r"It: 2 vertices \(0, 1\) has 2 vertices|none of the 108 boundary facets has all its vertices there"
    ):
        facets_at(MESH, [0, 1], "It")


def test_a_predicate_cannot_change_the_mesh():
    before = MESH.p.copy()
    vertices_at(MESH, lambda x: (np.multiply(x, 0, out=x) == 0).all(axis=0))
    assert np.array_equal(MESH.p, before)


def test_locations_are_described_in_messages():
    from functools import partial

    assert describe(np.array([False, True, True])) == "2 vertices (1, 2)"
    assert describe(partial(np.isclose, 1)) == "the predicate 'partial'"


@given(st.integers(0, 10_000))
def test_facets_are_found_for_any_order_of_their_vertices(seed):
    rng = np.random.default_rng(seed)
    for mesh in (MESH, sheet()):
        chosen = rng.permutation(mesh.surface.shape[1])[:5]
        wanted = rng.permuted(mesh.surface[:, chosen], axis=0)
        assert np.array_equal(find_facets(wanted, mesh.surface, mesh.nv), chosen)
    strange = np.array([[0], [0], [0]])
    assert find_facets(strange, MESH.surface, MESH.nv).tolist() == [-1]


@pytest.mark.parametrize("mesh", [skfem.MeshTet().refined(2), skfem.MeshTri.init_circle(2), skfem.MeshLine().refined(3)])
def test_facets_are_scikit_fems_in_the_same_order(mesh):
    facets, t2f = facets_of(mesh.t.astype(np.int32), mesh.nvertices)
    assert np.array_equal(facets, mesh.facets)
    for element in range(mesh.nelements):
        assert sorted(t2f[:, element]) == sorted(mesh.t2f[:, element])
        for corner in range(len(mesh.t)):
            assert set(facets[:, t2f[corner, element]]) == set(mesh.t[:, element]) - {mesh.t[corner, element]}


def test_the_boundary_of_triangles_has_the_body_on_its_left():
    """The area by Green's theorem is right for both orientations of triangles, and the boundary is one closed path."""
    mesh = sheet()
    facets = boundary_facets(mesh)
    (xa, xb), (ya, yb) = mesh.p[:, facets]
    a, b, c = mesh.p[:, mesh.t].transpose(1, 0, 2)
    area = np.abs(np.linalg.det(np.stack([b - a, c - a]).transpose(2, 0, 1))).sum() / 2
    assert (xa * yb - xb * ya).sum() / 2 == pytest.approx(area, rel=1e-13)
    assert np.array_equal(np.sort(facets[0]), np.sort(facets[1]))


def test_the_surface_is_found_once_and_cannot_be_written_to():
    mesh = box()
    assert mesh.surface is mesh.surface
    with pytest.raises(ValueError, match="read-only"):
        mesh.surface[0, 0] = 1


@pytest.mark.parametrize(
    "mesh", [skfem.MeshTet().refined(2), skfem.MeshTri.init_circle(2), skfem.MeshLine().refined(3), skfem.MeshTet2().refined(1)]
)
def test_boundaries_of_a_scikit_fem_mesh_are_adopted(mesh):
    named = mesh.with_boundaries({"wall": lambda x: x[0] < 0.2, "inner": np.array([4, 2])})
    simplices = ElementMesh.of(named)
    assert set(simplices.boundaries) == {"wall", "inner"} and len(simplices.boundaries) == 2
    for name, facets in simplices.boundaries.items():
        assert np.array_equal(facets[: simplices.k], named.facets[:, np.asarray(named.boundaries[name])])
    with pytest.raises(KeyError):
        simplices.boundaries["tip"]


def test_facets_of_a_scikit_fem_mesh_are_computed_lazily(monkeypatch):
    from skfem_stvk.mesh import facets

    mesh = skfem.MeshTet().refined(1).with_boundaries({"wall": lambda x: x[0] == 0})
    monkeypatch.setattr(facets, "facets_of", lambda *a: pytest.fail("looked for facets"))
    simplices = ElementMesh.of(mesh)
    assert "wall" in simplices.boundaries and list(simplices.boundaries) == ["wall"] and "wall" in repr(simplices.boundaries)
    assert ElementMesh.of(skfem.MeshTet()).boundaries == {}


def test_named_parts_of_a_mesh_may_be_left_out():
    assert ElementMesh(MESH.p, MESH.t, None, None, None).node_sets == {}
    assert issubclass(MeshError, ValueError)


def test_degrees_of_freedom_with_unknowns_of_other_kinds_are_refused():
    square = skfem.MeshTri()
    both = skfem.Basis(square, skfem.ElementVector(skfem.ElementTriP1()) * skfem.ElementTriP0())
    with pytest.raises(RegionError, match=r"expected those of linear vectors with 2 components, such as .*ElementTriP1"):
        vertices_at(ElementMesh.of(square), both.get_dofs(lambda x: x[0] == 0))
