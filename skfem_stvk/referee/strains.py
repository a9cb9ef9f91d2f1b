"""Strains and stresses that are mistaken for those of St. Venant-Kirchhoff.

`C = F'F`, `b = F F'`; the strains take displacement gradients `D = F - I` (..., d, d), the stresses `F` and `S = C : E`. All take
complex numbers too, by whose imaginary parts they are differentiated.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array


def biot(D: Array) -> Array:
    """`U - I` with the stretch `U`, the positive root of `C`."""
    return np.asarray(_stretch(np.eye(D.shape[-1]) + D) - np.eye(D.shape[-1]))


def almansi(D: Array) -> Array:
    """`(I - b^-1)/2`, the strain of Euler and Almansi."""
    return _almansi(np.swapaxes(D, -1, -2))


def pulled_back_almansi(D: Array) -> Array:
    """`(I - C^-1)/2`, whose principal values are those of `almansi`."""
    return _almansi(D)


def of_left_stretch(D: Array) -> Array:
    """`(b - I)/2`."""
    return np.asarray((D + np.swapaxes(D, -1, -2) + D @ np.swapaxes(D, -1, -2)) / 2)


def times_F_on_the_right(F: Array, S: Array) -> Array:
    """`P = S F`."""
    return np.asarray(S @ F)


def S_alone(F: Array, S: Array) -> Array:
    """`P = S`."""
    return S


def derivative_of_biot(F: Array, S: Array) -> Array:
    """`P = dW/dF = 2 F X` of `W = 1/2 E : C : E` with Biot's strain, where `U X + X U = S`."""
    d, U, one = F.shape[-1], _stretch(F), np.eye(F.shape[-1])
    both = np.einsum("...ik,jl->...ijkl", U, one) + np.einsum("ik,...lj->...ijkl", one, U)
    X = np.linalg.solve(both.reshape(*F.shape[:-2], d * d, d * d), S.reshape(*S.shape[:-2], d * d, 1))
    return np.asarray(2 * F @ X.reshape(S.shape))


def derivative_of_almansi(F: Array, S: Array) -> Array:
    """`P = dW/dF = F C^-1 S C^-1` of `W = 1/2 E : C : E` with `pulled_back_almansi`."""
    inverse = np.linalg.inv(np.swapaxes(F, -1, -2) @ F)
    return np.asarray(F @ inverse @ S @ inverse)


def _almansi(D: Array) -> Array:
    F = np.eye(D.shape[-1]) + D
    return np.asarray((np.eye(D.shape[-1]) - np.linalg.inv(np.swapaxes(F, -1, -2) @ F)) / 2)


def _stretch(F: Array) -> Array:
    """The positive root `U` of `C`, of the polar decomposition `F = R U` by Newton's iteration for R."""
    R = F
    for _ in range(100):  # halves the error of large stretches until R is near, then squares it
        before, R = R, (R + np.swapaxes(np.linalg.inv(R), -1, -2)) / 2
        if np.abs(R - before).max(initial=0.0) <= 1e-14:
            break
    U = np.swapaxes(R, -1, -2) @ F
    return np.asarray((U + np.swapaxes(U, -1, -2)) / 2)
