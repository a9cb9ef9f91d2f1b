"""Loads that have a potential and are not dead, in motion.

The ledger contains their energy, and tangents, modes and critical steps contain their stiffness.
"""

import numpy as np
import pytest
from motions import MESHES, Scene, material, velocities
from scipy.linalg import eigh
from springs import PointSpring

from skfem_stvk import System, critical_step, modes
from skfem_stvk.solvers.dynamics import BackwardEuler, EnergyMomentum, LinearBackwardEuler, Newmark, VelocityVerlet

ANCHOR = (1.5, 0.8, -0.4)


def sprung(d, k=0.05, length=0.0, fixed=None, own=False):
    """Return a body with springs from one end to a point, or from each vertex to its position at rest."""
    mesh = MESHES[d]
    ids = np.unique(mesh.boundaries["right"])
    return System(mesh, [material(mesh), PointSpring(ids, mesh.p.T[ids] if own else ANCHOR[:d], k, length)], fixed=fixed)


def motion(d, integrator, until=0.4, **options):
    system = sprung(d, **options)
    return Scene(system, 0.2 * velocities(system.mesh)).run(integrator, until)


@pytest.mark.parametrize("d", [2, 3])
def test_energy_momentum_conserves_the_energy_of_springs_to_round_off(d):
    run = motion(d, EnergyMomentum(0.02))
    potential = run.ledger["potential_energy"]
    assert np.ptp(potential) > 0.1 * run.ledger["total_energy"].max() and not run.ledger["external_work"].any()
    assert potential[-1] == pytest.approx(run.system.potential(run.u) - run.system.energy(run.u), rel=1e-12)
    assert np.abs(run.ledger["closure_error"]).max() < 1e-11 * run.ledger["total_energy"].max()


def test_the_ledger_with_springs_of_nonzero_length_closes_to_second_order():
    errors = [
        np.abs(motion(2, make(dt), length=0.6).ledger["closure_error"]).max()
        for make in (EnergyMomentum, VelocityVerlet)
        for dt in (0.02, 0.01)
    ]
    assert 0 < errors[1] < 0.3 * errors[0] and 0 < errors[3] < 0.3 * errors[2]


@pytest.mark.parametrize(
    "integrator",
    [
        Newmark(1e-3),
        BackwardEuler(1e-3),
        BackwardEuler(1e-3, solver="ssor-cg"),
        BackwardEuler(1e-3, tangent="diagonal"),
        LinearBackwardEuler(1e-3),
        VelocityVerlet(1e-3),
    ],
    ids=str,
)
def test_every_integrator_finds_the_same_motion(integrator):
    options = {"k": 4.0, "until": 0.1, "own": True}
    u, fine = motion(3, integrator, **options).u, motion(3, EnergyMomentum(2e-3), **options).u
    assert np.abs(u - fine).max() < 0.02 * np.abs(fine).max()


def test_linear_backward_euler_is_stable_with_stiff_springs():
    """The linear solve includes their stiffness; otherwise the springs would be explicit, and steps 30 times too long."""
    run = motion(3, LinearBackwardEuler(0.05), until=1.0, k=1e4, own=True)
    assert run.success and run.ledger["total_energy"][-1] < run.ledger["total_energy"][0]
    assert run.ledger["potential_energy"].max() < 0.1 * run.ledger["total_energy"][0]


@pytest.mark.parametrize("solver", ["superlu", "amg-cg", "block-jacobi-cg"])
@pytest.mark.parametrize(("k", "length"), [(2.0, 0.0), (5.0, 0.4)])
def test_modes_have_the_stiffness_of_springs(solver, k, length):
    system = sprung(3, k, length, fixed={"left": "xyz"})
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    u = 0.02 * np.sin(np.arange(system.ndofs))
    u[system.supports.held] = 0
    K, M = (matrix.toarray()[np.ix_(free, free)] for matrix in (system.jacobian(u), system.mass().matrix))
    found = modes(system, 3, u=u, solver=solver)
    assert found.eigenvalues == pytest.approx(eigh(K, M, eigvals_only=True)[:3], rel=1e-6)
    assert (
        np.abs(
            found.eigenvalues / modes(System(system.mesh, material(system.mesh), fixed={"left": "xyz"}), 3, u=u).eigenvalues - 1
        ).max()
        > 0.01
    )


@pytest.mark.parametrize(("k", "length"), [(2.0, 0.0), (50.0, 0.0), (500.0, 0.4)])
def test_the_critical_step_is_safe_with_springs(k, length):
    system = sprung(2, k, length)
    u = 0.02 * np.sin(np.arange(system.ndofs))
    largest = eigh(system.jacobian(u).toarray(), system.mass().matrix.toarray(), eigvals_only=True)[-1]
    critical, bare = critical_step(system, u), critical_step(System(system.mesh, material(system.mesh)), u)
    limit = 2 / np.sqrt(largest)
    assert 0.6 * limit < critical.step <= limit * (1 + 1e-6) and critical.bound <= critical.step and critical.step < bare.step


def test_an_explicit_run_with_stiff_springs_finds_a_stable_step():
    run = motion(2, VelocityVerlet(), until=0.2, k=500.0, own=True)
    assert run.success and "blew up" not in run.message
    assert np.abs(run.ledger["closure_error"]).max() < 0.3 * run.ledger["total_energy"].max()
