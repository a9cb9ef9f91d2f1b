"""Fields of a body by name, by element and by node, for any displacements; data of its mesh and terms are retained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array, shown
from ..errors import StvkError
from ..mesh.displacements import by_vertex
from ..mesh.points import rule_of
from ..space import Space
from ..units import UNITS, UnitSystem
from .contact_forces import ContactState, combined
from .response import ElasticBody, Masked, Response
from .table import find


class Fields(ElasticBody):
    """Strains and stresses of a body, for any of its displacements.

    If several terms share an element, their forces add up. The stress is that of all of them per `section`, the largest of their
    sections (the same for all in solids). A strain across that differs between terms is averaged, weighted by their sections. For
    the stress of one term use `Fields(mesh, [term])`.

    Parameters
    ----------
    mesh
        Mesh, as `System` takes it.
    terms
        Term, or several; loads among them carry no stress and are skipped.
    quadrature
        Integration rule, as `System` takes it: the points at which elements with several points have their fields.

    Attributes
    ----------
    section
        (nt,) thickness [m], area [m^2] or 1.
    volume
        (nt,) rest volume [m^3]: length, area or volume times section.
    without_term
        (nt,) whether an element is in no term, or in a term with unknown stress.

    Raises
    ------
    MaterialError, RegionError
        if a term does not fit the mesh.
    StvkError
        if no term carries stress.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK
    >>> mesh = skfem.MeshTet().refined(1)
    >>> now = Fields(mesh, StVK(young=2.6, poisson=0.3)).at(0.1 * mesh.p.ravel("F"))   # 10 % larger in all directions
    >>> E = (1.1**2 - 1) / 2                             # S = 3 K E I, sigma = F S F'/J = 3 K E/1.1 I with K = 13/6
    >>> bool(np.allclose(now["green_strain"], E * np.eye(3))), bool(np.allclose(now["cauchy"], 6.5 * E / 1.1 * np.eye(3)))
    (True, True)
    """

    @classmethod
    def of(cls, system: Any) -> Fields:
        """Return the fields of a system, at the points where its elements are integrated, without elements that are removed so far;
        and those of the elements in `beside`.
        """
        fields = cls(system.mesh, system.body.terms, getattr(system, "quadrature", None))
        fields.leave_out(system.removed)
        fields.units = system.units
        fields.beside = tuple(cls(body.mesh, body.terms) for body in system.body.beside)
        return fields

    #: System of units of all values.
    units: UnitSystem = UNITS["SI"]
    #: Fields of elements of lower dimensions on the same nodes.
    beside: tuple[Fields, ...] = ()

    @cached_property
    def average(self) -> NodalAverage:
        return NodalAverage(self.mesh.t, self.volume, self.mesh.nv, self.mesh.space)

    @cached_property
    def to_nodes(self) -> Array:
        """Matrix (n, nq) from values at the points of an element to values at its nodes: linear, in boxes along each axis, through
        the points.

        With more points than corners, it is the least-squares fit.
        """
        element = self.mesh.element
        corners = element.linear
        inner = corners.values(rule_of(element, self.kind).points)
        return np.asarray(corners.values(element.nodes) @ np.linalg.pinv(inner))

    def at(self, u: ArrayLike, v: ArrayLike | None = None, contacts: Sequence[ContactState] = ()) -> State:
        """Return the state at displacements `u` (ndofs,) [m], for a body in motion with velocities `v` (ndofs,) [m/s].

        Files have the forces, pressures and gaps of the `contacts`, as `result.contact(name)` returns them, and pictures their
        shapes.

        Raises
        ------
        StateError
            if `u` or `v` does not have one finite entry for each degree of freedom.
        """
        moving = None if v is None else by_vertex(self.mesh, v, "v").astype(np.float64)
        return State(self, by_vertex(self.mesh, u).astype(np.float64), moving, contacts)


class State:
    """Fields at displacements `u` (nv, d) [m], each computed at first use.

    `state[name]` has values by element; for elements with several points they are the means over the volume.
    `state.at_points(name)` has values at the points, and `state.at_nodes(name)` by node.

    Elements and nodes without a value are masked (a `numpy.ma.MaskedArray`). Elements without a term have no stress and, below
    three dimensions, no strain across. Removed elements have no values. If no value is missing, the array is not masked.

    Attributes
    ----------
    v
        (nv, d) velocities [m/s] of a body in motion, otherwise None.
    contacts
        States of its contacts.
    `beside`
        States of elements of lower dimensions on the same nodes: membranes and cables on tetrahedra.
    """

    def __init__(self, fields: Fields, u: Array, v: Array | None = None, contacts: Sequence[ContactState] = ()) -> None:
        self.fields, self.u, self.v, self.contacts = fields, u, v, contacts

    @cached_property
    def beside(self) -> tuple[State, ...]:
        return tuple(State(fields, self.u, self.v, self.contacts) for fields in self.fields.beside)

    @cached_property
    def responses(self) -> list[Response]:
        """Strains and stresses at each point of the elements."""
        return [Response(self.fields, self.u, point) for point in self.fields.points]

    def __getitem__(self, name: str) -> Array:
        """Return the values (nt, ...) by element of the field of this name; `results.names()` lists the names.

        Raises
        ------
        StvkError
            if no field has this name.
        """
        return masked(*self.raw(name))

    def at_nodes(self, name: str, region: str | NDArray[Any] | None = None) -> Array:
        """Return averages (nv, ...) over the elements around each node, weighted by rest volume; with a `region`, over its elements
        only. All parts of a divided body call this method together.

        Values at several points of an element are first extrapolated to its nodes.

        Raises
        ------
        StvkError
            if the field or the region does not exist.
        """
        fields, outside = self.fields, np.ones(self.fields.mesh.nt, dtype=bool)
        outside[fields.mesh.elements(region)] = False
        if len(fields.points) == 1:
            values, missing = self.raw(name)
            return masked(*fields.average(values, missing | outside))
        values, missing = self.extrapolated(name)
        return masked(*fields.average.of_corners(values, missing | outside))

    def extrapolated(self, name: str) -> Masked:
        """Return the values (n, nt, ...) at the nodes of each element from those at its points, and the elements (nt,) without
        values.
        """
        values, missing = self._at_points(name)
        return np.tensordot(self.fields.to_nodes, values, axes=1), missing

    def at_points(self, name: str) -> Array:
        """Return the values (nt, nq, ...) of the field at the points of the elements, those of `elements.rule_of(mesh.element)`.

        Raises
        ------
        StvkError
            if no field has this name.
        """
        values, missing = self._at_points(name)
        return masked(np.moveaxis(values, 0, 1), missing)

    def raw(self, name: str) -> Masked:
        """Return values by element, finite everywhere, and a mask of the invalid ones."""
        if len(self.fields.points) == 1:
            return self.responses[0].value(find(name).of)
        values, missing = self._at_points(name)
        return np.einsum("qn,qn...->n...", self.fields.weights, values), missing

    def _at_points(self, name: str) -> Masked:
        """Return the values (nq, nt, ...) at the points, and the elements (nt,) without a value at one of them."""
        values, missing = zip(*[response.value(find(name).of) for response in self.responses], strict=True)
        return np.array(values), np.any(missing, axis=0)

    @cached_property
    def nodal(self) -> dict[str, Array]:
        """Values at nodes by name: displacements (nv, d), velocities if there are any, and with contacts their combined fields."""
        return {"displacement": self.u} | ({} if self.v is None else {"velocity": self.v}) | combined(self.contacts)


class NodalAverage:
    """Averages at nodes over the elements around them, weighted by rest volume; the operator is built once.

    The average also smooths across the boundary of two materials, where stresses jump. There, average over one region at a time, by
    leaving the others out.

    >>> average = NodalAverage(np.array([[0, 1], [1, 2]]), np.array([1.0, 3.0]), 4)
    >>> average(np.array([10.0, 20.0]), np.array([False, False]))
    (array([10. , 17.5, 20. ,  0. ]), array([False, False, False,  True]))
    """

    def __init__(self, t: NDArray[np.integer], volume: Array, nodes: int, space: Space | None = None) -> None:
        size, nt = t.shape
        self._t, self._volume, self._space = t, volume, space or Space(nodes)
        self._sum = csr_matrix((np.tile(volume, size), (t.ravel(), np.tile(np.arange(nt), size))), shape=(nodes, nt))

    def __call__(self, values: Array, missing: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """Return averages (nodes, ...) of values (nt, ...) over the elements that are not missing, and the nodes without any."""
        flat = np.where(missing[:, None], 0.0, values.reshape(len(values), math.prod(values.shape[1:])))
        return self._averages(self._sum @ flat, missing, values.shape[1:])

    def of_corners(self, values: Array, missing: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        """Return averages as `__call__` does, of values (n, nt, ...) at the nodes of each element."""
        shares, nodes = np.where(missing, 0.0, self._volume), self._sum.shape[0]
        flat = shares[:, None] * values.reshape(*self._t.shape, math.prod(values.shape[2:]))
        sums = np.stack([np.bincount(self._t.ravel(), column.ravel(), nodes) for column in np.moveaxis(flat, 2, 0)], axis=1)
        return self._averages(sums, missing, values.shape[2:])

    def _averages(self, sums: Array, missing: NDArray[np.bool_], shape: tuple[int, ...]) -> tuple[Array, NDArray[np.bool_]]:
        """Return averages (nodes, *shape) from sums (nodes, m) of weighted values in this part, and the nodes without any."""
        weight, sums = (self._space.share(x) for x in (self._sum @ np.where(missing, 0.0, 1.0), np.ascontiguousarray(sums)))
        average = sums / np.where(weight > 0, weight, 1.0)[:, None]
        return average.reshape(-1, *shape), weight == 0


def split_nodes(t: NDArray[np.integer], part: NDArray[np.integer]) -> tuple[NDArray[np.int64], int]:
    """Return indices (k + 1, nt) of the nodes, and their number, after each node is split into one for every part that meets there.

    >>> split_nodes(np.array([[0, 1], [1, 2]]), np.array([0, 1]))
    (array([[0, 2],
           [1, 3]]), 4)
    """
    nodes = int(t.max()) + 1
    numbers, split = np.unique(part * nodes + t, return_inverse=True)
    return split.reshape(t.shape), len(numbers)


def checked_state(state: Any) -> State:
    """Return the state; refuse other objects."""
    if not isinstance(state, State):
        raise StvkError(f"state = {shown(state)}; expected a state, such as result.state or Fields(mesh, terms).at(u).")
    return state


def whole_state(state: State) -> State:
    """Return the state; refuse one of a part of a divided body, of which there are no pictures."""
    if state.fields.mesh.space.comm.divided:
        raise StvkError(
            "The state belongs to a part of a body; expected the whole body for a picture. Write its file, save='x.pvd', and read "
            "it on one machine: animate('x.pvd', ...), read_state('x.pvd', mesh) or ParaView."
        )
    return state


def masked(values: Array, missing: NDArray[np.bool_]) -> Array:
    """Return the values, masked where they are missing; unchanged if none is missing."""
    if not missing.any():
        return values
    mask = np.broadcast_to(missing.reshape(-1, *(1,) * (values.ndim - 1)), values.shape)
    return np.ma.MaskedArray(values, mask)
