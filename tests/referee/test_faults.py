"""Reports on planted faults name the failed check, the state and the location."""

import numpy as np
import pytest
from bodies import MESHES, box

from skfem_stvk import ElementMesh, StVK, StvkError, System, embedded_mesh, verify
from skfem_stvk.referee.faults import FAULTS
from skfem_stvk.referee.results import CheckOutcome

MESH = box(3)
TERM = StVK(young=2.0, poisson=0.3)


def checked(candidate, mesh=MESH, **options):
    return verify(mesh, TERM, candidate=candidate, quiet=True, **options)


@pytest.mark.parametrize("name", ["twice lambda", "no geometric term", "linear strain", "one wrong sign"])
def test_the_report_names_check_quantity_state_and_location(name):
    report = checked(FAULTS[name].make(MESH, [TERM]))
    text = str(report)
    assert "NOT PASSED" in text and "failed agreement, K of candidate against scikit-fem" in text.replace("\n", " ")
    failures = [r for r in report.failures("candidate") if r.check == "agreement" and r.quantity == "K"]
    assert failures and all("node" in r.worst and r.state and r.scale and r.reason for r in failures)


def test_a_single_wrong_sign_in_one_tetrahedron_is_found_in_that_tetrahedron():
    report = checked(FAULTS["one wrong sign"].make(MESH, [TERM]))
    locations = [r.worst for r in report.failures("candidate") if r.check == "agreement" and r.quantity in "FK"]
    assert locations
    for location in locations:
        assert location["elements_off"] == 1 and location["suspects"] == [MESH.nt // 2] and location["nodes_off"] == 4
    assert f"all nodes of 1 element: {MESH.nt // 2}" in " ".join(str(report).split())


@pytest.mark.slow
def test_a_single_wrong_sign_is_caught_on_the_embedded_mesh():
    mesh = ElementMesh(embedded_mesh().p, embedded_mesh().t)
    report = checked(FAULTS["one wrong sign"].make(mesh, [TERM]), mesh)
    assert {r.worst["suspects"][0] for r in report.failures("candidate") if r.check == "agreement" and r.quantity == "K"} == {
        mesh.nt // 2
    }


def test_twice_lambda_cannot_be_seen_at_nu_zero():
    """At nu = 0 a doubled lambda passes, which is why the checks require nu != 0."""
    term = StVK(young=2.0, poisson=0.0)
    assert verify(MESH, term, candidate=FAULTS["twice lambda"].make(MESH, [term]), quiet=True).passed


def test_without_the_geometric_term_K_is_right_at_rest_only():
    report = checked(FAULTS["no geometric term"].make(MESH, [TERM]))
    states = {
        r.state
        for r in report.results
        if r.check == "agreement" and r.quantity == "K" and r.subject == "candidate" and r.outcome is CheckOutcome.PASSED
    }
    assert states == {"rest", "rigid rotation"}


def test_an_error_of_single_precision_in_W_only_is_caught():
    class Rounded(System):
        def energy(self, u):
            return float(np.float32(super().energy(u)))

    failed = checked(Rounded(MESH, TERM)).failures("candidate")
    assert {"agreement", "derivatives"} <= {r.check for r in failed}
    assert {r.quantity for r in failed if r.check == "agreement"} == {"W"}


@pytest.mark.parametrize("name", ["twice lambda", "half mu", "no pairs", "no opposite pairs", "one wrong sign"])
def test_a_fault_of_tetrahedra_refuses_triangles(name):
    with pytest.raises(StvkError, match="This fault is for isotropic tetrahedra; got triangles in 2D of Isotropic"):
        FAULTS[name].make(MESHES["triangles"], [TERM])


def test_twice_lambda_is_off_in_every_closed_form():
    failed = checked(FAULTS["twice lambda"].make(MESH, [TERM])).failures("candidate")
    states = {"uniaxial strain", "uniaxial stress", "equibiaxial", "hydrostatic", "simple shear"}
    assert {r.state for r in failed if r.check == "closed forms" and r.quantity == "P"} == states
    (pressure,) = [r.measured for r in failed if r.state == "hydrostatic" and r.quantity == "P"]
    assert pressure == pytest.approx(3 * 0.3 / (1 + 0.3), rel=1e-9)  # lam/K: relative change of the bulk modulus


def test_an_energy_that_depends_on_the_location_fails_under_translation():
    failed = checked(FAULTS["energy of position"].make(MESH, [TERM])).failures("candidate")
    assert {r.state for r in failed if r.check == "invariance"} == {"translation", "rotation", "reflection"}


def test_an_energy_of_the_signed_volume_fails_only_under_reflection():
    """An energy with the signed volume fails under reflection only, because only a reflection changes the sign."""

    class SignedVolumeEnergy:
        def energy(self, u):
            x = (MESH.p.T + u.reshape(-1, 3))[ORIENTED.T]
            return System(MESH, TERM).energy(u) + 0.1 * np.linalg.det(x[:, 1:] - x[:, :1]).sum()

    rest = MESH.p.T[MESH.t.T]
    ORIENTED = MESH.t.copy()
    negative = np.linalg.det(rest[:, 1:] - rest[:, :1]) < 0
    ORIENTED[:2, negative] = ORIENTED[1::-1, negative]
    failed = checked(SignedVolumeEnergy()).failures("candidate")
    assert {r.state for r in failed if r.check == "invariance"} == {"reflection"}


def test_the_worst_entry_of_K_is_named():
    class OneEntry:
        def tangent(self, u):
            K = System(MESH, TERM).tangent(u).tolil()
            K[30, 33] += 1.0
            return K.tocsr()

    worst = [r.worst for r in checked(OneEntry()).failures("candidate") if r.check == "agreement"]
    assert worst and all(location["entry"] == [30, 33] and location["dof"] == 30 and location["node"] == 10 for location in worst)


def test_a_table_row_has_the_number_of_failed_checks():
    text = str(checked(FAULTS["no geometric term"].make(MESH, [TERM])))
    rows = [line for line in text.splitlines() if line.split()[:2] == ["agreement", "candidate"] and " K " in line]
    assert rows and all(line.rstrip().endswith("2/8 failed") for line in rows)
