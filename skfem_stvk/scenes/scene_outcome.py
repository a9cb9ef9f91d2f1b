"""Outcome of a scene: the result, the curves of probes and reactions, the results that matter most, and the expectations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import isnan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import StvkError
from ..mesh import ElementMesh
from ..results.monitors import point_of
from ..solvers.dynamics import Modes, Run
from ..solvers.dynamics.motion import Motion
from ..solvers.statics import StaticResult
from ..solvers.statics.history import History
from ..terminal import DONE, INTERRUPTED, NOT_AS_EXPECTED, NOT_PASSED, duration
from ..units import UNITS
from .build import Built

#: Largest number of elements that are drawn by the first rank.
MOST_DRAWN = 200_000


class Curve(NamedTuple):
    """Curve over time: the mean displacement of a probe, or the force of supports at a location."""

    t: Array  # (n,) times, or load factors
    values: Array  # (n, d) components
    dimension: str  # "length" or "force"


class ComparedResult(NamedTuple):
    """Result with its expectation."""

    name: str  # as `tip.z`
    got: float | None  # None where it does not exist
    expected: float
    allowed: float  # the largest difference
    passed: bool


class SummaryRow(NamedTuple):
    """Result that matters most, in words."""

    name: str  # as "largest displacement"
    value: str  # with its unit
    where: str = ""  # its location


def as_printed(value: float | None) -> str:
    """Return a result with nine digits; "-" for one that does not exist."""
    return "-" if value is None or isnan(value) else f"{value:.9g}"


@dataclass(frozen=True, eq=False)
class SceneOutcome:
    """Outcome of a scene.

    Attributes
    ----------
    built
        The scene with its system.
    result
        Result of the analysis, a `StaticResult`, `Run` or `Modes`.
    success, status, message
        Whether the analysis succeeded, its status in a word, and the full message.
    curves
        Probes and reactions by name, over the times or load factors.
    values
        Results at the end by dotted name, such as `energy.strain` and `tip.z`. NaN for an energy that does not exist.
    judged
        Results with their expectations.
    summary
        Results that matter most, with units and locations.
    seconds
        Duration of the analysis.
    folder
        Folder of results, if they were written.
    warnings
        Texts of the warnings on the way.
    ranks
        Number of ranks and the sizes of their parts; empty on one machine.
    """

    built: Built
    result: Any
    success: bool
    status: str
    message: str
    curves: dict[str, Curve]
    values: dict[str, float]
    judged: tuple[ComparedResult, ...]
    summary: tuple[SummaryRow, ...]
    seconds: float
    folder: Path | None = None
    warnings: tuple[str, ...] = field(default=())
    ranks: str = ""

    @property
    def headline(self) -> str:
        """Status and message; the status only where the message does not say it."""
        said = self.status.split()[0] in self.message.lower()
        return self.message if said else f"{self.status}: {self.message}"

    @property
    def seconds_by_stage(self) -> str:
        """Duration of the analysis, and of its parts where they were measured."""
        parts = ", ".join(f"{name} {duration(seconds)}" for name, seconds in getattr(self.result, "seconds", {}).items() if seconds)
        return duration(self.seconds) + (f" ({parts})" if parts else "")

    @property
    def exit_code(self) -> int:
        """Exit code: 0 if the analysis converged and all expectations hold, 1 if it did not converge, 3 if an expectation failed,
        130 if interrupted.
        """
        if self.status == "interrupted":
            return INTERRUPTED
        if not self.success:
            return NOT_PASSED
        return DONE if all(one.passed for one in self.judged) else NOT_AS_EXPECTED


def gathered_outcome(outcome: SceneOutcome, whole: Built | None) -> SceneOutcome | None:
    """Return the outcome with the states of all ranks, on the scene that the first rank has built `whole`.

    All ranks call this function together; others than the first have None, and get None.
    """
    from ..ranks import gathered  # imports MPI

    of_all: Any = partial(gathered, outcome.built.system.space)
    result, changed = outcome.result, {"u": of_all(outcome.result.u)}
    if isinstance(result, Run):
        changed["v"] = of_all(result.v)
        if whole is not None:
            analysis = whole.sections.analysis
            changed["motion"] = Motion(whole.system, analysis.mass, analysis.damping.of_library())
    else:
        changed["history"] = history = History()
        for step in result.history:
            history.append(replace(step, u=of_all(step.u)))
        if whole is not None:
            changed["system"] = whole.system
    return None if whole is None else replace(outcome, built=whole, result=replace(result, **changed))


# results that matter most: the lines that `solve` prints, and the first table of the report

#: Field of the largest stress.
STRESS = "von_mises_stress"


class LargestValue(NamedTuple):
    """Largest value of a field, and its location in words."""

    value: float
    where: str


def largest_displacement(result: StaticResult | Run) -> LargestValue:
    """Return the largest displacement of a node, on all ranks together."""
    mesh = result.system.mesh
    lengths = np.linalg.norm(result.u.reshape(-1, mesh.d), axis=1)
    value, node = _largest(mesh, lengths, mesh.node_numbers)
    here, space = np.flatnonzero((mesh.node_numbers == node) & (mesh.space.counted(np.ones(mesh.nv)) > 0)), mesh.space
    return LargestValue(value, f"node {node} at {_point(space.comm.total(mesh.p[:, here].sum(axis=1)))}")


def largest_stress(result: StaticResult | Run) -> LargestValue | None:
    """Return the largest von Mises stress, the mean of an element, on all ranks together; None if no term has a stress."""
    try:
        states = [result.state, *result.state.beside]
    except StvkError:  # springs alone, for example
        return None
    found = []
    for state in states:
        stress, missing = state.raw(STRESS)
        mesh = state.fields.mesh
        value, element = _largest(mesh, np.where(missing, -np.inf, stress), mesh.element_numbers)
        of = f" of the {mesh.kind}" if len(states) > 1 else ""
        if np.isfinite(value):
            found.append(LargestValue(value, f"mean of element {element}{of} at {point_of(mesh, element)}"))
    return max(found, default=None)


def _largest(mesh: ElementMesh, values: Array, numbers: NDArray[np.int64]) -> tuple[float, int]:
    """Return the largest of the values of all ranks, and the number of its node or element."""
    value = mesh.space.comm.most(float(values.max(initial=-np.inf)))
    return value, int(mesh.space.comm.most(float(numbers[values == value].max(initial=-1))))


def summary(
    built: Built,
    result: StaticResult | Run | Modes,
    curves: Mapping[str, Curve],
    values: Mapping[str, float],
    stress: LargestValue | None,
) -> Iterator[SummaryRow]:
    """Yield the rows of a summary."""
    units = UNITS[built.sections.units]
    if isinstance(result, Modes):
        return  # the message lists them
    displacement = largest_displacement(result)
    yield SummaryRow("largest displacement", f"{displacement.value:.6g} {units.symbol('length')}", displacement.where)
    if stress is not None:
        yield SummaryRow("largest von Mises stress", f"{stress.value:.6g} {units.symbol('stress')}", stress.where)
    if built.system.space.comm.any(built.system.supports.held.size > 0) and not getattr(result, "projected", False):
        yield SummaryRow("reaction of all supports", f"{_vector(result.reaction().resultant)} {units.symbol('force')}")
    for name in built.reactions:
        yield SummaryRow(f"reaction of {name}", f"{_vector(curves[name].values[-1])} {units.symbol('force')}")
    for state in result.contacts:
        pressure = units.symbol("stress")
        force = f"{_vector(state.resultant)} {units.symbol('force')}, pressure up to {state.pressure.max():.6g} {pressure}"
        yield SummaryRow(f"force of contact {state.name}", force, f"{state.area:.4g} {units.symbol('area')}" if state.area else "")
    for name in ("strain", "kinetic"):
        if np.isfinite(energy := values.get(f"energy.{name}", np.nan)):
            yield SummaryRow(f"{name} energy", f"{energy:.6g} {units.symbol('energy')}")


def _vector(values: Array) -> str:
    """Return components with six digits of the largest.

    >>> _vector(np.array([1.2e-11, -3.8e-08, 601.5621]))
    '(0, 0, 601.562)'
    """
    size = float(np.abs(values).max())
    rounded = np.round(values / size, 6) * size + 0.0 if 0 < size < np.inf else values
    return f"({', '.join(f'{value:.6g}' for value in rounded)})"


def _point(x: Array) -> str:
    return f"({', '.join(f'{value:.4g}' for value in x)})"
