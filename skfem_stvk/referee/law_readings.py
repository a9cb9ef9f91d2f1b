"""Readings of a stress or a tangent: stress measures, tangents and Voigt orders, and their conversion to P and A = dP/dF.

`JudgedLaw` finds the readings that fit the values of a law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..arguments import Array, real_array, shown
from ..errors import StvkError
from .case import random_rotation
from .implementations import ContractViolation, guarded

MEASURES = ("P", "S", "sigma", "tau", "P transposed")
TANGENTS = ("A", "C", "A transposed")
#: Index pairs of the shears in each Voigt order. Normal components are first.
ORDERS = {"23-13-12": ((1, 2), (0, 2), (0, 1)), "12-13-23": ((0, 1), (0, 2), (1, 2)), "12-23-13": ((0, 1), (1, 2), (0, 2))}
#: Largest relative residual of a reading that fits. Differences of sixth order are accurate to about 1e-10, taken twice to 1e-8.
FITS = 1e-6
SIXTH = ((1, 45 / 60), (2, -9 / 60), (3, 1 / 60))  # antisymmetric weights of the derivative of sixth order
ARGUMENT = {"W": "energy", "P": "stress", "A": "elasticity"}
Declared = dict[str, tuple[str | None, str | None, bool | None]]


@dataclass(frozen=True)
class Reading:
    """Meaning of an array: its kind (of `MEASURES` or `TANGENTS`), and for Voigt arrays the order of shears.

    `engineering` says whether a Voigt matrix acts on engineering shear strain `2 E_ij`.
    """

    kind: str
    order: str | None = None
    engineering: bool | None = None

    def __str__(self) -> str:
        words = [self.kind] + ([f"in the order {self.order}"] if self.order else [])
        words += [] if self.engineering is None else [f"{'' if self.engineering else 'no '}engineering shear"]
        return ", ".join(words)


def readings_of_stress(shape: tuple[int, ...], d: int) -> list[Reading]:
    """Return all readings of a stress of this shape, or an empty list for any other shape."""
    if shape == (d, d):
        return [Reading(kind) for kind in MEASURES]
    return [Reading(kind, order) for kind in ("S", "sigma", "tau") for order in _orders(d)] if shape == (_voigt(d),) else []


def readings_of_tangent(shape: tuple[int, ...], d: int) -> list[Reading]:
    """Return all readings of a tangent of this shape: (d, d, d, d), A as a (d^2, d^2) matrix by rows, or a Voigt matrix of C."""
    if shape == (d, d, d, d):
        return [Reading(kind) for kind in TANGENTS]
    if shape == (d * d, d * d):
        return [Reading("A"), Reading("A transposed")]
    voigt = [Reading("C", order, engineering) for engineering in (True, False) for order in _orders(d)]
    return voigt if shape == (_voigt(d), _voigt(d)) else []


def _voigt(d: int) -> int:
    return d * (d + 1) // 2


def _orders(d: int) -> list[str]:
    return list(ORDERS) if d == 3 else ["12"]


def _indices(order: str | None, d: int) -> tuple[Array, Array]:
    shear = ORDERS.get(order or "12", ((0, 1),))
    pairs = np.array([*((i, i) for i in range(d)), *shear])
    return pairs[:, 0], pairs[:, 1]


def nominal_stress(value: Array, F: Array, reading: Reading) -> Array:
    """Return `P` (d, d) for a stress in a given reading: `P = F S = J sigma F^-T = tau F^-T`."""
    if value.ndim == 1:
        i, j = _indices(reading.order, len(F))
        full = np.zeros_like(F)
        full[i, j] = full[j, i] = value
        value = full
    if reading.kind in ("P", "P transposed"):
        return value if reading.kind == "P" else value.T
    if reading.kind == "S":
        return F @ value
    pulled = value @ np.linalg.inv(F).T
    return pulled * np.linalg.det(F) if reading.kind == "sigma" else pulled


def geometric_part(P: Array, F: Array) -> Array:
    """Return the geometric part of A, `delta_ik S_JL` (d, d, d, d), with `S = F^-1 P`."""
    return np.einsum("ik,jl->ijkl", np.eye(len(F)), np.linalg.solve(F, P))


def nominal_tangent(value: Array, F: Array, P: Array, reading: Reading) -> Array:
    """Return `A_iJkL = dP_iJ/dF_kL` (d, d, d, d) for a tangent in a given reading.

    For `C = dS/dE`, `A_iJkL = F_iM F_kN C_MJNL + delta_ik S_JL`.
    """
    d = len(F)
    if reading.kind != "C":
        value = value.reshape(d, d, d, d)
        return value if reading.kind == "A" else value.transpose(1, 0, 3, 2)
    return material_part(value, F, reading) + geometric_part(P, F)


def full_tensor(value: Array, reading: Reading, d: int) -> Array:
    """Return `C_MJNL` (d, d, d, d) of a tangent C, which may be a Voigt matrix."""
    if value.ndim == 4:
        return value
    i, j = _indices(reading.order, d)
    matrix = value.copy()
    if not reading.engineering:  # the shear columns act on E_ij, which represents E_ij and E_ji
        matrix[:, d:] /= 2
    full = np.zeros((d, d, d, d))
    for a, b in ((i, j), (j, i)):
        for k, l in ((i, j), (j, i)):
            full[a[:, None], b[:, None], k, l] = matrix
    return full


def material_part(value: Array, F: Array, reading: Reading) -> Array:
    """Return `F_iM F_kN C_MJNL` for a tangent C."""
    return np.einsum("im,kn,mjnl->ijkl", F, F, full_tensor(value, reading, len(F)))


def material_tangent(A: Array, F: Array, P: Array) -> Array:
    """Return `C_MJNL` (d, d, d, d) for A: subtract the geometric part, and pull back the first index of each pair."""
    inverse = np.linalg.inv(F)
    return np.einsum("mi,nk,ijkl->mjnl", inverse, inverse, A - geometric_part(P, F))


#: Wrong geometric parts of A, by the words of a report, for P and F.
WRONG_GEOMETRIC: dict[str, Callable[[Array, Array], Array]] = {
    "without its geometric term": lambda P, F: 0 * geometric_part(P, F),
    "with the wrong sign of its geometric term": lambda P, F: -geometric_part(P, F),
    "with the Cauchy stress in its geometric term": lambda P, F: geometric_part(F @ P @ F.T / np.linalg.det(F), F),
}


class Fit(NamedTuple):
    """Relative residual of a reading, and the correction that makes it fit.

    The correction is a factor or the geometric term. There is none if the factor is 1 and `geometric` is empty.
    """

    residual: float
    factor: float = 1.0
    geometric: str = ""

    @property
    def words(self) -> str:
        """Description of the correction, empty if there is none."""
        if self.geometric:
            return f"it is the expected value {self.geometric}"
        return "" if self.factor == 1 else f"it is {self.factor:.3f} x the expected value"


class JudgedLaw:
    """W, P and A = dP/dF from the user's functions, each converted by its reading. All returned values are validated."""

    def __init__(self, functions: dict[str, Callable[[Array], Any]], d: int, rng: np.random.Generator) -> None:
        self.functions, self.d = dict(functions), d
        self.reading: dict[str, Reading] = {}
        #: For a stress or tangent that does not fit as declared, a reading that would fit, with its residual.
        self.fitting_readings: dict[str, tuple[Reading, Fit]] = {}
        self.before: dict[str, float] = {}
        #: Names of the functions that have changed their argument.
        self.changing: set[str] = set()
        self.tried = 0
        one = np.eye(d)
        self.generic = [random_rotation(d, rng) @ (one + 0.3 * rng.uniform(-1, 1, (d, d))) for _ in range(3)]
        self.rotation = random_rotation(d, rng, 70.0)

    def value(self, name: str, F: Array) -> Array:
        """Return the function's result as a new array of real numbers.

        Raise `ContractViolation` if it has another type or shape.
        """
        given = F.copy()
        with np.errstate(all="ignore"):  # the law may take the logarithm of a negative det F
            returned = guarded(f"{name}(F)", lambda: self.functions[name](given))
        if not np.array_equal(given, F):
            self.changing.add(name)
        values = real_array(guarded(f"{name}(F)", lambda: np.array(returned, dtype=None)))
        if values is None or (name == "W" and values.size != 1):
            raise ContractViolation(
                f"{name}(F) returned {shown(returned)}; expected {'one number' if name == 'W' else 'real numbers'}."
            )
        if name != "W" and name in self.reading and values.shape != self.shape[name]:
            raise ContractViolation(f"{name}(F) returned shape {values.shape}; before it was {self.shape[name]}.")
        return np.array(values)

    def W(self, F: Array) -> float:
        return float(self.value("W", F).reshape(()))

    def P(self, F: Array) -> Array:
        return nominal_stress(self.value("P", F), F, self.reading["P"])

    def A(self, F: Array) -> Array:
        return nominal_tangent(self.value("A", F), F, self.any_stress(F), self.reading["A"])

    def any_stress(self, F: Array) -> Array:
        """Return P, else the derivative of W, else the claimed stress, else zero.

        The last two cases are those of a tangent without stress and energy.
        """
        if "P" in self.functions:
            return self.P(F)
        if "W" in self.functions:
            return differences(self.W, F, 2e-3)
        return self.claimed(F) if self.claimed is not None else np.zeros_like(F)

    claimed: Callable[[Array], Array] | None = None
    shape: dict[str, tuple[int, ...]]
    _reference_tangents: list[Array] | None = None

    def tangent_by_differences(self, F: Array) -> Array | None:
        """Return A (d, d, d, d) by differences of P, or else of W. Return None if there is neither."""
        if "P" in self.functions:
            return differences(self.P, F, 2e-3)
        return differences(lambda G: differences(self.W, G, 1e-2), F, 1e-2) if "W" in self.functions else None

    def read(self, declared: Declared, tensor: Array | None, stvk: bool) -> list[str]:
        """Choose the readings of stress and tangent, and return lines that describe them.

        Raise StvkError if a function fails, or its result has no reading that agrees with `declared`.
        """
        self.shape, lines = {}, []
        if tensor is not None and stvk:
            self.claimed = lambda F: stvk_stress(tensor, F)
        for name, readings_of, fits in (
            ("P", readings_of_stress, self._stress_fits),
            ("A", readings_of_tangent, self._tangent_fits),
        ):
            if name not in self.functions:
                continue
            word = ARGUMENT[name]
            try:
                self.shape[name] = self.value(name, self.generic[0]).shape
            except ContractViolation as violation:
                raise StvkError(f"{word}: {violation}") from violation
            known = readings_of(self.shape[name], self.d)
            if not known:
                raise StvkError(f"{word} returned an array of shape {self.shape[name]}; expected {_EXPECTED[name][self.d]}.")
            kind, order, engineering = declared[name]
            allowed = [
                r
                for r in known
                if kind in (None, r.kind) and (order in (None, r.order) or r.order in (None, "12")) and
                (engineering is None or r.engineering in (None, engineering))
            ]  # fmt: skip
            if not allowed:
                raise StvkError(
                    f"{word} returned an array of shape {self.shape[name]}; expected one that fits the declared measure, tangent, "
                    f"voigt and engineering. This shape may be: {'; '.join(map(str, known))}."
                )
            lines.append(self._chosen(name, known, allowed, fits))
        return lines

    def _chosen(self, name: str, known: list[Reading], allowed: list[Reading], fits: Callable[[Reading], Fit]) -> str:
        found: dict[Reading, Fit] = {}
        for reading in known:
            self.reading[name] = reading
            try:
                found[reading] = fits(reading)
            except ContractViolation:
                found[reading] = Fit(np.inf)
        self.tried += len(known)
        good = [r for r in known if found[r].residual < FITS]
        agreeing = [r for r in allowed if r in good]
        named = [r for r in allowed if found[r].words]
        self.reading[name] = (agreeing or named or sorted(allowed, key=lambda r: found[r].residual))[0]
        if agreeing:
            origin = "declared" if len(allowed) == 1 else "guessed"
            return f"{ARGUMENT[name]} read as {agreeing[0]} ({origin})" + "".join(f"; or {r}" for r in agreeing[1:])
        fitting = good or named or [r for r in known if found[r].words]
        if fitting:
            self.fitting_readings[name] = fitting[0], found[fitting[0]]
        self.before[name] = found[self.reading[name]].residual
        return f"{ARGUMENT[name]} read as {self.reading[name]}, which does not fit"

    def _stress_fits(self, reading: Reading) -> Fit:
        """Return the fit of a reading to the derivative of W.

        Without W, the residual is the largest violation of the balance of moments, objectivity and major symmetry.
        """
        given = np.array([nominal_stress(self.value("P", F), F, reading) for F in self.generic])
        if "W" in self.functions:
            return fitted(given, np.array([differences(self.W, F, 2e-3) for F in self.generic]))
        worst = 0.0
        for F, P in zip(self.generic, given, strict=True):
            scale = np.abs(P).max() or 1.0
            moments, A = P @ F.T, differences(self.P, F, 2e-3)
            worst = max(worst, float(np.abs(moments - moments.T).max() / scale))
            worst = max(worst, float(np.abs(self.P(self.rotation @ F) - self.rotation @ P).max() / scale))
            worst = max(worst, float(np.abs(A - A.transpose(2, 3, 0, 1)).max() / (np.abs(A).max() or 1.0)))
        return Fit(worst if np.isfinite(worst) else np.inf)

    def _tangent_fits(self, reading: Reading) -> Fit:
        at = [(self.any_stress(F), F) for F in self.generic]
        given = [nominal_tangent(self.value("A", F), F, P, reading) for P, F in at]
        true = self._tangents_in_generic_states()
        if not true:
            return Fit(self._objectivity_error(reading))
        A, B, G = np.array(given), np.array(true), np.array([geometric_part(P, F) for P, F in at])
        fit = fitted(A, B) if reading.kind != "C" else fitted(A - G, B - G)
        for name, part in WRONG_GEOMETRIC.items() if reading.kind != "C" and not fit.words and fit.residual > FITS else ():
            if fitted(A, B - G + np.array([part(P, F) for P, F in at])).residual < FITS:
                return Fit(fit.residual, geometric=name)
        return fit

    def _tangents_in_generic_states(self) -> list[Array]:
        """Return A in the generic states by differences of P, W or the claimed stress, or an empty list without them."""
        if self._reference_tangents is None:
            self._reference_tangents = []
            for F in self.generic:
                A = self.tangent_by_differences(F)
                if A is None and self.claimed is not None:
                    A = differences(self.claimed, F, 2e-3)
                if A is not None:
                    self._reference_tangents.append(A)
        return self._reference_tangents

    def _objectivity_error(self, reading: Reading) -> float:
        """Return the largest violation of symmetry and objectivity by a tangent without stress and energy."""
        worst, d = 0.0, self.d
        for F in self.generic:
            if reading.kind == "C":
                one = np.eye(d)
                first, rotated = (material_part(self.value("A", G), one, reading) for G in (F, self.rotation @ F))
                first_symmetric = np.abs(first - first.transpose(1, 0, 2, 3)).max()
            else:
                first, rotated = (nominal_tangent(self.value("A", G), G, 0 * F, reading) for G in (F, self.rotation @ F))
                rotated, first_symmetric = np.einsum("ai,bk,ijkl->ajbl", self.rotation.T, self.rotation.T, rotated), 0.0
            errors = np.abs(rotated - first).max(), np.abs(first - first.transpose(2, 3, 0, 1)).max(), first_symmetric
            worst = max(worst, float(max(errors) / (np.abs(first).max() or 1.0)))
        return worst if np.isfinite(worst) else np.inf


_EXPECTED = {
    "P": {2: "(2, 2), or (3,) in Voigt order", 3: "(3, 3), or (6,) in Voigt order"},
    "A": {2: "(2, 2, 2, 2), (4, 4), or (3, 3) in Voigt order", 3: "(3, 3, 3, 3), (9, 9), or (6, 6) in Voigt order"},
}


def differences(function: Callable[[Array], Any], F: Array, h: float) -> Array:
    """Return the derivative with respect to F, (..., d, d), by central differences of sixth order."""
    d, columns = len(F), []
    for i, j in product(range(d), range(d)):
        step = np.zeros((d, d))
        step[i, j] = h
        columns.append(sum(w * (np.asarray(function(F + n * step)) - function(F - n * step)) for n, w in SIXTH) / h)
    return np.moveaxis(np.array(columns), 0, -1).reshape(*np.shape(columns[0]), d, d)


def second_differences(function: Callable[[Array], float], F: Array, h: float = 1e-3) -> Array:
    """Return the second derivatives of a number with respect to F, (d, d, d, d), by differences of second order.

    This accuracy is sufficient to find a change of sign.
    """
    d = len(F)
    steps = h * np.eye(d * d).reshape(-1, d, d)
    H = np.zeros((d * d, d * d))
    for a, b in product(range(d * d), range(d * d)):
        if a <= b:
            D, E = steps[a], steps[b]
            mixed = function(F + D + E) - function(F + D - E) - function(F - D + E) + function(F - D - E)
            H[a, b] = H[b, a] = mixed / (4 * h * h)
    return H.reshape(d, d, d, d)


def fitted(given: Array, true: Array) -> Fit:
    """Return the relative residual of `given = true`, and the factor c if `given = c true` with c other than 1."""
    scale = np.abs(true).max() or 1.0
    residual = float(np.abs(given - true).max() / scale)
    if not np.isfinite(residual):
        return Fit(np.inf)
    c = float((given * true).sum() / ((true * true).sum() or 1.0))
    explained = abs(c) > FITS and np.abs(given - c * true).max() / scale / abs(c) < FITS
    return Fit(residual, c if explained and residual > FITS else 1.0)


def stvk_energy(tensor: Array, F: Array) -> float:
    """Return `1/2 E : C : E`."""
    E = (F.T @ F - np.eye(len(F))) / 2
    return float(np.einsum("ij,ijkl,kl", E, tensor, E) / 2)


def stvk_stress(tensor: Array, F: Array) -> Array:
    """Return `P = F (C : E)`."""
    return F @ np.einsum("ijkl,kl->ij", tensor, (F.T @ F - np.eye(len(F))) / 2)
