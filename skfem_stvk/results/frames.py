"""Orthonormal frames of simplices: the axes of their own line or plane, then the normals; three columns in any space."""

from __future__ import annotations

import numpy as np

from ..arguments import Array


def in_space(columns: Array) -> Array:
    """Vectors (n, d, k) as columns of a space of three dimensions (n, 3, k).

    >>> in_space(np.array([[[2.0]]]))[0].T
    array([[2., 0., 0.]])
    """
    solid = np.zeros((columns.shape[0], 3, columns.shape[2]))
    solid[:, : columns.shape[1]] = columns
    return solid


def rest_frames(axes: Array) -> Array:
    """(n, 3, 3) right-handed frames that begin with the simplices' axes (n, d, k); the global ones for `k = d`."""
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
    """(n, 3, 3 - k) unit normals of the simplices as they are now, from their rest frames and current tangents (n, 3, k).

    Those of a membrane in space follow its tangents. Those of a segment are turned with it by the smallest rotation that takes its old
    direction to the new one: a segment does not tell how far it turns about itself. In a space that the simplices fill, and where
    one has shrunk to a point or a line, the normals stay as they were.
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
    first = _unit(_without(_turned(first, old, new), new))
    return np.stack([first, np.cross(new, first)], axis=2)


def _turned(normal: Array, old: Array, new: Array) -> Array:
    """`R n = n - (t . n)/(1 + t0 . t) (t0 + t)`, the smallest rotation from `t0` to `t`; half a turn in the plane of `t0` and `n` if opposite."""
    bisector = old + new
    squared = (bisector**2).sum(axis=1, keepdims=True)  # 2 (1 + t0 . t)
    opposite = squared < 1e-12
    factor = 2 * (new * normal).sum(axis=1, keepdims=True) / np.where(opposite, 1.0, squared)
    return np.where(opposite, -normal, normal - factor * bisector)


def _without(vector: Array, unit: Array) -> Array:
    return vector - (vector * unit).sum(axis=1, keepdims=True) * unit


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit
