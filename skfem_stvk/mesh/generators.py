"""Generated meshes: boxes, bars and cylinders, with named boundaries and all elements of the same orientation."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array, array, check_index_range, choice, number, real_array, shown, whole
from ..errors import MeshError
from .element import Element, named
from .mesh import ElementMesh
from .points import orientations

#: Kinds of elements of a box by its dimension, the default first.
KINDS = {1: ("segments",), 2: ("triangles", "quadrilaterals"), 3: ("tetrahedra", "hexahedra")}
#: Sides of a box along each axis, with the smallest and the largest coordinate, as scikit-fem's `with_defaults` names them.
SIDES = (("left", "right"), ("bottom", "top"), ("front", "back"))


def box(size: Any, cells: Any, element: str | None = None, origin: Any = None) -> ElementMesh:
    """Return a box along the axes in one, two or three dimensions.

    Boundaries are "left" and "right" (least and largest x), "bottom" and "top" (y), "front" and "back" (z), as scikit-fem's
    `mesh.with_defaults()` names them. A cell is a quadrilateral or a hexahedron, or it is split into two triangles or six
    tetrahedra.

    Parameters
    ----------
    size
        (d,) length along each axis [m], d = 1, 2 or 3; a number for one dimension.
    cells
        (d,) number of cells along each axis; a number for the same along all.
    element
        Kind of the elements, "segments", "triangles", "quadrilaterals", "tetrahedra" or "hexahedra"; by default simplices.
    origin
        (d,) corner with the least coordinates [m], by default 0.

    Raises
    ------
    MeshError
        for lengths that are not positive, numbers of cells that are not whole, and elements of another dimension.

    Examples
    --------
    >>> mesh = box(size=(2.0, 1.0, 1.0), cells=(4, 2, 2))
    >>> mesh, sorted(mesh.boundaries)
    (ElementMesh: 96 tetrahedra in 3D, 45 vertices, ['back', 'bottom', 'front', 'left', 'right', 'top'])
    >>> box(1.0, 8), box((2.0, 1.0), 4, "quadrilaterals")
    (ElementMesh: 8 segments in 1D, 9 vertices, ElementMesh: 16 quadrilaterals in 2D, 25 vertices)
    """
    lengths = _lengths(size)
    d = len(lengths)
    counts = _counts("cells", cells, d)
    kind = choice("element", KINDS[d][0] if element is None else element, KINDS[d], MeshError)
    expected = f"({d},) coordinates of the corner, as many as the size has"
    start = np.zeros(d) if origin is None else array("origin", origin, (d,), expected, MeshError)
    check_index_range(int(np.prod([count + 1.0 for count in counts])), "vertices")
    axes = [low + np.linspace(0.0, length, count + 1) for low, length, count in zip(start, lengths, counts, strict=True)]
    grid = named(kind).mesh.init_tensor(*axes)
    p, t = grid.p, positively_oriented(grid.p, grid.t, named(kind))
    mesh = ElementMesh(p, t, element=named(kind))
    ends = [(axis, SIDES[axis][end], axes[axis][-end]) for axis in range(d) for end in (0, 1)]
    return mesh.with_boundaries({side: p[axis] == end for axis, side, end in ends})


def bar(length: float, width: float, cells: Any, element: str = "tetrahedra") -> ElementMesh:
    """Return a bar of square cross-section about the x axis, from x = 0 on; boundaries are those of `box`.

    Parameters
    ----------
    length
        Length along x [m].
    width
        Width and height of the cross-section [m].
    cells
        Number of cells along x, and across.
    element
        Kind of the elements, "tetrahedra" or "hexahedra".

    Raises
    ------
    MeshError
        as `box`.

    Examples
    --------
    >>> mesh = bar(length=1.0, width=0.1, cells=(20, 2))
    >>> mesh.nt, mesh.p.min(axis=1), mesh.p.max(axis=1)
    (480, array([ 0.  , -0.05, -0.05]), array([1.  , 0.05, 0.05]))
    """
    length, width = _length("length", length), _length("width", width)
    along, across = _counts("cells", cells, 2, "along x, and across")
    choice("element", element, KINDS[3], MeshError)
    return box((length, width, width), (along, across, across), element, (0.0, -width / 2, -width / 2))


def cylinder(radius: float, length: float, cells: Any, inner_radius: float = 0.0) -> ElementMesh:
    """Return a cylinder of tetrahedra about the x axis, from x = 0 on, solid or hollow.

    Boundaries are "left" (x = 0), "right", "side", and for a hollow cylinder "inside". The nodes of the side lie on the cylinder.
    Its facets are flat, so that the volume of a solid one with `n` facets around is `n/(2 pi) sin(2 pi/n)` of the cylinder's.

    Parameters
    ----------
    radius
        Outer radius [m].
    length
        Length along x [m].
    cells
        Number of cells along x; and across, from the axis or the bore to the side.
    inner_radius
        Radius of the bore [m], 0 for none.

    Raises
    ------
    MeshError
        for lengths that are not positive, numbers of cells that are not integers, and a bore that does not fit.

    Examples
    --------
    >>> mesh = cylinder(radius=0.5, length=2.0, cells=(8, 2))
    >>> mesh, sorted(mesh.boundaries)
    (ElementMesh: 576 tetrahedra in 3D, 171 vertices, ['left', 'right', 'side'])
    """
    radius, length = _length("radius", radius), _length("length", length)
    within = f"a number from 0 to less than radius = {radius:g}"
    bore = number("inner_radius", inner_radius, within, 0.0, np.nextafter(radius, 0.0), error=MeshError, closed=True)
    along, across = _counts("cells", cells, 2, "along x, and across")
    check_index_range(18 * along * across**2, "elements")
    flat, triangles, rim = _disc(radius, across) if bore == 0 else _ring(bore, radius, across)
    n = flat.shape[1]
    layers = np.linspace(0.0, length, along + 1)
    p = np.vstack([np.repeat(layers, n), np.tile(flat, along + 1)])
    bottom = np.sort(triangles, axis=0)
    a, b, c = (bottom[:, None, :] + n * np.arange(along)[:, None]).reshape(3, -1)
    prisms = (
        (a, b, c, c + n),
        (a, b, b + n, c + n),
        (a, a + n, b + n, c + n),
    )  # from the first node of each side, as for neighbours
    t = np.concatenate([np.stack(nodes) for nodes in prisms], axis=1)
    mesh = ElementMesh(p, positively_oriented(p, t, named("tetrahedra")))
    on_rim = {name: np.tile(np.isin(np.arange(n), ids), along + 1) for name, ids in rim.items()}
    return mesh.with_boundaries({"left": p[0] == layers[0], "right": p[0] == layers[-1], **on_rim})


def _disc(radius: float, rings: int) -> tuple[Array, Array, dict[str, Array]]:
    """Return the nodes (2, n) of a disc on rings of 6, 12, 18, ..., triangles (3, nt), and the nodes of its rim."""
    counts = [6 * ring for ring in range(1, rings + 1)]
    circles = [_circle(radius * ring / rings, count) for ring, count in enumerate(counts, 1)]
    flat = np.concatenate([np.zeros((2, 1)), *circles], axis=1)
    starts = np.cumsum([0, 1, *counts])
    triangles = []
    for ring in range(rings):
        outer, inner = 6 * (ring + 1), max(6 * ring, 1)
        sector = np.arange(6)[:, None]
        out, step = np.arange(ring + 1), np.arange(ring)
        first = [starts[ring + 1] + (sector * (ring + 1) + out + i) % outer for i in (0, 1)]
        triangles.append(np.stack([starts[ring] + (sector * ring + out) % inner, *first]).reshape(3, -1))
        second = [starts[ring] + (sector * ring + step + i) % inner for i in (0, 1)]
        triangles.append(np.stack([*second, starts[ring + 1] + (sector * (ring + 1) + step + 1) % outer]).reshape(3, -1))
    return flat, np.concatenate(triangles, axis=1), {"side": np.arange(starts[-2], starts[-1])}


def _ring(bore: float, radius: float, across: int) -> tuple[Array, Array, dict[str, Array]]:
    """Return the same as `_disc` with a bore; its cells are about as long as wide, each split into two triangles."""
    around = max(12, round(np.pi * (bore + radius) / ((radius - bore) / across)))
    circles = [_circle(r, around) for r in np.linspace(bore, radius, across + 1)]
    this, following = np.arange(around), (np.arange(around) + 1) % around
    triangles = []
    for inner, outer in pairwise(around * np.arange(across + 1)):
        triangles += [(inner + this, outer + this, outer + following), (inner + this, outer + following, inner + following)]
    rim = {"inside": this, "side": around * across + this}
    return np.concatenate(circles, axis=1), np.concatenate([np.stack(ids) for ids in triangles], axis=1), rim


def _circle(radius: float, count: int) -> Array:
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle)])


def positively_oriented(p: Array, t: NDArray[Any], element: Element) -> NDArray[np.int32]:
    """Return linear elements (n, nt) of positive volume: inverted ones with two of their axes exchanged."""
    t, nodes = np.array(t, dtype=np.int32), element.nodes
    if element.is_simplex:
        mirrored = np.array([*range(element.n - 2), element.n - 1, element.n - 2])
    else:
        mirrored = np.array(
            [int(np.flatnonzero((nodes == node).all(axis=1))[0]) for node in nodes[:, [1, 0, *range(2, element.k)]]]
        )
    negative = orientations(p, t, element) < 0
    t[:, negative] = t[mirrored][:, negative]
    return t


def _length(name: str, value: Any) -> float:
    return number(name, value, "a positive length", 0.0, error=MeshError)


def _lengths(size: Any) -> Array:
    """Return positive lengths (d,)."""
    expected = "one to three positive lengths, one along each axis"
    lengths = real_array(size)
    lengths = array("size", size if lengths is None or lengths.ndim else lengths[None], (None,), expected, MeshError)
    if not 1 <= len(lengths) <= 3 or (lengths <= 0).any():
        raise MeshError(f"size = {shown(size)}; expected {expected}.")
    return lengths


def _counts(name: str, value: Any, n: int, meaning: str = "along each axis") -> list[int]:
    """Return `n` numbers of cells, at least 1 each."""
    expected = f"{n} whole number{'s' * (n > 1)} of cells from 1 on, {meaning}"
    counts = list(value) if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim == 1) else [value] * n
    if len(counts) != n:
        raise MeshError(f"{name} = {shown(value)}; expected {expected}.")
    return [whole(name, count, expected, 1, error=MeshError) for count in counts]
