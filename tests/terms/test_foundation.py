"""The energy of an elastic foundation is the integral of k u^2/2 over the surface; forces and stiffness are its derivatives."""

import numpy as np
import pytest
from bodies import MESHES, sheet, state
from forces import integral

from skfem_stvk import ElementMesh, RegionError, StVK
from skfem_stvk.errors import LoadError
from skfem_stvk.mesh.points import sizes_of
from skfem_stvk.terms import Body, ElasticFoundation

K_XYZ = np.array([2.0, 0.0, 5.0])
CASES = {(name, part): (mesh, part) for name, mesh in MESHES.items() for part in ("all", "part")}


def where(part):
    return (lambda x: x[0] > -9) if part == "all" else (lambda x: x[0] < 0.4)


def bound(mesh, part="all", stiffness=None, dtype=np.float64):
    section = {1: {"area": 0.3}, 2: {"thickness": 0.3}}.get(mesh.k, {})
    body = Body(mesh, [StVK(young=1.0, poisson=0.3, **section)])
    k = [2.0] if mesh.d == 1 else K_XYZ[: mesh.d]
    return ElasticFoundation(where(part), k if stiffness is None else stiffness).bind(body, dtype)


@pytest.mark.few
@pytest.mark.parametrize("case", CASES)
def test_the_energy_of_a_linear_field_is_that_of_quadrature(case):
    mesh, part = CASES[case]
    A = np.random.default_rng(1).standard_normal((mesh.d, mesh.d))
    facets = mesh.surface[:, where(part)(mesh.p)[mesh.surface].all(axis=0)]
    areas = sizes_of(mesh.p, facets, mesh.facet) * (0.3 if mesh.k < 3 else 1)
    k = [2.0] if mesh.d == 1 else K_XYZ[: mesh.d]
    expected = integral(mesh.p, facets, areas, lambda x: (np.array(k)[:, None] * (A @ x) ** 2).sum(axis=0)[None])[0] / 2
    assert bound(mesh, part).energy_and_force((A @ mesh.p).T) == pytest.approx(expected, rel=1e-12)


def test_grounded_lists_the_degrees_of_freedom_tied_to_the_ground():
    mesh = MESHES["tetrahedra"]
    vertices = np.unique(mesh.surface[:, (mesh.p[0] < 0.4)[mesh.surface].all(axis=0)])
    assert np.array_equal(bound(mesh, "part").grounded, np.sort(np.concatenate([3 * vertices, 3 * vertices + 2])))


def test_a_number_is_the_stiffness_of_all_components():
    mesh = sheet()
    u = state(mesh).reshape(-1, 2)
    assert bound(mesh, stiffness=3.0).energy_and_force(u) == bound(mesh, stiffness=(3, 3)).energy_and_force(u)


@pytest.mark.parametrize("stiffness", [-1.0, (1, np.nan, 1), 0, (0, 0, 0), "stiff", [[1, 2]], (1, 2, -3)])
def test_an_invalid_stiffness_is_refused(stiffness):
    with pytest.raises(LoadError, match=r"ElasticFoundation: stiffness is .*; expected"):
        ElasticFoundation("floor", stiffness)


def test_a_stiffness_of_other_components_and_a_location_without_facets_are_refused():
    mesh = MESHES["tetrahedra"]
    with pytest.raises(LoadError, match=r"stiffness has shape \(2,\); expected a number, or 3 components"):
        bound(mesh, stiffness=(1, 2))
    with pytest.raises(
        RegionError, match="ElasticFoundation on 'floor': the mesh has no boundary or node set 'floor'; known: none"
    ):
        ElasticFoundation("floor", 1.0).bind(ElementMesh(mesh.p, mesh.t))
