"""The report names the fault of a candidate, and states that the cause is unknown if no hypothesis fits."""

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from bodies import box
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import aslinearoperator

from skfem_stvk import Corotated, ElementMesh, NeoHookean, StVK, System, TransverselyIsotropic, verify
from skfem_stvk.referee.element_model import cauchy, model_of
from skfem_stvk.referee.faults import FAULTS, bodies
from skfem_stvk.referee.naming import name_the_fault
from skfem_stvk.referee.verification import _case, verify_candidate
from skfem_stvk.testing import Inconsistent, assert_consistent

MESH, TERM = bodies()["isotropic"].mesh, bodies()["isotropic"].terms[0]


def named(candidate, mesh=MESH, terms=(TERM,), options=None):
    return name_the_fault(_case(mesh, list(terms), options or {}, candidate, 0), list(terms))


def partial_model(model, *methods):
    """Return a candidate with some of the three methods of a model."""
    return SimpleNamespace(**{method: getattr(model, method) for method in methods})


@pytest.mark.few(8)
@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_named_by_its_class_or_by_none(name):
    fault = FAULTS[name]
    body = bodies()[fault.body]
    naming = named(fault.make(body.mesh, body.terms), body.mesh, body.terms, body.options)
    assert set(naming.names) == ({fault.named} if fault.named else set())
    assert all(
        one.residual <= 1e-8 or one.name in ("single precision", "not a number at inversion") or "K of the state" in one.name
        for one in naming.explanations
    )
    assert naming.names or naming.smallest


@pytest.mark.few
@pytest.mark.parametrize("methods", [["energy"], ["internal_force"], ["tangent"]], ids=lambda methods: methods[0])
@pytest.mark.parametrize("name", ["twice lambda", "half mu", "linear strain", "materials exchanged"])
def test_one_of_the_three_methods_is_enough(name, methods):
    fault = FAULTS[name]
    body = bodies()[fault.body]
    assert fault.named in named(partial_model(fault.make(body.mesh, body.terms), *methods), body.mesh, body.terms).names


class RacyModel:
    """Candidate whose calls lose some elements at random, as in a data race of threads that write to one array."""

    def __init__(self, chance=0.3):
        body, rng = System(MESH, [TERM]), np.random.default_rng(3)
        lost = System(MESH, [StVK(TERM.material, region=np.arange(1, MESH.nt))])
        for name in ("energy", "internal_force", "tangent"):
            setattr(self, name, lambda u, name=name: getattr(lost if rng.random() < chance else body, name)(u))


def test_a_data_race_is_named_first():
    report = verify(MESH, TERM, candidate=RacyModel(), quiet=True)
    assert not report.passed and report.named.names == ["not repeatable"], str(report.named)
    words = report.named.explanations[0].words
    assert all(f"{quantity} in " in words for quantity in "WFK") and "Correct this first" in words


def test_a_rare_race_is_named():
    assert named(RacyModel(0.1)).names == ["not repeatable"]


def test_an_operator_is_enough():
    model = FAULTS["twice lambda"].make(MESH, [TERM])

    class Operator:
        def tangent(self, u):
            return aslinearoperator(model.tangent(u))

    assert "K x" not in str(named(Operator()).names)
    assert "volume of the deformed body" not in named(Operator()).names


def test_explanations_contain_the_factors():
    report = verify(MESH, TERM, candidate=FAULTS["twice lambda"].make(MESH, [TERM]), quiet=True)
    text = " ".join(str(report).split())
    assert "lambda doubled: your lambda is 2.000 x, your mu 1.000 x" in text
    assert report.to_dict()["named"]["explanations"][0]["name"] == "lambda doubled"
    json.dumps(report.to_dict())


def test_hypotheses_that_are_equal_on_the_body_are_printed_together():
    """Hypotheses that are equal on the body are printed together: at nu = 1/3 the lambda of plane stress is half of lambda."""
    term = StVK(young=2.0, poisson=1 / 3)
    naming = named(FAULTS["half lambda"].make(MESH, [term]), terms=[term])
    assert naming.names == ["lambda halved", "lambda of plane stress"] and "equivalent on this body" in naming.lines()[0]


def test_a_missing_element_is_named():
    naming = named(FAULTS["one tet skipped"].make(MESH, [TERM]))
    assert f"element {MESH.nt // 2} counts 0.000 x: it is left out" in naming.explanations[0].words


def test_a_region_is_named():
    left = np.arange(MESH.nt) % 3 == 0
    mesh = ElementMesh(MESH.p, MESH.t, subdomains={"left": np.flatnonzero(left), "right": np.flatnonzero(~left)})
    terms = [StVK(young=2.0, poisson=0.3, region="left"), StVK(young=1.0, poisson=0.4, region="right")]
    candidate = System(mesh, [StVK(young=2.0, poisson=0.3, region="left"), StVK(young=3.0, poisson=0.4, region="right")])
    naming = named(candidate, mesh, terms)
    assert naming.names == ["lambda and mu by region"]
    assert naming.explanations[0].words == "your lambda is 3.000 x, your mu 3.000 x in right (E = 3 where 1 was claimed)"


def of_lame(lam, mu):
    return System(MESH, StVK(young=mu * (3 * lam + 2 * mu) / (lam + mu), poisson=lam / (2 * (lam + mu))))


def test_a_fault_in_one_of_two_materials_is_named_with_its_region():
    """A fault in one of two materials of an array is named with its region.

    The fault is named likewise if all values are wrong.
    """
    stiff = np.arange(MESH.nt) % 3 == 0
    E, nu = np.where(stiff, 2.0, 1.0), np.where(stiff, 0.3, 0.4)
    term, lam, mu = StVK(young=E, poisson=nu), E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    where = f"in the region of elements 0, 3, 6, ... ({stiff.sum()})"
    (one,) = named(of_lame(np.where(stiff, 2 * lam, lam), mu), terms=[term]).explanations
    assert one.name == "lambda doubled"
    assert (
        one.words
        == f"your lambda is 2.000 x, your mu 1.000 x {where} (E = 2.11538 where 2 was claimed, nu = 0.375 where 0.3 was claimed)"
    )
    (one,) = named(of_lame(np.where(stiff, mu, lam), np.where(stiff, lam, mu)), terms=[term]).explanations
    assert one.name == "lambda and mu exchanged" and one.words.startswith(f"your lambda is 0.667 x, your mu 1.500 x {where} (E = ")
    assert named(of_lame(mu, lam), terms=[term]).names == ["lambda and mu exchanged"]
    (one,) = named(of_lame(2 * lam, mu), terms=[term]).explanations
    assert one.words == "your lambda is 2.000 x, your mu 1.000 x"
    assert named(of_lame(2 * lam, 3 * mu), terms=[term]).names == ["lambda and mu by region"]


@pytest.mark.parametrize("plane", [None, "stress"])
def test_constants_of_one_region_are_named_as_young_and_poisson(plane):
    mesh = MESH if plane is None else ElementMesh.of(skfem.MeshTri().refined(2))
    term = StVK(young=1e5, poisson=0.3, plane=plane)
    naming = named(System(mesh, StVK(young=1e5, poisson=0.45, plane=plane)), mesh, [term])
    assert naming.names == ["lambda and mu"]
    assert naming.explanations[0].words.endswith(" (nu = 0.45 where 0.3 was claimed)")


def test_usual_causes_are_named_if_every_element_has_different_constants():
    rng = np.random.default_rng(4)
    E, nu = rng.uniform(1, 3, MESH.nt), rng.uniform(0.1, 0.45, MESH.nt)
    term, lam, mu = StVK(young=E, poisson=nu), E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    assert named(of_lame(mu, lam), terms=[term]).names == ["lambda and mu exchanged"]
    assert named(of_lame(2 * lam * mu / (lam + 2 * mu), mu), terms=[term]).names == ["lambda of plane stress"]
    assert named(of_lame(lam, E), terms=[term]).names == ["Young's modulus for mu"]
    assert named(of_lame(2 * lam, mu), terms=[term]).names == ["lambda doubled"]
    assert not named(of_lame(lam * rng.uniform(1, 2, MESH.nt), mu), terms=[term]).names


def test_an_unexplained_fault_is_reported_with_the_smallest_failing_case():
    other = verify_candidate(System(MESH, NeoHookean(young=2.0, poisson=0.3)), MESH, [TERM]).named
    assert not other.names and "No hypothesis explains the failure" in other.lines()[0] and "Moving node 0 alone" in other.smallest


def with_error_in(element, error):
    """Return a candidate whose K has an additional `error(u)` in all entries of the nodes of one element."""
    dofs = (3 * MESH.t[:, element][:, None] + np.arange(3)).ravel()

    def tangent(u):
        K = RIGHT.tangent(u).tolil()
        K[np.ix_(dofs, dofs)] = K[np.ix_(dofs, dofs)].toarray() + error(u[dofs])
        return csr_matrix(K)

    return SimpleNamespace(energy=RIGHT.energy, internal_force=RIGHT.internal_force, tangent=tangent)


@pytest.mark.parametrize("element", [0, 5, 29, 47])
def test_the_location_of_an_unexplained_fault_is_in_the_wrong_element(element):
    """An error of one element at rest is located there. An error that grows with the strain is located by one of its nodes."""
    naming = named(with_error_in(element, lambda u: 0.1))
    assert naming.names == [] and naming.smallest == f"W and F are correct. It fails at rest, in the elements {element}."
    naming = named(with_error_in(element, lambda u: np.ptp(u.reshape(-1, 3), axis=0).max()))
    node = MESH.t[:, element].min()
    assert naming.smallest == f"W and F are correct. Moving node {node} alone, in the elements {element}, makes it fail."


def test_a_failure_of_the_energy_at_rest_has_no_location():
    naming = named(SimpleNamespace(energy=lambda u: RIGHT.energy(u) + 0.1 * np.exp(-(u @ u)), internal_force=RIGHT.internal_force))
    assert naming.names == [] and naming.smallest == "F is correct. It fails at rest."


def wide_mesh():
    """Return a mesh of quadratic triangles of several shapes."""
    return ElementMesh.of(skfem.MeshTri.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 2, 4) ** 0.8)).with_degree(2)


KINDS = {
    "segments": ElementMesh.of(skfem.MeshLine(np.linspace(0, 1, 6) ** 1.3)),
    "quadratic triangles": wide_mesh(),
    "tetrahedra": MESH,
    "hexahedra": ElementMesh.of(skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 3) ** 1.2] * 3)),
}


@pytest.mark.few
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("name", "factor_of_mesh", "factor_of_u"),
    [("mesh in mm", 1e3, 1), ("mesh in m", 1e-3, 1), ("u in mm", 1, 1e3), ("u in m", 1, 1e-3), ("W, F, K x", 1e3, 1e3)],
)
def test_wrong_units_of_length_are_named_for_all_elements(kind, name, factor_of_mesh, factor_of_u):
    """Displacements in mm have the force of the body in mm. If both are in mm, W, F and K have factors, in 1D and 2D too."""
    mesh = KINDS[kind]
    body = System(ElementMesh(factor_of_mesh * mesh.p, mesh.t, element=mesh.element), TERM)
    calls = {
        name: partial(lambda name, u: getattr(body, name)(factor_of_u * u), name)
        for name in ("energy", "internal_force", "tangent")
    }
    naming = named(SimpleNamespace(**calls), mesh)
    assert len(naming.names) == 1 and (naming.names[0] == name or name == "W, F, K x"), naming.lines()
    if name == "W, F, K x":
        k = mesh.k
        assert naming.names[0] == "; ".join(
            f"{q} x {1e3**power:g}" for q, power in zip("WFK", (k, k - 1, k - 2), strict=True) if power
        )


@pytest.mark.few
@pytest.mark.parametrize("kind", ["quadratic triangles", "tetrahedra", "hexahedra"])
@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("sign of the initial stress in K", {"initial": -1.0}),
        ("no initial stress in K", {"initial": 0.0}),
        ("initial stress in K x 2", {"initial": 2.0}),
        ("Cauchy stress for S in K", {"initial_from": cauchy}),
    ],
)
def test_wrong_initial_stresses_are_named_for_all_elements(kind, name, change):
    assert named(replace(model_of(KINDS[kind], [TERM]), **change), KINDS[kind]).names == [name]


@pytest.mark.parametrize("kind", ["quadratic triangles", "tetrahedra", "hexahedra"])
@pytest.mark.parametrize("fault", ["no lambda in K", "F' S for F S"])
def test_wrong_formulas_of_K_and_P_are_named_for_all_elements(kind, fault):
    mesh = KINDS[kind]
    assert named(FAULTS[fault].make(mesh, [TERM]), mesh).names == [FAULTS[fault].named]


def spoilt(quantity, states):
    """Return the right model in which one entry of W, F or K is not a number in some states."""

    def value(name, call, u):
        found = call(u)
        if name != quantity or not states(u):
            return found
        if name == "W":
            return np.nan
        (found if name == "F" else found.data)[7] = np.nan
        return found

    names = {"energy": "W", "internal_force": "F", "tangent": "K"}
    return SimpleNamespace(**{m: partial(value, name, getattr(RIGHT, m)) for m, name in names.items()})


@pytest.mark.parametrize("quantity", "WFK")
def test_one_entry_that_is_not_a_number_is_named(quantity):
    naming = named(spoilt(quantity, lambda u: not u.any()))
    (one,) = naming.explanations
    where = {"W": "", "F": " at dof 7 (node 2, y)", "K": " in row 0, column 10"}[quantity]
    assert one.name == "one entry not a number" and one.words.startswith(f"{quantity} is not finite{where} in rest; all other")
    everywhere = named(spoilt(quantity, lambda u: True)).names
    assert everywhere == ([] if quantity == "W" else ["one entry not a number"])
    wrong = spoilt(quantity, lambda u: not u.any())
    wrong.energy = LAMBDA_TWICE.energy if quantity == "F" else RIGHT.energy
    wrong.internal_force = LAMBDA_TWICE.internal_force if quantity != "F" else wrong.internal_force
    assert named(wrong).names != ["one entry not a number"]


@pytest.mark.parametrize(
    ("states", "words"), [("all", "no finite values"), ("zero", "W has entries that are not finite in: rest, rigid rotation.")]
)
def test_no_hypothesis_is_concluded_from_nan(states, words):
    class Broken(System):
        def energy(self, u):
            W = super().energy(u)
            return np.nan if states == "all" or W < 1e-20 else W

    naming = verify_candidate(Broken(MESH, TERM), MESH, [TERM]).named
    assert not naming.names and words in naming.smallest


def test_a_candidate_given_as_function_of_the_mesh_fails_on_one_element():
    report = verify_candidate(lambda mesh: System(mesh, NeoHookean(young=2.0, poisson=0.3)), MESH, [TERM])
    assert "The smallest mesh that fails is one element: 0, nodes" in report.named.smallest


def test_a_fault_between_two_elements_has_a_smallest_mesh_of_several():
    class PairForces(System):
        """System with additional forces between elements that share a node."""

        def internal_force(self, u):
            shared = np.bincount(self.mesh.t.ravel(), minlength=self.mesh.nv) > 1
            return super().internal_force(u) + 1e-3 * np.repeat(shared, 3) * u

    report = verify_candidate(lambda mesh: PairForces(mesh, TERM), MESH, [TERM])
    assert "The smallest mesh found that fails has" in report.named.smallest


def test_right_candidates_and_other_laws_test_no_hypotheses(monkeypatch):
    def tried(*arguments):
        raise AssertionError("hypotheses were tried")

    monkeypatch.setattr("skfem_stvk.referee.verification.name_the_fault", tried)
    assert verify_candidate(System(MESH, TERM), MESH, [TERM]).named is None
    assert verify_candidate(System(MESH, NeoHookean(young=2.0, poisson=0.3)), MESH).named is None


def test_an_error_in_a_hypothesis_loses_no_results(monkeypatch):
    monkeypatch.setattr("skfem_stvk.referee.verification.name_the_fault", lambda *arguments: 1 / 0)
    report = verify_candidate(FAULTS["half mu"].make(MESH, [TERM]), MESH, [TERM])
    assert report.failures() and "ZeroDivisionError" in report.named.smallest


@pytest.mark.parametrize("name", ["twice lambda", "deformed volume", "components first"])
def test_faults_are_named_on_another_mesh(name):
    mesh = box(3)
    assert FAULTS[name].named in named(FAULTS[name].make(mesh, [TERM]), mesh).names


def test_the_assertion_contains_the_name():
    with pytest.raises(Inconsistent, match=r"lambda doubled: your lambda is 2\.000 x"):
        assert_consistent(FAULTS["twice lambda"].make(MESH, [TERM]), MESH, TERM)


LAMBDA_TWICE = FAULTS["twice lambda"].make(MESH, [TERM])
RIGHT = System(MESH, TERM)


def test_a_fault_of_only_a_tangent_is_named_without_a_dense_matrix(monkeypatch):
    def dense(*arguments, **options):
        raise AssertionError("a matrix of the size of the mesh was made dense")

    monkeypatch.setattr(csr_matrix, "toarray", dense)
    monkeypatch.setattr(csr_matrix, "todense", dense)
    assert named(partial_model(LAMBDA_TWICE, "tangent")).names == ["lambda doubled"]
    assert named(partial_model(FAULTS["one tet skipped"].make(MESH, [TERM]), "tangent")).names == ["one element x 0"]


def test_no_factor_of_lambda_is_reported_where_it_is_zero():
    """At nu = 0 no factor of lambda is reported, because forces do not depend on it."""
    term = StVK(young=2.0, poisson=0.0)
    naming = named(System(MESH, StVK(young=4.0, poisson=0.0)), terms=[term])
    assert naming.names == ["W, F, K x 2"] and "lambda" not in naming.explanations[0].words


@pytest.mark.parametrize("farthest", [4.5, 5.6])
def test_a_candidate_that_raises_in_some_states_is_named_by_the_others(farthest):
    raised = []

    def force(u):
        if np.linalg.norm(u) > farthest:  # for all six homogeneous states, or for a few
            raised.append(u)
            raise ValueError("too far")
        return LAMBDA_TWICE.internal_force(u)

    assert named(SimpleNamespace(internal_force=force)).names == ["lambda doubled"] and len(raised) == (9 if farthest == 4.5 else 4)


@pytest.mark.parametrize("factor", [1e-9, 1e-3, 1e6])
def test_units_are_named_with_their_digits(factor):
    (one,) = named(System(MESH, StVK(young=2.0 * factor, poisson=0.3))).explanations
    assert one.name == f"W, F, K x {factor:g}" and "units" in one.words and " 0.000 x" not in one.words


def test_a_fault_of_one_of_the_three_methods_is_named_separately():
    candidate = SimpleNamespace(energy=RIGHT.energy, internal_force=LAMBDA_TWICE.internal_force, tangent=RIGHT.tangent)
    (one,) = named(candidate).explanations
    assert one.name == "W: right; F: lambda doubled; K: right" and "F: your lambda is 2.000 x" in one.words
    candidate.tangent = FAULTS["no geometric term"].make(MESH, [TERM]).tangent
    assert named(candidate).names == ["W: right; F: lambda doubled; K: no initial stress in K"]


def test_a_partial_explanation_and_the_rest_are_reported():
    shear, skew = FAULTS["engineering shear doubled"].make(MESH, [TERM]), FAULTS["skew K"].make(MESH, [TERM])
    candidate = SimpleNamespace(energy=shear.energy, internal_force=shear.internal_force)
    candidate.tangent = lambda u: shear.tangent(u) + 1e6 * (skew.tangent(u) - RIGHT.tangent(u))
    naming = named(candidate)
    assert naming.names == ["W: shear stresses doubled; F: shear stresses doubled"]
    first, _, last = naming.lines()
    assert first.startswith("This explains a part of it") and last == "K has a further fault, which no hypothesis explains."
    candidate.tangent = FAULTS["stale K"].make(MESH, [TERM]).tangent
    assert named(candidate).names == ["W: shear stresses doubled; F: shear stresses doubled"]
    candidate.tangent, candidate.energy = skew.tangent, RIGHT.energy
    assert named(candidate).names == ["W: right; F: shear stresses doubled"]
    candidate.internal_force = RIGHT.internal_force
    naming = named(candidate)
    assert naming.names == [] and naming.smallest == "W and F are correct. It fails at rest."


def test_an_added_term_explains_W_or_F_only_if_the_others_are_right():
    candidate = SimpleNamespace(energy=LAMBDA_TWICE.energy, internal_force=FAULTS["lone force"].make(MESH, [TERM]).internal_force)
    assert named(candidate).names == ["W: lambda doubled; F: a constant force"]
    candidate = SimpleNamespace(energy=lambda u: RIGHT.energy(u) + 0.3, internal_force=RIGHT.internal_force, tangent=RIGHT.tangent)
    (one,) = named(candidate).explanations
    assert one.name == "a constant energy" and "0.3 J" in one.words


def test_elements_without_initial_stress_are_named_for_an_operator():
    K = FAULTS["geometric term in part"].make(MESH, [TERM]).tangent
    for tangent in (K, lambda u: aslinearoperator(K(u))):
        (one,) = named(SimpleNamespace(tangent=tangent)).explanations
        assert one.words == "K has no initial stress in 16 elements (0, 3, 6, 9, 12, ...)"


@pytest.mark.parametrize(("degrees", "name"), [(True, "degrees taken for radians"), (False, "radians taken for degrees")])
def test_angles_of_fibres_are_named(degrees, name):
    """Wrong units of fibre angles are named for angles from 0 to 360 degrees, with other materials than in the planted fault."""

    def fibres(angles):
        c, s, zero, one = np.cos(angles), np.sin(angles), np.zeros(MESH.nt), np.ones(MESH.nt)
        frame = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
        constants = {"poisson_axial": 0.3, "poisson_transverse": 0.4, "shear_axial": 1.0}
        return [StVK(TransverselyIsotropic(9.0, 2.0, **constants, frame=frame))]

    for low in (0, 180):
        angles = np.random.default_rng(8).uniform(low, low + 180, MESH.nt)
        wrong = fibres(angles if degrees else np.deg2rad(np.deg2rad(angles)))
        assert named(System(MESH, wrong), terms=fibres(np.deg2rad(angles))).names == [name]


@pytest.mark.parametrize("law", ["positive root", "corotated"])
def test_another_strain_is_named_on_inverted_elements(law):
    mesh, model = box(2), FAULTS["Biot strain"].make(box(2), [TERM])
    candidate = model if law == "positive root" else System(mesh, Corotated(young=2.0, poisson=0.3))
    case = _case(mesh, [TERM], {}, candidate, 0)
    assert System(mesh, TERM).smallest_volume_ratio(case.states["large random"]) < 0
    assert name_the_fault(case, [TERM]).names == ["Biot strain"]


REST = MESH.p.T.ravel()
REVERSED = np.arange(MESH.p.size).reshape(-1, 3)[:, ::-1].ravel()


@pytest.mark.parametrize(
    ("name", "force"),
    [
        ("sign of u reversed", lambda u: RIGHT.internal_force(-u)),
        ("u doubled", lambda u: RIGHT.internal_force(2 * u)),
        ("u halved", lambda u: RIGHT.internal_force(u / 2)),
        ("u taken for positions", lambda u: RIGHT.internal_force(u - REST)),
        ("components returned in the order z, y, x", lambda u: RIGHT.internal_force(u)[REVERSED]),
        ("components read and returned in the order z, y, x", lambda u: RIGHT.internal_force(u[REVERSED])[REVERSED]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_wrong_displacements_are_named(name, force):
    assert named(SimpleNamespace(internal_force=force)).names == [name]


def test_plane_strain_instead_of_plane_stress_is_named_and_the_reverse():
    mesh = ElementMesh.of(skfem.MeshTri.init_symmetric())
    plane = {kind: StVK(young=2.0, poisson=0.3, plane=kind) for kind in ("strain", "stress")}
    assert named(System(mesh, plane["strain"]), mesh, [plane["stress"]]).names == ["lambda of plane strain"]
    assert named(System(mesh, plane["stress"]), mesh, [plane["strain"]]).names == ["lambda of plane stress"]


def test_not_more_constants_are_fitted_than_energies_determine():
    """Constants by region are not fitted to the energy if there are as many as values of W: five regions have ten constants."""
    regions = np.array_split(np.arange(MESH.nt), 5)
    terms = [StVK(young=1.0 + i, poisson=0.2 + 0.05 * i, region=region) for i, region in enumerate(regions)]
    assert not named(SimpleNamespace(energy=lambda u: float(np.sum(np.cos(u)) + 7)), MESH, terms).names


def test_a_candidate_without_an_energy_is_named_by_its_force_and_tangent():
    def energy(u):
        raise ValueError("there is none")

    naming = named(SimpleNamespace(energy=energy, internal_force=LAMBDA_TWICE.internal_force, tangent=LAMBDA_TWICE.tangent))
    assert naming.names == ["lambda doubled"]
