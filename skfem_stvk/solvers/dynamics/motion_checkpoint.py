"""Checkpoint of a motion: one file in its own folder, from which a later run continues with bitwise identical results."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StvkError, name_ids
from ...mesh import ElementMesh
from ...npz import Ids, Numbers, Stored, Within
from ...results.complete_files import of_leader, output_folder
from ...space import Space
from ...system import System
from ...system.signature import Fingerprint, Signature
from ..runs.archive import STRICT, FolderStore, check_lengths, refusing_damage, validated
from ..runs.ledger import Ledger
from .damping import DampingFactors
from .integrators import Integrator
from .ledger_rows import REMOVED, LedgerLocations, column_names, columns_without_value, known_strain, known_total
from .motion import Motion
from .record import RunRecord, RunState, Snapshot

#: Name of its file.
MOTION_FILE = "motion.npz"
#: Shortest time between two checkpoints [s], and largest share of the run time that writing them may take.
EVERY, SHARE = 5.0, 0.05
#: Remedy for a file that cannot be resumed.
START_AGAIN = "Start again: overwrite=True, without resume."
#: Relative tolerance of energies, as a part of the largest.
ENERGY = 1e-6
#: Smallest computed step, as a part of the first one.
SHORTEST = 1e-9
#: Columns that, with the strain energy, add up to the total energy and the closure error.
PARTS = "kinetic_energy", "potential_energy", "external_work", "dissipated_work"


@dataclass(frozen=True)
class IntegratorOptions:
    """Integrator in files: its options, and the names of solvers that are objects."""

    name: str
    options: dict[str, str | float | None]
    objects: dict[str, str]


@dataclass(frozen=True)
class MotionMethod:
    """Method in the `Signature` of a motion, as `method_options` returns it."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    integrator: IntegratorOptions
    mass: Literal["lumped", "consistent"]
    damping: DampingFactors
    remove: str | None = None


@dataclass
class SavedMotion(RunState):
    """Record of a checkpoint: the state of a run, its ledger and locations, and the series that it saves."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    seconds: dict[str, Annotated[float, Within(-1.0)]]  # run time by part; "other" may be negative by rounding
    columns: list[str]  # names of the columns of the ledger
    rows: Annotated[Array, Stored(2, finite=False)]  # rows of the ledger
    probes: dict[str, Ids]  # vertices in the whole mesh
    reactions: dict[str, Ids]
    supports: dict[str, str]  # words of the support of each reaction; empty for another location
    save: str | None = None  # series as the user named it; a resumed run uses its file name alone, see `_series_next_to`
    every: Annotated[int, Within(1)] = 1  # steps from one saved state to the next
    pushed: tuple[str, ...] = ()  # locations on which a `Simulation` pushes
    moved: tuple[str, ...] = ()  # contacts whose shapes it moves
    inputs: Numbers = field(default_factory=lambda: np.empty(0))  # inputs of a `Simulation`

    @classmethod
    def of(cls, record: RunRecord, locations: LedgerLocations, mesh: ElementMesh, *, found: bool, **others: Any) -> SavedMotion:
        """Return the record of a run. The last good state is left out unless the step length is `found` from the critical step.
        `others` are fields that a run record does not have.
        """
        good, reactions = record.good, locations.reactions
        older = found and good is not None and good.steps < record.steps
        return cls(
            **(record.parts | {"good": good if older else None}),
            columns=list(record.ledger.names),
            rows=record.ledger.rows(),
            probes={name: _in_whole_mesh(mesh, ids) for name, ids in locations.probes.items()},
            reactions={name: _in_whole_mesh(mesh, place.vertices) for name, place in reactions.items()},
            supports={name: place.support for name, place in reactions.items()},
            **others,
        )

    def record(self, ledger: Ledger) -> RunRecord:
        """Return the record of the run, with its ledger."""
        record = RunRecord(**self.parts, ledger=ledger)
        record.watch.add(self.seconds)
        return record


class MotionCheckpoint(FolderStore[SavedMotion]):
    """File `motion.npz` in a folder, replaced as a motion proceeds. If the run is killed, the previous file remains intact.

    States of the motion are vectors of the `space`. In a divided body, each part has a file of its own next to `motion.npz`.
    """

    known, schema, remedy = ("motion of skfem-stvk", 6), SavedMotion, START_AGAIN

    def __init__(self, folder: Path, space: Space | None = None) -> None:
        self.file, self._next = folder / MOTION_FILE, -np.inf
        super().__init__(output_folder(folder), space)

    @property
    def exists(self) -> bool:
        """Whether the file exists."""
        return of_leader(self.comm, self.file.exists)

    def belongs_to(self, problem: Fingerprint, overwrite: bool) -> None:
        """Set the signature of the problem for the files to be written. Refuse to replace a file of another problem."""
        self.problem = problem
        if self.exists and not overwrite:
            self.refuse_to_replace(self.file)

    def due(self, now: float) -> bool:
        """Return whether to write now, where `now` is from `time.perf_counter` [s].

        The first call returns True. Later ones return True after `EVERY` seconds, or more if writing would exceed the share
        `SHARE`.
        """
        return now >= self._next

    def replace(self, saved: SavedMotion) -> None:
        """Replace the file."""
        begin = time.perf_counter()
        self.write(self.file, saved)
        end = time.perf_counter()
        self._next = end + max(EVERY, (end - begin) / SHARE)


class ReadMotion(NamedTuple):
    """Checkpoint that was read: its problem with the method, its record, and the ledger so far."""

    problem: Signature
    method: MotionMethod
    saved: SavedMotion
    ledger: Ledger


def _in_whole_mesh(mesh: ElementMesh, vertices: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the ids in the whole mesh of vertices of all parts, each once."""
    every = np.concatenate(mesh.space.comm.each(mesh.node_numbers[vertices]))
    return every[np.sort(np.unique(every, return_index=True)[1])]


def load(file: Path, space: Space | None = None) -> ReadMotion:
    """Return the content of the file, checked as far as possible without the system. Its states are vectors of the `space`, by
    default those of the whole body.

    Raises an error if the file is missing, incomplete, or not written by this package.
    """
    if not file.exists():
        raise StvkError(
            f"There is no checkpoint {file}. Is the path relative to another folder? Without resume=True, simulate starts a new "
            "motion."
        )
    problem, saved = MotionCheckpoint.read_file(file, space)
    with refusing_damage(file, START_AGAIN):
        return ReadMotion(problem, validated(MotionMethod, problem.method), saved, Ledger(saved.columns, saved.rows))


def refuse_inconsistent(read: ReadMotion, motion: Motion, integrator: Integrator) -> LedgerLocations:
    """Return the locations that a checkpoint records.

    Raises ValueError or KeyError with a message if the checkpoint contradicts itself or the system.
    """
    problem, method, saved, ledger = read
    system = motion.system
    check_lengths(saved, motion.states.n)
    if list(saved.supports) != list(saved.reactions):
        raise ValueError(f"it has supports of {list(saved.supports)}, and reactions of {list(saved.reactions)}")
    locations = LedgerLocations.checked(system, saved.probes, saved.reactions, saved.supports)
    if lost := [words for name, words in saved.supports.items() if locations.reactions[name].support != words]:
        raise ValueError(f"it records the reaction of the support {lost[0]}, which the system lacks")
    if ledger.names != column_names(motion.body, *locations, removing=method.remove is not None):
        raise ValueError(f"its ledger has the columns {', '.join(ledger.names)}")
    if ledger.steps != saved.steps + 1:
        raise ValueError(f"its ledger has {ledger.steps} rows for {saved.steps} steps")
    _check_balance(ledger, columns_without_value(system))
    _check_removed(saved, system, ledger)
    start = {name: problem.numbers.get(name, []) for name in ("t0", "u0", "v0")}
    if start["t0"] != [ledger["time"][0]] or len(start["u0"]) != 2 or len(start["v0"]) != 2:
        raise ValueError(f"it began with {start}, its ledger at t = {ledger['time'][0]:g}")
    _check_snapshot(saved, ledger, motion, integrator)
    if saved.good is not None:
        if integrator.dt is not None or not saved.good.steps < saved.steps:
            raise ValueError(f"its last good state is that of step {saved.good.steps} of {saved.steps}")
        _check_snapshot(saved.good, ledger, motion, integrator)
    return locations


def _check_removed(saved: SavedMotion, system: System, ledger: Ledger) -> None:
    """Check that the removed elements are those of the system, and that the times are in the ledger; raises ValueError."""
    removed, removed_at = saved.removed, saved.removed_at
    during = removed_at[~np.isnan(removed_at)]
    if not np.array_equal(np.sort(removed), system.removed) or removed_at.shape != removed.shape:
        raise ValueError(
            f"it lacks {name_ids(removed, 'element')}; expected those that the system lacks, {name_ids(system.removed, 'element')}"
        )
    if not np.isin(during, ledger["time"]).all() or (np.diff(during) < 0).any() or (len(during) and REMOVED not in ledger):
        raise ValueError("the times at which elements were removed are not in its ledger")


def _check_snapshot(then: Snapshot, ledger: Ledger, motion: Motion, integrator: Integrator) -> None:
    """Check that the parts of a stored state are consistent; raises ValueError or KeyError with a message."""
    state, clock, reviews, times = then.state, then.clock, then.reviews, ledger["time"][: then.steps + 1]
    if then.cuts > then.steps or clock.count > then.steps:
        raise ValueError(f"of its {then.steps} steps, {then.cuts} are cut and {clock.count} of one length")
    if state.t != clock.start + clock.count * clock.dt or state.t != times[-1]:
        raise ValueError(
            f"t = {state.t!r}, but its clock has {clock.count} steps of {clock.dt!r} from {clock.start!r}, its ledger ends at "
            f"{float(times[-1])!r}"
        )
    if not np.array_equal(times[then.steps - clock.count :], clock.start + np.arange(clock.count + 1) * clock.dt):
        raise ValueError("the times of its ledger are not those of its clock")
    if integrator.dt is not None and clock.dt != integrator.dt:
        raise ValueError(f"its steps are of {clock.dt!r}, those of its integrator of {integrator.dt!r}")
    if integrator.dt is None and not SHORTEST * reviews.largest <= clock.dt <= reviews.largest:
        raise ValueError(f"its steps are of {clock.dt:g} s, and were {reviews.largest:g} s at first")
    if reviews.next > then.steps + reviews.interval:
        raise ValueError(f"after {then.steps} steps its next review is at step {reviews.next}, later than its interval allows")
    if len(state.forces) != motion.force_rows:
        raise ValueError(f"it has forces of {len(state.forces)} contacts and foundations; expected {motion.force_rows}")
    row = {"kinetic_energy": ledger["kinetic_energy"][then.steps], "strain_energy": known_strain(ledger)[then.steps]}
    kinetic = motion.states.dot(state.v, motion.mass.multiply(state.v)) / 2
    motion.body.return_to(then.history)
    strain = motion.energy(state.u, state.t)
    for name, energy in (("kinetic_energy", kinetic), ("strain_energy", strain)):
        if not np.isclose(row[name], energy, rtol=ENERGY, atol=ENERGY**2 * (kinetic + abs(strain))):
            raise ValueError(f"its ledger ends with a {name} of {row[name]:g} J; its state has {energy:g} J")


def _check_balance(ledger: Ledger, without_value: Collection[str]) -> None:
    """Check that the rows are finite, in order and add up; raises ValueError with a message.

    The columns `without_value` are energies that do not exist, so they contain NaN.
    """
    rows = ledger.rows()
    right = np.where([name in without_value for name in ledger.names], np.isnan(rows), np.isfinite(rows)).all(axis=1)
    if not right.all():
        raise ValueError(f"row {int(np.argmin(right))} of its ledger is not finite, or has an energy that does not exist")
    if not (np.diff(ledger["time"]) > 0).all():
        raise ValueError("the times of its ledger do not ascend")
    total = known_total(ledger)
    closure = total - total[:1] - ledger["external_work"] + ledger["dissipated_work"]
    if REMOVED in ledger:
        closure = closure + ledger[REMOVED]
    size = ENERGY * max(float(np.abs(part).max()) for part in (known_strain(ledger), *(ledger[name] for name in PARTS)))
    for name, sums in (("total_energy", total), ("closure_error", closure)):
        if (np.abs(ledger[name] - sums) > size).any():
            raise ValueError(f"the {name} of row {int(np.argmax(np.abs(ledger[name] - sums)))} of its ledger does not add up")
