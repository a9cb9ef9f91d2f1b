"""Supports: constrained degrees of freedom, their values, and refused arguments."""

import numpy as np
import pytest
from bodies import MESHES, box, sheet
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, RegionError
from skfem_stvk.errors import SupportError
from skfem_stvk.system.supports import Supports

MESH = box()
WALL, TIP = np.flatnonzero(MESH.p[0] < 0.2), np.flatnonzero(MESH.p[0] > 0.8)
NAMED = ElementMesh(MESH.p, MESH.t, node_sets={"wall": WALL, "tip": TIP})


@pytest.mark.parametrize("name", MESHES)
def test_components_are_constrained_at_their_locations(name):
    mesh = MESHES[name]
    ids = np.flatnonzero(mesh.p[0] < 0.3)
    for letters in {1: ("x",), 2: ("x", "y", "yx"), 3: ("x", "y", "yx", "zx", "xyz")}[mesh.d]:
        expected = np.sort([mesh.d * v + "xyz".index(letter) for v in ids for letter in letters])
        supports = Supports(mesh, {lambda x: x[0] < 0.3: letters})
        assert np.array_equal(supports.fixed, expected) and np.array_equal(supports.held, expected)
        assert not supports.prescribed.size and not supports.values(1.0).any()


@given(t=st.floats(1e-100, 1))
def test_prescribed_displacements_have_the_given_values_and_constants_ramp(t):
    values = np.linspace(1, 2, len(TIP))
    supports = Supports(
        NAMED,
        {"wall": "xyz"},
        {"tip": {"x": 0.01, "y": values, "z": lambda x, t: t**2 * x[1]}},
    )
    u = np.zeros((MESH.nv, 3))
    u.ravel()[supports.held] = supports.values(t)
    assert u[TIP, 0] == pytest.approx(0.01 * t) and u[TIP, 1] == pytest.approx(t * values)
    assert u[TIP, 2] == pytest.approx(t**2 * MESH.p[1, TIP])
    assert np.array_equal(np.flatnonzero(u.any(axis=1)), TIP) and not supports.values(0.0).any()
    assert np.array_equal(supports.held, np.union1d(supports.fixed, supports.prescribed))


@given(t=st.floats(0, 1))
def test_one_function_may_give_all_components(t):
    rotate = lambda x, t: np.stack([-t * x[1], t * x[0], 0 * x[2]])  # noqa: E731
    supports = Supports(NAMED, None, {"tip": rotate})
    u = np.zeros((MESH.nv, 3))
    u.ravel()[supports.held] = supports.values(t)
    assert u[TIP] == pytest.approx(rotate(MESH.p[:, TIP], t).T)
    assert np.array_equal(supports.prescribed, (3 * TIP[:, None] + np.arange(3)).ravel())


def test_a_function_of_time_moves_all_vertices_equally():
    supports = Supports(NAMED, None, {"tip": {"z": lambda t: np.sin(3 * t)}})
    assert supports.values(0.4) == pytest.approx(np.full(len(TIP), np.sin(1.2)))


def test_pairs_accept_locations_that_cannot_be_keys():
    supports = Supports(MESH, [(WALL, "xyz"), (MESH.p[0] < 0.2, "x")], [(TIP, {"x": 0.1})])
    assert np.array_equal(supports.held, Supports(NAMED, {"wall": "xyz"}, {"tip": {"x": 0.1}}).held)


def test_overlapping_locations_may_agree():
    some = TIP[:3]
    supports = Supports(MESH, [(WALL, "x"), (WALL[:2], "xy")], [(TIP, {"x": 0.1}), (some, {"x": lambda t: 0.1 * t})])
    assert len(supports.prescribed) == len(TIP) and supports.values(0.5)[-1] == pytest.approx(0.05)


def test_supports_may_be_empty():
    supports = Supports(MESH)
    assert supports.held.size == supports.fixed.size == supports.values(1.0).size == 0


@pytest.mark.parametrize(
    ("fixed", "prescribed", "error", "message"),
    [
        (
            {"wal": "x"},
            None,
            RegionError,
            r"fixed on 'wal': the mesh has no boundary or node set 'wal'; known: 'tip', 'wall'\. Did you mean 'wall'",
        ),
        (None, {"tpi": {"x": 1}}, RegionError, r"prescribed on 'tpi': .*Did you mean 'tip'"),
        (
            {"wall": "q"},
            None,
            SupportError,
            r"fixed on 'wall': got 'q'; expected components of this mesh of tetrahedra in 3D, from 'xyz'",
        ),
        ({"wall": ""}, None, SupportError, "fixed on 'wall': got ''"),
        ({"wall": 0}, None, SupportError, "fixed on 'wall': got 0"),
        ("wall", None, SupportError, r"fixed = 'wall'; expected a dict such as \{\"wall\": \"xyz\"\}, or a list of such pairs"),
        (None, ["tip"], SupportError, r"prescribed = \['tip'\]; expected a dict"),
        (
            None,
            {"tip": 0.01},
            SupportError,
            r"prescribed on 'tip': got 0\.01; expected displacements by component, such as \{'x': 0\.01\}",
        ),
        (None, {"tip": {}}, SupportError, "expected displacements by component"),
        (None, {"tip": {"w": 1}}, SupportError, "prescribed on 'tip': got 'w'; expected components"),
        (None, {"tip": {"x": np.nan}}, SupportError, r"prescribed on 'tip', component x: the value is not finite"),
        (
            None,
            {"tip": {"x": [1, 2]}},
            SupportError,
            r"component x: the value has shape \(2,\); expected a number, or \(\d+,\), one for each",
        ),
        (None, {"tip": {"x": "far"}}, SupportError, "component x: the value is 'far'; expected a number"),
        (None, {"tip": lambda x, t: x[:2]}, SupportError, r"returned at t = 0 has shape \(2, \d+\); expected 3 components"),
        (None, {"tip": {"x": lambda t: 1 / t}}, SupportError, "component x: the function failed at t = 0 with ZeroDivisionError"),
        (
            {"wall": "xyz"},
            {"wall": {"x": 0.0}},
            SupportError,
            r"^Both fixed and prescribed: x of \d+ vertices \(.*Do locations share an edge",
        ),
        (
            None,
            [((1, 2), {"x": 1}), ((2, 3), {"x": 2})],
            SupportError,
            r"different displacements at t = 0\.333: x of 1 vertex \(2\)",
        ),
        (None, [((1, 2), {"x": 1}), ((2,), lambda x, t: x)], SupportError, r"at t = 0: x of 1 vertex \(2\)"),
        (
            {lambda x: x[0] > -9: "xyz"},
            None,
            SupportError,
            r"All 192 degrees of freedom are fixed or prescribed: there is nothing to solve for",
        ),
    ],
)
def test_contradictory_supports_are_refused(fixed, prescribed, error, message):
    with pytest.raises(error, match=message):
        Supports(NAMED, fixed, prescribed)


def test_a_component_that_the_mesh_does_not_have_is_refused():
    with pytest.raises(SupportError, match=r"got 'z'; expected components of this mesh of triangles in 2D, from 'xy'"):
        Supports(sheet(), {(0,): "z"})


def test_functions_that_differ_at_a_later_time_are_refused_at_that_time():
    same = [((1, 2), {"x": lambda t: t}), ((2,), {"x": lambda t: t if t != 0.7 else 0.0})]
    supports = Supports(MESH, None, same)
    supports.values(0.6)
    with pytest.raises(SupportError, match=r"different displacements at t = 0\.7: x of 1 vertex \(2\)"):
        supports.values(0.7)
