"""Supports of a body: fixed degrees of freedom, and prescribed displacements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..arguments import shown, whole_array
from ..errors import SupportError
from ..mesh import ElementMesh
from ..mesh.locations import DofsView, Where, describe, dofs_of, vertices_at
from ..terms.loads.load import Moment, Time, Value

Dofs = NDArray[np.int64]

#: Supports by location: `{"wall": "xyz"}`; or pairs of a location and its support, for locations that cannot be keys, such as
#: arrays.
Displacements: TypeAlias = Mapping[Any, Any] | Iterable[tuple[Where, Any]]


class MovedLocation(NamedTuple):
    """Location whose displacements are inputs of a `Simulation`: components, and the indices (n, k) of its n nodes in `held`."""

    components: str
    indices: NDArray[np.int64]


class Supports:
    """Constrained degrees of freedom of a body: fixed ones, and those with prescribed displacements.

    Parameters
    ----------
    mesh
        Mesh of the body.
    fixed
        Components that do not move, by location: `{"wall": "xyz", "symmetry": "y"}`; bare integers as a location are nodes. Or the
        result of scikit-fem's `basis.get_dofs(...)`, one or several by name: exactly those degrees of freedom.
    prescribed
        Displacements [m], by location and component: `{"handle": {"x": 0.01}}`. A value is a number, a function of t or of (x, t),
        or (n,) values for the nodes there. The values are in the order of the ids as passed in, otherwise ascending. For all
        components of a location use one function of (x, t) that returns (d, n). Constants ramp with the load factor. Components
        without a value, `{"grip": "xyz"}` for a named location, are inputs of a `Simulation`. Other analyses hold them at 0.

    Attributes
    ----------
    fixed, prescribed, held
        Degrees of freedom `d * node + component`, ascending; `held` is the union of the other two.
    entries
        Pairs of a location and the degrees of freedom that a support constrains there; a location may have several.
    moved
        `MovedLocation` by name: locations whose displacements are inputs.
    steady
        Whether all displacements are constants, not functions.

    Raises
    ------
    RegionError
        if a location has no nodes.
    SupportError
        if the mesh does not have a component; if a value has the wrong shape or is not finite; if a degree of freedom is both fixed
        and prescribed, or prescribed twice with different values; or if none is free.

    Examples
    --------
    >>> mesh = ElementMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [1], [2]])
    >>> supports = Supports(mesh, {(0,): "xy"}, {(1,): {"y": 0.1}})
    >>> supports.fixed, supports.prescribed, supports.values(0.5)
    (array([0, 1]), array([3]), array([0.  , 0.  , 0.05]))
    """

    def __init__(
        self, mesh: ElementMesh, fixed: Displacements | DofsView | None = None, prescribed: Displacements | None = None
    ) -> None:
        self._mesh = mesh = ElementMesh.of(mesh)
        fixed_at = _fixed_entries(mesh, fixed)
        self.fixed = _union([dofs for _, dofs in fixed_at])
        entries = _pairs(prescribed, "prescribed", '{"handle": {"x": 0.01}}')
        inputs = {where: self._moved_dofs(where, argument) for where, argument in entries if isinstance(argument, str)}
        values = [(where, self._move(where, argument)) for where, argument in entries if not isinstance(argument, str)]
        motions = [motion for _, moves in values for motion in moves]
        moved_at = [(where, dofs) for where, moves in values for dofs, _ in moves]
        self.entries = [(where, dofs.ravel()) for where, dofs in (*fixed_at, *moved_at, *inputs.items())]
        self.prescribed = _union([*(dofs for dofs, _ in motions), *inputs.values()])
        self.held = np.union1d(self.fixed, self.prescribed)
        self._refuse_both()
        self._refuse_moved_twice(inputs, [dofs for dofs, _ in motions])
        letters = dict(entry for entry in entries if isinstance(entry[1], str))
        self.moved = {name: MovedLocation(letters[name], np.searchsorted(self.held, dofs)) for name, dofs in inputs.items()}
        if not mesh.space.comm.any(len(self.held) < mesh.p.size):
            raise SupportError(f"All {mesh.space.count} degrees of freedom are fixed or prescribed: there is nothing to solve for.")
        self._motions = [(np.searchsorted(self.held, dofs), value) for dofs, value in motions]
        self.steady = all(value.constant is not None for _, value in self._motions)
        indices = np.concatenate([np.empty(0, dtype=np.int64), *(index.ravel() for index, _ in self._motions)])
        self._twice = mesh.space.comm.any(len(indices) > len(np.unique(indices)))
        for t in (0.0, 1 / 3, 1.0):
            self.values(t)

    def values(self, t: Time) -> NDArray[np.float64]:
        """Return the displacements of `held` at load factor `t`, or at a `Moment` [m].

        Raises
        ------
        StateError
            if `t` is not a finite number.
        SupportError
            if a function does not return finite values, or two functions return different ones for the same degree of freedom.
        """
        values, moment = np.zeros(len(self.held)), Moment.checked(t)
        for index, value in self._motions:
            values[index] = value.at(moment)
        if self._twice:
            for index, value in self._motions:
                self._refuse_different(index, values[index], value.at(moment), moment)
        return values

    def _move(self, where: Where, argument: Any) -> list[tuple[Dofs, Value]]:
        """Return the degrees of freedom with displacements prescribed at a location, and the values by component and node."""
        what = f"prescribed on {describe(where)}"
        vertices, d = vertices_at(self._mesh, where, what), self._mesh.d
        x, divided = self._mesh.p[:, vertices], self._mesh.space.comm.divided
        if callable(argument):
            return [(_dofs(vertices, range(d), d).reshape(-1, d).T, Value(argument, (d,), x, what, SupportError, divided=divided))]
        if not isinstance(argument, Mapping) or not argument:
            raise SupportError(
                f"{what}: got {shown(argument)}; expected displacements by component, such as {{'x': 0.01}}, or a function of (x, "
                f"t) that returns all {d} components."
            )
        return [
            (_dofs(vertices, [component], d), Value(value, (), x, f"{what}, component {letter}", SupportError, divided=divided))
            for letter, value in argument.items()
            for component in _components(self._mesh, letter, what)
        ]

    def _moved_dofs(self, where: Where, letters: str) -> Dofs:
        """Return the degrees of freedom (n, k) of a named location whose displacements are inputs, node by node."""
        what = f"prescribed on {describe(where)}"
        components = _components(self._mesh, letters, what)
        if not isinstance(where, str):
            raise SupportError(
                f"{what}: got {letters!r}, components without a value, which a Simulation moves by name; expected a named "
                f"location: mesh.with_boundaries({{'grip': predicate}}), then prescribed={{'grip': {letters!r}}}."
            )
        return _dofs(np.sort(vertices_at(self._mesh, where, what)), components, self._mesh.d).reshape(-1, len(components))

    def _refuse_moved_twice(self, inputs: Mapping[str, Dofs], others: list[Dofs]) -> None:
        """Refuse degrees of freedom that are inputs and have another displacement, too."""
        once = np.zeros(self._mesh.p.size, dtype=bool)
        once[_union(others)] = True
        for name, dofs in inputs.items():
            twice = np.zeros(self._mesh.p.size, dtype=bool)
            twice[dofs[once[dofs]]] = True
            if self._mesh.space.comm.any(bool(twice.any())):
                raise SupportError(
                    f"Prescribed twice, once as an input at {name!r}: {self._name(twice)}. Do locations share an edge or a corner? "
                    "Leave the component out of one of them."
                )
            once[dofs] = True

    def _refuse_both(self) -> None:
        both = np.zeros(self._mesh.p.size, dtype=bool)
        both[np.intersect1d(self.fixed, self.prescribed)] = True
        if self._mesh.space.comm.any(bool(both.any())):
            raise SupportError(
                f"Both fixed and prescribed: {self._name(both)}. Do locations share an edge or a corner? Leave the component out "
                "of one of them, or take the vertices out with a predicate."
            )

    def _refuse_different(self, index: Dofs, one: NDArray[np.float64], other: NDArray[np.float64], moment: Moment) -> None:
        differ = np.abs(one - other) > 1e-12 * np.maximum(np.abs(one), np.abs(other))
        if self._mesh.space.comm.any(bool(differ.any())):
            bad = np.zeros(self._mesh.p.size, dtype=bool)
            bad[self.held[index[np.broadcast_to(differ, index.shape)]]] = True
            raise SupportError(
                f"Prescribed twice, with different displacements at t = {moment.time:.3g}: {self._name(bad)}. Do "
                "locations share an edge or a corner? Leave the component out of one of them."
            )

    def _name(self, dofs: NDArray[np.bool_]) -> str:
        """Return a description of the chosen degrees of freedom (ndofs,), by component."""
        mesh = self._mesh
        chosen = dofs.reshape(-1, mesh.d).T
        return "; ".join(
            f"{letter} of {mesh.name_nodes(nodes)}"
            for letter, nodes in zip("xyz", chosen, strict=False)
            if mesh.space.comm.any(bool(nodes.any()))
        )


def fixed_dofs(mesh: ElementMesh, fixed: Displacements | DofsView | None) -> Dofs:
    """Return the degrees of freedom of components at locations, or of scikit-fem's result, ascending. Errors as in `Supports`.

    >>> mesh = ElementMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [1], [2]])
    >>> fixed_dofs(mesh, [([2, 0], "y")])
    array([1, 5])
    """
    return _union([dofs for _, dofs in _fixed_entries(mesh, fixed)])


def _fixed_entries(mesh: ElementMesh, fixed: Displacements | DofsView | None) -> list[tuple[Any, Dofs]]:
    """Return pairs of a location and the degrees of freedom that do not move there."""
    if isinstance(fixed, DofsView):
        return [(fixed, dofs_of(mesh, fixed, "fixed"))]
    return [(where, _fixed_at(mesh, where, letters)) for where, letters in _pairs(fixed, "fixed", '{"wall": "xyz"}')]


def dofs_at(mesh: ElementMesh, argument: Any) -> Any:
    """Return the degrees of freedom of an argument.

    The argument is as in `fixed_dofs`, or a name or predicate for all components there. Any other argument is returned unchanged.
    """
    if isinstance(argument, str) or callable(argument):
        return _dofs(vertices_at(mesh, argument, "fixed"), range(mesh.d), mesh.d)
    pairs = isinstance(argument, list | tuple) and any(
        isinstance(one, list | tuple) and len(one) == 2 and isinstance(one[-1], str | DofsView) for one in argument
    )
    return fixed_dofs(mesh, argument) if pairs or isinstance(argument, Mapping | DofsView) else argument


def _fixed_at(mesh: ElementMesh, where: Where, letters: Any) -> Dofs:
    what = f"fixed on {describe(where)}"
    if isinstance(letters, DofsView):  # one entry of the dict that get_dofs({...}) returned
        return dofs_of(mesh, letters, what)
    return _dofs(vertices_at(mesh, where, what), _components(mesh, letters, what), mesh.d)


def _components(mesh: ElementMesh, letters: Any, what: str) -> list[int]:
    own = "xyz"[: mesh.d]
    if not isinstance(letters, str) or not letters or not set(letters) <= set(own) or len(set(letters)) < len(letters):
        raise SupportError(
            f"{what}: got {shown(letters)}; expected components of this mesh of {mesh.kind}, from {own!r}, each once."
        )
    return [own.index(letter) for letter in letters]


def _pairs(argument: Any, name: str, example: str) -> list[tuple[Any, Any]]:
    """Return pairs of a location and its support."""
    pairs = list(argument.items()) if isinstance(argument, Mapping) else argument if argument is not None else []
    if not isinstance(pairs, list | tuple) or any(not isinstance(pair, list | tuple) or len(pair) != 2 for pair in pairs):
        bare = ""
        if name == "fixed" and whole_array(argument) is not None:
            bare = (
                " Bare integers do not say which components: vertices are fixed=[(ids, 'xyz')]; degrees of freedom are what "
                "scikit-fem's basis.get_dofs(...) returned, not its .all(), such as fixed=basis.get_dofs('wall').keep('u^1')."
            )
        raise SupportError(f"{name} = {shown(argument)}; expected a dict such as {example}, or a list of such pairs.{bare}")
    return list(pairs)


def _dofs(vertices: NDArray[np.int64], components: Iterable[int], d: int) -> Dofs:
    """Return the degrees of freedom (n c,) of these components, node by node."""
    return (d * vertices[:, None] + np.array(list(components))).ravel()


def _union(dofs: list[Dofs]) -> Dofs:
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(ids.ravel() for ids in dofs)]))
