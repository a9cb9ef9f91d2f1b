"""Internal forces balance, K is symmetric, and a rigid motion costs nothing at rest."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from scipy.sparse import issparse

from ...arguments import Array
from ..case import Case
from ..judgement import as_a_whole, by_entry, by_vertex, largest_component, largest_rows
from ..players import Player
from ..tasks import NotApplicable, Task


def balance(case: Case) -> Iterator[Task]:
    """Sums of forces and torques, symmetry of K in every state; rigid modes at rest."""
    for player in case.players:
        for state in case.states:
            yield Task("balance", player, "sum of forces", state, "F", partial(_forces, case, player, state))
            yield Task("balance", player, "sum of torques", state, "F", partial(_torques, case, player, state))
            yield Task("symmetry", player, "K", state, "K", partial(_symmetry, case, player, state))
        yield Task("rigid modes", player, "K", "rest", "K", partial(_rigid_modes, case, player))


def _forces(case: Case, player: Player, state: str) -> dict[str, Any]:
    case.refuse_undefined(player, state)
    F = case.value(player, "F", state).reshape(-1, case.mesh.d)
    return _resultant(case, player, state, F.sum(axis=0), F, 1.0, "sum of |F|, or K at rest x edge")


def _torques(case: Case, player: Player, state: str) -> dict[str, Any]:
    case.refuse_undefined(player, state)
    d = case.mesh.d
    if d == 1:
        raise NotApplicable("there are no torques on a line")
    F = case.value(player, "F", state).reshape(-1, d)
    x = case.centred + case.states[state].reshape(-1, d)
    x = x - x.mean(axis=0)
    torque = np.array([(x[:, i] * F[:, j] - x[:, j] * F[:, i]).sum() for i, j in combinations(range(d), 2)])
    reach = float(np.abs(x).max())
    return _resultant(case, player, state, torque, F, reach, "sum of |F| x size of the body")


def _resultant(case: Case, player: Player, state: str, total: Array, F: Array, reach: float, words: str) -> dict[str, Any]:
    scale = max(float(np.abs(F).sum()), float(case.force_floor(player).max())) * reach
    lost = float(case.lost_force(player, case.states[state]).max()) * reach
    reason = "1e-12 is for round-off: forces between the vertices of an element cancel"
    return as_a_whole(float(np.abs(total).max()), scale, lost, words, reason)


def _symmetry(case: Case, player: Player, state: str) -> dict[str, Any]:
    case.refuse_undefined(player, state)
    K, lost = case.value(player, "K", state), case.lost_stiffness(player, case.states[state])
    reason = "1e-12 is for round-off of the diagonal blocks: second derivatives commute"
    if issparse(K):
        rows = np.maximum(largest_rows(K, case.mesh.d), case.stiffness(player))
        return by_entry(case.mesh, K - K.T, rows, lost, "largest |K| of the rows, now or at rest", reason)
    rng = case.random("symmetry")
    x, y = rng.standard_normal((2, K.shape[0]))
    Kx, Ky = K @ x, K @ y
    largest = (largest_component(values, case.mesh.d) for values in (x, y))
    loss = case.mesh.d**2 * float(next(largest) @ lost @ next(largest))
    return as_a_whole(abs(float(y @ Kx - x @ Ky)), float(np.abs(y * Kx).sum()), loss, "sum of |y K x|, random x and y", reason)


def rigid_motions(X: Array) -> Array:
    """(ndofs, d (d + 1)/2) translations and infinitesimal rotations about the origin of `X` (nv, d), largest entry 1."""
    d = X.shape[1]
    modes = []
    for i in range(d):
        modes.append(np.tile(np.eye(d)[i], (len(X), 1)))
    for i, j in combinations(range(d), 2):
        spin = np.zeros_like(X)
        spin[:, i], spin[:, j] = -X[:, j], X[:, i]
        modes.append(spin / np.abs(X).max())
    return np.stack([mode.ravel() for mode in modes], axis=1)


def _rigid_modes(case: Case, player: Player) -> dict[str, Any]:
    u = np.zeros(case.mesh.p.size)
    K = player.K(u)
    error = np.max([np.abs(K @ mode) for mode in rigid_motions(case.centred).T], axis=0)
    lost = case.lost_product(player, u, np.ones(case.mesh.p.size))
    reason = "1e-12 is for round-off: translations and rotations strain nothing to first order"
    return by_vertex(case.mesh, error, case.stiffness(player), lost, "largest |K| of the row, modes of size 1", reason)
