"""The step limit is the length along a line at which the first element has no volume."""

import numpy as np
import pytest
from bodies import MESHES, box, state
from hypothesis import assume, given
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.kernels.volumes import _first_zero

TERM = StVK(young=2.0, poisson=0.3)


def single(rest, u, v):
    """Return the limit of one tetrahedron with vertices `rest`, displacements `u` and direction `v`, each (4, 3)."""
    body = System(ElementMesh(np.transpose(rest), np.arange(4)[:, None]), TERM)
    return body.step_limit(np.ravel(u), np.ravel(v))


def determinants(mesh, x):
    return np.linalg.det(np.swapaxes(x[mesh.t[1:]] - x[mesh.t[:1]], 0, 1))


def by_numpy(mesh, u, v):
    """Return the smallest positive root of the cubics, from their values at four points."""
    u, v, x = u.reshape(-1, mesh.d), v.reshape(-1, mesh.d), mesh.p.T
    places = np.array([0.0, 1.0, -1.0, 2.0])
    J = [determinants(mesh, x + u + s * v) / determinants(mesh, x) for s in places]
    least = np.inf
    for c in np.linalg.solve(np.vander(places, increasing=True), J).T:
        if c[0] > 0:
            roots = np.roots(c[::-1])
            least = min(least, roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].min(initial=np.inf))
    return least


@pytest.mark.parametrize("name", ["tetrahedra", "triangles"])
def test_round_off_of_a_coefficient_counts_as_zero(name):
    """Shear along any axis preserves volume: a coefficient 1e-16 s^2 would end it at 1e8, and 1e-16 s^3 at 2e5."""
    mesh, rng = MESHES[name], np.random.default_rng(3)
    body = System(mesh, TERM)
    for _ in range(10):
        along, across = np.linalg.qr(rng.standard_normal((mesh.d, mesh.d)))[0][:2]
        v = np.outer(mesh.p.T @ across, along).ravel()
        assert body.step_limit(np.zeros_like(v), v) > 1e12


def test_a_minimum_that_is_zero_up_to_rounding_is_a_zero():
    rng = np.random.default_rng(0)
    for r, q, height in rng.uniform(0.1, 10, (500, 3)):
        # (1 - s/r)^2 (1 + s/q)
        c = height * np.array([1.0, 1 / q - 2 / r, 1 / r**2 - 2 / (r * q), 1 / (r**2 * q)])
        assert _first_zero(*c, np.inf) == pytest.approx(r, rel=1e-6)


def test_inverted_elements_do_not_limit_the_step():
    mesh = box(1)
    body = System(mesh, TERM)
    mirrored = (-2 * mesh.p.T * [1, 0, 0]).ravel()
    back = -mirrored
    assert len(body.inside_out(mirrored)) == mesh.nt
    assert body.step_limit(mirrored, back) == np.inf and body.step_limit(0 * back, mirrored) == pytest.approx(0.5)
    assert body.step_limit(0.5 * mirrored, back) == np.inf  # flat elements are not considered either


def test_the_limiting_element_is_found_at_any_index():
    mesh = box(3)
    body = System(mesh, TERM)
    for e in range(0, mesh.nt, 7):
        top, base = mesh.t[0, e], mesh.t[1:, e]
        v = np.zeros((mesh.nv, 3))
        v[top] = mesh.p[:, base].mean(axis=1) - mesh.p[:, top]
        limit = body.step_limit(0 * v.ravel(), v.ravel())
        assert limit == pytest.approx(by_numpy(mesh, 0 * v, v), rel=1e-10) and limit <= 1 + 1e-12
        # the same holds for an element that is nearer than all before it and beyond the bound on all after it
        assert body.step_limit(0 * v.ravel(), v.ravel() + 1e-3 * state(mesh)) <= 1.01


TET = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


@pytest.mark.few
@pytest.mark.parametrize(
    ("c", "wanted", "limit"),
    [
        ((1.0, -1.0, 0.0, 0.0), 1.0, 1e-12),
        ((1.0, 1.0, 0.0, 0.0), np.inf, 1e-12),
        ((1.0, 0.0, 0.0, 0.0), np.inf, 1e-12),
        ((1.0, 0.0, -4.0, 0.0), 0.5, 1e-12),
        ((1.0, 0.0, 0.0, -8.0), 0.5, 1e-12),
        ((1.0, 0.0, 0.0, 8.0), np.inf, 1e-12),
        ((1.0, -2.0, 1.0, 0.0), 1.0, 1e-12),  # a double root of a parabola, which touches zero
        ((1.0, -3.0, 3.0, -1.0), 1.0, 1e-5),  # a triple root
        ((4.0, 0.0, -3.0, 1.0), 2.0, 1e-12),  # (s - 2)^2 (s + 1): touches zero, then rises
        ((4.0, -8.0, 5.0, -1.0), 1.0, 1e-12),  # (1 - s)(s - 2)^2
        ((2.0, -5.0, 4.0, -1.0), 1.0, 1e-7),  # (s - 1)^2 (2 - s): touches zero first, crosses it later
        ((6.0, -11.0, 6.0, -1.0), 1.0, 1e-12),  # three roots: 1, 2, 3
        ((6.0, -5.0, 1.0, 0.0), 2.0, 1e-12),
        ((1.0, -1e-9, 0.0, 0.0), 1e9, 1e-12),
        ((1e-30, -1.0, 0.0, 1.0), 1e-30, 1e-12),
        ((1.0, 1e8, -1.0, 0.0), 1e8 + 1e-8, 1e-12),
        ((1.0, -2.0 + 1e-6, 1.0, 0.0), np.inf, 1e-12),  # has the minimum 1e-6 above zero
        ((1.0, -2.0 - 1e-6, 1.0, 0.0), 1 - 1e-3, 1e-6),
    ],
)
def test_the_first_zero_of_a_cubic(c, wanted, limit):
    found, bound = _first_zero(*c, np.inf), min(wanted, 1e12)
    assert found == pytest.approx(wanted, rel=limit)
    assert _first_zero(*c, 2 * bound) == pytest.approx(min(found, 2 * bound), rel=1e-9)
    assert _first_zero(*c, 0.5 * bound) == 0.5 * bound


@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3), st.floats(0.1, 5), st.floats(1e-6, 1e6))
def test_the_first_zero_of_any_product_of_factors(roots, height, scale):
    """The first zero of `h prod (1 - s/r_i)` is the smallest positive root, also if roots are close to each other."""
    roots = np.array([r if abs(r) > 1e-3 else 1e-3 for r in roots])
    c = height * np.poly(1 / (scale * roots))  # prod (1 - s x) has the coefficients of prod (x - ...) in reverse order
    wanted = (roots * scale)[roots > 0].min(initial=np.inf)
    found = _first_zero(*c, np.inf)
    gaps = np.abs(np.subtract.outer(roots, roots))[np.triu_indices(3, 1)]
    near = 1e-4 if gaps.min() < 1e-2 else 1e-8  # the accuracy of multiple roots is a root of eps
    assume(gaps.min() > 1e-5 or np.isinf(wanted))
    assert found == pytest.approx(wanted, rel=near)


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_the_limit_of_any_tetrahedron_is_its_first_flat_state(seed, size, speed):
    rng = np.random.default_rng(seed)
    rest, u, v = size * rng.standard_normal((4, 3)), 0.3 * size * rng.standard_normal((4, 3)), speed * rng.standard_normal((4, 3))
    mesh = ElementMesh(rest.T, np.arange(4)[:, None])
    assume(np.abs(determinants(mesh, rest))[0] >= 1e-3 * size**3)
    limit = single(rest, u, v)

    def J(s):
        return (determinants(mesh, rest + u + s * v) / determinants(mesh, rest))[0]

    assume(J(0) > 1e-6)
    end = limit if np.isfinite(limit) else 100 * size / speed
    inside = np.array([J(s) for s in np.linspace(0, end, 400)[:-1]])
    assert inside.min() > -1e-9 * np.abs(inside).max()
    if np.isfinite(limit):
        around = [J(limit * (1 + d)) for d in (-1e-6, 1e-6)]
        assert min(around) <= 1e-5 * max(1, abs(inside).max())


def test_a_tetrahedron_that_is_flat_for_an_instant_limits_the_step():
    """Two edges of the base shrink to zero and reverse: J = (1 - s)^2 exactly."""
    v = np.zeros((4, 3))
    v[1], v[2] = [-1, 0, 0], [0, -1, 0]
    assert single(TET, 0 * TET, v) == pytest.approx(1, abs=1e-7)
    v[3] = [0, 0, 5.0]
    assert single(TET, 0 * TET, v) == pytest.approx(1, abs=1e-7)


def test_the_limit_is_invariant_under_translation_and_units():
    mesh = MESHES["tetrahedra"]
    u, v = 0.5 * state(mesh), state(mesh, seed=3)
    limit = System(mesh, TERM).step_limit(u, v)
    far = ElementMesh(mesh.p + 2.0**20, mesh.t)
    same = ElementMesh(far.p - 2.0**20, mesh.t)
    assert System(far, TERM).step_limit(u, v) == System(same, TERM).step_limit(u, v) == pytest.approx(limit, rel=1e-6)
    for size in (1e-9, 1e9):
        scaled = ElementMesh(size * mesh.p, mesh.t)
        assert System(scaled, TERM).step_limit(size * u, size * v) == pytest.approx(limit, rel=1e-12)
    assert System(mesh, TERM, dtype=np.float32).step_limit(u, v) == limit
