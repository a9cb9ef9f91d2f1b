import json

import numpy as np
import pytest
import skfem
from bodies import BODIES, MESHES, box

from skfem_stvk import Isotropic, MaterialError, MeshError, SimplexMesh, StVK, StvkWarning, embedded_mesh, verify
from skfem_stvk.referee.checks.homogeneous import CLOSED_FORMS
from skfem_stvk.referee.results import Outcome

TERM = StVK(young=2.0, poisson=0.3)
QUIET = {"quiet": True}


@pytest.mark.parametrize("name", BODIES)
def test_every_body_passes(name):
    mesh, terms = BODIES[name]
    report = verify(mesh, terms, **QUIET)
    assert report.passed, str(report)
    assert report.counts[Outcome.COULD_NOT_RUN] == 0


def test_all_named_states_agree_to_1e_13():
    report = verify(box(4), TERM, **QUIET)
    agreement = [r for r in report.results if r.check == "agreement"]
    assert {r.state for r in agreement} == {
        "rest",
        "small random strain",
        "rigid rotation",
        "rotated strained",
        "100 % stretch",
        "35 % compression",
        "large random",
        "reflected random",
    }
    assert len(agreement) == 24 and max(r.measured for r in agreement) < 1e-13


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "segments"])
def test_which_closed_forms_apply_depends_on_the_dimension(name):
    mesh = MESHES[name]
    report = verify(mesh, TERM, **QUIET)
    passed = {r.state for r in report.results if r.check == "closed forms" and r.outcome is Outcome.PASSED}
    assert passed == {state for state, (_, dimensions) in CLOSED_FORMS.items() if mesh.k in dimensions}


def test_membranes_have_more_zero_modes_and_it_says_so():
    report = verify(MESHES["membrane"], TERM, **QUIET)
    (result,) = [r for r in report.results if r.check == "no further zero mode"]
    assert result.outcome is Outcome.NOT_APPLICABLE and "resist no bending" in result.reason
    assert "resist no bending" in str(report)


def test_a_hinge_of_two_bodies_is_not_blamed_for_its_mechanism():
    """Two tetrahedra that share one edge: K has a seventh zero mode, and the referee knows why."""
    p = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.2], [0.3, -1, 0.2], [0.2, -0.3, -1]]).T
    report = verify((p, np.array([[0, 1, 2, 3], [0, 1, 4, 5]]).T), young=1.0, poisson=0.3, **QUIET)
    (result,) = [r for r in report.results if r.check == "no further zero mode"]
    assert report.passed and "share no facet" in result.reason


def test_a_mechanism_within_a_connected_body_is_found():
    """A candidate that leaves out the stiffness of one corner vertex."""
    from skfem_stvk import System

    mesh = box(3)
    body = System(mesh, TERM)

    class Loose:
        def tangent(self, u):
            K = body.tangent(u).tolil()
            K[0, :] = K[:, 0] = 0
            return K.tocsr()

    report = verify(mesh, TERM, candidate=Loose(), **QUIET)
    (result,) = [r for r in report.failures("candidate") if r.check == "no further zero mode"]
    assert result.measured >= 1 and result.worst["dof"] == 0


def test_the_embedded_mesh_is_verified_with_two_materials():
    terms = [StVK(young=70e9, poisson=0.33, region="bracket"), StVK(young=5e6, poisson=0.45, region="bushing")]
    report = verify(embedded_mesh(), terms, **QUIET)
    assert report.passed
    assert {r.subject for r in report.results} == {"skfem-stvk", "homogeneous copy"}
    facts = report.header["mesh"]
    assert 0.3 < facts["negative elements"] / embedded_mesh().nt < 0.7
    assert set(facts["subdomains"]) == {"bracket", "bushing"}
    assert sum("region" in line or "isotropic" in line for line in report.header["material"]) == 2


def test_a_plane_mesh_of_scikit_fem_in_plane_stress():
    report = verify(skfem.MeshTri.init_circle(3), StVK(young=1.0, poisson=0.3, plane="stress", thickness=0.1), **QUIET)
    assert report.passed


def test_disconnected_parts_are_verified_with_a_warning():
    mesh = box(2)
    p = np.concatenate([mesh.p, mesh.p + 5], axis=1)
    with pytest.warns(StvkWarning, match="2 parts that are not connected"):
        report = verify(SimplexMesh(p, np.concatenate([mesh.t, mesh.t + mesh.nv], axis=1)), TERM, **QUIET)
    assert report.passed


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_unit_and_place_do_not_matter(size, offset):
    mesh = box(3)
    report = verify((size * (mesh.p + offset), mesh.t), TERM, **QUIET)
    assert report.passed, str(report)


def test_flat_elements_pass_at_the_digits_that_they_cost():
    mesh = box(3)
    assert verify((mesh.p * np.array([[1.0], [1e-2], [1.0]]), mesh.t), TERM, **QUIET).passed


def test_elements_so_flat_that_the_stress_keeps_six_digits_do_not_pass():
    mesh = box(3)
    report = verify((mesh.p * np.array([[1.0], [2e-4], [1.0]]), mesh.t), TERM, **QUIET)
    assert {r.check for r in report.failures()} == {"closed forms", "patch test"}
    assert "aspect ratio" in report.header["mesh"] and "flat elements cost more" in report.failures()[0].reason


@pytest.mark.parametrize("poisson", [-0.4, 0.0, 0.25, 0.45, 0.499])
def test_any_poisson_passes(poisson):
    assert verify(box(2), young=1.0, poisson=poisson, **QUIET).passed


@pytest.mark.parametrize("seed", range(5))
def test_any_seed_passes(seed):
    assert verify(box(2), TERM, seed=seed, **QUIET).passed


def test_the_same_seed_gives_the_same_numbers():
    first, second = (verify(box(2), TERM, seed=3, **QUIET).results for _ in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: verify(box(2)), MaterialError, "A material is missing"),
        (lambda: verify(box(2), TERM, young=1.0), MaterialError, "a material came as well"),
        (lambda: verify(box(2), [TERM, Isotropic(1.0, 0.3)]), MaterialError, "holds an object of type Isotropic"),
        (lambda: verify("bracket.msh", TERM), MeshError, "A mesh of type str came"),
        (lambda: verify(skfem.MeshHex(), TERM), MeshError, "MeshHex1 is not a mesh of simplices"),
    ],
)
def test_bad_input_is_an_error_before_any_work(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_precision_is_kept_at_every_strain_and_offset_and_lost_by_the_textbook_form():
    rows = verify(box(3), TERM, **QUIET).precision
    error = {(r["form"], r["rotation_deg"], r["offset_m"], r["strain"]): r["error"] for r in rows}
    strains = sorted({r["strain"] for r in rows})
    assert len(strains) == 12 and {r["offset_m"] for r in rows} == {0.0, 1e3, 1e6}
    for offset in (0.0, 1e3, 1e6):
        for strain in strains:
            assert error["skfem-stvk", 0, offset, strain] < 1e-14
            assert error["skfem-stvk", 170, offset, strain] < 1e-14 / strain
    assert error["|p|^2 - |P|^2", 0, 0.0, 1e-8] > 1e-10
    assert error["|p|^2 - |P|^2", 0, 1e6, 1e-8] > 1e-3
    assert error["scikit-fem", 0, 0.0, 1e-8] > 1e-10


def test_speed_has_a_row_for_each_player_and_quantity():
    rows = verify(box(3), TERM, **QUIET).speed
    assert {(r["player"], r["quantity"]) for r in rows} == {(p, q) for p in ("skfem-stvk", "scikit-fem") for q in "WFK"}
    assert all(r["ns_per_element"] > 0 and r["peak_bytes_per_element"] > 0 for r in rows)


def test_the_report_is_saved_as_json_and_as_one_html_file(tmp_path):
    report = verify(box(2), TERM, **QUIET)
    folder = report.save(tmp_path / "new" / "report")
    saved = json.loads((folder / "report.json").read_text())
    assert saved["passed"] and len(saved["results"]) == len(report.results)
    assert {"versions", "machine", "mesh", "material", "command", "seed"} <= set(saved["header"])
    assert all(r["reason"] for r in saved["results"]), "every limit is explained"
    html = (folder / "report.html").read_text()
    assert html.count("<svg") == 2 and "http://" not in html.replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("http://creativecommons.org", "")
    assert "src=" not in html and "passed" in html


def test_a_failed_value_that_is_no_number_is_still_json(tmp_path):
    class Nothing:
        def energy(self, u):
            return float("nan")

    report = verify(box(2), TERM, candidate=Nothing(), **QUIET)
    saved = json.loads((report.save(tmp_path) / "report.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert "nan" in {r["measured"] for r in saved["results"]}


def test_no_picture_no_matplotlib():
    import subprocess
    import sys

    code = (
        "import sys, skfem\nfrom skfem_stvk import verify\n"
        "print(verify(skfem.MeshTet().refined(1), young=1.0, poisson=0.3))\nassert 'matplotlib' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
