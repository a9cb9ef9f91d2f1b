import numpy as np
import pytest
import skfem
from bodies import box

from skfem_stvk import ElementMesh
from skfem_stvk.mesh.facets import boundary_facets, facet_ids


@pytest.mark.parametrize("mesh", [skfem.MeshTet().refined(2), skfem.MeshTri.init_circle(2), skfem.MeshLine().refined(3)])
def test_facets_and_boundary_are_scikit_fems(mesh):
    simplices = ElementMesh.of(mesh)
    assert facet_ids(simplices).max() + 1 == mesh.nfacets
    assert boundary_facets(simplices).shape[1] == len(mesh.boundary_facets())
    assert np.array_equal(np.unique(simplices.surface), np.sort(mesh.boundary_nodes()))


def test_boundary_facets_of_tetrahedra_look_outwards():
    """The flux of x through the surface is three times the volume, whichever way the tetrahedra are turned."""
    mesh = box(3)
    a, b, c = mesh.p[:, boundary_facets(mesh)].transpose(1, 2, 0)
    flux = ((a + b + c) / 3 * np.cross(b - a, c - a) / 2).sum()
    x = mesh.p.T[mesh.t.T]
    volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])).sum() / 6
    assert flux == pytest.approx(3 * volume, rel=1e-12)
