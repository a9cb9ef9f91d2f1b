"""Ratios of volumes, step limits and stretches of linear, straight and curved quadratic simplices, and of boxes."""

import numpy as np
import pytest
from bodies import CURVED, MESHES, STRAIGHT, box, sheet, state
from kernels.parts import in_parts

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.mesh.points import base_vectors_at, measures_of, rule_of

TERM = StVK(young=2.0, poisson=0.3)
EVERY = MESHES | {f"{name}, curved": mesh for name, mesh in CURVED.items()}
EVERY |= {f"{name}, straight": mesh for name, mesh in STRAIGHT.items()}
SOLID = [name for name, mesh in EVERY.items() if mesh.k == mesh.d]


def everywhere(mesh):
    """Return reference coordinates of points and nodes."""
    return np.concatenate([rule_of(mesh.element).points, mesh.element.nodes])


def ratios(mesh, u, xi):
    """Return ratios of determinants, or of measures for membranes and cables, (nt, nq)."""
    rest, now = (base_vectors_at(np.ascontiguousarray(x.T), mesh.t, mesh.element, xi) for x in (mesh.p.T, mesh.p.T + u))
    if mesh.k < mesh.d:
        return measures_of(now) / measures_of(rest)
    return np.linalg.det(now) / np.linalg.det(rest)


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("name", EVERY)
def test_the_ratio_of_an_element_is_the_smallest_at_its_points_and_nodes(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh = EVERY[name]
    u = state(mesh, 0.6).reshape(-1, mesh.d)
    found, wanted = TERM.bind(mesh).volume_ratios(u), ratios(mesh, u, everywhere(mesh)).min(axis=1)
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()
    assert TERM.bind(mesh).smallest_volume_ratio(u) == found.min()
    assert np.abs(TERM.bind(mesh).volume_ratios(0 * u) - 1).max() < 1e-12
    region = np.random.default_rng(0).permutation(mesh.nt)[: mesh.nt // 2]
    part = StVK(young=2.0, poisson=0.3, region=region).bind(mesh).volume_ratios(u)
    assert np.abs(part - wanted[region]).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("make", [lambda: box(2), lambda: sheet(3)])
def test_the_ratio_of_a_quadratic_map_is_known(make):
    """For x + a x^2 along the first axis, J = 1 + 2 a x is smallest at the leftmost or rightmost corner."""
    mesh = make().with_degree(2)
    x = mesh.p[0][mesh.t]
    for a in (0.3, -0.7):
        u = np.zeros((mesh.nv, mesh.d))
        u[:, 0] = a * mesh.p[0] ** 2
        J = (1 + 2 * a * x).min(axis=0)
        assert TERM.bind(mesh).volume_ratios(u) == pytest.approx(J, rel=1e-12, abs=1e-12)
        body = System(mesh, TERM)
        assert list(body.inside_out(u.ravel())) == list(np.flatnonzero(J <= 1e-9)) and (len(body.inside_out(u.ravel())) > 0) == (
            a < 0
        )
        if a < 0:  # J falls to zero where x is largest
            assert body.step_limit(0 * u.ravel(), u.ravel()) == pytest.approx(-1 / (2 * a * mesh.p[0][mesh.t].max()), rel=1e-12)


def first_root(mesh, u, v):
    """Return the smallest positive root of the cubics at points and nodes, from their values at four points."""
    places = np.array([0.0, 1.0, -1.0, 2.0])
    J = [ratios(mesh, u + s * v, everywhere(mesh)).ravel() for s in places]
    least = np.inf
    for c in np.linalg.solve(np.vander(places, increasing=True), J).T:
        if c[0] > 0:
            roots = np.roots(c[::-1])
            least = min(least, roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].min(initial=np.inf))
    return least


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("name", SOLID)
def test_the_step_limit_is_the_first_root_of_all_cubics(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh = EVERY[name]
    body = TERM.bind(mesh)
    for seed in range(3):
        u, v = (0.2 * state(mesh, seed=100 * seed + i).reshape(-1, mesh.d) for i in (1, 2))
        limit = body.step_limit(u, v)
        assert np.isfinite(limit) and limit == pytest.approx(first_root(mesh, u, v), rel=1e-8)
        right = ratios(mesh, u, everywhere(mesh)) > 0
        for s, sign in ((1 - 1e-8, 1), (1 + 1e-8, -1)):
            assert sign * ratios(mesh, u + s * limit * v, everywhere(mesh))[right].min() > 0


@pytest.mark.few
@pytest.mark.parametrize("name", SOLID)
def test_the_step_limit_of_an_affine_motion_is_exact(name):
    mesh = EVERY[name]
    body, rest, x = TERM.bind(mesh), np.zeros((mesh.nv, mesh.d)), mesh.p.T
    one = np.eye(mesh.d)[0]
    assert body.step_limit(rest, -0.25 * x * one) == pytest.approx(4, rel=1e-12)
    assert body.step_limit(-0.5 * x * one, -0.25 * x * one) == pytest.approx(2, rel=1e-12)
    # a root of multiplicity d; rounding leaves only 1/d of its digits
    assert body.step_limit(rest, -0.25 * x) == pytest.approx(4, rel={1: 1e-12, 2: 1e-6, 3: 1e-4}[mesh.d])
    for away in (0.25 * x, 0.25 * x * one, np.ones_like(x), np.zeros_like(x)):
        assert body.step_limit(rest, away) == np.inf


@pytest.mark.parametrize("name", [name for name in EVERY if name not in SOLID])
def test_steps_of_membranes_and_cables_are_not_limited(name):
    mesh = EVERY[name]
    assert TERM.bind(mesh).step_limit(np.zeros((mesh.nv, mesh.d)), -mesh.p.T) == np.inf


@pytest.mark.few
@pytest.mark.parametrize("name", EVERY)
def test_the_smallest_stretch_is_that_of_the_points(name):
    mesh = EVERY[name]
    u = state(mesh, 0.4).reshape(-1, mesh.d)
    xi = rule_of(mesh.element).points
    rest, now = (
        np.swapaxes(base_vectors_at(np.ascontiguousarray(x.T), mesh.t, mesh.element, xi), 2, 3) for x in (mesh.p.T, mesh.p.T + u)
    )
    wanted = np.linalg.svd(now @ np.linalg.inv(np.linalg.qr(rest)[1]), compute_uv=False)[..., -1].min(axis=1)
    found = TERM.bind(mesh).smallest_stretches(u)
    assert found == pytest.approx(wanted, rel=1e-11)
    assert TERM.bind(mesh).smallest_stretch(u) == found.min()


def test_an_element_inverted_only_at_a_node_is_found():
    """The middle of an edge is moved towards a corner by more than a quarter of the edge; J stays positive at the points."""
    mesh = box(2).with_degree(2)
    body, u = System(mesh, TERM), np.zeros((mesh.nv, 3))
    e, (a, b), middle = 3, mesh.t[:2, 3], mesh.t[4, 3]
    u[middle] = 0.3 * (mesh.p[:, a] - mesh.p[:, b])
    sharing = np.flatnonzero((mesh.t == middle).any(axis=0))
    assert e in sharing and list(body.inside_out(u.ravel())) == list(sharing)
    assert ratios(mesh, u, rule_of(mesh.element).points).min() > 0.2
    u[middle] *= 0.2 / 0.3
    assert not len(body.inside_out(u.ravel()))


@pytest.mark.parametrize("name", ["hexahedra", "quadratic tetrahedra"])
def test_mirror_images_have_the_same_ratios(name):
    mesh = CURVED[name]
    mirror = np.array([-1.0, 1, 1])
    other = ElementMesh(mirror[:, None] * mesh.p, mesh.t, element=mesh.element)
    u = state(mesh, 0.4).reshape(-1, 3)
    one, two = TERM.bind(mesh).volume_ratios(u), TERM.bind(other).volume_ratios(mirror * u)
    assert two == pytest.approx(one, rel=1e-12, abs=1e-12)
