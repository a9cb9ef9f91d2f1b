"""Counts and messages of runs, and folders of output files."""

import re
from dataclasses import dataclass

import numpy as np
from motions import clamped, reached, released, spinning

from skfem_stvk import Gravity, NeoHookean, RigidContact, RigidPlane, System, simulate
from skfem_stvk.mesh import box
from skfem_stvk.solvers.dynamics import EnergyMomentum, LinearBackwardEuler
from skfem_stvk.solvers.dynamics.integrators import StepFailed
from skfem_stvk.solvers.dynamics.integrators.implicit import ImplicitStepper
from skfem_stvk.solvers.dynamics.motion_checkpoint import load


def test_iterations_are_summed_over_all_steps():
    short, long = (clamped(3).run(LinearBackwardEuler(0.01), until).iterations for until in (0.2, 0.4))
    assert short >= 20 and long >= short + 20


def test_a_resumed_run_continues_its_counts(tmp_path):
    """Iterations, clamped tangents and seconds include the first part of the run, which has most of them."""
    pressed, integrator = released(3), LinearBackwardEuler(0.2)
    whole = pressed.run(integrator, 4.0)
    first = pressed.run(integrator, 3.0, checkpoint=tmp_path / "run")
    resumed = reached(pressed.system, checkpoint=tmp_path / "run", resume=True, until=4.0)
    assert 0 < first.iterations < resumed.iterations == whole.iterations
    assert re.search(r"[1-9]\d* of them with the clamped", first.message) and resumed.message == whole.message
    assert resumed.seconds.keys() == first.seconds.keys()
    assert all(resumed.seconds[part] >= 0.9 * first.seconds[part] for part in ("assemble", "factor", "solve"))


def test_an_unused_clamped_tangent_is_not_reported():
    assert "clamped" not in spinning(3).run(LinearBackwardEuler(0.01), 0.1).message


@dataclass(frozen=True)
class AlternatelyFailing(EnergyMomentum):
    """Integrator for which every other step fails unless it is made in halves."""

    def stepper(self, motion):
        return AlternatelyFailingStepper(motion, self)


class AlternatelyFailingStepper(ImplicitStepper):
    def step(self, state, t):
        if t - state.t > 0.9 * self.integrator.dt and round(t / self.integrator.dt) % 2:
            raise StepFailed("not this one")
        super().step(state, t)


def test_occasional_cut_steps_are_counted_without_a_warning():
    assert clamped(2).run(AlternatelyFailing(0.01), 0.4).cuts == 20


def test_a_run_resumes_in_its_original_folder(tmp_path, monkeypatch):
    scene, here, there = clamped(2), tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    monkeypatch.chdir(here)
    scene.run(EnergyMomentum(0.01), 0.1, save="run.pvd", checkpoint="run")
    monkeypatch.chdir(there)
    simulate(scene.system, checkpoint=here / "run", resume=True, until=0.2, quiet=True)
    assert not list(there.iterdir())
    assert '"0.2' in (here / "run.pvd").read_text()
    assert load(here / "run" / "motion.npz").saved.steps == 20


def test_a_body_that_starts_within_a_shape_makes_the_message_name_the_contact():
    """The normal of the floor points down, so most of the cube is within the half-space of the floor and its first step fails."""
    rubber = NeoHookean(young=5e4, poisson=0.4, density=1000.0)

    def message(normal, height=-0.05, **motion):
        floor = RigidContact(RigidPlane((0, 0, height), normal), name="floor")
        cube = System(box((0.1, 0.1, 0.1), (4, 4, 4)), [rubber, Gravity((0, 0, -9.81)), floor])
        return simulate(cube, EnergyMomentum(dt=1e-3), until=2e-3, quiet=True, raise_on_failure=False, **motion).message

    assert "The body starts within the shape of 'floor': check the position and the normal of the shape." in message(
        (0, 0, -1), 0.01
    )
    assert "starts within" not in message((0, 0, 1))
    wild = np.random.default_rng(0).normal(0, 300, 375)  # the first step fails, on a floor that the cube touches to round-off
    resting = message((0, 0, 1), 1e-17, v0=wild)
    assert "the step from t = 0 s did not converge" in resting and "starts within" not in resting
