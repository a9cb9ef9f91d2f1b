"""The studies of reduced models: their quick forms hold, and what they claim can fail."""

import pytest

from validation import reduced
from validation.reduced import against_full
from validation.reduced.costs import costs
from validation.reduced.studies import STUDIES


def test_every_name_has_a_study():
    assert tuple(STUDIES) == reduced.NAMES


@pytest.mark.parametrize("study", [against_full.at_rest, against_full.in_motion])
def test_derivatives_bring_the_error_of_modes_down(study, tmp_path):
    (found,) = study(True, tmp_path)
    assert found.passed, found.failures
    errors = {row[0]: [float(one.rstrip("%")) for one in row[1:]] for row in found.rows}
    assert errors["modes"][-1] > 20 and errors["modes and derivatives"][-1] < 12 and errors["all three"][-1] < 4


def test_modes_in_place_of_their_derivatives_do_not(monkeypatch):
    kinds = against_full.KINDS
    monkeypatch.setattr(against_full, "KINDS", (kinds[0], kinds[1]._replace(derivatives=False, modes=kinds[0].modes), *kinds[2:]))
    (found,) = against_full.at_rest(True, None)
    assert not found.passed


def test_energy_is_kept_by_the_mean_of_the_force_alone(monkeypatch):
    from skfem_stvk.reduced import motion

    monkeypatch.setattr(against_full, "QUICK_PERIODS", 2)
    (found,) = against_full.kept_energy(True, None)
    lost = {row[0]: float(row[1]) for row in found.rows}
    assert found.passed and lost["Newmark"] > 1e6 * lost["EnergyMomentum"]
    monkeypatch.setattr(motion, "GAUSS", (0.5, 0.5))
    (found,) = against_full.kept_energy(True, None)
    assert not found.passed


def test_costs_are_measured_for_every_size(monkeypatch):
    from validation.reduced import costs as module

    monkeypatch.setattr(module, "SECONDS", 0.01)
    (found,) = costs(True, None)
    assert [row[1] for row in found.rows] == ["full", "r = 5", "r = 20"] and found.claim == ""
