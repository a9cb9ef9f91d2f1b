"""Surfaces of rigid shapes in the surroundings of a body, for pictures."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..terms.loads.rigid_shapes import RigidBox, RigidCylinder, RigidPlane, RigidShape, RigidSphere
from .law_on_elements import in_space

#: Width of the surroundings, as a part of the largest extent of the body.
MARGIN = 0.2
#: Number of pieces of a plane along each axis, and of a curved surface around: a multiple of four, for the corners of boxes.
PIECES = 24


def surroundings(box: Array) -> Array:
    """Return the smallest and largest coordinates (2, 3) up to which shapes are drawn, from those of the body."""
    margin = MARGIN * np.ptp(box, axis=0).max()
    return box + np.array([[-margin], [margin]])


def surface_of(shape: RigidShape, box: Array) -> Array:
    """Return the part in a box (2, 3) of the surface of a shape: triangles (n, 3, 3), or segments (n, 2, 3) of shapes in a plane.

    Corners of triangles are in anticlockwise order for a viewer on the side of the body.
    """
    middle, reach = box.mean(axis=0), float(np.linalg.norm(np.ptp(box, axis=0))) / 2
    lattice = _flat(shape, middle, reach) if shape.d < 3 else _in_space(shape, middle, reach)
    cells = _cells(lattice[:, ::-1] if getattr(shape, "inside", False) else lattice)
    for axis in range(shape.d):
        for side, sign in ((0, -1.0), (1, 1.0)):
            cells = _below(cells, sign * (cells[..., axis] - box[side, axis]))
    return cells


def _flat(shape: RigidShape, middle: Array, reach: float) -> Array:
    """Return points (1, n, 3) along a line, a circle or a rectangle."""
    if isinstance(shape, RigidPlane):
        n, along = _vector(shape.normal), np.linspace(-reach, reach, 2)[:, None]
        foot = middle - n @ (middle - _vector(shape.point)) * n
        return (foot + along * [-n[1], n[0], 0.0])[None]
    turns = 2 * np.pi * (np.arange(4 * PIECES + 1) + 0.5) / (4 * PIECES)
    return _around(shape, np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=-1)[None])


def _in_space(shape: RigidShape, middle: Array, reach: float) -> Array:
    """Return a lattice of points (m, n, 3) on a surface, as far as it is near the `middle`."""
    if isinstance(shape, RigidPlane):
        n, steps = _vector(shape.normal), np.linspace(-reach, reach, PIECES + 1)
        a, b = _across(n)
        return middle - n @ (middle - _vector(shape.point)) * n + steps[:, None, None] * a + steps[:, None] * b
    if isinstance(shape, RigidCylinder):
        axis = _vector(shape.axis)
        foot = _vector(shape.point) + axis @ (middle - _vector(shape.point)) * axis
        a, angle = _towards(middle - foot, reach, _across(axis)[0])
        turns = angle * np.linspace(-1, 1, 2 * PIECES + 1)[:, None, None]
        out = np.cos(turns) * a + np.sin(turns) * np.cross(axis, a)
        return foot + shape.radius * out + np.linspace(-reach, reach, PIECES + 1)[:, None] * axis
    pole, angle = np.array([0.0, 0.0, 1.0]), np.pi
    if isinstance(shape, RigidSphere):
        pole, angle = _towards(middle - _vector(shape.centre), reach, pole)
    a, b = _across(pole)
    tilts = angle * np.concatenate([[0.0], (np.arange(PIECES) + 0.5) / PIECES, [1.0]])[:, None, None]
    turns = 2 * np.pi * (np.arange(2 * PIECES + 1) + 0.5)[:, None] / (2 * PIECES)
    return _around(shape, np.cos(tilts) * pole + np.sin(tilts) * (np.cos(turns) * a + np.sin(turns) * b))


def _around(shape: RigidShape, directions: Array) -> Array:
    """Return the points of a sphere or a box in these directions (..., 3)."""
    if isinstance(shape, RigidBox):
        low, high = _vector(shape.low), _vector(shape.high)
        corners = np.where(np.abs(directions) < 1e-9, 0.0, np.sign(directions))
        return (low + high) / 2 + corners * np.maximum((high - low) / 2 - shape.radius, 0.0) + shape.radius * directions
    assert isinstance(shape, RigidSphere)
    return _vector(shape.centre) + shape.radius * directions


def _vector(components: tuple[float, ...]) -> Array:
    return in_space(np.array([components]))[0]


def _across(n: Array) -> tuple[Array, Array]:
    """Return two unit vectors across a unit vector, which form a right-handed system with it as the third."""
    a = np.cross(np.eye(3)[np.abs(n).argmin()], n)
    a /= np.linalg.norm(a)
    return a, np.cross(n, a)


def _towards(way: Array, reach: float, default: Array) -> tuple[Array, float]:
    """Return the direction of a way, and the angle around it under which a ball of radius `reach` is seen."""
    length = float(np.linalg.norm(way))
    return (way / length, float(np.arcsin(reach / length))) if length > reach else (default, np.pi)


def _cells(x: Array) -> Array:
    """Return the segments (n, 2, 3) between points (1, n + 1, 3), or the triangles (n, 3, 3) of a lattice of points."""
    if len(x) == 1:
        return np.stack([x[0, :-1], x[0, 1:]], axis=1)
    a, b, c, d = x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]
    cells = np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])
    areas = np.linalg.norm(np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0]), axis=1)
    return cells[areas > 1e-12 * areas.max()]


def _below(cells: Array, height: Array) -> Array:
    """Return the parts of segments or triangles (n, m, 3) at whose corners a linear function (n, m) is at most zero."""
    below, m = height <= 0, cells.shape[1]
    count, parts = below.sum(axis=1), [cells[below.all(axis=1)]]
    for inner in range(1, m):
        some = np.flatnonzero(count == inner)
        single = below[some] if inner == 1 else ~below[some]  # the corner that is alone on its side comes first
        order = (single.argmax(axis=1)[:, None] + np.arange(m)) % m
        x, s = cells[some[:, None], order], height[some[:, None], order]
        cut = x[:, :1] + (x[:, 1:] - x[:, :1]) * (s[:, :1] / (s[:, :1] - s[:, 1:]))[..., None]
        if inner == 1:
            parts.append(np.concatenate([x[:, :1], cut], axis=1))
        else:
            parts += [np.stack([cut[:, 0], x[:, 1], x[:, 2]], axis=1), np.stack([cut[:, 0], x[:, 2], cut[:, 1]], axis=1)]
    return np.concatenate(parts)
