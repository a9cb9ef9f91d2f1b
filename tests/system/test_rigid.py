"""Rigid modes that supports leave free: their number is that of the zero modes of K, and they are named."""

from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from bodies import MESHES, box, sheet
from hypothesis import given, settings
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.edges.topology import edge_topology
from skfem_stvk.errors import SupportError
from skfem_stvk.system.mechanisms import check_held
from skfem_stvk.system.rigid import free_rigid_modes, parts_of, rigid_modes
from skfem_stvk.system.supports import Supports

CUBE = ElementMesh.of(skfem.MeshTet().refined(2))
SQUARE = ElementMesh.of(skfem.MeshTri().refined(2))


def left(mesh, supports=(), move=lambda p: p):
    held = Supports(mesh, list(supports)).held
    return descriptions(move(mesh.p), [edge_topology(mesh.t)[0]], held)


def descriptions(p, edges, held):
    return [str(each) for each in free_rigid_modes(p, parts_of(edges, p.shape[1]), held)]


def at(mesh, condition):
    return np.flatnonzero(condition(mesh.p))


@pytest.mark.parametrize("name", MESHES)
def test_rigid_modes_cost_nothing_at_rest(name):
    mesh = MESHES[name]
    system = System(mesh, StVK(young=2.0, poisson=0.3))
    R = rigid_modes(mesh.p.T)
    K = system.tangent(np.zeros(system.ndofs))
    assert R.shape == (mesh.p.size, {1: 1, 2: 3, 3: 6}[mesh.d])
    assert np.linalg.matrix_rank(R) == R.shape[1] and np.abs(R).max() <= 1
    assert np.abs(K @ R).max() < 1e-13 * np.abs(K.data).max()


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 8), offset=st.sampled_from([0.0, 1e6]))
@pytest.mark.parametrize("mesh", [box(1), sheet(2)], ids=["box", "sheet"])
def test_the_number_of_rigid_modes_is_that_of_zero_eigenvalues_of_the_stiffness(mesh, seed, count, offset):
    held = np.random.default_rng(seed).permutation(mesh.p.size)[:count]
    K = System(mesh, StVK(young=2.0, poisson=0.3)).tangent(np.zeros(mesh.p.size)).toarray()
    free = np.setdiff1d(np.arange(mesh.p.size), held)
    values = np.linalg.eigvalsh(K[np.ix_(free, free)])
    zeros = (values < 1e-9 * values[-1]).sum()
    text = "".join(descriptions(mesh.p + offset, [edge_topology(mesh.t)[0]], held))
    counted = int(text.split(" has ")[1].split()[0]) if text else 0
    assert counted == zeros == text.count("translation") + text.count("rotation") + text.count("screw")


THE_CUBE = f"the body of {CUBE.nv} vertices has "
TRANSLATIONS, ROTATIONS = [f"translation along {a}" for a in "xyz"], [f"rotation about the {a} axis" for a in "xyz"]


@pytest.mark.parametrize("offset", [0.0, 1e5, -1e8])
@pytest.mark.parametrize(
    ("supports", "modes"),
    [
        ([], [*TRANSLATIONS, *ROTATIONS]),
        ([(lambda p: p[0] == 0, "x")], ["translation along y", "translation along z", "rotation about the x axis"]),
        ([(lambda p: p[0] == 0, "xy")], ["translation along z"]),
        ([(lambda p: (p[:2] == 0).all(axis=0), "xyz")], ["rotation about the line along z through {O}"]),
        ([(lambda p: (p[:2] == 0).all(axis=0), "xy")], ["translation along z", "rotation about the line along z through {O}"]),
    ],
)
def test_the_remaining_rigid_modes_are_named(supports, modes, offset):
    where = [(at(CUBE, condition), letters) for condition, letters in supports]
    (text,) = left(CUBE, where, lambda p: p + offset)
    count, _, names = text.removeprefix(THE_CUBE).partition(" left, ")
    assert count == f"{len(modes)} rigid mode{'s' * (len(modes) > 1)}"
    origin = "(" + ", ".join([f"{offset:.6g}", f"{offset:.6g}", f"{offset + 0.5:.6g}"]) + ")"
    assert names == ", ".join(mode.format(O=origin) for mode in modes)


@pytest.mark.parametrize("offset", [0.0, 1e5, -1e8])
@pytest.mark.parametrize("supports", [[(0, "xyz")], [(0, "x"), (1, "y"), (2, "z")]])
def test_a_constrained_body_has_no_rigid_modes(supports, offset):
    where = [(at(CUBE, lambda p, axis=axis: p[axis] == 0), letters) for axis, letters in supports]
    assert left(CUBE, where, lambda p: p + offset) == [] and left(CUBE, where[:-1], lambda p: p + offset) != []


def test_directions_off_the_axes_are_given_by_components():
    rotation = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    mesh = ElementMesh(rotation @ CUBE.p, CUBE.t)
    line = np.flatnonzero((CUBE.p[1] == 0) & (CUBE.p[2] == 0))
    assert left(mesh, [(line, "xyz")]) == [
        f"{THE_CUBE}1 rigid mode left, rotation about the line along (0.8, 0.6, 0) through (0.4, 0.3, 0)"
    ]


def test_five_components_in_general_position_leave_a_screw_motion():
    mesh = box(1)
    held = np.array([0, 4, 8, 12, 16])
    (text,) = descriptions(mesh.p, [edge_topology(mesh.t)[0]], held)
    assert "1 rigid mode left, screw motion along (" in text
    axis, pitch = text.partition("along ")[2].split("), ")
    e, pitch = np.array([float(c) for c in axis.strip("(").split(", ")]), float(pitch.removesuffix(" per revolution"))
    lines, b = rigid_modes(mesh.p.T)[held], np.zeros(5)  # v + w x (x - c) = 0 there: w and v . w/w . w do not depend on c
    motion = np.linalg.svd(lines)[2][-1]
    size = np.linalg.norm(mesh.p - mesh.p.mean(axis=1, keepdims=True), axis=0).max()
    v, w = motion[:3], motion[3:] / size
    assert lines @ motion == pytest.approx(b, abs=1e-14)
    assert np.abs(np.cross(e, w)).max() < 1e-5 * np.linalg.norm(w)
    assert pitch == pytest.approx(2 * np.pi * (v @ w) / (w @ w), rel=1e-3)


def test_a_plane_body_has_three_modes_and_rotates_about_a_pin():
    assert left(SQUARE) == [
        f"the body of {SQUARE.nv} vertices has 3 rigid modes left, translation along x, translation along y, rotation in the plane"
    ]
    pin = np.flatnonzero((SQUARE.p == [[1], [0.5]]).all(axis=0))
    assert left(SQUARE, [(pin, "xy")])[0].endswith("1 rigid mode left, rotation about the point (1, 0.5)")
    assert left(SQUARE, [(pin, "xy")], lambda p: p - 3e4)[0].endswith("rotation about the point (-29999, -29999.5)")
    roller = at(SQUARE, lambda p: p[1] == 0)
    assert left(SQUARE, [(roller, "y")])[0].endswith("1 rigid mode left, translation along x")
    assert left(SQUARE, [(roller, "y"), (pin, "x")]) == []


def test_a_straight_cable_has_no_rotation_about_its_axis():
    mesh = ElementMesh([[0, 1, 2.0], [0, 2, 4.0], [0, 0, 0]], [[0, 1], [1, 2]])
    assert "5 rigid modes left" in left(mesh)[0]
    assert "2 rigid modes left" in left(mesh, [((0,), "xyz")])[0]
    assert left(mesh, [((0, 1), "xyz")]) == []


def test_a_bar_on_a_line_slides():
    mesh = ElementMesh([[0, 1, 2.0]], [[0, 1], [1, 2]])
    assert left(mesh) == ["the body of 3 vertices has 1 rigid mode left, translation along x"]
    assert left(mesh, [((2,), "x")]) == []


def test_each_part_needs_its_own_supports():
    n = CUBE.nv
    two = ElementMesh(np.concatenate([CUBE.p, CUBE.p + 3], axis=1), np.concatenate([CUBE.t, CUBE.t + n], axis=1))
    held = at(two, lambda p: p[0] == 0)
    (text,) = left(two, [(held, "xyz")])
    assert text.startswith(f"the part of {n} vertices ({n}, {n + 1}, {n + 2}, {n + 3}, {n + 4}, ...) has 6 rigid modes left")
    bridge = np.array([[0], [n]])
    assert descriptions(two.p, [edge_topology(two.t)[0], bridge], Supports(two, [(held, "xyz")]).held) == []


def test_a_body_without_supports_is_refused_unless_it_has_a_foundation():
    edges, solid = edge_topology(CUBE.t)[0], np.ones(CUBE.nt, dtype=bool)
    floor = at(CUBE, lambda p: p[2] == 0)
    term, held = SimpleNamespace(nodes_paired=edges, nodes_joined=None, grounded=None), np.array([0])
    with pytest.raises(SupportError, match=r"^Not held: the body of \d+ vertices has 5 rigid modes left, .*\. Fix more components"):
        check_held(CUBE, [term], held, solid)
    bedding = SimpleNamespace(
        nodes_paired=np.empty((2, 0), dtype=np.int32), nodes_joined=None, grounded=(3 * floor[:, None] + np.arange(3)).ravel()
    )
    check_held(CUBE, [term, bedding], held, solid)


def test_many_parts_are_counted():
    n, copies = CUBE.nv, 9
    p = np.concatenate([CUBE.p + 3 * i for i in range(copies)], axis=1)
    mesh = ElementMesh(p, np.concatenate([CUBE.t + n * i for i in range(copies)], axis=1))
    with pytest.raises(SupportError, match=r"; and 4 more parts\. Fix .* common faces\.$") as error:
        check_held(
            mesh,
            [SimpleNamespace(nodes_paired=edge_topology(mesh.t)[0], nodes_joined=None, grounded=None)],
            np.array([], dtype=int),
            np.ones(mesh.nt, dtype=bool),
        )
    assert str(error.value).count("the part of") == 5


def test_supports_on_a_small_patch_constrain_a_large_body():
    mesh = ElementMesh(CUBE.p * np.array([[1e4], [1], [1]]), CUBE.t)
    patch = np.flatnonzero(np.linalg.norm(CUBE.p, axis=0) <= 0.5)
    assert left(mesh, [(patch, "xyz")]) == []
    far = lambda p: p * 1e-3 + 1e3  # noqa: E731
    assert left(CUBE, [(patch, "xyz")], far) == []
