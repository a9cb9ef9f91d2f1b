"""Rigid motions in words."""

from __future__ import annotations

import numpy as np

from ..arguments import Array


def names(free: Array, d: int, centre: Array, size: float) -> list[str]:
    """Motions in words.

    Parameters
    ----------
    free : (r, m) orthonormal: translations, and rotations about the `centre`, in units of the `size`.

    >>> names(np.eye(3)[:, [1, 2]], 2, np.zeros(2), 1.0)
    ['translation along y', 'rotation in the plane']
    """
    if d == 1 or not free.size:
        return ["translation along x"] * free.shape[1]
    _, values, right = np.linalg.svd(free[d:])
    still = np.append(values, np.zeros(len(right) - len(values))) < 1e-6
    translations = free[:d] @ right[still].T
    names = [f"translation along {_direction(a)}" for a in _axes(translations)]
    turning = free @ right[~still].T
    return names + [_rotation(turning, axis, translations, centre, size) for axis in _axes(np.linalg.qr(turning[d:])[0])]


def _rotation(turning: Array, axis: Array, translations: Array, centre: Array, size: float) -> str:
    """The motion among `turning` (r, m) that turns about the direction `axis`, in words."""
    d = len(centre)
    motion = turning @ np.linalg.lstsq(turning[d:], axis, rcond=None)[0]
    v = motion[:d]  # at right angles to the translations, since `turning` is
    if d == 2:
        point = centre + size * np.array([-v[1], v[0]]) * np.sign(axis[0])
        return "rotation in the plane" if translations.shape[1] else f"rotation about the point {_numbers(point, size)}"
    along = v @ axis
    if abs(along) > 1e-6:
        return f"screw motion along {_direction(axis)}, {2 * np.pi * size * along:.4g} a turn"
    name = _direction(axis)
    if np.linalg.matrix_rank(np.column_stack([translations, axis]), tol=1e-6) == d:
        return f"rotation about the {name} axis" if name in "xyz" else f"rotation about the direction {name}"
    return f"rotation about the line along {name} through {_numbers(centre + size * np.cross(axis, v), size)}"


def _axes(basis: Array) -> list[Array]:
    """Directions that span the same space as the orthonormal columns of `basis` (d, m): coordinate axes as far as they are in it."""
    axes = [e for e in np.eye(len(basis)) if np.linalg.norm(basis.T @ e) > 1 - 1e-9]
    rest = basis - sum((np.outer(e, e @ basis) for e in axes), np.zeros_like(basis))
    left, values, _ = np.linalg.svd(rest, full_matrices=False)
    others = left[:, values > 1e-6].T
    return axes + [other * np.sign(other[np.abs(other).argmax()]) for other in others]


def _direction(a: Array) -> str:
    """`x`, `y`, `z`, or components.

    >>> _direction(np.array([0.0, 1.0])), _direction(np.array([0.6, 0.8]))
    ('y', '(0.6, 0.8)')
    """
    return "xyz"[int(a.argmax())] if a.max() > 1 - 1e-9 else _numbers(a, 1.0)


def _numbers(x: Array, size: float) -> str:
    """Coordinates, with what is nothing against the size as zero."""
    x = np.where(np.abs(x) < 1e-6 * size, 0.0, x)
    return f"({', '.join(f'{value:.6g}' for value in x)})"
