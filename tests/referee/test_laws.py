"""The referee of laws passes right textbook laws, and catches and names mistakes."""

import numpy as np
import pytest

from skfem_stvk import (
    Corotated,
    ElementMesh,
    InvertibleStVK,
    Isotropic,
    NeoHookean,
    StVK,
    System,
    TransverselyIsotropic,
    verify_law,
)
from skfem_stvk.errors import MaterialError, StvkError
from skfem_stvk.referee.results import CheckOutcome
from validation.textbook_laws import LAM, LAWS, MU, ONE, voigt

CLAIMS = StVK(young=MU * (3 * LAM + 2 * MU) / (LAM + MU), poisson=LAM / 2 / (LAM + MU))
KIRCHHOFF, HOLZAPFEL = LAWS["St. Venant-Kirchhoff"], LAWS["Holzapfel-Gasser-Ogden"]


def lines(report):
    return "\n".join(report.header["lines"])


def name(report):
    """Return the only name in the explanation of all failures."""
    (name,) = report.named.names
    return name


def failed(report):
    return {(result.check, result.quantity) for result in report.failures()}


@pytest.mark.few
@pytest.mark.parametrize("of", LAWS)
def test_laws_of_textbooks_pass(of):
    law = LAWS[of]
    report = verify_law(energy=law.W, stress=law.S, elasticity=law.C)
    assert report.passed and report.named is None, str(report)
    assert "stress read as S (guessed)" in lines(report) and "elasticity read as C (guessed)" in lines(report)


def test_ctrl_c_keeps_the_results_of_a_law():
    calls = iter(range(10**6))

    def energy(F):
        if next(calls) == 60:
            raise KeyboardInterrupt
        return KIRCHHOFF.W(F)

    report = verify_law(energy=energy, quiet=True)
    reasons = [result.reason for result in report.results]
    assert report.interrupted and not report.passed and report.counts[CheckOutcome.PASSED] > 0
    assert "interrupted" in reasons and "a law in 3 dimensions: W of F" in str(report)


@pytest.mark.few(3)
@pytest.mark.parametrize("of", LAWS)
def test_a_stress_without_its_factor_two_is_caught_and_named(of):
    """The stress `S = dW/dC` instead of `2 dW/dC` is caught and named."""
    law = LAWS[of]
    report = verify_law(energy=law.W, stress=lambda F: law.S(F) / 2)
    assert ("derivatives", "P") in failed(report) and name(report) == "stress x 0.500"
    assert report.named.explanations[0].words == "the stress fits as S: it is 0.500 x the expected value"


@pytest.mark.few(3)
@pytest.mark.parametrize("of", LAWS)
def test_an_elasticity_by_C_instead_of_E_is_caught_and_named(of):
    """The elasticity `dS/dC` instead of `dS/dE = 2 dS/dC` is caught and named, and so is `d2W/dC2` instead of `4 d2W/dC2`."""
    law = LAWS[of]
    for factor in (2, 4):
        report = verify_law(stress=law.S, elasticity=lambda F, factor=factor: law.C(F) / factor, measure="S", at=states())
        assert ("derivatives", "A") in failed(report)
        assert name(report) == f"elasticity x {1 / factor:.3f}"


def states(d=3):
    rng = np.random.default_rng(5)
    return np.eye(d) + 0.2 * rng.uniform(-1, 1, (2, d, d))


MEASURES = {
    "P": lambda F, P: P,
    "S": lambda F, P: np.linalg.solve(F, P),
    "sigma": lambda F, P: P @ F.T / np.linalg.det(F),
    "tau": lambda F, P: P @ F.T,
    "P transposed": lambda F, P: P.T,
}


@pytest.mark.few
@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("with_energy", [True, False])
def test_stress_measures_are_distinguished(measure, with_energy):
    given = {"stress": lambda F: MEASURES[measure](F, HOLZAPFEL.P(F))} | ({"energy": HOLZAPFEL.W} if with_energy else {})
    report = verify_law(**given, at=states())
    assert report.passed, str(report)
    assert f"stress read as {measure} (guessed)" in report.header["lines"]


@pytest.mark.parametrize("order", ["23-13-12", "12-13-23", "12-23-13"])
@pytest.mark.parametrize("engineering", [True, False])
def test_voigt_orders_are_distinguished(order, engineering):
    report = verify_law(
        stress=HOLZAPFEL.S, elasticity=lambda F: voigt(HOLZAPFEL.C(F), order, engineering), measure="S", at=states()
    )
    assert report.passed, str(report)
    words = f"elasticity read as C, in the order {order}, {'' if engineering else 'no '}engineering shear (guessed)"
    assert words in report.header["lines"]


def test_all_orders_are_listed_where_an_isotropic_matrix_leaves_them_open():
    report = verify_law(stress=KIRCHHOFF.S, elasticity=lambda F: voigt(KIRCHHOFF.C(F), "12-23-13"), claims=CLAIMS, at=states())
    assert report.passed, str(report)
    (line,) = [line for line in report.header["lines"] if line.startswith("elasticity")]
    assert line.count("; or ") == 2 and line.count("no engineering") == 0


def test_wrongly_declared_conventions_are_reported():
    report = verify_law(stress=HOLZAPFEL.S, elasticity=lambda F: voigt(HOLZAPFEL.C(F), "12-23-13"), voigt="23-13-12", at=states())
    assert ("derivatives", "A") in failed(report)
    assert name(report) == "elasticity is C, in the order 12-23-13, engineering shear"


def wrong_energy(F):
    """Return W without the factor 1/2 of lambda, that is, with twice lambda."""
    E = (F.T @ F - ONE) / 2
    return LAM * np.trace(E) ** 2 + MU * np.sum(E * E)


def strain_without_half(F):
    E = F.T @ F - ONE
    return LAM * np.trace(E) * ONE + 2 * MU * E


def linear(F):
    e = (F + F.T) / 2 - ONE
    return LAM * np.trace(e) * ONE + 2 * MU * e


def plastic_like(F):
    """Return a stress that has no energy.

    A multiple of tr(E), added to one component only, breaks the major symmetry.
    """
    E = (F.T @ F - ONE) / 2
    return LAM * np.trace(E @ E) * ONE + 2 * MU * E + 3 * np.trace(E) * np.diag([1.0, 0, 0])


def at_rest_stressed(F):
    return KIRCHHOFF.S(F) + 0.1 * ONE


@pytest.mark.few(8)
@pytest.mark.parametrize(
    ("given", "check", "names"),
    [
        ({"energy": wrong_energy}, ("moduli at rest", "W"), ["lambda x 2.000, mu x 1.000"]),
        ({"energy": wrong_energy, "stress": KIRCHHOFF.P}, ("derivatives", "P"), ["energy: lambda x 2.000, mu x 1.000"]),
        ({"stress": strain_without_half}, ("agreement", "P"), ["lambda x 2.000, mu x 2.000"]),
        ({"stress": lambda F: KIRCHHOFF.S(F) - MU * (F.T @ F - ONE) / 2}, ("agreement", "P"), ["lambda x 1.000, mu x 0.500"]),
        ({"energy": KIRCHHOFF.W, "stress": lambda F: -KIRCHHOFF.P(F)}, ("derivatives", "P"), ["stress x -1.000"]),
        ({"stress": KIRCHHOFF.S, "elasticity": lambda F: KIRCHHOFF.C(F) + LAM * np.einsum("ij,kl->ijkl", ONE, ONE)},
         ("derivatives", "A"), ["elasticity: lambda x 2.000, mu x 1.000"]),
        ({"stress": KIRCHHOFF.S, "elasticity": lambda F: KIRCHHOFF.C(F) - LAM * np.einsum("ij,kl->ijkl", ONE, ONE)},
         ("derivatives", "A"), ["elasticity: lambda x 0.000, mu x 1.000"]),
        ({"energy": KIRCHHOFF.W, "stress": lambda F: KIRCHHOFF.S(F) / 2, "elasticity": lambda F: KIRCHHOFF.C(F) / 2},
         ("derivatives", "P"), ["stress x 0.500; elasticity x 0.500"]),
        ({"stress": linear}, ("objectivity", "P"), ["linear strain"]),
        ({"stress": lambda F: linear(F) + LAM * np.trace(F - ONE) * ONE}, ("objectivity", "P"),
         ["lambda x 2.000, mu x 1.000; linear strain"]),
        ({"stress": plastic_like, "elasticity": KIRCHHOFF.C, "measure": "S"}, ("derivatives", "A"), []),
        ({"stress": at_rest_stressed}, ("rest", "P"), []),
        ({"energy": lambda F: KIRCHHOFF.W(F) if np.linalg.det(F) > 0 else np.nan}, ("inversion", "W"), None),
    ],
)  # fmt: skip
def test_mistakes_in_st_venant_kirchhoff_are_caught_and_named(given, check, names):
    report = verify_law(**given, claims=CLAIMS)
    assert check in failed(report) and not report.passed, str(report)
    assert names == (None if report.named is None else report.named.names), str(report)


def test_an_unnamed_fault_is_reported_in_the_state_nearest_to_rest():
    report = verify_law(stress=lambda F: KIRCHHOFF.S(F) + (F.T @ F - ONE) @ (F.T @ F - ONE), claims=CLAIMS)
    assert report.named.names == [] and "'small strain'" in report.named.smallest, str(report)


def test_a_lambda_that_should_be_zero_is_named():
    report = verify_law(stress=KIRCHHOFF.S, claims=StVK(young=2 * MU, poisson=0.0))
    assert name(report) == "lambda instead of 0" and "lambda = 10, expected 0" in str(report)


def test_a_tangent_without_symmetry_is_caught():
    skew = np.random.default_rng(1).uniform(-1, 1, (3, 3, 3, 3))
    report = verify_law(
        energy=KIRCHHOFF.W, stress=KIRCHHOFF.S, elasticity=lambda F: KIRCHHOFF.C(F) + skew, tangent="C", at=states()
    )
    assert {("major symmetry", "A"), ("minor symmetries", "C"), ("objectivity", "A")} - failed(report) <= {("objectivity", "A")}


def test_a_law_with_fibres_is_not_isotropic():
    isotropic = verify_law(energy=HOLZAPFEL.W, claims=CLAIMS)
    assert ("isotropy", "W") in failed(isotropic)


def test_anisotropic_claims_are_checked():
    fibres = TransverselyIsotropic(
        young_axial=20.0, young_transverse=9.0, poisson_axial=0.2, poisson_transverse=0.3, shear_axial=4.0
    )
    tensor = np.zeros((3, 3, 3, 3))
    for a, (i, j) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
        for b, (k, l) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
            for one in {(i, j), (j, i)}:
                for other in {(k, l), (l, k)}:
                    tensor[(*one, *other)] = np.asarray(fibres.stiffness()).reshape(6, 6)[a, b]

    def stress(F):
        return np.einsum("ijkl,kl->ij", tensor, (F.T @ F - ONE) / 2)

    assert verify_law(stress=stress, claims=StVK(fibres), at=states()).passed
    rotated = TransverselyIsotropic(20.0, 9.0, 0.2, 0.3, 4.0, frame=np.roll(ONE, 1, axis=0))
    assert not verify_law(stress=stress, claims=StVK(rotated), at=states()).passed


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_laws_in_the_plane(plane):
    lam = LAM if plane == "strain" else 2 * LAM * MU / (LAM + 2 * MU)
    claims = StVK(Isotropic(CLAIMS.material.young, CLAIMS.material.poisson), plane=plane)

    def law(lam):
        def S(F):
            E = (F.T @ F - np.eye(2)) / 2
            return lam * np.trace(E) * np.eye(2) + 2 * MU * E

        return S

    matrix = np.array([[lam + 2 * MU, lam, 0], [lam, lam + 2 * MU, 0], [0, 0, MU]])
    assert verify_law(stress=law(lam), elasticity=lambda F: matrix, claims=claims).passed
    other = LAM if plane == "stress" else 2 * LAM * MU / (LAM + 2 * MU)
    report = verify_law(stress=law(other), claims=claims)
    assert ("moduli at rest", "P") in failed(report) and name(report).endswith("mu x 1.000")


def test_loss_of_strong_ellipticity_is_that_of_a_fine_grid_of_closed_forms():
    """The reported loss of strong ellipticity is that of a fine grid of closed forms in a plane that contains the axis.

    The closed form is `a . Q(N) a = (N . S N) |a|^2 + lambda (b . N)^2 + mu (|b|^2 + (b . N)^2)` with `b = F' a`.
    """
    report = verify_law(stress=KIRCHHOFF.S, elasticity=KIRCHHOFF.C, at=states())
    (line,) = [line for line in report.header["lines"] if "uniaxial compression" in line]
    N, a = (np.array([np.cos(angles), np.sin(angles)]) for angles in np.meshgrid(*2 * [np.linspace(0, np.pi, 721)]))

    def least(s):
        E = (s**2 - 1) / 2
        b = np.array([s * a[0], a[1]])
        along = (b * N).sum(axis=0)
        S = (LAM + 2 * MU) * E * N[0] ** 2 + LAM * E * N[1] ** 2
        return (S + LAM * along**2 + MU * ((b**2).sum(axis=0) + along**2)).min()

    s = float(line.rsplit(" ", 1)[1])
    assert least(s + 2e-3) > 0 > least(s - 2e-3)


def raising(F):
    raise SystemExit(3)


def mutating(law, largest=np.inf):
    """Return a law that doubles its argument where its largest entry is below a limit, and returns the right value."""

    def changes(F):
        value = law(F.copy())
        if np.abs(F).max() < largest:
            F *= 2
        return value

    return changes


@pytest.mark.parametrize("largest", [np.inf, 1.0], ids=["always", "in some states"])
def test_a_function_that_changes_its_argument_is_found(largest):
    given = {"energy": mutating(KIRCHHOFF.W, largest), "stress": mutating(KIRCHHOFF.S, largest), "elasticity": KIRCHHOFF.C}
    report = verify_law(**given, claims=CLAIMS, measure="S")
    assert failed(report) == {("unchanged argument", "W"), ("unchanged argument", "P")} and report.named is None, str(report)
    half = verify_law(energy=KIRCHHOFF.W, stress=mutating(lambda F: KIRCHHOFF.S(F) / 2, largest))
    assert ("unchanged argument", "P") in failed(half) and name(half) == "stress x 0.500"


def test_laws_that_are_undefined_at_inversion_pass_with_a_remark():
    """The energy has a logarithm of det F and the stress has not, as in many textbooks."""

    def W(F):
        return MU / 2 * (np.trace(F.T @ F) - 3 - 2 * np.log(np.linalg.det(F))) + LAM / 2 * (np.linalg.det(F) - 1) ** 2

    def P(F):
        J, H = np.linalg.det(F), np.linalg.inv(F).T
        return MU * (F - H) + LAM * (J - 1) * J * H

    report = verify_law(energy=W, stress=P)
    assert report.passed, str(report)
    assert "remark: where det F < 0, W cannot be computed, but P can" in lines(report)
    assert "remark" not in lines(verify_law(energy=KIRCHHOFF.W, stress=KIRCHHOFF.P))


@pytest.mark.parametrize("law", [NeoHookean, StVK, Corotated, InvertibleStVK], ids=lambda law: law.__name__)
def test_laws_of_this_package_pass(law):
    """The laws of this package pass with energy, stress and tangent of one element, of which F is the deformation gradient."""
    mesh = ElementMesh(np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), np.array([[0], [1], [2], [3]]))
    system, g = System(mesh, law(young=2.6, poisson=0.3)), np.array([[-1.0, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    pull = np.linalg.pinv(g)  # (3, 4): forces f_a = V P g_a, so that P = f pull' / V

    def u(F):
        return (mesh.p.T @ (F - ONE).T).ravel()

    def A(F):
        K = system.tangent(u(F)).toarray().reshape(4, 3, 4, 3)
        return 6 * np.einsum("aibk,ja,lb->ijkl", K, pull, pull)

    report = verify_law(
        energy=lambda F: 6 * system.energy(u(F)),
        stress=lambda F: 6 * system.internal_force(u(F)).reshape(4, 3).T @ pull.T,
        elasticity=A,
        claims=law(young=2.6, poisson=0.3),
        measure="P",
        tangent="A",
    )
    assert report.passed, str(report)


def test_an_energy_with_stress_at_rest_fails():
    """The derivative of an energy without a stress of its own must vanish at rest. W itself vanishes there."""

    def W(F):
        return MU / 2 * (np.trace(F.T @ F) - 3) + LAM / 2 * (np.linalg.det(F) - 1) ** 2

    report = verify_law(energy=W)
    assert failed(report) == {("rest", "dW/dF")} and report.named.names == [], str(report)
    assert failed(verify_law(energy=W, dimension=2)) >= {("rest", "dW/dF")}


@pytest.mark.parametrize("degrees", [20, 60, 100, 121, 140, 160])
def test_an_energy_that_is_not_objective_beyond_an_angle_fails(degrees):
    """The trace of a rotation by an angle a is 1 + 2 cos a. All angles up to 160 degrees are seen."""
    least = 1 + 2 * np.cos(np.deg2rad(degrees))
    report = verify_law(energy=lambda F: KIRCHHOFF.W(F) * (1.01 if np.trace(F) < least else 1), quiet=True)
    assert ("objectivity", "W") in failed(report), str(report)


def test_laws_that_raise_or_return_nan_are_handled():
    assert not verify_law(energy=lambda F: float("nan"), at=states()).passed
    assert not verify_law(energy=lambda F: 0.0, at=states()).passed
    report = verify_law(energy=raising)
    assert not report.passed and "SystemExit" in str(report)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "nothing to check"),
        ({"energy": 3}, "expected a function"),
        ({"energy": KIRCHHOFF.W, "at": np.zeros((3, 3))}, "det F <= 0"),
        ({"energy": KIRCHHOFF.W, "dimension": 4}, "2 or 3"),
        ({"stress": lambda F: np.zeros(4)}, "(3, 3), or (6,)"),
        ({"stress": KIRCHHOFF.S, "measure": "PK2"}, "known:"),
        ({"elasticity": KIRCHHOFF.C, "voigt": "11"}, "known:"),
        ({"energy": KIRCHHOFF.W, "claims": 3}, "expected a law"),
        ({"energy": KIRCHHOFF.W, "claims": StVK(young=1.0, poisson=0.3, plane="strain"), "dimension": 3}, "plane"),
    ],
)
def test_bad_arguments_are_refused(given, words):
    with pytest.raises(StvkError) as refused:
        verify_law(**given)
    assert words in str(refused.value)


def test_claims_are_one_material():
    with pytest.raises(MaterialError, match="one Young's modulus"):
        verify_law(energy=KIRCHHOFF.W, claims=StVK(young=[1.0, 2.0], poisson=0.3))
    with pytest.raises(MaterialError, match="poisson = None; expected a number"):
        verify_law(energy=KIRCHHOFF.W, claims=StVK(young=1.0))
    with pytest.raises(MaterialError, match=r"expected values in \(-1, 0.5\)"):
        verify_law(energy=KIRCHHOFF.W, claims=StVK(young=1.0, poisson=0.7))
    verify_law(energy=KIRCHHOFF.W, claims=StVK(young=1.0, poisson=0.7, plane="stress"))  # plane stress admits this value


def test_no_hypothesis_is_concluded_from_nan():
    text = str(verify_law(energy=lambda F: float("nan"), claims=StVK(young=1.0, poisson=0.3)))
    assert (
        "The failing state nearest to rest is 'rest', where the law is not finite" in " ".join(text.split())
        and "strong ellipticity in uniaxial compression is unknown" in text
    )
    assert "not isotropic" not in text and "is lost" not in text


def test_quiet_prints_nothing():
    assert verify_law(energy=KIRCHHOFF.W, quiet=True).passed
    with pytest.raises(StvkError, match="quiet = 1"):
        verify_law(energy=KIRCHHOFF.W, quiet=1)


def with_geometric(stress):
    """Return A = dP/dF of St. Venant-Kirchhoff with another stress than S in its geometric term."""

    def A(F):
        return np.einsum("im,kn,mjnl->ijkl", F, F, KIRCHHOFF.C(F)) + np.einsum("ik,jl->ijkl", ONE, stress(F))

    return A


@pytest.mark.parametrize(
    ("stress", "words"),
    [
        (lambda F: -KIRCHHOFF.S(F), "with the wrong sign of its geometric term"),
        (lambda F: F @ KIRCHHOFF.S(F) @ F.T / np.linalg.det(F), "with the Cauchy stress in its geometric term"),
        (lambda F: 0 * F, "without its geometric term"),
    ],
    ids=["sign", "Cauchy", "none"],
)
@pytest.mark.parametrize("given", ["energy", "stress", "claims"])
def test_a_wrong_geometric_term_is_named(stress, words, given):
    others = {"energy": {"energy": KIRCHHOFF.W}, "stress": {"stress": KIRCHHOFF.P, "measure": "P"}, "claims": {"claims": CLAIMS}}
    report = verify_law(elasticity=with_geometric(stress), tangent="A", **others[given])
    assert not report.passed and name(report) == f"elasticity {words}", str(report)
