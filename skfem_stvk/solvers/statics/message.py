"""Messages of results: the outcome, its cause and advice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arguments import Array
from ...errors import StateError, name_ids
from ...results.monitors import point_of
from ...system import System
from ..newton.newton import End
from ..newton.outcome import Status
from ..newton.stability import Verdict, lowest_mode, nearest_mode
from .arc_length import ArcLength
from .equilibrium import Equilibrium
from .history import History

SOFTENS = "St. Venant-Kirchhoff material gives way in compression, so the branch without inversion may end here."
AGAINST_INVERSION = {
    False: "a term that resists inversion (VolumePenalty(), or NeoHookean in place of StVK), a finer mesh there, more steps, or a "
    "load that is spread over more of the boundary.",
    True: "more steps, a finer mesh there, a stiffer VolumePenalty if there is one, or a load that is spread over more of the "
    "boundary.",
}
#: Advice by the reason of a failure. For inverted elements it depends on whether there is a penalty already.
ADVICE = {
    End.NO_DESCENT: "Is there a mechanism: a part that only one vertex or edge joins to the rest, a flat membrane or a cable "
    "without tension? Fix it, stretch it first, or put it on an ElasticFoundation. If the body buckles there, give it a small "
    "imperfection.",
    End.NO_LENGTH: "Does the load push the body away without limit, or depend on the shape? Try more steps, or a smaller load.",
    End.OVERFLOW: "Are units mixed up, or is the load far too large for the stiffness?",
    End.TOO_SHARP: "Try more steps.",
    End.CONTACT: "Try more steps. If a shape or a support moves, let it move less per step.",
}
#: Advice if even the smallest first step inverts elements.
UNITS = "Not even a small part of the load is carried: check the units of material, mesh and load first (system.implausible())."
#: Advice if no state was found for a body without transverse stiffness at rest.
SLACK = (
    "Membranes and cables have no transverse stiffness without tension. Take one step (steps=1), or stretch them first, by "
    "displacements of their rim. Or simulate their motion under the load, and start from its end: run = "
    "simulate(system, BackwardEuler(dt), until=...), then solve_static(system, u0=run.u, t0=0.999)."
)
#: A branch ends if the lowest eigenvalue of K has fallen below this fraction of its value at the start.
SOFTENED = 0.1
#: Number of elements named that deform most.
MOST_NAMED = 5


def advice_after(end: End, system: System) -> str:
    """Return advice after a failed step."""
    softens = np.isfinite(system.smallest_stretch(np.zeros(system.ndofs)))  # only laws that soften return finite stretches
    advice = f"{SOFTENS} " * bool(softens) + f"Try {AGAINST_INVERSION[system.resists_inversion]}"
    if end is End.OUT_OF_ITERATIONS:
        return f"Look at the last state: result.plot(). {advice}"
    return advice if end is End.INSIDE_OUT else ADVICE[end]


@dataclass(frozen=True)
class Ending:
    """Data on the end of a solve, from which its message is written."""

    system: System
    status: Status
    method: str  # name of the continuation method
    history: History
    t0: float  # load factor at the start
    t: float  # load factor of the last state
    verdict: Verdict  # stability of the last state, if the path reached its end
    inverted: str  # names of inverted or flat elements
    branch: str  # sentence on whether a branch ends at the last state
    started: bool  # whether the path began at user-supplied displacements
    cause: BaseException | None  # exception that interrupted the solve


def reason(ending: Ending) -> str:
    """Return the message of a result."""
    status, history, t, verdict = ending.status, ending.history, ending.t, ending.verdict
    if status is Status.UNSTABLE:
        count = f"K has {verdict.negative} negative eigenvalue(s)" if verdict.negative else "K is not positive definite"
        known = "a small part of result.critical_points[0].mode as an imperfection"
        mode = known if history.critical_points else "a small imperfection"
        otherwise = ", or prescribe displacements instead of loads" if ending.system.loads else ""
        return (
            f"At t = {t:.4g} the body is in equilibrium, but unstable: {count}, and a real body would leave this "
            f"state.{_critical(history)} To find a stable state nearby, give the mesh {mode}{otherwise}."
        )
    if status is Status.INVERTED:
        found = f"At t = {t:.4g} the body is in equilibrium, but inverted or flat in {ending.inverted}."
        if ending.system.resists_inversion:
            return (
                f"{found} The forces that push such elements back are in balance there. Start from another state; for quadratic "
                "elements, from the state that linear ones find (degree=1)."
            )
        return (
            f"{found} The energy does not change when an element is mirrored, so this state solves the equations, but no body can "
            "be in it. Start from a state without inverted elements, or add a term that pushes them back: "
            "VolumePenalty(kind='compression')."
        )
    if status is Status.INTERRUPTED:
        by = "" if isinstance(ending.cause, KeyboardInterrupt) else f" by {type(ending.cause).__name__}: {ending.cause}"
        count = "1 state" if len(history) == 1 else f"{len(history)} states"
        return f"Interrupted at t = {t:.6g}{by.rstrip('.')}. Found so far: {count}."
    if status is Status.STOPPED:
        where = "before its end" if ending.method == ArcLength.name else "before the full load"
        unstable = len(history) and history[-1].negative
        already = f" The last state is unstable: K has {unstable} negative eigenvalue(s) there." if unstable else ""
        return f"Stopped {where}, at t = {t:.6g}{_cause_and_advice(ending)}{already}{_critical(history)}{_found(history)}"
    residual = history[-1].iterations.residuals[-1]
    end = f"the path is followed to its end at t = {t:.6g}" if ending.method == ArcLength.name else "the full load is reached"
    doubt = f" {verdict.doubt}" if verdict.doubt else ""
    rounding = "" if status is Status.CONVERGED else " as far as rounding allows"
    remark = history[-1].iterations.detail
    seen = f"{' ' * bool(remark)}{remark}{doubt}{_jumped(history)}{_critical(history)}{_found(history)}"
    return f"Converged: {end}{rounding}, residual {residual:.1e} of loads and reactions.{seen}"


def _may_be_slack(system: System) -> bool:
    """Return whether a body has membranes or cables, which have no transverse stiffness at rest."""
    return any(body.mesh.k < body.mesh.d for body in (system.body, *system.body.beside))


def _cause_and_advice(ending: Ending) -> str:
    history, t, penalty = ending.history, ending.t, ending.system.resists_inversion
    if not history.ends_in_failure:
        return f": the stop is not reached after {len(history)} states. Give a stop on the path, or Stop(states=...)."
    last = history.attempts[-1]
    detail = f" ({last.iterations.detail})" if last.iterations.detail else ""
    if last.t == t:
        start = "Let loads and displacements that act at the start grow with t."
        if ending.started:
            push_back = ", or add VolumePenalty(kind='compression'), which pushes inverted elements back" * (not penalty)
            start = f"No equilibrium was found from u0. Give another u0{push_back}."
        elif ending.system.contacts:
            start = "Does the body start in a contact? Move them apart, and let the motion of the shape press them together."
        slack = f" {SLACK}" * _may_be_slack(ending.system)
        return f": {last.end.value}{detail}, before the first step. {start} {advice_after(last.end, ending.system)}{slack}"
    failed = f"{last.end.value}{detail}, even in a step of {abs(last.t - t):.1e}."
    if t == ending.t0 and _may_be_slack(ending.system):
        return f": {failed} {SLACK}"
    if not ending.branch:
        units = f" {UNITS}" * (t == ending.t0 == 0.0 and last.end is End.INSIDE_OUT and bool(ending.system.loads))
        return f": {failed}{units} {advice_after(last.end, ending.system)}"
    beyond = "To follow the unstable path beyond it, use method='arc-length'."
    material = f"If the material gives way in compression, try {AGAINST_INVERSION[penalty]}"
    return f": {ending.branch} Beyond it, {failed} {beyond} {material}"


def _jumped(history: History) -> str:
    """Return a sentence on load steps that ended far from the extrapolated state; empty if there are none."""
    befores = [None, *history[:-1]]
    jumps = [(before, step) for before, step in zip(befores, history, strict=True) if step.jumped]
    if not jumps:
        return ""
    before, step = jumps[0]
    where = f"Before t = {step.t:.4g}" if before is None else f"Between t = {before.t:.4g} and t = {step.t:.4g}"
    return (
        f" {where} it moved {step.jump:.2g} times as far as extrapolated: the body snapped or buckled there. "
        "method='arc-length' follows the path in between."
    )


def _critical(history: History) -> str:
    points = history.critical_points
    if not points:
        return ""
    named = "; ".join(map(str, points[:3])) + ("; ..." if len(points) > 3 else "")
    return f" On the way: {named} (result.critical_points has their modes)."


def _found(history: History) -> str:
    """Return the findings of the monitors in the last state."""
    return "".join(f" {finding.text}" for finding in history[-1].findings) if len(history) else ""


def branch_end(problem: Equilibrium, start: Array, t0: float, u: Array, t: float) -> str:
    """Return a sentence on the end of the branch at the last state `u` of a path that began at `start`.

    It is empty if K is not symmetric, or if its lowest eigenvalue is still large.
    """
    try:
        before = _lowest(problem, start, t0)
        now = None if before is None else _lowest(problem, u, t)
    except StateError:
        return ""
    if before is None or now is None or not now[0] < SOFTENED * before[0]:
        return ""
    value, mode = now
    fallen = "K is not positive definite any more"
    if value > 0:
        fallen = f"the lowest eigenvalue of K has fallen to {value / before[0]:.2g} of that at the start"
    return f"the stable branch ends here. There {fallen}, and the body gives way most in {_most_deformed(problem, u, mode)}."


def _lowest(problem: Equilibrium, u: Array, t: float) -> tuple[float, Array] | None:
    """Return the lowest eigenvalue of K and its mode; with a direct solver, the eigenvalue nearest to zero.

    Return None if there is none or K is not symmetric.
    """
    mode = lowest_mode(problem, u, t) if problem.iterative else nearest_mode(problem, u, t)
    return None if mode is None or not problem.symmetric else (mode.value, mode.vector)


def _most_deformed(problem: Equilibrium, u: Array, mode: Array) -> str:
    """Return a description of the elements that the mode deforms most, by the displacements relative to their mean."""
    mesh = problem.system.mesh
    v = problem.states.expand(mode).reshape(-1, mesh.d)
    moves = v[mesh.t] - v[mesh.t].mean(axis=0)
    most = np.argsort(-(moves**2).sum(axis=(0, 2)))[:MOST_NAMED]
    pressed = problem.system.smallest_stretch(problem.states.expand(u))
    named = f"{name_ids(np.sort(most), 'element')}, near x = {point_of(mesh, most[0])}"
    return named if np.isinf(pressed) else f"{named}; the smallest principal stretch of all is {pressed:.2g}"
