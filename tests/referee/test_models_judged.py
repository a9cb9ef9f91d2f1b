"""The referee judges models that do not claim to be StVK by derivatives, invariance, balance, symmetry and rigid modes."""

import pytest
from bodies import box

from skfem_stvk import Corotated, EdgeNetwork, InvertibleStVK, LinearElastic, NeoHookean, SpringNetwork, StVK, System, verify
from skfem_stvk.referee.results import CheckOutcome

MESH, TERM, MATERIAL = box(2), StVK(young=2.0, poisson=0.3), {"young": 2.0, "poisson": 0.3}
MODELS = {
    "neo-Hookean": NeoHookean(**MATERIAL),
    "corotated": Corotated(**MATERIAL),
    "invertible": InvertibleStVK(**MATERIAL),
    "springs": SpringNetwork(rule="least-squares", **MATERIAL),
    "quartic springs": EdgeNetwork.of(MESH, TERM).diagonal(),
}


def judged(model):
    """Return the results of a candidate that claims only to be an elastic body."""
    report = verify(MESH, TERM, candidate=System(MESH, model), candidate_is_stvk=False, quiet=True)
    return [r for r in report.results if r.subject == "candidate"]


@pytest.mark.parametrize("name", MODELS)
def test_a_model_with_an_energy_passes_without_agreement_with_stvk(name):
    results = judged(MODELS[name])
    passed = {r.check for r in results if r.outcome is CheckOutcome.PASSED}
    failed = [
        (r.check, r.quantity, r.state, r.measured, r.limit, r.reason)
        for r in results
        if r.outcome in (CheckOutcome.FAILED, CheckOutcome.COULD_NOT_RUN)
    ]
    assert failed == [] and {"derivatives", "invariance", "balance", "symmetry", "rigid modes"} <= passed
    assert all(r.outcome is CheckOutcome.NOT_APPLICABLE for r in results if r.check in ("agreement", "closed forms"))


def test_a_linear_body_is_found_to_resist_rotation():
    failed = {(r.check, r.state) for r in judged(LinearElastic(**MATERIAL)) if r.outcome is CheckOutcome.FAILED}
    assert ("invariance", "rotation") in failed and ("balance", "rigid rotation") in failed
    assert not {check for check, _ in failed} & {"derivatives", "symmetry", "rigid modes"}
