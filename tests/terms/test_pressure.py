"""The force of a follower pressure is minus p times the gradient of the enclosed volume; its stiffness is exact."""

import numpy as np
import pytest
from bodies import bar, box, sheet, state, turned_round
from forces import force, quadrature, stiffness
from hypothesis import given, settings
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, RegionError, StVK
from skfem_stvk.errors import LoadError
from skfem_stvk.terms import Body, Pressure


def everywhere(x):
    return x[0] > -np.inf


def bubble():
    """Return the surface of a box of tetrahedra as a closed membrane with outward normals."""
    solid = box()
    vertices, t = np.unique(solid.surface, return_inverse=True)
    return ElementMesh(solid.p[:, vertices], t.reshape(solid.surface.shape))


CLOSED = {"tetrahedra": box(), "triangles": sheet(), "bubble": bubble()}


def bound(mesh, pressure, where=everywhere, thickness=0.3):
    terms = [StVK(young=1.0, poisson=0.3, **({"thickness": thickness} if mesh.k == 2 else {}))]
    return Pressure(None if mesh.k < mesh.d and where is everywhere else where, pressure).bind(Body(mesh, terms))


SURFACES = {
    **{name: (mesh, everywhere) for name, mesh in CLOSED.items()},
    "part of tetrahedra": (box(), lambda x: x[0] < 0.4),
    "part of triangles": (sheet(), lambda x: x[0] < 0.4),
    "part of a bubble": (bubble(), np.arange(7)),
}


@pytest.mark.parametrize("name", SURFACES)
def test_load_stiffness_is_symmetric_only_where_the_surface_is_closed_and_the_pressure_even(name):
    mesh, where = SURFACES[name]
    u = state(mesh, 0.5).reshape(-1, mesh.d)
    K = stiffness(bound(mesh, 2.5, where), mesh, u)
    asymmetry = np.abs(K - K.T).max() / np.abs(K).max()
    assert asymmetry < 1e-13 if where is everywhere else asymmetry > 0.1


def test_a_linear_pressure_is_integrated_exactly_over_each_facet():
    mesh = bubble()
    u = state(mesh, 0.5).reshape(-1, 3)
    f = force(bound(mesh, lambda x, t: 1 + x[0] - 2 * x[1]), mesh, u)
    a, b, c = (mesh.p + u.T)[:, mesh.t].transpose(1, 0, 2)
    area = np.cross(b - a, c - a, axis=0) / 2
    expected = np.zeros((3, mesh.nv))
    for point in quadrature(3):
        x = np.einsum("m,dmn->dn", point, mesh.p[:, mesh.t])
        for corner in range(3):
            np.add.at(expected.T, mesh.t[corner], (-point[corner] * (1 + x[0] - 2 * x[1]) * area / 3).T)
    assert f == pytest.approx(expected, abs=1e-13 * np.abs(expected).max())


def test_positive_pressure_pushes_inwards():
    """Positive pressure makes a ball shrink: the force points to the centre."""
    for mesh in CLOSED.values():
        f = force(bound(mesh, 1.0), mesh)
        assert (f * (mesh.p - mesh.p.mean(axis=1, keepdims=True))).sum() < 0


def test_pressure_on_an_edge_uses_the_thickness_of_its_element():
    mesh = sheet()
    f, thick = (force(bound(mesh, 1.0, thickness=h), mesh) for h in (1.0, np.full(mesh.nt, 0.25)))
    assert thick == pytest.approx(f / 4)
    varied = np.random.default_rng(1).uniform(1, 2, mesh.nt)
    total = np.abs(force(bound(mesh, 1.0, thickness=varied), mesh)).sum()
    assert np.abs(f).sum() < total < 2 * np.abs(f).sum()


def test_a_triangle_in_space_is_pushed_against_its_right_hand_normal():
    mesh = ElementMesh([[0, 2, 0], [0, 0, 1], [0, 0, 0]], [[0], [1], [2]])
    assert force(bound(mesh, 3.0, thickness=9.0), mesh).sum(axis=1) == pytest.approx([0, 0, -3.0])


def test_the_facets_of_a_named_boundary_may_have_any_orientation():
    mesh = box()
    u = state(mesh).reshape(-1, 3)
    facets = mesh.surface[:, 5:12]
    for order in ([0, 1, 2], [1, 0, 2], [2, 0, 1]):
        named = ElementMesh(mesh.p, mesh.t, boundaries={"some": facets[order]})
        f = force(bound(named, 1.0, "some"), mesh, u)
        a, b, c = (mesh.p + u.T)[:, facets].transpose(1, 0, 2)
        assert f.sum(axis=1) == pytest.approx(-np.cross(b - a, c - a, axis=0).sum(axis=1) / 2)


def test_pressure_far_from_the_origin_is_as_exact_as_the_coordinates():
    mesh = box()
    far = ElementMesh(np.round(mesh.p * 2**20) / 2**20 + 2.0**20, mesh.t)
    near = ElementMesh(far.p - 2.0**20, mesh.t)
    u = state(mesh).reshape(-1, 3)
    assert np.array_equal(force(bound(far, 1.0), far, u), force(bound(near, 1.0), near, u))


def inner_facet(mesh):
    """Return a facet of the first simplex with such a facet that is not on the boundary."""
    outer = {tuple(sorted(facet)) for facet in mesh.surface.T.tolist()}
    return next(f for t in mesh.t.T.tolist() for f in [sorted(t)[:-1]] if tuple(f) not in outer)


def test_pressure_on_inner_facets_is_refused():
    for mesh in (box(), sheet()):
        some = np.concatenate([mesh.surface[:, :3], np.array(inner_facet(mesh))[:, None]], axis=1)
        named = ElementMesh(mesh.p, mesh.t, boundaries={"some": some})
        with pytest.raises(LoadError, match=r"Pressure on 'some': 1 facet \(\d\) of 4 are not on the boundary.*Traction"):
            bound(named, 1.0, "some")


def test_pressure_on_segments_is_refused():
    for d in (1, 2, 3):
        with pytest.raises(LoadError, match=rf"the mesh has segments in {d}D, which have no surface\. Use Traction or NodalLoad"):
            Pressure(everywhere, 1.0).bind(Body(bar(d=d), [StVK(young=1.0, poisson=0.3)]))


@settings(max_examples=10)
@given(seed=st.integers(0, 10_000))
def test_reversed_triangles_have_the_orientation_of_the_first(seed):
    """If half of the triangles have random orientation, the force is the same, or opposite if the first triangle is reversed."""
    mesh = bubble()
    mixed = turned_round(mesh.t, np.random.default_rng(seed))
    sign = 1 if np.array_equal(mixed[:, 0], mesh.t[:, 0]) else -1
    expected = sign * force(bound(mesh, 1.0), mesh)
    assert force(bound(ElementMesh(mesh.p, mixed), 1.0), mesh) == pytest.approx(expected, abs=1e-15)


def test_each_connected_piece_has_a_first_triangle_of_its_own():
    mesh = bubble()
    n = mesh.nv
    outwards, inwards = mesh.t, mesh.t[[1, 0, 2]] + n
    two = ElementMesh(np.concatenate([mesh.p, mesh.p], axis=1), np.concatenate([outwards, inwards], axis=1))
    f = force(bound(two, 1.0), two)
    assert np.abs(f).max() > 0 and f[:, :n] == pytest.approx(-f[:, n:], abs=1e-15)


def test_a_surface_without_two_sides_is_refused():
    a = np.linspace(0, 2 * np.pi, 6)[:-1]
    x = np.concatenate(
        [[(2 + s * np.cos(b / 2)) * np.cos(b), (2 + s * np.cos(b / 2)) * np.sin(b), s * np.sin(b / 2)] for b in a for s in (-1, 1)]
    )
    strip = np.array([[i, i + 1, i + 2] for i in range(8)] + [[8, 9, 1], [9, 1, 0]]).T
    moebius = ElementMesh(x.reshape(-1, 3).T, strip)
    with pytest.raises(LoadError, match=r"Pressure: 10 elements \(0, 1, .*\) are a surface without two sides"):
        bound(moebius, 1.0)
    assert np.abs(force(bound(moebius, 1.0, np.arange(9)), moebius)).max() > 0.1


def test_where_three_triangles_meet_each_retains_its_orientation():
    fan = ElementMesh([[0, 0, 1, -1, 0], [0, 0, 0, 0, 1], [0, 1, 0, 0, 0]], [[0, 0, 0], [1, 1, 1], [2, 3, 4]])
    alone = sum(force(bound(fan, 1.0, [e]), fan) for e in range(3))
    assert np.abs(alone).max() > 0 and force(bound(fan, 1.0), fan) == pytest.approx(alone, abs=1e-15)


@pytest.mark.parametrize(
    ("where", "pressure", "error", "message"),
    [
        (
            everywhere,
            (0, 0, 1.0),
            LoadError,
            r"pressure is \(0, 0, 1\.0\)|pressure has shape \(3,\); expected a number, or \(\d+,\)",
        ),
        (everywhere, np.inf, LoadError, "pressure is not finite"),
        (everywhere, lambda x, t: x, LoadError, r"returned at t = 0 has shape \(3, \d+\); expected a number, or"),
        (lambda x: x[0] > 9, 1.0, RegionError, "none of the 64 vertices satisfies"),
        (None, 1.0, RegionError, "Pressure on .*expected the name of a boundary or of a node set"),
    ],
)
def test_invalid_pressure_is_refused(where, pressure, error, message):
    with pytest.raises(error, match=message):
        Pressure(where, pressure).bind(Body(box(), [StVK(young=1.0, poisson=0.3)]))


def test_pressure_on_triangles_in_space_needs_elements():
    with pytest.raises(LoadError, match=r"triangles in space are the surface themselves; expected the name of a subdomain"):
        bound(bubble(), 1.0, lambda x: x[0] < 0.4)
    with pytest.raises(RegionError, match="no subdomain 'lid'"):
        bound(bubble(), 1.0, "lid")
