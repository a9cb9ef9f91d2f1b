"""Law of a material on elements: frames, full strain and stress from the strain within, and an energy of the volume.

A frame has the axes of the element's own line or plane, then the normals: three columns in any space.
Across an element either the strain vanishes (plane strain), or the stress does (plane stress, segments); this gives the strain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.materials import FramedMaterial, Hypothesis, Isotropic, Material
from ..edges.stiffness import VOIGT, multiplicity, unit_stresses, voigt_indices
from ..errors import MaterialError
from ..terms.laws.elastic_law import embedded

FIRST, SECOND = np.array(VOIGT[3]).T


def strain_and_stress(material: Material, hypothesis: Hypothesis, strain: Array, frames: Array) -> tuple[Array, Array]:
    """Return `E` and `S` (n, 3, 3) [1], [Pa] in the elements' `rest_frames`, from the Green-Lagrange strain (n, k, k) in their own
    axes.

    >>> E, S = strain_and_stress(Isotropic(1.0, 0.25), Hypothesis.PLANE_STRESS, np.array([[[0.1, 0], [0, 0]]]), np.eye(3)[None])
    >>> np.round(np.diagonal(E[0]), 4), np.round(np.diagonal(S[0]), 4)
    (array([ 0.1   ,  0.    , -0.0333]), array([0.1067, 0.0267, 0.    ]))
    """
    if isinstance(material, Isotropic):
        return _isotropic(material, hypothesis, strain)
    if not isinstance(material, FramedMaterial):
        name = type(material).__name__
        raise MaterialError(f"material = {name}(...); expected Isotropic, or a FramedMaterial with a stiffness() in its frame.")
    rotation = frames if material.frame is None else np.swapaxes(np.asarray(material.frame), -1, -2) @ frames
    return (_condensed if hypothesis.condensed else _framed)(material.stiffness(), strain, rotation)


def elasticity(material: Material, hypothesis: Hypothesis, frames: Array, k: int) -> Array:
    """Return the elasticity tensors `C_MJNL` (n, k, k, k, k) [Pa] within elements, from the stress of each unit strain."""
    C, units = np.zeros((len(frames), k, k, k, k)), np.eye(k * k).reshape(-1, k, k)
    for unit in (units + np.swapaxes(units, 1, 2)) / 2:
        stress = strain_and_stress(material, hypothesis, np.tile(unit, (len(frames), 1, 1)), frames)[1]
        C += stress[:, :k, :k, None, None] * unit
    return C


def dilation(gradient: Array) -> Array:
    """Return `J - 1 = det(I + H) - 1` (n,) from displacement gradients `H` (n, k, k), without cancellation at small strain."""
    k, trace = gradient.shape[1], np.trace(gradient, axis1=1, axis2=2)
    if k == 1:
        return trace
    value = trace + np.linalg.det(gradient)
    if k == 3:
        value = value + (trace**2 - np.einsum("nij,nji->n", gradient, gradient)) / 2
    return value


def volume_stress(slope: Array, gradient: Array, constrained_across: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Return `S = psi' J C^-1 = psi' A A'/J` (n, 3, 3), `A` the adjugate of `I + H`, and a mask where it is infinite; 0 there.

    The inputs are the slope `psi'(J)` [Pa] and the displacement gradients `H` (n, k, k) of elements that fill their space. The
    Cauchy stress is `psi' I` within the elements, and also across those constrained there (plane strain).
    """
    k = gradient.shape[1]
    F = np.eye(3) + embedded(gradient)
    A = adjugate(F)
    J = (A[:, 0] * F[:, :, 0]).sum(axis=1)
    lost = (J == 0) & (slope != 0)
    S: Array = (slope / np.where(J == 0, 1.0, J))[:, None, None] * (A @ np.swapaxes(A, 1, 2))
    S[:, range(k, 3), range(k, 3)] *= constrained_across[:, None]
    S[lost] = 0
    return S, lost


def adjugate(F: Array) -> Array:
    """Return the adjugates `det(F) F^-1` of matrices (n, 3, 3)."""
    return np.stack([np.cross(F[:, :, i - 2], F[:, :, i - 1]) for i in range(3)], axis=1)


def _isotropic(material: Isotropic, hypothesis: Hypothesis, strain: Array) -> tuple[Array, Array]:
    """Return `S = lam tr(E) I + 2 mu E`, and the strain across if the stress there vanishes."""
    lam, mu = (value[..., None, None] for value in material.lame(hypothesis))
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    E, k = embedded(strain), strain.shape[1]
    if not hypothesis.condensed:
        return E, lam * trace * np.eye(3) + 2 * mu * E
    S = embedded(lam * trace * np.eye(k) + 2 * mu * strain)
    E[:, range(k, 3), range(k, 3)] = material.strain_across(np.trace(S, axis1=1, axis2=2))[:, None]
    return E, S


def _framed(C: Array, strain: Array, rotation: Array) -> tuple[Array, Array]:
    """Return `E` and `S = C : E`, computed in material axes; `rotation` are the frames in these axes."""
    E, transposed = embedded(strain), np.swapaxes(rotation, 1, 2)
    local = rotation @ E @ transposed
    stress = np.squeeze(C @ (local[:, FIRST, SECOND] * multiplicity(3))[..., None], axis=-1)
    return E, transposed @ stress[:, voigt_indices(3)] @ rotation


def _condensed(C: Array, strain: Array, rotation: Array) -> tuple[Array, Array]:
    """Return the full strain `C^-1 N s` and the stress `s` within, from `(N' C^-1 N) s = e` with the dyads `N` of the axes."""
    k, compliance = strain.shape[1], np.linalg.inv(C)
    i, j = np.array(VOIGT[k]).T
    N = unit_stresses(rotation[:, :, :k])
    within = (strain[:, i, j] * multiplicity(k))[..., None]
    s = np.linalg.solve(N @ compliance @ N.swapaxes(1, 2), within)
    local = np.squeeze(compliance @ (N.swapaxes(1, 2) @ s), axis=-1) / multiplicity(3)
    E, S = np.swapaxes(rotation, 1, 2) @ local[:, voigt_indices(3)] @ rotation, np.zeros((len(strain), 3, 3))
    E[:, :k, :k] = strain
    S[:, i, j] = S[:, j, i] = s[..., 0]
    return E, S


def in_space(vectors: Array) -> Array:
    """Return vectors (n, d), or (n, d, k) as columns, padded with zeros to three dimensions.

    >>> in_space(np.array([[2.0]]))
    array([[2., 0., 0.]])
    """
    solid = np.zeros((len(vectors), 3, *vectors.shape[2:]))
    solid[:, : vectors.shape[1]] = vectors
    return solid


def rest_frames(axes: Array) -> Array:
    """Return right-handed frames (n, 3, 3) that begin with the elements' axes (n, d, k); the global axes for `k = d`."""
    n, d, k = axes.shape
    if k == d:
        return np.broadcast_to(np.eye(3), (n, 3, 3))
    tangents = in_space(axes)
    if k == 2:
        normal = np.cross(tangents[..., 0], tangents[..., 1])
        return np.concatenate([tangents, normal[..., None]], axis=2)
    tangent = tangents[..., 0]
    across = np.eye(3)[np.abs(tangent).argmin(axis=1)] if d == 3 else np.array([0.0, 0.0, 1.0])
    first = _unit(np.cross(across, tangent))
    return np.stack([tangent, first, np.cross(tangent, first)], axis=2)


def current_normals(frames: Array, tangents: Array, d: int) -> Array:
    """Return the unit normals (n, 3, 3 - k) of the deformed elements, from their rest frames and current tangents (n, 3, k).

    Normals of a membrane in space follow its tangents. Normals of a segment are rotated with it by the smallest rotation from its
    rest direction to its current one, since a segment does not determine its rotation about itself. Normals stay at rest in a space
    that the elements fill, and where an element has shrunk to a point or a line.
    """
    k = tangents.shape[2]
    if k == d:
        return frames[..., k:]
    if k == 2:
        normal = np.cross(tangents[..., 0], tangents[..., 1])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        return np.where(length > 0, normal / np.where(length > 0, length, 1.0), frames[..., 2])[..., None]
    length = np.linalg.norm(tangents[..., 0], axis=1, keepdims=True)
    old, first = frames[..., 0], frames[..., 1]
    new = np.where(length > 0, tangents[..., 0] / np.where(length > 0, length, 1.0), old)
    rotated = _rotated_with(first, old, new)
    first = _unit(rotated - (rotated * new).sum(axis=1, keepdims=True) * new)
    return np.stack([first, np.cross(new, first)], axis=2)


def _rotated_with(normal: Array, old: Array, new: Array) -> Array:
    """Return the normal rotated by the smallest rotation from `t0` to `t`: `R n = n - (t . n)/(1 + t0 . t) (t0 + t)`.

    For opposite directions it is a rotation by 180 degrees in the plane of `t0` and `n`.
    """
    bisector = old + new
    squared = (bisector**2).sum(axis=1, keepdims=True)  # 2 (1 + t0 . t)
    opposite = squared < 1e-12
    factor = 2 * (new * normal).sum(axis=1, keepdims=True) / np.where(opposite, 1.0, squared)
    return np.where(opposite, -normal, normal - factor * bisector)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)
