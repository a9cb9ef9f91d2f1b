"""On hard cases the package is never wrong without a warning, and the judge finds wrong states whatever the method reports."""

import csv
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from slow import slow

from skfem_stvk import InvertibleStVK, System
from skfem_stvk.solvers.newton import stability
from skfem_stvk.solvers.statics import solve
from validation import hard
from validation.hard import crushed, deformed, judge, meshes, methods, scales, study, table, truths, unstable
from validation.hard.case import Case
from validation.hard.judge import Verdict
from validation.hard.tiny_steps import NoPathError
from validation.meshes import dihedral_angles, signed_volumes

#: Cases of the quick table that take a second or more with all methods of the package.
TAKES_ITS_TIME = (
    "compress a held block by",
    "twist a bar of 10",
    "shear a stiff core",
    "shear by 200 %",
    "bend a bar, 1000",
    "shear a mesh graded",
)
QUICK = study.cases(hard.NAMES, quick=True)
#: Slow cases, except for slender bodies, which only differ in the solver.
LONG = [case for case in study.cases([name for name in hard.NAMES if name != "slender"], quick=False) if not case.quick]


@pytest.mark.few
@pytest.mark.parametrize(
    "case",
    [*(slow(case) if case.name.startswith(TAKES_ITS_TIME) else case for case in QUICK), *map(slow, LONG)],
    ids=lambda case: case.name,
)
def test_the_default_is_right_or_says_why_not(case):
    """Only the methods of the package run; nothing is claimed about the others."""
    ours = tuple(name for name in case.methods or methods.METHODS if name in methods.OURS)
    row = study.row_of(replace(case, methods=ours))
    assert ours and [run.method for run in row.runs] == list(ours) and not list(study.failures(row))


def test_few_cases_take_long():
    assert 4 <= len(LONG) < 0.2 * len(QUICK)


def test_plain_newton_is_wrong_in_some_cases_and_the_table_says_so(tmp_path):
    made = [study.row_of(a_case(name)) for name in ("compress a held block by 20 % in one step", "stretch by 300 %, sides free")]
    assert all([run.method for run in row.runs] == list(methods.METHODS) for row in made)
    wrong = [run for row in made for run in row.runs if run.verdict is Verdict.WRONG]
    assert {"plain Newton", "Newton, clamped"} <= {run.method for run in wrong}
    table.save(made, tmp_path)
    with (tmp_path / "hard-cases.csv").open(encoding="utf-8") as file:
        assert len(list(csv.reader(file))) == 1 + sum(len(row.runs) for row in made)


def a_case(beginning):
    return next(case for case in study.cases(hard.NAMES, quick=False) if case.name.startswith(beginning))


@pytest.mark.parametrize("name", ["compress a held block by 20 % in one step", "press with 1e9"])
def test_a_default_that_ignores_inversion_is_detected(monkeypatch, name):
    """A default that checks only the residual, like plain Newton, fails the claims."""
    monkeypatch.setitem(methods.METHODS, "default", methods.METHODS["plain Newton"])
    failures = list(study.failures(study.row_of(a_case(name))))
    assert any("default: reported as success" in failure and "inside out" in failure for failure in failures)


def test_the_judge_finds_inverted_elements_without_the_package(monkeypatch):
    monkeypatch.setattr(System, "inside_out", lambda self, u: np.empty(0, dtype=np.int64))
    monkeypatch.setattr(System, "smallest_volume_ratio", lambda self, u: 1.0)
    system = crushed.block(0.2, 0.3, n=2).system(volume=False)
    mirrored = (-2 * system.mesh.p * [[1], [0], [0]]).ravel("F")
    assert any("inside out" in fault for fault in judge.faults_of(system, mirrored, 1e-6))


def test_invertible_bodies_have_right_outcomes_of_their_own():
    """From a flat start, only invertible bodies give the right state.

    For a bar twisted too far for StVK, only they have a right state.
    """
    runs = {run.method: run.verdict for run in study.row_of(a_case("start from a flattened body")).runs}
    assert runs["default"] is Verdict.REPORTED and runs["default, invertible"] is Verdict.RIGHT
    case = a_case("twist a bar of 5 x 1 x 1 by 360°")
    assert isinstance(case.of_invertible().body().system(volume=False).terms[0], InvertibleStVK)
    run = methods.run(replace(case, invertible=None), "default, invertible")
    assert run.verdict is Verdict.WRONG and run.judgement.why == "there is no right state"


@pytest.mark.parametrize("name", ["shear by 200 % between plates", "shear a mesh graded"])
def test_the_state_of_stvk_is_not_taken_for_that_of_invertible_bodies(name):
    run = methods.run(replace(a_case(name), invertible=None), "default, invertible")
    assert run.verdict is Verdict.WRONG and "another state" in run.judgement.why


def test_flat_elements_are_no_success():
    system = crushed.block(0.2, 0.3, n=2).system(volume=False)
    flat = (-(1 - 1e-12) * system.mesh.p * [[1], [0], [0]]).ravel("F")
    assert any("flat" in fault for fault in judge.faults_of(system, flat, 1e-6))


@pytest.mark.slow
def test_a_default_without_an_explanation_is_detected(monkeypatch):
    """A default that ends early without the required words fails the claims."""

    def silent(case):
        return methods.Answer(np.zeros(3 * case.body().mesh.nv), False, 0, 0, "stopped", "Sorry.")

    monkeypatch.setitem(methods.METHODS, "default", methods.Method(silent, volume=False))
    loose = next(case for case in unstable.unstable() if "node" in case.name)
    assert any("not said" in failure for failure in study.failures(study.row_of(loose)))


def test_a_stable_state_other_than_the_right_one_is_wrong():
    body = scales.scales()[0].body()
    system = body.system(volume=False)
    right = truths.state("the body at rest", lambda system: np.ones(system.ndofs))
    run = methods.run(Case("bent", scales.scales()[0].body, 4, right, right), "plain Newton")
    assert run.verdict is Verdict.WRONG and "another state" in run.judgement.why
    assert len(run.u) == system.ndofs


def test_a_reported_success_is_wrong_if_there_is_no_right_state():
    nothing = truths.none("no state carries this load")
    run = methods.run(Case("bent", scales.scales()[0].body, 4, nothing, nothing), "default")
    assert run.verdict is Verdict.WRONG and run.judgement.why == "there is no right state"


@pytest.mark.parametrize("dense", [0, 1000], ids=["pivots", "eigenvalues"])
@pytest.mark.parametrize("shift", [80.0, 12.0])
def test_negative_eigenvalues_are_counted(monkeypatch, dense, shift):
    A = np.random.default_rng(0).standard_normal((40, 40))
    K = A + A.T + shift * np.eye(40)
    count = int((np.linalg.eigvalsh(K) <= 0).sum())
    assert (np.diag(K) > 0).all() and (count > 0) == (shift < 80)
    monkeypatch.setattr(judge, "DENSE", dense)
    assert judge.not_positive(csr_matrix(K)) == count


def test_real_eigenvalues_of_a_matrix_that_is_not_symmetric_are_counted():
    """Two complex eigenvalues with a negative real part do not count, because they do not indicate divergence."""
    D = np.diag([-1.0, 2.0, 3.0, 0.0, 0.0])
    D[3:, 3:] = [[-0.1, 1.0], [-1.0, -0.1]]
    Q = np.random.default_rng(3).standard_normal((5, 5))
    K = Q @ D @ np.linalg.inv(Q)
    assert judge.real_not_positive(K) == 1 and judge.real_not_positive(K + 1.5 * np.eye(5)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["press a column whose head is held", "press an arch"])
def test_a_default_that_assumes_stability_is_detected(monkeypatch, name):
    monkeypatch.setattr(solve, "stability_of", lambda problem, u, t: stability.Verdict(True, None))
    failures = list(study.failures(study.row_of(a_case(name))))
    assert any("default: reported as success, but unstable, 1 eigenvalues" in failure for failure in failures)


def test_a_mechanism_is_not_stable():
    loose = next(case for case in unstable.unstable() if "edge" in case.name)
    system = loose.body().system(volume=False)
    u = np.zeros(system.ndofs)
    assert any("unstable" in fault for fault in judge.faults_of(system, u, 1e-6))


def test_displacements_out_of_equilibrium_are_wrong():
    system = crushed.block(0.05, 0.3, n=2).system(volume=False)
    u = np.zeros(system.ndofs)
    u[system.supports.held] = system.supports.values(1.0)
    assert any("not in equilibrium" in fault for fault in judge.faults_of(system, u, 1e-6))


def test_the_clamped_block_has_the_known_energy():
    """The energy is 1726.8 with J >= 0.78; the mirrored state of plain Newton has less."""
    make = a_case("compress a held block by 20 % in one step").body
    u = truths.followed(make, False, 10)
    system = make().system(volume=False)
    assert system.energy(u) == pytest.approx(1726.8, abs=0.05) and judge.volume_ratios(system, u).min() == pytest.approx(
        0.784, abs=1e-3
    )


@pytest.mark.parametrize(
    ("make", "steps", "end"),
    [slow(partial(crushed.block, 0.4, 0.3), 16, 0.315 / 0.4), (partial(deformed._twisted, 5.0, 360), 40, 242 / 360)],
    ids=["block", "bar"],
)
def test_branches_end_where_the_table_says(make, steps, end):
    with pytest.raises(NoPathError) as caught:
        truths.followed(make, False, steps)
    assert float(str(caught.value).split("= ")[1].rstrip(".")) == pytest.approx(end, rel=0.003)


def test_bad_meshes_have_the_stated_flaws():
    slivers = meshes.with_slivers(meshes.bar(3.0, 4), 1.0)
    angles = dihedral_angles(slivers)
    assert angles.min() == pytest.approx(1.0, rel=1e-9)
    x = meshes.graded().p.T[meshes.graded().t.T]
    graded = np.linalg.norm(x[:, :, None] - x[:, None], axis=3).max(axis=(1, 2))  # longest edge of each element
    assert graded.max() > 1e4 * graded.min()
    for mesh in (slivers, meshes.graded(), meshes.bar()):
        volumes = signed_volumes(mesh)
        assert (volumes > 0).any() and (volumes < 0).any()
        assert np.abs(volumes).sum() == pytest.approx(np.prod(np.ptp(mesh.p, axis=1)), rel=1e-12)
