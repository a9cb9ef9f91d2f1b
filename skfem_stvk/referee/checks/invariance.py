"""Translations, rotations and reflections of the deformed body change nothing but the directions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case import Case
from ..places import worst_places
from ..players import Player
from ..states import STRETCH, random_rotation
from ..tasks import NotApplicable, Task

Array = NDArray[np.float64]

REASON = "round-off of moving the body by about its own size: eps x size / edge, 1e-14 on a hundred elements in a row; flat or many elements cost more"


def invariance(case: Case) -> Iterator[Task]:
    """`W(g u) = W(u)`, `F(g u) = Q F(u)`, `K(g u) Q = Q K(u)` for the motions `g` with orthogonal `Q`."""
    d = case.mesh.d
    rng = case.random("invariance")
    mirror = np.eye(d) - 2 * np.outer(np.eye(d)[0], np.eye(d)[0])
    shift = np.ptp(case.centred, axis=0).max() * rng.standard_normal(d)
    turn = random_rotation(d, rng, degrees=115.0)
    motions = {"translation": (np.eye(d), shift), "rotation": (turn, 0 * shift), "reflection": (turn @ mirror, 0 * shift)}
    for player in case.players:
        for motion, (Q, c) in motions.items():
            for quantity in "WFK":
                measure = partial(_change, case, player, quantity, motion, Q, c)
                yield Task("invariance", player, quantity, motion, quantity, measure)


def _change(case: Case, player: Player, quantity: str, motion: str, Q: Array, c: Array) -> dict[str, Any]:
    d = case.mesh.d
    if np.linalg.det(Q) < 0 and not case.is_stvk(player):
        raise NotApplicable("a law may tell a body from its mirror image; the candidate does not claim to be St. Venant-Kirchhoff")
    if case.mesh.d == 1 and motion == "rotation":
        raise NotApplicable("a line cannot turn")
    u = case.states[STRETCH]
    moved = (case.centred @ (Q - np.eye(d)).T + u.reshape(-1, d) @ Q.T + c).ravel()

    def turned(f: Array) -> Array:
        return (f.reshape(-1, d) @ Q.T).ravel()

    if quantity == "W":
        before, after = np.array([player.W(u)]), np.array([player.W(moved)])
    elif quantity == "F":
        before, after = turned(player.F(u)), player.F(moved)
    else:
        v = case.direction(u, case.random("invariance K"))
        before, after = turned(np.asarray(player.K(u) @ v)), np.asarray(player.K(moved) @ turned(v))
    limit = case.limit()
    error = np.abs(after - before)
    scale, words = float(np.abs(before).max()), f"largest |{quantity}{' v' if quantity == 'K' else ''}| before"
    if quantity != "K":
        scale, words = case.scale(quantity, scale, player)
    return {
        "measured": error.max() / scale if scale else np.inf,  # a body that does not resist is none
        "limit": limit,
        "scale": f"{scale:.3e} ({words})",
        "reason": REASON,
        "worst": {} if quantity == "W" else worst_places(case.mesh, error, limit * scale),
    }
