"""Candidates that abuse the referee: results are checked, exceptions are caught, and the report is complete."""

import numpy as np
import pytest

from skfem_stvk import verify
from skfem_stvk.referee.implementations import ContractViolation, Implementation
from skfem_stvk.referee.results import CheckOutcome
from validation.hostile import candidates
from validation.hostile.candidates import RIGHT, WRONG, Candidate, attempt, judge

BODY = candidates.body()
U = 0.1 * np.random.default_rng(5).standard_normal(BODY.ndofs)
#: Candidates with wrong values, not just a wrong type or shape: the comparison finds them.
NUMBERS = {
    "energy returns nan",
    "K dense and not finite",
    "K masked",
    "F masked",
    "F masked in one place",
    "every third force is off",
}


def tried(implementation):
    """Return W, F, K and a product with K, or the violation."""
    try:
        return [implementation.W(U), implementation.F(U), implementation.K(U) @ U]
    except ContractViolation as violation:
        return violation


@pytest.mark.few(24)
@pytest.mark.parametrize("name", WRONG)
def test_every_candidate_gives_a_value_or_a_described_violation(name):
    found = tried(Implementation("candidate", WRONG[name](BODY), BODY.ndofs))
    if name in NUMBERS:
        assert isinstance(found, list) and (name == "every third force is off" or not all(map(same, found, tried_right())))
    else:
        assert isinstance(found, ContractViolation) and "candidate." in str(found) and len(str(found)) < 600


def tried_right():
    return tried(Implementation("right", BODY, BODY.ndofs))


def same(one, other):
    return np.array_equal(one, other)


@pytest.mark.parametrize("name", ["columns far outside", "an operator that quits", "methods that raise when looked up", "moods"])
def test_the_report_on_a_hostile_candidate_is_complete_and_not_passed(name, tmp_path):
    judge(attempt(tmp_path, WRONG.get(name, candidates.wrong_every_third_time)), right=False)
    assert (tmp_path / "report" / "report.html").stat().st_size > 10_000


@pytest.mark.parametrize("name", RIGHT)
def test_an_unusual_but_right_candidate_passes(name, tmp_path):
    judge(attempt(tmp_path, RIGHT[name]), right=True)


def test_a_candidate_that_interrupts_leaves_an_interrupted_report():
    """A candidate's own `KeyboardInterrupt` has the effect of Ctrl-C, from which it cannot be distinguished.

    The report keeps its results and does not pass.
    """
    report = verify(
        BODY.mesh,
        young=candidates.YOUNG,
        poisson=candidates.POISSON,
        candidate=Candidate(BODY, tangent=candidates.raising(KeyboardInterrupt())),
        quiet=True,
    )
    assert report.interrupted and not report.passed and report.counts[CheckOutcome.PASSED] > 0


def test_the_referee_keeps_no_array_of_a_candidate():
    """F and K of the referee do not change if the candidate overwrites the arrays that it returned."""
    K = BODY.tangent(U)
    F = BODY.internal_force(U)
    implementation = Implementation(
        "candidate", Candidate(BODY, tangent=lambda body, u: K, internal_force=lambda body, u: F), BODY.ndofs
    )
    returned = implementation.K(U), implementation.F(U)
    before = returned[0].data.copy(), returned[1].copy()
    K.data[:] = F[:] = 0
    assert (
        np.array_equal(returned[0].data, before[0])
        and np.array_equal(returned[1], before[1])
        and before[0].any()
        and before[1].any()
    )
