"""A result in words: what came out, why, and what to try."""

from __future__ import annotations

from .history import History
from .newton import End
from .status import Status

TRY = {
    End.OUT_OF_ITERATIONS: "Try more steps, or look at the last state: result.plot().",
    End.INSIDE_OUT: "St. Venant-Kirchhoff material gives way in compression, so the branch without inversion may end here. Try a finer mesh "
    "there, more steps, or spread the load over more of the boundary.",
    End.NO_DESCENT: "Is it a mechanism: a part that only one vertex or edge holds, a flat membrane or a cable without tension? Hold it, "
    "stretch it first, or put it on an ElasticFoundation. If the body buckles there, give it a small imperfection.",
    End.NO_LENGTH: "Does the load push the body away without end, or depend on its shape? Try more steps, or a smaller load.",
    End.OVERFLOW: "Are units mixed up, or is the load far too large for the stiffness?",
}


def reason(
    status: Status, history: History, t: float, negative: int | None, inverted: str, cause: BaseException | None = None
) -> str:
    """The message of a result; `cause` is what interrupted it."""
    if status is Status.UNSTABLE:
        count = f"K has {negative} negative eigenvalue(s)" if negative else "K is not positive definite"
        return (
            f"At t = {t:.4g} the body is in equilibrium, but unstable: {count}, and a real one would leave this state. Look for the stable one "
            "beside it: give the mesh or the load a small imperfection, or prescribe displacements instead of loads."
        )
    if status is Status.INVERTED:
        return (
            f"At t = {t:.4g} the body is in equilibrium, but turned inside out in {inverted}. The energy does not change when an "
            "element is mirrored, so this is a solution of the equations, not one of the body. Start from a state that is not inside out."
        )
    if status is Status.INTERRUPTED:
        by = "" if isinstance(cause, KeyboardInterrupt) else f" by {type(cause).__name__}: {cause}"
        kept = "1 state" if len(history) == 1 else f"{len(history)} states"
        return f"Interrupted at t = {t:.6g} of 1{by.rstrip('.')}. Kept so far: {kept}."
    if status is Status.STOPPED:
        return f"Stopped before the full load, at t = {t:.6g} of 1" + _why(history)
    residual = history[-1].iterations.residuals[-1]
    kind = "the full load is reached" if status is Status.CONVERGED else "the full load is reached as far as rounding allows"
    return f"Converged: {kind}, residual {residual:.1e} of loads and reactions."


def _why(history: History) -> str:
    last = history.attempts[-1]
    detail = f" ({last.iterations.detail})" if last.iterations.detail else ""
    if last.t == 0:
        return f": {last.end.value}{detail}. What is there from the start cannot be approached in steps: let it grow with t. {TRY[last.end]}"
    return f": {last.end.value}{detail}, in a step of {last.t - (history[-1].t if len(history) else 0):.1e} too. {TRY[last.end]}"
