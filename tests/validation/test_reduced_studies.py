"""The studies of reduced models: their quick forms hold, and what they claim can fail."""

import pytest

from validation import reduced
from validation.reduced import against_full, cables, membranes
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


@pytest.mark.parametrize(
    "study", [cables.hanging_cable, cables.cable_net, cables.inflated_sphere, membranes.clamped_disc, membranes.sheared_sheet]
)
def test_cables_and_membranes_are_as_their_own_equations_say(study):
    studies = list(study(True, None))
    assert studies
    for found in studies:
        assert found.passed, found.failures


def test_another_law_of_the_cables_is_noticed(monkeypatch):
    """Of engineering strain: `T = E A (s - 1)`, alike for small strain."""
    monkeypatch.setattr(cables, "stretch_of", lambda tension, stiffness: 1 + tension / stiffness)
    (found,) = cables.hanging_cable(True, None)
    assert not found.passed


@pytest.mark.parametrize(("name", "value"), [("STRETCH", 1.51), ("POISSON", 0.31)])
def test_a_sphere_of_another_law_is_noticed(monkeypatch, name, value):
    """The pressure is that of the closed form for the right numbers, the sphere is made of others."""
    right = cables.System

    def other(mesh, terms, **given):
        skin = terms[0]
        if name == "POISSON":
            terms = [cables.StVK(young=cables.YOUNG, poisson=value, thickness=skin.thickness), terms[1]]
        else:
            terms = [skin, cables.Pressure(None, 1.02 * terms[1].pressure)]
        return right(mesh, terms, **given)

    monkeypatch.setattr(cables, "System", other)
    (found,) = cables.inflated_sphere(True, None)
    assert not found.passed


def test_loads_that_are_not_those_of_the_net_are_noticed(monkeypatch):
    right = cables.NodalLoad
    monkeypatch.setattr(cables, "NodalLoad", lambda nodes, force: right(nodes, force * 1.0001))
    (found,) = cables.cable_net(True, None)
    assert not found.passed


def test_energy_is_kept_by_the_mean_of_the_force_alone(monkeypatch):
    from skfem_stvk.dynamics import step_matrix

    monkeypatch.setattr(against_full, "QUICK_PERIODS", 2)
    (found,) = against_full.kept_energy(True, None)
    lost = {row[0]: float(row[1]) for row in found.rows}
    assert found.passed and lost["Newmark"] > 1e6 * lost["EnergyMomentum"]
    monkeypatch.setattr(step_matrix, "GAUSS", (0.5, 0.5))
    (found,) = against_full.kept_energy(True, None)
    assert not found.passed


def test_costs_are_measured_for_every_size(monkeypatch):
    from validation.reduced import costs as module

    monkeypatch.setattr(module, "SECONDS", 0.01)
    (found,) = costs(True, None)
    assert [row[1] for row in found.rows] == ["full", "r = 5", "r = 20"] and found.claim == ""


def test_a_tension_field_of_another_law_is_noticed(monkeypatch):
    """Poisson's factor of plane stress left where it wrinkles."""
    right = membranes.tension_field
    assert all(study.passed for study in membranes.sheared_sheet(True, None))
    monkeypatch.setattr(membranes, "tension_field", lambda shear: (right(shear)[0] / (1 - membranes.POISSON**2), right(shear)[1]))
    assert not all(study.passed for study in membranes.sheared_sheet(True, None))
