import numpy as np
import pytest
import skfem
from bodies import BODIES, CURVED, MESHES, box, node_sizes

from skfem_stvk import (
    EdgeNetwork,
    ElementMesh,
    Isotropic,
    MaterialError,
    MeshError,
    Orthotropic,
    StVK,
    StvkError,
    StvkWarning,
    System,
    embedded_mesh,
    verify,
)
from skfem_stvk.referee.case import EDGES, nearby_states
from skfem_stvk.referee.checks.homogeneous import CLOSED_FORMS
from skfem_stvk.referee.faulty_systems import cached
from skfem_stvk.referee.results import CheckOutcome

TERM = StVK(young=2.0, poisson=0.3)
QUIET = {"quiet": True}


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_every_body_passes(name):
    mesh, terms = BODIES[name]
    report = verify(mesh, terms, **QUIET)
    assert report.passed, str(report)
    assert report.counts[CheckOutcome.COULD_NOT_RUN] == 0


def test_all_named_states_agree_to_1e_13():
    report = verify(box(3), TERM, **QUIET)
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
    assert len(agreement) == 48 and max(r.measured for r in agreement) < 1e-13


def test_the_sum_over_edges_and_pairs_is_judged_where_an_edge_form_exists():
    results = {r.quantity: r for r in verify(box(3), TERM, **QUIET).results if r.subject == EDGES and r.check == "agreement"}
    assert set(results) == {"W", "F", "K"} and max(r.measured for r in results.values()) < 1e-13
    (result,) = [r for r in verify(CURVED["quadratic tetrahedra"], TERM, **QUIET).results if r.subject == EDGES]
    assert result.outcome is CheckOutcome.NOT_APPLICABLE and "strain is not uniform" in result.reason


def test_a_wrong_coefficient_of_one_pair_of_edges_is_found(monkeypatch):
    """A wrong coefficient of one pair of edges is found, so the check covers the formula of the paper itself."""
    right = EdgeNetwork.of

    def wrong(mesh, terms):
        network = right(mesh, terms)
        i, j = network.pairs[:, 7]
        L = network.L.tolil()
        L[i, j] *= -1
        L[j, i] *= -1
        return EdgeNetwork(network.edges, L.tocsr(), network.laws)

    monkeypatch.setattr(EdgeNetwork, "of", wrong)
    failures = verify(box(3), TERM, **QUIET).failures()
    assert {r.subject for r in failures} == {EDGES} and "agreement" in {r.check for r in failures}


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "segments"])
def test_which_closed_forms_apply_depends_on_the_dimension(name):
    mesh = MESHES[name]
    report = verify(mesh, TERM, **QUIET)
    passed = {r.state for r in report.results if r.check == "closed forms" and r.outcome is CheckOutcome.PASSED}
    assert passed == {state for state, (_, dimensions) in CLOSED_FORMS.items() if mesh.k in dimensions}


def test_further_zero_modes_of_membranes_are_reported():
    report = verify(MESHES["membrane"], TERM, **QUIET)
    result, of_edges = [r for r in report.results if r.check == "no further zero mode"]
    assert of_edges.subject == "edges and TSEPs"
    assert result.outcome is CheckOutcome.NOT_APPLICABLE and "resist no bending" in result.reason
    assert "resist no bending" in str(report)


def test_a_hinge_of_two_bodies_passes():
    """Two tetrahedra that share one edge pass: K has a seventh zero mode, and the report gives the reason."""
    p = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.2], [0.3, -1, 0.2], [0.2, -0.3, -1]]).T
    report = verify((p, np.array([[0, 1, 2, 3], [0, 1, 4, 5]]).T), young=1.0, poisson=0.3, **QUIET)
    result, _ = [r for r in report.results if r.check == "no further zero mode"]
    assert report.passed and "share no facet" in result.reason


def test_a_mechanism_within_a_connected_body_is_found():
    """Candidates with zero or negative stiffness at one degree of freedom fail."""

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


def test_a_region_that_does_not_cover_the_mesh_passes():
    mesh = box(3)
    with pytest.warns(StvkWarning, match="in no term"):
        report = verify(mesh, StVK(young=1.0, poisson=0.3, region=np.arange(81)), **QUIET)
    assert report.passed
    assert any("81 elements belong to no term" in r.reason for r in report.results)


def test_the_embedded_mesh_is_verified_with_two_materials():
    terms = [StVK(young=70e9, poisson=0.33, region="bracket"), StVK(young=5e6, poisson=0.45, region="bushing")]
    report = verify(embedded_mesh(), terms, **QUIET)
    assert report.passed
    assert {r.subject for r in report.results} == {"skfem-stvk", "edges and TSEPs", "homogeneous copy"}
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
        report = verify(ElementMesh(p, np.concatenate([mesh.t, mesh.t + mesh.nv], axis=1)), TERM, **QUIET)
    assert report.passed


def test_named_states_have_their_deformations():
    """Named states have the deformation of their name: stretches are along the longest direction of the body."""
    from skfem_stvk.referee.case import named_states

    cable = ElementMesh(
        np.stack([0 * np.arange(9.0), 0.1 * np.sin(np.arange(9.0)), np.arange(9.0)]), [np.arange(8), np.arange(1, 9)]
    )
    for mesh in (box(3), cable, MESHES["membrane"], MESHES["segments"]):
        X = (mesh.p - mesh.p.mean(axis=1, keepdims=True)).T
        states = named_states(X, node_sizes(mesh), np.random.default_rng(0))
        along = np.linalg.svd(X, full_matrices=False)[2][0]
        moved = {name: u.reshape(X.shape) for name, u in states.items()}
        for name, factor in (("100 % stretch", 2.0), ("35 % compression", 0.65)):
            (slope,) = np.linalg.lstsq((X @ along)[:, None], (X + moved[name]) @ along, rcond=None)[0]
            assert slope == pytest.approx(factor, abs=0.05)
        rotated = X + moved["rigid translation" if mesh.d == 1 else "rigid rotation"]
        distances = [np.linalg.norm(x[:, None] - x[None], axis=2) for x in (X, rotated)]
        assert np.allclose(*distances, atol=1e-12 * np.ptp(X))
        assert np.abs(rotated.mean(axis=0)).max() > 0.01 * np.ptp(X)
        if mesh.d > 1:
            assert np.abs(rotated - rotated.mean(axis=0) - X).max() > 0.1 * np.ptp(X)
            strained = X + moved["rotated strained"]
            assert np.abs(strained - rotated).max() < 0.3 * np.ptp(X) < np.ptp(X)  # rotated and shifted in the same way
            assert not np.allclose(strained, rotated, atol=0.01 * np.ptp(X))
        if np.linalg.matrix_rank(X, tol=1e-9) == mesh.d:
            mirrored = np.linalg.lstsq(X, X + moved["reflected random"], rcond=None)[0]
            assert np.linalg.det(mirrored) < 0


def test_states_on_a_line_have_no_rotation():
    report = verify(MESHES["segments"], TERM, **QUIET)
    rotations = [r for r in report.results if r.state in ("rotation", "rotated by 170 deg")]
    assert rotations and {r.outcome for r in rotations} == {CheckOutcome.NOT_APPLICABLE}


def test_a_homogeneous_sheet_of_any_thickness_has_closed_forms():
    mesh = MESHES["triangles"]
    term = StVK(young=1.0, poisson=0.3, thickness=0.1)
    report = verify(mesh, term, candidate=System(mesh, term), **QUIET)
    assert report.passed
    assert {r.outcome for r in report.results if r.subject == "candidate" and r.state == "simple shear"} == {CheckOutcome.PASSED}


def test_plane_strain_and_plane_stress_side_by_side():
    half = MESHES["triangles"].nt // 2
    terms = [StVK(young=1.0, poisson=0.9, plane="stress", region=np.arange(half))]
    terms += [StVK(young=1.0, poisson=0.3, region=np.arange(half, MESHES["triangles"].nt))]
    assert verify(MESHES["triangles"], terms, **QUIET).passed


def test_the_textbook_form_in_the_kernel_is_caught_by_precision(monkeypatch):
    from skfem_stvk.edges import Assembly
    from skfem_stvk.referee.checks.precision import Textbook

    def energy(self, u, force=None):
        if force is not None:
            force += Textbook(self.form).internal_force(u.ravel()).reshape(force.shape)
        return 0.0

    monkeypatch.setattr(Assembly, "energy_and_force", energy)
    failed = {r.check for r in verify(box(2), TERM, **QUIET).failures()}
    assert "precision" in failed


@pytest.mark.parametrize("name", ["membrane", "triangles"])
def test_a_wrong_plane_hypothesis_is_caught(name, monkeypatch):
    from skfem_stvk.edges.materials import Hypothesis

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


def test_any_seed_passes_and_gives_its_own_numbers():
    first, second, *others = (verify(box(2), TERM, seed=seed, **QUIET) for seed in (3, 3, 4, 5))
    assert first.results == second.results
    assert all(report.passed and report.results != first.results for report in others)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: verify(box(2)), MaterialError, "A material is missing"),
        (lambda: verify(box(2), TERM, young=1.0), MaterialError, "expected one of the two, got both"),
        (lambda: verify(box(2), [TERM, Isotropic(1.0, 0.3)]), MaterialError, "contains an object of type Isotropic"),
        (
            lambda: verify("bracket.msh", TERM),
            MeshError,
            "mesh = 'bracket.msh'; expected a scikit-fem mesh.*Read files with read_mesh",
        ),
        (lambda: verify(box(2), []), MaterialError, "empty list"),
        (lambda: verify(box(2), TERM, seed=-1), StvkError, "seed = -1; expected a whole number from 0"),
        (lambda: verify(box(2), TERM, seed=1.5), StvkError, "seed = 1.5; expected a whole number from 0"),
        (lambda: verify(skfem.MeshWedge1(), TERM), MeshError, "MeshWedge1 is not a mesh of tetrahedra, hexahedra"),
    ],
)
def test_bad_input_is_an_error_before_any_work(call, error, message):
    with pytest.raises(error, match=message):
        call()


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


#: Keys of a cache that two nearby states may share.
KEYS = {
    "text": str,
    "first entries": lambda u: tuple(u[:3]),
    "last entries": lambda u: tuple(u[-3:]),
    "norm": np.linalg.norm,
    "sum": np.sum,
    "largest entry": np.max,
}
BOXES = {
    "segments": skfem.MeshLine(np.linspace(0, 1, 13) ** 1.3),
    "triangles": skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 2, 7) ** 0.8),
    "tetrahedra": skfem.MeshTet.init_tensor(np.linspace(0, 2, 10), *[np.linspace(0, 1, 6)] * 2),
}


@pytest.mark.few
@pytest.mark.parametrize("methods", [("internal_force", "tangent"), ("internal_force",), ("tangent",)], ids=["F and K", "F", "K"])
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("mesh", BOXES)
def test_a_stale_cache_of_a_nearby_state_fails_and_is_named(mesh, key, methods):
    """Caches of F or K by the text of u, some of its entries, its norm, its sum or its largest entry fail, and are named."""
    names = {"internal_force": "F", "tangent": "K"}
    candidate = cached(methods, lambda u, last: KEYS[key](u) == KEYS[key](last), ElementMesh.of(BOXES[mesh]), [TERM])
    report = verify(BOXES[mesh], TERM, candidate=candidate, **QUIET)
    stale = {("memory", names[method]) for method in methods}
    assert stale <= {(r.check, r.quantity) for r in report.failures("candidate")}, str(report)
    assert report.named.names == [f"{', '.join(map(names.get, methods))} cached while u is nearly the same"]


@pytest.mark.parametrize("mesh", BOXES)
def test_a_cache_of_the_whole_state_passes(mesh):
    methods = ("energy", "internal_force", "tangent")
    candidate = cached(methods, np.array_equal, ElementMesh.of(BOXES[mesh]), [TERM])
    assert verify(BOXES[mesh], TERM, candidate=candidate, **QUIET).passed


@pytest.mark.parametrize("mesh", BOXES)
def test_a_nearby_state_has_the_sum_the_norm_and_the_text_of_the_first(mesh):
    mesh = ElementMesh.of(BOXES[mesh])
    u = 0.3 * np.random.default_rng(3).standard_normal(mesh.p.size)
    near, nearest = nearby_states(u, mesh.d)
    assert np.allclose(near, u, rtol=2e-6, atol=0) and (near != u).all()
    changed = np.flatnonzero(nearest != u)
    assert len(changed) <= {1: 3, 2: 4, 3: 3}[mesh.d] and changed.min() >= 3 and changed.max() < len(u) - 3
    assert 0 < np.abs(nearest - u).max() <= 1e-9 * np.linalg.norm(u)
    assert all(key(nearest) == key(u) for key in (np.linalg.norm, np.sum, str))
