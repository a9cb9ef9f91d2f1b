"""Checks of a constitutive law without a mesh: energy density W(F), stress and tangent at deformation gradients."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, choice, flag, real_array, shown, whole
from ..edges.materials import FramedMaterial, Hypothesis, Isotropic
from ..errors import MaterialError, StvkError
from ..terms import StVK
from ..terms.laws.elastic_law import ElasticLaw
from .bodies import tensor_in, voigt_matrix
from .case import random_rotation
from .checks.constitutive import LawChecks
from .law_naming import named_law
from .law_readings import MEASURES, ORDERS, TANGENTS, Declared, JudgedLaw
from .report import Report, judge

Measurement = dict[str, Any]


def verify_law(
    *,
    energy: Callable[[Array], Any] | None = None,
    stress: Callable[[Array], Any] | None = None,
    elasticity: Callable[[Array], Any] | None = None,
    at: ArrayLike | None = None,
    claims: ElasticLaw | None = None,
    dimension: int | None = None,
    measure: str | None = None,
    tangent: str | None = None,
    voigt: str | None = None,
    engineering: bool | None = None,
    seed: int = 0,
    quiet: bool = False,
) -> Report:
    """Check a hyperelastic law at deformation gradients F, without a mesh.

    The law is any subset of energy density, stress and tangent. The checks are:

    - derivatives, by Taylor tests (remainders of order 2). A second test is exact if W is a polynomial of degree up to four along
      lines.
    - objectivity, `W(QF) = W(F)`.
    - the balance of moments, `P F' = F P'`.
    - major and minor symmetries of the tangent.
    - zero stress and strong ellipticity at rest.
    - no function changes its argument.
    - against `claims`: moduli at rest, material symmetry, and for `StVK` also W, P and A in all states, inverted ones included.

    The head of the report states how stress and tangent were read, at which stretch strong ellipticity is lost, and how the law
    behaves at inversion.
    `report.named` names the fault if a factor, other constants, another reading or a missing geometric term explains all failures.

    Parameters
    ----------
    energy
        Function of F (d, d) that returns `W(F)`, one number [J/m^3].
    stress
        Function of F that returns `P`, `S`, `sigma` or `tau` (d, d) [Pa], the last three also as Voigt vectors (6,) or (3,).
    elasticity
        Function of F that returns `A = dP/dF` (d, d, d, d) or by rows (d^2, d^2), or `C = dS/dE` (d, d, d, d) or as a Voigt matrix
        (6, 6) or (3, 3) [Pa].
    at
        (d, d) or (n, d, d) deformation gradients with det F > 0. By default they are sampled.
    claims
        The law that the functions claim to be, such as `StVK(young=1e5, poisson=0.3)`, with `plane=` in two dimensions. For other
        laws of this package only the moduli at rest are compared.
    dimension
        Dimension of F, 2 or 3. The default is the dimension of `at`, then 2 if `claims` has a plane, else 3.
    measure, tangent, voigt, engineering
        The meaning of the arrays. `measure` is "P", "S", "sigma", "tau" or "P transposed"; `tangent` is "A", "C" or "A transposed";
        `voigt` is the order of shears "23-13-12", "12-13-23" or "12-23-13"; `engineering` says whether a matrix acts on engineering
        shear. If one is None, it is inferred at generic F, and the report lists all readings that fit.
    seed
        Seed of the sampled F.
    quiet
        Whether to hide the progress bar.

    Returns
    -------
    Report
        Use `report.passed`, `report.named`, `print(report)` and `report.save("folder")`.

    Raises
    ------
    StvkError
        if no function is given, or an argument is invalid.
    MaterialError
        if `claims` has no material, constants or frames per element, or an invalid Poisson's ratio.

    Notes
    -----
    Source: Bonet, Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis" (2008), chapters 5 and 6.

    Examples
    --------
    >>> import numpy as np
    >>> def W(F):
    ...     E = (F.T @ F - np.eye(3)) / 2
    ...     return 5.0 * np.trace(E) ** 2 + 4.0 * np.sum(E * E)
    >>> def S(F):                                     # twice lambda
    ...     E = (F.T @ F - np.eye(3)) / 2
    ...     return 20.0 * np.trace(E) * np.eye(3) + 8.0 * E
    >>> verify_law(energy=W).passed, verify_law(energy=W, stress=S).passed
    (True, False)
    >>> claims = StVK(young=4 * 19 / 7, poisson=5 / 14)   # lambda = 10, mu = 4
    >>> verify_law(stress=S, claims=claims).named.names
    ['lambda x 2.000, mu x 1.000']
    """
    functions = {name: f for name, f in (("W", energy), ("P", stress), ("A", elasticity)) if f is not None}
    for name, f in (("energy", energy), ("stress", stress), ("elasticity", elasticity)):
        if f is not None and not callable(f):
            raise StvkError(f"{name} = {shown(f)}; expected a function of F (d, d).")
    if not functions:
        raise StvkError("verify_law has nothing to check; give energy=, stress= or elasticity=, functions of F (d, d).")
    choices = {"measure": (measure, MEASURES), "tangent": (tangent, TANGENTS), "voigt": (voigt, (*ORDERS, "12"))}
    for name, (value, known) in choices.items():
        if value is not None:
            choice(name, value, known)
    if engineering is not None:
        flag("engineering", engineering)
    gradients = None if at is None else _gradients(at)
    d = _dimension(dimension, gradients, claims)
    tensor = None if claims is None else _tensor(claims, d)
    quiet = flag("quiet", quiet)
    rng = np.random.default_rng(whole("seed", seed, "a whole number from 0"))
    law = JudgedLaw(functions, d, rng)
    states = _samples(d, rng) if gradients is None else {f"F {i}": F for i, F in enumerate(gradients)}
    declared: Declared = {"P": (measure, voigt, None), "A": (tangent, voigt, engineering)}
    lines = law.read(declared, tensor, isinstance(claims, StVK))
    checks = LawChecks(law, states, tensor, claims, rng)
    lines = [f"a law in {d} dimensions: {', '.join(functions)} of F", *lines]

    def explain(report: Report) -> None:
        report.named = named_law(law, checks, declared, report.results)
        lines.extend(checks.facts())

    return judge("verify law", {"seed": seed, "lines": lines}, list(checks.tasks()), quiet, explain)


def _gradients(at: ArrayLike) -> Array:
    given = real_array(at)
    if (
        given is None
        or given.ndim not in (2, 3)
        or given.shape[-1] not in (2, 3)
        or given.shape[-1] != given.shape[-2]
        or not given.size
    ):
        raise StvkError(f"at = {shown(at)}; expected deformation gradients (d, d) or (n, d, d), d = 2 or 3.")
    if not np.isfinite(given).all() or (np.linalg.det(given) <= 0).any():
        raise StvkError("at has a gradient that is not finite or has det F <= 0; inversion is checked by itself. Leave it out.")
    return np.array(given.reshape(-1, *given.shape[-2:]))


def _dimension(dimension: int | None, gradients: Array | None, claims: Any) -> int:
    known = None if gradients is None else gradients.shape[-1]
    plane = getattr(claims, "plane", None)
    if dimension is None:
        dimension = known or (2 if plane is not None else 3)
    dimension = whole("dimension", dimension, "2 or 3", least=2, most=3)
    if known not in (None, dimension):
        raise StvkError(f"dimension = {dimension}, but the gradients of at are {known} x {known}. Leave one out.")
    if plane is not None and dimension == 3:
        raise StvkError(f"claims has plane = {plane!r}, which is for 2 dimensions. Leave it out, or say dimension=2.")
    return dimension


def _tensor(claims: Any, d: int) -> Array:
    """Return the moduli at rest of the claimed law, (d, d, d, d)."""
    if not isinstance(claims, ElasticLaw):
        raise StvkError(f"claims = {shown(claims)}; expected a law such as StVK(young=1e5, poisson=0.3).")
    material, condensed = claims.material, d == 2 and claims.plane == "stress"
    if isinstance(material, Isotropic):
        if np.size(material.young) != 1 or (material.poisson is not None and np.size(material.poisson) != 1):
            raise MaterialError("claims needs one Young's modulus and one Poisson's ratio: a law is checked at points.")
        plane = Hypothesis.PLANE_STRESS if condensed else Hypothesis.PLANE_STRAIN
        material.check(1, Hypothesis.SOLID if d == 3 else plane)  # refuses a Poisson's ratio that is missing or impossible
    else:
        frame = material.frame if isinstance(material, FramedMaterial) else None
        if voigt_matrix(material).size != 36 or (frame is not None and np.ndim(frame) != 2):
            raise MaterialError("claims has constants or frames by element; expected one of each: a law is checked at points.")
    return np.array(tensor_in(np.eye(d)[None], material, condensed)[0])


def _samples(d: int, rng: np.random.Generator) -> dict[str, Array]:
    """Return named deformation gradients: rest, small strain, a rotation, generic ones, a stretch and a compression."""
    one = np.eye(d)
    generic = {f"generic {i}": random_rotation(d, rng) @ (one + 0.25 * rng.uniform(-1, 1, (d, d))) for i in range(4)}
    small = {"small strain": one + 1e-3 * rng.uniform(-1, 1, (d, d)), "rotation": random_rotation(d, rng)}
    stretched = {"stretched": np.diag([1.6, 0.9, 1.1][:d]) + 0.1 * one[::-1], "compressed": np.diag([0.7, 0.95, 0.85][:d])}
    return {"rest": one} | small | generic | stretched
