"""The referee judges candidates of all kinds: partial, dense, operators, broken, of another law."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from bodies import MESHES, box
from scipy.sparse import csr_array, csr_matrix
from scipy.sparse.linalg import LinearOperator

from skfem_stvk import NeoHookean, StVK, StvkError, System, verify
from skfem_stvk.mesh.geometry import Geometry
from skfem_stvk.referee.faults import FAULTS
from skfem_stvk.referee.judgement import worst_locations
from skfem_stvk.referee.results import CheckOutcome

MESH = box(3)
TERM = StVK(young=2.0, poisson=0.3)
BODY = System(MESH, TERM)


class Array:
    """Array of another package, which NumPy reads by `__array__`."""

    def __init__(self, values):
        self.values = values

    def __array__(self, dtype=None, copy=None):
        return np.array(self.values, dtype=dtype)


def outcomes(report, check, quantity):
    return {r.outcome for r in report.results if r.subject == "candidate" and (r.check, r.quantity) == (check, quantity)}


def test_a_candidate_with_only_F_gets_the_checks_of_F():
    report = verify(MESH, TERM, candidate=SimpleNamespace(internal_force=BODY.internal_force), quiet=True)
    assert report.passed
    assert outcomes(report, "agreement", "F") == {CheckOutcome.PASSED}
    assert outcomes(report, "agreement", "K") == outcomes(report, "derivatives", "F") == {CheckOutcome.NOT_APPLICABLE}
    assert any("candidate has no tangent(u)" in r.reason for r in report.results)


@pytest.mark.few
@pytest.mark.parametrize(
    "convert",
    [
        lambda K: K.toarray(),
        lambda K: K.todense(),
        lambda K: K.toarray().tolist(),
        lambda K: Array(K.toarray()),
        lambda K: K.tocoo(),
        csr_array,
        lambda K: LinearOperator(K.shape, matvec=lambda v: K @ v, dtype=float),
    ],
    ids=["dense", "matrix", "lists", "__array__", "coo", "array", "operator"],
)
def test_K_may_be_dense_sparse_or_an_operator(convert):
    good = SimpleNamespace(tangent=lambda u: convert(BODY.tangent(u)))
    bad = SimpleNamespace(tangent=lambda u: convert(FAULTS["one wrong sign"].make(MESH, [TERM]).tangent(u)))
    assert verify(MESH, TERM, candidate=good, quiet=True).passed
    failures = verify(MESH, TERM, candidate=bad, quiet=True).failures("candidate")
    assert {r.worst["suspects"][0] for r in failures if r.check == "agreement"} == {MESH.nt // 2}


@pytest.mark.few
@pytest.mark.parametrize(
    ("methods", "outcome", "words"),
    [
        (
            {"internal_force": lambda u: np.zeros(3)},
            CheckOutcome.COULD_NOT_RUN,
            r"internal_force\(u\) returned shape \(3,\); expected",
        ),
        ({"internal_force": lambda u: 1 / 0}, CheckOutcome.COULD_NOT_RUN, r"raised ZeroDivisionError"),
        ({"energy": lambda u: [1.0, 2.0]}, CheckOutcome.COULD_NOT_RUN, r"energy\(u\) returned shape \(2,\)"),
        ({"tangent": lambda u: np.eye(3)}, CheckOutcome.COULD_NOT_RUN, r"tangent\(u\) returned ndarray of shape \(3, 3\)"),
        ({"tangent": lambda u: Array(["K"])}, CheckOutcome.COULD_NOT_RUN, r"returned Array of shape \(1,\); expected a dense"),
        ({"energy": lambda u: "abc"}, CheckOutcome.COULD_NOT_RUN, r"energy\(u\) returned a str of <U3; expected real numbers"),
        ({"energy": lambda u: 1 + 1j}, CheckOutcome.COULD_NOT_RUN, r"returned a complex of complex128"),
        ({"internal_force": lambda u: [[1.0], [1.0, 2.0]]}, CheckOutcome.COULD_NOT_RUN, "returned a list; expected real numbers"),
        ({"internal_force": lambda u: csr_matrix(BODY.internal_force(u))}, CheckOutcome.COULD_NOT_RUN, "returned a csr_matrix"),
        ({"tangent": lambda u: BODY.tangent(u) * (1 + 1j)}, CheckOutcome.COULD_NOT_RUN, "returned a matrix of complex128"),
        ({"internal_force": lambda u: np.full(u.size, np.nan)}, CheckOutcome.FAILED, ""),
        ({"energy": lambda u: float("nan")}, CheckOutcome.FAILED, ""),
        ({"tangent": lambda u: BODY.tangent(u) * np.nan}, CheckOutcome.FAILED, ""),
    ],
)
def test_a_broken_candidate_is_never_a_pass_nor_an_exception(methods, outcome, words):
    report = verify(MESH, TERM, candidate=SimpleNamespace(**methods), quiet=True)
    assert not report.passed
    agreement = [r for r in report.results if r.check == "agreement" and r.subject == "candidate" and r.outcome is outcome]
    assert agreement and all(re.search(words, r.reason) for r in agreement)
    assert all(r.outcome is CheckOutcome.PASSED for r in report.results if r.subject == "skfem-stvk")


def test_a_candidate_without_any_method_is_an_error():
    with pytest.raises(StvkError, match="of type int, has none of energy, internal_force, tangent"):
        verify(MESH, TERM, candidate=3)


def test_a_class_that_needs_more_than_the_mesh_is_an_error_that_says_what_to_pass():
    class Loop:
        def __init__(self, mesh, young):
            self.mesh, self.young = mesh, young

    with pytest.raises(StvkError, match=r"missing 1 required .* Pass an object with energy, .* from the mesh alone"):
        verify(MESH, TERM, candidate=Loop)


LAW = NeoHookean(young=2.6, poisson=0.3)


def test_another_law_gets_a_taylor_test_and_no_comparison():
    report = verify(MESH, TERM, candidate=System(MESH, LAW), candidate_is_stvk=False, quiet=True)
    assert report.passed, str(report)
    assert outcomes(report, "agreement", "F") == outcomes(report, "closed forms", "P") == {CheckOutcome.NOT_APPLICABLE}
    taylor = [
        r for r in report.results if r.check == "derivatives" and r.subject == "candidate" and r.outcome is CheckOutcome.PASSED
    ]
    assert len(taylor) == 12 and all("order" in r.scale and r.reason.startswith("Taylor test") for r in taylor)
    assert "Taylor test" in str(report.to_dict())


@pytest.mark.parametrize("degrees", [20, 100, 125, 160])
def test_another_law_that_is_not_objective_beyond_an_angle_is_caught(degrees):
    """The energy is larger by a millionth if the mean deformation gradient, mostly a rotation, has a small trace."""

    geometry = Geometry(MESH.p, MESH.t)

    class Turning(System):
        def energy(self, u):
            gradient = np.einsum("e,eai,eaj->ij", geometry.volume, u.reshape(-1, 3)[MESH.t.T], geometry.gradients)
            left, _, right = np.linalg.svd(np.eye(3) + gradient / geometry.volume.sum())
            return super().energy(u) * (1 + 1e-6 * (np.trace(left @ right) < 1 + 2 * np.cos(np.deg2rad(degrees))))

    report = verify(MESH, TERM, candidate=Turning(MESH, LAW), candidate_is_stvk=False, quiet=True)
    assert ("invariance", "W") in {(r.check, r.quantity) for r in report.failures("candidate")}, str(report)


def test_the_taylor_test_catches_a_wrong_tangent_of_another_law():
    body = System(MESH, LAW)
    wrong = SimpleNamespace(energy=body.energy, internal_force=body.internal_force, tangent=lambda u: 1.001 * body.tangent(u))
    report = verify(MESH, TERM, candidate=wrong, candidate_is_stvk=False, quiet=True)
    assert {(r.check, r.quantity) for r in report.failures("candidate")} == {("derivatives", "K")}


def test_another_law_passed_off_as_stvk_is_caught():
    report = verify(MESH, TERM, candidate=System(MESH, LAW), quiet=True)
    assert "agreement" in {r.check for r in report.failures("candidate")}


@pytest.mark.few
@pytest.mark.parametrize("name", MESHES)
def test_candidates_on_every_kind_of_simplex(name):
    mesh, term = MESHES[name], StVK(young=2.0, poisson=0.3)
    report = verify(mesh, term, candidate=System(mesh, term), quiet=True)
    assert report.passed, str(report)
    wrong = verify(mesh, term, candidate=System(mesh, StVK(young=2.02, poisson=0.3)), quiet=True)
    assert {r.quantity for r in wrong.failures("candidate") if r.check == "agreement"} == {"W", "F", "K"}


def test_an_operator_that_is_not_symmetric_is_caught():
    wrong = FAULTS["skew K"].make(MESH, [TERM])
    operator = SimpleNamespace(
        tangent=lambda u: LinearOperator((MESH.p.size,) * 2, matvec=lambda v: wrong.tangent(u) @ v, dtype=float)
    )
    failed = {r.check for r in verify(MESH, TERM, candidate=operator, quiet=True).failures("candidate")}
    assert {"agreement", "symmetry"} <= failed


def test_a_large_operator_is_checked_for_zero_modes_on_a_piece():
    mesh = box(6)
    body = System(mesh, TERM)
    operator = SimpleNamespace(
        tangent=lambda u: LinearOperator((mesh.p.size,) * 2, matvec=lambda v: body.tangent(u) @ v, dtype=float)
    )
    report = verify(mesh, TERM, candidate=operator, quiet=True)
    (result,) = [r for r in report.results if r.check == "no further zero mode" and r.subject == "candidate"]
    assert result.outcome is CheckOutcome.PASSED and "all others constrained" in result.scale


@pytest.mark.parametrize("factor", [1e-15, 1e6])
def test_another_law_is_judged_on_its_own_scale(factor):
    class Scaled(System):
        def energy(self, u):
            return factor * super().energy(u)

        def internal_force(self, u):
            return factor * super().internal_force(u)

        def tangent(self, u):
            return factor * super().tangent(u)

    assert verify(MESH, TERM, candidate=Scaled(MESH, LAW), candidate_is_stvk=False, quiet=True).passed
    linear = FAULTS["linear strain"].make(MESH, StVK(young=factor, poisson=0.3))
    failed = {(r.check, r.quantity) for r in verify(MESH, TERM, candidate=linear, candidate_is_stvk=False, quiet=True).failures()}
    assert {("invariance", "W"), ("invariance", "F"), ("invariance", "K"), ("balance", "sum of torques")} <= failed


@pytest.mark.parametrize("is_stvk", [True, False])
def test_zero_W_and_F_do_not_pass(is_stvk):
    nothing = SimpleNamespace(energy=lambda u: 0.0, internal_force=lambda u: 0 * u)
    report = verify(MESH, TERM, candidate=nothing, candidate_is_stvk=is_stvk, quiet=True)
    assert not report.passed
    assert {"derivatives"} <= {r.check for r in report.results if r.subject == "candidate" and r.outcome is not CheckOutcome.PASSED}


def test_a_derivative_hidden_by_round_off_does_not_pass():
    hidden = SimpleNamespace(energy=lambda u: 1e14 + BODY.energy(u), internal_force=lambda u: 2 * BODY.internal_force(u))
    report = verify(MESH, TERM, candidate=hidden, candidate_is_stvk=False, quiet=True)
    assert not report.passed
    assert any("round-off hides the derivative" in r.reason for r in report.results if r.outcome is CheckOutcome.COULD_NOT_RUN)


def test_the_worst_location_has_the_largest_error():
    error = np.zeros(MESH.p.size)
    error[17], error[3] = 1.0, 0.5
    location = worst_locations(MESH, error, 0.7)
    assert (location["dof"], location["node"], location["component"], location["nodes_off"]) == (17, 5, "z", 1)
    assert all(5 in MESH.t[:, element] for element in location["elements"]) and location["elements_off"] == 0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda mesh: None, "returned None; expected an object"),
        (lambda mesh: 1 / 0, "raised ZeroDivisionError"),
        (lambda mesh: exec("raise SystemExit(3)"), "raised SystemExit"),
    ],
)
def test_functions_that_return_no_candidate_are_refused(make, words):
    """A function of the mesh that returns no candidate is refused, and not mistaken for the absence of a candidate."""
    with pytest.raises(StvkError, match=words):
        verify(box(1), young=2.0, poisson=0.3, candidate=make, quiet=True)
