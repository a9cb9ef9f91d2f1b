"""Steps of a motion: failed steps are made in parts, and steps of explicit integrators follow the critical one."""

from __future__ import annotations

from dataclasses import replace
from math import ulp

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StateError, StvkError, warn
from ...mesh.displacements import by_vertex
from ...system import System
from ...terms.loads.load import Time
from ..newton.newton import End
from .critical_step import CriticalStep, LargestFrequency
from .damping import Damping, EdgeDamping, Rayleigh
from .integrators import Explicit, Integrator, StepFailed
from .ledger_rows import LedgerWriter
from .motion import Motion
from .record import HALVINGS as MOST_BLOW_UPS
from .record import ROUNDED, Clock, MotionState, Reviews, RunRecord, Snapshot

#: Largest number of times that `simulate` halves a step, down to 64 parts.
HALVINGS = 6
#: Number of consecutive steps that must be cut before a warning.
MANY = 10
#: Smallest part of the first step that is used. A step below it has collapsed, and the motion would not proceed.
FLOOR = 1e-5
#: Part of the critical step that is used by default. A step between the parts `LEAST` and `MOST` is retained as the body deforms.
SAFETY, LEAST, MOST = 0.85, 0.7, 0.88
#: The bound costs five to seven forces. While the step scaled with the bound changes by at most this part, it replaces the critical
#: step. Otherwise the critical step is computed, for sixty forces or more, unless a user-supplied step is below the bound.
MOVED = 0.04


class Steps:
    """Steps of an integrator from the state of a record. It writes the state, the clock, the reviews and the counts of the record.

    If the record has no step length yet, the first one is chosen. `start` must be called before the first step.

    Attributes
    ----------
    stepper
        Stepper of the integrator for this motion.
    limit
        Choice of the time step.
    halvings
        Largest number of times that a step is halved.
    writer
        Writer of the ledger, in which works are added after each part of a step; None without a ledger.
    """

    def __init__(self, motion: Motion, integrator: Integrator, record: RunRecord, halvings: int) -> None:
        self._motion, self._record, self.halvings = motion, record, halvings
        self.writer: LedgerWriter | None = None
        self.stepper, self.limit = integrator.stepper(motion), StableStep(motion, integrator)
        self.stepper.counts.add(record.counts)
        self.stepper.watch.add(record.watch.parts())
        record.counts, record.watch, record.ledger.units = self.stepper.counts, self.stepper.watch, motion.system.units
        if not record.clock.dt:
            record.clock.dt, record.reviews = self.limit.first(record.state)
        self._consecutive = 0

    def start(self) -> None:
        """Prepare for a step from the state of the record."""
        self._return_to(self._record.history)
        self.stepper.start(self._record.state)

    def append_row(self) -> None:
        """Append a row for the state of the record to the ledger, if there is one."""
        if self.writer is not None:
            state = self._record.state
            self.writer.append_row(state, self.stepper.strain_energy(state))

    def remove(self, elements: NDArray[np.int64]) -> None:
        """Remove elements from the body at the state of the record, and enter this state in the ledger again, if there is one."""
        motion, record, state = self._motion, self._record, self._record.state
        if self.writer is None:
            motion.remove_elements(elements)
        else:
            self.writer.record_removal(state, lambda: motion.remove_elements(elements))
        record.add_removed(elements, state.t)
        record.history = motion.body.after_step(record.history)
        state.v.reshape(-1, motion.system.mesh.d)[motion.system.bare] = 0
        state.a[:] = 0
        self.start()
        self.append_row()

    def refuse_far(self, until: float) -> None:
        """Raise StvkError if rounded times do not resolve the steps before the end `until` [s]."""
        dt = self._record.clock.dt
        if not Clock(until, dt).resolves(dt):
            largest = ROUNDED * dt / np.finfo(float).eps
            text = f"until = {until:g} s; expected an end before {largest:.0e} s, up to which times resolve steps of {dt:.3g} s."
            raise StvkError(self._motion.system.units.text(text))

    def advance(self, t: float, whole: bool) -> None:
        """Advance to time `t`, and append a row to the ledger. A `whole` step advances the clock.

        Raises
        ------
        StepFailed
            if no state was found, not even in the smallest parts. The state is that before the step.
        StateError
            if numbers overflow.
        """
        record = self._record
        cut = self._bisected(t)
        record.steps, record.cuts = record.steps + 1, record.cuts + cut
        if whole:
            record.clock.tick()
        if self.writer is not None:
            self.append_row()

    def review(self, recompute: bool = False) -> None:
        """Review the length of the next steps after a whole step. `recompute`: elements were removed."""
        record = self._record
        if not self.limit.needed:
            return
        dt, record.reviews = self.limit.review(record, recompute)
        if dt != record.clock.dt:
            record.clock.change(dt)

    def _return_to(self, history: tuple[Array, ...]) -> None:
        """Go back to the step that began with this history."""
        self._motion.body.return_to(history)
        self._motion.begin_step(history)

    def _bisected(self, t: float) -> bool:
        """Advance to time `t`, in parts if a step finds no state. Return whether it was made in parts."""
        state = self._record.state
        try:
            self._part(state, t)
        except StepFailed:
            if not self.halvings:
                raise
            before, history = state.copy(), self._record.history
            impulses = np.zeros_like(state.reaction), np.zeros_like(state.forces)
            try:
                self._halves(state, t, 1, impulses)
            except StepFailed:
                state.copy_from(before)
                self._record.history = history
                self._return_to(history)
                raise
            state.reaction, state.forces = impulses[0] / (t - before.t), impulses[1] / (t - before.t)
            self._consecutive += 1
            if self._consecutive == MANY:
                text = f"t = {t:.4g} s: {MANY} steps in a row had to be cut into parts. Take a smaller dt, or another tangent."
                warn(self._motion.system.units.text(text))
            return True
        self._consecutive = 0
        return False

    def _halves(self, state: MotionState, t: float, depth: int, impulses: tuple[Array, Array]) -> None:
        """Advance to time `t` in two parts or more, and add those of the forces on the body to the `impulses`."""
        for end in ((state.t + t) / 2, t):
            begin = state.t
            try:
                self._part(state, end)
            except StepFailed:
                if depth == self.halvings:
                    raise
                self._halves(state, end, depth + 1, impulses)
            else:
                for impulse, force in zip(impulses, (state.reaction, state.forces), strict=True):
                    impulse += (end - begin) * force

    def _part(self, state: MotionState, t: float) -> None:
        """Make one step of the integrator. The history becomes that of its beginning, unless it fails."""
        motion, body, system = self._motion, self._motion.body, self._motion.system
        before = state.copy() if len(state.forces) else None
        history = body.advanced(self._record.history, state.u, motion.moment(state.t))
        motion.begin_step(history)
        try:
            self.stepper.step(state, t)
            if before is not None and (name := _passed_contact(system, before.u, state.u, motion.moment(state.t))):
                state.copy_from(before)
                raise StepFailed(f"{End.CONTACT.value}: {name!r}")
        except StepFailed:
            self._return_to(self._record.history)
            if system.contacts:
                self.stepper.start(state)
            raise
        self._record.history = body.after_step(history)
        if before is not None:
            self.stepper.store_forces(before, state)
        if self.writer is not None:
            self.writer.add_work(state)


def _passed_contact(system: System, u0: Array, u1: Array, t: Time) -> str:
    """Return the name of a contact that is passed through from `u0` to `u1` over the step of `t`; "" if there is none."""
    x0, x1 = (by_vertex(system.mesh, u) for u in (u0, u1))
    return next((contact.name for contact in system.contacts_at(t) if contact.passes(x0, x1)), "")


class StepCollapsed(StateError):
    """Error for a stable step that has become too short for the motion to proceed. The state itself may be healthy."""


class StableStep:
    """Time steps of an integrator for a motion: a stable step, or the user-supplied one.

    A user-supplied step above the critical step leads to one warning. `needed`: whether stability limits the step.
    """

    def __init__(self, motion: Motion, integrator: Integrator) -> None:
        self._user_dt, self._integrator, self._warned, self.needed = integrator.dt, integrator, False, integrator.explicit
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
        if self._user_dt is not None or good.reviews.halvings == MOST_BLOW_UPS:
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
