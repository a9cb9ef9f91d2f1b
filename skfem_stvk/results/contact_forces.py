"""Forces of a contact on a body, by node and in total."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, text
from ..errors import ContactError, name_known
from ..mesh.displacements import by_vertex
from ..system import System
from ..terms.loads.contact import BoundContact
from ..terms.loads.load import Time
from ..terms.loads.rigid_shapes import RigidShape
from ..units import UnitSystem
from .reactions import moment_of


@dataclass(frozen=True, eq=False, repr=False)
class ContactState:
    """State of a contact: what `result.contact(name)` returns.

    Attributes
    ----------
    name
        Name of the contact.
    force
        (nv, d) force on each node of the body [N], with friction; in motions that of the last step.
    pressure
        (nv,) normal force on each node over its area at rest [Pa]; 0 where nothing touches.
    gap
        (nv,) smallest gap of the points of each node's facets [m], negative where they touch; infinite at other nodes.
    area
        Area at rest of the points that touch [m^2].
    nodes
        Nodes (m,) on which the resultant acts: those of the facets that may touch a shape, or of the first of two surfaces.
    positions
        (nv, d) positions of the nodes of the body [m].
    shape
        The rigid shape, displaced as in this state; None between bodies.
    units
        System of units of the values.
    """

    name: str
    force: Array
    pressure: Array
    gap: Array
    area: float
    nodes: NDArray[np.int32]
    positions: Array
    shape: RigidShape | None
    units: UnitSystem

    @property
    def resultant(self) -> Array:
        """Sum (d,) of the forces on the `nodes` [N]."""
        return np.asarray(self.force[self.nodes].sum(axis=0))

    @property
    def moment(self) -> Array | float:
        """Moment of the forces on the `nodes` about the origin [N m]: (3,) in space, a number in the plane, 0 on a line."""
        return moment_of(self.positions[self.nodes], self.force[self.nodes])

    def __repr__(self) -> str:
        of, total = self.units.of, ", ".join(f"{component:.4g}" for component in self.resultant)
        return (
            f"contact {self.name!r}: ({total}) {of('N')} on {self.area:.4g} {of('m^2')}, pressure up to "
            f"{self.pressure.max():.4g} {of('Pa')}, smallest gap {self.gap.min():.4g} {of('m')}"
        )


def contact_state(system: System, name: str, u: Array, t: Time, forces: Array | None = None) -> ContactState:
    """Return the state of the contact of this name at displacements `u` (ndofs,) and load factor or moment `t`.

    `forces` (n, ndofs) are those of all contacts on the body [N], by default those at `u` without friction, which follows from the
    states before.

    Raises
    ------
    ContactError
        if there is no such contact.
    """
    known = {term.name: term for term in system.contacts_at(t)}
    if text("name", name) not in known:
        raise ContactError(f"name = {name!r}; expected a contact of the body; {name_known(name, known)}")
    return _state_of(known[name], system, u, None if forces is None else forces[list(known).index(name)])


def contact_states(system: System, u: Array, t: Time, forces: Array | None = None) -> tuple[ContactState, ...]:
    """Return the states of all contacts, as `contact_state` does."""
    contacts = system.contacts_at(t)
    each = [None] * len(contacts) if forces is None else forces
    return tuple(_state_of(term, system, u, force) for term, force in zip(contacts, each, strict=False))


def shapes_at(system: System, t: Time) -> list[RigidShape]:
    """Return the rigid shapes of all contacts at load factor or moment `t`."""
    return [contact.shape for contact in system.contacts_at(t) if contact.shape is not None]


def _state_of(term: BoundContact, system: System, u: Array, force: Array | None) -> ContactState:
    x, rest = by_vertex(system.mesh, u), system.mesh.p.T
    if force is None:
        internal = np.zeros(x.shape)
        term.energy_and_force(x, internal)
        force = -internal
    pressure, gap, area = term.evaluated(x)
    return ContactState(
        term.name, force.reshape(x.shape).copy(), pressure, gap, area, term.nodes, rest + x, term.shape, system.units
    )


def combined(contacts: Sequence[ContactState]) -> dict[str, Array]:
    """Return force (nv, d) [N], pressure (nv,) [Pa] and gap (nv,) [m] of contacts at nodes, as files and pictures have them.

    Forces are added, the pressure is the largest and the gap the smallest. The gap is masked where no surface may touch.
    """
    if not contacts:
        return {}
    gap = np.min([contact.gap for contact in contacts], axis=0)
    return {
        "contact_force": np.sum([contact.force for contact in contacts], axis=0),
        "contact_pressure": np.max([contact.pressure for contact in contacts], axis=0),
        "gap": np.ma.masked_array(np.where(np.isfinite(gap), gap, 0.0), ~np.isfinite(gap)),
    }
