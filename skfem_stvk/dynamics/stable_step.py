"""Choice of the time step. The step of explicit integrators is compared with the critical step."""

from __future__ import annotations

from dataclasses import replace
from math import ulp

import numpy as np

from ..errors import StateError, StvkError, warn
from .critical_step import CriticalStep, LargestFrequency
from .damping import Damping, EdgeDamping, Rayleigh
from .integrators import Explicit, Integrator
from .motion import Motion
from .record import HALVINGS, Clock, MotionState, Reviews, RunRecord, Snapshot

#: Part of the critical step that is used by default. A step between the parts `LEAST` and `MOST` is retained as the body deforms.
SAFETY, LEAST, MOST = 0.85, 0.7, 0.88
#: The bound costs five to seven forces. While the step scaled with the bound changes by at most this part, it replaces the critical
#: step. Otherwise the critical step is computed, for sixty forces or more, unless a user-supplied step is below the bound.
MOVED = 0.04


class StableStep:
    """Time steps of an integrator for a motion: a stable step, or the user-supplied one.

    A user-supplied step above the critical step leads to one warning.
    """

    def __init__(self, motion: Motion, integrator: Integrator) -> None:
        self._user_dt, self._integrator, self._warned = integrator.dt, integrator, False
        self._last: CriticalStep | None = None
        self._motion, self._text = motion, motion.system.units.text
        self._largest = self._frequencies()

    def _frequencies(self) -> LargestFrequency | None:
        """Return the search for the largest frequency of the present body; None if it does not limit the step."""
        motion, integrator = self._motion, self._integrator
        if not isinstance(integrator, Explicit):
            return None
        weight = integrator.damping_weight  # factor of damping in the stability limit
        damping: Damping = [Rayleigh(weight * motion.alpha, weight * motion.beta), EdgeDamping(weight * motion.tau)]
        return LargestFrequency(motion.system, damping)

    def first(self, state: MotionState) -> tuple[float, Reviews]:
        """Return the first step [s] and the schedule of its reviews. Refuse a step that the rounding of times does not resolve."""
        dt, reviews = self._first(state)
        if not Clock(state.t, dt).resolves(dt):
            earlier = (
                f"t0 = {state.t:g} s; expected an earlier time for steps of dt = {dt:.4g} s, because times there are rounded to "
                f"{ulp(state.t):.2g} s. Count the time from 0: leave t0 out, and shift functions of t by t0."
            )
            raise StvkError(self._text(earlier))
        return dt, reviews

    @np.errstate(over="ignore", invalid="ignore")  # a body may be about to blow up
    def review(self, record: RunRecord, recompute: bool = False) -> tuple[float, Reviews]:
        """Return the step with which the motion continues [s], and the reviews after this one.

        The critical step is computed if a review is due. `recompute`: elements were removed, so the previous critical step
        is not valid.
        """
        state, clock, reviews = record.state, record.clock, record.reviews
        if recompute:
            self._largest = self._frequencies()
        if self._largest is None or self._warned or (record.steps < reviews.next and not recompute):
            return clock.dt, reviews
        share, has_user_dt = 0.5**reviews.halvings, self._user_dt is not None
        bound = self._largest.bound(state.u, state.t)
        before = reviews.step
        step, reviews = reviews.estimate(bound, record.steps)
        safe, moved = has_user_dt and clock.dt <= bound, not abs(step / before - 1) <= MOVED
        if not safe and (moved or recompute or (has_user_dt and clock.dt > step)):
            step, reviews = self._computed(state, reviews)
        if has_user_dt:
            self._warn(clock.dt, state.t)
        elif clock.dt > share * MOST * step or clock.dt < share * min(LEAST * step, reviews.largest):
            dt = share * min(SAFETY * step, reviews.largest)
            if not clock.resolves(dt):
                stiff = f"the body is so stiff there that steps would be of {dt:.2g} s, which rounded times do not resolve"
                raise StateError(self._text(stiff))
            return dt, reviews
        return clock.dt, reviews

    def halved(self, good: Snapshot) -> Snapshot | None:
        """Return the last good state with half the step; None if the step is user-supplied or was halved too often."""
        if self._user_dt is not None or good.reviews.halvings == HALVINGS:
            return None
        reviews = replace(good.reviews, halvings=good.reviews.halvings + 1)
        return replace(good, clock=Clock(good.clock.t, good.clock.dt / 2), reviews=reviews)

    def advice(self, record: RunRecord) -> str:
        """Return advice for a motion that has blown up."""
        dt, reviews = record.clock.dt, record.reviews
        if self._largest is None:
            chosen = getattr(self._integrator, "tangent", "exact")
            larger = "'clamped' allows larger steps in compression"
            return f"Try a smaller step than dt = {dt:.4g} s, or another tangent than {chosen!r}: {larger}."
        known = self._last or self._largest.at(record.state.u, record.state.t)
        found = "" if self._user_dt is None else ", dt=None to have it computed"
        halved = f", halved {_times(reviews.halvings)} from {reviews.largest:.4g} s at most" if reviews.halvings else ""
        was = f"The step was {dt:.4g} s{halved} ({known} at the last review)"
        return f"{was}: try a smaller step{found}, or an implicit integrator."

    def _first(self, state: MotionState) -> tuple[float, Reviews]:
        dt, reviews = self._user_dt, Reviews()
        if self._largest is None:
            assert dt is not None
            return dt, reviews
        if dt is not None:
            bound = self._largest.bound(state.u, state.t)
            reviews = replace(reviews, step=bound, bound=bound)
            if dt > bound:
                _, reviews = self._computed(state, reviews)
                self._warn(dt, state.t)
            return dt, reviews
        step, reviews = self._computed(state, reviews)
        if self._motion.states.any(bool(state.u.any())):  # a compressed body is soft, but will not stay compressed
            step = min(step, self._largest.at(np.zeros_like(state.u), state.t).step)
        if not np.isfinite(step):
            raise StvkError(
                "dt = None; expected a time step: no part that moves has stiffness, so every step is stable. Give dt=..."
            )
        return SAFETY * step, replace(reviews, largest=SAFETY * step)

    def _computed(self, state: MotionState, reviews: Reviews) -> tuple[float, Reviews]:
        """Return the critical step at this state, and the reviews that store it."""
        assert self._largest is not None
        self._last = self._largest.at(state.u, state.t)
        return self._last.step, replace(reviews, step=self._last.step, bound=self._last.bound)

    def _warn(self, dt: float, t: float) -> None:
        if self._last is not None and dt > self._last.step:
            self._warned = True
            above = (
                f"t = {t:.4g} s: the step dt = {dt:.4g} s is above the critical one, {self._last.step:.4g} s (safe bound "
                f"{self._last.bound:.4g} s): the motion will blow up. Take a smaller step, or dt=None to have it computed."
            )
            warn(self._text(above))


def halving_text(reviews: Reviews) -> str:
    """Return the part of the run's message about halved steps; empty if no steps were halved."""
    if not reviews.halvings:
        return ""
    return (
        f"; it blew up {_times(reviews.halvings)} on the way, and went on from the last good state with steps of at most "
        f"{0.5**reviews.halvings * reviews.largest:.4g} s in place of {reviews.largest:.4g} s"
    )


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"
