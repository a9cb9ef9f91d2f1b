"""The time step, that of explicit integrators held against the critical one."""

from __future__ import annotations

from dataclasses import replace
from math import ulp

import numpy as np

from ..errors import StateError, StvkError, warn
from .clock import HALVINGS, Clock
from .critical_step import CriticalStep, LargestFrequency
from .damping import EdgeDamping, Rayleigh
from .integrators import Explicit
from .motion import Motion
from .plan import Plan

#: Part of the critical step that is taken by default; between the other two it is kept as the body deforms.
SAFETY, LEAST, MOST = 0.85, 0.7, 0.88
#: While the bound, for the price of five to seven forces, is within this part of what it was, the critical step moves with it; else it is looked for,
#: for that of sixty or more: never for a given step that is below the bound.
MOVED = 0.04


class StableStep:
    """Gives a plan its clock, and watches that of explicit integrators.

    Raises
    ------
    StvkError
        if no step was given and none is too large, or the clock cannot tell the end of a step from its beginning.

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
        if plan.ledger is None:
            self._begin()

    def _begin(self) -> None:
        clock = self._plan.clock
        clock.dt = self._first()
        if not clock.resolves(clock.dt):
            raise StvkError(
                f"t0 = {clock.start:g} s is too late for steps of dt = {clock.dt:.4g} s: the numbers for times there are {ulp(clock.start):.2g} s apart. "
                "Count the time from 0: leave out t0, and let what is a function of t be one of t0 + t."
            )

    @np.errstate(over="ignore", invalid="ignore")  # where a body is about to blow up
    def review(self) -> None:
        """Look at the critical step again, if it is time.

        Raises
        ------
        StateError
            if K overflows, or the step that is found is too short for the clock.
        """
        looks = self._plan.looks
        share = 0.5**looks.halvings
        if self._largest is None or self._warned or self._plan.steps < looks.next:
            return
        u, clock, given = self._plan.state.u, self._plan.clock, self._plan.integrator.dt is not None
        bound = self._largest.bound(u, self._plan.state.t)
        step = looks.estimate(bound, self._plan.steps)
        safe, moved = given and clock.dt <= bound, not abs(step / looks.step - 1) <= MOVED
        if not safe and (moved or (given and clock.dt > step)):
            step = self._look().step
        if given:
            self._warn(clock.dt)
        elif clock.dt > share * MOST * step or clock.dt < share * min(LEAST * step, looks.largest):
            dt = share * min(SAFETY * step, looks.largest)
            if not clock.resolves(dt):
                raise StateError(f"steps would be of {dt:.2g} s, for the body is that stiff where it is, too short for the clock")
            clock.change(dt)

    def halve(self) -> bool:
        """Whether a motion that blew up may go on from its last good state: with steps half as long, if they were found, and not too often."""
        good = self._plan.good
        assert good is not None
        if self._plan.integrator.dt is not None or good.looks.halvings == HALVINGS:
            return False
        looks = replace(good.looks, halvings=good.looks.halvings + 1)
        self._plan.good = replace(good, clock=Clock(good.clock.t, good.clock.dt / 2), looks=looks)
        return True

    @property
    def remark(self) -> str:
        """That steps were halved, for the message of the run; empty if they were not."""
        looks = self._plan.looks
        if not looks.halvings:
            return ""
        return (
            f"; it blew up {_times(looks.halvings)} on the way, and went on from the last good state with steps of at most "
            f"{0.5**looks.halvings * looks.largest:.4g} s in place of {looks.largest:.4g} s"
        )

    def advice(self) -> str:
        """What to try after a motion has blown up."""
        clock = self._plan.clock
        if self._largest is None:
            chosen = getattr(self._plan.integrator, "tangent", "exact")
            return f"Try a smaller step than dt = {clock.dt:.4g} s, or another tangent than {chosen!r}: 'clamped' takes larger ones where bodies are pressed."
        known = f" ({self._last or self._look()} when it was looked at last)"
        found = "" if self._plan.integrator.dt is None else ", dt=None to have it found"
        looks = self._plan.looks
        halved = f", halved {_times(looks.halvings)} from {looks.largest:.4g} s at most" if looks.halvings else ""
        return f"The step was {clock.dt:.4g} s{halved}{known}: try a smaller one{found}, or an implicit integrator."

    def _first(self) -> float:
        dt = self._plan.integrator.dt
        if self._largest is None:
            assert dt is not None
            return dt
        if dt is not None:
            bound = self._largest.bound(self._plan.state.u, self._plan.state.t)
            self._plan.looks.step = self._plan.looks.bound = bound
            if dt > bound:
                self._look()
                self._warn(dt)
            return dt
        last = self._look()
        rest = last if not self._plan.state.u.any() else self._largest.at(np.zeros_like(self._plan.state.u), self._plan.state.t)
        step = min(last.step, rest.step)  # a body that is pressed is soft, and will not stay so
        if not np.isfinite(step):
            raise StvkError("No time step came, and any is stable: nothing that moves has stiffness. Give one: dt=...")
        self._plan.looks.largest = SAFETY * step
        return SAFETY * step

    def _look(self) -> CriticalStep:
        assert self._largest is not None
        self._last = self._largest.at(self._plan.state.u, self._plan.state.t)
        self._plan.looks.step, self._plan.looks.bound = self._last.step, self._last.bound
        return self._last

    def _warn(self, dt: float) -> None:
        if self._last is not None and dt > self._last.step:
            self._warned = True
            warn(
                f"t = {self._plan.state.t:.4g} s: the step dt = {dt:.4g} s is above the critical one, {self._last.step:.4g} s (safe bound "
                f"{self._last.bound:.4g} s): the motion will blow up. Take a smaller one, or dt=None to have it found."
            )


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


def _weighed(motion: Motion, weight: float) -> list[Rayleigh | EdgeDamping]:
    """The damping as it counts for stability."""
    return [Rayleigh(weight * motion.alpha, weight * motion.beta), EdgeDamping(weight * motion.tau)]
