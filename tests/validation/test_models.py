"""The quick comparison of models holds, and its claims can fail."""

import numpy as np
import pytest

from validation import models
from validation.models import bars, motions
from validation.models.models import MODELS, NEO_HOOKEAN, TRUE
from validation.models.studies import at_rest, costs, in_motion


@pytest.mark.few(1)
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


@pytest.mark.slow
def test_costs_are_measured_of_every_model():
    study = costs(quick=True)
    assert {row[0] for row in study.rows} == {model.name for model in MODELS} and study.claim == ""
    assert models.NAMES == ("bent", "twisted", "released", "thrown", "costs")
