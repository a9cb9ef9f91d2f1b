"""The time step, that of explicit integrators held against the critical one."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import StvkError, StvkWarning
from .clock import Clock
from .critical_step import CriticalStep, LargestFrequency
from .damping import EdgeDamping, Rayleigh
from .integrators import Explicit
from .motion import Motion
from .plan import Plan

#: Part of the critical step that is taken by default; between the other two it is kept as the body deforms.
SAFETY, LEAST, MOST = 0.85, 0.7, 0.88
#: While the bound, for the price of eight forces, is within this part of what it was, the critical step moves with it; else it is looked for, for
#: that of sixty.
MOVED = 0.04


class StableStep:
    """Gives a plan its clock, and watches that of explicit integrators.

    Raises
    ------
    StvkError
        if no step was given and none is too large.

    Warns
    -----
    StvkWarning
        if a step was given that is above the critical one, from the beginning or as the body deforms; once.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._warned = plan, False
        self._largest: LargestFrequency | None = None
        self._last: CriticalStep | None = None
        if isinstance(plan.integrator, Explicit):
            self._largest = LargestFrequency(plan.motion.system, _weighed(plan.motion, plan.integrator.damping_weight))
        if plan.clock is None:
            plan.clock = Clock(plan.state.t, self._first())

    def review(self) -> None:
        """Look at the critical step again, if it is time.

        Raises
        ------
        StateError
            if K overflows.
        """
        looks = self._plan.looks
        if self._largest is None or self._warned or self._plan.steps < looks.next:
            return
        u, clock, given = self._plan.state.u, self._plan.clock, self._plan.integrator.dt is not None
        assert clock is not None
        step = looks.estimate(self._largest.bound(u), self._plan.steps)
        if not abs(step / looks.step - 1) <= MOVED or (given and clock.dt > step):
            step = self._look().step
        if given:
            self._warn(clock.dt)
        elif clock.dt > MOST * step or clock.dt < min(LEAST * step, looks.largest):
            clock.change(min(SAFETY * step, looks.largest))

    def advice(self) -> str:
        """What to try after a motion has blown up."""
        clock = self._plan.clock
        assert clock is not None
        if self._largest is None:
            chosen = getattr(self._plan.integrator, "tangent", "exact")
            return f"Try a smaller step than dt = {clock.dt:.4g} s, or another tangent than {chosen!r}: 'clamped' takes larger ones where bodies are pressed."
        known = f" ({self._last} when it was looked at last)" if self._last is not None else ""
        found = "" if self._plan.integrator.dt is None else ", dt=None to have it found"
        return f"The step was {clock.dt:.4g} s{known}: try a smaller one{found}, or an implicit integrator."

    def _first(self) -> float:
        dt = self._plan.integrator.dt
        if self._largest is None:
            assert dt is not None
            return dt
        last = self._look()
        if dt is not None:
            self._warn(dt)
            return dt
        rest = last if not self._plan.state.u.any() else self._largest.at(np.zeros_like(self._plan.state.u))
        step = min(last.step, rest.step)  # a body that is pressed is soft, and will not stay so
        if not np.isfinite(step):
            raise StvkError("No time step came, and any is stable: nothing that moves has stiffness. Give one: dt=...")
        self._plan.looks.largest = SAFETY * step
        return SAFETY * step

    def _look(self) -> CriticalStep:
        assert self._largest is not None
        self._last = self._largest.at(self._plan.state.u)
        self._plan.looks.step, self._plan.looks.bound = self._last.step, self._last.bound
        return self._last

    def _warn(self, dt: float) -> None:
        if self._last is not None and dt > self._last.step:
            self._warned = True
            warnings.warn(
                f"t = {self._plan.state.t:.4g} s: the step dt = {dt:.4g} s is above the critical one, {self._last.step:.4g} s (safe bound "
                f"{self._last.bound:.4g} s): the motion will blow up. Take a smaller one, or dt=None to have it found.",
                StvkWarning,
                stacklevel=6,
            )


def _weighed(motion: Motion, weight: float) -> list[Rayleigh | EdgeDamping]:
    """The damping as it counts for stability."""
    return [Rayleigh(weight * motion.alpha, weight * motion.beta), EdgeDamping(weight * motion.tau)]
