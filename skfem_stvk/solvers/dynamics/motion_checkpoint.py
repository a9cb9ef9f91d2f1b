"""Checkpoint of a motion: one file in its own folder, from which a later run continues with bitwise identical results."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from itertools import count, takewhile
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AllowInfNan, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from ...arguments import Array
from ...errors import StvkError, name_ids
from ...mesh import ElementMesh
from ...results.complete_files import ForeignFile, of_leader, output_folder
from ...results.state_files import MOTION, MOTION_FILE
from ...results.store import FolderStore, Header, Record, expect, refusing_damage
from ...space import Space
from ...system import System
from ...system.signature import Fingerprint
from ..newton.problem import Tangent
from .integrators import Integrator
from .ledger import Ledger
from .ledger_rows import REMOVED, LedgerLocations, column_names, columns_without_value, known_strain, known_total
from .motion import Motion
from .record import FEWEST, HALVINGS, MOST, Clock, Counts, HierarchyOrigin, MotionState, Reviews, RunRecord, Snapshot

#: Shortest time between two checkpoints [s], and largest share of the run time that writing them may take.
EVERY, SHARE = 5.0, 0.05
#: Remedy for a file that cannot be resumed.
START_AGAIN = "Start again: overwrite=True, without resume."
#: Arrays of a state that a checkpoint holds.
ARRAYS = ("u", "v", "a", "reaction")
#: Beginning of the names of the arrays with the `forces` of a state.
FORCE = "force "
#: Arrays of the origin of a hierarchy.
HIERARCHY = ("hierarchy u0", "hierarchy w")
#: Array of the inputs of a `Simulation`.
INPUTS = "inputs"
#: Relative tolerance of energies, as a part of the largest.
ENERGY = 1e-6
#: Smallest computed step, as a part of the first one.
SHORTEST = 1e-9
#: Columns that, with the strain energy, add up to the total energy and the closure error.
PARTS = "kinetic_energy", "potential_energy", "external_work", "dissipated_work"

#: Length of a step, or a bound on it [s]; infinite for a body without stiffness.
Bound = Annotated[NonNegativeFloat, AllowInfNan(True)]


class ClockRecord(Record):
    """`Clock` in the form that checkpoints store."""

    start: float
    dt: PositiveFloat
    count: NonNegativeInt


class ReviewsRecord(Record):
    """`Reviews` of a critical step in the form that checkpoints store."""

    next: NonNegativeInt
    interval: Annotated[int, Field(ge=FEWEST, le=MOST)]
    seen: Bound
    step: Bound
    bound: Bound
    largest: Bound
    halvings: Annotated[int, Field(ge=0, le=HALVINGS)]


class MomentRecord(Record):
    """`Snapshot` without the arrays of its state."""

    t: float
    clock: ClockRecord
    looks: ReviewsRecord
    steps: NonNegativeInt
    cuts: NonNegativeInt
    rows: PositiveInt


class OriginRecord(Record):
    """`HierarchyOrigin` without its arrays."""

    t: float
    c: NonNegativeFloat
    g: NonNegativeFloat
    tangent: Literal[tuple(one.value for one in Tangent)]  # type: ignore[valid-type]
    with_tensions: bool
    pace: NonNegativeFloat | None
    slow: bool


class StepperRecord(Record):
    """`Counts` of a run in the form that checkpoints store."""

    iterations: NonNegativeInt
    clamped: NonNegativeInt


class IntegratorRecord(Record):
    """Integrator in the form that checkpoints store: its options, and the names of solvers that are objects."""

    name: str
    options: dict[str, str | float | None]
    objects: dict[str, str]


class DampingRecord(Record):
    """Factors of the damping in the form that checkpoints store."""

    alpha: NonNegativeFloat
    beta: NonNegativeFloat
    tau: NonNegativeFloat


class MethodRecord(Record):
    """Method in the `Signature` of a motion."""

    integrator: IntegratorRecord
    mass: Literal["lumped", "consistent"]
    damping: DampingRecord
    remove: str | None = None


class MotionHeader(Header):
    """Header of the file: progress of the run, its last good state, the locations that it records, and the series that it saves."""

    now: MomentRecord
    good: MomentRecord | None
    counts: StepperRecord  # iterations of all steps so far
    seconds: dict[str, Annotated[float, Field(ge=-1)]]  # run time by part; "other" may be negative by rounding
    probes: list[str]
    reactions: list[str]
    supports: dict[str, str]  # words of the support of each reaction; empty for another location
    columns: list[str]
    save: str | None  # series as the user named it; a resumed run uses its file name alone, see `outputs._series_next_to`
    every: PositiveInt  # steps from one saved state to the next
    hierarchy: OriginRecord | None = None  # origin of multigrid's hierarchy
    pushed: tuple[str, ...] = ()  # locations on which a `Simulation` pushes
    moved: tuple[str, ...] = ()  # contacts whose shapes it moves


class MotionCheckpoint(FolderStore[MotionHeader]):
    """File `motion.npz` in a folder, replaced as a motion proceeds. If the run is killed, the previous file remains intact.

    States of the motion are vectors of the `space`. In a divided body, each part has a file of its own next to `motion.npz`.
    """

    known = MOTION
    schema = MotionHeader
    remedy = START_AGAIN

    @staticmethod
    def by_dof(name: str) -> bool:
        own = name.removeprefix("good ")
        return own in ARRAYS or own.startswith(FORCE) or name in HIERARCHY

    def __init__(self, folder: Path, resume: bool = False, space: Space | None = None) -> None:
        self.file, self._next = folder / MOTION_FILE, -np.inf
        super().__init__(output_folder(folder), space)
        there = of_leader(self.space.comm, self.file.exists)
        #: File to continue from; None to begin with the initial state.
        self.source = self.file if resume and there else None

    def belongs_to(self, problem: Fingerprint, overwrite: bool) -> None:
        """Set the signature of the problem for the files to be written. Refuse to replace a file of another problem."""
        self.problem = problem
        if self.file.exists() and not overwrite:
            self.refuse_to_replace(self.file)

    def due(self, now: float) -> bool:
        """Return whether to write now, where `now` is from `time.perf_counter` [s].

        The first call returns True. Later ones return True after `EVERY` seconds, or more if writing would exceed the share
        `SHARE`.
        """
        return now >= self._next

    def write(self, about: Mapping[str, Any], arrays: Mapping[str, Array], ledger: Ledger) -> None:
        """Replace the file. `about` has the fields of `MotionHeader` except the format, the problem and the columns."""
        begin = time.perf_counter()
        every = {**arrays, "ledger": ledger.rows()}
        self.write_file(self.file, self.problem, {"columns": ledger.names, **about}, every, self.states)
        end = time.perf_counter()
        self._next = end + max(EVERY, (end - begin) / SHARE)


class Saved(NamedTuple):
    """Content of a checkpoint: its header and method, arrays by name, and the ledger so far."""

    header: MotionHeader
    method: MethodRecord
    arrays: dict[str, Array]
    ledger: Ledger

    def record(self) -> RunRecord:
        """Return the record of the run that the file stores."""
        now, good = self.header.now, self.header.good
        then = self._snapshot(now, "")
        last_good = None if good is None else self._snapshot(good, "good ")
        record = RunRecord(then.state, then.clock, self.ledger, then.reviews, then.steps, then.cuts, last_good)
        record.removed, record.removed_at = self.removed
        record.history = then.history
        if self.header.hierarchy is not None:
            u0, w = (self.arrays[name] for name in HIERARCHY)
            record.origin = HierarchyOrigin(u0, w, **self.header.hierarchy.model_dump())
        record.counts.add(Counts(**self.header.counts.model_dump()))
        record.watch.add(self.header.seconds)
        return record

    @property
    def removed(self) -> tuple[NDArray[np.int64], Array]:
        """Ids of removed elements, and the times of their removal [s]; NaN if they were removed before the run."""
        return self.arrays.get("removed", np.empty(0, dtype=np.int64)), self.arrays.get("removed at", np.empty(0))

    def _snapshot(self, moment: MomentRecord, prefix: str) -> Snapshot:
        u, v, a, reaction = (self.arrays[prefix + name] for name in ARRAYS)
        forces = np.array(self._numbered(prefix + FORCE)).reshape(-1, len(u))
        state = MotionState(moment.t, u, v, a, reaction, forces)
        clock, reviews = Clock(**moment.clock.model_dump()), Reviews(**moment.looks.model_dump())
        return Snapshot(state, clock, reviews, moment.steps, moment.cuts, moment.rows, self.history(prefix))

    def history(self, prefix: str = "") -> tuple[Array, ...]:
        """Return the histories of the terms that have one."""
        return self._numbered(f"{prefix}history ")

    def _numbered(self, prefix: str) -> tuple[Array, ...]:
        names = takewhile(self.arrays.__contains__, (f"{prefix}{i}" for i in count()))
        return tuple(self.arrays[name] for name in names)


def packed(
    record: RunRecord, locations: LedgerLocations, found: bool, mesh: ElementMesh
) -> tuple[dict[str, Any], dict[str, Array]]:
    """Return the part of the header that JSON can write, and the arrays.

    Include the last good state if the step length is `found` from the critical step and not user-supplied.
    """
    about: dict[str, Any] = {"now": _moment(record, record.ledger.steps), "good": None}
    arrays = _arrays_of(record.state, "")
    arrays |= {f"history {i}": one for i, one in enumerate(record.history)}
    good = record.good
    if found and good is not None and good.steps < record.steps:
        about["good"] = _moment(good, good.rows)
        arrays |= _arrays_of(good.state, "good ")
        arrays |= {f"good history {i}": one for i, one in enumerate(good.history)}
    if record.origin is not None:
        u0, w, *others = record.origin
        about["hierarchy"] = dict(zip(HierarchyOrigin._fields[2:], others, strict=True))
        arrays |= dict(zip(HIERARCHY, (u0, w), strict=True))
    if len(record.removed):
        arrays |= {"removed": record.removed, "removed at": record.removed_at}
    reactions = locations.reactions
    for kind, vertices in (("probes", locations.probes), ("reactions", {x: place.vertices for x, place in reactions.items()})):
        about[kind] = list(vertices)
        arrays |= {f"{kind} {name}": _in_whole_mesh(mesh, ids) for name, ids in vertices.items()}
    about["supports"] = {name: place.support for name, place in reactions.items()}
    return about, arrays


def _arrays_of(state: MotionState, prefix: str) -> dict[str, Array]:
    """Return the arrays of a state by name."""
    vectors = {prefix + name: getattr(state, name) for name in ARRAYS}
    return vectors | {f"{prefix}{FORCE}{i}": force for i, force in enumerate(state.forces)}


def _in_whole_mesh(mesh: ElementMesh, vertices: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the ids in the whole mesh of vertices of all parts, each once."""
    every = np.concatenate(mesh.space.comm.each(mesh.node_numbers[vertices]))
    return every[np.sort(np.unique(every, return_index=True)[1])]


def _moment(then: RunRecord | Snapshot, rows: int) -> dict[str, Any]:
    """Return the fields of a `MomentRecord`, as JSON can write them."""
    clock, reviews = vars(then.clock).copy(), vars(then.reviews).copy()
    return {"t": then.state.t, "clock": clock, "looks": reviews, "steps": then.steps, "cuts": then.cuts, "rows": rows}


def load(file: Path, space: Space | None = None) -> Saved:
    """Return the content of the file, checked as far as possible without the system. Its states are vectors of the `space`, by
    default those of the whole body.

    Raises an error if the file is missing, incomplete, or not written by this package.
    """
    if not file.exists():
        raise StvkError(
            f"There is no checkpoint {file}. Is the path relative to another folder? Without resume=True, simulate starts a new "
            "motion."
        )
    header, arrays = MotionCheckpoint.read_file(file, space)
    with refusing_damage(file, START_AGAIN):
        method = MethodRecord.model_validate(header.problem.method)
    try:
        rows = arrays.pop("ledger")
        if rows.dtype != np.float64:
            raise ValueError(f"numbers of the type {rows.dtype}")
        return Saved(header, method, arrays, Ledger(header.columns, rows))
    except (StvkError, KeyError, ValueError, TypeError) as error:
        raise ForeignFile(f"{file} is damaged: its ledger is missing or invalid ({error}). {START_AGAIN}") from None


def refuse_inconsistent(saved: Saved, motion: Motion, integrator: Integrator) -> LedgerLocations:
    """Return the locations that a checkpoint records.

    Raises ValueError or KeyError with a message if the checkpoint contradicts itself or the system.
    """
    header, ledger, system = saved.header, saved.ledger, motion.system
    probes, reactions = _vertices(saved, "probes", header.probes), _vertices(saved, "reactions", header.reactions)
    if list(header.supports) != header.reactions:
        raise ValueError(f"it has supports of {list(header.supports)}, and reactions of {header.reactions}")
    locations = LedgerLocations.checked(system, probes, reactions, header.supports)
    if lost := [words for name, words in header.supports.items() if locations.reactions[name].support != words]:
        raise ValueError(f"it records the reaction of the support {lost[0]}, which the system lacks")
    removing = saved.method.remove is not None
    if ledger.names != column_names(motion.body, *locations, removing=removing):
        raise ValueError(f"its ledger has the columns {', '.join(ledger.names)}")
    if ledger.steps != header.now.rows:
        raise ValueError(f"its ledger has {ledger.steps} rows for {header.now.rows}")
    _check_balance(ledger, columns_without_value(system))
    _check_removed(*saved.removed, system, ledger)
    start = {name: header.problem.numbers.get(name, []) for name in ("t0", "u0", "v0")}
    if start["t0"] != [ledger["time"][0]] or len(start["u0"]) != 2 or len(start["v0"]) != 2:
        raise ValueError(f"it began with {start}, its ledger at t = {ledger['time'][0]:g}")
    _check_moment(saved, header.now, "", motion, integrator)
    if header.hierarchy is not None:
        for name in HIERARCHY:
            expect(saved.arrays, name, (motion.states.n,))
    if header.good is not None:
        if integrator.dt is not None or not header.good.steps < header.now.steps:
            raise ValueError(f"its last good state is that of step {header.good.steps} of {header.now.steps}")
        _check_moment(saved, header.good, "good ", motion, integrator)
    return locations


def _check_removed(removed: Array, removed_at: Array, system: System, ledger: Ledger) -> None:
    """Check that the removed elements are those of the system, and that the times are in the ledger; raises ValueError."""
    during = removed_at[~np.isnan(removed_at)]
    if not np.array_equal(np.sort(removed), system.removed) or removed_at.shape != removed.shape:
        raise ValueError(
            f"it lacks {name_ids(removed, 'element')}; expected those that the system lacks, {name_ids(system.removed, 'element')}"
        )
    if not np.isin(during, ledger["time"]).all() or (np.diff(during) < 0).any() or (len(during) and REMOVED not in ledger):
        raise ValueError("the times at which elements were removed are not in its ledger")


def _vertices(saved: Saved, kind: str, names: list[str]) -> dict[str, Array]:
    """Return the locations of a checkpoint by name; raises ValueError with a message."""
    found = {name: saved.arrays.get(f"{kind} {name}", np.empty(0)) for name in names}
    wrong = [name for name, ids in found.items() if ids.ndim != 1 or ids.dtype.kind != "i"]
    if wrong or len(found) < len(names):
        listed = ", ".join(map(repr, wrong or names))
        raise ValueError(f"the vertices of its {kind} {listed} are missing, invalid or repeated")
    return found


def _check_moment(saved: Saved, moment: MomentRecord, prefix: str, motion: Motion, integrator: Integrator) -> None:
    """Check that the parts of a stored state are consistent; raises ValueError or KeyError with a message."""
    clock, reviews, times = moment.clock, moment.looks, saved.ledger["time"][: moment.rows]
    if moment.rows != moment.steps + 1 or moment.cuts > moment.steps or clock.count > moment.steps:
        raise ValueError(f"it has {moment.rows} rows for {moment.steps} steps, {moment.cuts} cut and {clock.count} of one length")
    if moment.t != clock.start + clock.count * clock.dt or moment.t != times[-1]:
        raise ValueError(
            f"t = {moment.t!r}, but its clock has {clock.count} steps of {clock.dt!r} from {clock.start!r}, its ledger ends at "
            f"{float(times[-1])!r}"
        )
    if not np.array_equal(times[moment.steps - clock.count :], clock.start + np.arange(clock.count + 1) * clock.dt):
        raise ValueError("the times of its ledger are not those of its clock")
    if integrator.dt is not None and clock.dt != integrator.dt:
        raise ValueError(f"its steps are of {clock.dt!r}, those of its integrator of {integrator.dt!r}")
    if integrator.dt is None and not SHORTEST * reviews.largest <= clock.dt <= reviews.largest:
        raise ValueError(f"its steps are of {clock.dt:g} s, and were {reviews.largest:g} s at first")
    if reviews.next > moment.steps + reviews.interval:
        raise ValueError(f"after {moment.steps} steps its next review is at step {reviews.next}, later than its interval allows")
    names = *ARRAYS, *(f"{FORCE}{i}" for i in range(motion.force_rows))
    state = {name: expect(saved.arrays, prefix + name, (motion.states.n,)) for name in names}
    last = moment.rows - 1
    row = {"kinetic_energy": saved.ledger["kinetic_energy"][last], "strain_energy": known_strain(saved.ledger)[last]}
    kinetic = motion.states.dot(state["v"], motion.mass.multiply(state["v"])) / 2
    motion.body.return_to(saved.history(prefix))
    strain = motion.energy(state["u"], moment.t)
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
