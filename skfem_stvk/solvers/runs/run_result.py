"""Result of a run along a path or in time: its last state with all fields, forces on the body, files and pictures."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from ...arguments import Array
from ...mesh.locations import Where
from ...results import Fields, Reaction, State, plot, write_vtu
from ...results.contact_forces import ContactState, contact_state, contact_states
from ...results.plotting import thumbnail
from ...results.reactions import ReactionPlace
from ...results.vtu import DEFAULT
from ...system import System
from ...terminal import html_table
from ...terms.loads.load import Time
from ..newton.outcome import Status


class RunResult:
    """Last state of a run, its status and its duration: what `StaticResult` and `Run` have in common."""

    system: System
    u: Array
    status: Status
    message: str
    seconds: dict[str, float]

    @property
    @abstractmethod
    def _end(self) -> tuple[Time, Array | None, Array | None]:
        """Load factor or moment of the last state; and of a motion, velocities and forces (n, ndofs) of contacts on the body."""

    @abstractmethod
    def _ground_forces(self) -> Array:
        """Return the forces (ndofs,) of supports and foundations on the body [N]."""

    @property
    def success(self) -> bool:
        """Whether the run reached its end without inverted elements, in a state that is stable as far as known."""
        return self.status.success

    @cached_property
    def contacts(self) -> tuple[ContactState, ...]:
        """States of all contacts, as `contact` returns them."""
        moment, _, forces = self._end
        return contact_states(self.system, self.u, moment, forces)

    @cached_property
    def state(self) -> State:
        """All fields of the last state, see `skfem_stvk.results.names()`.

        `state["green_strain"]` has values by element, `state.at_nodes("volume_ratio")` by node.
        """
        return Fields.of(self.system).at(self.u, self._end[1], self.contacts)

    def reaction(self, where: Where | None = None) -> Reaction:
        """Return the force of supports and foundations on the body at a location.

        The result has `.resultant` [N], `.moment(about)` [N m] and `.by_node`.

        In statics the sum of all reactions and loads is zero. In a motion, the force of supports is `M a + D v + F(u) - h(u, t)`.
        It carries the loads, and the inertia and damping of constrained degrees of freedom that move. The force of foundations is
        `-K_f (u + beta v)`, with the factor beta of `Rayleigh` damping. Together with the loads, these forces are the rate of the
        body's linear momentum. For a `System` with `EnergyMomentum`, or whose supports move, they are those in the equation of the
        last step, with the inertia `M (v1 - v)/T`.

        Parameters
        ----------
        where
            Boundary, node set, vertex ids or a predicate; None for the whole body. The location of a support, as passed to `fixed`
            or `prescribed`, has the components that this support constrains. If k supports constrain a component at a node, each
            has 1/k of the force. Any other location has all constrained components at its nodes.

        Raises
        ------
        RegionError
            if there is no such location.
        SupportError
            if no support or foundation acts there.
        """
        return ReactionPlace.of(self.system, where).reaction(self.system, self.u, self._ground_forces())

    def contact(self, name: str) -> ContactState:
        """Return the forces of a contact on the body: `.resultant` [N], `.pressure` [Pa], `.gap` [m] and `.force` by node.

        In a motion, forces are those that acted in the last step: the mean over it with `EnergyMomentum`, `F + K w` in equation 9.

        Parameters
        ----------
        name
            Name of the contact, as in `RigidContact(..., name="floor")`.

        Raises
        ------
        ContactError
            if there is no such contact.
        """
        moment, _, forces = self._end
        return contact_state(self.system, name, self.u, moment, forces)

    def plot(self, field: str | ArrayLike = "von_mises_stress", **options: Any) -> Any:
        """Draw the deformed body in the last state, coloured by a field.

        Parameters
        ----------
        field
            Name of a field, or values (nv,) at nodes or (nt,) of elements.
        **options
            Options of `results.plot`.
        """
        return plot(self.state, field, **options)

    def save(self, path: str | os.PathLike[str], fields: Sequence[str] = DEFAULT) -> Path:
        """Write displacements and fields of the last state to a .vtu file, for a body that is divided into parts to a .pvtu file.

        Parameters
        ----------
        path
            Path of the file, ending in .vtu or .pvtu.
        fields
            Names of the fields in it, see `skfem_stvk.results.names()`; by default stresses and strains.

        Raises
        ------
        StvkError
            as `results.write_vtu`.
        """
        return write_vtu(path, self.state, fields)

    @abstractmethod
    def _rows(self) -> list[tuple[str, Any]]:
        """Return the rows of a table of the result, below its status and its message."""

    def _repr_html_(self) -> str:
        seconds = [(f"seconds, {name}", f"{seconds:.2g}") for name, seconds in self.seconds.items()]
        rows = [("status", self.status), ("message", self.message), *self._rows(), *seconds]
        return html_table(type(self).__name__, rows, thumbnail(self.system, lambda: self.state))

    def _summary(self, text: str) -> str:
        """Return the message, and below it a text with the duration by part."""
        parts = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in self.seconds.items())
        return f"{type(self).__name__}: {self.message}\n{text}; {parts}"
