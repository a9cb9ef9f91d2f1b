"""The named states in which W, F and K are compared."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..arguments import Array


def random_rotation(d: int, rng: np.random.Generator, degrees: float = 170.0) -> Array:
    """(d, d) rotation by this angle, about a random axis in space; on a line the identity."""
    if d == 1:
        return np.eye(1)
    angle = np.deg2rad(degrees)
    if d == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    axis = rng.standard_normal(3)
    return np.asarray(Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix())


def named_states(X: Array, node_size: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Displacements (ndofs,) [m] by name.

    Parameters
    ----------
    X : (nv, d) coordinates from the centre of the body [m].
    node_size : (nv,) size of the elements around each vertex [m], the unit of the random displacements.
    rng : random numbers.
    """
    d = X.shape[1]
    turn = random_rotation(d, rng)
    shift = np.ptp(X, axis=0).max() * rng.standard_normal(d)
    along = np.linalg.svd(X, full_matrices=False)[2][0]  # the direction in which the body is longest

    def noise(amplitude: float) -> Array:
        return amplitude * node_size[:, None] * rng.standard_normal(X.shape)

    def stretched(s: float) -> Array:
        return (s - 1) * np.outer(X @ along, along) + noise(0.02)

    strained = 0.1 * np.outer(X @ along, along) + noise(0.05)
    mirror = np.eye(d) - 2 * np.outer(along, along)
    states = {
        "rest": np.zeros_like(X),
        "small random strain": noise(1e-3),
        "rigid rotation": X @ turn.T - X + shift,
        "rotated strained": (X + strained) @ turn.T - X + shift,
        STRETCH: stretched(2.0),
        "35 % compression": stretched(0.65),
        "large random": noise(0.3),
        "reflected random": (X + noise(0.3)) @ mirror.T - X,
    }
    if d == 1:  # a line cannot turn
        states["rigid translation"] = states.pop("rigid rotation")
        states["translated strained"] = states.pop("rotated strained")
    return {name: u.ravel() for name, u in states.items()}


STRETCH = "100 % stretch"
#: States in which elements may be inside out.
INVERTED = ("large random", "reflected random")
