"""The quick comparison of models holds, and its claims can fail."""

from types import SimpleNamespace

import numpy as np
import pytest

from skfem_stvk import StVK, System
from validation import models
from validation.models import bars, motions, recoveries
from validation.models.models import MODELS, NEO_HOOKEAN, TRUE
from validation.models.studies import at_rest, costs, from_random_starts, in_motion, recovered


@pytest.mark.parametrize("trial", [bars.BENT, bars.TWISTED], ids=lambda trial: trial.name)
def test_every_model_is_compared_at_rest(trial):
    study = at_rest(trial, quick=True)
    assert study.passed, study.failures
    errors = {row[0]: row[1:4] for row in study.rows}
    assert set(errors) == {model.name for model in MODELS}
    same = {name: float(row[0].rstrip("%")) for name, row in errors.items() if row[0] != "-"}
    assert same["StVK"] == 0 and same["neo-Hookean"] < 25 and same["linear"] > 5
    assert same["van-gelder springs"] > 10 and same["StVK + volume"] < 10


def test_the_neo_hookean_reference_by_scikit_fem_agrees_with_this_package():
    """Both codes agree on the same quadratic tetrahedra."""
    truth = bars.true_neo_hookean("bent", 1)
    system = bars.System(bars.bar(1), [*NEO_HOOKEAN.terms(bars.bar(1)), *bars.BENT.loads], {"wall": "xyz"}, degree=2)
    found = bars.solved(bars.BENT, system)
    assert bars.error(found.measured, truth) < 1e-4 and np.abs(truth).max() > 0.1


@pytest.mark.parametrize("motion", [motions.released, motions.thrown], ids=["released", "thrown"])
def test_every_model_is_compared_in_motion(motion):
    study = in_motion(motion.__name__, motion, quick=True)
    assert study.passed, study.failures
    assert {row[0] for row in study.rows} == {model.name for model in MODELS}


def test_a_path_that_ended_early_has_an_infinite_error():
    path = motions.released(TRUE, quick=True)
    lost = path._replace(tip=np.where(np.arange(motions.MOMENTS)[:, None] > 50, np.nan, path.tip))
    assert motions.off(path, path) == 0 and motions.off(lost, path) == np.inf


def test_costs_are_measured_of_every_model():
    study = costs(quick=True)
    assert {row[0] for row in study.rows} == {model.name for model in MODELS} and study.claim == ""
    assert models.NAMES == ("bent", "twisted", "released", "thrown", "recoveries", "random-starts", "costs")


def test_invertible_elements_come_back_from_every_start_and_stvk_does_not():
    study = recovered(quick=True)
    found = dict(zip(study.columns, zip(*study.rows, strict=True), strict=True))
    assert study.passed, study.failures
    assert {"exactly mirrored", "on a line", "at a point"} < set(found["start"])
    for law in recoveries.COME_BACK:
        assert all(one.startswith(("back", "folded")) for one in found[law])
        assert sum(one.startswith("folded") for one in found[law]) < 2
    assert not any("back" in one for one in found["StVK"][:4]) and set(found["neo-Hookean"]) == {"refused"}


@pytest.mark.slow
def test_no_random_start_ends_at_a_saddle_point_and_such_an_end_is_detected(monkeypatch):
    study = from_random_starts(quick=True)
    assert study.passed, study.failures
    assert len(study.rows) == 6 and all(sum(map(int, row[1:])) == recoveries.QUICK_SEEDS for row in study.rows)
    monkeypatch.setattr(recoveries, "_end", lambda system, found: recoveries.SADDLE)
    assert len(from_random_starts(quick=True).failures) == 6


def test_the_outcome_of_a_solve_is_determined_by_forces_and_eigenvalues():
    system = System(recoveries.box(1), StVK(young=1e3, poisson=0.3), {"wall": "xyz"})
    x, free = system.mesh.p.T, system.mesh.p[0] > 0
    mirrored = np.where(free[:, None], -2 * x * [1, 0, 0], 0.0)
    for u, end in (
        (0 * x, recoveries.BACK_AT_REST),
        (0.3 * x * free[:, None], recoveries.NOT_SOLVED),
        (mirrored, recoveries.INVERTED),
    ):
        assert recoveries._end(system, SimpleNamespace(u=u.ravel())) == end
    flat = np.where(free[:, None], -x * [1, 0, 0], 0.0)  # forces along x vanish by symmetry, the others in uniaxial strain
    bar = System(recoveries.box(1), StVK(young=1e3, poisson=0.0), {"wall": "xyz"})
    assert recoveries._end(bar, SimpleNamespace(u=flat.ravel())) == recoveries.SADDLE
