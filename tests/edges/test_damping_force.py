"""Damping resists the rates of the squared elongations of edges."""

import hypothesis.strategies as st
import numpy as np
import pytest
from bodies import BODIES, state
from hypothesis import given, settings
from kernels.parts import in_parts

from skfem_stvk.edges import ALL, NONE, TENSILE

LIMIT = 1e-12
CASES = {name: (mesh, [term.bind(mesh) for term in terms]) for name, (mesh, terms) in BODIES.items()}


def damping(assembly, u, v):
    force = np.zeros(u.shape)
    return assembly.damping_force(u, v, force), force


def product(assembly, u, v, kept):
    out = np.zeros(u.shape)
    assembly.pairs.add_product(assembly.blocks(u, kept=kept)[1], v, out)
    return out


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


@settings(max_examples=60)
@given(st.sampled_from(sorted(CASES)), st.integers(0, 10**6), st.sampled_from([1e-9, 0.3, 1.0, 10.0]))
def test_damping_is_the_gauss_newton_product_and_has_the_power_2_R(name, seed, amount):
    mesh, assemblies = CASES[name]
    u, v = states(mesh, amount, seed)
    for assembly in assemblies:
        R, force = damping(assembly, u, v)
        wanted = product(assembly, u, v, NONE)
        assert R > 0 and np.vdot(force, v) == pytest.approx(2 * R, abs=LIMIT * (np.abs(force) * np.abs(v)).sum())
        assert np.abs(force - wanted).max() < LIMIT * np.abs(wanted).max()


@pytest.mark.few
@pytest.mark.parametrize("kept", [ALL, TENSILE])
@pytest.mark.parametrize("name", BODIES)
def test_tangents_with_tensions_differ_from_damping(name, kept):
    mesh, assemblies = CASES[name]
    u, v = states(mesh)
    for assembly in assemblies:
        force = damping(assembly, u, v)[1]
        assert np.abs(force - product(assembly, u, v, kept)).max() > 1e-3 * np.abs(force).max()


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


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_damping_is_the_limit_of_small_changes(name):
    mesh, assemblies = CASES[name]
    u, v = states(mesh)
    for assembly in assemblies:
        R, force = damping(assembly, u, v)
        errors = []
        for h in (1e-3, 1e-4):
            change = np.zeros(u.shape)
            of_change = assembly.mean_force(u, u + h * v, (-1 / h, 1 / h), 0.5, change)
            errors.append((abs(of_change / h**2 / R - 1), np.abs(change - force).max() / np.abs(force).max()))
        assert np.allclose(np.divide(*errors), 10, rtol=0.1)


@pytest.mark.parametrize("name", ["tetrahedra, two regions", "membrane, anisotropic", "cable, area"])
def test_single_precision_agrees_with_double(name):
    mesh, terms = BODIES[name]
    u, v = states(mesh)
    for term in terms:
        (wanted_R, wanted), (R, force) = (damping(term.bind(mesh, dtype), u, 1e-6 * v) for dtype in (np.float64, np.float32))
        assert pytest.approx(wanted_R, rel=1e-5) == R
        assert 0 < np.abs(force - wanted).max() < 1e-5 * np.abs(wanted).max()
