"""Edges and pairs of edges have scikit-fem's numbers, and pairs are as many as predicted."""

import numpy as np
import pytest
import skfem
from bodies import MESHES

from skfem_stvk import ElementMesh
from skfem_stvk.edges.topology import LOCAL_EDGES, edge_topology
from skfem_stvk.terms import StVK


@pytest.mark.parametrize(
    "mesh",
    [
        skfem.MeshTet().refined(2),
        skfem.MeshTet.init_ball(2),
        skfem.MeshTet.init_tensor(*[np.arange(4.0)] * 3),
        skfem.MeshTri().refined(3),
        skfem.MeshTri.init_circle(2),
    ],
)
def test_edges_are_those_of_scikit_fem(mesh):
    wanted = (mesh.edges, mesh.t2e) if len(mesh.t) == 4 else (mesh.facets, mesh.t2f)
    assert all(map(np.array_equal, edge_topology(mesh.t), wanted))


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
