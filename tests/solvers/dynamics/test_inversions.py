"""Runs report inverted elements."""

import re

import numpy as np
import pytest
import skfem
from motions import MESHES, material, reached

from skfem_stvk import ElementMesh, Gravity, NeoHookean, Newmark, StVK, StvkWarning, System, VolumePenalty, simulate
from skfem_stvk.mesh import box
from skfem_stvk.solvers.dynamics import (
    EnergyMomentum,
    ForwardEuler,
    LinearBackwardEuler,
    Rayleigh,
    SimulationError,
    Status,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics.guards import EXPLICIT

pytestmark = pytest.mark.filterwarnings("ignore:.*inverted:skfem_stvk.errors.StvkWarning")


def shaken(*terms):
    """Return a soft block on its base, and velocities of 6 m/s downwards for every other vertex."""
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 5)] * 3)
    elastic = StVK(young=1e5, poisson=0.3, density=1000.0)
    system = System(mesh, [elastic, *terms, Gravity((0, 0, -9.81))], fixed={lambda x: x[2] == 0: "xyz"})
    v = np.zeros(mesh.p.T.shape)
    v[::2, 2] = -6.0
    return system, v.ravel()


def folded():
    """Return a body with a corner pushed through it and a penalty that restores it, and its displacements."""
    mesh = MESHES[2]
    system = System(mesh, [material(mesh), VolumePenalty(3.0, kind="compression")], fixed={"left": "xy"})
    u = np.zeros((mesh.nv, 2))
    u[int(np.argmax(mesh.p.sum(axis=0)))] = [-0.45, -0.35]
    return system, u.ravel()


@pytest.mark.parametrize(
    ("integrator", "inverted"), [(VelocityVerlet(), 134), (ForwardEuler(1e-3), 100), (LinearBackwardEuler(0.005), 110)]
)
def test_a_motion_that_ends_with_inverted_elements_is_no_success(integrator, inverted, tmp_path):
    """Its files are written as for any other run, and the run can be resumed."""
    system, v0 = shaken()
    files = {"save": tmp_path / "run.pvd", "checkpoint": tmp_path / "run"}
    with pytest.raises(
        SimulationError, match=r"reached t = 0\.4 s .* elements \(\d+, .* inverted or flat .*VolumePenalty"
    ) as caught:
        simulate(system, integrator, until=0.4, v0=v0, quiet=True, **files)
    run = caught.value.run
    ids = system.inside_out(run.u)
    assert run.status is Status.ENDED_INVERTED and not run.success and run.t == 0.4
    assert run.ledger["inside_out"][-1] == len(ids) >= inverted - 20
    finding = next(one for one in run.findings if one.name == "inside out")
    np.testing.assert_array_equal(finding.elements, ids)
    table = np.genfromtxt(tmp_path / "run.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(table["inside_out"], run.ledger["inside_out"])
    assert reached(system, checkpoint=tmp_path / "run", resume=True, until=0.41).t == pytest.approx(0.41)


@pytest.mark.parametrize("integrator", [VelocityVerlet(0.01), LinearBackwardEuler(0.01)], ids=lambda one: one.name)
def test_temporary_inversions_are_a_success_and_reported(integrator, tmp_path):
    system, u0 = folded()
    files = {"checkpoint": tmp_path / "run", "damping": Rayleigh(alpha=3.0)}
    run = simulate(system, integrator, until=1.0, u0=u0, quiet=True, **files)
    first = len(system.inside_out(u0))
    assert first > 0 and run.ledger["inside_out"][0] == first and run.ledger["inside_out"][-1] == 0
    assert run.status is Status.FINISHED and run.success and not any(one.name == "inside out" for one in run.findings)
    most = f"{run.ledger['inside_out'].max():.0f}"
    said = rf"elements were inverted on the way, up to {most} at once, between t = 0 s and t = 0\.\d+ s"
    assert re.search(said, run.message)
    more = simulate(system, checkpoint=tmp_path / "run", resume=True, until=1.5, quiet=True)
    assert "inverted on the way" in more.message and more.success


def test_a_motion_without_inversion_reports_none():
    system, v0 = shaken()
    run = simulate(system, EnergyMomentum(0.005), until=0.05, v0=0.1 * v0, quiet=True)
    assert "inverted" not in run.message and not run.findings and not run.ledger["inside_out"].any()


def test_inversions_are_counted_at_every_implicit_step_and_at_some_explicit_steps():
    system, v0 = shaken()
    for integrator, every in ((LinearBackwardEuler(0.005), 1), (VelocityVerlet(0.005), EXPLICIT)):
        whole = reached(system, integrator, until=0.3, v0=v0).ledger["inside_out"]
        for steps in (20, 40, 47, 60):
            until = steps * 0.005
            run = reached(system, integrator, until=until, v0=v0)
            assert run.ledger["inside_out"][-1] == len(system.inside_out(run.u))
            assert whole[steps] == run.ledger["inside_out"][-1 if steps % every == 0 else -2]
        assert len(set(whole)) > 2


def test_a_resumed_run_has_the_counts_of_an_uninterrupted_run(tmp_path):
    """The end of the first part is reviewed at a step at which the whole run has no review."""
    system, v0 = shaken()
    whole = reached(system, VelocityVerlet(0.005), until=0.4, v0=v0)
    first = reached(system, VelocityVerlet(0.005), until=0.235, v0=v0, checkpoint=tmp_path / "run")
    resumed = reached(system, checkpoint=tmp_path / "run", resume=True, until=0.4)
    assert first.ledger["inside_out"][-1] != whole.ledger["inside_out"][47]
    np.testing.assert_array_equal(resumed.ledger.rows(), whole.ledger.rows())
    assert resumed.message == whole.message


def test_the_first_guess_of_a_step_inverts_no_element():
    """The first guess of a step inverts no element: the energy of such a state may be infinite, so that every step was halved."""
    mesh = box((0.3, 0.1, 0.1), (3, 1, 1))
    v0 = np.zeros((mesh.nv, 3))
    v0[:, 0] = -150 * (mesh.p[0] - 0.15)
    law = NeoHookean(young=1e5, poisson=0.3, density=1e3)
    run = simulate(System(mesh, law), Newmark(2e-3), until=0.04, v0=v0.ravel(), quiet=True)
    assert "smaller" not in run.message and not run.ledger["inside_out"].any() and mesh.p[0].max() + run.u[::3].max() > 0.1


def test_a_failed_run_reports_inverted_elements():
    system, _ = shaken()
    u0 = np.random.default_rng(0).uniform(-1, 1, system.mesh.p.T.shape) * (system.mesh.p[2] > 0)[:, None]
    run = simulate(system, EnergyMomentum(0.05), until=0.5, u0=u0.ravel(), quiet=True, raise_on_failure=False)
    assert run.status is Status.NOT_CONVERGED
    inverted = system.inside_out(run.u)
    assert len(inverted) > 100 and f"{len(inverted)} elements ({inverted[0]}, " in run.message and "inverted or flat" in run.message


def test_locking_and_final_overcompression_are_reported():
    mesh = ElementMesh.of(skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3))
    system = System(mesh, StVK(young=1.0, poisson=0.46, density=1.0))
    u0 = mesh.p.T * [0.0, 0.0, -0.5]
    with pytest.warns(StvkWarning, match=r"Poisson's ratio above 0.45"):
        run = simulate(system, VelocityVerlet(1e-3), until=2e-3, u0=u0.ravel(), quiet=True)
    assert run.success and [one.name for one in run.findings] == ["compressed"]
    assert "compressed to a principal stretch below 1/sqrt(3)" in run.message
