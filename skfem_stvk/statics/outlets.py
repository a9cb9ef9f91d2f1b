"""What a static solve writes while it goes: a series of states, and the checkpoint."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ..arguments import Array
from ..results import Fields, Series
from ..system import System
from ..system.signature import Problem, sums
from .checkpoint import Checkpoint
from .history import Step

Write: TypeAlias = Callable[[float, Step], object]

#: Load factors at which loads and prescribed displacements are looked at to know a problem again.
MOMENTS = 0.5, 1.0


class Outlets(NamedTuple):
    """What a solve writes while it goes, as in `solve_static`."""

    save: str | os.PathLike[str] | None
    checkpoint: str | os.PathLike[str] | None
    resume: bool
    overwrite: bool

    @contextmanager
    def opened(self, system: System, options: dict[str, Any], start: Array) -> Iterator[tuple[Write, Checkpoint | None]]:
        """What writes a state to the series of files, and the checkpoint, if there are to be such; nobody else can write them."""
        with ExitStack() as stack:
            write, kept = _nothing, None
            if self.save is not None or self.checkpoint is not None:
                problem = Problem("path of equilibria", system, options, MOMENTS, {"u0": sums(start)})
            if self.checkpoint is not None:
                kept = stack.enter_context(Checkpoint(Path(self.checkpoint), system, problem, self.resume, self.overwrite))
            if self.save is not None:
                series = stack.enter_context(Series(self.save, problem=problem, overwrite=self.overwrite))
                write = partial(_add, series, Fields(system.mesh, system.elastic_terms))
            yield write, kept


def _add(series: Series, fields: Fields, t: float, step: Step) -> None:
    series.add(fields.at(step.u), t)


def _nothing(t: float, step: Step) -> None:
    """Write nothing."""
