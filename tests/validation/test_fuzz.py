"""A few random cases of every family are right, and planted faults are found."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from skfem_stvk import EnergyMomentum, StvkError, System, VelocityVerlet
from skfem_stvk.solvers.dynamics.integrators.explicit import VelocityVerletStepper
from skfem_stvk.terms.loads.mesh_contact import BoundMeshContact
from skfem_stvk.terms.loads.rigid_contact import BoundRigidContact, RigidContactWithHistory
from validation import limits
from validation.fuzz import bodies, files, programs, solves, study

CONTACTS = ("contacts", "contact programs", "contact solves", "contact motions")


@pytest.mark.few(2)
@pytest.mark.parametrize("family", ["bodies", "programs", "solves", "motions", *CONTACTS, "mesh files", "scene files"])
def test_random_cases_are_right_or_refused_with_a_clear_error(family, tmp_path):
    counts = Counter()
    drawn, check = study.families(tmp_path)[family]
    assert study.chunk(drawn, check, 5, 40, counts) == ""
    assert counts["cases"] >= 30 and counts["went through"] and counts["refused"]


def found(drawn, check, size=60):
    """Return the description of the smallest wrong case."""
    return study.chunk(drawn, check, 5, size, Counter())


def test_a_result_that_depends_on_earlier_calls_is_found(monkeypatch):
    def remembering(system, u, t=0.0):
        system.__dict__.setdefault("calls", []).append(1)
        return energy(system, u, t) * len(system.calls)

    energy = System.energy
    monkeypatch.setattr(System, "energy", remembering)
    story = found(programs.programs(), lambda drawn: programs.run_program(*drawn), 80)
    assert "of a fresh system" in story and story.count("'energy'") >= 1


@pytest.mark.slow
def test_a_force_that_is_not_the_derivative_is_found(monkeypatch):
    internal_force = System.internal_force
    monkeypatch.setattr(System, "internal_force", lambda system, u: 1.001 * internal_force(system, u))
    story = found(bodies.recipes(), bodies.check_body)
    assert "is not the derivative of" in story and "size=1" in story  # the smallest body with this fault


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of_state", "of_tangent", "said"),
    [(1.001, 1.0, "not in equilibrium"), (1.0, -1.0, "unstable: the lowest eigenvalue of K is -")],
)
def test_a_wrong_solve_reported_as_success_is_found(monkeypatch, of_state, of_tangent, said):
    def wrong(system, *arguments, **options):
        result, jacobian = solve_static(system, *arguments, **options), system.jacobian
        system.jacobian = lambda *at: of_tangent * jacobian(*at)
        return replace(result, u=of_state * result.u)

    solve_static = solves.solve_static
    monkeypatch.setattr(solves, "solve_static", wrong)
    assert said in found(solves.solves(), solves.check_solve)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("owner", "method", "held", "said"),
    [(VelocityVerletStepper, "step", "nothing", "linear momentum of"), (EnergyMomentum, "update", "a node", "energy of")],
)
def test_a_motion_that_loses_a_thousandth_of_its_velocity_is_found(monkeypatch, owner, method, held, said):
    def braked(self, state, *arguments):
        original(self, state, *arguments)
        state.v *= 0.999

    original = getattr(owner, method)
    monkeypatch.setattr(owner, method, braked)
    integrator = EnergyMomentum if owner is EnergyMomentum else VelocityVerlet
    drawn = solves.motions().map(lambda one: replace(one, recipe=replace(one.recipe, held=held), integrator=integrator))
    story = found(drawn, solves.check_motion)
    assert said in story and "is lost" in story


@pytest.mark.slow
def test_a_motion_with_a_spurious_spin_is_found(monkeypatch):
    """The planted spin about the centre of mass leaves linear momentum unchanged."""

    def spun(self, state, *arguments):
        original(self, state, *arguments)
        mass, mesh = self.motion.mass.vertex, self.motion.system.mesh
        x, v = mesh.p.T + state.u.reshape(-1, mesh.d), state.v.reshape(-1, mesh.d)
        arm = x - mass @ x / mass.sum()
        spin = 1e-3 * np.abs(v).max() / np.abs(arm).max()
        v[:, :2] += spin * np.stack([-arm[:, 1], arm[:, 0]], axis=1)

    original = VelocityVerletStepper.step
    monkeypatch.setattr(VelocityVerletStepper, "step", spun)
    free = {"held": "nothing", "loads": (), "d": 3}
    drawn = solves.motions().map(lambda one: replace(one, recipe=replace(one.recipe, **free), integrator=VelocityVerlet))
    assert "angular momentum of" in found(drawn, solves.check_motion)


def with_kind(kind, drawn):
    """Return bodies that touch something of one kind, without wrong arguments."""
    return drawn.map(
        lambda one: replace(one, touch=replace(one.touch, kind=kind, wrong=None, gap=0.05 if "bodies" in kind else -0.05))
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bound", "method", "said"),
    [
        (BoundRigidContact, "energy_and_force", "the force of a contact is not the derivative of its energy"),
        (BoundMeshContact, "energy_and_force", "the force of a contact is not the derivative of its energy"),
        (BoundRigidContact, "mean_force", "a work of"),
        (BoundMeshContact, "mean_force", "a work of"),
        (BoundMeshContact, "contact_limit", "a contact is passed at 0.9 of its limit"),
    ],
)
def test_faults_of_contacts_are_found(monkeypatch, bound, method, said):
    right = getattr(bound, method)

    def wrong(self, *given):
        if method == "contact_limit":
            return 3 * right(self, *given)
        force = given[-1]
        if not isinstance(force, np.ndarray) or len(given) < 2:
            return right(self, *given)
        before = force.copy()
        result = right(self, *given)
        force[:] = before + 1.01 * (force - before)
        return result

    monkeypatch.setattr(bound, method, wrong)
    drawn = with_kind("plane" if bound is BoundRigidContact else "two bodies", bodies.touching())
    assert said in found(drawn, bodies.check_body, 80)


@pytest.mark.slow
def test_a_body_in_another_one_and_a_result_of_another_time_are_found(monkeypatch):
    monkeypatch.setattr(solves, "crosses", lambda mesh, u: True)
    drawn = solves.motions(with_kind("two bodies", bodies.touching())).map(lambda one: replace(one, integrator=EnergyMomentum))
    assert "surfaces cross" in found(drawn, solves.check_motion)
    right = RigidContactWithHistory.at
    monkeypatch.setattr(RigidContactWithHistory, "at", lambda one, *given: vars(one).setdefault("_memo", right(one, *given)))
    drawn = programs.programs(with_kind("plane", bodies.touching(2)))
    assert "of a fresh system" in found(drawn, lambda drawn: programs.run_program(*drawn), 200)


@pytest.mark.slow
def test_foreign_errors_and_errors_without_an_explanation_are_found(monkeypatch, tmp_path):
    drawn, check = study.families(tmp_path)["mesh files"]

    def deep(path):
        raise KeyError("nodes")

    monkeypatch.setattr(files, "read_mesh", deep)
    assert "KeyError: 'nodes'" in found(drawn, check)

    def silent(path):
        raise StvkError("no")

    monkeypatch.setattr(files, "read_mesh", silent)
    assert "expected an explanation" in found(drawn, check)


@pytest.mark.slow
def test_an_endless_case_is_found():
    def endless():
        while True:
            pass

    with pytest.raises(limits.Hang, match="no result within 1 s"):
        limits.limited(endless, 1)


def test_meshes_are_of_all_kinds():
    """Meshes have one to about a thousand elements, boxes, both orientations, slivers, both degrees, and all dimensions."""
    made = []

    def check(recipe):
        made.append(bodies.mesh_of(recipe, np.random.default_rng(recipe.seed)))
        return True

    assert found(bodies.recipes(largest=5), check, 150) == ""
    kinds = {(mesh.element.name, mesh.d) for mesh in made}
    assert len(kinds) >= 12 and {1} < {mesh.nt for mesh in made} and max(mesh.nt for mesh in made) > 300
