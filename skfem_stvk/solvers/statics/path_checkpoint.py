"""Path on disk: every accepted state is written as soon as it is found, and a later call can resume from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...arguments import Array
from ...errors import StvkError
from ...npz import Count
from ...results.complete_files import in_all_parts, output_folder
from ...system import System
from ...system.signature import Fingerprint
from ...terms.loads.load import Moment, StepStart
from ..newton.outcome import Status
from ..runs.archive import STRICT, FolderStore, refusing_damage, remove_file
from ..runs.outputs import OutputFiles
from .arc_length import ArcLengthState
from .equilibrium import SMALLEST_SCALE
from .history import Step
from .load_steps import LARGEST, LoadSteps, LoadStepsState

#: Possible outcomes of a state on a path.
EQUILIBRIA = Status.CONVERGED, Status.AT_ROUND_OFF, Status.UNSTABLE, Status.INVERTED
#: Relative tolerance of the strain energy in a file against the energy of the system. Largest factor by which the residual may
#: exceed the residual in the file.
ENERGY, RESIDUAL = 1e-6, 10.0
#: Remedy for states of another problem.
REMEDY = "Pass the same arguments to resume it, or name another folder. overwrite=True without resume replaces its states."


@dataclass(frozen=True)
class SavedStep:
    """Record of a file with one state: its number on the path, the state, and the next step of the continuation."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    number: Count
    state: Step
    next: LoadStepsState | ArcLengthState


class PathCheckpoint(FolderStore[SavedStep]):
    """Folder with a file for each state of a path. A run that is killed loses no finished state.

    A resumed run finds its states in `steps`, and the state of the continuation after the last step in `saved`. Without `resume`,
    the first state replaces the existing files. States of another problem are replaced only with `overwrite`.

    In a divided body, each part has a file of its own for each state.
    """

    known, name, schema = ("path of skfem-stvk", 3), "state_{:05d}.npz", SavedStep
    remedy = "Remove it and all later states, and resume; or start again with overwrite=True and without resume."

    def __init__(self, folder: Path, system: System, problem: Fingerprint, output_files: OutputFiles) -> None:
        super().__init__(output_folder(folder), system.space)
        self.problem, self._system, self._output_files = problem, system, output_files
        self._count = 0
        self._old_files: list[Path] = []
        self.steps: list[Step] = []
        self.histories: list[tuple[Array, ...]] = []  # of the terms at the beginning of each step
        self.saved: Any = None  # the data for the next step after `steps`

    def opened(self) -> None:
        files = self.existing()
        if self._output_files.resume:
            self._load(files)
            return
        self._old_files = files
        if not self._output_files.overwrite:
            for file in files:
                self.refuse_to_replace(file)

    def add(self, step: Step, saved: Any) -> None:
        """Write a state and the state of the continuation after it."""
        with in_all_parts(self.comm):
            while self._old_files:  # last file first, so that the remaining files always form a path from its beginning
                if self.comm.leads:
                    remove_file(self._old_files[-1])
                self._old_files.pop()
        self.write(self.numbered(self._count), SavedStep(self._count, step, saved))
        self._count += 1

    def _load(self, files: list[Path]) -> None:
        """Read the states and the state of the continuation after the last one; both stay empty if there are no files."""
        for number, file in enumerate(files):
            if file != self.numbered(number):
                raise StvkError(
                    f"{self.folder} has {file.name}, but no {self.numbered(number).name} before it. Remove {file.name} and all "
                    "later states, and resume."
                )
            record, options = self.read_own(file, REMEDY), self.problem.signature.method
            with refusing_damage(file, self.remedy):
                if record.number != number:
                    raise ValueError(f"its number is {record.number}; expected {number}, its position on the path")
                self.histories.append(self._next_history())
                _check_state(self._system, record.state)
                _check_equilibrium(self._system, record, options["rtol"], self.histories[-1])
                _check_order(self.steps[-1].t if self.steps else -np.inf, record, options)
            self.steps.append(record.state)
            self.saved = record.next
        self._count = len(files)

    def _next_history(self) -> tuple[Array, ...]:
        """Return the history of the terms at the beginning of the step after those that are read."""
        if not self.steps:
            return self._system.first_history()
        return self._system.advanced(self.histories[-1], self.steps[-1].u, Moment.of(self.steps[-1].t))


def _check_state(system: System, step: Step) -> None:
    """Raise ValueError with a message if a state does not belong to the system, or is no equilibrium by its own record."""
    if step.status not in EQUILIBRIA or not step.end.converged or not step.iterations.residuals:
        raise ValueError(f"its status is {step.status.name}, because {step.end.value}; expected an equilibrium")
    for finding in step.findings:
        if not ((finding.elements >= 0) & (finding.elements < system.mesh.element_count)).all():
            raise ValueError(f"its finding '{finding.name}' is of elements that do not exist")
    energy = sum(system.elastic_energies(step.u, step.t))
    if not np.isclose(step.strain_energy, energy, rtol=ENERGY, atol=np.finfo(float).tiny, equal_nan=True):
        raise ValueError(f"its strain energy is {step.strain_energy:g}; expected {energy:g}, the energy of its displacements")


def _check_order(last: float, record: SavedStep, options: dict[str, Any]) -> None:
    """Raise ValueError with a message if a state is not the next one of its path, after the load factor `last`."""
    step, after, load_steps = record.state, record.next, options["method"] == LoadSteps.name
    if isinstance(after, LoadStepsState) != load_steps:
        raise ValueError(f"its data for the next step are of another method; expected those of {options['method']}")
    if not load_steps:
        return
    if not last < step.t <= 1 or after.reached != (step.t == 1):
        raise ValueError(
            f"its load factor is {step.t:g} after {last:g}, with reached = {after.reached}; expected an increase to at most 1"
        )
    if after.first != 1 / options["steps"] or not 0 < after.size <= LARGEST * after.first:
        raise ValueError(
            f"its next step is {after.size:g} of the load and its first was {after.first:g}; expected those of steps = "
            f"{options['steps']}"
        )


def _check_equilibrium(system: System, record: SavedStep, rtol: float, history: tuple[Array, ...]) -> None:
    """Raise ValueError with a message if displacements and load factor are not an equilibrium of the system."""
    step, u = record.state, record.state.u
    moment = Moment(step.t, step.t, step=StepStart(history, in_time=False))
    constrained, prescribed = system.supports.held, system.supports.values(step.t)
    gap, *sizes = (system.space.comm.most(float(np.abs(x).max(initial=0.0))) for x in (u[constrained] - prescribed, prescribed, u))
    if gap > 1e-9 * sum(sizes):
        raise ValueError(f"its displacements differ from those of the supports at t = {step.t:g} by up to {gap:.3g} m")
    loads = system.external_force(u, step.t)
    forces = system.internal_force(u, moment) - loads
    reactions = forces[constrained].copy()
    forces[constrained] = 0
    scale = system.space.norm(loads) + system.space.on(constrained).norm(reactions)
    if system.contacts:
        scale += system.space.norm(system.contact_force(u, moment))
    small, size = RESIDUAL * max(rtol, step.iterations.residuals[-1]), system.space.norm(forces)
    if size > small * max(scale, SMALLEST_SCALE * record.next.largest):
        raise ValueError(f"it is no equilibrium: its residual at t = {step.t:g} is {size / scale:.3g} of the loads and reactions")
