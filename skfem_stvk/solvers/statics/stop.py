"""End of an arc-length path: a `Stop`, and its levels on a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

from ...arguments import Array, number, own, shown, whole
from ...errors import StvkError, name_ids
from ...mesh.locations import Where, describe, vertices_at
from ...space import Space
from ...system import System
from .equilibrium import Hyperplane
from .history import Step

#: Largest number of states on a path, if `Stop(states=...)` is not given.
MOST_STATES = 1000
#: `ON_LEVEL` is the tolerance, as a fraction of the step, within which a state lies on a level. A path that begins on a level does
#: not cross it there, and a path that ends on a level does. The step counts as at most `FAR` times the level, because the first
#: step of a body that is nearly a mechanism goes far beyond.
ON_LEVEL, FAR = 1e-9, 1e3


@dataclass(frozen=True, repr=False)
class Stop:
    """End of a path of equilibria: the first of these conditions that is reached.

    Parameters
    ----------
    load
        Load factor, reached exactly. If it is below the load factor at the start, the path begins with a falling load.
    displacement
        Location, component and value such as `("apex", "z", -0.2)` [m]. The mean of this displacement over the vertices there
        reaches the value exactly. Without a load, the path begins in its direction.
    turns
        Number of limit points that have been passed.
    states
        Number of states that have been found. If nothing else is reached after 1000 states, the path counts as stopped before its
        end.

    Examples
    --------
    >>> Stop(displacement=("apex", "z", -0.2), turns=2)
    Stop(displacement=('apex', 'z', -0.2), turns=2)
    """

    load: float | None = None
    displacement: tuple[Where, str, float] | None = None
    turns: int | None = None
    states: int | None = None

    def __repr__(self) -> str:
        conditions = {field.name: getattr(self, field.name) for field in fields(self)}
        return f"Stop({', '.join(f'{name}={value!r}' for name, value in conditions.items() if value is not None)})"

    def __post_init__(self) -> None:
        own(self)
        if self.load is None and self.displacement is None and self.turns is None and self.states is None:
            raise StvkError("Got Stop(); expected a load, a displacement, a number of turns or of states: Stop(load=1.0).")
        for name in ("turns", "states"):
            if getattr(self, name) is not None:
                count = whole(f"Stop: {name}", getattr(self, name), "a whole number of at least 1", 1)
                object.__setattr__(self, name, count)
        if self.load is not None:
            object.__setattr__(self, "load", number("Stop: load", self.load, "a finite load factor such as 1.0"))


class StopCriterion:
    """`Stop` on a mesh: levels of load or displacement, and numbers of limit points and states.

    `states` is the space of the states of a problem, by default the space of all displacements.
    """

    def __init__(self, stop: Stop, system: System, states: Space | None = None) -> None:
        self._stop, mesh, self._states = stop, system.mesh, states or system.space
        self._levels: list[tuple[Array, float, float]] = []
        if stop.load is not None:
            self._levels.append((self._states.restrict(np.zeros(mesh.p.size)), 1.0, float(stop.load)))
        if stop.displacement is not None:
            normal, weight, value = _mean_displacement(stop.displacement, system)
            self._levels.append((self._states.restrict(normal), weight, value))

    def sign_towards(self, u: Array, t: float, direction: Array, rate: float) -> float:
        """Return 1 if a direction leads towards the first level, or if there is none; -1 if it leads away."""
        if not self._levels:
            return 1.0
        normal, weight, value = self._levels[0]
        dot = self._states.dot
        missing = value - dot(normal, u) - weight * t
        return -1.0 if missing * (dot(normal, direction) + weight * rate) < 0 else 1.0

    @property
    def has_levels(self) -> bool:
        """Whether the stop has a level of load or displacement."""
        return bool(self._levels)

    def first_crossing(self, u: Array, t: float, v: Array, s: float) -> tuple[float, Hyperplane] | None:
        """Return the location and the plane of the first level that the step from `(u, t)` to `(v, s)` crosses; None without one.

        The location is a fraction of the step.
        """
        found, dot = [], self._states.dot
        for normal, weight, value in self._levels:
            begin, end = dot(normal, u) + weight * t, dot(normal, v) + weight * s
            size = FAR * abs(value) if value else np.inf
            near = ON_LEVEL * min(abs(end - begin), size)
            crossed = (begin - value) * (end - value) <= 0 or abs(end - value) <= near
            if crossed and abs(begin - value) > near:
                found.append(((value - begin) / (end - begin), Hyperplane(normal, weight, value, end - begin)))
        return min(found, key=lambda one: one[0], default=None)

    def refuse_passed(self, u0: Array, t0: float, steps: Sequence[Step]) -> None:
        """Raise StvkError if the path from `(u0, t0)` through `steps` has crossed a level already.

        The message names the two states around the crossing.
        """
        states = [(u0, t0), *((step.u, step.t) for step in steps)]
        for i, (one, other) in enumerate(pairwise(states)):
            if self.first_crossing(*one, *other) is not None:
                before = f"state {i - 1}" if i else "the start"
                raise StvkError(
                    f"stop = {self._stop}; expected an end that the stored states have not passed. They pass it between {before} "
                    f"(t = {one[1]:.4g}) and state {i} (t = {other[1]:.4g}). Give a stop that lies ahead, or begin a new path "
                    f"from {before}: u0 is its u, and t0={one[1]:.6g}."
                )

    def saved(self) -> list[list[float]]:
        """Return numbers that identify the goal."""
        levels = [
            [weight, value, self._states.dot(normal, np.arange(1.0, len(normal) + 1))] for normal, weight, value in self._levels
        ]
        return [*levels, [float(self._stop.turns or 0), float(self._stop.states or 0)]]

    def is_count_reached(self, turns: int, states: int) -> bool:
        """Return whether the requested number of limit points or of states is reached."""
        both = (turns, self._stop.turns), (states, self._stop.states)
        return any(requested is not None and found >= requested for found, requested in both)

    def is_limit_reached(self, states: int) -> bool:
        """Return whether the default limit on the number of states is reached."""
        return self._stop.states is None and states >= MOST_STATES


def _mean_displacement(displacement: Any, system: System) -> tuple[Array, float, float]:
    """Return the mean displacement over the vertices of a location as a level: its normal (ndofs,), load weight and value."""
    mesh = system.mesh
    if not isinstance(displacement, tuple | list) or len(displacement) != 3:
        raise StvkError(
            f"Stop: displacement = {shown(displacement)}; expected a location, a component and a value: ('apex', 'z', -0.2)."
        )
    where, component, value = displacement
    what = f"Stop: displacement at {describe(where)}"
    letters = "xyz"[: mesh.d]
    if not isinstance(component, str) or len(component) != 1 or component not in letters:
        raise StvkError(f"{what}: component = {shown(component)}; expected one of {', '.join(map(repr, letters))}.")
    value = number(f"{what}: value", value, "a finite displacement [m]")
    vertices = vertices_at(mesh, where, what)
    dofs = mesh.d * vertices + letters.index(component)
    if np.isin(dofs, system.supports.fixed).all():
        raise StvkError(
            f"{what}: component = {component!r} is fixed at {name_ids(vertices, 'vertex')}; expected a component that can move. "
            "Choose another component or location."
        )
    normal = np.zeros(mesh.p.size)
    normal[dofs] = 1 / len(vertices)
    return normal, 0.0, value
