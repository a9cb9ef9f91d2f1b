"""The quick studies of motion hold, their references are right, and they detect planted faults."""

import numpy as np
import pytest
from slow import slow

from skfem_stvk import BodyForce, Gravity, System
from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    Newmark,
    VelocityVerlet,
    simulate,
)
from skfem_stvk.solvers.dynamics.critical_step import critical_step
from skfem_stvk.solvers.dynamics.forces import add_mean_force
from skfem_stvk.solvers.dynamics.integrators import ENERGY
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper
from validation import dynamics
from validation.dynamics import (
    csm3,
    flight,
    independent,
    large_steps,
    limit,
    step_cost,
    step_solvers,
    studies,
    tangents,
    vibrations,
    work_precision,
)
from validation.dynamics.oscillation import Oscillation
from validation.dynamics.scenes import block, cantilever
from validation.statics.study import Study

# building blocks of the studies


def test_an_oscillation_is_described_by_its_periods():
    t = np.arange(0, 5, 0.013)
    x = -3 + 2 * np.sin(2 * np.pi * 1.7 * t + 0.3)
    periods = Oscillation.by_period(t, x)
    assert len(periods) == 7
    np.testing.assert_allclose(Oscillation.averaged(t, x), [-3, 2, 1.7], rtol=1e-4)
    np.testing.assert_allclose(Oscillation.last(t, x), periods[-1])


def test_means_over_periods_are_not_those_of_the_last():
    t = np.arange(0, 4, 0.01)
    x = (2 + 0.1 * t) * np.sin(2 * np.pi * t - 1)
    assert Oscillation.last(t, x).amplitude > Oscillation.averaged(t, x).amplitude + 0.09


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 1.0])
def test_generalized_alpha_is_predicted_with_its_spectral_radius(rho):
    wave = vibrations.generalized_alpha(rho, 1e-3)
    assert wave.angle == pytest.approx(1e-3, rel=1e-6) and wave.decay == pytest.approx(1, abs=1e-6)
    assert (
        vibrations.generalized_alpha(rho, 0.5).decay == pytest.approx(1, abs=1e-12)
        if rho == 1
        else vibrations.generalized_alpha(rho, 0.5).decay < 1
    )


def test_predictions_have_the_declared_order():
    for integrator in (
        VelocityVerlet(dt=1.0),
        BackwardEuler(dt=1.0),
        Newmark(dt=1.0),
        GeneralizedAlpha(dt=1.0),
        EnergyMomentum(dt=1.0),
    ):
        off = [abs(vibrations.predicted(integrator, omega).angle / omega - 1) for omega in (0.02, 0.01)]
        assert off[0] / off[1] == pytest.approx(4, rel=0.01)


def test_the_exact_tangent_is_the_derivative_of_the_force():
    system = block(2)
    u0, u1, v = 0.02 * np.random.default_rng(0).standard_normal((3, system.ndofs))
    K = tangents.EnergyMomentumSteps(system, symmetric=False).tangent(u0, u1)

    def force(u):
        f = np.zeros(system.ndofs)
        add_mean_force(system, u0, u, f)
        return f

    by_differences = (force(u1 + 1e-4 * v) - force(u1 - 1e-4 * v)) / 2e-4
    np.testing.assert_allclose(K @ v, by_differences, atol=1e-7 * np.abs(by_differences).max())
    assert abs(K - K.T).max() > 1e-2 * abs(K).max()
    symmetric = tangents.EnergyMomentumSteps(system, symmetric=True).tangent(u0, u1)
    assert abs(symmetric - symmetric.T).max() < 1e-12 * abs(symmetric).max() and abs(symmetric - K).max() > 1e-2 * abs(K).max()


def test_both_tangents_lead_to_the_step_of_the_package():
    system, dt = cantilever(1), 0.02
    run = simulate(system, EnergyMomentum(dt=dt, rtol=1e-12), until=3 * dt, quiet=True)
    for symmetric in (False, True):
        exact, u, v = tangents.EnergyMomentumSteps(system, symmetric), np.zeros(system.ndofs), np.zeros(system.ndofs)
        for _ in range(3):
            u, v = exact.step(u, v, dt)
        np.testing.assert_allclose(u, run.u, atol=1e-8 * np.abs(u).max())
        np.testing.assert_allclose(v, run.v, atol=1e-7 * np.abs(v).max())


def test_blocks_have_their_centre_of_mass_at_the_origin_and_vibrate_without_momentum():
    system = block(3)
    mass, v = system.mass().vertex, flight.first_velocities(system).reshape(-1, 3)
    assert np.abs(system.mesh.p @ mass).max() < 1e-14 * mass.sum()
    assert np.abs(mass @ v).max() < 1e-13 * np.abs(v).max()
    through = flight.first_velocities(system, (3.0, 1.5, -1.0)).reshape(-1, 3)
    np.testing.assert_allclose(mass @ through / mass.sum(), (3.0, 1.5, -1.0))


def test_errors_at_a_cost_and_costs_of_an_error_are_interpolated():
    points = [csm3.Point(dt, dt**2, 1 / dt) for dt in (0.1, 0.05, 0.025)]
    assert csm3.at_cost(points, 20.0) == pytest.approx(0.05**2)
    several = [work_precision.Point(ForwardEuler(dt=dt), dt**2, 1 / dt) for dt in (0.1, 0.01)]
    several.append(work_precision.Point(ForwardEuler(dt=1.0), float("nan"), 1.0))
    assert work_precision.seconds_to_reach(0.001, several) == pytest.approx(0.001**-0.5)
    assert np.isnan(work_precision.seconds_to_reach(0.5, several))
    assert np.isnan(work_precision.seconds_to_reach(0.5, several[2:]))


# the studies


@pytest.mark.parametrize("name", [name if name in ("flight", "vibrations") else slow(name) for name in dynamics.NAMES])
def test_the_studies_hold(name, tmp_path, capsys):
    code = dynamics.main(quick=True, only=[name], out=str(tmp_path / "new"))
    out = capsys.readouterr().out
    assert code == 0 and "claims hold" in out and "DOES NOT" not in out
    pictures = list((tmp_path / "new").glob("*.png"))
    assert len(pictures) == (name in ("csm3", "flight", "work-precision"))
    assert all(picture.stat().st_size > 10_000 for picture in pictures)


# planted faults are detected


def test_a_wrong_density_is_detected_in_csm3(monkeypatch):
    monkeypatch.setattr(csm3, "DENSITY", 1150.0)
    monkeypatch.setattr(csm3, "QUICK_MESHES", ((35, 2), (70, 4)))
    study = csm3._meshes(quick=True)
    assert not study.passed and any("extrapolated to" in failure for failure in study.failures)


def test_an_order_below_the_declared_one_is_detected(monkeypatch):
    monkeypatch.setattr(csm3, "INTEGRATORS", (EnergyMomentum, BackwardEuler))
    monkeypatch.setattr(csm3, "declared", lambda kind: 2)
    monkeypatch.setattr(csm3, "RISES", {csm3.SMOOTH: 1.0})
    failures = csm3._integrators(quick=True, folder=None).failures
    assert len(failures) == 1 and "BackwardEuler: order 1.0" in failures[0]


def test_energy_that_is_not_conserved_is_detected(monkeypatch):
    monkeypatch.setattr(Newmark, "conserves", EnergyMomentum.conserves)
    found = flight.fly(block(1), Newmark(dt=1e-3, rtol=1e-12), 0.02)
    assert any("energy drifts" in failure for failure in flight._failures(found, flight.KEPT))
    assert ENERGY in Newmark.conserves


def test_a_load_that_strains_is_detected_in_free_fall(monkeypatch):
    monkeypatch.setattr(flight, "FALLS", flight.FALLS[3:5])
    assert flight._falls(0.01).passed
    uneven = BodyForce(lambda x, t: np.outer([0, 0, -9810], 1 + 1e-4 * x[0]))
    monkeypatch.setattr(flight, "Gravity", lambda g: uneven)
    assert len(flight._falls(0.01).failures) == 2


def test_loose_solves_are_detected_in_the_long_flight(monkeypatch):
    monkeypatch.setattr(flight, "ROUND_OFF", 1e-6)
    seen = {failure.split(": ")[0] for failure in flight._long(50, 2).failures}
    assert seen == {row[0] for row in flight._long(2, 1).rows} and len(seen) == 3


def test_another_mass_is_detected(monkeypatch):
    monkeypatch.setattr(independent, "CASES", independent.CASES[2:3])
    monkeypatch.setattr(independent, "STEPS", 100)
    right = independent.reference
    monkeypatch.setattr(independent, "LIMIT", 1e-4)
    assert independent.independent()[0].passed
    monkeypatch.setattr(independent, "reference", lambda case: right(case._replace(mass="consistent")))
    assert not independent.independent()[0].passed


def test_another_frequency_is_detected(monkeypatch):
    monkeypatch.setattr(vibrations, "predicted", lambda integrator, omega: vibrations.Wave(omega * integrator.dt, 1.0))
    (study,) = vibrations.vibrations(quick=True)
    assert len(study.failures) == len(study.rows)


def test_another_limit_is_detected():
    case = next(limit._cases())
    true = critical_step(case.system)
    observed = limit.observed_limit(case, VelocityVerlet, true.step)
    assert not list(limit._failures(case, true, VelocityVerlet, observed))
    assert len(list(limit._failures(case, true, VelocityVerlet, 0.93 * true.step))) == 1
    assert len(list(limit._failures(case, true, VelocityVerlet, 0.8 * true.bound))) == 2
    assert np.isnan(limit.observed_limit(case, VelocityVerlet, 2 * true.step))


def test_a_tangent_that_fails_is_detected(monkeypatch):
    monkeypatch.setattr(large_steps, "ROBUST", ("rest", "diagonal"))
    failures = large_steps.large_steps(quick=True)[0].failures
    assert any(failure.startswith("rest, 1000") for failure in failures)
    assert any(failure.startswith("diagonal, 1 times") and "error" in failure for failure in failures)


def test_a_solver_that_gives_another_motion_is_detected():
    system = cantilever(1)
    loose, tight = (
        step_solvers.stepped(system, BackwardEuler(dt=0.02, rtol=rtol), np.zeros(system.ndofs), 2) for rtol in (1e-1, 1e-10)
    )
    assert not list(step_solvers._unlike("a body", {"one": tight, "other": tight}))
    failures = list(step_solvers._unlike("a body", {"one": loose, "other": tight}))
    assert len(failures) == 2 and "motions with one and other differ" in failures[0] and "iterations with one" in failures[1]


def test_more_iterations_with_ssor_are_detected(monkeypatch):
    monkeypatch.setattr(step_solvers, "PART", 0.1)
    study = step_solvers._of_eq9(quick=True)
    assert not study.passed and "iterations with SSOR" in study.failures[0]


def test_the_command_names_claims_that_do_not_hold(monkeypatch, capsys):
    broken = Study("a study", "1 = 2", ("number",), (("1",),), ("1 is not 2",))
    monkeypatch.setattr(studies, "limit", lambda quick, folder: [broken])
    assert studies.run(["limit"], quick=True, out=None) == 1
    assert "DOES NOT HOLD: a study" in capsys.readouterr().out


# timing


@pytest.mark.parametrize("integrator", [VelocityVerlet(dt=step_cost.DT), ForwardEuler(dt=step_cost.DT)], ids=lambda one: one.name)
def test_equal_numbers_of_steps_and_forces_are_timed_alternately(integrator, monkeypatch):
    """With a clock that counts forces, a step takes one unit, because it evaluates one force."""
    forces, evaluate = [], System.energy_and_force
    monkeypatch.setattr(System, "energy_and_force", lambda self, u, out=None: forces.append(1) or evaluate(self, u, out))
    monkeypatch.setattr(step_cost, "clock", lambda: float(len(forces)))
    body = block(1)
    system = step_cost.Interleaved(body.mesh, [*body.terms, Gravity((0.0,) * (body.mesh.d - 1) + (-9.81,))])
    first, rounds = step_cost._rounds(system, integrator, 3)
    assert first == 1 and np.array_equal(rounds, np.ones((3, 2)))


def test_the_first_step_is_not_timed(monkeypatch):
    """With a clock that counts steps, the first step takes no time."""
    steps, body = [], cantilever(1)
    step = ImplicitStepper.step
    monkeypatch.setattr(ImplicitStepper, "step", lambda self, state, t: steps.append(t) or step(self, state, t))
    monkeypatch.setattr(step_solvers, "clock", lambda: float(len(steps)) ** 2)
    found = step_solvers.stepped(body, BackwardEuler(dt=0.01), np.zeros(body.ndofs), 3)
    assert found.seconds == (4**2 - 1) / 3 and np.allclose(steps, [0.01, 0.02, 0.03, 0.04])
