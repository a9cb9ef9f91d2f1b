"""Bounds of the round-off of the force."""

import numpy as np
import pytest
from bodies import MESHES, state
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


def test_round_off_grows_with_the_displacement_of_the_body():
    mesh = MESHES["tetrahedra"]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, 3)
    near, far = (np.linalg.norm(bound_of(assembly, u + offset)) for offset in (0.0, 1e6))
    assert 1e5 < far / near < 1e8


@pytest.mark.parametrize("parts", [2, 5])
def test_the_bound_is_added_and_threads_do_not_change_it(parts, monkeypatch):
    mesh = MESHES["tetrahedra"]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, 3)
    alone = bound_of(assembly, u)
    in_parts(monkeypatch, parts)
    more = np.ones_like(u)
    assembly.add_round_off(u, more)
    assert np.abs(more - 1 - alone).max() < 1e-14 * alone.max()
