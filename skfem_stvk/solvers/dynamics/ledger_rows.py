"""Content of a ledger: its columns, the locations whose motion and forces it records, and the entry of rows step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import nan
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, shown
from ...errors import StvkError
from ...mesh.displacements import by_vertex
from ...mesh.locations import Where, vertices_at
from ...results.reactions import ReactionPlace
from ...system import System
from ...system.coordinates import Coordinates
from ..runs.ledger import Ledger
from .motion import Motion
from .record import MotionState

#: Column with the number of inverted elements.
INSIDE_OUT = "inside_out"
#: Column with the energy that friction dissipated.
FRICTION = "friction_work"
#: Column with the energy of the elements that were removed.
REMOVED = "removed_energy"
Vertices = Mapping[str, NDArray[np.int64]]
NO_LOCATIONS: Mapping[str, Any] = MappingProxyType({})


def column_names(
    body: System | Coordinates, probes: Iterable[str] = (), reactions: Iterable[str] = (), *, removing: bool = False
) -> tuple[str, ...]:
    """Return the columns of a motion's ledger, in their order; `docs/reference/files.md` describes each.

    `removing`: whether elements may be removed from the body.
    """
    axes = "xyz"[: body.mesh.d]
    terms, contacts = body.elastic_names, body.contacts if isinstance(body, System) else []
    return (
        "time",
        "kinetic_energy",
        "strain_energy",
        *(f"strain_energy {name}" for name in terms if len(terms) > 1),
        "potential_energy",
        "external_work",
        "dissipated_work",
        *((FRICTION,) if _has_friction(body) else ()),
        *((REMOVED,) if removing else ()),
        "total_energy",
        "closure_error",
        INSIDE_OUT,
        *(f"linear_momentum_{axis}" for axis in axes),
        *(f"angular_momentum_{axis}" for axis in {"xy": "z", "xyz": axes}.get(axes, "")),
        *(f"{probe} {axis}" for probe in probes for axis in axes),
        *(f"reaction {location} {axis}" for location in reactions for axis in axes),
        *(
            f"contact {contact.name} {column}"
            for contact in contacts
            for column in (*axes, *(("gap",) if contact.shape is not None else ()))
        ),
    )


def _has_friction(body: System | Coordinates) -> bool:
    return isinstance(body, System) and any(contact.has_friction for contact in body.contacts)


def columns_without_value(system: System) -> list[str]:
    """Return the energy columns that are NaN because a term has no energy."""
    names = [f"strain_energy {name}" for name in system.without_energy if len(system.elastic_names) > 1]
    return ["strain_energy", *names, "total_energy"] if system.without_energy else []


def known_strain(ledger: Mapping[str, Array]) -> Array:
    """Return the strain energy (n,) [J] of the terms that have an energy."""
    strain, names = ledger["strain_energy"], list(ledger)
    by_term = names[names.index("strain_energy") + 1 : names.index("potential_energy")]
    known = sum((np.nan_to_num(ledger[name]) for name in by_term), np.zeros(len(strain)))
    return np.where(np.isnan(strain), known, strain)


def known_total(ledger: Mapping[str, Array]) -> Array:
    """Return the total energy (n,) [J], with the strain energy of the terms that have one. The sum is that of `LedgerWriter`."""
    total: Array = ledger["kinetic_energy"] + known_strain(ledger) + ledger["potential_energy"]
    return total


def refuse_name_of_column(system: System, probe: str) -> None:
    """Raise StvkError if a probe has the name of a column that is no displacement, or begins like one."""
    if probe in column_names(system, removing=True) or probe.startswith(("reaction ", "contact ", "strain_energy ")):
        raise StvkError(f"probe {probe!r}; expected another name: the ledger has columns of this name that are no displacements.")


class LedgerLocations(NamedTuple):
    """Vertices by name whose motion and forces a ledger records."""

    probes: Vertices = NO_LOCATIONS  # vertices whose mean displacements are recorded
    reactions: Mapping[str, ReactionPlace] = NO_LOCATIONS  # locations whose forces of supports and foundations are recorded

    @classmethod
    def checked(
        cls,
        system: System,
        probes: Mapping[str, Where] | None,
        reactions: Mapping[str, Where] | None,
        supports: Mapping[str, str] = NO_LOCATIONS,
    ) -> LedgerLocations:
        """Return the requested locations. `supports` are the words of supports whose locations a file has as vertices.

        Raises
        ------
        RegionError
            if a location has no vertices.
        SupportError
            if no support and no foundation is at the location of a reaction.
        StvkError
            if a probe has the name of another column.
        """
        probed, supported = _named("probes", probes, "'tip': [17]"), _named("reactions", reactions, "'clamp': 'left'")
        for name in probed:
            refuse_name_of_column(system, name)
        moving = {name: vertices_at(system.mesh, where, f"probe {name!r}") for name, where in probed.items()}
        supporting = {
            name: ReactionPlace.of(system, where, f"reaction {name!r}", supports.get(name)) for name, where in supported.items()
        }
        return cls(moving, supporting)


class LedgerWriter:
    """Recorder of the energies, works and momenta of a motion's states in its ledger.

        total_energy = kinetic + strain + potential
        closure_error = total_energy - total_energy at the first step - external work + dissipated work + removed energy

    The closure error is energy that was created or lost numerically, by the time integrator and by round-off. The forces of terms
    without an energy count as external work.

    When a motion is resumed, the ledger already has rows, and the last row belongs to the first state. `dt` is the approximate
    length of the first step [s]. `mean`: whether the forces of the integrator are means over a step.
    """

    def __init__(self, motion: Motion, locations: LedgerLocations, ledger: Ledger, dt: float, mean: bool = False) -> None:
        self.motion, self.ledger, self._dt, self._mean = motion, ledger, dt, mean
        mesh = motion.system.mesh
        counts = mesh.space.counted(np.ones(mesh.nv)) > 0  # each node once in a divided body
        probes = [ids[counts[ids]] for ids in locations.probes.values()]
        self._reactions = [
            place._replace(shares=place.shares * counts[place.vertices, None]) for place in locations.reactions.values()
        ]
        dofs = [(mesh.d * vertices[:, None] + np.arange(mesh.d)).ravel() for vertices in probes]
        self._probes = [motion.states.entries(one) for one in dofs]
        self._probed = [mesh.space.comm.total(len(vertices)) for vertices in probes]
        self._angular = {1: slice(0), 2: slice(6, 7), 3: slice(4, 7)}[mesh.d]
        self._sums = np.zeros(8)
        self.external = self.dissipated = self.friction = self.removed = 0.0
        self._has_friction = FRICTION in self.ledger.names
        self._removing = REMOVED in self.ledger.names
        self._without_value = [ledger.names.index(name) for name in columns_without_value(motion.system)]
        self._first = float(known_total(ledger)[0]) if ledger.steps else None
        self._inside_out = self.ledger.names.index(INSIDE_OUT)
        self._has_work = motion.moving or motion.damped or motion.driven or bool(motion.system.working_contacts)
        self._t, self._u, self._v = 0.0, np.zeros(motion.states.n), np.zeros(motion.states.n)
        self._driving_force: Array = np.zeros(motion.states.n)

    def begin(self, state: MotionState) -> None:
        """Count the work from this state on.

        If the ledger has rows, the last one must belong to this state. The works of that row are continued.
        """
        if self.ledger.steps:
            self.external, self.dissipated = (float(self.ledger[name][-1]) for name in ("external_work", "dissipated_work"))
            self.friction = float(self.ledger[FRICTION][-1]) if self._has_friction else 0.0
            self.removed = float(self.ledger[REMOVED][-1]) if self._removing else 0.0
        self._begin(state)

    def _begin(self, state: MotionState) -> None:
        if self._has_work:
            self._t = state.t
            np.copyto(self._u, state.u)
            np.copyto(self._v, state.v)
            self._driving_force = self.motion.driving_force(state.u, state.t)
            if self.motion.system.without_energy and not self._mean:
                self._driving_force += self.motion.force_without_energy(state.u, state.t)

    def add_work(self, state: MotionState) -> None:
        """Add the work of driving forces and the energy lost to damping since the previous state."""
        if not self._has_work:
            return
        motion, before, since = self.motion, self._driving_force, self._t
        self.dissipated += motion.dissipated(self._u, state.u, state.t - since)
        change = state.u - self._u
        if motion.system.without_energy and self._mean:
            self.external += motion.states.dot(motion.force_without_energy(self._u + change / 2, state.t), change)
        if motion.moving:  # prescribed degrees of freedom do not move with the mean of their velocities
            fixed = motion.free.fixed
            impulse, apart = motion.mass.multiply(state.v - self._v), (state.v + self._v) / 2 - change / (state.t - since)
            dot_fixed = motion.states.on(fixed).dot
            self.external += dot_fixed(state.reaction[fixed], change[fixed]) + dot_fixed(impulse[fixed], apart[fixed])
        for term in motion.system.contacts_at(motion.moment(state.t)):
            u0, u1 = (by_vertex(motion.system.mesh, u) for u in (self._u, state.u))
            work, lost = term.work(u0, u1)
            self.external, self.dissipated, self.friction = self.external + work, self.dissipated + lost, self.friction + lost
        self._begin(state)
        dot = motion.states.dot
        self.external += (dot(before, change) + dot(self._driving_force, change)) / 2

    def append_row(self, state: MotionState, strain_energy: float) -> None:
        """Append a row for this state. Copy the number of inverted elements from the previous row; see `count_inside_out`.

        `strain_energy` is that of the terms that have an energy [J].
        """
        motion, mesh = self.motion, self.motion.system.mesh
        potential = motion.add_up(state, self._sums)
        sums = self._sums.tolist()
        kinetic = sums[0] / 2
        total = kinetic + strain_energy + potential
        closure = 0.0 if self._first is None else total - self._first - self.external + (self.dissipated + self.removed)
        self._first = total if self._first is None else self._first
        row = [state.t, kinetic, strain_energy, *motion.term_energies(state.u, state.t)]
        inside_out = float(self.ledger.rows(self.ledger.steps - 1)[0, self._inside_out]) if self.ledger.steps else 0.0
        optional = *([self.friction] if self._has_friction else []), *([self.removed] if self._removing else [])
        row += [potential, self.external, self.dissipated, *optional, total, closure, inside_out]
        row += [*sums[1 : 1 + mesh.d], *sums[self._angular]]
        for displacements, count in zip(self._probes, self._probed, strict=True):
            row += list(mesh.space.comm.total(displacements(state.u).reshape(-1, mesh.d).sum(axis=0)) / count)
        if self._reactions:
            times = [*self.ledger["time"][-2:].tolist(), state.t]
            forces = motion.ground_forces(state, times, self._dt, self._mean)
            for place in self._reactions:
                row += list(mesh.space.comm.total(place.forces(forces).sum(axis=0)))
        for contact, force in zip(motion.system.contacts_at(motion.moment(state.t)), state.forces, strict=False):
            row += list(force.reshape(-1, mesh.d)[contact.nodes].sum(axis=0))
            if contact.shape is not None:
                row.append(contact.smallest_gap(by_vertex(mesh, state.u)))
        for column in self._without_value:
            row[column] = nan
        self.ledger.append(row)

    def record_removal(self, state: MotionState, remove: Callable[[], None]) -> None:
        """Record the energy that is lost when `remove` removes elements at this state, and delete the last row.

        The last row must belong to this state. The lost energy is the decrease of the body's energy: strain energy, kinetic energy
        of the removed masses, and potential of loads.
        """
        before = self._total_energy(state)
        remove()
        self.removed += before - self._total_energy(state)
        self.ledger.truncate(self.ledger.steps - 1)
        self._begin(state)

    def _total_energy(self, state: MotionState) -> float:
        potential = self.motion.add_up(state, self._sums)
        return float(self._sums[0]) / 2 + potential + self.motion.energy(state.u, state.t)

    def set_inside_out(self, number: float) -> None:
        """Write the number of inverted elements to the last row."""
        self.ledger.replace_last(INSIDE_OUT, number)


def _named(name: str, value: Any, example: str) -> Mapping[str, Where]:
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(one, str) and one for one in value):
        raise StvkError(f"{name} = {shown(value)}; expected locations by name, such as {{{example}}}.")
    hidden = [one for one in value if not one.isprintable()]
    if hidden:
        raise StvkError(
            f"{name}: name = {ascii(hidden[0])[:80]}; expected printable characters, because tables and pictures show the name. "
            "Rename it."
        )
    return value
