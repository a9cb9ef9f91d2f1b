"""Locations by shape: boxes, planes, and the node nearest to a point."""

import numpy as np
import pytest

from skfem_stvk import BodyForce, Box, NearestNode, NodalLoad, Plane, RegionError, StVK, System, Traction
from skfem_stvk.mesh import box
from skfem_stvk.mesh.locations import describe, facets_at, vertices_at
from skfem_stvk.results.reactions import constrained_vertices

MESH = box((2.0, 1.0, 1.0), (4, 2, 2))
LAW = StVK(young=2.0, poisson=0.3, density=1.0)


@pytest.mark.parametrize(
    ("shape", "same"),
    [
        (Box((0, 0, 0), (0.5, 1, 1)), lambda x: x[0] <= 0.5),
        (Box((1e-7, 0, 0), (0.5 - 1e-7, 1, 1)), lambda x: x[0] <= 0.5),  # rounding of coordinates does not matter
        (Box((0, 1, 0), (2, 1, 1)), lambda x: x[1] == 1),
        (Plane((0, 0, 1), (0, 0, 3)), lambda x: x[2] == 1),
        (Plane((2, 0, 0), (-1e-200, 0, -1e-200)), lambda x: x[0] + x[2] == 2),
        (Plane((1, 0.4, 0), (0, 1, 0), within=0.45), lambda x: x[1] <= 0.5),
        (NearestNode((1.9, 0.9, 0.1)), lambda x: (x[0] == 2) & (x[1] == 1) & (x[2] == 0)),
        (NearestNode((0.25, 0, 0)), lambda x: (x == 0).all(axis=0)),  # the first of several nearest nodes
    ],
)
def test_a_shape_is_equivalent_to_its_predicate(shape, same):
    assert np.array_equal(vertices_at(MESH, shape), vertices_at(MESH, same))
    typed = eval(repr(shape))
    assert typed == shape and hash(typed) == hash(shape)


def test_facets_of_a_shape_have_all_their_nodes_in_it():
    assert facets_at(MESH, Plane((2, 0, 0), (1, 0, 0))).shape[1] == MESH.boundaries["right"].shape[1]
    with pytest.raises(
        RegionError, match=r"the node nearest to \(0, 0, 0\) has 1 vertex \(0\), but none of the 80 boundary facets"
    ):
        facets_at(MESH, NearestNode((0, 0, 0)))


def test_shapes_are_accepted_wherever_a_location_is_expected():
    tip, wall = Plane((2, 0, 0), (1, 0, 0)), Box((0, 0, 0), (0, 1, 1))
    shapes = System(
        MESH,
        [LAW, Traction(tip, (0, 0, -1.0)), NodalLoad(NearestNode((2, 1, 1)), (1.0, 0, 0))],
        fixed={wall: "xyz"},
        prescribed={NearestNode((1, 0, 0)): {"y": 0.1}},
    )
    plain = System(
        MESH,
        [LAW, Traction("right", (0, 0, -1.0)), NodalLoad(lambda x: (x == [[2], [1], [1]]).all(axis=0), (1.0, 0, 0))],
        fixed={"left": "xyz"},
        prescribed={lambda x: (x == [[1], [0], [0]]).all(axis=0): {"y": 0.1}},
    )
    u = np.cos(np.arange(plain.ndofs)) / 9
    assert np.array_equal(shapes.residual(u, 1.0), plain.residual(u, 1.0))
    assert np.array_equal(shapes.supports.held, plain.supports.held)
    assert np.array_equal(constrained_vertices(shapes, wall, "wall"), constrained_vertices(plain, "left", "wall"))


def test_a_box_as_a_region_contains_elements_by_their_centres():
    half = Box((0, 0, 0), (1, 1, 1))
    ids = MESH.elements(half)
    assert len(ids) == MESH.nt // 2 and (MESH.p[0][MESH.t[:, ids]] <= 1).all()
    assert np.array_equal(MESH.with_degree(2).elements(half), ids)
    laws = [StVK(young=2.0, poisson=0.3, region=half), StVK(young=4.0, poisson=0.3, region=Box((1, 0, 0), (2, 1, 1)))]
    system = System(MESH, [*laws, BodyForce((0, 0, 1.0), half)])
    assert np.isclose(system.external_force(np.zeros(system.ndofs), 1.0).sum(), 1.0)
    u = 0.1 * MESH.p.ravel("F")
    assert np.isclose(system.energy(u), 1.5 * System(MESH, LAW).energy(u))
    with pytest.raises(
        RegionError, match=r"no element has its centre in the box from \(5, 0, 0\) to \(6, 1, 1\)\. The mesh is from"
    ):
        MESH.elements(Box((5, 0, 0), (6, 1, 1)))


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (
            Box((5, 0, 0), (6, 1, 1)),
            r"none of the 45 vertices is in the box from \(5, 0, 0\) to \(6, 1, 1\)\. The mesh has x\[0\] from",
        ),
        (Plane((0, 0.3, 0), (0, 1, 0)), r"none of the 45 vertices is in the plane through \(0, 0\.3, 0\) with normal \(0, 1, 0\)"),
        (Box((0, 0), (1, 1)), r"the box from \(0, 0\) to \(1, 1\) is in 2 dimensions, the mesh in 3: give 3 components\."),
        (NearestNode((2000, 0, 0)), r"the node nearest to \(2000, 0, 0\) is 1998 away .* 2 large\. Is the point in the units"),
    ],
)
def test_a_shape_without_nodes_is_refused(where, message):
    with pytest.raises(RegionError, match="^It: " + message):
        vertices_at(MESH, where, "It")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box((0, 0), (1, 1, 1)), r"Box: low has 2 components and high 3"),
        (lambda: Box((0, 2), (1, 1)), r"Box: low = \(0\.0, 2\.0\) is above high = \(1\.0, 1\.0\) along y\. Exchange them"),
        (lambda: Box("wall", (1, 1)), r"Box: low = 'wall'; expected one to three coordinates"),
        (lambda: Box((), ()), r"Box: low = \(\); expected one to three coordinates"),
        (lambda: Box((0, np.nan), (1, 1)), r"Box: low is not finite in 1 entry \(1\)"),
        (lambda: Plane((0, 0), (0, 0)), r"Plane: normal = \(0\.0, 0\.0\); expected a vector that is not zero"),
        (lambda: Plane((0, 0), (0, 0, 1)), r"Plane: point has 2 components and normal 3"),
        (lambda: Plane((0, 0), (0, 1), within=0), r"Plane: within = 0; expected a positive distance, or None"),
        (lambda: NearestNode(3.0), r"NearestNode: point has shape \(\); expected one to three coordinates"),
    ],
)
def test_invalid_shapes_are_refused(make, message):
    with pytest.raises(RegionError, match=message):
        make()


def test_messages_describe_shapes():
    assert describe(NearestNode((1, 2))) == "the node nearest to (1, 2)"
    with pytest.raises(RegionError, match=r"Traction on the plane through \(9, 0, 0\) with normal \(1, 0, 0\): none of"):
        System(MESH, [LAW, Traction(Plane((9, 0, 0), (1, 0, 0)), (0, 0, 1.0))])
