"""A reduced body is its body in the span of its fields: W, F and K at states that are not small, derivatives, symmetry, the basis.

`u = columns z`, z all amounts, those of lifts among them, so that W is held against `W(u)`, `dW/dz` against `columns' F(u)`, and
`d2W/dz2` against `columns' K(u) columns`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ...arguments import Array
from ...system import System
from ..judgement import LIMIT
from ..players import Player
from ..results import Task
from .agreement import DERIVATIVES, STENCIL, taylor_order

REDUCED, FULL = "the reduced body", "the body"
AGREEMENT = "1e-12 is for round-off of sums over all elements in another order; 1e-15 is usual"
#: The largest displacements of the states, as parts of the body's size.
STATES = {"at rest, nearly": 1e-4, "small": 0.02, "large": 0.3}


@runtime_checkable
class OfFewUnknowns(Protocol):
    """A body whose displacements are `columns z`: the first `size` of the z are unknown, and their fields orthonormal by `masses`
    (ndofs,)."""

    @property
    def body(self) -> System: ...
    @property
    def columns(self) -> Array: ...
    @property
    def masses(self) -> Array: ...
    @property
    def size(self) -> int: ...
    @property
    def quartic(self) -> bool: ...
    def response(self, z: Array) -> tuple[float, Array, Array]: ...


def checks_of_reduced(reduced: OfFewUnknowns, rng: np.random.Generator) -> Iterator[Task]:
    """The tasks of a reduced body."""
    player = Player(REDUCED, reduced, reduced.size)
    yield Task("orthonormality", player, "V' M V", "", "", partial(_orthonormal, reduced), against="the identity")
    size = float(np.linalg.norm(np.ptp(reduced.body.mesh.p, axis=1)))
    for state, amount in STATES.items():
        z, v = (_amounts(reduced, amount * size, rng) for _ in range(2))
        for number, quantity in enumerate("WFK"):
            yield Task("agreement", player, quantity, state, "", partial(_difference, reduced, z, number), against=FULL)
        for number, quantity in enumerate("FK"):
            test = partial(_stencil if reduced.quartic else _taylor, reduced, z, v, number)
            yield Task("derivatives", player, quantity, state, "", test)
        yield Task("symmetry", player, "K", state, "", partial(_symmetry, reduced, z))


def _amounts(reduced: OfFewUnknowns, largest: float, rng: np.random.Generator) -> Array:
    """Random amounts, of which softer fields have more, with a largest displacement."""
    K = reduced.response(np.zeros(reduced.columns.shape[1]))[2]
    z = rng.standard_normal(len(K)) / np.sqrt(np.maximum(np.diagonal(K), np.finfo(float).tiny))
    return np.asarray(z * largest / np.abs(reduced.columns @ z).max())


def _orthonormal(reduced: OfFewUnknowns) -> dict[str, Any]:
    V = reduced.columns[:, : reduced.size]
    error = np.abs(V.T @ (reduced.masses[:, None] * V) - np.eye(reduced.size)).max()
    return {"measured": float(error), "limit": LIMIT, "scale": "1", "reason": "1e-12 is for round-off of a sum over all nodes"}


def _difference(reduced: OfFewUnknowns, z: Array, number: int) -> dict[str, Any]:
    """W, F or K against those of the body."""
    V, u = reduced.columns, reduced.columns @ z
    full: Callable[[], Any] = (
        lambda: reduced.body.energy(u),
        lambda: V.T @ reduced.body.internal_force(u),
        lambda: V.T @ (reduced.body.tangent(u) @ V),
    )[number]
    truth = np.asarray(full())
    return _relative(np.asarray(reduced.response(z)[number]) - truth, truth, "largest entry of the body's", AGREEMENT)


def _along(reduced: OfFewUnknowns, z: Array, v: Array, number: int, s: float) -> Array:
    return np.atleast_1d(np.array(reduced.response(z + s * v)[number]))


def _stencil(reduced: OfFewUnknowns, z: Array, v: Array, number: int) -> dict[str, Any]:
    """The derivative of W or F along a line, exactly, against F or K."""
    claimed = np.atleast_1d(reduced.response(z)[number + 1] @ v)
    terms = np.array([weight * _along(reduced, z, v, number, s) for s, weight in STENCIL])
    return _relative(terms.sum(axis=0) - claimed, terms, "largest term of the stencil", DERIVATIVES)


def _taylor(reduced: OfFewUnknowns, z: Array, v: Array, number: int) -> dict[str, Any]:
    return taylor_order(partial(_along, reduced, z, 0.1 * v, number), 0.1 * np.atleast_1d(reduced.response(z)[number + 1] @ v))


def _symmetry(reduced: OfFewUnknowns, z: Array) -> dict[str, Any]:
    K = np.asarray(reduced.response(z)[2])
    return _relative(K - K.T, K, "largest entry of K", "1e-12 is for round-off")


def _relative(error: Array, truth: Array, words: str, reason: str) -> dict[str, Any]:
    scale = float(np.abs(truth).max())
    measured = float(np.abs(error).max()) / scale if scale else np.inf
    return {"measured": measured, "limit": LIMIT, "scale": f"{scale:.3e} ({words})", "reason": reason}
