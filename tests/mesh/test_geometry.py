"""Volumes and gradients agree with closed forms, for all simplices in all spaces."""

import numpy as np
import pytest
from bodies import element_sizes, jacobians, node_sizes

from skfem_stvk import ElementMesh
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.mesh.geometry import Geometry, aspect_ratios, edge_lengths
from skfem_stvk.mesh.points import are_straight

KINDS = [(1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)]
EDGE = 0.3
REGULAR = {1: EDGE, 2: np.sqrt(3) / 4 * EDGE**2, 3: EDGE**3 / (6 * np.sqrt(2))}


def random_simplices(k, d, count=20):
    """Return simplices that do not share vertices."""
    p = np.random.default_rng(k + 10 * d).normal(size=(d, count * (k + 1)))
    return p, np.arange(count * (k + 1)).reshape(k + 1, count)


def regular_simplex(k, d):
    """Return one regular simplex with edges EDGE, randomly rotated in d dimensions.

    It is a projection of corners of a cube of k + 1 dimensions.
    """
    centred = np.eye(k + 1) - 1 / (k + 1)
    axes = np.linalg.svd(centred)[2][:k]
    rotation = np.linalg.qr(np.random.default_rng(k).normal(size=(d, d)))[0]
    return rotation[:, :k] @ (axes @ centred) * EDGE / np.sqrt(2), np.arange(k + 1).reshape(-1, 1)


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_the_gradients_of_the_barycentric_coordinates_sum_to_zero(k, d):
    gradients = Geometry(*random_simplices(k, d)).gradients
    assert gradients.shape == (20, k + 1, k)
    assert np.abs(gradients.sum(axis=1)).max() < 1e-13 * np.abs(gradients).max()


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_linear_fields_have_their_exact_gradient_along_the_simplex(k, d):
    p, t = random_simplices(k, d)
    geometry = Geometry(p, t)
    slope = np.arange(1.0, d + 1)
    found = np.einsum("tak,at->tk", geometry.gradients, (slope @ p + 4)[t])
    assert np.allclose(found, np.einsum("tdk,d->tk", geometry.axes, slope), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_the_axes_are_orthonormal_and_span_the_simplex(k, d):
    p, t = random_simplices(k, d)
    axes = Geometry(p, t).axes
    assert np.allclose(np.swapaxes(axes, 1, 2) @ axes, np.eye(k), atol=1e-14)
    base_vectors = np.swapaxes(p[:, t[1:]] - p[:, t[:1]], 0, 2).swapaxes(1, 2)
    assert np.allclose(axes @ (np.swapaxes(axes, 1, 2) @ base_vectors), base_vectors, atol=1e-13)


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_a_regular_simplex_has_its_textbook_volume(k, d):
    assert Geometry(*regular_simplex(k, d)).volume[0] == pytest.approx(REGULAR[k], rel=1e-14)


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_a_regular_simplex_has_the_gram_matrix_of_its_heights(k, d):
    height = (k + 1) / k * np.sqrt(k / (2 * (k + 1))) * EDGE
    expected = ((k + 1) * np.eye(k + 1) - 1) / k / height**2
    assert np.allclose(Geometry(*regular_simplex(k, d)).gram[0], expected, rtol=1e-13, atol=1e-13 / height**2)


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_both_orientations_have_the_same_positive_volume_and_gram_matrix(k, d):
    p, t = random_simplices(k, d)
    reversed_t = t.copy()
    reversed_t[:2] = t[1::-1]
    one, other = Geometry(p, t), Geometry(p, reversed_t)
    swap = [1, 0, *range(2, k + 1)]
    assert (one.volume > 0).all()
    assert np.allclose(one.volume, other.volume, rtol=1e-12)
    assert np.allclose(one.gram, other.gram[:, swap][:, :, swap], rtol=1e-9, atol=1e-9 * np.abs(one.gram).max())


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_volume_and_gradients_scale_with_the_size(k, d):
    p, t = random_simplices(k, d)
    one, small = Geometry(p, t), Geometry(1e-6 * p, t)
    assert np.allclose(small.volume, 1e-6**k * one.volume, rtol=1e-10)
    assert np.allclose(small.gram, 1e12 * one.gram, rtol=1e-9, atol=1e-9 * 1e12 * np.abs(one.gram).max())


@pytest.mark.parametrize(("k", "ratio"), [(1, 1.0), (2, 2 / np.sqrt(3)), (3, np.sqrt(3 / 2))])
def test_the_aspect_ratio_of_a_regular_simplex(k, ratio):
    assert aspect_ratios(ElementMesh(*regular_simplex(k, 3)))[0] == pytest.approx(ratio, rel=1e-12)


def test_the_aspect_ratio_is_the_longest_edge_over_the_smallest_height():
    """The longest edge of three edges at right angles is sqrt(1 + 4); the smallest height ends on the slanted face."""
    corner = ElementMesh(p=[[0, 1, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1.0]], t=[[0], [1], [2], [3]])
    height = 1 / np.sqrt(1 + 1 / 4 + 1)
    assert aspect_ratios(corner)[0] == pytest.approx(np.sqrt(5) / height, rel=1e-12)


def test_the_aspect_ratio_does_not_depend_on_the_order_of_the_vertices():
    """The smallest height ends on the largest face, which is each of the four in turn."""
    p = np.array([[0, 1, 0, 0.3], [0, 0, 2, 0.2], [0, 0, 0, 0.1]])
    ratios = [aspect_ratios(ElementMesh(p, np.roll(np.arange(4), i)[:, None]))[0] for i in range(4)]
    assert ratios == pytest.approx([np.sqrt(5) / 0.1] * 4, rel=1e-12)


def test_the_size_at_a_vertex_is_the_shortest_edge_of_its_elements():
    chain = ElementMesh(p=[[0, 1, 1.5, 4]], t=[[0, 1, 2], [1, 2, 3]])
    assert node_sizes(chain).tolist() == [1.0, 0.5, 0.5, 2.5]


@pytest.mark.parametrize(("k", "d"), KINDS)
def test_straight_quadratic_simplices_have_the_sizes_and_shapes_of_their_corners(k, d):
    linear = ElementMesh(*random_simplices(k, d))
    quadratic = linear.with_degree(2)
    assert are_straight(quadratic.p, quadratic.t, quadratic.element).all()
    assert np.allclose(aspect_ratios(quadratic), aspect_ratios(linear), rtol=1e-8)
    assert np.array_equal(edge_lengths(quadratic), edge_lengths(linear))
    half = node_sizes(linear) / 2  # from a corner to the middle of the edge across it may be less
    assert ((node_sizes(quadratic)[: linear.nv] < (1 + 1e-12) * half) & (node_sizes(quadratic)[: linear.nv] > 0)).all()
    for kind in ("usual", "exact", "mass"):
        assert np.allclose(element_sizes(quadratic, kind), Geometry(linear.p, linear.t).volume, rtol=1e-9)


@pytest.mark.parametrize("name", ["quadrilaterals", "hexahedra"])
def test_sizes_and_shapes_of_boxes_in_closed_form(name):
    element = ELEMENTS[name]
    sides = np.array([1.0, 2.0, 5.0])[: element.k]
    mesh = ElementMesh((element.nodes * sides).T, np.arange(element.n)[:, None], element=element)
    assert element_sizes(mesh)[0] == pytest.approx(sides.prod()) and are_straight(mesh.p, mesh.t, mesh.element).all()
    assert aspect_ratios(mesh)[0] == pytest.approx(sides[-1] / sides[0])
    assert node_sizes(mesh).tolist() == [1.0] * element.n
    tapered = ElementMesh(mesh.p * (1 - 0.5 * (mesh.p[0] > 0)), mesh.t, element=element)
    assert not are_straight(tapered.p, tapered.t, tapered.element).any()


@pytest.mark.parametrize("sign", [1, -1])
def test_jacobians_are_signed_and_those_of_membranes_by_their_centre(sign):
    triangle = ElementMesh(p=[[0, 1, 0], [0, 0, sign]], t=[[0], [1], [2]]).with_degree(2)
    assert np.allclose(jacobians(triangle, triangle.element.nodes), sign)
    p = np.vstack([triangle.p, 0 * triangle.p[:1]])
    p[2, 4] = 0.1
    membrane = ElementMesh(p, triangle.t, element=triangle.element)
    assert (jacobians(membrane, triangle.element.nodes) > 0).all() and not are_straight(
        membrane.p, membrane.t, membrane.element
    ).any()
