"""Jumps of supports are reported, and fast motions of supports are not."""

import warnings

import numpy as np
import pytest
from motions import MESHES, Scene, driven, material

from skfem_stvk import StvkWarning, System, simulate
from skfem_stvk.solvers.dynamics import EnergyMomentum, ForwardEuler, LinearBackwardEuler, Newmark, SimulationError, VelocityVerlet
from skfem_stvk.solvers.dynamics.guards import Jumps
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.record import MotionState

DT, SIZE = 0.01, 0.02
JUMPS = {
    "within a step": (0.104, SIZE, lambda t: SIZE * (t > 0.104)),
    "where a step ends": (0.1, SIZE, lambda t: SIZE * (t >= 10 * DT)),
    "where a step begins": (0.1, SIZE, lambda t: SIZE * (t > 10 * DT)),
    "soon after the beginning": (0.001, SIZE, lambda t: SIZE * (t > 0.001)),
    "in the last step, which is shorter": (0.2055, SIZE, lambda t: SIZE * (t > 0.2055)),
    "back, of a sawtooth": (0.05, SIZE, lambda t: SIZE * ((t / 0.05) % 1)),
    "on a motion": (0.12, SIZE, lambda t: 0.1 * t + SIZE * (t > 0.12)),
    "against a motion": (0.12, SIZE, lambda t: 0.1 * t - SIZE * (t > 0.12)),
    "of stairs": (0.03, SIZE / 4, lambda t: SIZE / 4 * np.floor(t / 0.03)),
    "of stairs that grow": (0.05, SIZE / 100, lambda t: SIZE / 100 * (np.floor(t / 0.05) + 20 * np.floor(t / 0.1))),
    "in a thousandth of a step": (0.1, SIZE, lambda t: SIZE * np.clip((t - 0.1) / (DT / 20_000), 0, 1)),
}
MOTIONS = {
    "a sine at 8 steps a period": lambda t: SIZE * np.sin(2 * np.pi * t / (8 * DT)),
    "a sine at 2.3 steps a period": lambda t: SIZE * np.sin(2 * np.pi * t / (2.3 * DT)),
    "a cosine that begins at rest": lambda t: SIZE * (1 - np.cos(2 * np.pi * t / (8 * DT))),
    "a cosine that steps hardly see": lambda t: SIZE * (1 - np.cos(2 * np.pi * t / (1.001 * DT))),
    "a ramp that begins abruptly": lambda t: 0.3 * max(0.0, t - 0.1033),
    "a ramp that ends abruptly": lambda t: 0.3 * min(t, 0.1033),
    "a ramp within a step": lambda t: SIZE * np.clip((t - 0.1042) / 0.002, 0, 1),
    "a root": lambda t: SIZE * np.sqrt(max(0.0, t - 0.1)),
    "a table": lambda t: float(np.interp(t, [0, 0.1, 0.11, 0.3], [0, 0.01, 0.02, 0.015])),
    "rounding": lambda t: 1e-12 * np.floor(t / DT / 2),
    "nothing": lambda t: 0.0 * t,
}


class CountedFunction:
    """Function that counts its calls and records the latest time."""

    def __init__(self, of):
        self.of, self.count, self.latest = of, 0, 0.0

    def __call__(self, t):
        self.count, self.latest = self.count + 1, max(self.latest, t)
        return self.of(t)


def pulled(function, d=2):
    """Return a body with prescribed displacements of its left end along x; the other components there are zero."""
    mesh = MESHES[d]
    return Scene(System(mesh, material(mesh), fixed={"left": "xyz"[1:d]}, prescribed={"left": {"x": function}}))


@pytest.mark.few
@pytest.mark.parametrize("name", JUMPS)
@pytest.mark.parametrize("integrator", [EnergyMomentum(DT), VelocityVerlet(DT / 4)], ids=lambda one: one.name)
def test_a_support_that_jumps_is_named_once(name, integrator):
    when, size, function = JUMPS[name]
    with pytest.warns(
        StvkWarning, match=r"t = .*: the supports of 3 vertices \(0, 1, 2\) jump by up to .* over 20 steps or more"
    ) as caught:
        pulled(function).run(integrator, 0.2063)
    assert len(caught) == 1 and caught[0].filename.endswith("motions.py")
    words = str(caught[0].message).split()
    reported, by = float(words[2]), float(words[words.index("to") + 1])
    assert when <= reported + 1e-9 and reported - when <= 2e-3 * integrator.dt
    assert by == pytest.approx(size, rel=0.02)


@pytest.mark.parametrize("integrator", [ForwardEuler(DT / 4), LinearBackwardEuler(DT), Newmark(DT)], ids=lambda one: one.name)
def test_jumps_are_reported_by_every_integrator(integrator):
    with pytest.warns(StvkWarning, match="jump by up to 0.02 m"):
        pulled(JUMPS["within a step"][-1], 3).run(integrator, 0.2063)


@pytest.mark.few
@pytest.mark.filterwarnings("ignore:.*inverted:skfem_stvk.errors.StvkWarning")
@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize(
    "integrator", [EnergyMomentum(DT), LinearBackwardEuler(DT), VelocityVerlet(DT / 4)], ids=lambda one: one.name
)
def test_fast_motions_and_kinks_are_no_jumps(name, integrator):
    asked = CountedFunction(MOTIONS[name])
    scene = pulled(asked)
    asked.latest = 0.0
    run = scene.run(integrator, 0.2063)
    assert run.success and asked.latest <= 0.2063


def test_the_search_for_jumps_evaluates_smooth_motions_no_more_often(monkeypatch):
    counts = []
    for looking in (True, False):
        with monkeypatch.context() as patch:
            if not looking:
                patch.setattr(Jumps, "check", lambda self, t, prescribed=None: None)
            asked = CountedFunction(lambda t: SIZE * np.sin(4 * t))
            pulled(asked).run(EnergyMomentum(DT), 1.0)
            counts.append(asked.count)
    assert counts[0] == counts[1]


def test_only_jumping_supports_are_named():
    """The other supports move further over the same step, and start to move in it."""
    mesh, corner = MESHES[3], [int(np.argmax(MESHES[3].p[0]))]
    ends = [("left", lambda x, t: max(0.0, t - 0.1455) * np.ones_like(x)), (corner, {"z": lambda t: 0.003 * (t > 0.1412)})]
    with pytest.warns(StvkWarning, match=rf"1 vertex \({corner[0]}\) jump by up to 0\.003 m"):
        simulate(System(mesh, material(mesh), prescribed=ends), EnergyMomentum(DT), until=0.2, quiet=True)


def test_a_jump_that_makes_all_steps_fail_is_reported():
    with pytest.warns(StvkWarning, match=r"jump by up to 9 m"), pytest.raises(SimulationError):
        pulled(lambda t: 9.0 * (t > 0.104)).run(EnergyMomentum(DT), 0.2)


def test_earlier_speeds_are_recorded_for_each_support():
    """Each search concerns only supports that never moved so fast before, so a jump is found next to an oscillation."""
    scene = driven(2)
    motion = Motion(scene.system, "lumped", None)
    state = MotionState.at(0.0, np.zeros(scene.system.ndofs), np.zeros(scene.system.ndofs))
    jumps, searched = Jumps(motion, state), []
    jumps._search = lambda times, ends, fast: searched.append(fast.tolist())
    still = np.zeros(len(motion.free.fixed))
    there = still.copy()
    there[1] = 0.1
    jumps.check(0.1, there)  # 1 m/s, from rest
    jumps.check(0.2, still)
    there[1] = 0.05
    jumps.check(0.22, there)  # 2.5 m/s
    both = there + 0.02
    jumps.check(0.24, both)
    assert searched == [[1], [1], [i for i in range(len(still)) if i != 1]]


def test_a_run_resumed_after_a_jump_does_not_report_it(tmp_path):
    scene = pulled(JUMPS["within a step"][-1])
    with pytest.warns(StvkWarning, match="jump"):
        scene.run(EnergyMomentum(DT), 0.15, checkpoint=tmp_path / "c")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert simulate(scene.system, checkpoint=tmp_path / "c", resume=True, until=0.2, quiet=True).success
