"""Forces of a contact on a body, by node and in total."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, text
from ..errors import ContactError, name_known
from ..system import System
from ..terms.load import Time
from ..terms.protocols import set_time
from ..units import UnitSystem


@dataclass(frozen=True, eq=False, repr=False)
class ContactState:
    """State of a contact: what `result.contact(name)` returns.

    Attributes
    ----------
    name
        Name of the contact.
    force
        (nv, d) force on each node of the body [N], with friction.
    pressure
        (nv,) normal force on each node over its area at rest [Pa]; 0 where nothing touches.
    gap
        (nv,) smallest gap of the points of each node's facets [m], negative where they touch; infinite at other nodes.
    area
        Area at rest of the points that touch [m^2].
    nodes
        Nodes (m,) on which the resultant acts: those of the facets that may touch a shape, or of the first of two surfaces.
    units
        System of units of the values.
    """

    name: str
    force: Array
    pressure: Array
    gap: Array
    area: float
    nodes: NDArray[np.int32]
    units: UnitSystem

    @property
    def resultant(self) -> Array:
        """Sum (d,) of the forces on the `nodes` [N]."""
        return np.asarray(self.force[self.nodes].sum(axis=0))

    def __repr__(self) -> str:
        of, total = self.units.of, ", ".join(f"{component:.4g}" for component in self.resultant)
        return (
            f"contact {self.name!r}: ({total}) {of('N')} on {self.area:.4g} {of('m^2')}, pressure up to "
            f"{self.pressure.max():.4g} {of('Pa')}, smallest gap {self.gap.min():.4g} {of('m')}"
        )


def contact_state(system: System, name: str, u: Array, t: Time) -> ContactState:
    """Return the state of the contact of this name at displacements `u` (ndofs,) and load factor or moment `t`.

    Raises
    ------
    ContactError
        if there is no such contact.
    """
    known = {term.name: term for term in system.contacts}
    if text("name", name) not in known:
        raise ContactError(f"name = {name!r}; expected a contact of the body; {name_known(name, known)}")
    set_time(system.bound_terms, t)
    term, x = known[name], u.reshape(-1, system.mesh.d)
    force = np.zeros(x.shape)
    term.energy_and_force(x, force)
    pressure, gap, area = term.evaluated(x)
    return ContactState(term.name, -force, pressure, gap, area, term.nodes, system.units)
