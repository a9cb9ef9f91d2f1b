"""Loop over the steps of a motion."""

from __future__ import annotations

import numpy as np

from ...errors import StateError, warn
from ...linear.choose import header_text
from ...mesh.mesh import parts_line
from ...results.complete_files import WriteError
from ...results.monitors import Finding, Monitors
from ...results.penetration import contact_findings, start_within
from ...terms.loads.rigid_contact import rigid
from ...units import UnitSystem, remarks
from ..newton.outcome import Interrupted, Status, raise_if_divided, stop_if_requested
from .guards import EXPLICIT, IMPLICIT, Guard, Inversions, Jumps, inversion_text, relative_closure_error
from .integrators import BackwardEuler, StepFailed
from .ledger_rows import LedgerWriter, known_total
from .motion_outputs import MotionProgress, Outputs
from .options import Setup
from .record import MotionState, RunRecord
from .removal import Removal, removal_text
from .run import Run, SimulationError
from .stable_step import StepCollapsed, halving_text
from .steps import HALVINGS, Steps

#: Smallest closure error, as a part of the energy, that the message of the run mentions.
REPORTED = 0.05


class Loop:
    """Loop over the steps of one run. Only this object and its `Steps` write the record of the run; the other helpers read it."""

    def __init__(self, setup: Setup, record: RunRecord, outputs: Outputs, quiet: bool) -> None:
        self.setup, self.record, self._outputs, self._quiet = setup, record, outputs, quiet
        motion = setup.motion
        self._steps = Steps(motion, setup.integrator, record, self._arrived, HALVINGS)
        self._steps.refuse_far(setup.until)
        self._stepper, self._limit = self._steps.stepper, self._steps.limit
        self._ledger_writer = LedgerWriter(motion, setup.locations, record.ledger, record.clock.dt, setup.integrator.mean)
        self._begin()
        if record.origin is not None:
            self._stepper.rebuild(record.origin)
        self._inversions = Inversions(motion, self._inversion_interval())
        self._ledger_writer.set_inside_out(self._inversions.at_first(record))
        self._jumps = Jumps(motion, record.state)
        self._removal = None if setup.rule is None else Removal(motion, setup.rule)
        self._stepping = False

    def _inversion_interval(self) -> int:
        """Return the number of steps between two counts of inverted elements. On a basis, count only in saved states."""
        if self.setup.motion.body is not self.setup.motion.system:
            return self._outputs.saved_every
        return EXPLICIT if self.setup.integrator.explicit else IMPLICIT

    def _begin(self) -> None:
        """Start from the state of the record, using only data that a resumed run would have.

        If the ledger is empty, enter its first row.
        """
        record = self.record
        self._steps.start()
        self._ledger_writer.begin(record.state)
        if record.ledger.steps == 0:
            self._ledger_writer.append_row(record.state, self._stepper.strain_energy(record.state))
        if record.good is None:
            record.store_good_state()
        self._guard = Guard(record)

    def run(self, raise_on_failure: bool) -> Run:
        """Run all steps and return the result. Raises the errors of `simulate`."""
        status, detail = Status.FINISHED, ""
        cause: BaseException | None = None
        setup, record = self.setup, self.record
        for finding in self._monitors.before():
            warn(finding.text)
        free, solver, space = setup.motion.states.on(setup.motion.free.free), self._stepper.solver, setup.motion.system.space
        header = f"{setup.motion.body!r}, {free.count} of them free; {setup.integrator}"
        if free.comm.divided and solver is not None:
            header += f"; {header_text(solver, True)}"
        header += parts_line(setup.motion.system.mesh) + remarks(setup.motion.system)
        with MotionProgress(header, record.ledger, record.steps, self._quiet) as progress:
            try:
                self._outputs.save_if_due()
                status, detail = self._all_steps(progress)
                while status in (Status.BLEW_UP, Status.STOPPED) and self._restart_from_good_state():
                    status, detail = self._all_steps(progress)
                self._outputs.close()
            except (KeyboardInterrupt, Exception) as error:  # full disk or failing load: the run so far is retained
                raise_if_divided(space.comm, error)
                status, cause = Status.INTERRUPTED, error
                detail = self._end_interrupted(error)
        run = self._result(status, detail, cause)
        space.comm.end_step(False)  # issues the last warnings
        if isinstance(cause, KeyboardInterrupt):
            raise Interrupted(run)
        if cause is not None or (raise_on_failure and not run.success):
            raise SimulationError(run) from cause
        return run

    def _all_steps(self, progress: MotionProgress) -> tuple[Status, str]:
        record, motion, until = self.record, self.setup.motion, self.setup.until
        state, clock = record.state, record.clock
        while record.after_whole_step and (clock.steps_left(until) or (record.steps == 0 and state.t < until)):  # at least one step
            t, whole = clock.next(until)
            if not whole:
                self._outputs.checkpoint()
            status, detail = self._step(t, whole)
            if motion.moving:
                self._jumps.check(t, state.u[motion.free.fixed] if state.t == t else None)  # a jump may be the cause
            if not status.success:
                return status, detail
            inverted = self._inversions.count(record, last=not whole or not clock.steps_left(until))
            if inverted is not None:
                self._ledger_writer.set_inside_out(inverted)
            if whole:
                self._outputs.step()
            progress.step(record.steps, record.steps + (clock.steps_left(until) if whole else 0))
            if whole and clock.steps_left(until):
                stop_if_requested(motion.system.space.comm)
        return Status.FINISHED, ""

    @np.errstate(over="ignore", invalid="ignore")  # states that overflow are rejected later
    def _step(self, t: float, whole: bool) -> tuple[Status, str]:
        """Advance to time `t`, with all tasks of a step. Return the status and its explanation."""
        record, state = self.record, self.record.state
        self._stepping = True
        try:
            self._steps.advance(t, whole)
            self._ledger_writer.append_row(state, self._stepper.strain_energy(state))
            if self._guard.blown_up():
                total = known_total(record.ledger)[-1]
                return (
                    Status.BLEW_UP,
                    f"energy was created numerically, {total:.3g} {self._units.of('J')} in all at {self._time(t)}",
                )
            if whole:
                chosen = () if self._removal is None else self._removal.chosen(record)
                if len(chosen):
                    self._steps.remove(np.asarray(chosen), self._ledger_writer)
                self._steps.review(recompute=len(chosen) > 0)
                if len(chosen) or self._guard.is_good():
                    record.store_good_state()
            record.origin = self._stepper.origin
        except StepFailed as error:
            return Status.NOT_CONVERGED, str(error)
        except StateError as error:
            return Status.STOPPED if isinstance(error, StepCollapsed) else Status.BLEW_UP, str(error).rstrip(".")
        self._stepping = False
        return Status.FINISHED, ""

    @property
    def _units(self) -> UnitSystem:
        return self.setup.motion.system.units

    @property
    def _monitors(self) -> Monitors:
        """Search for elements at which the model is unreliable, in the present body."""
        return Monitors(self.setup.motion.system)

    def _arrived(self, state: MotionState) -> None:
        self._ledger_writer.add_work(state)

    def _restart_from_good_state(self) -> bool:
        """Return to the last good state after a motion has blown up.

        Return whether the motion can continue from there with shorter steps.
        """
        assert self.record.good is not None
        halved = self._limit.halved(self.record.good)
        self.record.good = halved or self.record.good
        self.record.return_to_good_state()
        self._outputs.discard_later_states()
        if halved:
            self._begin()
        return halved is not None

    def _end_interrupted(self, error: BaseException) -> str:
        """End an interrupted run at the last whole step, or at the last good state. Return a message with the next action."""
        record = self.record
        if self._stepping and (self.setup.integrator.explicit or record.state.t != record.ledger["time"][-1]):
            record.return_to_good_state()  # implicit steps change the state only at their end
        return self._outputs.resume_advice(error)

    def _result(self, status: Status, detail: str, cause: BaseException | None) -> Run:
        setup, record = self.setup, self.record
        setup.motion.begin_step(record.history)
        u, v = (setup.motion.states.expand(x) for x in (record.state.u, record.state.v))
        moment = setup.motion.moment(record.state.t)
        findings = (*self._monitors.at(u), *contact_findings(setup.motion.system, record.ledger, u, moment))
        if status is Status.FINISHED and any(finding.name == "inside out" for finding in findings):
            status = Status.ENDED_INVERTED
        message = self._units.text(self._message(status, detail, cause, findings))
        return Run(
            system=setup.motion.system,
            motion=setup.motion,
            integrator=setup.integrator,
            u=u.copy(),
            v=v.copy(),
            last=record.state.copy(),
            t=record.state.t,
            dt=record.clock.dt,
            status=status,
            message=message,
            findings=findings,
            ledger=record.ledger,
            iterations=record.counts.iterations,
            cuts=record.cuts,
            blow_ups=record.reviews.halvings,
            seconds=record.watch.parts(),
            series=self._outputs.path,
            removed=record.removed,
            removed_at=record.removed_at,
        )

    def _message(self, status: Status, detail: str, cause: BaseException | None, findings: tuple[Finding, ...]) -> str:
        """Return the message of the run. `findings` belong to its last state."""
        t = self.record.state.t
        if status in (Status.FINISHED, Status.ENDED_INVERTED):
            return ". ".join([self._reached(), *(finding.text.rstrip(".") for finding in findings)]) + "." * bool(findings)
        there = "".join(f" {finding.text}" for finding in findings if finding.name == "inside out")
        if status in (Status.BLEW_UP, Status.STOPPED):
            what = "blew up" if status is Status.BLEW_UP else "stopped"
            return f"{what} soon after {self._time(t)}, the last good state: {detail}.{there} {self._limit.advice(self.record)}"
        if status is Status.NOT_CONVERGED:
            penalty = ", or VolumePenalty() among the terms if elements invert" * (not self._inversions.resisted)
            parts = f"the step from {self._time(t)} did not converge, not even in 64 parts: {detail}.{there}"
            impacts = bool(self.setup.motion.system.contacts) and not isinstance(self.setup.integrator, BackwardEuler)
            if "contact" in detail and (soft := self._soft_contacts()):
                return f"{parts}{soft}"
            return (
                f"{parts}{start_within(self.setup.motion.system, self.record.ledger)} Try a smaller dt or another tangent"
                f"{', or BackwardEuler, which damps impacts' * impacts}{penalty}."
            )
        if isinstance(cause, WriteError):
            return f"interrupted at {self._time(t)}: {cause}{detail}"
        if isinstance(cause, OSError):
            remedy = "Free disk space, or choose another folder."
            return f"interrupted at {self._time(t)}: results could not be written ({cause}). {remedy}{detail}{there}"
        by = f" by {type(cause).__name__}: {str(cause).rstrip('.')}" if str(cause) else ""
        return f"interrupted at {self._time(t)}{by}.{detail}{there}"

    def _soft_contacts(self) -> str:
        """Return sentences on contacts that do not stop the body at its speed within their shapes; empty if all do."""
        motion, system = self.setup.motion, self.setup.motion.system
        mesh, v = system.mesh, np.abs(motion.states.expand(self.record.state.v).reshape(-1, system.mesh.d))
        per_size = system.body.lumped_mass.sum() / system.body.sizes.sum()  # density, or mass per area of membranes
        speed = np.sqrt((v**2).sum(axis=1))
        along = speed * (v @ mesh.extent) if mesh.k == mesh.d else speed**2  # speed^2 times the height
        impact = system.space.comm.most(float(np.sqrt(per_size * along.max(initial=0.0))))
        return "".join(one.too_soft(impact) for one in rigid(system.contacts))

    def _time(self, t: float) -> str:
        return f"t = {t:.6g} {self._units.of('s')}"

    def _reached(self) -> str:
        """Return the message that the end is reached, with notable events of the run."""
        record = self.record
        cuts = f", {record.cuts} of them cut into smaller ones" if record.cuts else ""
        gained = _gain_text(relative_closure_error(record.ledger))
        way = f"{cuts}{self._stepper.remark}{halving_text(record.reviews)}{gained}{inversion_text(record.ledger)}"
        way += removal_text(record.removed, record.removed_at)
        return f"reached {self._time(record.state.t)} in {record.steps} steps{way}"


def _gain_text(part: float) -> str:
    """Return the message about lost or gained energy; empty if it is within the tolerance."""
    if abs(part) < REPORTED:
        return ""
    return f"; the steps {'gained' if part > 0 else 'lost'} {abs(part) * 100:.0f} % of the energy (closure_error)"
