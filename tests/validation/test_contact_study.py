"""Studies of contact: the quick versions hold, and each claim can fail."""

from dataclasses import replace

import pytest

from skfem_stvk import Friction, StvkWarning
from skfem_stvk.terms.loads.mesh_contact import BoundMeshContact
from skfem_stvk.terms.loads.rigid_contact import BoundRigidContact
from validation import contact
from validation.contact import between, hertz, motions, pairs, pressed
from validation.contact.check import Check, study_of
from validation.study import measured


@pytest.fixture
def changed(monkeypatch):
    """Return a function that changes arguments of a class that a module of the study calls."""

    def change(module, name, **factors):
        right = getattr(module, name)

        def other(*given, **options):
            one = right(*given, **options)
            return replace(one, **{key: factor and factor * getattr(one, key) for key, factor in factors.items()})

        monkeypatch.setattr(module, name, other)

    return change


def quick(name):
    """Return the quick version of a study."""
    [study] = measured("validation.contact", contact.STUDIES[name], True, None)
    return study


@pytest.mark.few(2)
@pytest.mark.parametrize("name", contact.NAMES)
def test_the_quick_study_holds(name, gmsh):
    study = quick(name)
    assert study.passed and len(study.rows) > 1, study.failures


def test_the_areas_of_facets_that_face_away_are_detected(changed):
    changed(pressed, "RigidContact", where=None)
    assert len(pressed.patch(True).failures) == 6


@pytest.mark.slow
def test_a_doubled_stiffness_is_detected(changed):
    """Under a traction the pressure does not depend on the stiffness."""
    changed(pressed, "RigidContact", stiffness=2.0)
    failures = pressed.patch(True).failures
    assert len(failures) == 3 and all("lid: " in failure for failure in failures)


@pytest.mark.slow
@pytest.mark.parametrize(("module", "study"), [(pressed, "capstan"), (motions, "slope")])
def test_another_coefficient_of_friction_is_detected(changed, monkeypatch, module, study):
    monkeypatch.setattr(pressed, "FRICTIONS", (0.3,))
    monkeypatch.setattr(motions, "ANGLES", (1.1,))
    changed(module, "Friction", coefficient=1.05)
    assert not quick(study).passed


@pytest.mark.slow
def test_another_indentation_and_a_soft_plate_are_detected(monkeypatch, gmsh):
    """Hertz's approach without Tatara's correction, and a stiffness of 10 E/h, change the force by more than 0.5 %."""
    assert abs(hertz.pressed(hertz.LinearElastic, 0.1, k=10.0).force - 1) > hertz.FORCE_LIMIT
    monkeypatch.setattr(hertz, "approach", lambda a: a**2)
    assert any("force" in failure for failure in hertz.hertz(True).failures)


@pytest.mark.slow
def test_a_soft_wall_and_a_heavy_bar_are_detected(changed, monkeypatch):
    monkeypatch.setattr(motions, "ELEMENTS", 20)
    right = motions.StVK
    monkeypatch.setattr(motions, "StVK", lambda density, **given: right(density=1.1 * density, **given))
    assert abs([*motions.impact(10.0)][1].error) > 5e-3
    changed(motions, "RigidContact", stiffness=0.1)
    assert abs(next(motions.impact(1.0)).error) > 0.03


@pytest.mark.slow
@pytest.mark.parametrize("study", ["bar", "bounce", "collision"])
def test_the_force_at_the_end_of_a_step_loses_energy(monkeypatch, study):
    def end(self, u0, u1, weights, theta, force):
        before = force.copy()
        self.energy_and_force(u1, force)
        force[:] = before + sum(weights) * (force - before)
        return 0.0

    for bound in (BoundRigidContact, BoundMeshContact):
        monkeypatch.setattr(bound, "mean_force", end)
    monkeypatch.setattr(motions, "ELEMENTS", 20)
    failures = quick(study).failures
    assert any("lost energy" in failure for failure in failures)
    assert study != "collision" or any("ratio of the two" in failure for failure in failures)


@pytest.mark.slow
def test_a_force_without_a_reaction_changes_the_momentum(monkeypatch):
    right = BoundMeshContact.mean_force

    def unbalanced(self, u0, u1, weights, theta, force):
        before = force.copy()
        right(self, u0, u1, weights, theta, force)
        force[self.nodes[0]] += 1e-6 * (force - before).max()
        return 0.0

    monkeypatch.setattr(BoundMeshContact, "mean_force", unbalanced)
    assert any("linear momentum" in failure for failure in pairs.collision(True).failures)


@pytest.mark.slow
def test_a_thick_barrier_changes_the_stress_off_the_side_faces(monkeypatch):
    monkeypatch.setattr(pairs, "THIN", 10 * pairs.THIN)
    assert any("stress in the lower block" in failure for failure in pairs.pair(True).failures)


@pytest.mark.slow
def test_a_soft_barrier_and_another_approach_of_two_balls_are_detected(monkeypatch, gmsh):
    """A barrier of E/100 lets the balls come closer. Hertz's approach without Tatara's correction is larger."""
    with_options(monkeypatch, between, "MeshContact", stiffness=0.01)
    assert any("force" in failure for failure in between.balls(True).failures)
    monkeypatch.undo()
    monkeypatch.setattr(between, "approach", lambda a: a**2)
    assert any("force" in failure for failure in between.balls(True).failures)


@pytest.mark.slow
def test_friction_and_a_ring_of_few_edges_are_detected_while_ironing(monkeypatch):
    monkeypatch.setattr(between, "RING_CELLS", (2, 1, 10))
    assert any("normal force" in failure for failure in between.ironing(True).failures)
    monkeypatch.undo()
    with_options(monkeypatch, between, "MeshContact", friction=Friction(0.1, slip_length=1e-4))
    with pytest.warns(StvkWarning, match="Press first"):  # the ring touches at few points first, which slip in one direction
        assert any("force of the contact/reaction" in failure for failure in between.ironing(True).failures)


def with_options(monkeypatch, module, name, **options):
    right = getattr(module, name)
    monkeypatch.setattr(module, name, lambda *given, **others: right(*given, **others, **options))


def test_a_number_that_is_not_expected_fails_the_command(monkeypatch, capsys):
    wrong = study_of("a study", "1 = 2", [Check("one", float("nan"), 1.0, 0.1), Check("two", 2.0), Check("three", 3.1, 3.0, 0.1)])
    assert len(wrong.failures) == 1 and "one: nan; expected 1," in wrong.failures[0]
    monkeypatch.setattr(motions, "bar", lambda quick: wrong)
    assert contact.main(quick=True, only=["bar"]) == 1
    assert "DOES NOT HOLD: a study" in capsys.readouterr().out
