"""Contents of pictures and films of a deformed body, for all drawing programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array, number, real_array, shown, text
from ..errors import StvkError
from ..mesh.element import Element, linear_simplex
from ..mesh.facets import Cells, MeshArrays, outer_facets
from ..terms.loads.rigid_shapes import RigidShape
from .fields import NodalAverage, State, checked_state, masked, split_nodes, whole_state
from .law_on_elements import in_space
from .shapes import surface_of, surroundings
from .table import FIELDS, NODAL, find

#: Units that get a prefix.
PREFIXED = {"m", "m/s", "Pa", "J/m^3"}
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
Ids = NDArray[np.int64]
SHARP = np.cos(np.radians(30))
_ELEVATION, _AZIMUTH = np.radians([24.0, -50.0])
#: Unit vectors (3, 3), row by row, that point right, up and to the viewer in pictures of bodies in space.
SCREEN = np.array(
    [
        [-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0],
        [-np.sin(_ELEVATION) * np.cos(_AZIMUTH), -np.sin(_ELEVATION) * np.sin(_AZIMUTH), np.cos(_ELEVATION)],
        [np.cos(_ELEVATION) * np.cos(_AZIMUTH), np.cos(_ELEVATION) * np.sin(_AZIMUTH), np.sin(_ELEVATION)],
    ]
)
#: Number of pieces of an edge, by the maximum number of faces.
CUTS = ((300, 6), (2000, 4), (np.inf, 2))


@dataclass(frozen=True, eq=False)
class Picture:
    """Triangles (m = 3) or segments (m = 2) with a colour value at each corner."""

    d: int  # dimension of the space
    rest: Array  # (nv, 3) points at rest [m]: the vertices; for other elements than linear simplices a lattice on each face
    moved: Array  # (nv, 3) the same with `scale` times their displacements [m]
    cells: NDArray[np.integer]  # (m, n) points
    values: Array  # (m, n) at the corners, masked where missing
    lines: NDArray[np.integer]  # (2, ne) edges that outline the body
    label: str  # meaning of the colours, with the unit
    scale: float
    length_unit: str = "m"  # of the coordinates
    shapes: tuple[RigidShape, ...] = ()  # rigid shapes that the body may touch

    @property
    def largest(self) -> float:
        """Largest absolute value; 0 if there is none."""
        return float(np.abs(np.ma.compressed(self.values)).max(initial=0.0))

    def in_unit(self, factor: float, unit: str) -> Picture:
        """Return the picture with values times the factor, and their unit in the label."""
        return replace(self, values=self.values * factor, label=f"{self.label} [{unit}]" if unit else self.label)

    def on_screen(self) -> Picture:
        """Return the picture with coordinates to the right, up and to the viewer, for a body in space."""
        return replace(self, rest=self.rest @ SCREEN.T, moved=self.moved @ SCREEN.T) if self.d == 3 else self

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest value, which always differ a little."""
        return View.of([self]).limits


class View(NamedTuple):
    """Common bounds of the pictures of a body."""

    box: Array  # (2, 3) smallest and largest coordinates of the body in all of them, and at rest [m]
    frame: Array  # (2, 3) the same with the rigid shapes in the surroundings of the body
    screen: Array  # (2, 3) the same with `Picture.on_screen`
    limits: tuple[float, float]  # smallest and largest colour value, which always differ a little

    @classmethod
    def of(cls, pictures: Iterable[Picture]) -> View:
        """Return the view of these pictures, at least one."""
        low, high, box, screen = np.inf, -np.inf, np.empty((0, 3)), np.empty((0, 3))
        shapes: set[RigidShape] = set()
        for picture in pictures:
            known = np.ma.compressed(picture.values)
            low, high = float(known.min(initial=low)), float(known.max(initial=high))
            seen = picture.on_screen()
            box, screen = _bounds(box, picture.rest, picture.moved), _bounds(screen, seen.rest, seen.moved)
            shapes.update(picture.shapes)
        if low > high:
            low, high = 0.0, 1.0  # no picture has a value
        least = 1e-9 * max(abs(low), abs(high), 1e-300)
        limits = (low, high) if high - low > least else (low - 1e3 * least, high + 1e3 * least)
        drawn = [surface_of(shape, surroundings(box)).reshape(-1, 3) for shape in shapes]
        return cls(box, _bounds(box, *drawn), _bounds(screen, *(x @ SCREEN.T for x in drawn)), limits)


def _bounds(*points: Array) -> Array:
    """Return the smallest and the largest coordinates (2, 3) of all points."""
    every = np.concatenate(points)
    return np.array([every.min(axis=0), every.max(axis=0)])


def picture_of(state: State, field: str | ArrayLike, scale: float, label: str | None) -> Picture:
    """Return the body at this state, coloured by a field with one component.

    Values by element are averaged to the nodes within each material, so that stress still jumps between materials.
    """
    scale, label = checked_scale(scale), checked_label(label)
    _, named, unit = corner_values(whole_state(checked_state(state)), field)
    picture = VisibleBody(state).picture(state, field, named if label is None else label, scale)
    picture = replace(picture, length_unit=state.fields.units.of("m"))
    return picture.in_unit(*prefixed(picture.largest, unit)) if label is None else picture


def checked_scale(scale: Any) -> float:
    """Return the factor of displacements; refuse other values."""
    return number("scale", scale, "a finite factor for the displacements, such as 1")


def checked_label(label: Any) -> str | None:
    """Return the label of a colour bar; refuse other values."""
    return None if label is None else text("label", label)


@dataclass(frozen=True, eq=False)
class Film:
    """Pictures of a body in time, each made on request."""

    times: list[float]  # [s]
    picture: Callable[[int], Picture]  # by its index, with values in their unit
    unit: str  # of the values; empty if they are not converted
    length_unit: str = "m"  # of the coordinates

    def view_and_pictures(self) -> tuple[View, Iterator[tuple[str, Picture]]]:
        """Return the view that all pictures share, and an iterator of each picture with its time in words.

        Pictures have as many axes as the motion needs, in a unit that suits all values.
        """
        raw = View.of(map(self.picture, range(len(self.times))))
        low, high = raw.limits
        factor, unit = prefixed(max(abs(low), abs(high)), self.unit)
        moving = np.flatnonzero(np.ptp(raw.box, axis=0) > 0)
        d = int(max(moving, default=0)) + 1
        length = self.length_unit
        pictures = (
            replace(self.picture(number).in_unit(factor, unit), d=d, length_unit=length) for number in range(len(self.times))
        )
        return raw._replace(limits=(factor * low, factor * high)), zip(_in_words(self.times), pictures, strict=True)


def _in_words(times: list[float]) -> list[str]:
    """Return the times in words, with enough digits to distinguish them."""
    gaps = np.diff(np.unique(times))
    digits = int(np.clip(1 - np.floor(np.log10(gaps.min())), 0, 9)) if len(gaps) else 3
    return [f"t = {t:.{digits}f}" for t in times]


class VisibleMesh:
    """Visible part of a mesh, for pictures at any displacements.

    Faces of quadratic elements and of boxes are cut by a lattice, so that curved faces are drawn curved. Elements in the mask
    `removed` (nt,) are not drawn.
    """

    def __init__(self, mesh: MeshArrays, removed: NDArray[np.bool_] | None = None) -> None:
        self._d, x = mesh.d, in_space(mesh.p.T)
        self._lattice: Lattice | None = None
        remaining, retained = mesh, np.arange(mesh.nt)
        if removed is not None and removed.any():
            remaining, retained = Cells(mesh.p, mesh.t[:, ~removed], mesh.element), np.flatnonzero(~removed)
        (nodes, elements), face = visible_faces(remaining)
        self._seen = nodes, retained[elements]
        self._nodes = mesh.t[self._seen]  # (m, n)
        if mesh.element.is_linear_simplex:
            self._rest: Array = x
            self._cells: NDArray[np.integer] = self._nodes
            self._lines = outline(x, self._cells)
            return
        self._lattice = Lattice(face, self._nodes.shape[1], mesh.d)
        self._rest = self._lattice.points(x[self._nodes])
        self._cells = self._lattice.cells
        self._lines = self._cells if face.k == 1 else self._lattice.lines(x[self._nodes], self._nodes)

    def picture(self, u: Array, values: Array, label: str, scale: float) -> Picture:
        """Return the picture at displacements `u` (nv, d), coloured by values (n, nt) at the nodes of all elements."""
        shift, seen = scale * in_space(u), values[self._seen]
        if self._lattice is None:
            return Picture(self._d, self._rest, self._rest + shift, self._cells, seen, self._lines, label, scale)
        moved = self._rest + self._lattice.points(shift[self._nodes])
        seen = self._lattice.values(seen)
        return Picture(self._d, self._rest, moved, self._cells, seen, self._lines, label, scale)


class VisibleBody:
    """Visible parts of a body and of its bodies of lower dimensions, with the elements of a state, and shapes that it touches."""

    def __init__(self, state: State) -> None:
        self._parts = [VisibleMesh(part.fields.mesh, part.fields.removed) for part in (state, *state.beside)]

    def picture(self, state: State, field: str | ArrayLike, label: str, scale: float) -> Picture:
        """Return the picture of a state with the same elements, coloured by a field."""
        values = [corner_values(state, field)[0]]
        for lower in state.beside:
            mesh = lower.fields.mesh
            known = isinstance(field, str) or np.shape(field) == (mesh.nv,) != (state.fields.mesh.nt,)
            values.append(corner_values(lower, field)[0] if known else masked(np.zeros(mesh.t.shape), np.ones(mesh.nt, bool)))
        picture = joined([part.picture(state.u, colours, label, scale) for part, colours in zip(self._parts, values, strict=True)])
        shapes = (contact.shape for contact in state.contacts if scale == 1)
        return replace(picture, shapes=tuple(shape for shape in shapes if shape is not None))


def joined(pictures: Sequence[Picture]) -> Picture:
    """Return several pictures as one. From other pictures with triangles only new faces are added; segments become lines."""
    first, *others = pictures
    for other in others:
        begin = len(first.rest)
        rest, moved = np.concatenate([first.rest, other.rest]), np.concatenate([first.moved, other.moved])
        first = replace(first, rest=rest, moved=moved, lines=np.concatenate([first.lines, begin + other.lines], axis=1))
        if len(other.cells) == len(first.cells):
            new = ~_with_same_centre(other.rest[other.cells], first.rest[first.cells])
            cells = np.concatenate([first.cells, begin + other.cells[:, new]], axis=1)
            first = replace(first, cells=cells, values=np.ma.concatenate([first.values, other.values[:, new]], axis=1))
    return first


def _with_same_centre(some: Array, every: Array) -> NDArray[np.bool_]:
    """Return a mask of the cells (m, n, 3) with the same centre as another cell."""
    centres = np.concatenate([some, every], axis=1).mean(axis=0)
    keys = np.round(centres / (np.abs(centres).max(initial=0.0) or 1.0), 9)
    _, index = np.unique(keys, axis=0, return_inverse=True)
    index = index.reshape(-1)
    return np.isin(index[: some.shape[1]], index[some.shape[1] :])


class Lattice:
    """Lattice of points on `n` faces of a kind, evenly spread on the reference element, with the triangles or segments between."""

    def __init__(self, face: Element, n: int, d: int) -> None:
        cuts = 2 if d == 1 else next(cuts for most, cuts in CUTS if n <= most)
        self._grid, self._local = subdivided(face, cuts)
        self._face, self._cuts, self._N = face, cuts, face.values(self._grid)  # (points, m)
        self.cells = (self._local[:, :, None] + len(self._grid) * np.arange(n)).reshape(len(self._local), -1)

    def points(self, x: Array) -> Array:
        """Return values (points of all faces, 3) interpolated between nodes (m, n, 3), face by face."""
        return np.einsum("pm,mnc->npc", self._N, x).reshape(-1, x.shape[2])

    def values(self, values: Array) -> Array:
        """Return values at the corners of the cells, from values (m, n) at the nodes; masked where a face has none."""
        missing = np.asarray(np.ma.getmaskarray(values)).any(axis=0)
        found = (self._N @ np.ma.filled(values, 0.0))[self._local]  # (corners, cells of a face, n)
        return masked(found.reshape(len(self._local), -1).T, np.tile(missing, self._local.shape[1])).T

    def lines(self, x: Array, nodes: NDArray[np.integer]) -> NDArray[np.integer]:
        """Return pieces (2, n) of the edges that outline faces with `nodes` (m, n) at `x` (m, n, 3), see `outline_edges`."""
        face, count = self._face, len(self._N)
        of_face, edge = outline_edges(face, nodes, x)
        s = np.linspace(0, 1, self._cuts + 1)[:, None]
        along = [
            [np.abs(self._grid - ((1 - r) * face.nodes[a] + r * face.nodes[b])).sum(axis=1).argmin() for r in s]
            for a, b in face.edges
        ]
        chain = np.array(along)[edge] + count * of_face[:, None]  # (n, cuts + 1)
        return np.stack([chain[:, :-1].ravel(), chain[:, 1:].ravel()])


def subdivided(face: Element, cuts: int) -> tuple[Array, NDArray[np.integer]]:
    """Return reference points (n, k) of a lattice with `cuts` pieces to an edge, and the segments or triangles between them."""
    if face.k == 1:
        return np.arange(cuts + 1)[:, None] / cuts, np.array([np.arange(cuts), np.arange(1, cuts + 1)])
    grid = [(i, j) for i in range(cuts + 1) for j in range(cuts + 1 - i if face.is_simplex else cuts + 1)]
    number = {indices: k for k, indices in enumerate(grid)}
    low = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in grid]
    high = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in grid]
    cells = [[number[indices] for indices in cell] for cell in low + high if number.keys() >= set(cell)]
    return np.array(grid) / cuts, np.array(cells).T


def corner_values(state: State, field: str | ArrayLike) -> tuple[Array, str, str]:
    """Return values (n, nt) at the nodes of all elements, their name, and their unit or an empty text."""
    mesh = state.fields.mesh
    if not isinstance(field, str):
        return _given(state, field), "", ""
    if field in state.nodal:
        at_nodes = state.nodal[field]
        lengths = at_nodes if at_nodes.ndim == 1 else np.linalg.norm(at_nodes, axis=1)
        return lengths[mesh.t], field.replace("_", " "), state.fields.units.of(NODAL[field])
    found = find(field, state.nodal)
    if found.shape:
        scalars = ", ".join([*state.nodal, *(other.name for other in FIELDS if not other.shape)])
        raise StvkError(
            f"{found.name} has {'3 x 3' if len(found.shape) == 2 else 3} components; expected a field with one component, such as "
            f"{scalars}, or hand "
            f'in a component and its label: field=state["{field}"][:, 0{", 0" if len(found.shape) == 2 else ""}], label="...".'
        )
    values = state.raw(found.name) if len(state.fields.points) == 1 else state.extrapolated(found.name)
    return _by_material(state, *values), found.words, state.fields.units.of(found.unit.replace("-", ""))


def _given(state: State, values: Any) -> Array:
    mesh, given = state.fields.mesh, real_array(np.ma.getdata(values) if isinstance(values, np.ma.MaskedArray) else values)
    if given is None or given.shape not in ((mesh.nt,), (mesh.nv,)):
        what = f"has shape {given.shape}" if given is not None else f"= {shown(values)}"
        raise StvkError(
            f"field {what}; expected a name, or one number for each of the {mesh.nt} elements or {mesh.nv} {mesh.words}."
        )
    missing = np.ma.getmaskarray(values) | ~np.isfinite(given)
    known = np.where(missing, 0.0, given)
    return masked(known, missing)[mesh.t] if len(known) == mesh.nv != mesh.nt else _by_material(state, known, missing)


def _by_material(state: State, values: Array, missing: NDArray[np.bool_]) -> Array:
    """Return averages (n, nt) at the nodes within each material, of values (nt,), or of values (n, nt) at the nodes of each
    element.
    """
    fields = state.fields
    nodes, count = split_nodes(fields.mesh.t, fields.material_of)
    average = NodalAverage(nodes, fields.volume, count)
    return masked(*(average(values, missing) if values.ndim == 1 else average.of_corners(values, missing)))[nodes]


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Return a factor that brings the largest value into 1 ... 1000, and the unit of SI with the matching prefix.

    Values in other units are not converted.
    """
    if unit not in PREFIXED or not largest:
        return 1.0, unit
    power = int(np.clip(3 * np.floor(np.log10(largest) / 3 + 1e-9), min(PREFIXES), max(PREFIXES)))
    return 10.0**-power, PREFIXES[power] + unit.replace("^3", "³")


def visible_faces(mesh: MeshArrays) -> tuple[tuple[NDArray[Any], NDArray[Any]], Element]:
    """Return local nodes (m, n) and elements (n,) of the visible faces, and the kind of faces.

    `mesh.t[nodes, elements]` are the nodes: for solids those of the boundary facets, for other elements all.
    """
    if mesh.k < 3:
        return (np.repeat(np.arange(mesh.element.n)[:, None], mesh.nt, axis=1), np.arange(mesh.nt)), mesh.element
    facets, elements = outer_facets(mesh)
    return ((mesh.t[:, elements] == facets[:, None]).argmax(axis=1), elements), mesh.facet


def outline_edges(face: Element, nodes: NDArray[np.integer], x: Array) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return face (n,) and local edge (n,) of each edge that outlines faces with `nodes` (m, nf) at `x` (m, nf, 3), each once.

    At these edges faces end, branch or bend by more than 30 degrees.
    """
    ends = np.array(face.edges)
    base_vectors = np.einsum("eai,anc->neic", face.derivatives(face.nodes[ends].mean(axis=1)), x)  # (nf, edges, 2, 3)
    normals = np.cross(base_vectors[:, :, 0], base_vectors[:, :, 1]).reshape(-1, 3)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 0, length, 1.0)
    pairs = np.sort(nodes[ends.T].transpose(0, 2, 1).reshape(2, -1), axis=0)  # face by face
    _, index, count = np.unique(pairs, axis=1, return_inverse=True, return_counts=True)
    by_edge = np.argsort(index.reshape(-1), kind="stable")
    start = np.cumsum(count) - count
    one, other = by_edge[start], by_edge[start + (count == 2)]
    flat = np.abs((normals[one] * normals[other]).sum(axis=1)) > SHARP
    return np.divmod(one[(count != 2) | ~flat], len(ends))


def outline(points: Array, cells: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return edges (2, n) that outline triangles of `points` (nv, 3), see `outline_edges`; segments are returned unchanged."""
    if len(cells) == 2:
        return cells
    triangle = linear_simplex(2)
    of_face, edge = outline_edges(triangle, cells, points[cells])
    return cells[np.array(triangle.edges)[edge].T, of_face]
