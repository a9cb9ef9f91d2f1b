"""Naming of the fault of a constitutive law: a repair of its functions after which every check passes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..arguments import Array
from ..errors import StvkError
from .checks.constitutive import LawChecks
from .implementations import ContractViolation
from .law_readings import (
    ARGUMENT,
    FITS,
    WRONG_GEOMETRIC,
    Declared,
    JudgedLaw,
    Reading,
    fitted,
    full_tensor,
    geometric_part,
    material_part,
    nominal_stress,
    stvk_energy,
    stvk_stress,
)
from .moduli import engineering_constants
from .reference import lame_tensor
from .results import CheckOutcome, Explanation, Naming, Result, largest

#: Relative distance below which moduli are equal. Differences of sixth order, taken twice, are accurate to 1e-8.
SAME = 1e-6
SELF_EXPLAINING = {"inversion", "strong ellipticity", "unchanged argument"}  # the names of these checks state the fault


def named_law(law: JudgedLaw, checks: LawChecks, declared: Declared, results: list[Result]) -> Naming | None:
    """Return the explanation of all failures, or None if no failure needs a name.

    Moduli at rest are compared with the claims first. Then the repaired stress and tangent are read again. The repairs are an
    explanation if the law with all repairs passes every check.
    """
    failures = [result for result in results if result.outcome is CheckOutcome.FAILED and result.check not in SELF_EXPLAINING]
    if not failures:
        return None
    naming = Naming(tried=law.tried, before=largest(failures))
    repair = _Repair(law, checks, declared)
    try:
        after = repair.results()
    except (ContractViolation, StvkError, np.linalg.LinAlgError):  # the repaired law may fail in the same ways as the law
        after = []
    naming.tried += len(law.functions) * (checks.isotropic + checks.stvk)
    if repair.found and after and not any(result.outcome is CheckOutcome.FAILED for result in after):
        residual = largest(r for r in after if r.outcome is CheckOutcome.PASSED and r.check not in SELF_EXPLAINING)
        names, words = zip(*repair.found, strict=True)
        naming.explain([Explanation("; ".join(names), "; ".join(words), residual)])
        return naming
    size = {name: float(np.abs(F.T @ F - np.eye(law.d)).max()) for name, F in checks.states.items()}
    mildest_state = min((result.state for result in failures), key=lambda name: size.get(name, np.inf))
    not_finite = any(
        result.state == mildest_state and np.isnan(result.measured) for result in failures if result.measured is not None
    )
    part = "; ".join(words for _, words in repair.found)
    naming.smallest = (
        f"The failing state nearest to rest is {mildest_state!r}{', where the law is not finite' if not_finite else ''}."
    )
    naming.smallest += f" A part is explained: {part}." if part else ""
    return naming


class _Repair:
    """Law whose functions are repaired one by one, with a description of each repair."""

    def __init__(self, law: JudgedLaw, checks: LawChecks, declared: Declared) -> None:
        self.law, self.checks, self.declared = law, checks, dict(declared)
        self.functions: dict[str, Callable[[Array], Any]] = dict(law.functions)
        self.tensor = checks.tensor
        self.found: list[tuple[str, str]] = []

    def results(self) -> list[Result]:
        """Return the results of all checks of the repaired law."""
        if self.checks.isotropic:
            self._moduli()
        if self.tensor is not None and self.checks.stvk:
            self._linear(self.tensor)
        for _ in range(3):  # the stress, the tangent, and a final check
            law = JudgedLaw(self.functions, self.law.d, np.random.default_rng(1))
            law.read(self.declared, self.tensor, self.checks.stvk)
            if not law.fitting_readings:
                break
            self._reading(law, next(iter(law.fitting_readings)))
        checks = LawChecks(law, self.checks.states, self.tensor, self.checks.claims, np.random.default_rng(2))
        return [task.run() for task in checks.tasks()]

    def _moduli(self) -> None:
        """Repair moduli at rest that differ from the claims, either of all functions by other claims, or of each function."""
        assert self.tensor is not None
        lam, mu, _ = lame_of(self.tensor)
        found = {quantity: lame_of(self.checks.moduli(quantity)) for quantity in self.functions}
        found = {quantity: one for quantity, one in found.items() if one[2] < SAME and abs(one[1]) > SAME * mu}
        wrong = {
            quantity: one[:2]
            for quantity, one in found.items()
            if max(abs(one[0] - lam), abs(one[1] - mu)) > SAME * (abs(lam) + mu)
        }
        if not wrong:
            return
        first = next(iter(wrong.values()))
        alike = all(np.allclose(one, first, rtol=SAME, atol=SAME * mu) for one in wrong.values())
        if alike and len(wrong) == len(self.functions):
            claims = self.checks.claims
            name, words = _moduli_in_words("", *first, lam, mu)
            constants = engineering_constants(*first, claims.material, claims.plane == "stress")
            self.found.append((name, words + constants))
            self.tensor = lame_tensor(*first, self.law.d)
            return
        for quantity, (other, shear) in wrong.items():
            c = shear / mu
            if abs(other - c * lam) < SAME * (abs(other) + mu):
                self._scaled(quantity, c)
            elif self.checks.stvk:
                self._of_other_constants(quantity, lame_tensor(other, shear, self.law.d))
            self.found.append(_moduli_in_words(ARGUMENT[quantity], other, shear, lam, mu))

    def _linear(self, tensor: Array) -> None:
        """Repair an energy or stress that is that of linear elasticity."""
        found = []
        for quantity in self.functions.keys() & {"W", "P"}:
            at = [(self._raw(quantity, F), *linear(tensor, F)) for F in self.law.generic]
            given = np.array([raw for raw, *_ in at])
            fit = fitted(given, np.array([W if quantity == "W" else sigma for _, W, sigma in at]))
            if fit.residual < FITS:
                found.append(quantity)
        for quantity in found:
            self.functions[quantity] = partial(stvk_energy if quantity == "W" else stvk_stress, tensor)
        if "P" in found:
            self.declared["P"] = "P", None, None
        if found:
            words = " and ".join(ARGUMENT[quantity] for quantity in sorted(found, reverse=True))
            self.found.append(("linear strain", f"the {words} {'are those' if len(found) > 1 else 'is that'} of linear elasticity"))

    def _raw(self, quantity: str, F: Array) -> Array:
        """Return the number, or the full (d, d) matrix, that the function returned, without conversion to P."""
        value = self.law.value(quantity, F)
        return value.reshape(()) if quantity == "W" else nominal_stress(value, F, Reading("P", self.law.reading["P"].order))

    def _scaled(self, quantity: str, c: float) -> None:
        raw = partial(self.law.value, quantity)
        self.functions[quantity] = lambda F: raw(F) / c
        if quantity != "W":
            self._declare(quantity, self.law.reading[quantity])

    def _declare(self, quantity: str, reading: Reading) -> None:
        self.declared[quantity] = reading.kind, reading.order, reading.engineering

    def _of_other_constants(self, quantity: str, other: Array) -> None:
        """Repair a function: subtract St. Venant-Kirchhoff with its own constants, and add that with the claimed constants."""
        law, tensor = self.law, self.tensor
        assert tensor is not None
        if quantity == "W":
            self.functions[quantity] = lambda F: law.W(F) + stvk_energy(tensor - other, F)
        elif quantity == "P":
            self.functions[quantity] = lambda F: law.P(F) + stvk_stress(tensor - other, F)
            self.declared[quantity] = "P", None, None
        elif law.reading[quantity].kind == "C":
            self.functions[quantity] = lambda F: full_tensor(law.value(quantity, F), law.reading[quantity], law.d) + tensor - other
            self.declared[quantity] = "C", None, None
        else:
            more = tensor - other
            self.functions[quantity] = lambda F: (
                law.A(F) + material_part(more, F, Reading("C")) + geometric_part(stvk_stress(more, F), F)
            )
            self.declared[quantity] = "A", None, None

    def _reading(self, law: JudgedLaw, quantity: str) -> None:
        """Repair a stress or tangent that fits by another reading, by a factor, or with its geometric part added."""
        reading, fit = law.fitting_readings[quantity]
        if fit.geometric:
            law.reading[quantity] = reading

            def repaired(F: Array) -> Array:
                P = law.any_stress(F)
                return law.A(F) + geometric_part(P, F) - WRONG_GEOMETRIC[fit.geometric](P, F)

            self.functions[quantity] = repaired
            self.declared[quantity] = "A", None, None
        else:
            raw = partial(law.value, quantity)
            self.functions[quantity] = lambda F: raw(F) / fit.factor
            self._declare(quantity, reading)
        word = ARGUMENT[quantity]
        short = fit.geometric or (f"x {fit.factor:.3f}" if fit.words else f"is {reading}")
        self.found.append((f"{word} {short}", f"the {word} fits as {reading}" + (f": {fit.words}" if fit.words else "")))


def _moduli_in_words(word: str, lam: float, mu: float, true: float, shear: float) -> tuple[str, str]:
    """Return name and words for wrong moduli at rest, of the function `word`, or of all functions if `word` is empty."""
    of = f"at rest the moduli of the {word} are" if word else "at rest the moduli are"
    if abs(true) < SAME * shear:
        return (
            f"{word} lambda instead of 0".strip(),
            f"{of} lambda = {lam:.4g}, expected 0, and mu {mu / shear:.3f} x that of the claim",
        )
    if word and abs(lam / true - mu / shear) < SAME:
        return f"{word} x {mu / shear:.3f}", f"the {word} is {mu / shear:.3f} x the claimed one"
    of_lam = round(lam / true, 3) + 0.0  # no negative zero
    name = f"lambda x {of_lam:.3f}, mu x {mu / shear:.3f}"
    return f"{word}: {name}" if word else name, f"{of} lambda {of_lam:.3f} x and mu {mu / shear:.3f} x those of the claim"


def linear(tensor: Array, F: Array) -> tuple[float, Array]:
    """Return `1/2 e : C : e` and `C : e` of linear elasticity."""
    e = (F + F.T) / 2 - np.eye(len(F))
    sigma = np.einsum("ijkl,kl->ij", tensor, e)
    return float(np.sum(e * sigma) / 2), sigma


def lame_of(C: Array) -> tuple[float, float, float]:
    """Return (lambda, mu) nearest to a tensor (d, d, d, d), and the relative residual.

    The residual is infinite if the tensor has entries that are not finite.
    """
    if not np.isfinite(C).all():
        return 0.0, 0.0, np.inf
    basis = np.stack([lame_tensor(*pair, C.shape[0]).ravel() for pair in ((1, 0), (0, 1))], axis=1)
    (lam, mu), *_ = np.linalg.lstsq(basis, C.ravel(), rcond=None)
    rest = np.abs(basis @ (lam, mu) - C.ravel()).max() / (np.abs(C).max() or 1.0)
    return float(lam), float(mu), float(rest)
