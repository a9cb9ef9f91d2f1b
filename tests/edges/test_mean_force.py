"""The mean force between two states is that of the edges, with all its digits; its work is tested for all terms."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from kernels.parts import in_parts

from skfem_stvk import ElementMesh, StVK

TERM = StVK(young=2.0, poisson=0.3)
HALVES = (0.5, 0.5)
LIMIT = 1e-12
CASES = {name: (mesh, [term.bind(mesh) for term in terms]) for name, (mesh, terms) in BODIES.items()}


def force_of(assembly, u):
    force = np.zeros(u.shape)
    return assembly.energy_and_force(u, force), force


def mean(assembly, u0, u1, weights=HALVES, theta=0.5):
    force = np.zeros(u0.shape)
    return assembly.mean_force(u0, u1, weights, theta, force), force


def states(mesh, of_u=0.3, of_v=0.3, seed=4):
    """Return two states, (nv, d) each, which are not small by default."""
    u0 = state(mesh, of_u, seed).reshape(-1, mesh.d) - 0.2 * min(of_u, 1) * mesh.p.T
    return u0, u0 + state(mesh, of_v, seed + 5).reshape(-1, mesh.d)


def rotation_of(d, angle=2.0):
    """Return a rotation (d, d) by a large angle, about a random axis."""
    if d == 1:
        return np.eye(1)
    axes = np.linalg.qr(np.random.default_rng(3).standard_normal((d, d)))[0]
    rotation = np.eye(d)
    rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return axes @ rotation @ axes.T


def from_the_edges(assembly, u0, u1, weights, theta):
    """Return R and the force from the coefficients L of the edges, with 11 bits more than the kernels."""
    form, (w0, w1) = assembly.form, weights
    (a, b), L = form.edges, np.asarray(form.L.todense(), dtype=np.longdouble)
    P, U0, U1 = (x[a] - x[b] for x in (x.astype(np.longdouble) for x in (form.p.T, u0, u1)))
    p0, p1 = P + U0, P + U1
    zeta, dzeta = ((P + p0) * U0).sum(axis=1), ((p0 + p1) * (U1 - U0)).sum(axis=1)
    tensions, force = L @ ((w0 + w1) * zeta + w1 * dzeta), np.zeros(u0.shape, dtype=np.longdouble)
    pull = tensions[:, None] * ((1 - theta) * p0 + theta * p1)
    np.add.at(force, a, pull)
    np.subtract.at(force, b, pull)
    return float(dzeta @ L @ dzeta / 4), force.astype(float)


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("name", BODIES)
def test_the_force_is_that_of_the_edges(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, assemblies = CASES[name]
    u0, u1 = states(mesh)
    for assembly in assemblies:
        for weights, theta in ((HALVES, 0.5), ((0.2, 0.8), 0.5), ((-1.0, 1.0), 1.0), ((0.3, 0.5), 0.1), ((0.0, 1.0), 0.0)):
            (wanted_R, wanted), (R, force) = (f(assembly, u0, u1, weights, theta) for f in (from_the_edges, mean))
            assert min(wanted_R, np.abs(wanted).max()) > 1e-3
            assert pytest.approx(wanted_R, rel=LIMIT) == R
            assert np.abs(force - wanted).max() < LIMIT * np.abs(wanted).max()


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_a_large_rigid_motion_changes_no_edge(name):
    mesh, assemblies = CASES[name]
    (u0, u1), x = states(mesh), mesh.p.T
    moved = (x + u0) @ rotation_of(mesh.d).T + 3.0 - x
    for assembly in assemblies:
        W, F = force_of(assembly, u0)
        R, force = mean(assembly, u0, moved, (-1.0, 1.0))
        assert R < 1e-26 * W and np.abs(force).max() < 1e-12 * np.abs(F).max()
        assert mean(assembly, u0, u1, (-1.0, 1.0))[0] > 1e-2 * W


@pytest.mark.few
@pytest.mark.parametrize(("of_u", "of_v"), [(1e-9, 1e-9), (1.0, 1e-9), (1e-9, 1.0)])
@pytest.mark.parametrize("offset", [0.0, 2.0**20])
@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "membrane", "cable"])
def test_small_changes_have_all_their_digits(name, offset, of_u, of_v):
    """The claim holds for small strains, small changes of large strains, and far from the origin.

    The plain difference `zeta(u1) - zeta(u0)` has no correct digit there.
    """
    mesh = MESHES[name]
    mesh = ElementMesh(mesh.p + offset, mesh.t)
    u0 = state(mesh, of_u).reshape(-1, mesh.d)
    assembly, u1 = TERM.bind(mesh), u0 + state(mesh, of_v, 9).reshape(-1, mesh.d)
    for weights in (HALVES, (-1.0, 1.0)):
        (wanted_R, wanted), (R, force) = (f(assembly, u0, u1, weights, 0.5) for f in (from_the_edges, mean))
        assert pytest.approx(wanted_R, rel=LIMIT) == R and R > 0
        assert np.abs(force - wanted).max() < LIMIT * np.abs(wanted).max()


@pytest.mark.parametrize("name", ["tetrahedra, two regions", "membrane, anisotropic", "cable, area"])
def test_small_changes_are_accurate_in_single_precision(name):
    mesh, terms = BODIES[name]
    for of_v in (0.3, 1e-7):
        u0, u1 = states(mesh, 0.3, of_v)
        for term in terms:
            (wanted_R, wanted), (R, force) = (
                mean(term.bind(mesh, dtype), u0, u1, (-1.0, 1.0)) for dtype in (np.float64, np.float32)
            )
            assert pytest.approx(wanted_R, rel=1e-5) == R
            assert 0 < np.abs(force - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_mean_forces_are_bitwise_reproducible_and_added(monkeypatch):
    in_parts(monkeypatch, 3)
    mesh = MESHES["tetrahedra"]
    assembly, (u0, u1) = TERM.bind(mesh), states(mesh)
    R, force = mean(assembly, u0, u1)
    for _ in range(5):
        assembly.energy_and_force(u1)
        again = mean(assembly, u0, u1)
        assert again[0] == R and np.array_equal(again[1], force)
    more = np.ones_like(force)
    assembly.mean_force(u0, u1, HALVES, 0.5, more)
    assert np.abs(more - 1 - force).max() < 1e-14
