"""What pictures and films of a deformed body show, whoever draws them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, number, real_array, shown, text
from ..errors import StvkError
from ..mesh import ElementMesh
from ..mesh.facets import facet_ids
from .fields import NodalAverage, State, checked_state, masked, split_nodes
from .law import in_space
from .table import FIELDS, VECTORS, find

PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
Ids = NDArray[np.int64]
SHARP = np.cos(np.radians(30))


@dataclass(frozen=True, eq=False)
class Picture:
    """Triangles (m = 3) or segments (m = 2) with a colour value at each corner."""

    d: int  # dimension of the space
    rest: Array  # (nv, 3) vertices at rest [m]
    moved: Array  # (nv, 3) the same with `scale` times their displacements [m]
    cells: NDArray[np.integer]  # (m, n) vertices
    values: Array  # (m, n) at the corners, masked where there are none
    lines: NDArray[np.integer]  # (2, ne) edges that outline the body
    label: str  # what the colours mean, with the unit
    scale: float

    @property
    def largest(self) -> float:
        """The largest size of a value; 0 if there is none."""
        return float(np.abs(np.ma.compressed(self.values)).max(initial=0.0))

    def in_unit(self, factor: float, unit: str) -> Picture:
        """The picture with values times the factor, and their unit in the label."""
        return replace(self, values=self.values * factor, label=f"{self.label} [{unit}]" if unit else self.label)

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest value, a little apart."""
        return View.of([self]).limits


class View(NamedTuple):
    """What pictures of a body have in common."""

    box: Array  # (2, 3) the least and the largest coordinates of the body in all of them, and at rest [m]
    limits: tuple[float, float]  # least and largest colour value, a little apart

    @classmethod
    def of(cls, pictures: Iterable[Picture]) -> View:
        """The view of these pictures, of which there is at least one."""
        low, high, corners = np.inf, -np.inf, np.empty((0, 3))
        for picture in pictures:
            known = np.ma.compressed(picture.values)
            low, high = float(known.min(initial=low)), float(known.max(initial=high))
            corners = np.concatenate([corners, picture.rest, picture.moved])
            corners = np.array([corners.min(axis=0), corners.max(axis=0)])
        if low > high:
            low, high = 0.0, 1.0  # no value in any
        least = 1e-9 * max(abs(low), abs(high), 1e-300)
        limits = (low, high) if high - low > least else (low - 1e3 * least, high + 1e3 * least)
        return cls(corners, limits)


def picture_of(state: State, field: str | ArrayLike, scale: float, label: str | None) -> Picture:
    """The body at this state, coloured by a field with one component.

    Values by element are averaged to the nodes within each material, so that stress still jumps from one to the next.
    """
    scale, label = checked_scale(scale), checked_label(label)
    values, named, unit = corner_values(checked_state(state), field)
    picture = Sight(state.fields.mesh).picture(state.u, values, named if label is None else label, scale)
    return picture.in_unit(*prefixed(picture.largest, unit)) if label is None else picture


def checked_scale(scale: Any) -> float:
    """Refuse what is no factor of displacements."""
    return number("scale", scale, "a finite factor for the displacements, such as 1")


def checked_label(label: Any) -> str | None:
    """Refuse what is no label of a colour bar."""
    return None if label is None else text("label", label)


@dataclass(frozen=True, eq=False)
class Film:
    """Pictures of a body in time, each made when it is asked for."""

    times: list[float]  # [s]
    picture: Callable[[int], Picture]  # by its number, with values in their unit
    unit: str  # of the values; empty if they stay as they are

    def developed(self) -> tuple[View, Iterator[tuple[str, Picture]]]:
        """The view that all pictures share, and each picture with its time in words.

        Pictures have as many axes as the motion takes, in a unit that suits all values.
        """
        raw = View.of(map(self.picture, range(len(self.times))))
        low, high = raw.limits
        factor, unit = prefixed(max(abs(low), abs(high)), self.unit)
        moving = np.flatnonzero(np.ptp(raw.box, axis=0) > 0)
        d = int(max(moving, default=0)) + 1
        shots = (replace(self.picture(number).in_unit(factor, unit), d=d) for number in range(len(self.times)))
        return View(raw.box, (factor * low, factor * high)), zip(_in_words(self.times), shots, strict=True)


def _in_words(times: list[float]) -> list[str]:
    """The times in words, with as many digits as tell them apart."""
    gaps = np.diff(np.unique(times))
    digits = int(np.clip(1 - np.floor(np.log10(gaps.min())), 0, 9)) if len(gaps) else 3
    return [f"t = {t:.{digits}f}" for t in times]


class Sight:
    """The visible part of a mesh, for pictures of it at any displacements."""

    def __init__(self, mesh: ElementMesh) -> None:
        self._d, self._seen = mesh.d, visible_cells(mesh)
        self._cells = mesh.t[self._seen]
        self._rest = in_space(mesh.p.T)
        self._lines = outline(self._rest, self._cells)

    def picture(self, u: Array, values: Array, label: str, scale: float) -> Picture:
        """The picture at displacements `u` (nv, d), coloured by values (k + 1, nt) at the corners of all elements."""
        moved = self._rest + scale * in_space(u)
        return Picture(self._d, self._rest, moved, self._cells, values[self._seen], self._lines, label, scale)


def corner_values(state: State, field: str | ArrayLike) -> tuple[Array, str, str]:
    """(k + 1, nt) values at the corners of all elements, their name, and their unit or nothing."""
    mesh = state.fields.mesh
    if not isinstance(field, str):
        return _given(state, field), "", ""
    if field in state.vectors:
        return np.linalg.norm(state.vectors[field], axis=1)[mesh.t], field, VECTORS[field]
    found = find(field, state.vectors)
    if found.shape:
        scalars = ", ".join([*state.vectors, *(other.name for other in FIELDS if not other.shape)])
        raise StvkError(
            f"{found.name} has {'3 x 3' if len(found.shape) == 2 else 3} components; a picture shows one number. Take one of "
            f"{scalars}, or hand "
            f'in a component and its label: field=state["{field}"][:, 0{", 0" if len(found.shape) == 2 else ""}], label="...".'
        )
    return _by_material(state, *state.raw(found.name)), found.words, found.unit.replace("-", "")


def _given(state: State, values: Any) -> Array:
    mesh, given = state.fields.mesh, real_array(np.ma.getdata(values) if isinstance(values, np.ma.MaskedArray) else values)
    if given is None or given.shape not in ((mesh.nt,), (mesh.nv,)):
        what = f"has shape {given.shape}" if given is not None else f"= {shown(values)}"
        raise StvkError(f"field {what}; expected a name, or a number for each of the {mesh.nt} elements or {mesh.nv} vertices.")
    missing = np.ma.getmaskarray(values) | ~np.isfinite(given)
    known = np.where(missing, 0.0, given)
    return masked(known, missing)[mesh.t] if len(known) == mesh.nv != mesh.nt else _by_material(state, known, missing)


def _by_material(state: State, values: Array, missing: NDArray[np.bool_]) -> Array:
    fields = state.fields
    nodes, count = split_nodes(fields.mesh.t, fields.material_of)
    return masked(*NodalAverage(nodes, fields.volume, count)(values, missing))[nodes]


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """A factor that makes the largest value one of 1 ... 1000, and the unit with the prefix that goes with it."""
    if not unit or not largest:
        return 1.0, unit
    power = int(np.clip(3 * np.floor(np.log10(largest) / 3 + 1e-9), min(PREFIXES), max(PREFIXES)))
    return 10.0**-power, PREFIXES[power] + unit.replace("^3", "³")


def visible_cells(mesh: ElementMesh) -> tuple[Ids, Ids]:
    """(m, n) corners and (n,) elements of what is drawn: the boundary facets of tetrahedra, other simplices as they are.

    `mesh.t[corners, elements]` are the vertices; facets are counterclockwise when seen from outside.
    """
    if mesh.k < 3:
        return np.repeat(np.arange(mesh.k + 1)[:, None], mesh.nt, axis=1), np.arange(mesh.nt)
    ids = facet_ids(mesh)
    opposite, elements = np.nonzero(np.bincount(ids.ravel())[ids] == 1)
    corners = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[opposite].T
    a, b, c, inside = mesh.p.T[mesh.t[np.vstack([corners, opposite]), elements]]
    inwards = (np.cross(b - a, c - a) * (inside - a)).sum(axis=1) > 0
    corners[:2, inwards] = corners[1::-1, inwards]
    return corners, elements


def outline(points: Array, cells: NDArray[np.integer]) -> NDArray[np.integer]:
    """Edges (2, n) where triangles of `points` (nv, 3) end, branch or bend by more than 30 degrees; segments as they are."""
    if len(cells) == 2:
        return cells
    a, b, c = points[cells]
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(np.concatenate([cells[[0, 1]], cells[[1, 2]], cells[[0, 2]]], axis=1), axis=0)
    unique, place, count = np.unique(edges, axis=1, return_inverse=True, return_counts=True)
    by_edge = np.argsort(place.reshape(-1), kind="stable") % cells.shape[1]  # the triangles of each edge in turn
    start = np.cumsum(count) - count
    flat = np.abs((normals[by_edge[start]] * normals[by_edge[start + (count == 2)]]).sum(axis=1)) > SHARP
    return unique[:, (count != 2) | ~flat]
