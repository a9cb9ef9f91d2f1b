"""The quick studies of static solves hold, and they detect planted faults."""

import numpy as np
import pytest

from skfem_stvk import StVK
from validation import statics
from validation.statics import (
    elastica,
    homogeneous,
    kinds,
    manufactured,
    turek_hron,
)
from validation.statics.closed_states import STATES
from validation.statics.orders import extrapolated
from validation.study import Study


def lame(k, young=2.0, poisson=0.3):
    return (young, 0.0) if k == 1 else (young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson)))


@pytest.mark.few
@pytest.mark.parametrize("t", [0.3, 1.0])
@pytest.mark.parametrize(("state", "k"), [(name, k) for name, (_, dimensions) in STATES.items() for k in dimensions])
def test_closed_forms_are_those_of_the_law(state, k, t):
    lam, mu = lame(k)
    F, P = STATES[state][0](k, lam, mu, t)
    E = (F.T @ F - np.eye(k)) / 2
    assert np.abs(P).max() > 0.01
    np.testing.assert_allclose(F @ (lam * np.trace(E) * np.eye(k) + 2 * mu * E), P, atol=1e-14)


def test_body_force_is_minus_the_divergence_of_the_nominal_stress():
    x, h = np.random.default_rng(0).random((3, 50)), 1e-5
    steps = h * np.eye(3)[:, :, None]
    by_differences = -sum(
        (manufactured.nominal_stress(x + steps[J], 0.7) - manufactured.nominal_stress(x - steps[J], 0.7))[:, J] / (2 * h)
        for J in range(3)
    )
    exact = manufactured.body_force(x, 0.7)
    assert np.abs(by_differences - exact).max() < 1e-8 * np.abs(exact).max()


def test_gradient_is_that_of_the_displacement():
    x, h = np.random.default_rng(0).random((3, 50)), 1e-6
    for J, step in enumerate(h * np.eye(3)[:, :, None]):
        by_differences = (manufactured.displacement(x + step, 0.7) - manufactured.displacement(x - step, 0.7)) / (2 * h)
        np.testing.assert_allclose(by_differences, manufactured.gradient(x, 0.7)[:, J], atol=1e-9)


@pytest.mark.parametrize("case", elastica.CASES, ids=lambda case: f"{case.kind} {case.load:g}")
def test_the_elastica_is_the_published_one(case):
    np.testing.assert_allclose(elastica.elastica_tip(case.kind, case.load), case.table, atol=6e-6)


def test_the_elastica_under_a_small_load_is_eulers_beam():
    np.testing.assert_allclose(elastica.elastica_tip("tip", 1e-3)[0], 1e-3 / 3, rtol=1e-5)
    np.testing.assert_allclose(elastica.elastica_tip("uniform", 1e-3)[0], 1e-3 / 8, rtol=1e-5)


def test_the_flag_is_clamped_at_the_arc():
    mesh = turek_hron.strip(10, 4, turek_hron.flag)
    clamp = mesh.p[:, :5]
    np.testing.assert_allclose(np.hypot(*(clamp - 0.2)), 0.05, rtol=1e-14)
    np.testing.assert_allclose(clamp[:, 0], (0.2489898, 0.19), atol=1e-7)
    assert np.ptp(mesh.p[0, -5:]) < 1e-15 and mesh.p[0].max() == pytest.approx(0.6)


def test_extrapolation_from_three_meshes_eliminates_two_orders():
    assert extrapolated([1 + 2 * h**2 + 3 * h**4 for h in (1, 0.5, 0.25)]) == pytest.approx(1.0, abs=1e-14)


def test_homogeneous_states_agree_with_closed_forms():
    study = homogeneous.homogeneous(quick=True)
    assert study.passed, study.failures
    assert len(study.rows) == 5 + 3 * 4 + 2


def test_a_wrong_modulus_is_detected(monkeypatch):
    monkeypatch.setattr(kinds.Kind, "term", lambda self: StVK(young=kinds.YOUNG, poisson=kinds.POISSON + 1e-8, **self.options))
    kind = kinds.KINDS["triangles, plane strain"]
    errors = homogeneous.by_tractions(kind, STATES["uniaxial strain"][0], 3)
    assert max(errors) > homogeneous.LIMIT


@pytest.mark.slow
def test_turek_and_hrons_reference_is_reproduced():
    study = turek_hron.turek_hron(quick=True)
    assert study.passed, study.failures


@pytest.mark.slow
def test_a_straight_clamp_is_detected(monkeypatch):
    monkeypatch.setattr(turek_hron, "flag", lambda a, b: (0.25 + a * 0.35, 0.19 + 0.02 * b))
    monkeypatch.setattr(turek_hron, "CASES", turek_hron.CASES[:1])
    study = turek_hron.turek_hron(quick=True)
    assert not study.passed and "extrapolated to" in study.failures[0]


def test_the_manufactured_solution_converges():
    study = manufactured.manufactured(quick=True)
    assert study.passed, study.failures


@pytest.mark.slow
def test_a_wrong_body_force_is_detected(monkeypatch):
    right = manufactured.body_force
    monkeypatch.setattr(manufactured, "body_force", lambda x, t: 1.3 * right(x, t))
    monkeypatch.setattr(manufactured, "CELLS", (4, 6, 8))
    assert not manufactured.manufactured(quick=True).passed


@pytest.mark.slow
def test_slender_cantilevers_are_elasticas():
    study = elastica.elastica(quick=True)
    assert study.passed, study.failures


def test_the_command_names_claims_that_do_not_hold(monkeypatch, capsys):
    broken = Study("a study", "1 = 2", ("number",), (("1",),), ("1 is not 2",))
    monkeypatch.setattr(elastica, "elastica", lambda quick: broken)
    assert statics.main(quick=True, only=["elastica"]) == 1
    assert "DOES NOT HOLD: a study" in capsys.readouterr().out


def test_a_study_without_rows_does_not_pass():
    assert not Study("a study", "nothing", ("number",), ()).passed


def test_the_command_prints_the_requested_studies(capsys):
    assert statics.main(quick=True, only=["homogeneous"]) == 0
    out = capsys.readouterr().out
    assert "Homogeneous" in out and "all 1 claims hold" in out and "Turek" not in out
