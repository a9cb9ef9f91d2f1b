"""Full elasticity tensors for the reference, with independent Lame constants, rotation and condensation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array

#: Index pairs of the Voigt order 11, 22, 33, 23, 13, 12.
FIRST, SECOND = np.array([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]).T
#: Indices of the Voigt components within an element of dimension 1, 2 and 3.
WITHIN = {1: [0], 2: [0, 1, 5], 3: [0, 1, 2, 3, 4, 5]}


def isotropic_tensor(young: ArrayLike, poisson: ArrayLike, k: int, condensed: bool) -> Array:
    """Return the tensors (n, k, k, k, k) of `S = lam tr(E) I + 2 mu E`. If `condensed`, the transverse stress is zero."""
    E = np.atleast_1d(np.asarray(young, dtype=float))
    if k == 1:
        return E.reshape(-1, 1, 1, 1, 1)
    nu = np.atleast_1d(np.asarray(poisson, dtype=float))
    mu = E / 2 / (1 + nu)
    return lame_tensor(2 * mu * nu / (1 - nu) if condensed else 2 * mu * nu / (1 - 2 * nu), mu, k)


def lame_tensor(lam: ArrayLike, mu: ArrayLike, k: int) -> Array:
    """Return `lam d_ij d_kl + mu (d_ik d_jl + d_il d_jk)` (..., k, k, k, k) for constants (...)."""
    one = np.eye(k)
    spherical = np.einsum("ij,kl->ijkl", one, one)
    symmetric = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    return np.asarray(np.multiply.outer(lam, spherical) + np.multiply.outer(mu, symmetric))


def engineering_matrix(young: Sequence[ArrayLike], poisson: Sequence[ArrayLike], shear: Sequence[ArrayLike]) -> Array:
    """Return Voigt matrices (n, 6, 6) for `(E_1, E_2, E_3)`, `(nu_23, nu_13, nu_12)`, `(G_23, G_13, G_12)`, in closed form.

    With `nu_ji = nu_ij E_j/E_i` and `D = 1 - nu_12 nu_21 - nu_23 nu_32 - nu_13 nu_31 - 2 nu_21 nu_32 nu_13`:
    `C_11 = E_1 (1 - nu_23 nu_32)/D`, `C_12 = E_1 (nu_21 + nu_31 nu_23)/D`, and the others by permutation of the indices.
    """
    values = [np.asarray(value, dtype=float) for value in (*young, *poisson, *shear)]
    e1, e2, e3, n23, n13, n12, g23, g13, g12 = (np.atleast_1d(value) for value in np.broadcast_arrays(*values))
    n32, n31, n21 = n23 * e3 / e2, n13 * e3 / e1, n12 * e2 / e1
    D = 1 - n12 * n21 - n23 * n32 - n13 * n31 - 2 * n21 * n32 * n13
    matrix = np.zeros((len(e1), 6, 6))
    matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2] = e1 * (1 - n23 * n32) / D, e2 * (1 - n13 * n31) / D, e3 * (1 - n12 * n21) / D
    matrix[:, 0, 1] = matrix[:, 1, 0] = e1 * (n21 + n31 * n23) / D
    matrix[:, 0, 2] = matrix[:, 2, 0] = e1 * (n31 + n21 * n32) / D
    matrix[:, 1, 2] = matrix[:, 2, 1] = e2 * (n32 + n12 * n31) / D
    matrix[:, 3, 3], matrix[:, 4, 4], matrix[:, 5, 5] = g23, g13, g12
    return matrix


def anisotropic_tensor(voigt: ArrayLike, frame: ArrayLike | None, axes: Array, condensed: bool) -> Array:
    """Return tensors (n, k, k, k, k) for Voigt matrices (6, 6) or (n, 6, 6), in the elements' own axes (n, d, k).

    The full tensor is rotated from the material frame into an orthonormal triad that begins with the elements' axes. If
    `condensed`, the transverse stress vanishes, and the transverse strain is eliminated.
    """
    k = axes.shape[2]
    matrix = np.asarray(voigt, dtype=float).reshape(-1, 6, 6)
    triad = _triad(axes)
    rotation = triad if frame is None else np.swapaxes(np.asarray(frame, dtype=float), -1, -2) @ triad
    rotated = np.einsum("nabcd,nai,nbj,nck,ndl->nijkl", *np.broadcast_arrays(_tensor(matrix)), *[rotation] * 4, optimize=True)
    if not condensed:
        return rotated[:, :k, :k, :k, :k]
    local = rotated[:, FIRST[:, None], SECOND[:, None], FIRST, SECOND]
    inside, outside = WITHIN[k], [i for i in range(6) if i not in WITHIN[k]]
    across = local[:, outside][:, :, inside]
    eliminated = local.copy()
    eliminated[np.ix_(range(len(local)), inside, inside)] -= np.swapaxes(across, 1, 2) @ np.linalg.solve(
        local[:, outside][:, :, outside], across
    )
    return _tensor(eliminated)[:, :k, :k, :k, :k]


def _tensor(matrix: Array) -> Array:
    """Return the tensors (n, 3, 3, 3, 3) for Voigt matrices (n, 6, 6)."""
    row = np.empty((3, 3), dtype=int)
    row[FIRST, SECOND] = row[SECOND, FIRST] = range(6)
    return matrix[:, row[:, :, None, None], row]


def _triad(axes: Array) -> Array:
    """Return orthonormal columns (n, 3, 3) that begin with `axes` (n, d, k)."""
    n, d, k = axes.shape
    triad = np.zeros((n, 3, 3))
    triad[:, :d, :k] = axes
    for column in range(k, 3):  # the unit vector farthest from the columns so far, made orthogonal to them
        known = triad[:, :, :column]
        rest = np.eye(3) - known @ np.swapaxes(known, 1, 2)
        best = np.argmax(np.linalg.norm(rest, axis=1), axis=1)
        vector = rest[np.arange(n), :, best]
        triad[:, :, column] = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return triad
