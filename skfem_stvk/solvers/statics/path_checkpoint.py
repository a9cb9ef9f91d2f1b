"""Path on disk: every accepted state is written as soon as it is found, and a later call can resume from it."""

from __future__ import annotations

from dataclasses import asdict, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AllowInfNan, Field, NonNegativeFloat, NonNegativeInt

from ...arguments import Array
from ...errors import StvkError
from ...results.complete_files import OutputFiles, in_all_parts, output_folder
from ...results.monitors import Finding
from ...results.state_files import PATH, PATH_FILE
from ...results.store import FolderStore, Header, Record, expect, refusing_damage, remove_file
from ...system import System
from ...system.signature import Fingerprint
from ...terms.loads.load import Moment, StepStart
from ..newton.newton import End, Iterations
from ..newton.outcome import Status
from .critical import BIFURCATION, LIMIT_POINT, CriticalPoint
from .equilibrium import SMALLEST_SCALE
from .history import Step
from .load_steps import LARGEST, LoadSteps

#: Possible outcomes of a state on a path.
EQUILIBRIA = Status.CONVERGED, Status.AT_ROUND_OFF, Status.UNSTABLE, Status.INVERTED
#: Relative tolerance of the strain energy in a file against the energy of the system. Largest factor by which the residual may
#: exceed the residual in the file.
ENERGY, RESIDUAL = 1e-6, 10.0
#: Remedy for states of another problem.
REMEDY = "Pass the same arguments to resume it, or name another folder. overwrite=True without resume replaces its states."

Measured = Annotated[float, AllowInfNan(True)]


class IterationsRecord(Record):
    """`Iterations` of Newton's method in a file."""

    residuals: Annotated[list[Measured], Field(min_length=1)]
    lengths: list[Measured]
    tangents: list[str]
    linear: list[NonNegativeInt]
    negative_pivots: NonNegativeInt | None
    restarted: NonNegativeInt | None
    detail: str


class FindingRecord(Record):
    """`Finding` without its elements."""

    name: str
    extreme: float
    text: str


class CriticalRecord(Record):
    """`CriticalPoint` without its arrays."""

    kind: Literal[LIMIT_POINT, BIFURCATION]  # type: ignore[valid-type]
    t: float
    resolved: bool


class ContinuationRecord(Record):
    """State from which a continuation resumes, see `Continuation.saved`. Entries that may be None belong to one method."""

    size: NonNegativeFloat
    first: NonNegativeFloat
    reached: bool
    largest: NonNegativeFloat
    straight: bool | None = None
    full_first: bool | None = None
    turns: NonNegativeInt | None = None
    states: NonNegativeInt | None = None
    rate: float | None = None
    goal: list[list[float]] | None = None


class StepRecord(Record):
    """`Step` without its arrays."""

    t: float
    status: Literal[tuple(one.name for one in EQUILIBRIA)]  # type: ignore[valid-type]
    end: Literal[tuple(one.name for one in End if one.converged)]  # type: ignore[valid-type]
    iterations: IterationsRecord
    strain_energy: Measured
    potential: Measured
    smallest_volume_ratio: Measured
    lowest: float | None
    jump: Annotated[Measured, Field(ge=0)] | None
    findings: list[FindingRecord]
    critical: list[CriticalRecord]
    seconds: NonNegativeFloat


class StateHeader(Header):
    """Header of a file with one state: its number on the path, the state, and the next step of the continuation."""

    number: NonNegativeInt
    step: StepRecord
    walk: ContinuationRecord


class PathCheckpoint(FolderStore[StateHeader]):
    """Folder with a file for each state of a path. A run that is killed loses no finished state.

    A resumed run finds its states in `steps`, and the state of the continuation after the last step in `saved`. Without `resume`,
    the first state replaces the existing files. States of another problem are replaced only with `overwrite`.

    In a divided body, each part has a file of its own for each state.
    """

    known, name = PATH, PATH_FILE
    schema = StateHeader
    remedy = "Remove it and all later states, and resume; or start again with overwrite=True and without resume."

    @staticmethod
    def by_dof(name: str) -> bool:
        return name == "u" or name.startswith("critical ")

    def __init__(self, folder: Path, system: System, problem: Fingerprint, output_files: OutputFiles) -> None:
        super().__init__(output_folder(folder), system.space)
        self.problem, self._system, self._output_files = problem, system, output_files
        self._count = 0
        self._old_files: list[Path] = []
        self.steps: list[Step] = []
        self.histories: list[tuple[Array, ...]] = []  # of the terms at the beginning of each step
        self.saved: dict[str, Any] = {}

    def opened(self) -> None:
        files = self.existing()
        if self._output_files.resume:
            self._load(files)
            return
        self._old_files = files
        if not self._output_files.overwrite:
            for file in files:
                self.refuse_to_replace(file)

    def add(self, step: Step, saved: dict[str, Any]) -> None:
        """Write a state and the state of the continuation after it."""
        with in_all_parts(self.space.comm):
            while self._old_files:  # last file first, so that the remaining files always form a path from its beginning
                if self.space.comm.leads:
                    remove_file(self._old_files[-1])
                self._old_files.pop()
        about, arrays = _packed(step, saved)
        self.write_file(self.numbered(self._count), self.problem, {"number": self._count, **about}, arrays, self.states)
        self._count += 1

    def _load(self, files: list[Path]) -> None:
        """Read the states and the state of the continuation after the last one; both stay empty if there are no files."""
        for number, file in enumerate(files):
            if file != self.numbered(number):
                raise StvkError(
                    f"{self.folder} has {file.name}, but no {self.numbered(number).name} before it. Remove {file.name} and all "
                    "later states, and resume."
                )
            header, arrays = self.read_own(file, REMEDY)
            with refusing_damage(file, self.remedy):
                u = expect(arrays, "u", (self._system.ndofs,))
                self.histories.append(self._next_history())
                _check_equilibrium(self._system, u, header, self.histories[-1])
                self.steps.append(_unpacked(header.step, u, arrays, self._system))
                _check_order(self.steps, header, number)
            self.saved = header.walk.model_dump(exclude_unset=True)
        self._count = len(files)

    def _next_history(self) -> tuple[Array, ...]:
        """Return the history of the terms at the beginning of the step after those that are read."""
        if not self.steps:
            return self._system.first_history()
        return self._system.advanced(self.histories[-1], self.steps[-1].u, Moment.of(self.steps[-1].t))


def _packed(step: Step, saved: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return the part of the header that JSON can represent, and the arrays."""
    plain = {field.name: getattr(step, field.name) for field in fields(step) if field.name not in ("u", "findings", "critical")}
    plain |= {"status": step.status.name, "end": step.end.name, "iterations": asdict(step.iterations)}
    plain["findings"] = [{"name": one.name, "extreme": one.extreme, "text": one.text} for one in step.findings]
    plain["critical"] = [{"kind": one.kind, "t": one.t, "resolved": one.resolved} for one in step.critical]
    arrays = {"u": step.u} | {f"finding {i}": one.elements for i, one in enumerate(step.findings)}
    arrays |= {f"critical {i}": np.stack([one.u, one.mode]) for i, one in enumerate(step.critical)}
    return {"step": plain, "walk": saved}, arrays


def _unpacked(record: StepRecord, u: Array, arrays: dict[str, Array], system: System) -> Step:
    """Return the state of a file, with displacements `u`.

    Raise ValueError or KeyError with a message if it does not belong to the system.
    """
    plain = record.model_dump()
    plain |= {"status": Status[record.status], "end": End[record.end], "iterations": Iterations(**plain["iterations"])}
    plain["findings"] = tuple(
        Finding(elements=_elements(arrays, f"finding {i}", system), **one.model_dump()) for i, one in enumerate(record.findings)
    )
    critical = []
    for i, one in enumerate(record.critical):
        there, mode = expect(arrays, f"critical {i}", (2, len(u)))
        critical.append(CriticalPoint(one.kind, one.t, there, mode, one.resolved))
    energy = sum(system.elastic_energies(u, record.t))
    if not np.isclose(record.strain_energy, energy, rtol=ENERGY, atol=np.finfo(float).tiny, equal_nan=True):
        raise ValueError(f"its strain energy is {record.strain_energy:g}; expected {energy:g}, the energy of its displacements")
    return Step(u=u, **(plain | {"critical": tuple(critical)}))


def _elements(arrays: dict[str, Array], name: str, system: System) -> Array:
    elements = arrays.get(name, np.empty(0))
    if (
        elements.ndim != 1
        or elements.dtype.kind not in "iu"
        or not ((elements >= 0) & (elements < system.mesh.element_count)).all()
    ):
        raise ValueError(f"the array '{name}' does not contain ids of elements")
    return elements


def _check_order(steps: list[Step], header: StateHeader, number: int) -> None:
    """Raise ValueError with a message if a state is not the next one of its path."""
    step, walk = steps[-1], header.walk
    options: dict[str, Any] = dict(header.problem.method)
    if header.number != number:
        raise ValueError(f"its number is {header.number}; expected {number}, its position on the path")
    load_steps = options["method"] == LoadSteps.name
    needed = ("straight", "full_first") if load_steps else ("turns", "states", "rate", "goal")
    counted = [getattr(walk, name) for name in needed[:2]]  # counts and flags that a method has from the beginning
    if walk.model_fields_set != {"size", "first", "reached", "largest", *needed} or None in counted:
        raise ValueError(
            f"its entries for the next step are {sorted(walk.model_fields_set)}; expected those of {options['method']}"
        )
    if not load_steps:
        return
    last = steps[-2].t if len(steps) > 1 else -np.inf
    if not last < step.t <= 1 or walk.reached != (step.t == 1):
        raise ValueError(
            f"its load factor is {step.t:g} after {last:g}, with reached = {walk.reached}; expected an increase to at most 1"
        )
    if walk.first != 1 / options["steps"] or not 0 < walk.size <= LARGEST * walk.first:
        raise ValueError(
            f"its next step is {walk.size:g} of the load and its first was {walk.first:g}; expected those of steps = "
            f"{options['steps']}"
        )


def _check_equilibrium(system: System, u: Array, header: StateHeader, history: tuple[Array, ...]) -> None:
    """Raise ValueError with a message if displacements and load factor are not an equilibrium of the system."""
    step = header.step
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
    rtol: Any = header.problem.method["rtol"]
    small, size = RESIDUAL * max(rtol, step.iterations.residuals[-1]), system.space.norm(forces)
    if size > small * max(scale, SMALLEST_SCALE * header.walk.largest):
        raise ValueError(f"it is no equilibrium: its residual at t = {step.t:g} is {size / scale:.3g} of the loads and reactions")
