"""Facets, boundary facets and their orientation agree with scikit-fem's."""

import numpy as np
import pytest
import skfem
from bodies import box, element_sizes, values_at
from meshfiles import curved

from skfem_stvk import ElementMesh
from skfem_stvk.mesh.facets import (
    boundary_facets,
    edges_of,
    faces_to_reverse,
    facet_ids,
    facets_of,
    find_facets,
    with_midpoints,
)
from skfem_stvk.mesh.points import base_vectors_at, measures_of, normals_of, rule_of, sizes_of

KINDS = [skfem.MeshTet2, skfem.MeshTri2, skfem.MeshHex, skfem.MeshQuad]


@pytest.mark.parametrize("mesh", [skfem.MeshTet().refined(2), skfem.MeshTri.init_circle(2), skfem.MeshLine().refined(3)])
def test_facets_and_boundary_are_scikit_fems(mesh):
    simplices = ElementMesh.of(mesh)
    assert facet_ids(simplices).max() + 1 == mesh.nfacets
    assert boundary_facets(simplices).shape[1] == len(mesh.boundary_facets())
    assert np.array_equal(np.unique(simplices.surface), np.sort(mesh.boundary_nodes()))


def test_boundary_facets_of_tetrahedra_are_oriented_outwards():
    """The flux of x through the surface is three times the volume, with tetrahedra of both orientations."""
    mesh = box(3)
    a, b, c = mesh.p[:, boundary_facets(mesh)].transpose(1, 2, 0)
    flux = ((a + b + c) / 3 * np.cross(b - a, c - a) / 2).sum()
    x = mesh.p.T[mesh.t.T]
    volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])).sum() / 6
    assert flux == pytest.approx(3 * volume, rel=1e-12)


@pytest.mark.parametrize("cls", KINDS)
def test_facets_of_all_elements_are_scikit_fems_with_their_middles(cls):
    given = curved(cls)
    mesh = ElementMesh.of(given)
    facets, t2f = facets_of(mesh.t, mesh.nv, mesh.element)
    corners = len(given.facets)
    assert np.array_equal(facets[:corners], given.facets) and np.array_equal(facet_ids(mesh), t2f)
    assert np.array_equal(np.sort(t2f, axis=0), np.sort(given.t2f, axis=0))
    assert len(facets) == mesh.facet.n and np.array_equal(mesh.boundaries["wall"], facets[:, given.boundaries["wall"]])
    found = find_facets(mesh.surface, facets, mesh.nv)
    assert np.array_equal(np.sort(found), given.boundary_facets())
    if mesh.element.degree == 2:
        edges = edges_of(mesh.corners, mesh.element, mesh.nvertices)[0]
        assert np.array_equal(with_midpoints(facets[:corners], mesh.facet, [edges], mesh.nvertices), facets)
        ends = [facets[[a, b]] for a, b in mesh.facet.edges]
        on = np.abs(mesh.p[:, facets[corners:]] - np.stack([mesh.p[:, e].mean(axis=1) for e in ends], axis=1))
        assert on.max() < 0.05  # a middle is near the middle of its own edge


@pytest.mark.parametrize("cls", KINDS)
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_flux_of_x_through_the_surface_is_the_volume(cls, mirrored):
    """The claim holds for both orientations of elements and on curved facets; scikit-fem computes the same volume."""
    given = curved(cls)
    mesh = ElementMesh.of(given)
    if mirrored:  # the mirror image of the body
        mesh = ElementMesh(mesh.p * np.array([[-1.0], *[[1.0]] * (mesh.d - 1)]), mesh.t, element=mesh.element)
    xi, weights = rule_of(mesh.facet, "mass")
    x, base_vectors = values_at(mesh.p, mesh.surface, mesh.facet, xi), base_vectors_at(mesh.p, mesh.surface, mesh.facet, xi)
    normals, areas = normals_of(base_vectors) * weights[:, None], measures_of(base_vectors) * weights
    volume = skfem.Basis(given, given.elem(), intorder=6).dx.sum()
    assert (x * normals).sum() == pytest.approx(mesh.d * volume, rel=1e-12)
    assert element_sizes(mesh).sum() == pytest.approx(volume, rel=1e-12)
    assert np.abs(normals.sum(axis=(0, 1))).max() < 1e-14
    area = skfem.FacetBasis(given, given.elem(), intorder=4).dx.sum()
    assert areas.sum() == pytest.approx(area, rel=1e-3)
    assert sizes_of(mesh.p, mesh.surface, mesh.facet).sum() == pytest.approx(areas.sum(), rel=1e-14)


def test_quadrilaterals_get_equal_orientation_except_on_a_moebius_strip():
    n = 12
    below, above = np.arange(n), np.arange(n, 2 * n)
    ring = np.stack([below, np.roll(below, -1), np.roll(above, -1), above])
    some = np.random.default_rng(0).random(n) < 0.5
    mixed = np.where(some, ring[[1, 0, 3, 2]], ring)
    reversed_ids, two_sided = faces_to_reverse(mixed, 2 * n)
    assert two_sided.all() and np.array_equal(reversed_ids, some ^ some[0])
    ring[[1, 2], -1] = ring[[2, 1], -1]
    assert not faces_to_reverse(ring, 2 * n)[1].any()
