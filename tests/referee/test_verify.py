import json

import numpy as np
import pytest
import skfem
from bodies import BODIES, MESHES, box

from skfem_stvk import (
    Isotropic,
    MaterialError,
    MeshError,
    Orthotropic,
    Report,
    SimplexMesh,
    StVK,
    StvkError,
    StvkWarning,
    System,
    embedded_mesh,
    verify,
)
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
    """Candidates whose stiffness at one degree of freedom is missing, or negative."""

    class Loose:
        def __init__(self, dof, left):
            self.body, self.dof, self.left = System(box(3), TERM), dof, left

        def tangent(self, u):
            K = self.body.tangent(u).tolil()
            K[self.dof, :] = K[:, self.dof] = 0
            K[self.dof, self.dof] = self.left
            return K.tocsr()

    for dof, left in ((0, 0.0), (100, 0.0), (57, -1.0)):
        report = verify(box(3), TERM, candidate=Loose(dof, left), **QUIET)
        (result,) = [r for r in report.failures("candidate") if r.check == "no further zero mode"]
        assert result.measured >= 1 and result.worst["dof"] == dof


def test_a_region_that_does_not_cover_the_mesh_is_not_blamed():
    mesh = box(3)
    with pytest.warns(StvkWarning, match="in no term"):
        report = verify(mesh, StVK(young=1.0, poisson=0.3, region=np.arange(81)), **QUIET)
    assert report.passed
    assert any("81 elements belong to no term" in r.reason for r in report.results)


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
    assert "aspect ratio" in report.header["mesh"] and "flat elements" in report.failures()[0].reason


def sliver(h):
    """Two tetrahedra, one of them flat: four vertices about a square, h out of its plane."""
    p = np.array([[1, 0, h], [-1, 0, h], [0, 1, -h], [0, -1, -h], [0, 0, 2.0]]).T
    return p, np.array([[0, 1, 2, 3], [0, 1, 2, 4]]).T


@pytest.mark.parametrize("h", [0.3, 0.1, 0.03, 0.01, 0.001])
def test_single_slivers_pass(h):
    assert verify(sliver(h), TERM, **QUIET).passed


def test_a_delaunay_mesh_of_random_points_passes():
    from scipy.spatial import Delaunay

    points = np.random.default_rng(0).random((200, 3))
    t = Delaunay(points).simplices.T
    x = points[t.T]
    t = t[:, np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) > 1e-6]
    assert verify((points.T, t), TERM, **QUIET).passed


def test_slivers_whose_offset_would_flatten_them_are_measured_where_they_can_be():
    p, t = sliver(3e-4)
    report = verify((3e-6 * p, t), TERM, **QUIET)
    assert {r["offset_m"] for r in report.precision} == {0.0, 1e3}
    assert not [r for r in report.results if r.outcome is Outcome.COULD_NOT_RUN]


def test_long_chains_and_graded_meshes_pass():
    assert verify(skfem.MeshLine(np.linspace(0, 1, 3001)), young=1.0, **QUIET).passed
    graded = skfem.MeshTri().refined(1)
    for _ in range(9):
        graded = graded.refined(graded.elements_satisfying(lambda x: np.hypot(*x) < 1.5 * np.hypot(*x).min()))
    assert verify(graded, young=1.0, poisson=0.3, **QUIET).passed


def test_states_are_what_they_say():
    """In the direction in which the body is longest, wherever that is."""
    from skfem_stvk.mesh.geometry import vertex_sizes
    from skfem_stvk.referee.states import named_states

    cable = SimplexMesh(
        np.stack([0 * np.arange(9.0), 0.1 * np.sin(np.arange(9.0)), np.arange(9.0)]), [np.arange(8), np.arange(1, 9)]
    )
    for mesh in (box(3), cable, MESHES["membrane"], MESHES["segments"]):
        X = (mesh.p - mesh.p.mean(axis=1, keepdims=True)).T
        states = named_states(X, vertex_sizes(mesh), np.random.default_rng(0))
        along = np.linalg.svd(X, full_matrices=False)[2][0]
        moved = {name: u.reshape(X.shape) for name, u in states.items()}
        for name, factor in (("100 % stretch", 2.0), ("35 % compression", 0.65)):
            (slope,) = np.linalg.lstsq((X @ along)[:, None], (X + moved[name]) @ along, rcond=None)[0]
            assert slope == pytest.approx(factor, abs=0.05)
        turned = X + moved["rigid translation" if mesh.d == 1 else "rigid rotation"]
        distances = [np.linalg.norm(x[:, None] - x[None], axis=2) for x in (X, turned)]
        assert np.allclose(*distances, atol=1e-12 * np.ptp(X))
        assert np.abs(turned.mean(axis=0)).max() > 0.01 * np.ptp(X)
        if mesh.d > 1:
            assert np.abs(turned - turned.mean(axis=0) - X).max() > 0.1 * np.ptp(X)
            strained = X + moved["rotated strained"]
            assert np.abs(strained - turned).max() < 0.3 * np.ptp(X) < np.ptp(X)  # turned and shifted in the same way
            assert not np.allclose(strained, turned, atol=0.01 * np.ptp(X))
        if np.linalg.matrix_rank(X, tol=1e-9) == mesh.d:
            mirrored = np.linalg.lstsq(X, X + moved["reflected random"], rcond=None)[0]
            assert np.linalg.det(mirrored) < 0


def test_on_a_line_nothing_turns():
    report = verify(MESHES["segments"], TERM, **QUIET)
    rotations = [r for r in report.results if r.state in ("rotation", "rotated by 170 deg")]
    assert rotations and {r.outcome for r in rotations} == {Outcome.NOT_APPLICABLE}


def test_limits_of_ordinary_meshes_are_1e_12():
    limits = {(r.check, r.limit) for r in verify(embedded_mesh(), TERM, **QUIET).results}
    assert {limit for check, limit in limits if check in ("agreement", "derivatives", "invariance", "balance", "symmetry")} == {
        1e-12
    }
    assert all(limit < 1e-11 for check, limit in limits)


def test_limits_never_leave_1e_6():
    assert max(r.limit for r in verify(sliver(1e-5), TERM, **QUIET).results if r.limit is not None) == 1e-6


def test_a_homogeneous_sheet_of_any_thickness_has_closed_forms():
    mesh = MESHES["triangles"]
    term = StVK(young=1.0, poisson=0.3, thickness=0.1)
    report = verify(mesh, term, candidate=System(mesh, term), **QUIET)
    assert report.passed
    assert {r.outcome for r in report.results if r.subject == "candidate" and r.state == "simple shear"} == {Outcome.PASSED}


def test_plane_strain_and_plane_stress_side_by_side():
    half = MESHES["triangles"].nt // 2
    terms = [StVK(young=1.0, poisson=0.9, plane="stress", region=np.arange(half))]
    terms += [StVK(young=1.0, poisson=0.3, region=np.arange(half, MESHES["triangles"].nt))]
    assert verify(MESHES["triangles"], terms, **QUIET).passed


def test_an_interrupted_speed_is_no_pass(monkeypatch):
    from skfem_stvk.referee import verification

    def interrupted(case):
        raise KeyboardInterrupt

    monkeypatch.setattr(verification, "speed_table", interrupted)
    report = verify(box(2), TERM, **QUIET)
    assert report.interrupted and not report.passed and "interrupted" in str(report)


def test_an_empty_report_has_not_passed():
    assert not Report(header={}).passed


def test_the_textbook_form_in_the_kernel_is_caught_by_precision(monkeypatch):
    from skfem_stvk.kernels import edges

    monkeypatch.setattr(edges, "squared_elongations", lambda P, U: ((P + U) ** 2).sum(axis=1) - (P**2).sum(axis=1))
    failed = {r.check for r in verify(box(2), TERM, **QUIET).failures()}
    assert "precision" in failed


@pytest.mark.parametrize("name", ["membrane", "triangles"])
def test_a_wrong_plane_hypothesis_is_caught(name, monkeypatch):
    from skfem_stvk.materials import Hypothesis

    monkeypatch.setattr(StVK, "hypothesis", lambda self, mesh: Hypothesis.PLANE_STRAIN)
    report = verify(MESHES[name], StVK(young=1.0, poisson=0.3, plane="stress"), **QUIET)
    assert "agreement" in {r.check for r in report.failures()}


def test_exchanged_shear_moduli_and_a_wrong_lame_pair_are_caught(monkeypatch):
    ply = Orthotropic((10.0, 2.0, 1.0), (0.4, 0.3, 0.2), (0.5, 0.6, 0.7))
    right = Orthotropic.stiffness
    monkeypatch.setattr(Orthotropic, "stiffness", lambda self: right(self)[..., [0, 1, 2, 5, 4, 3], :][..., [0, 1, 2, 5, 4, 3]])
    assert "agreement" in {r.check for r in verify(box(2), ply, **QUIET).failures()}
    monkeypatch.undo()
    lame = Isotropic.lame
    monkeypatch.setattr(Isotropic, "lame", lambda self, hypothesis: (2 * lame(self, hypothesis)[0], lame(self, hypothesis)[1]))
    assert {"closed forms", "precision"} <= {r.check for r in verify(box(2), ply, **QUIET).failures()}


def test_errors_that_the_speed_is_shown_against_are_round_off():
    errors = verify(box(3), TERM, **QUIET).errors
    assert set(errors) == {"skfem-stvk", "scikit-fem", "|p|^2 - |P|^2"}
    assert 0 < errors["skfem-stvk"]["F"] < 1e-14 < errors["|p|^2 - |P|^2"]["F"] < 1e-11
    assert 0 < errors["skfem-stvk"]["K"] < 1e-14
    assert 0 < errors["scikit-fem"]["W"] < 1e-11


@pytest.mark.parametrize("poisson", [-0.9999, -0.4, 0.0, 0.25, 0.45, 0.499, 0.49999])
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
        (lambda: verify("bracket.msh", TERM), MeshError, "A mesh of type str came.*Files are read by read_mesh"),
        (lambda: verify(box(2), []), MaterialError, "empty list"),
        (lambda: verify(box(2), TERM, seed=-1), StvkError, "seed = -1; expected a whole number from 0"),
        (lambda: verify(box(2), TERM, seed=1.5), StvkError, "seed = 1.5; expected a whole number from 0"),
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


def test_another_seed_gives_other_numbers():
    first, second = (verify(box(2), TERM, seed=seed, **QUIET).results for seed in (3, 4))
    assert first != second


def test_speed_has_a_row_for_each_player_and_quantity():
    rows = verify(box(3), TERM, **QUIET).speed
    assert {(r["player"], r["quantity"]) for r in rows} == {(p, q) for p in ("skfem-stvk", "scikit-fem") for q in "WFK"}
    ns = {(r["player"], r["quantity"]): r["ns_per_element"] for r in rows}
    assert all(r["ratio"] == pytest.approx(ns["scikit-fem", r["quantity"]] / r["ns_per_element"]) for r in rows)
    nnz = System(box(3), TERM).pattern.nnz
    assert all(r["peak_bytes_per_element"] * box(3).nt >= 8 * nnz for r in rows if r["quantity"] == "K")


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


@pytest.mark.parametrize(("i", "j"), [(0, 0), (0, 1), (1, 0), (1, 1), (2, 2)])
def test_every_entry_of_the_nominal_stress_is_compared(i, j, monkeypatch):
    def wrong(k, lam, mu):
        F, P, W = simple_shear(k, lam, mu)
        P[i, j] *= 1.01
        return F, P, W

    simple_shear, dimensions = CLOSED_FORMS["simple shear"]
    monkeypatch.setitem(CLOSED_FORMS, "simple shear", (wrong, dimensions))
    assert [(r.check, r.quantity, r.state) for r in verify(box(2), TERM, **QUIET).failures()] == [
        ("closed forms", "P", "simple shear")
    ]


def test_an_error_of_the_energy_shows_beside_its_speed(monkeypatch):
    right = System.energy
    monkeypatch.setattr(System, "energy", lambda self, u: right(self, u) * (1 + 1e-10))
    assert verify(box(2), TERM, **QUIET).errors["skfem-stvk"]["W"] == pytest.approx(1e-10, rel=1e-3)
