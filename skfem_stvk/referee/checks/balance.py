"""Internal forces balance, K is symmetric, and a rigid motion costs nothing at rest."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import issparse

from ..case import Case
from ..places import worst_places
from ..players import Player
from ..tasks import NotApplicable, Task

Array = NDArray[np.float64]


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
    return _resultant(
        case, F.sum(axis=0), max(float(np.abs(F).sum()), case.force_scale(player)), "sum of |F|, at least that of one edge"
    )


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
    return _resultant(case, torque, max(float(np.abs(F).sum()), case.force_scale(player)) * reach, "sum of |F| x size of the body")


def _resultant(case: Case, total: Array, scale: float, words: str) -> dict[str, Any]:
    return {
        "measured": np.abs(total).max() / scale if scale else np.inf,
        "limit": case.limit(),
        "scale": f"{scale:.3e} ({words})",
        "reason": "forces between the vertices of an element cancel to round-off",
    }


def _symmetry(case: Case, player: Player, state: str) -> dict[str, Any]:
    case.refuse_undefined(player, state)
    limit, K = case.limit(), case.value(player, "K", state)
    if issparse(K):
        difference = abs(K - K.T).tocsr()
        scale, words = float(abs(K).max()), "largest |K|"
        error = difference.max(axis=1).toarray().ravel()
    else:
        rng = case.random("symmetry")
        x, y = rng.standard_normal((2, K.shape[0]))
        Kx, Ky = K @ x, K @ y
        error, scale, words = np.array([abs(y @ Kx - x @ Ky)]), float(np.abs(y * Kx).sum()), "sum of |y K x|, random x and y"
    return {
        "measured": error.max() / max(scale, np.finfo(float).tiny),
        "limit": limit,
        "scale": f"{scale:.3e} ({words})",
        "reason": "second derivatives commute; only round-off of the diagonal blocks is left",
        "worst": worst_places(case.mesh, error, limit * scale) if len(error) == case.mesh.p.size else {},
    }


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
    limit, K = case.limit(), player.K(np.zeros(case.mesh.p.size))
    error = np.max([np.abs(K @ mode) for mode in rigid_motions(case.centred).T], axis=0)
    scale = case.stiffness_scale(player)
    return {
        "measured": error.max() / scale if scale else np.inf,
        "limit": limit,
        "scale": f"{scale:.3e} (largest K at rest, modes of size 1)",
        "reason": "translations and rotations strain nothing to first order",
        "worst": worst_places(case.mesh, error, limit * scale),
    }
