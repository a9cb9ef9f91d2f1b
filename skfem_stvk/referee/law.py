"""Checks of a law without a mesh: an energy density W(F), its stress and its tangent, at deformation gradients."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, choice, flag, real_array, shown, whole
from ..errors import MaterialError, StvkError
from ..materials import FramedMaterial, Hypothesis, Isotropic
from ..reference import anisotropic_tensor, isotropic_tensor
from ..terms import Corotated, InvertibleStVK, LinearElastic, NeoHookean, StVK
from .bodies import voigt_matrix
from .case import random_rotation
from .header import PACKAGES, circumstances
from .law_readings import (
    MEASURES,
    ORDERS,
    TANGENTS,
    Reading,
    geometric_part,
    material_part,
    nominal_stress,
    nominal_tangent,
    readings_of_stress,
    readings_of_tangent,
    second_of,
)
from .players import Foul, Player, fairly
from .report import Report
from .results import CannotTell, NotApplicable, Task

LAW = "law"
#: Relative residuals of a reading that fits: differences of sixth order are good to 1e-10 or so, twice taken to 1e-8.
FITS = 1e-6
SIXTH = ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60))  # antisymmetric weights of the derivative of sixth order
Claims = StVK | NeoHookean | LinearElastic | Corotated | InvertibleStVK
Measurement = dict[str, Any]


def verify_law(
    *,
    energy: Callable[[Array], Any] | None = None,
    stress: Callable[[Array], Any] | None = None,
    elasticity: Callable[[Array], Any] | None = None,
    at: ArrayLike | None = None,
    claims: Claims | None = None,
    dimension: int | None = None,
    measure: str | None = None,
    tangent: str | None = None,
    voigt: str | None = None,
    engineering: bool | None = None,
    seed: int = 0,
) -> Report:
    """Check a hyperelastic law, any subset of energy density, stress and tangent, at deformation gradients F; no mesh is needed.

    Derivatives by Taylor tests (remainders of order 2), and exactly where W is a polynomial of degree up to four along lines;
    objectivity, `W(QF) = W(F)`; the balance of moments, `P F' = F P'`; major and minor symmetries; no stress at rest, and strong
    ellipticity there; what happens at inversion; and against `claims`, moduli at rest, material symmetry, and for `StVK` W, P and A
    everywhere. The head of the report says how stress and tangent were read, what is wrong if one word says it ("2 x"), and at
    which stretch strong ellipticity is lost.

    Parameters
    ----------
    energy : `W(F)`, one number [J/m^3], of F (d, d).
    stress : `P`, `S`, `sigma` or `tau` (d, d) [Pa], the last three also as Voigt vectors (6,) or (3,).
    elasticity : `A = dP/dF` (d, d, d, d) or by rows (d^2, d^2), or `C = dS/dE` (d, d, d, d) or as a Voigt matrix (6, 6) or
        (3, 3) [Pa].
    at : (d, d) or (n, d, d) deformation gradients with det F > 0, by default sampled ones.
    claims : the law that it claims to be, such as `StVK(young=1e5, poisson=0.3)`, with `plane=` in two dimensions; of other laws of
        this package the moduli at rest are held.
    dimension : 2 or 3; by default that of `at`, 2 if `claims` has a plane, else 3.
    measure, tangent, voigt, engineering : what the arrays mean: one of "P", "S", "sigma", "tau", "P transposed"; "A", "C",
        "A transposed"; the order of shear "23-13-12", "12-13-23", "12-23-13"; and whether a matrix acts on engineering shear.
        What is not told is guessed on generic F; the report lists all that fit.
    seed : of the sampled F.

    Raises
    ------
    StvkError
        if no function is given, or an argument is not what it should be.
    MaterialError
        if `claims` has constants per element, or no material.

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
    >>> [line for line in verify_law(stress=S, claims=claims).header["lines"] if "lambda" in line]
    ['stress at rest: lambda is 2.000 x, mu is 1.000 x that of the claim']

    Source: Bonet, Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis" (2008), chapters 5 and 6.
    """
    began = time.monotonic()
    functions = {name: f for name, f in (("W", energy), ("P", stress), ("A", elasticity)) if f is not None}
    for name, f in (("energy", energy), ("stress", stress), ("elasticity", elasticity)):
        if f is not None and not callable(f):
            raise StvkError(f"{name} = {shown(f)}; expected a function of F (d, d).")
    if not functions:
        raise StvkError("verify_law has nothing to check; give energy=, stress= or elasticity=, functions of F (d, d).")
    told = {"measure": (measure, MEASURES), "tangent": (tangent, TANGENTS), "voigt": (voigt, (*ORDERS, "12"))}
    for name, (value, known) in told.items():
        if value is not None:
            choice(name, value, known)
    if engineering is not None:
        flag("engineering", engineering)
    gradients = None if at is None else _gradients(at)
    d = _dimension(dimension, gradients, claims)
    tensor = None if claims is None else _tensor(claims, d)
    rng = np.random.default_rng(whole("seed", seed, "a whole number from 0"))
    law = _Law(functions, d, rng)
    states = _samples(d, rng) if gradients is None else {f"F {i}": F for i, F in enumerate(gradients)}
    lines = law.read({"P": (measure, voigt, None), "A": (tangent, voigt, engineering)}, tensor, isinstance(claims, StVK))
    checks = _Checks(law, states, tensor, claims, rng)
    report = Report(circumstances(PACKAGES) | {"seed": seed})
    report.results += [task.run() for task in checks.tasks()]
    report.header["lines"] = [f"a law in {d} dimensions: {', '.join(functions)} of F", *lines, *checks.facts()]
    report.seconds = time.monotonic() - began
    return report


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
    """(d, d, d, d) moduli at rest of the law that is claimed."""
    if not isinstance(claims, Claims):
        raise StvkError(f"claims = {shown(claims)}; expected a law such as StVK(young=1e5, poisson=0.3).")
    material, condensed = claims.material, d == 2 and claims.plane == "stress"
    if isinstance(material, Isotropic):
        if np.size(material.young) != 1 or (material.poisson is not None and np.size(material.poisson) != 1):
            raise MaterialError("claims needs one Young's modulus and one Poisson's ratio: a law is checked at points.")
        plane = Hypothesis.PLANE_STRESS if condensed else Hypothesis.PLANE_STRAIN
        material.check(1, Hypothesis.SOLID if d == 3 else plane)  # refuses a Poisson's ratio that is missing or impossible
        assert material.poisson is not None
        return np.array(isotropic_tensor(material.young, material.poisson, d, condensed)[0])
    matrices = voigt_matrix(material)
    frame = np.asarray(material.frame) if isinstance(material, FramedMaterial) and material.frame is not None else None
    if matrices.size != 36 or (frame is not None and frame.ndim != 2):
        raise MaterialError("claims has constants or frames by element; expected one of each: a law is checked at points.")
    frames = None if frame is None else frame[None]
    return np.array(anisotropic_tensor(matrices.reshape(1, 6, 6), frames, np.eye(d)[None], condensed)[0])


def _samples(d: int, rng: np.random.Generator) -> dict[str, Array]:
    """Deformation gradients that are neither small nor special, and those at rest and of a rotation."""
    one = np.eye(d)
    generic = {f"generic {i}": random_rotation(d, rng) @ (one + 0.25 * rng.uniform(-1, 1, (d, d))) for i in range(4)}
    small = {"small strain": one + 1e-3 * rng.uniform(-1, 1, (d, d)), "rotation": random_rotation(d, rng)}
    stretched = {"stretched": np.diag([1.6, 0.9, 1.1][:d]) + 0.1 * one[::-1], "compressed": np.diag([0.7, 0.95, 0.85][:d])}
    return {"rest": one} | small | generic | stretched


class _Law:
    """W, P and A = dP/dF of the functions that are given, each as a reading says; trusts nothing that they return."""

    def __init__(self, functions: dict[str, Callable[[Array], Any]], d: int, rng: np.random.Generator) -> None:
        self.functions, self.d = functions, d
        self.reading: dict[str, Reading] = {}
        one = np.eye(d)
        self.generic = [random_rotation(d, rng) @ (one + 0.3 * rng.uniform(-1, 1, (d, d))) for _ in range(3)]
        self.turn = random_rotation(d, rng, 70.0)

    def value(self, name: str, F: Array) -> Array:
        """What the function returned, as real numbers in an array of its own."""
        returned = fairly(f"{name}(F)", lambda: self.functions[name](F.copy()))
        values = real_array(fairly(f"{name}(F)", lambda: np.array(returned, dtype=None)))
        if values is None or (name == "W" and values.size != 1):
            raise Foul(f"{name}(F) returned {shown(returned)}; expected {'one number' if name == 'W' else 'real numbers'}.")
        if name != "W" and name in self.reading and values.shape != self.shape[name]:
            raise Foul(f"{name}(F) returned shape {values.shape}; before it was {self.shape[name]}.")
        return np.array(values)

    def W(self, F: Array) -> float:
        return float(self.value("W", F).reshape(()))

    def P(self, F: Array) -> Array:
        return nominal_stress(self.value("P", F), F, self.reading["P"])

    def A(self, F: Array) -> Array:
        return nominal_tangent(self.value("A", F), F, self.any_stress(F), self.reading["A"])

    def any_stress(self, F: Array) -> Array:
        """P as it is given, else as the derivative of W, else none: of a lone C, of which the claims know the stress."""
        if "P" in self.functions:
            return self.P(F)
        if "W" in self.functions:
            return differences(self.W, F, 2e-3)
        return self.claimed(F) if self.claimed is not None else np.zeros_like(F)

    claimed: Callable[[Array], Array] | None = None
    shape: dict[str, tuple[int, ...]]
    _true: list[Array] | None = None

    def tangent_by_differences(self, F: Array) -> Array | None:
        """(d, d, d, d) of P, or else of W; None if there is neither."""
        if "P" in self.functions:
            return differences(self.P, F, 2e-3)
        return differences(lambda G: differences(self.W, G, 1e-2), F, 1e-2) if "W" in self.functions else None

    def read(self, told: dict[str, tuple[str | None, str | None, bool | None]], tensor: Array | None, stvk: bool) -> list[str]:
        """Choose the readings of stress and tangent; lines that say what fits, and what is wrong if a word says it."""
        self.shape, lines = {}, []
        if tensor is not None and stvk:
            self.claimed = lambda F: stvk_stress(tensor, F)
        for name, all_of, fits in (("P", readings_of_stress, self._stress_fits), ("A", readings_of_tangent, self._tangent_fits)):
            if name not in self.functions:
                continue
            word = {"P": "stress", "A": "elasticity"}[name]
            try:
                self.shape[name] = self.value(name, self.generic[0]).shape
            except Foul as foul:
                raise StvkError(f"{word}: {foul}") from foul
            known = all_of(self.shape[name], self.d)
            if not known:
                raise StvkError(f"{word} returned an array of shape {self.shape[name]}; expected {_EXPECTED[name][self.d]}.")
            kind, order, engineering = told[name]
            asked = [
                r
                for r in known
                if kind in (None, r.kind) and (order in (None, r.order) or r.order in (None, "12")) and
                (engineering is None or r.engineering in (None, engineering))
            ]  # fmt: skip
            if not asked:
                raise StvkError(
                    f"{word} of shape {self.shape[name]} cannot be what is told; it may be: {'; '.join(map(str, known))}."
                )
            lines += self._chosen(name, word, known, asked, fits)
        return lines

    def _chosen(
        self, name: str, word: str, known: list[Reading], asked: list[Reading], fits: Callable[[Reading], tuple[float, str]]
    ) -> list[str]:
        found: dict[Reading, tuple[float, str]] = {}
        for reading in known:
            self.reading[name] = reading
            try:
                found[reading] = fits(reading)
            except Foul:
                found[reading] = (np.inf, "")
        good = [r for r in known if found[r][0] < FITS]
        right = [r for r in asked if r in good]
        named = [f"{r}: {found[r][1]}" for r in asked if found[r][1]]
        named = named or [f"{r}: {found[r][1]}" for r in known if found[r][1]]
        self.reading[name] = (right or [r for r in asked if found[r][1]] or sorted(asked, key=lambda r: found[r][0]))[0]
        how = "told" if len(asked) == 1 else "guessed"
        if right:
            return [f"{word} read as {right[0]} ({how})" + "".join(f"; or {r}" for r in right[1:])]
        lines = [f"{word} read as {self.reading[name]}, which does not fit"]
        if good:
            lines.append(f"{word} fits: " + "; ".join(map(str, good)))
        elif named:
            lines.append(f"{word} would fit as " + "; ".join(named))
        return lines

    def _stress_fits(self, reading: Reading) -> tuple[float, str]:
        """Residual of a reading, against the derivative of W or in itself, and the factor that would make it fit."""
        given = np.array([nominal_stress(self.value("P", F), F, reading) for F in self.generic])
        if "W" in self.functions:
            return fitted(given, np.array([differences(self.W, F, 2e-3) for F in self.generic]))
        worst = 0.0
        for F, P in zip(self.generic, given, strict=True):
            scale = np.abs(P).max() or 1.0
            moments, A = P @ F.T, differences(self.P, F, 2e-3)
            worst = max(worst, float(np.abs(moments - moments.T).max() / scale))
            worst = max(worst, float(np.abs(self.P(self.turn @ F) - self.turn @ P).max() / scale))
            worst = max(worst, float(np.abs(A - A.transpose(2, 3, 0, 1)).max() / (np.abs(A).max() or 1.0)))
        return (worst if np.isfinite(worst) else np.inf), ""

    def _tangent_fits(self, reading: Reading) -> tuple[float, str]:
        given, geometric = [], []
        for F in self.generic:
            P, value = self.any_stress(F), self.value("A", F)
            given.append(nominal_tangent(value, F, P, reading))
            geometric.append(geometric_part(P, F))
        true = self._true_tangents()
        if not true:
            return self._objective(reading), ""
        A, B, G = np.array(given), np.array(true), np.array(geometric)
        residual, words = fitted(A, B) if reading.kind != "C" else fitted(A - G, B - G)
        if reading.kind != "C" and not words and residual > FITS and fitted(A, B - G)[0] < FITS:
            words = "the geometric term is missing"
        return residual, words

    def _true_tangents(self) -> list[Array]:
        """A in the generic states by differences of P, of W, or of what is claimed; none if there is none of them."""
        if self._true is None:
            self._true = []
            for F in self.generic:
                A = self.tangent_by_differences(F)
                if A is None and self.claimed is not None:
                    A = differences(self.claimed, F, 2e-3)
                if A is not None:
                    self._true.append(A)
        return self._true

    def _objective(self, reading: Reading) -> float:
        """How far a lone tangent is from major symmetry and objectivity."""
        worst, d = 0.0, self.d
        for F in self.generic:
            if reading.kind == "C":
                one = np.eye(d)
                first, turned = (material_part(self.value("A", G), one, reading) for G in (F, self.turn @ F))
                first_symmetric = np.abs(first - first.transpose(1, 0, 2, 3)).max()
            else:
                first, turned = (nominal_tangent(self.value("A", G), G, 0 * F, reading) for G in (F, self.turn @ F))
                turned, first_symmetric = np.einsum("ai,bk,ijkl->ajbl", self.turn.T, self.turn.T, turned), 0.0
            errors = np.abs(turned - first).max(), np.abs(first - first.transpose(2, 3, 0, 1)).max(), first_symmetric
            worst = max(worst, float(max(errors) / (np.abs(first).max() or 1.0)))
        return worst if np.isfinite(worst) else np.inf


_EXPECTED = {
    "P": {2: "(2, 2), or (3,) in Voigt order", 3: "(3, 3), or (6,) in Voigt order"},
    "A": {2: "(2, 2, 2, 2), (4, 4), or (3, 3) in Voigt order", 3: "(3, 3, 3, 3), (9, 9), or (6, 6) in Voigt order"},
}


def differences(function: Callable[[Array], Any], F: Array, h: float) -> Array:
    """(..., d, d) derivative by F, by central differences of sixth order."""
    d, columns = len(F), []
    for i, j in product(range(d), range(d)):
        step = np.zeros((d, d))
        step[i, j] = h
        columns.append(sum(w * (np.asarray(function(F + n * step)) - function(F - n * step)) for n, w in SIXTH) / h)
    return np.moveaxis(np.array(columns), 0, -1).reshape(*np.shape(columns[0]), d, d)


def second_differences(function: Callable[[Array], float], F: Array, h: float = 1e-3) -> Array:
    """(d, d, d, d) second derivatives of a number by F, of second order: enough to see where they lose their sign."""
    d = len(F)
    steps = h * np.eye(d * d).reshape(-1, d, d)
    H = np.zeros((d * d, d * d))
    for a, b in product(range(d * d), range(d * d)):
        if a <= b:
            D, E = steps[a], steps[b]
            mixed = function(F + D + E) - function(F + D - E) - function(F - D + E) + function(F - D - E)
            H[a, b] = H[b, a] = mixed / (4 * h * h)
    return H.reshape(d, d, d, d)


def fitted(given: Array, true: Array) -> tuple[float, str]:
    """Relative residual of `given = true`; and if `given = c true` with another c, words that say so."""
    scale = np.abs(true).max() or 1.0
    residual = float(np.abs(given - true).max() / scale)
    if not np.isfinite(residual):
        return np.inf, ""
    c = float((given * true).sum() / ((true * true).sum() or 1.0))
    explained = abs(c) > FITS and np.abs(given - c * true).max() / scale / abs(c) < FITS
    return residual, f"it is {c:.3f} x what it should be" if explained and residual > FITS else ""


def stvk_energy(tensor: Array, F: Array) -> float:
    """`1/2 E : C : E`."""
    E = (F.T @ F - np.eye(len(F))) / 2
    return float(np.einsum("ij,ijkl,kl", E, tensor, E) / 2)


def stvk_stress(tensor: Array, F: Array) -> Array:
    """`P = F (C : E)`."""
    return F @ np.einsum("ijkl,kl->ij", tensor, (F.T @ F - np.eye(len(F))) / 2)


class _Checks:
    """The tasks on a law, and facts that are no checks."""

    def __init__(self, law: _Law, states: dict[str, Array], tensor: Array | None, claims: Any, rng: np.random.Generator) -> None:
        self.law, self.states, self.tensor, self.claims = law, states, tensor, claims
        d = law.d
        self.player = Player(LAW, law, d * d)
        self.turn = random_rotation(d, rng, 110.0)
        self.along = rng.uniform(-1, 1, (d, d))
        self.has = law.functions.keys()
        self.scales: dict[str, float] = {}
        self.stvk = isinstance(claims, StVK)
        self.isotropic = claims is not None and isinstance(claims.material, Isotropic)

    def tasks(self) -> Iterator[Task]:
        """Every check in every state."""
        for name, F in self.states.items():
            for what in ("P", "A"):
                if what in self.has and ("W" in self.has or (what == "A" and "P" in self.has)):
                    yield self._task("derivatives", what, name, self._taylor, what, F)
                    yield self._task("exact derivatives", what, name, self._exactly, what, F)
            for what in self.has:
                yield self._task("objectivity", what, name, self._objectivity, what, F)
                if self.isotropic:
                    yield self._task("isotropy", what, name, self._isotropy, what, F)
                if self.stvk:
                    yield self._task("agreement", what, name, self._agreement, what, F)
            if "P" in self.has:
                yield self._task("balance of moments", "P", name, self._moments, F)
            if "A" in self.has:
                yield self._task("major symmetry", "A", name, self._major, F)
                yield self._task("minor symmetries", "C", name, self._minor, F)
        one = np.eye(self.law.d)
        for what in self.has:
            if what != "A":
                yield self._task("rest", what, "rest", self._rest, what)
            if self.tensor is not None:
                yield self._task("moduli at rest", what, "rest", self._moduli, what)
            yield self._task("inversion", what, "mirrored", self._inversion, what)
        yield self._task("strong ellipticity", "A", "rest", self._elliptic, one)

    def _task(self, check: str, quantity: str, state: str, measured: Callable[..., Measurement], *arguments: Any) -> Task:
        against = "St. Venant-Kirchhoff" if check == "agreement" else ""
        return Task(check, self.player, quantity, state, "", partial(measured, *arguments), against)

    def _value(self, what: str, F: Array) -> Array:
        return np.asarray({"W": self.law.W, "P": self.law.P, "A": self.law.A}[what](F))

    def _scale(self, what: str) -> float:
        """The largest value in the generic states."""
        if what not in self.scales:
            self.scales[what] = max(float(np.abs(self._value(what, F)).max()) for F in self.law.generic) or np.inf
        return self.scales[what]

    def _relative(self, what: str, error: Array, limit: float, reason: str) -> Measurement:
        scale = self._scale(what)
        measured = float(np.abs(error).max()) / scale if np.isfinite(scale) else float("nan")  # a law that is zero is none
        return {
            "measured": measured,
            "limit": limit,
            "scale": f"{scale:.3e} (largest |{what}| in strained states)",
            "reason": reason,
        }

    def _lower(self, what: str) -> str:
        return "P" if what == "A" and "P" in self.has else "W"

    def _derivative(self, what: str, F: Array) -> tuple[Callable[[float], Array], Array]:
        """The function along a line whose derivative is tested, and the derivative that is claimed."""
        lower, D = self._lower(what), self.along
        if what == "A" and lower == "W":

            def slope(s: float) -> Array:
                steps = ((n, w * (self.law.W(F + (s + 1e-2 * n) * D) - self.law.W(F + (s - 1e-2 * n) * D))) for n, w in SIXTH)
                return np.asarray(sum(difference for _, difference in steps) / 1e-2)

            return slope, np.asarray(np.einsum("ij,ijkl,kl", D, self.law.A(F), D))
        if what == "P":
            return lambda s: self._value("W", F + s * D), np.asarray(np.sum(self.law.P(F) * D))
        return lambda s: self._value("P", F + s * D), np.einsum("ijkl,kl->ij", self.law.A(F), D)

    def _taylor(self, what: str, F: Array) -> Measurement:
        """2 minus the order of remainders, for the worst pair of steps above round-off."""
        line, slope = self._derivative(what, F)
        steps, start = 0.02 * 0.25 ** np.arange(7), line(0.0)
        scale = self._scale(self._lower(what)) + float(np.abs(slope).max())
        remainders = np.array([np.abs(line(h) - start - h * slope).max() for h in steps])
        reason = "remainders of Taylor's formula have order 2; between the smallest steps above round-off it is at least 1.9"
        result = {"limit": 0.1, "scale": "1 (2 minus the order)", "reason": reason}
        if not np.isfinite(remainders).all():
            return {"measured": float("nan"), **result}
        seen = remainders[remainders > 1e-11 * scale]
        if len(seen) < 2:
            return {"measured": 0.0, **result}
        orders = np.log(seen[:-1] / seen[1:]) / np.log(4)
        return {"measured": max(0.0, 2 - float(orders[-2:].max())), **result}

    def _exactly(self, what: str, F: Array) -> Measurement:
        """By the five-point stencil, which is exact if the function is a quartic along lines."""
        if what == "A" and "P" not in self.has:
            raise NotApplicable("a second derivative of W has no five-point stencil of its own; its Taylor test is held")
        line, slope = self._derivative(what, F)
        try:
            at = {n: line(0.5 * n) for n in range(-4, 5)}
        except Foul as foul:
            raise NotApplicable(f"the law is no polynomial: {foul}") from foul
        largest = max(float(np.abs(value).max()) for value in at.values())
        fifth = [at[n + 3] - 5 * at[n + 2] + 10 * at[n + 1] - 10 * at[n] + 5 * at[n - 1] - at[n - 2] for n in (-2, -1, 0, 1)]
        if not np.isfinite(largest) or not np.abs(fifth).max() <= 1e-11 * largest:
            raise NotApplicable("the law is no polynomial of degree four along lines")
        stencil = (at[-2] - 8 * at[-1] + 8 * at[1] - at[2]) / 6
        return {
            "measured": float(np.abs(stencil - slope).max()) / (largest or np.inf),
            "limit": 1e-11,
            "scale": f"{largest:.3e} (largest value along the line)",
            "reason": "round-off of a stencil that is exact for polynomials of degree four",
        }

    def _objectivity(self, what: str, F: Array) -> Measurement:
        Q = self.turn
        turned, value = self._value(what, Q @ F), self._value(what, F)
        if what != "W":
            value = Q @ value if what == "P" else np.einsum("ai,bk,ijkl->ajbl", Q, Q, value)
        return self._relative(what, turned - value, self._limit(what), _ROUND)

    def _isotropy(self, what: str, F: Array) -> Measurement:
        Q = self.turn
        turned, value = self._value(what, F @ Q), self._value(what, F)
        if what != "W":
            value = value @ Q if what == "P" else np.einsum("ijkl,ja,lb->iakb", value, Q, Q)
        return self._relative(what, turned - value, self._limit(what), _ROUND)

    def _limit(self, what: str) -> float:
        """Round-off; of a C whose geometric part is a derivative by differences, what those leave."""
        return 1e-7 if what == "A" and self.law.reading["A"].kind == "C" and "P" not in self.has else 1e-10

    def _agreement(self, what: str, F: Array) -> Measurement:
        assert self.tensor is not None
        return self._relative(what, self._value(what, F) - self._claimed(what, F), self._limit(what), _ROUND)

    def _claimed(self, what: str, F: Array) -> Array:
        assert self.tensor is not None
        if what == "W":
            return np.asarray(stvk_energy(self.tensor, F))
        P = stvk_stress(self.tensor, F)
        return P if what == "P" else material_part(self.tensor, F, Reading("C")) + geometric_part(P, F)

    def _moments(self, F: Array) -> Measurement:
        moments = self.law.P(F) @ F.T
        return self._relative("P", moments - moments.T, 1e-10, "tau = P F' is symmetric, to round-off")

    def _major(self, F: Array) -> Measurement:
        A = self.law.A(F)
        return self._relative("A", A - A.transpose(2, 3, 0, 1), self._limit("A"), "A is a second derivative, to round-off")

    def _minor(self, F: Array) -> Measurement:
        C = second_of(self.law.A(F), F, self.law.any_stress(F))
        error = np.maximum(np.abs(C - C.transpose(1, 0, 2, 3)), np.abs(C - C.transpose(0, 1, 3, 2)))
        limit = 1e-10 if "P" in self.has else 1e-7
        if not self.has & {"W", "P"} and not self.stvk:
            raise CannotTell("C is what remains of A without the stress, which is not given. Give stress= or energy=.") \
                if self.law.reading["A"].kind != "C" else NotApplicable("without a stress C stands as it is given")  # fmt: skip
        return self._relative("A", error, limit, _ROUND)

    def _rest(self, what: str) -> Measurement:
        return self._relative(what, self._value(what, np.eye(self.law.d)), 1e-10, "a body at rest has neither energy nor stress")

    def moduli(self, what: str) -> Array:
        """(d, d, d, d) moduli at rest of W, of P or of A."""
        one = np.eye(self.law.d)
        if what == "A":
            return self.law.A(one)
        return differences(self.law.P if what == "P" else partial(differences, self.law.W, h=1e-2), one, 1e-2)

    def _moduli(self, what: str) -> Measurement:
        assert self.tensor is not None
        scale = float(np.abs(self.tensor).max())
        error = float(np.abs(self.moduli(what) - self.tensor).max()) / scale
        reason = "differences of sixth order" if what != "A" else "round-off, and of a C stresses by differences"
        return {"measured": error, "limit": 1e-7, "scale": f"{scale:.3e} (largest modulus of the claim)", "reason": reason}

    def _inversion(self, what: str) -> Measurement:
        """St. Venant-Kirchhoff is defined there; another law is either defined with its stress and tangent, or none is."""
        mirrored = self.law.generic[0] @ np.diag([-1.0, *[1.0] * (self.law.d - 1)])
        if self.stvk:
            return self._agreement(what, mirrored)
        defined = {other: self._defined(other, mirrored) for other in self.has}
        reason = "W, P and A are all defined where det F < 0, or none is"
        return {"measured": float(len(set(defined.values())) - 1), "limit": 0.0, "scale": "1", "reason": reason}

    def _defined(self, what: str, F: Array) -> bool:
        try:
            return bool(np.isfinite(self._value(what, F)).all())
        except Foul:
            return False

    def _tangent(self, F: Array) -> Array:
        if "A" in self.has:
            return self.law.A(F)
        return differences(self.law.P, F, 2e-3) if "P" in self.has else second_differences(self.law.W, F)

    def _elliptic(self, F: Array) -> Measurement:
        A = self._tangent(F)
        least, scale = least_wave(A), float(np.abs(A).max())
        words = "the smallest eigenvalue of the acoustic tensor is positive in all directions tried"
        return {"measured": -least / (scale or np.nan), "limit": -1e-9, "scale": f"{scale:.3e} (largest |A|)", "reason": words}

    def facts(self) -> list[str]:
        """Lines on moduli, inversion and strong ellipticity."""
        lines = []
        for what, word in (("W", "energy"), ("P", "stress"), ("A", "elasticity")):
            if what in self.has and self.isotropic:
                lines += self._ratios(what, word)
        if "W" in self.has:
            lines.append(self._when_crushed())
        for name, path in _PATHS.items():
            lines += self._loss(name, path)
        return lines

    def _ratios(self, what: str, word: str) -> list[str]:
        assert self.tensor is not None
        try:
            lam, mu, rest = lame_of(self.moduli(what))
        except Foul:
            return []
        true, shear, _ = lame_of(self.tensor)
        if not np.isfinite(rest):
            return [f"{word} at rest: the moduli are not numbers"]
        if rest > 1e-6:
            return [f"{word} at rest: the moduli are not isotropic"]
        if abs(lam - true) < 1e-6 * abs(true) and abs(mu - shear) < 1e-6 * shear:
            return []
        compared = f"lambda is {lam / true:.3f} x" if true else f"lambda is {lam:.4g}, which should be 0"
        return [f"{word} at rest: {compared}, mu is {mu / shear:.3f} x that of the claim"]

    def _when_crushed(self) -> str:
        flat, mirrored = (np.diag([s, *[1.0] * (self.law.d - 1)]) for s in (1e-6, -1.0))
        words = []
        for state, F in (("nearly flat", flat), ("mirrored", mirrored)):
            try:
                W = self.law.W(F)
                words.append(f"W = {W:.4g} when {state}")
            except Foul:
                words.append(f"W is not defined when {state}")
        return "inversion: " + ", ".join(words)

    def _loss(self, name: str, path: Callable[[float, int], Array]) -> list[str]:
        """The stretch at which strong ellipticity is lost first, by halving."""
        try:
            steps = np.linspace(0, 1, 31)[1:]
            waves = [least_wave(self._tangent(path(s, self.law.d))) for s in steps]
            if not np.isfinite(waves).all():
                return [f"strong ellipticity in {name} is not known: the tangent is not a number somewhere on the way"]
            signs = [wave > 0 for wave in waves]
            if all(signs):
                return [f"strong ellipticity is kept in {name} to a stretch of {path(1.0, self.law.d)[0, 0]:.2f}"]
            first = signs.index(False)
            low, high = (0.0 if first == 0 else float(steps[first - 1])), float(steps[first])
            for _ in range(12):
                middle = (low + high) / 2
                low, high = (middle, high) if least_wave(self._tangent(path(middle, self.law.d))) > 0 else (low, middle)
            return [f"strong ellipticity is lost in {name} at a stretch of {path(high, self.law.d)[0, 0]:.4f}"]
        except (Foul, np.linalg.LinAlgError):
            return []


_ROUND = "round-off; 1e-7 where a stress or tangent is taken by differences"
_PATHS: dict[str, Callable[[float, int], Array]] = {
    "uniaxial compression": lambda s, d: np.diag([1 - 0.9 * s, *[1.0] * (d - 1)]),
    "uniaxial extension": lambda s, d: np.diag([1 + s, *[1.0] * (d - 1)]),
}


def lame_of(C: Array) -> tuple[float, float, float]:
    """(lambda, mu) nearest to a tensor (d, d, d, d), and the relative residual."""
    one = np.eye(C.shape[0])
    spherical = np.einsum("ij,kl->ijkl", one, one)
    shear = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    basis = np.stack([spherical.ravel(), shear.ravel()], axis=1)
    (lam, mu), *_ = np.linalg.lstsq(basis, np.nan_to_num(C.ravel()), rcond=None)
    rest = np.abs(basis @ (lam, mu) - C.ravel()).max() / (np.abs(C).max() or 1.0)
    return float(lam), float(mu), float(rest)


def least_wave(A: Array) -> float:
    """The smallest eigenvalue of the acoustic tensors `A_iJkL N_J N_L` of unit vectors N, over a net of directions."""
    d = A.shape[0]
    if not np.isfinite(A).all():
        return float("nan")
    if d == 2:
        angles = np.linspace(0, np.pi, 48, endpoint=False)
        N = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        z, turn = np.linspace(-1, 1, 15), np.linspace(0, 2 * np.pi, 24, endpoint=False)
        r = np.sqrt(1 - z**2)
        N = np.array([(a * np.cos(t), a * np.sin(t), b) for a, b in zip(r, z, strict=True) for t in turn] + [*np.eye(3)])
    Q = np.einsum("ijkl,nj,nl->nik", A, N, N)
    return float(np.linalg.eigvalsh((Q + Q.transpose(0, 2, 1)) / 2).min())
