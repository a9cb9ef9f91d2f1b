"""Numbers that match files to their problem: its mesh, terms, supports and method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import StvkError
from ..mesh import ElementMesh
from ..space import ONE_PROCESS, Communicator, Space
from ..terms.loads.load import Moment, Time
from .rigid import mean_of_nodes
from .system import System, for_analysis

#: Relative tolerance within which the numbers of equal systems agree.
SAME = 1e-9
#: Name of the solver of a divided body if the user names none: other divisions have other solvers, with the same results.
AUTO = "auto"
#: Shear and compression at which elastic terms are evaluated.
SHEAR, COMPRESSED = 0.01, 0.6
#: Largest number of moments at which loads are evaluated, and of numbers of one kind.
MOST = 9
Kind: TypeAlias = Literal["path of equilibria", "motion"]
#: Kinds of problems, and the argument for their loads at a moment.
KINDS: dict[str, Callable[[float], Time]] = {"path of equilibria": float, "motion": lambda t: Moment(t, 1.0)}


@dataclass(frozen=True)
class Signature:
    """Signature of a problem, stored in each file of a run.

    `method` has all options that affect the states. `numbers` describe the system and its first state, by name. They include loads
    and prescribed displacements at the `moments`: load factors or times [s].
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "extra": "forbid", "allow_inf_nan": False}

    kind: Kind
    method: dict[str, Any]
    moments: list[float]
    numbers: dict[str, list[float]]

    def __post_init__(self) -> None:
        if any(len(some) > MOST for some in (self.moments, *self.numbers.values())):
            raise ValueError(f"expected at most {MOST} moments, and {MOST} numbers of each name")


class Fingerprint:
    """Fingerprint of a problem, and the check that a file belongs to this problem.

    `start` has other data that affect the states, such as `u0`: a few numbers by name, see `sums`. The other arguments are as in
    `Signature`.
    """

    def __init__(
        self,
        kind: Kind,
        system: System,
        method: Mapping[str, Any],
        moments: Sequence[float],
        start: Mapping[str, Sequence[float]],
    ) -> None:
        self.system, self._method, self._kind = system, dict(method), kind
        self._start = {name: [float(value) for value in values] for name, values in start.items()}
        self._moments = [float(t) for t in moments]
        self._known: dict[tuple[float, ...], dict[str, list[float]]] = {}

    @cached_property
    def signature(self) -> Signature:
        """Signature in the files of the problem."""
        return Signature(kind=self._kind, method=self._method, moments=self._moments, numbers=self._numbers(self._moments))

    def differences(self, then: Signature) -> str:
        """Return a description of the differences from the problem of a file; empty if it is the same problem."""
        if then.kind != self._kind:
            return f"it contains a {then.kind}, not a {self._kind}"
        changed = {name for name in {*then.method, *self._method} if then.method.get(name) != self._method.get(name)}
        if AUTO in (then.method.get("solver"), self._method.get("solver")):
            changed.discard("solver")
        was = [f"{name} was {_words(then.method.get(name))} and is {_words(self._method.get(name))}" for name in sorted(changed)]
        try:
            now = self._numbers(then.moments)
        except Exception as error:  # other loads, which may be undefined at these moments
            return "; ".join([*was, f"the present loads cannot be evaluated at the times of the file ({error})"])
        other = [name for name in now if not _alike(then.numbers.get(name, []), now[name])]
        return "; ".join([*was, *([f"{', '.join(other)} changed"] if other else [])])

    def refuse_other(self, then: Signature, file: Path, remedy: str) -> None:
        """Raise StvkError if a file is of another problem."""
        differences = self.differences(then)
        if differences:
            raise StvkError(f"{file} is of another problem: {differences}. {remedy}")

    def _numbers(self, moments: Sequence[float]) -> dict[str, list[float]]:
        """Return the numbers for these moments, cached because a path has a file for each state."""
        if tuple(moments) not in self._known:
            self._known[tuple(moments)] = self._compute_numbers(moments)
        return self._known[tuple(moments)]

    def _compute_numbers(self, moments: Sequence[float]) -> dict[str, list[float]]:
        """Return numbers that depend on mesh, terms and supports, and on loads and prescribed displacements at these moments."""
        system, mesh, space = (
            for_analysis(self.system, self._kind == "motion"),
            self.system.mesh,
            self.system.space,
        )  # without the present history
        x = mesh.p.T - mean_of_nodes(mesh.p.T, space)
        u = (x @ (SHEAR * np.cos(np.arange(mesh.d**2).reshape(mesh.d, mesh.d)))).ravel()
        pressed = -COMPRESSED * x.ravel() + u
        own = space.counted(np.ones(space.n))[system.supports.held] > 0  # supports that count in this part of a divided body
        held = space.comm.gather(space.numbers[system.supports.held][own], np.empty(np.count_nonzero(own)))[0]
        numbers: dict[str, Any] = {
            "the mesh": mesh_numbers(mesh),
            "the elastic terms": [
                _energy(system, u),
                *(value for x in (u, pressed) for value in sums_of(system.internal_force(x), space)),
            ],
            "the supports": [len(held), *sums(held)],
        }
        if system.body.beside:
            every = [[body.mesh.element_count, *_sums_of_elements(body.mesh, mesh)] for body in system.body.beside]
            numbers["the elements beside the mesh"] = [value for values in every for value in values]
        if not mesh.element.is_linear_simplex:  # quadrature rules of other elements differ only if strain varies inside an element
            bent = u + SHEAR * np.sin(x.ravel() / space.comm.most(float(np.abs(x).max())))
            numbers["the elastic terms"] += [_energy(system, bent), *sums_of(system.internal_force(bent), space)]
            numbers["the elements"] = [mesh.element.k, mesh.element.degree, not mesh.element.is_simplex]
        unit = " s" if self._kind == "motion" else ""
        for t in moments:
            moment = KINDS[self._kind](t)
            numbers[f"the loads at t = {t:g}{unit}"] = sums_of(system.external_force(u, moment), space)
            if system.contacts:
                numbers[f"the contacts at t = {t:g}{unit}"] = sums(
                    np.array([x for contact in system.contacts_at(moment) for x in contact.identity()])
                )
            prescribed = space.comm.gather(space.numbers[system.supports.held][own], system.supports.values(moment)[own])[1]
            numbers[f"prescribed displacements at t = {t:g}{unit}"] = sums(prescribed)
        if self._kind == "motion":
            numbers["the masses"] = sums(system.mass().counted, mesh.node_numbers, space.comm)
        return {name: [float(value) for value in np.nan_to_num(values)] for name, values in numbers.items()} | self._start


def _energy(system: System, u: Array) -> float:
    """Return the strain energy of the terms that have one [J]."""
    return float(np.nansum(system.elastic_energies(u)))


def sums(values: Array, numbers: NDArray[np.int64] | None = None, comm: Communicator = ONE_PROCESS) -> list[float]:
    """Return two finite numbers that change with each value, its sign and its index.

    Neither is near zero by cancellation. In a divided body, the values of all parts count, with their indices `numbers` in an array
    of the whole body.
    """
    weights = 1.5 + np.cos(np.arange(values.size) if numbers is None else numbers.ravel())
    with np.errstate(over="ignore", invalid="ignore"):
        size, balance = weights @ np.abs(values.ravel()), weights @ values.ravel()
        size, balance = comm.total(np.array([size, balance]))
        found: list[float] = np.nan_to_num([size, 2 + balance / size if size else 0.0]).tolist()
    return found


def sums_of(x: Array, space: Space) -> list[float]:
    """Return `sums` of a vector of a space, the same for each division of a body."""
    return sums(space.counted(x.ravel()), space.numbers, space.comm)


def mesh_numbers(mesh: ElementMesh) -> list[float]:
    """Return numbers that identify a mesh, the same for each division of it: of nodes, of elements, and `sums` of both."""
    own, count = mesh.space.counted(np.ones(mesh.nv)), mesh.space.count // mesh.d
    of_nodes = sums(own * mesh.p, count * np.arange(mesh.d)[:, None] + mesh.node_numbers, mesh.space.comm)
    return [count, mesh.element_count, *of_nodes, *_sums_of_elements(mesh, mesh)]


def _sums_of_elements(elements: ElementMesh, mesh: ElementMesh) -> list[float]:
    """Return `sums` of the nodes of elements, on the nodes of a mesh."""
    numbers = elements.element_count * np.arange(len(elements.t))[:, None] + elements.element_numbers
    return sums(mesh.node_numbers[elements.t], numbers, mesh.space.comm)


def _words(value: Any) -> str:
    if isinstance(value, dict) and "name" in value:  # an integrator
        options = {**value.get("options", {}), **value.get("objects", {})}
        return f"{value['name']}({', '.join(f'{name}={option!r}' for name, option in options.items())})"
    return repr(value)


def _alike(old: list[float], new: list[float]) -> bool:
    return len(old) == len(new) and np.allclose(old, new, rtol=SAME, atol=0.0)
