"""Initial states of motions at supports, and first steps."""

import numpy as np
import pytest
from motions import MESHES, driven, material, velocities

from skfem_stvk import StvkError, SupportError, System, simulate
from skfem_stvk.solvers.dynamics import EnergyMomentum, VelocityVerlet
from skfem_stvk.solvers.dynamics.integrators import INTEGRATORS

MESH = MESHES[2]
LEFT = np.unique(MESH.boundaries["left"])


@pytest.mark.parametrize("integrator", [VelocityVerlet(0.01), EnergyMomentum(0.01)], ids=lambda one: one.name)
def test_constrained_vertices_are_bitwise_at_their_prescribed_positions(integrator):
    u0 = np.full(MESH.p.size, 1e-13)
    system = System(MESH, material(MESH), fixed={"left": "xy"})
    run = simulate(system, integrator, until=0.05, u0=u0, v0=velocities(MESH), quiet=True)
    assert not run.u.reshape(-1, 2)[LEFT].any() and not run.v.reshape(-1, 2)[LEFT].any()


def test_rounding_of_large_displacements_is_no_jump():
    far = 1e5 + 1 / 3
    system = System(MESH, material(MESH), prescribed={"left": {"x": lambda t: far, "y": 0.0}})
    u0 = np.tile([np.nextafter(far, np.inf), 0.0], MESH.nv)
    assert simulate(system, VelocityVerlet(0.01), until=0.05, u0=u0, v0=velocities(MESH), quiet=True).success
    with pytest.raises(SupportError, match="at t0 = 0 s"):
        simulate(system, VelocityVerlet(0.01), until=0.05, u0=u0 + 1e-3, quiet=True)


@pytest.mark.parametrize("dt", [1e-5, 1e-2])
def test_initial_velocities_of_supports_suit_the_step_size(dt):
    """The velocity of supports is a difference over a fraction of the step, for fast and slow supports."""
    omega = 0.05 / dt
    system = System(MESH, material(MESH), prescribed={"left": {"x": lambda t: 1e-4 * np.sin(omega * t), "y": 0.0}})
    run = simulate(system, EnergyMomentum(dt), until=dt, quiet=True)
    moving = system.mass().vertex[LEFT].sum()
    assert run.ledger["kinetic_energy"][0] == pytest.approx(moving * (1e-4 * omega) ** 2 / 2, rel=1e-6)


@pytest.mark.filterwarnings("ignore:.*above the critical one")
@pytest.mark.parametrize("integrator", INTEGRATORS.values())
def test_a_step_far_longer_than_the_motion_is_one_step_to_its_end(integrator, tmp_path):
    system, until = driven(2).system, 0.004
    one, huge = (simulate(system, integrator(dt), until=until, quiet=True) for dt in (until, 1e9))
    assert huge.success and huge.t == until and huge.ledger.steps == 2
    np.testing.assert_array_equal(huge.u, one.u)
    np.testing.assert_array_equal(huge.ledger.rows(), one.ledger.rows())
    assert np.abs(huge.u).max() > 0.5 * 0.6 * until  # the supports have moved
    simulate(system, integrator(1e9), until=until, checkpoint=tmp_path / "c", quiet=True)
    with pytest.raises(StvkError, match=r"until = -1 s; expected an end after t = 0 s"):
        simulate(system, checkpoint=tmp_path / "c", resume=True, until=-1.0, quiet=True)


def test_an_automatic_step_far_longer_than_the_motion_is_one_step_to_its_end():
    run = simulate(System(MESH, material(MESH)), VelocityVerlet(), until=1e-9, v0=velocities(MESH), quiet=True)
    assert run.success and run.t == 1e-9 and run.ledger.steps == 2
    np.testing.assert_allclose(run.u, 1e-9 * velocities(MESH), rtol=1e-6)
