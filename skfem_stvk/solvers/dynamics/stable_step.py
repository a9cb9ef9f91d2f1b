"""Choice of the time step. The step of explicit integrators is compared with the critical step."""

from __future__ import annotations

from dataclasses import replace
from math import ulp

import numpy as np

from ...errors import StateError, StvkError, warn
from ...mesh.displacements import by_vertex
from .critical_step import CriticalStep, LargestFrequency
from .damping import Damping, EdgeDamping, Rayleigh
from .integrators import Explicit, Integrator
from .motion import Motion
from .record import HALVINGS, Clock, MotionState, Reviews, RunRecord, Snapshot

#: Smallest part of the first step that is used. A step below it has collapsed, and the motion would not proceed.
FLOOR = 1e-5
#: Part of the critical step that is used by default. A step between the parts `LEAST` and `MOST` is retained as the body deforms.
SAFETY, LEAST, MOST = 0.85, 0.7, 0.88
#: The bound costs five to seven forces. While the step scaled with the bound changes by at most this part, it replaces the critical
#: step. Otherwise the critical step is computed, for sixty forces or more, unless a user-supplied step is below the bound.
MOVED = 0.04


class StepCollapsed(StateError):
    """Error for a stable step that has become too short for the motion to proceed. The state itself may be healthy."""


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
        due = record.steps >= reviews.next or recompute
        if self._largest is None or self._warned or not (due or self._has_friction):
            return clock.dt, reviews
        share, has_user_dt = 0.5**reviews.halvings, self._user_dt is not None
        step = reviews.latest
        if due:
            bound = self._largest.bound(state.u, state.t)
            before = reviews.step
            step, reviews = reviews.estimate(bound, record.steps)
            safe, moved = has_user_dt and clock.dt <= bound, not abs(step / before - 1) <= MOVED
            if not safe and (moved or recompute or (has_user_dt and clock.dt > step)):
                step, reviews = self._computed(state, reviews)
        step, cause = self._with_friction(step, state)
        if has_user_dt:
            self._warn(step, cause, state.t)
        elif clock.dt > share * MOST * step or clock.dt < share * min(LEAST * step, reviews.largest):
            dt = share * min(SAFETY * step, reviews.largest)
            if dt < share * FLOOR * reviews.largest or not clock.resolves(dt):
                why = cause or ", because the body is so stiff there"
                raise StepCollapsed(self._text(f"the stable step fell from {reviews.largest:.4g} s to {dt:.2g} s{why}"))
            return dt, reviews
        return clock.dt, reviews

    @property
    def _has_friction(self) -> bool:
        return any(contact.has_friction for contact in self._motion.system.contacts)

    def _with_friction(self, step: float, state: MotionState) -> tuple[float, str]:
        """Return the stable step with friction, at most `step` [s], and the cause if friction makes it much smaller.

        Friction is a dashpot at small slips. A step that is too long reverses velocities, so that friction does work. The limit is
        computed before each step, because normal forces change from step to step in an impact.
        """
        if self._largest is None or not self._has_friction:
            return step, ""
        system, mass = self._motion.system, self._largest.vertex
        x, drag = by_vertex(system.mesh, state.u), np.zeros(len(mass))
        for contact in system.contacts_at(self._motion.moment(state.t)):
            drag += contact.drag(x)
        rates = np.divide(drag, mass, out=np.zeros(len(mass)), where=mass > 0)
        node, half = int(rates.argmax()), step * float(rates.max()) / 4
        limited = step / (half + np.hypot(half, 1.0))  # (T/step)^2 + T rate/2 = 1
        cause = (
            f", because friction would reverse velocities at node {node} in longer steps. Take a larger slip_speed, or an implicit "
            "integrator"
        )
        return limited, cause if limited < LEAST * step else ""

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
            self._warn(*self._with_friction(reviews.step, state), state.t)
            return dt, reviews
        step, reviews = self._computed(state, reviews)
        if self._motion.states.comm.any(bool(state.u.any())):  # a compressed body is soft, but will not stay compressed
            step = min(step, self._largest.at(np.zeros_like(state.u), state.t).step)
        if not np.isfinite(step):
            raise StvkError(
                "dt = None; expected a time step: no part that moves has stiffness, so every step is stable. Give dt=..."
            )
        return SAFETY * self._with_friction(step, state)[0], replace(reviews, largest=SAFETY * step)

    def _computed(self, state: MotionState, reviews: Reviews) -> tuple[float, Reviews]:
        """Return the critical step at this state, and the reviews that store it."""
        assert self._largest is not None
        self._last = self._largest.at(state.u, state.t)
        return self._last.step, replace(reviews, step=self._last.step, bound=self._last.bound)

    def _warn(self, step: float, cause: str, t: float) -> None:
        """Warn once if the user-supplied step is above the stable one, `step`."""
        if self._user_dt is not None and self._user_dt > step:
            self._warned = True
            bound = "" if self._last is None else f" (safe bound {self._last.bound:.4g} s): the motion will blow up"
            above = (
                f"t = {t:.4g} s: the step dt = {self._user_dt:.4g} s is above the critical one, {step:.4g} s{cause or bound}. "
                "Take a smaller step, or dt=None to have it computed."
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
