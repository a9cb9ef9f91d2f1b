"""Damping resists the rates of the squared elongations of edges."""

import numpy as np
import pytest
from bodies import BODIES, state
from kernels.parts import in_parts

LIMIT = 1e-12
CASES = {name: (mesh, [term.bind(mesh) for term in terms]) for name, (mesh, terms) in BODIES.items()}


def damping(assembly, u, v):
    force = np.zeros(u.shape)
    return assembly.damping_force(u, v, force), force


def states(mesh, amount=0.3, seed=4):
    """Return displacements (nv, d) of a compressed body, and velocities."""
    u, v = (state(mesh, amount, seed + i).reshape(-1, mesh.d) for i in (0, 5))
    return u - 0.3 * min(amount, 1) * mesh.p.T, v


def from_the_edges(assembly, u, v):
    """Return `R = 1/4 rate' L rate`, and its derivative by `v`."""
    form = assembly.form
    (a, b), p = form.edges, form.P + form.differences(u)
    rate, force = 2 * (p * (v[a] - v[b])).sum(axis=1), np.zeros(u.shape)
    pull = (form.L @ rate)[:, None] * p
    np.add.at(force, a, pull)
    np.subtract.at(force, b, pull)
    return rate @ (form.L @ rate) / 4, force


def spins(d):
    """Yield skew matrices (d, d): the rates of all rotations."""
    for i in range(d):
        for j in range(i):
            spin = np.zeros((d, d))
            spin[i, j], spin[j, i] = 1, -1
            yield spin


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("name", BODIES)
def test_the_force_is_that_of_the_edges(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, assemblies = CASES[name]
    u, v = states(mesh)
    for assembly in assemblies:
        (wanted_R, wanted), (R, force) = from_the_edges(assembly, u, v), damping(assembly, u, v)
        assert min(wanted_R, np.abs(wanted).max()) > 1e-3
        assert pytest.approx(wanted_R, rel=LIMIT) == R
        assert np.abs(force - wanted).max() < LIMIT * np.abs(wanted).max()


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_rigid_motions_are_not_damped_in_any_state(name):
    mesh, assemblies = CASES[name]
    (u, v), ones = states(mesh), np.ones((mesh.nv, 1))
    for assembly in assemblies:
        size, resistance = damping(assembly, u, v)
        for rate in (*((mesh.p.T + u) @ spin.T for spin in spins(mesh.d)), *(ones * axis for axis in np.eye(mesh.d))):
            R, force = damping(assembly, u, rate)
            assert 1e-26 * size > R and np.abs(force).max() < LIMIT * np.abs(resistance).max()
        for spin in spins(mesh.d):  # about the body at rest the motion is not rigid, so the check can fail
            assert damping(assembly, u, mesh.p.T @ spin.T)[0] > 1e-4 * size


@pytest.mark.parametrize("name", ["tetrahedra, two regions", "membrane, anisotropic", "cable, area"])
def test_single_precision_agrees_with_double(name):
    mesh, terms = BODIES[name]
    u, v = states(mesh)
    for term in terms:
        (wanted_R, wanted), (R, force) = (damping(term.bind(mesh, dtype), u, 1e-6 * v) for dtype in (np.float64, np.float32))
        assert pytest.approx(wanted_R, rel=1e-5) == R
        assert 0 < np.abs(force - wanted).max() < 1e-5 * np.abs(wanted).max()
