"""The mesh of the package is a sound mesh of a real part."""

from importlib.resources import files

import numpy as np
import pytest
import skfem

from skfem_stvk.mesh import embedded_mesh
from skfem_stvk.mesh.diagnostics import check_mesh
from skfem_stvk.mesh.geometry import Geometry

MESH = embedded_mesh()
FILE = files("skfem_stvk.mesh") / "data" / "bracket.msh"


def test_the_mesh_is_sound_and_connected():
    check_mesh(MESH)


def test_the_mesh_file_is_small():
    assert 1500 <= MESH.nt <= 3500
    assert len(FILE.read_bytes()) < 200_000


def test_every_element_has_one_of_two_materials():
    assert set(MESH.subdomains) == {"bracket", "bushing"}
    ids = np.concatenate([MESH.elements(name) for name in MESH.subdomains])
    assert np.array_equal(np.sort(ids), np.arange(MESH.nt))


def test_half_of_the_elements_have_negative_orientation():
    x = MESH.p.T[MESH.t.T]
    assert abs((np.linalg.det(x[:, 1:] - x[:, :1]) < 0).sum() - MESH.nt / 2) <= 1


def test_the_volume_is_that_of_the_part():
    arms, fillet = 0.1 * 0.012 + 0.068 * 0.012, (1 - np.pi / 4) * 0.01**2
    expected = 0.04 * (arms + fillet) - np.pi * 0.012 * (0.0055**2 + 0.008**2)
    assert Geometry(MESH.p, MESH.t).volume.sum() == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("name", "axes", "centre", "radius"), [("bolt", [0, 1], [0.07, 0.02], 0.0055), ("bore", [1, 2], [0.02, 0.055], 0.008)]
)
def test_boundaries_lie_on_their_cylinders(name, axes, centre, radius):
    x = MESH.p[axes][:, MESH.boundaries[name].ravel()] - np.reshape(centre, (2, 1))
    assert np.allclose(np.linalg.norm(x, axis=0), radius, rtol=1e-9)


def test_scikit_fem_loads_the_same_mesh():
    mesh = skfem.MeshTet.load(FILE)
    assert np.array_equal(mesh.p, MESH.p) and np.array_equal(mesh.t, MESH.t)
    assert all(np.array_equal(mesh.subdomains[name], MESH.elements(name)) for name in MESH.subdomains)
    for name, facets in MESH.boundaries.items():
        found = np.sort(mesh.facets[:, mesh.boundaries[name]], axis=0)
        assert sorted(found.T.tolist()) == sorted(np.sort(facets, axis=0).T.tolist())
