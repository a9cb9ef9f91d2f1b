"""Who notices that supports jump."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import name_ids, warn
from .motion import Motion
from .state import State

#: A step over which a support moves so many times faster than ever before is looked at: halved so often, and then it is a jump if such a part of
#: what it moved is still left. What is smooth, or has a kink, leaves next to nothing; a motion within a thousandth of a step is a jump to it.
FASTER, HALVINGS, LEFT = 2.0, 10, 0.25
#: Smaller ones, as a part of the body's size, do no harm.
SMALL = 1e-9
#: Steps over which a jump should be spread.
STEPS = 20


class Jumps:
    """Looks at how supports move, step by step, and warns of the first jump.

    The functions of the supports are asked for where a step began, ended, or where it is halved: never beyond the run.
    """

    def __init__(self, motion: Motion, state: State) -> None:
        self._motion, self._t = motion, state.t
        self._before, self._speed = state.u[motion.free.fixed], np.abs(state.v[motion.free.fixed])
        self._small = SMALL * float(np.ptp(motion.system.mesh.p, axis=1).max())
        self._looking = motion.moving

    def look(self, t: float, held: Array | None = None) -> None:
        """They are there at `t`; by default where their functions say.

        Warns
        -----
        StvkWarning
            if they have jumped; once.
        """
        if not self._looking or t == self._t:
            return
        held = self._motion.held(t) if held is None else held
        moved, h = np.abs(held - self._before), t - self._t
        fast = np.flatnonzero(moved > FASTER * h * self._speed + self._small)
        if len(fast):
            self._search((self._t, t), (self._before[fast], held[fast]), fast)
        np.maximum(self._speed, moved / h, out=self._speed)
        self._t, self._before = t, held

    def _search(self, times: tuple[float, float], ends: tuple[Array, Array], fast: NDArray[np.intp]) -> None:
        """Warn if those that are fast jump between these times, where they are at these ends."""
        found = self._first_jump(times, ends, fast, np.zeros(len(fast)), HALVINGS)
        if found is None:
            return
        t, sizes = found
        self._looking = False
        jumping = sizes > 0
        vertices = np.unique(self._motion.free.fixed[fast[jumping]] // self._motion.system.mesh.d)
        warn(
            f"t = {t:.6g} s: the supports of {name_ids(vertices, 'vertex')} jump by up to {sizes.max():.3g} m. What energy that puts in depends on dt: "
            f"let them get there by a ramp, over {STEPS} steps or more. To begin elsewhere, hand in u0=solve_static(...).u."
        )

    def _first_jump(
        self, times: tuple[float, float], ends: tuple[Array, Array], fast: NDArray[np.intp], most: Array, halvings: int
    ) -> tuple[float, Array] | None:
        """When it ends, and how far each of those that are fast moves in it, 0 for those that do not jump.

        `most` is the most that each was seen to move, the parts that are left are held against it.
        """
        moved = np.abs(ends[1] - ends[0])
        np.maximum(most, moved, out=most)
        moved[moved < LEFT * most] = 0
        if not moved.any() or not halvings:
            return (times[1], moved) if moved.any() else None
        middle = (times[0] + times[1]) / 2
        there = self._motion.held(middle)[fast]
        early = self._first_jump((times[0], middle), (ends[0], there), fast, most, halvings - 1)
        return early or self._first_jump((middle, times[1]), (there, ends[1]), fast, most, halvings - 1)
