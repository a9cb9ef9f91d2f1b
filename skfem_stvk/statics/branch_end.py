"""Where a path could not go on: whether its stable branch ends there, and which elements give way."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..errors import StateError, name_ids
from ..nonlinear.eigen import lowest_mode, nearest_mode
from ..results.monitors import point_of
from .equilibrium import Equilibrium

#: A branch ends where the lowest eigenvalue of K has fallen below this part of what it was at the start.
GIVEN_WAY = 0.1
#: So many elements take part most are named.
MOST_NAMED = 5


def branch_end(problem: Equilibrium, start: Array, t0: float, u: Array, t: float) -> str:
    """What there is to say of the last state `u` (ndofs,) of a path that began at `start`; nothing if its tangent is as stiff as ever.

    Nothing is said of a K that is not symmetric either, as loads that follow the body make it.
    """
    try:
        before = _lowest(problem, start, t0)
        now = None if before is None else _lowest(problem, u, t)
    except StateError:
        return ""
    if before is None or now is None or not now[0] < GIVEN_WAY * before[0]:
        return ""
    value, mode = now
    fallen = "K is not positive definite any more"
    if value > 0:
        fallen = f"the lowest eigenvalue of K has fallen to {value / before[0]:.2g} of that at the start"
    return f"the stable branch ends here. There {fallen}, and the body gives way most in {_where(problem, u, mode)}."


def _lowest(problem: Equilibrium, u: Array, t: float) -> tuple[float, Array] | None:
    """The lowest eigenvalue, or of a direct solver the one nearest to zero, and its mode; None if there is none to speak of."""
    mode = lowest_mode(problem, u, t) if problem.iterative else nearest_mode(problem, u, t)
    return None if mode is None or not problem.symmetric else (mode.value, mode.vector)


def _where(problem: Equilibrium, u: Array, mode: Array) -> str:
    """The elements that the mode deforms most, by the change of their edges."""
    mesh = problem.system.mesh
    v = mode.reshape(-1, mesh.d)
    moves = v[mesh.t] - v[mesh.t].mean(axis=0)
    most = np.argsort(-(moves**2).sum(axis=(0, 2)))[:MOST_NAMED]
    pressed = problem.system.smallest_stretch(u)
    return f"{name_ids(np.sort(most), 'element')}, near x = {point_of(mesh, most[0])}; the smallest principal stretch of all is {pressed:.2g}"
