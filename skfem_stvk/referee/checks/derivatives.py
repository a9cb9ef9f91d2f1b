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

from ..case import Case
from ..places import worst_places
from ..players import Player
from ..states import INVERTED, UNDEFINED
from ..tasks import NotApplicable, Task

Array = NDArray[np.float64]

STENCIL = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))
ORDER = 1.9


def derivatives(case: Case) -> Iterator[Task]:
    """`dW/du = F` and `dF/du = K` of every player in every state."""
    for player in case.players:
        test = _stencil if case.is_stvk(player) else _taylor
        for state in case.states:
            for quantity, needs in (("F", "WF"), ("K", "FK")):
                yield Task("derivatives", player, quantity, state, needs, partial(test, case, player, quantity, state))


def _line(case: Case, player: Player, quantity: str, state: str) -> tuple[Callable[[float], Array], Array]:
    """The function along a line scaled to the state, and its claimed derivative at 0."""
    u = case.states[state]
    v = case.direction(u, case.random(f"derivatives {state}"))
    if quantity == "F":
        return lambda s: np.array([player.W(u + s * v)]), np.array([player.F(u) @ v])
    return lambda s: player.F(u + s * v), np.asarray(player.K(u) @ v)


def _stencil(case: Case, player: Player, quantity: str, state: str) -> dict[str, Any]:
    function, claimed = _line(case, player, quantity, state)
    limit = case.limit()
    terms = np.array([weight * function(s) for s, weight in STENCIL])
    error = np.abs(terms.sum(axis=0) - claimed)
    scale = max(float(np.abs(terms).max()), np.finfo(float).tiny)
    return {
        "measured": error.max() / scale,
        "limit": limit,
        "scale": f"{scale:.3e} (largest term of the stencil)",
        "reason": "five-point stencil, exact for this law, so only round-off is left: 1e-15 is usual; flat elements cost more",
        "worst": worst_places(case.mesh, error, limit * scale) if quantity == "K" else {},
    }


def _taylor(case: Case, player: Player, quantity: str, state: str) -> dict[str, Any]:
    """`|f(s) - f(0) - s f'(0)|` must fall with order 2: the deficit from 2 of the fitted order is measured."""
    if state in INVERTED:
        raise NotApplicable(UNDEFINED)
    function, claimed = _line(case, player, quantity, state)
    start = function(0.0)
    steps = 0.5 ** np.arange(2, 16)
    remainders = np.array([np.abs(function(s) - start - s * claimed).max() for s in steps])
    round_off = 1e3 * np.finfo(float).eps * max(float(np.abs(start).max()), float(np.abs(claimed).max()))
    usable = np.flatnonzero(~(remainders <= round_off))
    order = _fitted_order(steps[usable], remainders[usable]) if len(usable) >= 3 else 2.0
    return {
        "measured": 2 - order,
        "limit": 2 - ORDER,
        "scale": f"order {order:.2f} fitted to {len(usable)} of {len(steps)} steps, those above round-off",
        "reason": f"Taylor test: the remainder of a right derivative falls with order 2, that of a wrong one with 1; at least {ORDER} asked",
    }


def _fitted_order(steps: NDArray[Any], remainders: NDArray[Any]) -> float:
    """Slope of the last half of the usable steps, where the leading term rules."""
    half = slice(len(steps) // 2 if len(steps) >= 6 else 0, None)
    return float(np.polyfit(np.log(steps[half]), np.log(remainders[half]), 1)[0])
