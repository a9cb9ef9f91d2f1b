"""Counts and messages of runs, and where they write."""

import re
from dataclasses import dataclass

import numpy as np
import pytest
from motions import clamped, let_go, reached, spinning

from skfem_stvk import simulate
from skfem_stvk.dynamics import EnergyMomentum, LinearBackwardEuler
from skfem_stvk.dynamics.checkpoint import load
from skfem_stvk.dynamics.integrators import StepFailed
from skfem_stvk.dynamics.integrators.implicit import ImplicitStepper
from skfem_stvk.nonlinear.stopwatch import Stopwatch


def test_iterations_are_those_of_all_steps():
    short, long = (clamped(3).run(LinearBackwardEuler(0.01), until).iterations for until in (0.2, 0.4))
    assert short >= 20 and long >= short + 20


def test_a_resumed_run_goes_on_counting(tmp_path):
    """Iterations, clamped tangents and seconds, of which the first part of the run has most."""
    pressed, integrator = let_go(3), LinearBackwardEuler(0.2)
    whole = pressed.run(integrator, 4.0)
    first = pressed.run(integrator, 3.0, checkpoint=tmp_path / "run")
    resumed = reached(pressed.system, checkpoint=tmp_path / "run", resume=True, until=4.0)
    assert 0 < first.iterations < resumed.iterations == whole.iterations
    assert re.search(r"[1-9]\d* of them with the clamped", first.message) and resumed.message == whole.message
    assert resumed.seconds.keys() == first.seconds.keys()
    assert all(resumed.seconds[part] >= 0.9 * first.seconds[part] for part in ("assemble", "factor", "solve"))


def test_seconds_that_are_added_are_in_their_parts_and_in_the_total():
    watch = Stopwatch("write")
    watch.add({"assemble": 100.0, "write": 10.0, "other": 1000.0})
    parts = watch.parts()
    assert parts["assemble"] == 100 and parts["write"] == 10 and parts["solve"] == 0
    assert parts["other"] >= 1000 and watch.total() == pytest.approx(sum(parts.values()), abs=1.0)


def test_a_clamped_tangent_that_was_not_needed_is_not_told_of():
    assert "clamped" not in spinning(3).run(LinearBackwardEuler(0.01), 0.1).message


@pytest.mark.parametrize("d", [2, 3])
def test_energy_is_kept_next_to_round_off_without_asking(d):
    energy = spinning(d).run(EnergyMomentum(0.01), 0.3).ledger["total_energy"]
    assert np.ptp(energy) < 1e-12 * energy[0]


@dataclass(frozen=True)
class EveryOther(EnergyMomentum):
    """Every other step has to be made in halves."""

    def stepper(self, motion):
        return EveryOtherStepper(motion, self)


class EveryOtherStepper(ImplicitStepper):
    def step(self, state, t):
        if t - state.t > 0.9 * self.integrator.dt and round(t / self.integrator.dt) % 2:
            raise StepFailed("not this one")
        super().step(state, t)


def test_steps_that_are_cut_now_and_then_are_counted_without_a_warning():
    assert clamped(2).run(EveryOther(0.01), 0.4).cuts == 20


def test_a_run_goes_on_in_the_folder_where_it_was(tmp_path, monkeypatch):
    scene, here, there = clamped(2), tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    monkeypatch.chdir(here)
    scene.run(EnergyMomentum(0.01), 0.1, save="run.pvd", checkpoint="run")
    monkeypatch.chdir(there)
    simulate(scene.system, checkpoint=here / "run", resume=True, until=0.2, quiet=True)
    assert not list(there.iterdir())
    assert '"0.2' in (here / "run.pvd").read_text()
    assert load(here / "run" / "motion.npz").header.now.steps == 20
