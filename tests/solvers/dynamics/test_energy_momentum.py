"""Round-off does not accumulate in the energy of EnergyMomentum, and large rotations per step are solved."""

from fractions import Fraction

import numpy as np
import pytest
import skfem
from bodies import box

from skfem_stvk import StVK, System
from skfem_stvk.solvers.dynamics import EnergyMomentum, simulate
from skfem_stvk.solvers.dynamics.integrators.energy_momentum import _rate


def lost_in_the_square(rate):
    """Return the relative rounding error of the square of `rate`."""
    return float(abs(1 - Fraction(rate * rate) / Fraction(rate) ** 2))


def test_the_square_of_the_rate_is_almost_exact():
    steps = np.random.default_rng(0).uniform(1e-5, 1e-1, 200)
    assert max(abs(_rate(h) * h / 2 - 1) for h in steps) < 1e-14
    assert np.mean([lost_in_the_square(_rate(h)) for h in steps]) < 2e-18
    assert np.mean([lost_in_the_square(2 / h) for h in steps]) > 2e-17  # the error without this choice of the rate


def test_energy_does_not_drift_with_rounding():
    mesh = box()
    system = System(mesh, StVK(young=1e5, poisson=0.3, density=1000.0))
    p = mesh.p - mesh.p.mean(axis=1, keepdims=True)
    v = np.cross([1.0, 2.0, 8.0], p.T) + 0.2 * np.sin(5 * p).T
    ledger = simulate(system, EnergyMomentum(dt=1e-3, rtol=3e-16), until=0.5, v0=v.ravel(), quiet=True).ledger
    energy = ledger["total_energy"]
    assert np.ptp(energy) < 1e-13 * energy[0]
    assert np.ptp(ledger["strain_energy"]) > 1e-3 * energy[0] and ledger["closure_error"][0] == pytest.approx(0)


@pytest.mark.parametrize("solver", ["superlu", "block-jacobi-cg"])
def test_stiff_bodies_rotate_by_a_third_of_a_radian_per_step(solver):
    """No step is cut, although a body has shrunk by 1.4 % in the middle of such a step.

    Every step would be cut with the tensions of the middle in the tangent, or with the whole tangent at the end.
    """
    bar = skfem.MeshTet.init_tensor(np.linspace(-0.2, 0.2, 7), np.linspace(-0.05, 0.05, 3), np.linspace(-0.06, 0.06, 3))
    p = bar.p + 0.006 * np.random.default_rng(0).standard_normal(bar.p.shape)
    system = System((p, bar.t), StVK(young=1e9, poisson=0.3, density=1000.0))
    v = np.cross([1.0, 2.0, 10.0], p.T) + 0.3 * np.sin(40 * p).T
    run = simulate(system, EnergyMomentum(dt=1 / 30, rtol=1e-12, solver=solver), until=0.5, v0=v.ravel(), quiet=True)
    assert run.cuts == 0 and run.iterations < 60 * 15
    assert np.ptp(run.ledger["total_energy"]) < 1e-9 * run.ledger["total_energy"][0]
