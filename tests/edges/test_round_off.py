"""The size of what rounding does to the force."""

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
    """(nv, d) displacements: at random and small or not, of the whole body, turned, and far away."""
    noise, x = state(mesh).reshape(-1, mesh.d), mesh.p.T
    turned = np.eye(mesh.d)
    if mesh.d > 1:
        turned[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    yield from (amount * noise for amount in (1.0, 1e-3, 1e-8))
    yield from (amount * np.sin(2 * x + noise) for amount in (0.3, 1e-6))
    yield x @ (turned - np.eye(mesh.d)) + 1e-3 * noise
    yield 100 + 1e-3 * noise


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "membrane"])
def test_errors_of_the_force_stay_below_eps_times_it(name):
    """Against 50 digits."""
    mesh = MESHES[name]
    assembly = TERM.bind(mesh)
    lam, mu = (float(value) for value in TERM.material.lame(TERM.hypothesis(mesh)))
    for u in states(mesh):
        _, exact = ExactStVK(mesh.p, mesh.t, (lam, mu)).energy_and_force(u.ravel())
        bound = np.finfo(float).eps * bound_of(assembly, u)
        error = np.abs(force_of(assembly, u) - exact.reshape(u.shape))
        assert 0 < np.linalg.norm(error) < 0.3 * np.linalg.norm(bound) and (error < 4 * bound).all()


@pytest.mark.parametrize("name", BODIES)
def test_of_a_state_that_is_rounded_itself_the_error_is_neither_above_nor_far_below(name):
    """In single precision, where double is the truth: a Newton iterate cannot be stored any better. Of segments nothing adds up."""
    mesh, terms = BODIES[name]
    single, double = terms[0].bind(mesh, np.float32), terms[0].bind(mesh, np.float64)
    for u in states(mesh):
        stored = u.astype(np.float32).astype(np.float64)
        error = np.linalg.norm(force_of(single, stored) - force_of(double, u))
        bound = np.finfo(np.float32).eps * np.linalg.norm(bound_of(double, u))
        assert 1e-3 * bound < error < (2 if mesh.k == 1 else 0.3) * bound


@pytest.mark.parametrize("name", BODIES)
def test_it_is_above_the_force_and_no_sum_cancels(name):
    mesh, terms = BODIES[name]
    u = state(mesh).reshape(-1, mesh.d)
    assembly = terms[0].bind(mesh)
    sizes, force = bound_of(assembly, u), force_of(assembly, u)
    assert (sizes >= np.abs(force)).all() and np.abs(force).max() > 1e-3
    before = np.ones_like(u)
    assembly.add_round_off(u, before)
    assert np.abs(before - sizes - 1).max() < 1e-14 * sizes.max()


def test_a_body_that_is_moved_far_away_has_the_round_off_of_its_displacements():
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
