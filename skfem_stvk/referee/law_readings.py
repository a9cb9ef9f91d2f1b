"""What a stress or a tangent of a law may mean: stress measures, tangents and Voigt orders, each turned into P and A = dP/dF."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import Array

MEASURES = ("P", "S", "sigma", "tau", "P transposed")
TANGENTS = ("A", "C", "A transposed")
#: Pairs of indices of shear in each Voigt order; normal components come first.
ORDERS = {"23-13-12": ((1, 2), (0, 2), (0, 1)), "12-13-23": ((0, 1), (0, 2), (1, 2)), "12-23-13": ((0, 1), (1, 2), (0, 2))}


@dataclass(frozen=True)
class Reading:
    """What an array means: its kind (of `MEASURES` or `TANGENTS`), and for Voigt arrays the order of shear and whether a matrix
    acts on engineering shear strain `2 E_ij`.
    """

    kind: str
    order: str | None = None
    engineering: bool | None = None

    def __str__(self) -> str:
        words = [self.kind] + ([f"in the order {self.order}"] if self.order else [])
        words += [] if self.engineering is None else [f"{'' if self.engineering else 'no '}engineering shear"]
        return ", ".join(words)


def readings_of_stress(shape: tuple[int, ...], d: int) -> list[Reading]:
    """All that a stress of this shape may be; none for another shape."""
    if shape == (d, d):
        return [Reading(kind) for kind in MEASURES]
    return [Reading(kind, order) for kind in ("S", "sigma", "tau") for order in _orders(d)] if shape == (_voigt(d),) else []


def readings_of_tangent(shape: tuple[int, ...], d: int) -> list[Reading]:
    """All that a tangent of this shape may be: (d, d, d, d), A as a (d^2, d^2) matrix by rows, or a Voigt matrix of C."""
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
    """`P` (d, d) of a stress: `P = F S = J sigma F^-T = tau F^-T`."""
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
    """(d, d, d, d) `delta_ik S_JL`, with `S = F^-1 P`: what the stress adds to the tangent."""
    return np.einsum("ik,jl->ijkl", np.eye(len(F)), np.linalg.solve(F, P))


def nominal_tangent(value: Array, F: Array, P: Array, reading: Reading) -> Array:
    """`A_iJkL = dP_iJ/dF_kL` (d, d, d, d) of a tangent: of `C = dS/dE`, `A_iJkL = F_iM F_kN C_MJNL + delta_ik S_JL`."""
    d = len(F)
    if reading.kind != "C":
        value = value.reshape(d, d, d, d)
        return value if reading.kind == "A" else value.transpose(1, 0, 3, 2)
    return material_part(value, F, reading) + geometric_part(P, F)


def material_part(value: Array, F: Array, reading: Reading) -> Array:
    """`F_iM F_kN C_MJNL` of a tangent C."""
    d = len(F)
    if value.ndim == 2:
        i, j = _indices(reading.order, d)
        matrix = value.copy()
        if not reading.engineering:  # the columns of shear act on E_ij, which stands for E_ij and E_ji
            matrix[:, d:] /= 2
        full = np.zeros((d, d, d, d))
        for a, b in ((i, j), (j, i)):
            for k, l in ((i, j), (j, i)):
                full[a[:, None], b[:, None], k, l] = matrix
        value = full
    return np.einsum("im,kn,mjnl->ijkl", F, F, value)


def second_of(A: Array, F: Array, P: Array) -> Array:
    """`C_MJNL` (d, d, d, d) of A, by pulling both first indices back without the geometric part."""
    inverse = np.linalg.inv(F)
    return np.einsum("mi,nk,ijkl->mjnl", inverse, inverse, A - geometric_part(P, F))
