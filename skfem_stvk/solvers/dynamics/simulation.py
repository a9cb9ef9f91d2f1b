"""Simulation that another program drives: one step per call, with inputs, and states to go back to."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from math import inf
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, choice, flag, number, shown, text, whole
from ...arguments import path as path_of
from ...errors import StateError, StvkError, SupportError
from ...mesh.locations import Where, vertices_at
from ...results.contact_forces import ContactState, contact_state
from ...results.reactions import ReactionPlace
from ...system import System
from ...system.bound import elements_to_remove
from ...system.coordinates import Coordinates, ReducedLike
from ...system.signature import Fingerprint, sums_of
from ...terminal import html_table
from ..runs.ledger import Ledger
from .damping import Damping
from .inputs import Inputs
from .integrators import Integrator, StepFailed
from .ledger_rows import REMOVED, LedgerLocations, LedgerWriter, column_names
from .motion import Motion
from .motion_checkpoint import MOTION_FILE, MotionCheckpoint, SavedMotion, load
from .options import Options, basis_of, checked_integrator, method_options, refuse_unsupported
from .record import SLACK, Clock, Counts, HierarchyOrigin, MotionState, RunRecord, Snapshot
from .removal import rule_text
from .resumed import restored
from .run import SimulationError
from .simulate import checked_body, first_state
from .steps import HALVINGS, Steps

Method = TypeVar("Method", bound=Callable[..., Any])

#: Largest number of times that a step may be halved.
MOST_HALVINGS = 20


def exclusive(method: Method) -> Method:
    """Return a method of `Simulation` that raises StvkError within another such call, by a motion or a load."""

    @wraps(method)
    def alone(self: Simulation, *arguments: Any, **named: Any) -> Any:
        if self._running:
            raise StvkError(
                f"{method.__name__}() within a call of this simulation, by a motion or a load; expected functions that leave the "
                f"simulation alone. Call {method.__name__}() after the step."
            )
        self._running = True
        try:
            return method(self, *arguments, **named)
        finally:
            self._running = False

    return cast(Method, alone)


class Energies(NamedTuple):
    """Energies of a state [J]: `potential` is that of the loads that have one. Forces that are inputs have none."""

    kinetic: float
    strain: float
    potential: float

    @property
    def total(self) -> float:
        """Sum of the three energies [J]."""
        return self.kinetic + self.strain + self.potential


@dataclass(frozen=True, eq=False, repr=False)
class SavedState:
    """State of a `Simulation`, from `copy_state` for `restore` of the same object, whose `key` it has, at time `t` [s]."""

    key: object
    t: float
    snapshot: Snapshot
    inputs: Array
    system: System
    origin: HierarchyOrigin | None
    removed: tuple[NDArray[np.int64], Array]


class Simulation:
    """Motion that another program drives: one step per call, with displacements and forces as inputs.

    ::

        M v' + D v + F(u) = h(u, t) + pushed forces

    Inputs are the displacements of locations whose components have no value, `System(..., prescribed={"grip": "xyz"})`, the total
    forces on the `pushed` locations, and the displacements of the shapes of `moved` contacts. They are zero at first and keep their
    values until others are given. Within a call of `step`, they go straight from their last values to the new ones. One simulation
    belongs to one thread. Several of them, also of one body, can run side by side.

    Parameters
    ----------
    system
        A `System` or a `ReducedSystem`, as in `simulate`.
    integrator
        Time integrator, as in `simulate`.
    pushed
        Names of locations on which total forces act, in equal parts on the nodes.
    moved
        Names of contacts whose shapes are displaced: `RigidContact(..., name="ball")` without a `motion`.
    u0, v0, t0, mass, damping
        Initial state, kind of the mass and damping, as in `simulate`.
    halvings
        Largest number of times that a step without a state is halved, up to `2**halvings` parts. By default 6 for a body with a
        `MeshContact`, as in `simulate`, and otherwise 0, which limits the time of a step.
    on_failure
        "raise" an error if a step finds no state, or "hold": count it in `failures` and leave everything as it was.
    ledger
        Whether to record energies, works and momenta in a ledger, one row per step, as `simulate` does.

    Attributes
    ----------
    failures
        Number of calls of `step` that found no state.

    Raises
    ------
    MaterialError, LoadError, SupportError, StateError, StvkError
        as in `simulate`.
    ContactError
        if a `moved` contact does not exist, or has a motion of its own.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import LinearBackwardEuler, StVK, System
    >>> mesh = skfem.MeshTri().refined(2).with_boundaries({"grip": lambda x: x[0] == 1, "back": lambda x: x[0] == 0})
    >>> body = System(mesh, StVK(young=1e4, poisson=0.3, density=1e3), fixed={"back": "xy"}, prescribed={"grip": "xy"})
    >>> sim = Simulation(body, LinearBackwardEuler(dt=1e-3))
    >>> for i in range(5):
    ...     sim.step(grip=(1e-4 * (i + 1), 0.0))
    >>> sim.steps, sim.mean("grip"), bool(sim.reaction("grip")[0] > 0)
    (5, array([0.0005, 0.    ]), True)
    """

    def __init__(
        self,
        system: System | ReducedLike,
        integrator: Integrator,
        *,
        pushed: Sequence[str] = (),
        moved: Sequence[str] = (),
        u0: ArrayLike | None = None,
        v0: ArrayLike | None = None,
        t0: float = 0.0,
        mass: str | None = None,
        damping: Damping | None = None,
        halvings: int | None = None,
        on_failure: str = "raise",
        ledger: bool = False,
    ) -> None:
        integrator, t0 = checked_integrator(integrator), number("t0", t0, "a time in seconds")
        body = _body(system)
        motion = Motion(body, mass, damping, Inputs(body, pushed, moved))
        refuse_unsupported(motion, integrator, removing=False)
        state = first_state(motion, u0, v0, t0, integrator.dt or 1e-6)
        names = column_names(motion.body) if flag("ledger", ledger) else ["time"]
        self._begin(motion, integrator, RunRecord.at(state, Ledger(names), motion.body), halvings, on_failure)
        self._first = self.system, self._numbers()

    def _begin(self, motion: Motion, integrator: Integrator, record: RunRecord, halvings: int | None, on_failure: str) -> None:
        """Begin with the state of the record, with a ledger if that has more than one column."""
        assert motion.inputs is not None
        self._motion, self._integrator, self._record, self._inputs = motion, integrator, record, motion.inputs
        if halvings is None:
            halvings = HALVINGS if any(contact.is_barrier for contact in motion.system.contacts) else 0
        halvings = whole("halvings", halvings, f"0 ... {MOST_HALVINGS}", 0, MOST_HALVINGS)
        self._holds = choice("on_failure", on_failure, ("raise", "hold")) == "hold"
        self.failures, self._key, self._running = 0, object(), False
        self._steps = Steps(motion, integrator, record, self._arrived, halvings)
        self._means: dict[str, Callable[[Array], Array]] = {}
        self._reactions: dict[str, Callable[[], Array]] = {}
        self._before = record.state.copy()
        self._writer: LedgerWriter | None = None
        self._steps.start()
        if record.origin is not None:
            self._steps.stepper.rebuild(record.origin)
        if len(record.ledger) > 1:
            self._writer = self._written(record.ledger)

    def _written(self, ledger: Ledger) -> LedgerWriter:
        """Return the writer of a ledger, in which the present state has a row."""
        writer = LedgerWriter(self._motion, LedgerLocations(), ledger, self.dt, self._integrator.mean)
        state = self._record.state
        writer.begin(state)
        if not ledger.steps:
            writer.append_row(state, self._steps.stepper.strain_energy(state))
            writer.set_inside_out(len(self.inside_out()))
        return writer

    @exclusive
    def step(self, until: float | None = None, **inputs: ArrayLike) -> None:
        """Advance the motion by one step, or until a time.

        Parameters
        ----------
        until
            Time at the end [s]. Whole steps lead there, and a shorter one if it is not a whole number of steps away. By default one
            step is made.
        **inputs
            Values at the end of the call, by the name of the location: (k,) displacements [m] of all nodes at a moved location,
            along its k components, or (n, k) with one row per node, ascending; (d,) total force [N] on a pushed location; (d,)
            displacement [m] of the shape of a moved contact. A `ReducedSystem` takes (k,) only. Use `**{"a name": value}` for names
            that Python does not allow here.

        Raises
        ------
        SimulationError
            if no state was found, unless `on_failure` is "hold". The simulation is as it was before the call.
        StvkError
            if an input is unknown, or its value has another shape or is not finite; if `until` is not after `t`.
        """
        record, values, before = self._record, self._inputs.changed(inputs), self._inputs.values
        state, clock = record.state, record.clock
        at, origin = Clock(clock.start, clock.dt, clock.count), record.origin
        then = at, record.reviews, record.steps, record.cuts, record.history
        if until is None:
            end = clock.next(inf)[0]
            self._inputs.begin(values, state.t, end)
        else:
            end = number("until", until, self.system.units.text(f"a time after t = {state.t:.9g} s"), state.t)
            self._steps.refuse_far(end)
            self._inputs.begin(values, state.t, end - SLACK * clock.dt)
        self._before.copy_from(state)
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # states that overflow are rejected later
                self._one_step(end)
                while until is not None and record.clock.steps_left(end):
                    self._one_step(end)
            self._inputs.stay(values)
        except BaseException as error:
            self._go_back(Snapshot(self._before.copy(), *then), before, origin)
            if not isinstance(error, StepFailed | StateError):
                raise
            self.failures += 1
            if not self._holds:
                raise SimulationError(None, self._failure(error, end)) from error

    def _one_step(self, end: float) -> None:
        """Make a step, a shorter one if `end` lies within it."""
        record = self._record
        t, is_whole = record.clock.next(end)
        self._steps.advance(t, is_whole)
        if is_whole:
            self._steps.review()
        else:
            record.clock = Clock(t, record.clock.dt)
        record.origin = self._steps.stepper.origin
        if self._writer is not None:
            self._writer.append_row(record.state, self._steps.stepper.strain_energy(record.state))

    def _arrived(self, state: MotionState) -> None:
        if self._writer is not None:
            self._writer.add_work(state)

    def _failure(self, error: Exception, end: float) -> str:
        halved = f", not even in {2**self._steps.halvings} parts" if self._steps.halvings else ""
        return self.system.units.text(
            f"No state was found between t = {self.t:.6g} s and {end:.6g} s{halved}: {str(error).rstrip('.')}. The simulation is "
            f"as it was before. Try a smaller dt, smaller changes of the inputs{', or halvings=6' * (not halved)}; "
            "on_failure='hold' goes on without an error."
        )

    @property
    def t(self) -> float:
        """Time of the state [s]."""
        return self._record.state.t

    @property
    def dt(self) -> float:
        """Length of the next step [s]; it may change where an explicit integrator chooses it."""
        return self._record.clock.dt

    @property
    def steps(self) -> int:
        """Number of steps so far."""
        return self._record.steps

    @property
    def iterations(self) -> int:
        """Number of iterations so far, as in `Run.iterations`."""
        return self._record.counts.iterations

    @property
    def u(self) -> Array:
        """Copy of the displacements (ndofs,) [m], read-only."""
        return self._expanded(self._record.state.u)

    @property
    def v(self) -> Array:
        """Copy of the velocities (ndofs,) [m/s], read-only."""
        return self._expanded(self._record.state.v)

    @property
    def system(self) -> System:
        """Body, without the removed elements."""
        return self._motion.system

    @property
    def ledger(self) -> Ledger | None:
        """Ledger with one row per step; None without `ledger=True`."""
        return None if self._writer is None else self._writer.ledger

    def u_at(self, nodes: Where) -> Array:
        """Return the displacements (n, d) [m] of the nodes at a location.

        Parameters
        ----------
        nodes
            Name of a location, ids of nodes, or a predicate of the coordinates.

        Raises
        ------
        RegionError
            if there are no such nodes.
        """
        dofs = self._dofs_at(nodes, "u_at")
        return np.array(self._motion.states.entries(dofs.ravel())(self._record.state.u)).reshape(dofs.shape)

    def mean(self, name: str) -> Array:
        """Return the mean displacement (d,) [m] of the nodes at a named location.

        Parameters
        ----------
        name
            Name of the location.

        Raises
        ------
        RegionError
            if there is no such location.
        """
        name = text("name", name)
        if name not in self._means:
            self._means[name] = self._motion.states.entries(self._dofs_at(name, "mean").ravel())
        mean: Array = self._means[name](self._record.state.u).reshape(-1, self.system.mesh.d).mean(axis=0)
        return mean

    def _dofs_at(self, where: Where, what: str) -> NDArray[np.int64]:
        """Return the degrees of freedom (n, d) of the nodes at a location."""
        d = self.system.mesh.d
        dofs: NDArray[np.int64] = d * vertices_at(self.system.mesh, where, what)[:, None] + np.arange(d)
        return dofs

    def energy(self) -> Energies:
        """Return the kinetic energy, the strain energy and the potential of the loads [J]."""
        sums, state = np.zeros(8), self._record.state
        potential = self._motion.add_up(state, sums)
        return Energies(float(sums[0]) / 2, self._steps.stepper.strain_energy(state), potential)

    def reaction(self, name: str) -> Array:
        """Return the mean force (d,) [N] of the supports at a named location on the body during the last step.

        It is from the equation of the step, with damping and the inertia `M (v1 - v)/T`. The work of the support over the step is
        `(v + v1)/2 . M (v1 - v)` plus the displacements times the rest of the reaction; with it the energies balance. For a
        `ReducedSystem`, it costs nothing at a moved location, and one evaluation on the mesh elsewhere, for the end of the step.

        Parameters
        ----------
        name
            Name of the location. As in `StaticResult.reaction`, that of a support has its components and its share of common ones;
            any other has all components that supports constrain at its nodes.

        Raises
        ------
        RegionError, SupportError
            if there is no such location, or no support there.
        StvkError
            if no step was made yet.
        """
        if not self.steps:
            raise StvkError(f"reaction({name!r}) before the first step; expected a call of step() before.")
        name = text("name", name)
        if name not in self._reactions:
            self._reactions[name] = self._reaction_at(name)
        return self._reactions[name]()

    def _reaction_at(self, name: str) -> Callable[[], Array]:
        """Return the function that computes the reaction at a location."""
        motion, state, supports, d = self._motion, self._record.state, self.system.supports, self.system.mesh.d
        if not np.isin(self._dofs_at(name, "reaction"), supports.held).any():
            raise SupportError(
                f"reaction: no support acts at {shown(name)}; expected a location with fixed or prescribed components."
            )
        place = ReactionPlace.of(self.system, name)
        shares = place.shares * np.isin(d * place.vertices[:, None] + np.arange(d), supports.held)
        place = place._replace(shares=shares)
        if not isinstance(motion.body, Coordinates):
            return lambda: np.asarray(place.forces(state.reaction).sum(axis=0))
        moved = supports.moved.get(name)
        if moved is None or np.count_nonzero(shares) > moved.indices.size:
            return lambda: np.asarray(place.forces(self._ground_forces()).sum(axis=0))
        lifts = motion.free.fixed[self._inputs.moved[self._inputs.known[name].part]]
        along = np.eye(d)[["xyz".index(letter) for letter in moved.components]]
        return lambda: np.asarray(state.reaction[lifts] @ along)

    def _ground_forces(self) -> Array:
        """Return the forces (ndofs,) of supports and foundations at the end of the step, from one evaluation on the mesh."""
        return self._motion.ground_forces(self._record.state, (self.t - self.dt, self.t), self.dt, False)

    def contact(self, name: str) -> ContactState:
        """Return the forces of a contact in the last step, as `Run.contact`.

        Parameters
        ----------
        name
            Name of the contact, as in `RigidContact(..., name="floor")`.

        Raises
        ------
        ContactError
            if there is no such contact.
        """
        return contact_state(self.system, name, self.u, self._motion.moment(self.t), self._record.state.forces)

    def inside_out(self) -> NDArray[np.int64]:
        """Return the ids of the inverted or flat elements, ascending."""
        return self._motion.body.inside_out(self._record.state.u)

    @exclusive
    def remove(self, elements: str | ArrayLike) -> None:
        """Remove elements from the body, as `System.without` does; `system` is then the remaining body.

        Parameters
        ----------
        elements
            Ids of elements, a mask (nt,), or the name of a subdomain.

        Raises
        ------
        RegionError, StvkError
            as `System.without`, and for a `ReducedSystem`.
        """
        motion, record = self._motion, self._record
        if isinstance(motion.body, Coordinates):
            raise StvkError("remove(...): a reduced system is made of all its elements; expected a Simulation of a System.")
        ids = elements_to_remove(motion.system, elements)
        if not len(ids):
            return
        if self._writer is not None and REMOVED not in self._writer.ledger:
            record.ledger = _with_removed_energy(self._writer.ledger, column_names(motion.body, removing=True))
            self._writer = self._written(record.ledger)
        self._steps.remove(ids, self._writer)
        self._steps.review(recompute=True)

    @exclusive
    def copy_state(self) -> SavedState:
        """Return a copy of the state, from which `restore` leads to the same steps, to the last bit."""
        record = self._record
        removed = record.removed, record.removed_at
        return SavedState(self._key, record.state.t, record.snapshot(), self._inputs.values, self.system, record.origin, removed)

    @exclusive
    def restore(self, saved: SavedState) -> None:
        """Go back to a state, and to the inputs that it had.

        Parameters
        ----------
        saved
            Result of `copy_state` of this simulation.

        Raises
        ------
        StvkError
            if it is of another simulation.
        """
        if not isinstance(saved, SavedState) or saved.key is not self._key:
            what = "a state of another simulation" if isinstance(saved, SavedState) else shown(saved)
            raise StvkError(f"restore({what}); expected a result of copy_state() of this simulation.")
        if saved.system is not self.system:
            self._motion.replace_system(saved.system)
        self._record.removed, self._record.removed_at = saved.removed
        self._go_back(saved.snapshot, saved.inputs, saved.origin)

    def _go_back(self, then: Snapshot, inputs: Array, origin: HierarchyOrigin | None) -> None:
        record = self._record
        self._inputs.stay(inputs)
        record.return_to(then)
        self._steps.start()
        record.origin = origin
        if origin is not None:
            self._steps.stepper.rebuild(origin)
        if self._writer is not None:
            self._writer.begin(record.state)

    @exclusive
    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the state to a folder, as a checkpoint that `Simulation.load` and `simulate(checkpoint=..., resume=True)` read.

        Without a ledger, the file is that of a motion that begins at this state.

        Parameters
        ----------
        path
            Path of the folder, whose file is `motion.npz`.
        overwrite
            Let it replace the file of another motion.

        Raises
        ------
        StvkError
            if the folder has the file of another motion, or cannot be written.
        """
        folder, motion, record = path_of("path", path), self._motion, self._record
        (system, start), removed_at = self._first, record.removed_at
        if self._writer is None:
            system, start, removed_at = motion.system, self._numbers(), np.full(len(record.removed), np.nan)
            next_review = max(record.reviews.next - record.steps, 0)
            ledger = Ledger(column_names(motion.body))
            self._written(ledger)
            clock, reviews = Clock(self.t, self.dt), replace(record.reviews, next=next_review)
            record = replace(record, clock=clock, reviews=reviews, steps=0, cuts=0, ledger=ledger, counts=Counts())
        record = replace(record, removed_at=removed_at)
        removing = REMOVED in record.ledger
        method = method_options(motion, self._integrator, removed_by_hand if removing else None)
        with MotionCheckpoint(folder, space=motion.states) as file:
            file.belongs_to(Fingerprint("motion", system, method, start["t0"], start), flag("overwrite", overwrite))
            inputs = {"pushed": self._inputs.pushed, "moved": self._inputs.shapes, "inputs": self._inputs.values}
            file.replace(SavedMotion.of(record, LedgerLocations(), motion.system.mesh, found=False, seconds={}, **inputs))
            return file.file

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        system: System | ReducedLike,
        integrator: Integrator | None = None,
        *,
        halvings: int | None = None,
        on_failure: str = "raise",
    ) -> Simulation:
        """Return the simulation of a checkpoint, which `save` or `simulate` wrote, with the ledger that is there.

        Parameters
        ----------
        path
            Path of the folder.
        system
            System with which the motion began.
        integrator
            Integrator; by default that of the checkpoint. It is needed if its solver is an object.
        halvings, on_failure
            As in `Simulation`.

        Raises
        ------
        StvkError
            if the checkpoint is missing or damaged, or of another problem.
        """
        file, body = path_of("path", path) / MOTION_FILE, _body(system)
        read = load(file, body.space)
        saved, by_hand = read.saved, read.method.remove == rule_text(removed_by_hand)
        options = Options(until=inf, integrator=integrator, remove=removed_by_hand if by_hand else None)
        inputs = Inputs(body, saved.pushed, saved.moved)
        motion, own, _, problem = restored(body, options, read, file, inputs)
        made: Simulation = cls.__new__(cls)
        made._first = problem.system, read.problem.numbers
        made._begin(motion, own, saved.record(read.ledger), halvings, on_failure)
        return made

    def _expanded(self, x: Array) -> Array:
        u = np.array(self._motion.states.expand(x))
        u.flags.writeable = False
        return u

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        """Refuse copies and pickles, which would share the state or lack the data of solvers."""
        raise StvkError(
            "A Simulation cannot be copied or pickled; expected copy_state() and restore() to go back, or save() and load() for "
            "another simulation."
        )

    def _repr_html_(self) -> str:
        rows = [(name, f"{getattr(self, name):g}") for name in ("t", "dt", "steps", "failures")]
        inputs = ", ".join(self._inputs.known)
        return html_table("Simulation", [*rows, ("integrator", self._integrator), ("inputs", inputs), ("body", self._motion.body)])

    def __repr__(self) -> str:
        inputs = ", ".join(map(repr, self._inputs.known)) or "none"
        return self.system.units.text(
            f"Simulation at t = {self.t:g} s, {self.steps} steps with {self._integrator}; inputs: {inputs}; {self._motion.body!r}"
        )

    def _numbers(self) -> dict[str, list[float]]:
        """Return numbers that identify the present state as an initial one."""
        system = self.system
        numbers = {name: sums_of(x, system.space) for name, x in (("u0", self.u), ("v0", self.v))}
        return {"t0": [self.t]} | numbers | basis_of(self._motion)


def removed_by_hand(t: float, u: Array) -> None:
    """Rule that stands in files for elements that `Simulation.remove` removed."""


def _with_removed_energy(ledger: Ledger, names: Sequence[str]) -> Ledger:
    """Return the ledger with the additional column of the energy of removed elements, zero so far."""
    columns = [ledger[name] if name in ledger else np.zeros(ledger.steps) for name in names]
    wider = Ledger(names, np.column_stack(columns))
    wider.units = ledger.units
    return wider


def _body(system: System | ReducedLike) -> System | Coordinates:
    """Return the body of the states; refuse bodies that cannot be stepped."""
    body = checked_body(system)
    body.space.comm.refuse_divided("Simulation(system)", "a body on one machine", "inputs and saved states are not exchanged.")
    return body
