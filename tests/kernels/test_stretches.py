"""The smallest principal stretch agrees with singular values in NumPy and in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from bodies import BODIES, MESHES, box, state
from hypothesis import given, settings
from hypothesis import strategies as st

from skfem_stvk import ElasticFoundation, ElementMesh, StVK, System
from skfem_stvk.kernels.lanes import LANES
from skfem_stvk.mesh.geometry import Geometry
from skfem_stvk.system.bound import compressed_in_part

TERM = StVK(young=2.0, poisson=0.3)
EPS = np.finfo(float).eps
BAD = ElementMesh(
    np.array([[0.0, 1, 0.3, 0.2], [0, 0.1, 0.7, 0.3], [0, 0.2, -0.1, 1.9]]), np.array([[1, 0], [0, 1], [2, 2], [3, 3]])
)


def stretches(mesh, u):
    """Return singular values of the deformation gradients, ascending, (nt, k); for surfaces and curves, within them."""
    geometry = Geometry(mesh.p, mesh.t)
    corners = u[mesh.t.T]
    gradient = np.swapaxes(corners - corners[:, :1], 1, 2) @ geometry.gradients
    return np.linalg.svd(geometry.axes + gradient, compute_uv=False)[:, ::-1]


@pytest.mark.parametrize("name", MESHES)
def test_stretches_are_bitwise_one_at_rest_and_after_a_translation(name):
    mesh = MESHES[name]
    assembly = TERM.bind(mesh)
    assert (assembly.smallest_stretches(np.zeros((mesh.nv, mesh.d))) == 1).all()
    assert (assembly.smallest_stretches(np.full((mesh.nv, mesh.d), 0.25)) == 1).all()


@pytest.mark.parametrize("name", MESHES)
def test_a_rotated_and_scaled_body_has_one_stretch_everywhere(name):
    """All principal stretches are equal, for elements of both orientations and in a mirror image."""
    mesh, rng = MESHES[name], np.random.default_rng(5)
    rotation = np.linalg.qr(rng.standard_normal((mesh.d, mesh.d)))[0]
    for s in (0.01, 0.6, -0.6, 30.0):
        u = mesh.p.T @ (s * rotation - np.eye(mesh.d)).T
        assert np.allclose(TERM.bind(mesh).smallest_stretches(u), abs(s), rtol=1e-14 / min(1, s**2), atol=0)


def of_two_tetrahedra(values, seed, mesh=BAD):
    """Return F and the stretches of tetrahedra of both orientations for `F = Q diag(values) R'`.

    Q and R are rotations; a negative value mirrors the tetrahedra.
    """
    Q, R = np.linalg.qr(np.random.default_rng(seed).standard_normal((2, 3, 3)))[0]
    F = Q @ np.diag(values) @ R.T
    return F, TERM.bind(mesh).smallest_stretches(mesh.p.T @ (F - np.eye(3)).T)


@settings(max_examples=200)
@given(values=st.lists(st.floats(-6, 6), min_size=3, max_size=3), seed=st.integers(0, 10**6), mirror=st.booleans())
def test_the_error_is_a_few_eps_of_the_largest_stretch(values, seed, mirror):
    """The stretches are from 1e-6 to 1e6, in any order, with inverted elements, too."""
    values = 10.0 ** np.array(values) * [1, 1, -1 if mirror else 1]
    F, found = of_two_tetrahedra(values, seed)
    low, high = np.linalg.svd(F, compute_uv=False)[[2, 0]]
    assert (np.abs(found**2 - low**2) < 50 * EPS * max(1, high**2)).all()


@settings(max_examples=200)
@given(
    twice=st.floats(0.1, 3),
    once=st.floats(0.1, 3),
    apart=st.sampled_from([0, 1e-16, 1e-13, 1e-10, 1e-8, 1e-5, 1e-3]),
    seed=st.integers(0, 10**6),
)
def test_the_error_is_as_small_if_stretches_are_equal_or_close(twice, once, apart, seed):
    for values in ((twice, twice * (1 + apart), once), (twice, twice * (1 + apart), twice * (1 - apart))):
        F, found = of_two_tetrahedra(values, seed)
        low, high = np.linalg.svd(F, compute_uv=False)[[2, 0]]
        assert (np.abs(found**2 - low**2) < 50 * EPS * max(1, high**2)).all()


def test_a_flat_or_degenerate_simplex_has_stretch_zero():
    for values in ((1.0, 0.7, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 0.0)):
        assert (of_two_tetrahedra(values, 3)[1] < 1e-7).all()
    assert (of_two_tetrahedra((1e120, 1.0, 1.0), 3)[1] == 0).all()  # det F overflows


def test_slivers_far_away_keep_their_digits():
    """Squares of stretches of slivers flatter than 1 : 1e6, rotated and moved far, agree with exact arithmetic to 1e-8."""
    rng = np.random.default_rng(8)
    p = rng.random((3, 80))
    p[2] *= 1e-6
    mesh = ElementMesh(p, np.arange(80).reshape(4, 20))
    rotation, F = np.linalg.qr(rng.standard_normal((3, 3)))[0], np.diag([1.1, 0.9, 0.7])
    u = mesh.p.T @ (rotation @ F - np.eye(3)).T + 2.0**10
    found = TERM.bind(mesh).smallest_stretches(u)
    for value, corners in zip(found, mesh.t.T, strict=True):
        P = [[Fraction(x) for x in row] for row in mesh.p.T[corners].tolist()]
        p_now = [[x + Fraction(y) for x, y in zip(*rows, strict=True)] for rows in zip(P, u[corners].tolist(), strict=True)]
        exact = smallest_root(*(gram(x) for x in (p_now, P)))
        assert abs(value - exact) < 1e-8 * exact and abs(exact - 0.7) < 0.1


def gram(corners):
    base_vectors = [[v - w for v, w in zip(corner, corners[0], strict=True)] for corner in corners[1:]]
    return [[sum(v * w for v, w in zip(a, b, strict=True)) for b in base_vectors] for a in base_vectors]


def smallest_root(now, rest):
    """Return the root of the smallest `x` with `det(now - x rest) = 0`, by Newton's method from below on an exact cubic."""

    def at(x):
        (a, b, c), (d, e, f), (g, h, i) = [[v - x * w for v, w in zip(*rows, strict=True)] for rows in zip(now, rest, strict=True)]
        return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)

    f0, f1, f2, f3 = (at(Fraction(x)) for x in range(4))
    c3 = (f3 - 3 * f2 + 3 * f1 - f0) / 6
    c2 = (f2 - 2 * f1 + f0) / 2 - 3 * c3
    c1 = f1 - f0 - c2 - c3
    roots = np.roots([float(c / f0) for c in (c3, c2, c1)] + [1.0])
    x = Fraction(float(roots.real.min()))
    for _ in range(6):
        x = Fraction(float(x - (f0 + x * (c1 + x * (c2 + x * c3))) / (c1 + x * (2 * c2 + x * 3 * c3))))
    return float(x) ** 0.5


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1])
def test_a_crushed_element_is_found_at_any_index(count):
    whole = box(2)
    used, t = np.unique(whole.t[:, :count], return_inverse=True)
    mesh = ElementMesh(whole.p[:, used], t.reshape(4, -1))
    assembly = TERM.bind(mesh)
    for e in range(count):
        top, base = mesh.t[0, e], mesh.t[1:, e]
        u = np.zeros((mesh.nv, 3))
        u[top] = 0.8 * (mesh.p[:, base].mean(axis=1) - mesh.p[:, top])
        found = assembly.smallest_stretches(u)
        assert found[e] <= 0.2 + 1e-12 and assembly.smallest_stretch(u) == found.min() <= found[e]


@pytest.mark.parametrize("name", ["tetrahedra, two regions", "membrane, anisotropic"])
def test_stretches_are_the_same_in_single_precision(name):
    mesh, terms = BODIES[name]
    u = state(mesh).reshape(-1, mesh.d)
    single, double = (terms[0].bind(mesh, dtype).smallest_stretches(u) for dtype in (np.float32, np.float64))
    assert np.array_equal(single, double)


@pytest.mark.parametrize("name", MESHES)
def test_a_system_names_the_compressed_elements_of_all_its_regions(name):
    mesh = MESHES[name]
    order = np.random.default_rng(3).permutation(mesh.nt)
    first, second = order[: mesh.nt // 2], order[mesh.nt // 2 :]
    terms = [StVK(young=1.0, poisson=0.4, region=first), StVK(young=2.0, poisson=0.2, region=second)]
    system, u = System(mesh, [terms[0], ElasticFoundation(lambda x: x[0] < 2, stiffness=1.0), terms[1]]), 2 * state(mesh)
    wanted = stretches(mesh, u.reshape(-1, mesh.d))[:, 0]
    assert system.smallest_stretch(u) == pytest.approx(wanted.min(), rel=1e-9)
    for below in (wanted.min() * 0.999, np.sort(wanted)[:2].mean(), np.median(wanted) * (1 + 1e-9), 1e9):
        found = compressed_in_part(system, u, below)
        assert np.array_equal(found, np.flatnonzero(wanted < below)) and found.dtype == np.int64
