"""Strains and stretches of elements: how they deform. Each function takes a `State` and gives its values and where there are none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import name_ids, warn
from .frames import current_normals, in_space

if TYPE_CHECKING:
    from .state import State

#: Values, one an element, and a mask of the elements that have none.
Masked = tuple[Array, NDArray[np.bool_]]


def displacement_gradient(u: Array, t: NDArray[np.int32], gradients: Array) -> Array:
    """(nt, d, k) derivatives of the displacement (nv, d) along the simplices' own axes: `sum_a (u_a - u_0) (x) g_a`."""
    corners = u[t.T]
    gradient: Array = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) @ gradients[:, 1:]
    return gradient


def strain_within(gradient: Array, axes: Array) -> Array:
    """(nt, k, k) Green-Lagrange strain `(A'H + H'A + H'H)/2` in the simplices' axes `A`, from displacements `H`: nothing cancels."""
    linear = np.swapaxes(axes, 1, 2) @ gradient
    strain: Array = (linear + np.swapaxes(linear, 1, 2) + np.swapaxes(gradient, 1, 2) @ gradient) / 2
    return strain


def green_strain(state: State) -> Masked:
    """Green-Lagrange strain `E = (F'F - I)/2` (nt, 3, 3), on rest axes."""
    return state.globally(state.strain), state.without_strain


def deformation_gradient(state: State) -> Masked:
    """Deformation gradient `F` (nt, 3, 3), from rest to current axes: `I + grad u` within, and the stretches across the simplex.

    In plane strain `F_33 = 1`. Where the stress across vanishes, the columns across follow from `F'F = I + 2 E` and the current normals:
    `F_33 = sqrt(1 + 2 E_33)` if nothing shears across. There is no such `F` where `1 + 2 E_33 <= 0`: the law leaves no thickness.

    Warns
    -----
    StvkWarning
        with the ids of the elements without thickness; they are masked.
    """
    frames, k = state.fields.frames, state.fields.mesh.k
    gradient = in_space(state.gradient)
    if k == 3:
        return gradient + np.eye(3), state.without_strain
    tangents = frames[..., :k] + gradient
    across, solid = _across(tangents, state)
    thin = np.flatnonzero(~solid & ~state.without_strain)
    if len(thin):
        warn(_describe_thin(thin))
    F = tangents @ np.swapaxes(frames[..., :k], 1, 2) + across @ np.swapaxes(frames[..., k:], 1, 2)
    return F, state.without_strain | ~solid


def _across(tangents: Array, state: State) -> tuple[Array, NDArray[np.bool_]]:
    """(nt, 3, 3 - k) images `f B + n U` of the normals, `B = (f'f)^-1 2 E_f3`, `U^2 = 1 + 2 E_33 - 2 E_3f B`, and where `U` exists."""
    k = tangents.shape[2]
    C = np.eye(3) + 2 * state.strain
    B, solved = _solve(np.swapaxes(tangents, 1, 2) @ tangents, C[:, :k, k:])
    squares, directions = np.linalg.eigh(C[:, k:, k:] - C[:, k:, :k] @ B)
    U = (directions * np.sqrt(np.maximum(squares, 0.0))[:, None]) @ np.swapaxes(directions, 1, 2)
    normals = current_normals(state.fields.frames, tangents, state.fields.mesh.d)
    return tangents @ B + normals @ U, solved & (squares.min(axis=1) > 0)


def _solve(M: Array, right: Array) -> tuple[Array, NDArray[np.bool_]]:
    """`M^-1 right` and where there is one, `M` of order 1 or 2; zero where `right` is, even if `M` is singular."""
    adjugate = np.ones_like(M) if M.shape[1] == 1 else M[:, ::-1, ::-1] * np.array([[1, -1], [-1, 1]])
    determinant, size = np.linalg.det(M), np.trace(M, axis1=1, axis2=2) ** M.shape[1]
    regular = determinant > np.finfo(float).eps ** 2 * size
    solution = adjugate @ right / np.where(regular, determinant, 1.0)[:, None, None]
    return np.where(regular[:, None, None], solution, 0.0), regular | ~right.any(axis=(1, 2))


def volume_ratio(state: State) -> Masked:
    """`J = det F` (nt,): volume over rest volume, negative where an element is turned inside out; which way round its vertices are
    listed does not matter. Membranes and cables in space have no inside: theirs is positive."""
    F, missing = state.raw("deformation_gradient")
    return np.linalg.det(F), missing


def principal_stretches(state: State) -> Masked:
    """Principal stretches (nt, 3), descending: roots of the eigenvalues of `F'F = I + 2 E`, never negative."""
    strains = np.linalg.eigvalsh(state.strain)[:, ::-1]
    missing = state.raw("deformation_gradient")[1] if state.fields.mesh.k < 3 else state.without_strain
    return np.sqrt(np.maximum(1 + 2 * strains, 0.0)), missing


def _describe_thin(ids: NDArray[np.int64]) -> str:
    return (
        f"{name_ids(ids, 'element')}: stretched so far that zero stress across leaves no thickness (1 + 2 E <= 0 there). F, J, principal "
        "stretches and Cauchy stress are masked; pk2_stress, pk1_stress and green_strain are not. Were loads or moduli meant in other units?"
    )
