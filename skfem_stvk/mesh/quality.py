"""Quality of the elements of a mesh, and its worst elements, even for a mesh that cannot carry a body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, choice, whole
from ..errors import Remark, name_ids
from ..terminal import html_table
from . import points
from .diagnostics import faults, scale_of, sizes_of_parts, sound_elements
from .element import Element
from .facets import Cells
from .geometry import aspect_ratios, edge_lengths
from .mesh import ElementMesh, MeshLike

#: Limits of flatness, and of edges as a fraction of the usual ones, beyond which motions are slow and stresses inaccurate.
FLAT, SHORT = 100.0, 1e-3


@dataclass(frozen=True)
class Extreme:
    """Worst elements by one measure.

    Attributes
    ----------
    name
        Name of the measure, such as "largest aspect ratio".
    dimension
        Dimension of the measure, "length", "size" [m^k], "angle" [degrees] or "" for numbers.
    median
        Median of the measure over all elements.
    value
        Value of the worst element.
    elements
        Ids of the elements, the worst first.
    values
        Values of these elements.
    """

    name: str
    dimension: str
    median: float
    value: float
    elements: tuple[int, ...]
    values: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class MeshQuality:
    """Shapes of the elements of a mesh, and all its faults; `mesh_quality` makes it.

    Elements with nodes that are not finite, or with the same corner twice, have NaN.

    Attributes
    ----------
    mesh
        Mesh whose elements were measured.
    size
        (nt,) lengths, areas or volumes [m^k], positive for both orientations.
    aspect
        (nt,) longest edge over smallest height at the worst of an element's points; 1.22 for a regular tetrahedron, 1 for a
        segment, a square or a cube; infinite for zero volume.
    angles
        (2, nt) smallest and largest angle [degrees]: for tetrahedra and hexahedra between faces (dihedral; 70.5 in a regular
        tetrahedron), for triangles and quadrilaterals between edges. By corners, as if edges were straight; NaN for segments.
    edges
        (2, nt) shortest and longest edge, from corner to corner [m].
    turned
        (nt,) whether an element has negative orientation, which is harmless; False where elements do not fill the space.
    parts
        (n,) nodes in each connected part, the largest first.
    faults
        All faults and doubts, with ids, cause and remedy; `fault.refused`: `System` refuses such a mesh.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import mesh_quality
    >>> quality = mesh_quality(skfem.MeshTet())          # a regular tetrahedron in a cube, and one at each of four corners
    >>> quality.size.round(4), quality.aspect.round(2)
    (array([0.1667, 0.1667, 0.1667, 0.3333, 0.1667]), array([2.45, 2.45, 2.45, 1.22, 2.45]))
    """

    mesh: ElementMesh
    size: Array
    aspect: Array
    angles: Array
    edges: Array
    turned: NDArray[np.bool_]
    parts: NDArray[np.int64]
    faults: tuple[Remark, ...]

    @property
    def sound(self) -> bool:
        """Whether the mesh can carry a body."""
        return not any(fault.refused for fault in self.faults)

    def worst(self, name: str, n: int = 5) -> Extreme:
        """Return the n worst elements by a measure.

        Parameters
        ----------
        name
            Name of the measure, such as "largest aspect ratio"; errors list all measures.
        n
            Number of elements.

        Raises
        ------
        StvkError
            if the measure is unknown, or n is not a positive integer.
        """
        values, sign, dimension = self._measures[choice("name", name, tuple(self._measures))]
        n = whole("n", n, "a number of elements, from 1", 1)
        known = np.flatnonzero(~np.isnan(values))
        if not len(known):
            return Extreme(name, dimension, np.nan, np.nan, (), ())
        order = known[np.argsort(-sign * values[known], kind="stable")[:n]]
        each = tuple(values[order].tolist())
        return Extreme(name, dimension, float(np.median(values[known])), each[0], tuple(order.tolist()), each)

    def extremes(self, n: int = 5) -> list[Extreme]:
        """Return the n worst elements by each measure that the elements have.

        Parameters
        ----------
        n
            Number of elements for each measure.
        """
        return [self.worst(name, n) for name, (values, _, _) in self._measures.items() if not np.isnan(values).all()]

    @cached_property
    def _measures(self) -> dict[str, tuple[Array, int, str]]:
        """Values by name, 1 if the largest and -1 if the smallest is the worst, and the dimension."""
        return {
            "largest aspect ratio": (self.aspect, 1, ""),
            "smallest angle": (self.angles[0], -1, "angle"),
            "largest angle": (self.angles[1], 1, "angle"),
            "smallest size": (self.size, -1, "size"),
            "largest size": (self.size, 1, "size"),
            "shortest edge": (self.edges[0], -1, "length"),
            "longest edge": (self.edges[1], 1, "length"),
        }

    def _repr_html_(self) -> str:
        head = ("measure", "worst", "median", "in")
        rows = [(one.name, f"{one.value:.4g}", f"{one.median:.4g}", name_ids(one.elements, "element")) for one in self.extremes(3)]
        faults = [("refused" if fault.refused else "doubtful", fault.text) for fault in self.faults]
        return html_table(f"MeshQuality: {self.mesh.nt} {self.mesh.kind}", [head, *rows, ("parts", len(self.parts)), *faults])

    def __repr__(self) -> str:
        parts = f"{len(self.parts)} part{'s' * (len(self.parts) != 1)}"
        negative = f"{self.turned.sum()} of {self.mesh.nt} elements with negative orientation"
        rows = [
            f"{one.name} {one.value:.4g} (median {one.median:.4g}) in {name_ids(one.elements, 'element')}"
            for one in self.extremes(3)
        ]
        found = [f"{'refused' if fault.refused else 'doubtful'}: {fault.text}" for fault in self.faults]
        return "\n".join([f"MeshQuality: {self.mesh.nt} {self.mesh.kind}, {parts}, {negative}", *rows, *found])


def mesh_quality(mesh: MeshLike, others: Sequence[ElementMesh] = ()) -> MeshQuality:
    """Return the shapes of all elements of a mesh, its worst elements and all of its faults.

    A mesh that `System` refuses is accepted here, and all of its faults are reported at once.

    Parameters
    ----------
    mesh
        Mesh as `System` takes it.
    others
        Meshes of cables and membranes on the same nodes, which connect parts, such as `system.body.beside`.

    Returns
    -------
    MeshQuality
        Sizes, aspect ratios and angles of the elements, the connected parts, and all faults.

    Raises
    ------
    MeshError
        for arrays that are not a mesh.

    Examples
    --------
    >>> import skfem
    >>> quality = mesh_quality(skfem.MeshTet().refined(1))
    >>> round(quality.worst("largest aspect ratio").value, 6), quality.sound, quality.parts
    (3.0, True, array([26]))
    >>> flat = mesh_quality(([[0, 1, 0, 1.0], [0, 0, 1, 1.0]], [[0, 0], [1, 1], [3, 1]]))
    >>> [fault.name for fault in flat.faults], flat.aspect.round(3)
    (['collapsed', 'unused'], array([ 2., nan]))
    """
    mesh = ElementMesh.of(mesh)
    nt, k = mesh.nt, mesh.k
    size, aspect, angles, edges = np.full(nt, np.nan), np.full(nt, np.nan), np.full((2, nt), np.nan), np.full((2, nt), np.nan)
    turned = np.zeros(nt, dtype=bool)
    with np.errstate(all="ignore"):
        finite, ordered = np.isfinite(mesh.p).all(axis=0), np.sort(mesh.t, axis=0)
        sound, retained = sound_elements(mesh, finite, (ordered[1:] == ordered[:-1]).any(axis=0))
        if len(retained):
            scale = scale_of(sound.p)  # so that volumes neither overflow nor underflow
            cells = Cells(sound.p / scale, sound.t, sound.element)
            lengths = edge_lengths(cells)
            size[retained] = points.sizes_of(cells.p, cells.t, cells.element, "usual") * scale**k
            aspect[retained], edges[:, retained] = aspect_ratios(cells), [scale * lengths.min(axis=0), scale * lengths.max(axis=0)]
            if k > 1:
                angles[:, retained] = _angles(cells)
            if k == mesh.d:
                turned[retained] = points.orientations(cells.p, cells.t, cells.element) < 0
        count = sizes_of_parts((mesh, *others))[1]
        found = (*faults(mesh, (*others, mesh)), *_doubts(mesh, aspect, edges))
    return MeshQuality(mesh, size, aspect, angles, edges, turned=turned, parts=np.sort(count[count > 0])[::-1], faults=found)


def _angles(cells: Cells) -> Array:
    """Return smallest and largest angle (2, nt) [degrees] between adjacent edges (k = 2) or faces (k = 3), by corners."""
    x = np.zeros((3, *cells.corners.shape))
    x[: cells.d] = cells.p[:, cells.corners]
    low, high = np.full(cells.nt, np.inf), np.full(cells.nt, -np.inf)
    for at, along, one, other in _corners_of_angles(cells.element):
        a, b = x[:, one] - x[:, at], x[:, other] - x[:, at]
        if cells.k == 3:  # across the edge from `at` to `along`, in which the faces meet
            edge = x[:, along] - x[:, at]
            square = (edge * edge).sum(axis=0)
            a, b = (side - edge * ((side * edge).sum(axis=0) / square) for side in (a, b))
        angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b, axis=0), axis=0), (a * b).sum(axis=0)))
        low, high = np.fmin(low, angle), np.fmax(high, angle)
    return np.where(np.isfinite([low, high]), [low, high], np.nan)


def _corners_of_angles(element: Element) -> Iterator[tuple[int, int, int, int]]:
    """Yield the local corners of each angle: its own, the end of the edge where two faces meet, and one on either side."""
    neighbours = {a: sorted({b for edge in element.edges for b in edge if a in edge} - {a}) for a in range(element.corners)}
    for at, others in neighbours.items():
        if element.k == 2:
            yield at, at, others[0], others[1]
            continue
        for along in others:
            if not element.is_simplex or at < along:  # the angle of a simplex is the same at both ends of an edge
                one, other = (b for b in others if b != along)
                yield at, along, one, other


def _doubts(mesh: ElementMesh, aspect: Array, edges: Array) -> Iterator[Remark]:
    """Yield doubts about elements that can carry a body, but make it slow or inaccurate."""
    flat = np.flatnonzero((aspect > FLAT) & np.isfinite(aspect))
    if len(flat):
        worst = flat[np.argsort(-aspect[flat], kind="stable")]
        text = (
            f"{name_ids(worst, 'element')}: flatter than 1:{FLAT:g}, the flattest 1:{aspect[worst[0]]:.3g}. They are too stiff, "
            "their stresses are poor, and explicit steps short. Remesh there, or let the mesher optimise (Gmsh: Mesh.Optimize = 1)."
        )
        yield Remark("slivers", flat, text, refused=False)
    usual = float(np.nanmedian(edges[1])) if not np.isnan(edges[1]).all() else 0.0
    short = np.flatnonzero(edges[0] < SHORT * usual)
    if len(short):
        worst = short[np.argsort(edges[0, short], kind="stable")]
        text = (
            f"{name_ids(worst, 'element')}: an edge shorter than {SHORT:g} of the usual longest one ({usual:.3g}), the shortest "
            f"{edges[0, worst[0]]:.3g}. It makes explicit steps short. Is it an unneeded detail of the CAD model? Remove it, or "
            "set a smallest element size (Gmsh: Mesh.MeshSizeMin)."
        )
        yield Remark("short edges", short, text, refused=False)
