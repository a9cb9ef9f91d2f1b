"""Hard cases with quadratic elements next to linear ones, at rest and in motion: no result is wrong without a warning."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from .. import hard
from ..hard.case import Case, Truth, made
from ..hard.judge import Verdict
from ..hard.methods import Run
from ..hard.methods import run as run_method
from ..hard.motion.methods import run as run_motion
from ..hard.motion.scene import Scene
from ..hard.motion.study import scenes
from ..hard.study import cases
from ..statics.study import Study

#: Groups at rest, and the methods at rest and in motion.
GROUPS = tuple(name for name in hard.NAMES if name not in ("slack", "motion", "memory"))  # "slack" has quadratic elements already
AT_REST = ("default", "default + volume")  # for InvertibleStVK, quadratic elements have states of their own
MOVING = ("eq. 9", "backward Euler", "energy-momentum", "energy-momentum + volume")
#: Cases and scenes of the quick table.
FEW, FEW_SCENES = ("twist a bar of 5 x 1 x 1 by 360°", "press an arch from outside"), ("let a bar swing",)


def hard_cases(quick: bool = False) -> Iterator[Study]:
    """Run the hard cases at rest and in motion with quadratic elements."""
    yield _at_rest(quick)
    yield _in_motion(quick)


def quadratic(case: Case) -> Case:
    """Return the case with quadratic elements.

    If the path of linear elements ends and they have no right state, quadratic elements may still have one. Then any stable
    equilibrium without inverted elements is right, and so is a report that there is none.
    """
    truth, with_volume = map(_of_any_elements, (case.truth, case.with_volume))
    return replace(case, body=partial(made, case.body, 2), truth=truth, with_volume=with_volume)


def _of_any_elements(truth: Truth) -> Truth:
    if truth.error is not None or "in tiny steps" not in truth.source:
        return truth
    return replace(truth, error=lambda system, u: 0.0, refused=True, says=())


def _at_rest(quick: bool) -> Study:
    chosen = [case for case in cases(GROUPS, quick=True) if "slender" not in case.name and (not quick or case.name in FEW)]
    rows, failures = [], []
    for case in chosen:
        names = tuple(name for name in case.methods or AT_REST if name in AT_REST)
        by_degree = [[run_method(one, name) for name in names] for one in (case, quadratic(case))]
        rows += list(_rows(case, by_degree))
        failures += list(_wrong(case, by_degree[1]))
    return _study("Hard cases with quadratic elements", rows, failures)


def _in_motion(quick: bool) -> Study:
    rows, failures = [], []
    for scene in scenes(quick=True):
        if quick and not scene.name.startswith(FEW_SCENES):
            continue
        names = [name for name in MOVING if name in (scene.methods or MOVING)]
        moving = quadratic(scene)
        assert isinstance(moving, Scene)
        for truth in ("truth", "with_volume"):
            ending = getattr(moving, truth)
            if ending.error is None:
                moving = replace(moving, **{truth: replace(ending, error=lambda system, u: 0.0)})
        by_degree = [[run_motion(one, name) for name in names] for one in (scene, moving)]
        rows += list(_rows(scene, by_degree))
        failures += list(_wrong(scene, by_degree[1]))
    return _study("Hard cases in motion with quadratic elements", rows, failures)


def _study(name: str, rows: Sequence[tuple[str, ...]], failures: Sequence[str]) -> Study:
    counts = [f"{verdict.value} {sum(row[3].startswith(verdict.value) for row in rows)}" for verdict in Verdict]
    return Study(
        name,
        "quadratic elements are never wrong without a warning",
        ("case", "method", "linear", "quadratic", "iterations", "of quadratic", "s", "of quadratic "),
        tuple(rows),
        tuple(failures),
        ("runs with quadratic elements: " + ", ".join(counts),),
    )


def _rows(case: Case, by_degree: Sequence[Sequence[Run]]) -> Iterator[tuple[str, ...]]:
    for i, (linear, of_two) in enumerate(zip(*by_degree, strict=True)):
        verdicts = f"{linear.verdict} ({linear.status})"[:36], f"{of_two.verdict} ({of_two.status})"[:36]
        iterations = str(linear.iterations), str(of_two.iterations)
        times = f"{linear.seconds:.2f}", f"{of_two.seconds:.2f}"
        yield case.name if i == 0 else "", linear.method, *verdicts, *iterations, *times


def _wrong(case: Case, runs: Sequence[Run]) -> Iterator[str]:
    for run in runs:
        if run.verdict is Verdict.WRONG:
            yield f"{case.name}, {run.method}: reported as success, but {run.judgement.why}"


__all__ = ["hard_cases", "quadratic"]
