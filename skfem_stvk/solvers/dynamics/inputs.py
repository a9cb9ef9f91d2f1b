"""Inputs of a simulation: displacements of moved locations and shapes, and forces on pushed locations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array, array, real_array, shown
from ...errors import ContactError, LoadError, StvkError, name_known
from ...mesh.locations import vertices_at
from ...system import System
from ...system.coordinates import Coordinates
from ...terms.loads.load import Moment, Time
from ...terms.loads.rigid_contact import rigid


@dataclass(frozen=True)
class Input:
    """Part of the vector of all inputs that belongs to one of them: `nodes` times `components` numbers, and their meaning."""

    part: slice
    nodes: int
    components: int
    words: str

    def write(self, name: str, value: Any, to: Array) -> None:
        """Write a user-supplied value to its part of the vector `to`; refuse another shape, and numbers that are not finite."""
        n, k = self.nodes, self.components
        values = value if type(value) is np.ndarray and value.dtype == np.float64 else real_array(value)
        if values is None or values.shape not in ((k,), (n, k)) or not isfinite(values.sum()):
            expected = f"({k},) {self.words}" + f", or ({n}, {k}), one row for each node, ascending" * (n > 1)
            array(name, value, (k,) if values is None or values.ndim != 2 else (n, k), expected)
        to[self.part].reshape(n, k)[:] = values


class Inputs:
    """Inputs of one simulation, zero at first. During a step, they go straight from their last values to the new ones.

    Parameters
    ----------
    body
        Body with moved locations (`Supports.moved`), or such a body on a basis.
    pushed
        Names of the locations on which total forces act, in equal parts on the nodes.
    shapes
        Names of the contacts whose shapes are displaced.

    Attributes
    ----------
    values
        (n,) values at the end of the step: those of moved locations, of pushed ones, and of shapes. The array is never changed.
    moved
        Indices of the moved entries among the constrained degrees of freedom, or among the prescribed coordinates.
    pushed, shapes
        The names.
    pushes
        Whether any location is pushed.
    """

    def __init__(self, body: System | Coordinates, pushed: Sequence[str], shapes: Sequence[str]) -> None:
        basis = body if isinstance(body, Coordinates) else None
        system = body if isinstance(body, System) else body.system
        d, self._size = system.mesh.d, 0
        self.known: dict[str, Input] = {}
        indices = [np.empty(0, dtype=np.int64)]
        for name, location in system.supports.moved.items():
            n, k = location.indices.shape if basis is None else (1, location.indices.shape[1])
            self._add(name, n, k, f"displacements along {', '.join(location.components)} [{system.units.of('m')}]")
            indices.append(location.indices.ravel())
        self._count, self.moved = self._size, np.concatenate(indices)
        if basis is not None:  # the lifts of inputs are the last ones
            self.moved = np.arange(len(basis.free.fixed) - self._count, len(basis.free.fixed))
        self._dofs: list[NDArray[np.int64]] = []
        self.pushed = _checked_names(
            "pushed", pushed, "['tip']. Name a location: mesh.with_boundaries({'tip': lambda x: x[0] == 1})."
        )
        for name in self.pushed:
            dofs = d * vertices_at(system.mesh, name, f"pushed = {name!r}")[:, None] + np.arange(d)
            if np.isin(dofs, system.supports.held).all():
                raise LoadError(f"pushed = {name!r}; expected a location with free nodes: supports constrain all of its nodes.")
            if name in self.known:
                raise LoadError(f"pushed = {name!r}; expected another location: its displacements are inputs already.")
            self._add(name, 1, d, f"components of the total force [{system.units.of('N')}]")
            self._dofs.append(dofs)
        self._forces, self.pushes = slice(self._count, self._size), bool(self.pushed)
        self.shapes = _checked_names("moved", shapes, "['ball']. Name a contact: RigidContact(..., name='ball').")
        contacts = {term.name: term.contact for term in rigid(system.contacts)}
        for name in self.shapes:
            if name not in contacts:
                raise ContactError(f"moved = {name!r}; expected a RigidContact of the body; {name_known(name, contacts)}")
            if contacts[name].motion is not None:
                raise ContactError(f"moved = {name!r}: {contacts[name].label} has a motion; expected motion=None, or another name.")
            if name in self.known:
                raise StvkError(f"moved = {name!r}: a location is an input of this name; expected another name of the contact.")
            self._add(name, 1, d, f"components of the displacement of the shape [{system.units.of('m')}]")
        if taken := {"until", "self"} & self.known.keys():
            raise StvkError(f"An input is named {shown(min(taken))}, as an argument of step(); expected another name: rename it.")
        self._columns = None
        if basis is not None and self._dofs:
            self._columns = np.concatenate([basis.columns[dofs].mean(axis=0).T for dofs in self._dofs], axis=1)
        self.values = np.zeros(self._size)
        self.values.flags.writeable = False
        self._before, self._begin, self._end = self.values, 0.0, 0.0

    def _add(self, name: str, nodes: int, components: int, words: str) -> None:
        """Add an input after the others."""
        end = self._size + nodes * components
        self.known[name], self._size = Input(slice(self._size, end), nodes, components, words), end

    def changed(self, given: Mapping[str, Any]) -> Array:
        """Return the values (n,) with those that the user supplies by name.

        Raises
        ------
        StvkError
            if there is no such input, or a value has another shape or is not finite.
        """
        if not given:
            return self.values
        values = self.values.copy()
        for name, value in given.items():
            if name not in self.known:
                raise StvkError(
                    f"{name} = {shown(value)}; expected an input of the simulation; {name_known(name, self.known)} Inputs are "
                    "System(..., prescribed={'grip': 'xyz'}) and Simulation(..., pushed=['tip'], moved=['ball'])."
                )
            self.known[name].write(name, value, values)
        values.flags.writeable = False
        return values

    def begin(self, values: Array, t0: float, t1: float) -> None:
        """Begin to go from the present values at `t0` to these at `t1` [s]."""
        self._before, self.values, self._begin, self._end = self.values, values, t0, t1

    def stay(self, values: Array) -> None:
        """Stay at these values from now on."""
        self._before = self.values = values

    def moving(self, body: System | Coordinates) -> System | Coordinates:
        """Return the body for a motion in which these inputs displace the shapes."""
        if not self.shapes:
            return body
        assert isinstance(body, System)  # bodies on a basis have no contacts
        contacts = [one for one in rigid(body.contacts) if one.name in self.shapes]
        moved: dict[Any, Any] = {one: one.moved_by(MovedShape(self, self.known[one.name].part)) for one in contacts}
        return body.with_terms([moved.get(term, term) for term in body.bound_terms])

    def displacements(self, t: float) -> Array:
        """Return the displacements of the `moved` entries at time `t` [m]."""
        return self.at(t)[: self._count]

    def add_forces(self, t: float, out: Array) -> None:
        """Add the forces on pushed locations at time `t` to `out` [N]."""
        forces = self.at(t)[self._forces]
        if self._columns is not None:
            out += self._columns @ forces
            return
        d = len(forces) // len(self._dofs)
        for i, dofs in enumerate(self._dofs):
            out[dofs] += forces[d * i : d * (i + 1)] / len(dofs)

    def at(self, t: float) -> Array:
        """Return the values (n,) at time `t`."""
        before, values = self._before, self.values
        if before is values or t >= self._end:
            return values
        part = max(0.0, (t - self._begin) / (self._end - self._begin))
        between: Array = before + part * (values - before)
        return between


@dataclass(frozen=True)
class MovedShape:
    """Displacement of a shape that is an input: the `part` of the values."""

    inputs: Inputs
    part: slice

    def at(self, t: Time) -> Array:
        """Return the components (d, 1) at `t` [m]."""
        return self.inputs.at(Moment.of(t).time)[self.part, None]


def _checked_names(argument: str, given: Any, example: str) -> list[str]:
    names = list(given) if isinstance(given, list | tuple) else [given]
    if not all(isinstance(name, str) for name in names) or len(set(names)) < len(names) or isinstance(given, str):
        raise StvkError(f"{argument} = {shown(given)}; expected a list of different names, such as {example}")
    return names
