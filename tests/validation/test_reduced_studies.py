"""Studies of reduced models: the quick versions hold, and each claim can fail."""

import pytest

from validation.reduced import against_full, cables, membranes


@pytest.mark.few(1)
@pytest.mark.parametrize("study", [against_full.at_rest, against_full.in_motion])
def test_derivatives_reduce_the_error_of_modes(study):
    (found,) = study(True)
    assert found.passed, found.failures
    errors = {row[0]: [float(one.rstrip("%")) for one in row[1:]] for row in found.rows}
    assert errors["modes"][-1] > 20 and errors["modes and derivatives"][-1] < 12 and errors["all three"][-1] < 4


def test_modes_instead_of_derivatives_do_not_reduce_the_error(monkeypatch):
    kinds = against_full.KINDS
    monkeypatch.setattr(against_full, "KINDS", (kinds[0], kinds[1]._replace(derivatives=False, modes=kinds[0].modes), *kinds[2:]))
    (found,) = against_full.at_rest(True)
    assert not found.passed


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "study", [cables.hanging_cable, cables.cable_net, cables.inflated_sphere, membranes.clamped_disc, membranes.sheared_sheet]
)
def test_cables_and_membranes_satisfy_their_own_equations(study):
    studies = list(study(True))
    assert studies
    for found in studies:
        assert found.passed, found.failures


def test_another_law_of_the_cables_is_detected(monkeypatch):
    """A law in engineering strain, `T = E A (s - 1)`, which is equal for small strains, is detected."""
    monkeypatch.setattr(cables, "stretch_of", lambda tension, stiffness: 1 + tension / stiffness)
    (found,) = cables.hanging_cable(True)
    assert not found.passed


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), [("STRETCH", 1.51), ("POISSON", 0.31)])
def test_a_sphere_of_another_law_is_detected(monkeypatch, name, value):
    """A sphere whose numbers differ from those of the closed form is detected."""
    right = cables.System

    def other(mesh, terms, **given):
        skin = terms[0]
        if name == "POISSON":
            terms = [cables.StVK(young=cables.YOUNG, poisson=value, thickness=skin.thickness), terms[1]]
        else:
            terms = [skin, cables.Pressure(None, 1.02 * terms[1].pressure)]
        return right(mesh, terms, **given)

    monkeypatch.setattr(cables, "System", other)
    (found,) = cables.inflated_sphere(True)
    assert not found.passed


@pytest.mark.slow
def test_other_loads_on_the_net_are_detected(monkeypatch):
    right = cables.NodalLoad
    monkeypatch.setattr(cables, "NodalLoad", lambda nodes, force: right(nodes, force * 1.0001))
    (found,) = cables.cable_net(True)
    assert not found.passed


@pytest.mark.slow
def test_only_the_mean_of_the_force_conserves_energy(monkeypatch):
    from skfem_stvk.solvers.dynamics import step_matrix

    monkeypatch.setattr(against_full, "QUICK_PERIODS", 2)
    (found,) = against_full.conserved_energy(True)
    lost = {row[0]: float(row[1]) for row in found.rows}
    assert found.passed and lost["Newmark"] > 1e6 * lost["EnergyMomentum"]
    monkeypatch.setattr(step_matrix, "GAUSS", (0.5, 0.5))
    (found,) = against_full.conserved_energy(True)
    assert not found.passed


@pytest.mark.slow
def test_a_tension_field_of_another_law_is_detected(monkeypatch):
    """A tension field with the factor `1/(1 - nu^2)` of plane stress is detected."""
    right = membranes.tension_field
    assert all(study.passed for study in membranes.sheared_sheet(True))
    monkeypatch.setattr(membranes, "tension_field", lambda shear: (right(shear)[0] / (1 - membranes.POISSON**2), right(shear)[1]))
    assert not all(study.passed for study in membranes.sheared_sheet(True))
