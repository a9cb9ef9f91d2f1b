"""The loop over the steps of a motion."""

from __future__ import annotations

from contextlib import suppress

from ..errors import StateError, warn
from ..results.files import WriteError
from ..results.monitors import Finding, Monitors
from .books import Books
from .guard import Guard, from_nowhere
from .integrators import StepFailed
from .inversions import Inversions
from .jumps import Jumps
from .outputs import Outputs
from .plan import Plan
from .progress import Progress
from .run import Interrupted, Run, SimulationError
from .stable_step import StableStep
from .status import Status
from .stepping import Cutting

#: A closure error from this part of the energy on is said.
WORTH_SAYING = 0.05


class Loop:
    """Steps, books, outputs and guards of one run, until its end.

    Parameters
    ----------
    until : the end [s].
    """

    def __init__(self, plan: Plan, until: float, quiet: bool) -> None:
        self.plan, self._until, self._quiet = plan, until, quiet
        self._stepper = plan.integrator.stepper(plan.motion)
        self._go_on_counting()
        self._limit = StableStep(plan)
        self._books = Books(plan.motion, plan.places, plan.ledger, plan.clock.dt)
        self._begin()
        self._inversions = Inversions(plan, self._books.ledger)
        self._monitors = Monitors(plan.motion.system, ellipticity=False)
        self._outputs = Outputs(plan, self._books.ledger, self._stepper.watch)
        self._cutting = Cutting(self._stepper, self._books, plan.cuts)
        self._jumps = Jumps(plan.motion, plan.state)
        self._stepping = False

    def _go_on_counting(self) -> None:
        """From what a run that is resumed took before."""
        self._stepper.counts.add(self.plan.counts)
        self._stepper.watch.add(self.plan.seconds)
        self.plan.counts = self._stepper.counts

    def _begin(self) -> None:
        """From the plan's state on, with what a run that is resumed there would know."""
        self._stepper.start(self.plan.state)
        self._books.begin(self.plan.state)
        if self._books.ledger.steps == 0:
            self._books.enter(self.plan.state, self._stepper.energy)
        self._guard = Guard(self._books.ledger, self.plan)

    def run(self, raise_on_failure: bool) -> Run:
        """All steps; errors as of `simulate`."""
        status, detail = Status.FINISHED, ""
        cause: BaseException | None = None
        plan, ledger = self.plan, self._books.ledger
        for finding in self._monitors.before():
            warn(finding.text)
        header = f"{plan.motion.system!r}, {len(plan.motion.free.free)} of them free; {plan.integrator}"
        with Progress(header, ledger, plan.steps, self._quiet) as progress:
            try:
                self._outputs.begin()
                status, detail = self._steps(progress)
                while status is Status.BLEW_UP and self._goes_on():
                    status, detail = self._steps(progress)
                self._outputs.close()
            except (KeyboardInterrupt, Exception) as error:  # a full disk, a load's function that fails: the run so far is kept
                status, cause = Status.INTERRUPTED, error
                detail = self._rescue(error)
        run = self._result(status, detail, cause)
        if isinstance(cause, KeyboardInterrupt):
            raise Interrupted(run)
        if cause is not None or (raise_on_failure and not run.success):
            raise SimulationError(run) from cause
        return run

    def _steps(self, progress: Progress) -> tuple[Status, str]:
        plan, state, clock = self.plan, self.plan.state, self.plan.clock
        while plan.at_a_step and clock.left(self._until):
            t, whole = clock.next(self._until)
            if not whole:
                self._outputs.checkpoint()
            status, detail = self._step(t, whole)
            if plan.motion.moving:
                self._jumps.look(t, state.u[plan.motion.free.fixed] if state.t == t else None)  # a jump may be why
            if not status.success:
                return status, detail
            self._inversions.look(last=not whole or not clock.left(self._until))
            if whole:
                self._outputs.step()
            progress.step(plan.steps, plan.steps + (clock.left(self._until) if whole else 0))
        return Status.FINISHED, ""

    def _step(self, t: float, whole: bool) -> tuple[Status, str]:
        """Go on to time `t`, with all that belongs to a step; how that came out."""
        plan, state = self.plan, self.plan.state
        self._stepping = True
        try:
            self._cutting.advance(state, t)
            plan.steps, plan.cuts = plan.steps + 1, self._cutting.cuts
            if whole:
                plan.clock.tick()
            self._books.enter(state, self._stepper.energy)
            if self._guard.blown_up():
                total = self._books.ledger["total_energy"][-1]
                return Status.BLEW_UP, f"energy came from nowhere, {total:.3g} J in all at t = {t:.6g} s"
            if whole:
                self._limit.review()
                self._guard.keep()
        except StepFailed as error:
            return Status.NOT_CONVERGED, str(error)
        except StateError as error:
            return Status.BLEW_UP, str(error).rstrip(".")
        self._stepping = False
        return Status.FINISHED, ""

    def _goes_on(self) -> bool:
        """Back to the last good state after a motion has blown up; whether it can go on from there, with shorter steps."""
        halved = self._limit.halve()
        self._back()
        self._outputs.back()
        if halved:
            self._begin()
        return halved

    def _rescue(self, error: BaseException) -> str:
        """Where an interrupted run ends: at the last whole step, or the last good state if it was in between; what to do next.

        A checkpoint of it is written, unless there is a later one, or results can no more be written.
        """
        plan, outputs = self.plan, self._outputs
        if self._stepping and (plan.integrator.explicit or plan.state.t != self._books.ledger["time"][-1]):
            self._back()  # implicit steps change the state in the end only
        if plan.outlets is None or plan.outlets.checkpoint is None:
            return ""
        full = isinstance(error, OSError)  # then a state may be missing from the series
        if plan.at_a_step and plan.steps > outputs.written and not full:
            with suppress(Exception):
                outputs.checkpoint()
        resume = f"checkpoint={str(plan.outlets.checkpoint.place)!r}, resume=True"
        if outputs.written < 0:
            return ""
        return f" {resume} goes on from there." if outputs.written == plan.steps else f" {resume} goes on from the last checkpoint."

    def _back(self) -> None:
        """To the last good state."""
        good = self.plan.good
        assert good is not None
        self.plan.restore(good)
        self._books.ledger.truncate(good.rows)

    def _result(self, status: Status, detail: str, cause: BaseException | None) -> Run:
        plan, state, ledger = self.plan, self.plan.state, self._books.ledger
        findings = self._monitors.at(state.u)
        if status is Status.FINISHED and any(finding.name == "inside out" for finding in findings):
            status = Status.INVERTED
        message = self._message(status, detail, cause, findings)
        return Run(
            plan.motion,
            plan.integrator,
            state.u.copy(),
            state.v.copy(),
            state.t,
            plan.clock.dt,
            status,
            message,
            findings,
            ledger,
            plan.counts.iterations,
            plan.cuts,
            self._stepper.watch.parts(),
            self._outputs.path,
        )

    def _message(self, status: Status, detail: str, cause: BaseException | None, findings: tuple[Finding, ...]) -> str:
        """The message of the run; `findings` are of its last state."""
        t = self.plan.state.t
        if status in (Status.FINISHED, Status.INVERTED):
            return ". ".join([self._reached(), *(finding.text.rstrip(".") for finding in findings)]) + "." * bool(findings)
        there = "".join(f" {finding.text}" for finding in findings if finding.name == "inside out")
        if status is Status.BLEW_UP:
            return f"blew up soon after t = {t:.6g} s, the last good state: {detail}.{there} {self._limit.advice()}"
        if status is Status.NOT_CONVERGED:
            return (
                f"the step from t = {t:.6g} s did not converge, not even in 64 parts: {detail}.{there} Try a smaller dt or another tangent"
                f"{'' if self._inversions.resisted else ', or VolumePenalty() among the terms if elements turn inside out'}."
            )
        if isinstance(cause, WriteError):
            return f"interrupted at t = {t:.6g} s: {cause}{detail}"
        if isinstance(cause, OSError):
            return f"interrupted at t = {t:.6g} s: results could not be written ({cause}). Make room, or choose another folder.{detail}{there}"
        by = f" by {type(cause).__name__}: {str(cause).rstrip('.')}" if str(cause) else ""
        return f"interrupted at t = {t:.6g} s{by}.{detail}{there}"

    def _reached(self) -> str:
        """That the end is reached, and what there is to say of the way."""
        plan = self.plan
        cuts = f", {plan.cuts} of them cut into smaller ones" if plan.cuts else ""
        gained = _gained(from_nowhere(self._books.ledger))
        way = f"{cuts}{self._stepper.remark}{self._limit.remark}{gained}{self._inversions.on_the_way()}"
        return f"reached t = {plan.state.t:.6g} s in {plan.steps} steps{way}"


def _gained(part: float) -> str:
    """In words, if it is worth saying."""
    if abs(part) < WORTH_SAYING:
        return ""
    return f"; the steps {'gained' if part > 0 else 'lost'} {abs(part) * 100:.0f} % of the energy (closure_error)"
