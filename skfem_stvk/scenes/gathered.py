"""Outcome of a scene that several ranks solved, on the whole body of the first rank: for pictures and the last state."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..arguments import Array
from ..ranks import gathered
from ..solvers.dynamics import Run
from ..solvers.dynamics.motion import Motion
from ..solvers.statics import StaticResult
from ..solvers.statics.history import History
from .build import Built
from .scene_outcome import SceneOutcome
from .schema.analyses import DynamicAnalysis

#: Largest number of elements that are drawn by the first rank.
MOST_DRAWN = 200_000


def gathered_outcome(outcome: SceneOutcome, whole: Built | None) -> SceneOutcome | None:
    """Return the outcome with the states of all ranks, on the scene that the first rank has built `whole`.

    All ranks call this function together; others than the first have None, and get None.
    """
    space, result = outcome.built.system.space, outcome.result

    def of_all(u: Array) -> Any:
        return gathered(space, u)

    if isinstance(result, Run):
        u, v = of_all(result.u), of_all(result.v)
        if whole is None:
            return None
        analysis = whole.sections.analysis
        assert isinstance(analysis, DynamicAnalysis)
        motion = Motion(whole.system, analysis.mass, analysis.damping.of_library())
        return replace(outcome, built=whole, result=replace(result, motion=motion, u=u, v=v))
    assert isinstance(result, StaticResult)
    history = History()
    for step in result.history:
        history.append(replace(step, u=of_all(step.u)))
    u = of_all(result.u)
    return (
        None if whole is None else replace(outcome, built=whole, result=replace(result, system=whole.system, u=u, history=history))
    )
