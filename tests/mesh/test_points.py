"""Sizes of elements by quadrature against scikit-fem's own, on straight and curved meshes."""

import numpy as np
import pytest
import skfem

from skfem_stvk.elements import ELEMENTS, named, rule_of
from skfem_stvk.mesh.points import element_sizes, measured, sizes_at_points, spokes

RNG = np.random.default_rng(0)
FIRST, SECOND = {1: skfem.MeshLine, 2: skfem.MeshTri, 3: skfem.MeshTet}, {2: skfem.MeshTri2, 3: skfem.MeshTet2}
BOXES = {2: skfem.MeshQuad, 3: skfem.MeshHex}


def shaken(name, amount=0.08):
    """A scikit-fem mesh of these elements, all of whose nodes were moved."""
    element = ELEMENTS[name]
    mesh = (BOXES if element.is_box else FIRST)[element.k]().refined(1)
    if element.degree == 2:
        mesh = SECOND[element.k].from_mesh(mesh)
    return type(mesh)(mesh.doflocs + amount * RNG.uniform(-0.5, 0.5, mesh.doflocs.shape), mesh.t)


@pytest.mark.parametrize("name", [name for name in ELEMENTS if name != "quadratic segments"])
def test_sizes_are_those_of_a_rule_of_high_order(name):
    mesh = shaken(name)
    exact = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).elemental(skfem.Basis(mesh, mesh.elem(), intorder=8))
    sizes = element_sizes(mesh.doflocs, mesh.dofs.element_dofs, ELEMENTS[name])
    np.testing.assert_allclose(sizes, np.abs(exact), rtol=1e-13)


def test_the_length_of_a_parabola_is_found_to_the_order_of_the_rule():
    """y = x^2 from -h to h."""
    h = np.array([0.05, 0.1, 0.2])
    p = np.array([np.concatenate([-h, h, 0 * h]), np.concatenate([h**2, h**2, 0 * h])])
    lengths = element_sizes(p, np.arange(9).reshape(3, 3), ELEMENTS["quadratic segments"])
    exact = h * np.sqrt(1 + 4 * h**2) + np.arcsinh(2 * h) / 2
    assert (np.abs(lengths / exact - 1) < h**6).all()


def test_a_triangle_in_space_has_the_area_of_its_projections():
    mesh = shaken("quadratic triangles")
    t, element, w = mesh.dofs.element_dofs, ELEMENTS["quadratic triangles"], np.array([0.3, -0.2, 0.5])
    space = np.vstack([mesh.doflocs, w[:2] @ mesh.doflocs])  # a plane: areas grow by one factor
    flat = element_sizes(mesh.doflocs, t, element)
    np.testing.assert_allclose(element_sizes(space, t, element), flat * np.sqrt(1 + w[:2] @ w[:2]), rtol=1e-13)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_spokes_of_linear_simplices_are_differences_to_the_last_bit(k):
    element = {1: "segments", 2: "triangles", 3: "tetrahedra"}[k]
    p, t = RNG.normal(size=(3, 20)), RNG.permutation(20)[: 5 * (k + 1)].reshape(k + 1, 5)
    found = spokes(p, t, ELEMENTS[element].derivatives(np.full((1, k), 0.2))[0])
    assert np.array_equal(found, np.moveaxis(p[:, t[1:]] - p[:, t[:1]], 1, 0))
    assert (measured(found) > 0).all()


def test_a_point_has_size_one():
    assert np.array_equal(element_sizes(np.zeros((3, 4)), np.array([[0, 2]]), named("points")), [1, 1])
    assert named("points").values(rule_of(named("points")).points).tolist() == [[1.0]]


def test_parts_of_points_sum_to_the_size():
    mesh = shaken("hexahedra")
    element = ELEMENTS["hexahedra"]
    parts = sizes_at_points(mesh.doflocs, mesh.t, element, rule_of(element, "mass"))
    assert parts.shape == (27, mesh.nelements) and (parts > 0).all()
    np.testing.assert_allclose(parts.sum(axis=0), element_sizes(mesh.doflocs, mesh.t, element), rtol=1e-15)
