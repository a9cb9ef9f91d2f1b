"""F is the derivative of W, and K is the derivative of F.

Along a line `u + s v` the energy of St. Venant-Kirchhoff is exactly a quartic in `s`, and the force a cubic. So the five-point stencil

    f'(0) = [ f(-2) - 8 f(-1) + 8 f(1) - f(2) ] / 12

has no truncation error, and there is no step size to choose. Other laws get a Taylor test with a fitted order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ..case import EPS, Case
from ..judgement import as_a_whole, by_vertex, largest_component
from ..players import Player
from ..tasks import CannotTell, Task

REASON = "1e-12 is for round-off, all that the five-point stencil leaves of this law; 1e-15 is usual"
STENCIL = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))
ORDER, DIRECTIONS = 1.9, 2


def derivatives(case: Case) -> Iterator[Task]:
    """`dW/du = F` and `dF/du = K` of every player in every state."""
    for player in case.players:
        test = _stencil if case.is_stvk(player) else _taylor
        for state in case.states:
            for quantity, needs in (("F", "WF"), ("K", "FK")):
                yield Task("derivatives", player, quantity, state, needs, partial(test, case, player, quantity, state))


Line = tuple[Callable[[float], Array], Array, Array]


def _lines(case: Case, player: Player, quantity: str, state: str) -> Iterator[Line]:
    """Functions along random lines scaled to the state, their claimed derivatives at 0, and the directions."""
    u, rng = case.states[state], case.random(f"derivatives {state}")
    for _ in range(DIRECTIONS):
        v = case.direction(u, rng)
        if quantity == "F":
            yield lambda s, v=v: np.array([player.W(u + s * v)]), np.array([player.F(u) @ v]), v  # type: ignore[misc]
        else:
            yield lambda s, v=v: player.F(u + s * v), np.asarray(player.K(u) @ v), v  # type: ignore[misc]


def _stencil(case: Case, player: Player, quantity: str, state: str) -> dict[str, Any]:
    u = case.states[state]
    return max((_along(case, player, quantity, u, *line) for line in _lines(case, player, quantity, state)), key=_badness)


def _along(
    case: Case, player: Player, quantity: str, u: Array, function: Callable[[float], Array], claimed: Array, v: Array
) -> dict[str, Any]:
    terms = np.array([weight * function(s) for s, weight in STENCIL])
    error, words = np.abs(terms.sum(axis=0) - claimed), "largest term of the stencil"
    d = case.mesh.d
    if quantity == "F":
        lost = max(abs(weight) * case.lost_energy(player, u + s * v) for s, weight in STENCIL)
        lost += float(case.lost_force(player, u) @ largest_component(v, d))
        return as_a_whole(float(error[0]), float(np.abs(terms).max()), lost, words, REASON)
    loss = np.max([abs(weight) * case.lost_force(player, u + s * v) for s, weight in STENCIL], axis=0)
    scale = case.round_off.around(largest_component(np.abs(terms).max(axis=0), d))
    return by_vertex(case.mesh, error, scale, loss + case.lost_product(player, u, v), f"{words} around", REASON)


def _taylor(case: Case, player: Player, quantity: str, state: str) -> dict[str, Any]:
    case.refuse_undefined(player, state)
    return max((_order(function, claimed) for function, claimed, _ in _lines(case, player, quantity, state)), key=_badness)


def _order(function: Callable[[float], Array], claimed: Array) -> dict[str, Any]:
    """`|f(s) - f(0) - s f'(0)|` must fall with order 2: the deficit from 2 of the fitted order is measured."""
    start, steps = function(0.0), 0.5 ** np.arange(2, 16)
    remainders = np.array([np.abs(function(s) - start - s * claimed).max() for s in steps])
    round_off = 1e3 * EPS * max(float(np.abs(start).max()), float(np.abs(claimed).max()))
    usable = np.flatnonzero(~(remainders <= round_off))
    if len(usable) >= 3:
        order, words = (
            _fitted_order(steps[usable], remainders[usable]),
            f"fitted to {len(usable)} of {len(steps)} steps, above round-off",
        )
    elif round_off < 1e-6 * steps[0] * float(np.abs(claimed).max()):
        order, words = 2.0, "linear along the line: no remainder above round-off"
    else:
        raise CannotTell(
            "round-off hides the derivative along the line: the values are too large for their changes, or never change"
        )
    return {
        "measured": 2 - order,
        "limit": 2 - ORDER,
        "scale": f"order {order:.2f}, {words}",
        "reason": f"Taylor test: the remainder of a right derivative falls with order 2, that of a wrong one with 1; at least {ORDER} asked",
    }


def _badness(measurement: dict[str, Any]) -> float:
    """How far beyond its limit it is, for the worst of several: not a number is worse than any."""
    return float(measurement["measured"]) / measurement["limit"] if np.isfinite(measurement["measured"]) else np.inf


def _fitted_order(steps: NDArray[Any], remainders: NDArray[Any]) -> float:
    """Slope of the last half of the usable steps, where the leading term rules."""
    half = slice(len(steps) // 2 if len(steps) >= 6 else 0, None)
    return float(np.polyfit(np.log(steps[half]), np.log(remainders[half]), 1)[0])
