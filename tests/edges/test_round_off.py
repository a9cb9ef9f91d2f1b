"""Bounds of the round-off of the force."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from kernels.parts import in_parts

from skfem_stvk import StVK
from skfem_stvk.referee.exact import ExactStVK

TERM = StVK(young=2.0, poisson=0.3)


def bound_of(assembly, u):
    sizes = np.zeros_like(u)
    assembly.add_round_off(u, sizes)
    return sizes


def force_of(assembly, u):
    force = np.zeros(u.shape)
    assembly.energy_and_force(u, force)
    return force


def states(mesh):
    """Yield displacements (nv, d): random and of several sizes, smooth, rotated, and far away."""
    noise, x = state(mesh).reshape(-1, mesh.d), mesh.p.T
    rotation = np.eye(mesh.d)
    if mesh.d > 1:
        rotation[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    yield from (amount * noise for amount in (1.0, 1e-3, 1e-8))
    yield from (amount * np.sin(2 * x + noise) for amount in (0.3, 1e-6))
    yield x @ (rotation - np.eye(mesh.d)) + 1e-3 * noise
    yield 100 + 1e-3 * noise


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "membrane"])
def test_errors_of_the_force_stay_below_eps_times_the_bound(name):
    """The exact force has 50 digits."""
    mesh = MESHES[name]
    assembly = TERM.bind(mesh)
    lam, mu = (float(value) for value in TERM.material.lame(TERM.hypothesis(mesh)))
    for u in states(mesh):
        _, exact = ExactStVK(mesh.p, mesh.t, (lam, mu)).energy_and_force(u.ravel())
        bound = np.finfo(float).eps * bound_of(assembly, u)
        error = np.abs(force_of(assembly, u) - exact.reshape(u.shape))
        assert 0 < np.linalg.norm(error) < 0.3 * np.linalg.norm(bound) and (error < 4 * bound).all()


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_bound_is_tight_for_a_rounded_state(name):
    """Displacements are rounded to single precision, and double precision is taken as exact.

    No Newton iterate can be stored more accurately. For segments errors do not accumulate.
    """
    mesh, terms = BODIES[name]
    single, double = terms[0].bind(mesh, np.float32), terms[0].bind(mesh, np.float64)
    for u in states(mesh):
        stored = u.astype(np.float32).astype(np.float64)
        error = np.linalg.norm(force_of(single, stored) - force_of(double, u))
        bound = np.finfo(np.float32).eps * np.linalg.norm(bound_of(double, u))
        assert 1e-3 * bound < error < (2 if mesh.k == 1 else 0.3) * bound


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_bound_exceeds_the_force_and_is_added(name):
    mesh, terms = BODIES[name]
    u = state(mesh).reshape(-1, mesh.d)
    assembly = terms[0].bind(mesh)
    sizes, force = bound_of(assembly, u), force_of(assembly, u)
    assert (sizes >= np.abs(force)).all() and np.abs(force).max() > 1e-3
    before = np.ones_like(u)
    assembly.add_round_off(u, before)
    assert np.abs(before - sizes - 1).max() < 1e-14 * sizes.max()


def test_round_off_grows_with_the_displacement_of_the_body():
    mesh = MESHES["tetrahedra"]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, 3)
    near, far = (np.linalg.norm(bound_of(assembly, u + offset)) for offset in (0.0, 1e6))
    assert 1e5 < far / near < 1e8


@pytest.mark.parametrize("parts", [2, 5])
def test_threads_change_nothing(parts, monkeypatch):
    mesh = MESHES["tetrahedra"]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, 3)
    alone = bound_of(assembly, u)
    in_parts(monkeypatch, parts)
    assert np.abs(bound_of(assembly, u) - alone).max() < 1e-14 * alone.max()
