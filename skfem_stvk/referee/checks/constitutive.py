"""Checks of a law at deformation gradients: derivatives, objectivity, symmetries, moduli at rest, inversion, ellipticity."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ...arguments import Array
from ...edges.materials import Isotropic
from ...terms import StVK
from ..case import random_rotation
from ..implementations import ContractViolation, Implementation
from ..judgement import relative
from ..law_readings import (
    SIXTH,
    JudgedLaw,
    Reading,
    differences,
    geometric_part,
    material_part,
    material_tangent,
    second_differences,
    stvk_energy,
    stvk_stress,
)
from ..results import CannotDecide, NotApplicable, Task
from .agreement import taylor_order

LAW = "law"
#: Angles of the rotations of objectivity and isotropy [degrees]. The sign of the trace of F changes beyond 120.
ANGLES = (35.0, 110.0, 165.0)
Measurement = dict[str, Any]


class LawChecks:
    """Tasks that check a law, and facts about it that are not checked."""

    def __init__(
        self, law: JudgedLaw, states: dict[str, Array], tensor: Array | None, claims: Any, rng: np.random.Generator
    ) -> None:
        self.law, self.states, self.tensor, self.claims = law, states, tensor, claims
        d = law.d
        self.implementation = Implementation(LAW, law, d * d)
        self.rotations = [random_rotation(d, rng, degrees) for degrees in ANGLES]
        self.along = rng.uniform(-1, 1, (d, d))
        self.has = law.functions.keys()
        self.scales: dict[str, float] = {}
        self.stvk = isinstance(claims, StVK)
        self.isotropic = claims is not None and isinstance(claims.material, Isotropic)

    def tasks(self) -> Iterator[Task]:
        """Yield every check in every state."""
        one = np.eye(self.law.d)
        for name, F in self.states.items():
            for quantity in ("P", "A"):
                if quantity in self.has and ("W" in self.has or (quantity == "A" and "P" in self.has)):
                    yield self._task("derivatives", quantity, name, self._taylor, quantity, F)
                    yield self._task("exact derivatives", quantity, name, self._exactly, quantity, F)
            for quantity in self.has:
                yield self._task("objectivity", quantity, name, self._rotated, quantity, F, [(Q, one) for Q in self.rotations])
                if self.isotropic:
                    yield self._task("isotropy", quantity, name, self._rotated, quantity, F, [(one, R) for R in self.rotations])
                if self.stvk:
                    yield self._task("agreement", quantity, name, self._agreement, quantity, F)
            if "P" in self.has:
                yield self._task("balance of moments", "P", name, self._moments, F)
            if "A" in self.has:
                yield self._task("major symmetry", "A", name, self._major, F)
                yield self._task("minor symmetries", "C", name, self._minor, F)
        for quantity in self.has:
            yield self._task("unchanged argument", quantity, "all states", self._unchanged, quantity)
            if quantity != "A":
                yield self._task("rest", quantity, "rest", self._rest, quantity)
            if self.tensor is not None:
                yield self._task("moduli at rest", quantity, "rest", self._moduli, quantity)
            if self.stvk:
                yield self._task("inversion", quantity, "mirrored", self._agreement, quantity, self._mirrored)
        if "P" not in self.has and "W" in self.has:
            yield self._task("rest", "dW/dF", "rest", self._stress_at_rest)
        yield self._task("strong ellipticity", "A", "rest", self._elliptic, one)

    def _task(self, check: str, quantity: str, state: str, measured: Callable[..., Measurement], *arguments: Any) -> Task:
        against = "St. Venant-Kirchhoff" if check == "agreement" else ""
        return Task(check, self.implementation, quantity, state, "", partial(measured, *arguments), against)

    def _value(self, quantity: str, F: Array) -> Array:
        return np.asarray({"W": self.law.W, "P": self.law.P, "A": self.law.A}[quantity](F))

    def _scale(self, quantity: str) -> float:
        """Return the largest value in the generic states."""
        if quantity not in self.scales:
            self.scales[quantity] = max(float(np.abs(self._value(quantity, F)).max()) for F in self.law.generic) or np.inf
        return self.scales[quantity]

    def _relative(self, quantity: str, error: Array, limit: float, reason: str) -> Measurement:
        scale = self._scale(quantity)
        measured = float(np.abs(error).max()) / scale if np.isfinite(scale) else float("nan")  # a law that is zero everywhere fails
        return {
            "measured": measured,
            "limit": limit,
            "scale": f"{scale:.3e} (largest |{quantity}| in strained states)",
            "reason": reason,
        }

    def _derivative(self, quantity: str, F: Array) -> tuple[Callable[[float], Array], Array]:
        """Return the function along a line whose derivative is tested, and the claimed derivative."""
        lower, D = "P" if quantity == "A" and "P" in self.has else "W", self.along
        if quantity == "A" and lower == "W":

            def slope(s: float) -> Array:
                steps = ((n, w * (self.law.W(F + (s + 1e-2 * n) * D) - self.law.W(F + (s - 1e-2 * n) * D))) for n, w in SIXTH)
                return np.asarray(sum(difference for _, difference in steps) / 1e-2)

            return slope, np.asarray(np.einsum("ij,ijkl,kl", D, self.law.A(F), D))
        if quantity == "P":
            return lambda s: self._value("W", F + s * D), np.asarray(np.sum(self.law.P(F) * D))
        return lambda s: self._value("P", F + s * D), np.einsum("ijkl,kl->ij", self.law.A(F), D)

    def _taylor(self, quantity: str, F: Array) -> Measurement:
        """Return the Taylor test for steps of at most 0.02: the measured value is 2 minus the order of the remainders."""
        line, slope = self._derivative(quantity, F)
        return taylor_order(lambda s: line(0.08 * s), 0.08 * slope)

    def _exactly(self, quantity: str, F: Array) -> Measurement:
        """Return the test of the derivative by the five-point stencil, which is exact if the function is a quartic along lines."""
        if quantity == "A" and "P" not in self.has:
            raise NotApplicable("the second derivative of W has no five-point stencil; the Taylor test checks it")
        line, slope = self._derivative(quantity, F)
        try:
            at = {n: line(0.5 * n) for n in range(-4, 5)}
        except ContractViolation as violation:
            raise NotApplicable(f"the law is no polynomial: {violation}") from violation
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

    def _rotated(self, quantity: str, F: Array, rotations: list[tuple[Array, Array]]) -> Measurement:
        """Compare the values at `Q F R` with the value at F, with its first indices rotated by `Q` and the others by `R`."""
        value, errors = self._value(quantity, F), []
        for Q, R in rotations:
            expected = Q @ value @ R if quantity == "P" else value
            if quantity == "A":
                expected = np.einsum("ai,bk,ijkl,jc,ld->acbd", Q, Q, value, R, R)
            errors.append(self._value(quantity, Q @ F @ R) - expected)
        return self._relative(quantity, np.array(errors), self._limit(quantity), _ROUND)

    def _unchanged(self, quantity: str) -> Measurement:
        """Check that no call of a function so far has changed its argument."""
        reason = "a function that changes its argument changes the F of its caller"
        return {"measured": float(quantity in self.law.changing), "limit": 0.0, "scale": "1", "reason": reason}

    def _limit(self, quantity: str) -> float:
        """Return the limit for round-off. It is larger for a C without P, whose geometric part is computed by differences."""
        return 1e-7 if quantity == "A" and self.law.reading["A"].kind == "C" and "P" not in self.has else 1e-10

    def _agreement(self, quantity: str, F: Array) -> Measurement:
        assert self.tensor is not None
        return self._relative(quantity, self._value(quantity, F) - self._claimed(quantity, F), self._limit(quantity), _ROUND)

    def _claimed(self, quantity: str, F: Array) -> Array:
        assert self.tensor is not None
        if quantity == "W":
            return np.asarray(stvk_energy(self.tensor, F))
        P = stvk_stress(self.tensor, F)
        return P if quantity == "P" else material_part(self.tensor, F, Reading("C")) + geometric_part(P, F)

    def _moments(self, F: Array) -> Measurement:
        moments = self.law.P(F) @ F.T
        return self._relative("P", moments - moments.T, 1e-10, "tau = P F' is symmetric, to round-off")

    def _major(self, F: Array) -> Measurement:
        A = self.law.A(F)
        return self._relative("A", A - A.transpose(2, 3, 0, 1), self._limit("A"), "A is a second derivative, to round-off")

    def _minor(self, F: Array) -> Measurement:
        C = material_tangent(self.law.A(F), F, self.law.any_stress(F))
        error = np.maximum(np.abs(C - C.transpose(1, 0, 2, 3)), np.abs(C - C.transpose(0, 1, 3, 2)))
        limit = 1e-10 if "P" in self.has else 1e-7
        if not self.has & {"W", "P"} and not self.stvk:
            raise CannotDecide("C is A without the geometric part, which needs a stress. Pass stress= or energy=.") \
                if self.law.reading["A"].kind != "C" else NotApplicable("without a stress, C is used as returned")  # fmt: skip
        return self._relative("A", error, limit, _ROUND)

    def _rest(self, quantity: str) -> Measurement:
        return self._relative(quantity, self._value(quantity, np.eye(self.law.d)), 1e-10, _NOTHING)

    def _stress_at_rest(self) -> Measurement:
        """Check that the derivative of W vanishes at rest, for a law without a stress of its own."""
        at_rest, *strained = (np.abs(differences(self.law.W, F, 2e-3)).max() for F in (np.eye(self.law.d), *self.law.generic))
        return relative(
            float(at_rest), float(max(strained)), 1e-7, "largest |dW/dF| in strained states", f"{_NOTHING}; differences"
        )

    def moduli(self, quantity: str) -> Array:
        """Return the moduli at rest (d, d, d, d) of W, P or A."""
        one = np.eye(self.law.d)
        if quantity == "A":
            return self.law.A(one)
        return differences(self.law.P if quantity == "P" else partial(differences, self.law.W, h=1e-2), one, 1e-2)

    def _moduli(self, quantity: str) -> Measurement:
        assert self.tensor is not None
        error, scale = float(np.abs(self.moduli(quantity) - self.tensor).max()), float(np.abs(self.tensor).max())
        reason = "differences of sixth order" if quantity != "A" else "round-off; for C, stresses by differences"
        return relative(error, scale, 1e-7, "largest modulus of the claim", reason)

    @property
    def _mirrored(self) -> Array:
        """A generic state with det F < 0."""
        return np.asarray(self.law.generic[0] @ np.diag([-1.0, *[1.0] * (self.law.d - 1)]))

    def _defined(self, quantity: str, F: Array) -> bool:
        try:
            return bool(np.isfinite(self._value(quantity, F)).all())
        except ContractViolation:
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
        """Return lines on inversion and on the loss of strong ellipticity."""
        lines = ([self._when_crushed()] if "W" in self.has else []) + self._partly_defined()
        for name, path in _PATHS.items():
            lines += self._loss(name, path)
        return lines

    def _when_crushed(self) -> str:
        flat, mirrored = (np.diag([s, *[1.0] * (self.law.d - 1)]) for s in (1e-6, -1.0))
        words = []
        for state, F in (("nearly flat", flat), ("mirrored", mirrored)):
            try:
                W = self.law.W(F)
                words.append(f"W = {W:.4g} when {state}")
            except ContractViolation:
                words.append(f"W is not defined when {state}")
        return "inversion: " + ", ".join(words)

    def _partly_defined(self) -> list[str]:
        """Return a remark if some of W, P and A are defined where det F < 0, and others are not."""
        defined = {quantity: self._defined(quantity, self._mirrored) for quantity in self.has}
        if len(set(defined.values())) == 1:
            return []
        there, missing = (", ".join(q for q in self.has if defined[q] is value) for value in (True, False))
        return [f"remark: where det F < 0, {missing} cannot be computed, but {there} can: not all of them notice an inversion"]

    def _loss(self, name: str, path: Callable[[float, int], Array]) -> list[str]:
        """Return a line with the stretch at which strong ellipticity is first lost, found by bisection."""
        try:
            steps = np.linspace(0, 1, 31)[1:]
            waves = [least_wave(self._tangent(path(s, self.law.d))) for s in steps]
            if not np.isfinite(waves).all():
                return [f"strong ellipticity in {name} is unknown: the tangent is not finite at a state of this path"]
            signs = [wave > 0 for wave in waves]
            if all(signs):
                return [f"strong ellipticity is kept in {name} to a stretch of {path(1.0, self.law.d)[0, 0]:.2f}"]
            first = signs.index(False)
            low, high = (0.0 if first == 0 else float(steps[first - 1])), float(steps[first])
            for _ in range(12):
                middle = (low + high) / 2
                low, high = (middle, high) if least_wave(self._tangent(path(middle, self.law.d))) > 0 else (low, middle)
            return [f"strong ellipticity is lost in {name} at a stretch of {path(high, self.law.d)[0, 0]:.4f}"]
        except (ContractViolation, np.linalg.LinAlgError):
            return []


_NOTHING = "a body at rest has neither energy nor stress"
_ROUND = "round-off; 1e-7 where a stress or tangent is taken by differences"
_PATHS: dict[str, Callable[[float, int], Array]] = {
    "uniaxial compression": lambda s, d: np.diag([1 - 0.9 * s, *[1.0] * (d - 1)]),
    "uniaxial extension": lambda s, d: np.diag([1 + s, *[1.0] * (d - 1)]),
}


def least_wave(A: Array) -> float:
    """Return the smallest eigenvalue of the acoustic tensors `A_iJkL N_J N_L` over a grid of unit vectors N."""
    d = A.shape[0]
    if not np.isfinite(A).all():
        return float("nan")
    if d == 2:
        angles = np.linspace(0, np.pi, 48, endpoint=False)
        N = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        z, angle = np.linspace(-1, 1, 15), np.linspace(0, 2 * np.pi, 24, endpoint=False)
        r = np.sqrt(1 - z**2)
        N = np.array([(a * np.cos(t), a * np.sin(t), b) for a, b in zip(r, z, strict=True) for t in angle] + [*np.eye(3)])
    Q = np.einsum("ijkl,nj,nl->nik", A, N, N)
    return float(np.linalg.eigvalsh((Q + Q.transpose(0, 2, 1)) / 2).min())
