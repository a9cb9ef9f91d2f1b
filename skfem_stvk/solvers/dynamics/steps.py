"""Steps of a motion: failed steps are made in parts, and steps of explicit integrators follow the critical one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StvkError, warn
from ...mesh.displacements import by_vertex
from ...system import System
from ...terms.loads.load import Time
from ..newton.newton import End
from .integrators import Integrator, StepFailed
from .ledger_rows import LedgerWriter
from .motion import Motion
from .record import ROUNDED, Clock, MotionState, RunRecord
from .stable_step import StableStep

#: Largest number of times that `simulate` halves a step, down to 64 parts.
HALVINGS = 6
#: Number of consecutive steps that must be cut before a warning.
MANY = 10


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
    """

    def __init__(
        self, motion: Motion, integrator: Integrator, record: RunRecord, arrived: Callable[[MotionState], object], halvings: int
    ) -> None:
        """`arrived` is called with the state after each part of a step."""
        self._motion, self._record, self._arrived, self.halvings = motion, record, arrived, halvings
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

    def remove(self, elements: NDArray[np.int64], writer: LedgerWriter | None) -> None:
        """Remove elements from the body at the state of the record, and enter this state in the ledger again, if there is one."""
        motion, record, state = self._motion, self._record, self._record.state
        if writer is None:
            motion.remove_elements(elements)
        else:
            writer.record_removal(state, lambda: motion.remove_elements(elements))
        record.add_removed(elements, state.t)
        record.history = motion.body.after_step(record.history)
        state.v.reshape(-1, motion.system.mesh.d)[motion.system.bare] = 0
        state.a[:] = 0
        self.start()
        if writer is not None:
            writer.append_row(state, self.stepper.strain_energy(state))

    def refuse_far(self, until: float) -> None:
        """Raise StvkError if rounded times do not resolve the steps before the end `until` [s]."""
        dt = self._record.clock.dt
        if not Clock(until, dt).resolves(dt):
            largest = ROUNDED * dt / np.finfo(float).eps
            text = f"until = {until:g} s; expected an end before {largest:.0e} s, up to which times resolve steps of {dt:.3g} s."
            raise StvkError(self._motion.system.units.text(text))

    def advance(self, t: float, whole: bool) -> None:
        """Advance to time `t`. A `whole` step advances the clock.

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

    def review(self, recompute: bool = False) -> None:
        """Review the length of the next steps after a whole step. `recompute`: elements were removed."""
        record = self._record
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
        self._arrived(state)


def _passed_contact(system: System, u0: Array, u1: Array, t: Time) -> str:
    """Return the name of a contact that is passed through from `u0` to `u1` over the step of `t`; "" if there is none."""
    x0, x1 = (by_vertex(system.mesh, u) for u in (u0, u1))
    return next((contact.name for contact in system.contacts_at(t) if contact.passes(x0, x1)), "")
