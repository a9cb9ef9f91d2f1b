"""On hard cases in motion the package is never wrong without a warning, and the judge finds wrong states in any case."""

import csv
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from slow import slow

from skfem_stvk.solvers.dynamics import Status, VelocityVerlet, simulate
from validation.hard import table
from validation.hard.case import made
from validation.hard.judge import Verdict, volume_ratios
from validation.hard.motion import endings, judge, methods, study, verlet
from validation.hard.motion.impacts import UNTIL, _crushed, _dropped, _shaken
from validation.hard.motion.released import _let_go
from validation.hard.motion.stiff import SPIN, THROWN, _between, _rotated, _spun
from validation.hard.tiny_steps import by_scikit_fem

QUICK = study.scenes(quick=True)
QUADRATIC = [scene for scene in study.scenes(quick=False) if "quadratic" in scene.name]
DROPPED, STRETCHED = (scene.body.args[0] for scene in QUADRATIC[:2])
#: Scenes with the most steps.
LONG = (
    "crack a whip",
    "kick a core of 1e9 Pa between ends of 1e2 Pa, in steps of 1/30 s",
    "throw a block of 1e9 Pa that flips, in steps of 1/30 s",
)
SAYS_INSIDE_OUT, SAYS_ENERGY = (
    "; elements were inverted on the way, up to 3 at once",
    "reached t = 1 s in 9 steps; the steps lost 30 % of the energy",
)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "scene",
    [*(slow(scene) if scene.name in LONG else scene for scene in QUICK), *map(slow, QUADRATIC)],
    ids=lambda scene: scene.name,
)
def test_no_integrator_is_wrong_without_a_warning_and_the_plain_one_is(scene, tmp_path):
    row = study.row_of(scene)
    assert not list(study.failures(row))
    assert [run.method for run in row.runs] == list(methods.METHODS)
    assert [run.method for run in row.runs if run.verdict is Verdict.WRONG] == ["plain eq. 9"]
    table.save([row], tmp_path, study.IN_MOTION)
    with (tmp_path / f"{study.IN_MOTION.name}.csv").open(encoding="utf-8") as file:
        assert len(list(csv.reader(file))) == 1 + len(row.runs)


def a_scene(beginning):
    return next(scene for scene in study.scenes(quick=False) if scene.name.startswith(beginning))


@pytest.mark.parametrize("beginning", ["drop a block from 1 m", "stretch a bar"])
def test_an_integrator_that_ignores_inversion_is_detected(monkeypatch, beginning):
    monkeypatch.setitem(methods.METHODS, "eq. 9", methods.METHODS["plain eq. 9"])
    scene = replace(a_scene(beginning), methods=("eq. 9",))
    assert [failure for failure in study.failures(study.row_of(scene)) if "eq. 9: reported as success" in failure]


@pytest.mark.slow
def test_an_integrator_that_loses_energy_without_a_warning_is_detected(monkeypatch):
    monkeypatch.setattr("skfem_stvk.solvers.dynamics.loop.REPORTED", np.inf)
    scene = a_scene("crack a whip")
    assert methods.run(scene, "backward Euler").verdict is Verdict.WRONG


@pytest.mark.slow
def test_a_required_method_that_is_not_right_is_detected(monkeypatch):
    monkeypatch.setitem(methods.METHODS, "energy-momentum", methods.METHODS["backward Euler"])
    scene = replace(a_scene("crush a block by 25 %"), methods=("energy-momentum",))
    assert [failure for failure in study.failures(study.row_of(scene)) if "a right motion exists" in failure]


@pytest.fixture(scope="module")
def landing():
    make = partial(_dropped, 2.0)
    motion = verlet.followed(make, True, UNTIL, 500)
    return make().system(volume=True), motion, endings.tiny_steps(make, UNTIL, 500, volume=True)


def test_the_motion_itself_is_right(landing):
    system, motion, ending = landing
    assert judge.judged(system, motion.u, motion.v, True, "", ending).verdict is Verdict.RIGHT


@pytest.mark.parametrize(
    ("change", "why", "admission"),
    [
        (lambda u, v: (u + 0.03, v), "off by", SAYS_ENERGY),
        (lambda u, v: (u, 2 * v), "energy", SAYS_ENERGY),
        (lambda u, v: (u * np.nan, v), "not finite", None),
    ],
    ids=["elsewhere", "too fast", "not finite"],
)
def test_another_state_is_wrong_unless_the_method_reports_it(landing, change, why, admission):
    system, motion, ending = landing
    u, v = change(motion.u, motion.v)
    found = judge.judged(system, u, v, True, "reached t = 0.5 s", ending)
    assert found.verdict is Verdict.WRONG and why in found.why
    if admission is not None:
        assert judge.judged(system, u, v, True, admission, ending).verdict is Verdict.REPORTED
    else:
        assert judge.judged(system, u, v, True, SAYS_ENERGY + SAYS_INSIDE_OUT, ending).verdict is Verdict.WRONG


def test_inverted_elements_at_the_end_are_wrong_whatever_the_message(landing):
    system, motion, ending = landing
    mirrored = (-2 * system.mesh.p * [[1], [0], [0]]).ravel("F")
    assert judge.judged(system, mirrored, motion.v, True, SAYS_ENERGY, ending).verdict is Verdict.WRONG
    assert judge.judged(system, mirrored, motion.v, True, SAYS_INSIDE_OUT, ending).verdict is Verdict.WRONG
    assert judge.judged(system, mirrored, motion.v, False, "", ending).verdict is Verdict.REPORTED


def test_no_method_reports_success_for_a_block_inverted_by_shaking():
    scene = a_scene("shake")
    row = study.row_of(scene)
    assert not list(study.failures(row))
    ends = {run.method: run.status for run in row.runs if run.verdict is Verdict.REPORTED}
    assert set(ends) == set(scene.methods) - {"plain eq. 9"}
    assert ends["forward Euler, dt=None"] == ends["eq. 9"] == "reached the end, but with inverted elements"


@pytest.mark.slow
def test_a_reported_success_with_inverted_elements_is_detected(monkeypatch):
    monkeypatch.setattr(
        "skfem_stvk.solvers.newton.outcome.Status.success", property(lambda self: self in (Status.FINISHED, Status.ENDED_INVERTED))
    )
    scene = replace(a_scene("stretch a bar"), methods=("forward Euler",))
    assert [failure for failure in study.failures(study.row_of(scene)) if "reported as success, but 1" in failure]


def test_a_reported_success_is_wrong_if_there_is_no_right_motion(landing):
    system, motion, _ = landing
    assert judge.judged(system, motion.u, motion.v, True, "", endings.none(0.1)).why == "no right motion"


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("make", "inverted"),
    [
        (partial(_dropped, 2.0), 0.16),
        (partial(_dropped, 4.43), 0.06),
        (partial(_crushed, 0.6), 0.13),
        (_shaken, 0.062),
        (partial(_let_go, 3.0, 3, (1.3, 0.9, 0.9)), 0.29),
        (partial(_let_go, 1.0, 4, (1.2, 1.2, 0.6)), 0.21),
    ],
    ids=["dropped from 0.2 m", "dropped from 1 m", "crushed", "shaken", "stretched", "pressed flat"],
)
def test_elements_invert_at_the_times_in_the_table(make, inverted):
    assert verlet.followed(make, False, 0.3, 600).inverted == pytest.approx(inverted, abs=0.006)


def test_quadratic_elements_invert_at_the_times_in_the_table():
    assert verlet.followed(STRETCHED, False, 0.3, 2400, 2).inverted == pytest.approx(0.24, abs=0.006)
    assert verlet.followed(DROPPED, False, UNTIL, 2000, 2).inverted == np.inf


@pytest.mark.slow
@pytest.mark.parametrize(("make", "volume"), [(DROPPED, False), (DROPPED, True), (STRETCHED, True)])
def test_tiny_steps_of_quadratic_elements_are_small_enough(make, volume):
    """With half of the steps, the change is far below the limit of the judge."""
    motion, half = (verlet.followed(make, volume, UNTIL, steps, 2) for steps in (2000, 1000))
    assert 0 < np.sqrt(((motion.u - half.u) ** 2).mean()) < 0.1 * endings.LIMIT * motion.size


def test_reference_forces_of_quadratic_elements_equal_those_of_scikit_fem():
    body, motion = made(DROPPED, 2), verlet.followed(DROPPED, False, UNTIL, 2000, 2)
    right = by_scikit_fem(body)[0](motion.u)
    np.testing.assert_allclose(verlet.elasticity(body, False).force(motion.u), right, atol=1e-11 * np.abs(right).max())


def test_the_reference_agrees_with_the_package_for_weight_supports_and_velocities():
    """With weight, moving supports and initial velocities, the same scheme in the same steps agrees; the forces are independent."""
    for make in (partial(_dropped, 2.0), partial(_crushed, 0.25)):
        body = make()
        run = simulate(body.system(volume=False), VelocityVerlet(dt=1e-3), until=0.05, v0=body.v0, quiet=True)
        motion = verlet.followed(make, False, 0.05, 50)
        np.testing.assert_allclose(motion.u, run.u, atol=1e-5 * motion.size)
        assert motion.energy == pytest.approx(run.ledger["total_energy"][-1], rel=1e-2)


@pytest.mark.slow
def test_tiny_steps_are_small_enough():
    """With half of the steps, the change is far below the limit of the judge."""
    for scene in QUICK:
        if (
            not scene.with_volume.source.endswith("own forces") or scene.name == "crack a whip"
        ):  # half as many steps are above the critical step
            continue
        steps = int(scene.with_volume.source.split()[0])
        motion = verlet.followed(scene.body, True, scene.until, steps)
        for part in (steps // 2, steps):
            error = endings.tiny_steps(scene.body, scene.until, part, volume=True).error(scene.body().system(True), motion.u)
            assert error < 0.1 * endings.LIMIT and (error == 0) == (part == steps)


@pytest.mark.slow
def test_a_core_of_1e5_pa_is_as_rigid_as_one_of_1e4_pa():
    """A core of 1e5 Pa may therefore replace one of 1e9 Pa in the reference."""
    bodies = [verlet.followed(partial(_between, young), True, 1.0, 1000) for young in (1e5, 1e4)]
    assert np.abs(bodies[0].u - bodies[1].u).max() < 0.05 * np.abs(bodies[0].u).max()


def test_the_thrown_block_flips():
    """The motion is rigid, and its end differs much from a steady rotation about one axis."""
    system = _spun().system(volume=False)
    u = _rotated(system)
    assert volume_ratios(system, u) == pytest.approx(1, abs=1e-9)
    along = np.argmax(system.mesh.p[1])  # vertex near the axis of the spin
    assert SPIN[1] > 10 * SPIN[0] and SPIN[1] * THROWN > np.pi
    assert (system.mesh.p[1] + u[1::3])[along] < 0
