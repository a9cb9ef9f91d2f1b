"""Edges and pairs of edges have scikit-fem's numbers, and pairs are as many as predicted."""

import numpy as np
import pytest
import skfem
from bodies import MESHES

from skfem_stvk import ElementMesh
from skfem_stvk.edges.topology import LOCAL_EDGES, edge_topology
from skfem_stvk.terms import StVK


@pytest.mark.parametrize(
    "mesh", [skfem.MeshTet().refined(2), skfem.MeshTet.init_ball(2), skfem.MeshTet.init_tensor(*[np.arange(4.0)] * 3)]
)
def test_edges_of_tetrahedra_are_scikit_fems(mesh):
    edges, t2e = edge_topology(mesh.t)
    assert np.array_equal(edges, mesh.edges)
    assert np.array_equal(t2e, mesh.t2e)


@pytest.mark.parametrize("mesh", [skfem.MeshTri().refined(3), skfem.MeshTri.init_circle(2)])
def test_edges_of_triangles_are_scikit_fems_facets(mesh):
    edges, t2e = edge_topology(mesh.t)
    assert np.array_equal(edges, mesh.facets)
    assert np.array_equal(t2e, mesh.t2f)


@pytest.mark.parametrize("name", MESHES)
def test_the_edges_of_a_simplex_join_its_own_vertices(name):
    mesh = MESHES[name]
    edges, t2e = edge_topology(mesh.t)
    for local, (a, b) in enumerate(LOCAL_EDGES[mesh.k]):
        assert np.array_equal(edges[:, t2e[local]], np.sort(mesh.t[[a, b]], axis=0))


@pytest.mark.parametrize("mesh", [skfem.MeshTet().refined(2), skfem.MeshTet.init_ball(2)])
def test_tetrahedra_have_three_pairs_of_edges_per_facet_and_per_element(mesh):
    form = StVK(young=1.0, poisson=0.3).bind(ElementMesh.of(mesh)).form
    assert form.pairs.shape[1] == 3 * mesh.nfacets + 3 * mesh.nelements
    assert (~form.adjacent).sum() == 3 * mesh.nelements
    assert form.L.nnz <= form.edges.shape[1] + 2 * form.pairs.shape[1]  # exact zeros are left out
