"""Translations, rotations and reflections of the deformed body change nothing but the directions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from ...arguments import Array
from ..case import Case
from ..judgement import as_a_whole, by_vertex, largest_component
from ..players import Player
from ..states import STRETCH, random_rotation
from ..tasks import NotApplicable, Task

REASON = "1e-12 is for round-off of moving the body by about its own size: 1e-14 on a hundred elements in a row"


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
        W, words = player.W(u), "W before, or K at rest x edge squared, median"
        return as_a_whole(
            abs(player.W(moved) - W), max(abs(W), case.energy_floor(player)), case.lost_energy(player, moved), words, REASON
        )
    if quantity == "F":
        F, after = turned(player.F(u)), player.F(moved)
        words = "largest |F| around before, or K at rest x edge"
        return by_vertex(case.mesh, after - F, case.force_scale(player, F), case.lost_force(player, moved), words, REASON)
    v = case.direction(u, case.random("invariance K"))
    Kv, after = turned(np.asarray(player.K(u) @ v)), np.asarray(player.K(moved) @ turned(v))
    scale = np.maximum(case.round_off.around(largest_component(Kv, d)), case.stiffness(player) * largest_component(v, d))
    words = "largest |K v| around before, or K at rest x |v|"
    return by_vertex(case.mesh, after - Kv, scale, case.lost_product(player, moved, turned(v)), words, REASON)
