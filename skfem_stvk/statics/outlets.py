"""What a static solve writes while it goes: a series of states, and the checkpoint."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, TypeAlias

from ..arguments import Array
from ..results import Fields, Series
from ..results.outlets import Outlets
from ..system import System
from ..system.signature import Problem, sums
from .checkpoint import PathCheckpoint
from .history import Step

Write: TypeAlias = Callable[[float, Step], object]

#: Load factors at which loads and prescribed displacements are evaluated to know a problem again.
MOMENTS = 0.5, 1.0


@contextmanager
def opened(
    outlets: Outlets, system: System, options: dict[str, Any], start: Array
) -> Iterator[tuple[Write, PathCheckpoint | None]]:
    """A function that writes a state to the series of files, and the checkpoint, where they were asked for; nobody else can write them."""
    with ExitStack() as stack:
        write, kept = _nothing, None
        if outlets.save is not None or outlets.checkpoint is not None:
            problem = Problem("path of equilibria", system, options, MOMENTS, {"u0": sums(start)})
        if outlets.checkpoint is not None:
            kept = stack.enter_context(PathCheckpoint(outlets.checkpoint, system, problem, outlets))
        if outlets.save is not None:
            series = stack.enter_context(Series(outlets.save, problem=problem, overwrite=outlets.overwrite))
            write = partial(_add, series, Fields(system.mesh, system.elastic_terms))
        yield write, kept


def _add(series: Series, fields: Fields, t: float, step: Step) -> None:
    series.add(fields.at(step.u), t)


def _nothing(t: float, step: Step) -> None:
    """Write nothing: no series was asked for."""
