"""The quick studies of motion hold, their references are right, and they detect planted faults."""

import numpy as np
import pytest
from slow import slow

from skfem_stvk.solvers.dynamics import (
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    Newmark,
    VelocityVerlet,
)
from skfem_stvk.solvers.dynamics.integrators import ENERGY
from validation import dynamics
from validation.dynamics import (
    csm3,
    flight,
    independent,
    vibrations,
    work_precision,
)
from validation.dynamics.oscillation import Oscillation
from validation.dynamics.scenes import block
from validation.study import Study

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


def test_blocks_have_their_centre_of_mass_at_the_origin_and_vibrate_without_momentum():
    system = block(3)
    mass, v = system.mass().vertex, flight.first_velocities(system).reshape(-1, 3)
    assert np.abs(system.mesh.p @ mass).max() < 1e-14 * mass.sum()
    assert np.abs(mass @ v).max() < 1e-13 * np.abs(v).max()
    through = flight.first_velocities(system, (3.0, 1.5, -1.0)).reshape(-1, 3)
    np.testing.assert_allclose(mass @ through / mass.sum(), (3.0, 1.5, -1.0))


def test_costs_of_an_error_are_interpolated():
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
    assert len(pictures) == (name in ("flight", "work-precision"))
    assert all(picture.stat().st_size > 10_000 for picture in pictures)


# planted faults are detected


def test_a_wrong_density_is_detected_in_csm3(monkeypatch):
    monkeypatch.setattr(csm3, "DENSITY", 1150.0)
    monkeypatch.setattr(csm3, "QUICK_MESHES", ((35, 2), (70, 4)))
    study = csm3.csm3(quick=True)
    assert not study.passed and any("extrapolated to" in failure for failure in study.failures)


@pytest.mark.slow
def test_energy_that_is_not_conserved_is_detected(monkeypatch):
    monkeypatch.setattr(Newmark, "conserves", EnergyMomentum.conserves)
    found = flight.fly(block(1), Newmark(dt=1e-3, rtol=1e-12), 0.02)
    assert any("energy drifts" in failure for failure in flight._failures(found, flight.KEPT))
    assert ENERGY in Newmark.conserves


@pytest.mark.slow
def test_loose_solves_are_detected_in_the_long_flight(monkeypatch):
    monkeypatch.setattr(flight, "ROUND_OFF", 1e-6)
    seen = {failure.split(": ")[0] for failure in flight._long(50, 2).failures}
    assert seen == {row[0] for row in flight._long(2, 1).rows} and len(seen) == 3


@pytest.mark.slow
def test_another_mass_is_detected(monkeypatch):
    monkeypatch.setattr(independent, "CASES", independent.CASES[2:3])
    monkeypatch.setattr(independent, "STEPS", 100)
    right = independent.reference
    monkeypatch.setattr(independent, "LIMIT", 1e-4)
    assert independent.independent()[0].passed
    monkeypatch.setattr(independent, "reference", lambda case: right(case._replace(mass="consistent")))
    assert not independent.independent()[0].passed


@pytest.mark.slow
def test_another_frequency_is_detected(monkeypatch):
    monkeypatch.setattr(vibrations, "predicted", lambda integrator, omega: vibrations.Wave(omega * integrator.dt, 1.0))
    (study,) = vibrations.vibrations(quick=True)
    assert len(study.failures) == len(study.rows)


def test_the_command_names_claims_that_do_not_hold(monkeypatch, capsys):
    broken = Study("a study", "1 = 2", ("number",), (("1",),), ("1 is not 2",))
    monkeypatch.setattr(vibrations, "vibrations", lambda quick: [broken])
    assert dynamics.main(quick=True, only=["vibrations"]) == 1
    assert "DOES NOT HOLD: a study" in capsys.readouterr().out
