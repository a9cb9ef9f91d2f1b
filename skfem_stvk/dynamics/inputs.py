"""Inputs of a simulation: displacements of moved locations, and forces on pushed locations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, array, real_array, shown
from ..errors import LoadError, StvkError, name_known
from ..mesh.locations import vertices_at
from ..system import System
from ..system.coordinates import Coordinates


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

    Attributes
    ----------
    values
        (n,) values at the end of the step: those of moved locations, then those of pushed ones. The array is never changed.
    moved
        Indices of the moved entries among the constrained degrees of freedom, or among the prescribed coordinates.
    pushes
        Whether any location is pushed.
    """

    def __init__(self, body: System | Coordinates, pushed: Sequence[str]) -> None:
        basis = body if isinstance(body, Coordinates) else None
        system = body if isinstance(body, System) else body.system
        d, at = system.mesh.d, 0
        self.known: dict[str, Input] = {}
        indices = [np.empty(0, dtype=np.int64)]
        for name, location in system.supports.moved.items():
            n, k = location.indices.shape if basis is None else (1, location.indices.shape[1])
            words = f"displacements along {', '.join(location.components)} [m]"
            self.known[name] = Input(slice(at, at + n * k), n, k, words)
            indices.append(location.indices.ravel())
            at += n * k
        self._count, self.moved = at, np.concatenate(indices)
        if basis is not None:  # the lifts of inputs are the last ones
            self.moved = np.arange(len(basis.free.fixed) - at, len(basis.free.fixed))
        self._dofs: list[NDArray[np.int64]] = []
        for name in _checked_names(pushed):
            dofs = d * vertices_at(system.mesh, name, f"pushed = {name!r}")[:, None] + np.arange(d)
            if np.isin(dofs, system.supports.held).all():
                raise LoadError(f"pushed = {name!r}; expected a location with free nodes: supports constrain all of its nodes.")
            if name in self.known:
                raise LoadError(f"pushed = {name!r}; expected another location: its displacements are inputs already.")
            self.known[name] = Input(slice(at, at + d), 1, d, "components of the total force [N]")
            self._dofs.append(dofs)
            at += d
        if taken := {"until", "self"} & self.known.keys():
            raise StvkError(f"An input is named {shown(min(taken))}, as an argument of step(); expected another name: rename it.")
        self.pushes = bool(self._dofs)
        self._columns = None
        if basis is not None and self.pushes:
            self._columns = np.concatenate([basis.columns[dofs].mean(axis=0).T for dofs in self._dofs], axis=1)
        self.values = np.zeros(at)
        self.values.flags.writeable = False
        self._before, self._begin, self._end = self.values, 0.0, 0.0

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
                    "System(..., prescribed={'grip': 'xyz'}) and Simulation(..., pushed=['tip'])."
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

    def displacements(self, t: float) -> Array:
        """Return the displacements of the `moved` entries at time `t` [m]."""
        return self._at(t)[: self._count]

    def add_forces(self, t: float, out: Array) -> None:
        """Add the forces on pushed locations at time `t` to `out` [N]."""
        forces = self._at(t)[self._count :]
        if self._columns is not None:
            out += self._columns @ forces
            return
        d = len(forces) // len(self._dofs)
        for i, dofs in enumerate(self._dofs):
            out[dofs] += forces[d * i : d * (i + 1)] / len(dofs)

    def _at(self, t: float) -> Array:
        before, values = self._before, self.values
        if before is values or t >= self._end:
            return values
        part = max(0.0, (t - self._begin) / (self._end - self._begin))
        between: Array = before + part * (values - before)
        return between


def _checked_names(pushed: Any) -> list[str]:
    names = list(pushed) if isinstance(pushed, list | tuple) else [pushed]
    if not all(isinstance(name, str) for name in names) or len(set(names)) < len(names) or isinstance(pushed, str):
        raise StvkError(
            f"pushed = {shown(pushed)}; expected a list of different names, such as ['tip']. Name a location: "
            "mesh.with_boundaries({'tip': lambda x: x[0] == 1})."
        )
    return names
