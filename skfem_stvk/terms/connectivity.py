"""Terms with their own simplices: the elements that result on the nodes that all terms share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import real_array, shown, whole_array
from ..errors import MeshError, name_ids, name_known
from ..mesh import ElementMesh, MeshLike
from ..mesh.element import ELEMENTS, Element, named
from ..mesh.locations import checked_facets, checked_lines
from ..space import ONE_PROCESS, Communicator
from .loads.load import is_load


class Connected(NamedTuple):
    """Elements of a body, by their dimension, and the elements of each term.

    Attributes
    ----------
    mesh
        Elements of the highest dimension, with all nodes.
    `beside`
        Meshes of lower dimensions on the same nodes, the higher dimension first.
    terms
        The user's terms, with a region of their mesh in place of simplices.
    of
        Number of the mesh of each term: 0 if it is on `mesh`, or i + 1 if it is on `beside[i]`.
    source
        The mesh that terms were added to, or the bare points.
    """

    mesh: ElementMesh
    beside: tuple[ElementMesh, ...]
    terms: tuple[Any, ...]
    of: tuple[int, ...]
    source: ElementMesh | NDArray[np.float64]


def connected(value: MeshLike, terms: Sequence[Any]) -> Connected:
    """Return the meshes of a body from a mesh, or from bare points (d, n), and from the simplices of its terms.

    All simplices of one dimension form one mesh, and each term has a region of it. Terms with the same simplices are on the same
    elements. Terms without simplices are on the elements of the highest dimension.

    Raises
    ------
    MeshError
        if simplices do not fit the points or the mesh; if there are only points and an elastic law has no simplices.

    Examples
    --------
    >>> from skfem_stvk import StVK
    >>> bag = [StVK(young=1.0, poisson=0.3, simplices=[[0], [1], [2]]), StVK(young=1.0, area=0.1, simplices=[[2], [3]])]
    >>> found = connected(np.array([[0.0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 0]]), bag)
    >>> found.mesh, found.beside, found.of
    (ElementMesh: 1 triangles in 3D, 4 vertices, (ElementMesh: 1 segments in 3D, 4 vertices,), (0, 1))
    """
    points, with_elements = _points(value), [term for term in terms if _has_own_elements(term)]
    mesh = ElementMesh.of(value) if points is None else None
    if mesh is not None and not with_elements:
        return Connected(mesh, (), tuple(terms), (0,) * len(terms), mesh)
    if points is not None:
        _refuse_without_simplices(terms, with_elements)
    p = mesh.p if mesh is not None else points
    degree = 1 if mesh is None else mesh.element.degree
    assert p is not None
    blocks: dict[str, list[tuple[NDArray[np.int32], Any]]] = {}  # by element: simplices, and how the user supplies them
    regions: dict[int, tuple[str, slice]] = {}
    for number, term in enumerate(terms):
        if _has_own_elements(term):
            t, element = simplices_of(term.simplices, p, degree, mesh, f"{type(term).__name__} {number}: simplices")
            if mesh is not None and element.k >= mesh.k:
                raise MeshError(
                    f"{type(term).__name__} {number}: simplices are {element.name}, and the mesh has {mesh.kind}; expected "
                    "elements of lower dimension. To select elements of the mesh, give region=...; if all terms have their own "
                    "elements, give bare points, System(mesh.p, ...)."
                )
            comm = ONE_PROCESS if mesh is None else mesh.space.comm
            regions[number] = element.name, _positions(t, term.simplices, blocks.setdefault(element.name, []), comm)
    meshes = [] if mesh is None else [mesh]
    order = sorted(blocks, key=lambda name: -ELEMENTS[name].k)
    if len({ELEMENTS[name].k for name in order}) < len(order):
        raise MeshError(f"Got {', '.join(order)} as simplices; expected one kind of elements of each dimension.")
    for name in order:
        arrays, simplices = zip(*blocks[name], strict=True)
        t = np.concatenate(arrays, axis=1)
        own = ElementMesh(p, t, element=ELEMENTS[name]) if mesh is None else mesh.beside(t, ELEMENTS[name], simplices)
        meshes.append(own)
    numbers = {name: number for number, name in enumerate(order, start=len(meshes) - len(order))}
    resolved, of = list(terms), [0] * len(terms)
    for number, (name, part) in regions.items():
        of[number] = numbers[name]
        resolved[number] = terms[number].on(None if part == slice(0, meshes[of[number]].nt) else part)
    return Connected(meshes[0], tuple(meshes[1:]), tuple(resolved), tuple(of), p if mesh is None else mesh)


def simplices_of(
    value: Any, p: NDArray[np.float64], degree: int, mesh: ElementMesh | None, what: str
) -> tuple[NDArray[np.int32], Element]:
    """Return the simplices (n, nt) on points `p` (d, nv), and their element. They are user-supplied as nodes, or by the name of a
    boundary or of lines of the `mesh`.

    Messages begin with `what`. Simplices have the `degree` of the mesh.
    """
    if isinstance(value, str):
        if mesh is not None and mesh.k > 1 and value in mesh.boundaries:
            return checked_facets(mesh, value), named(mesh.element.facet)
        if mesh is not None and value in mesh.lines:
            return checked_lines(mesh, value), mesh.element.edge
        names = "there are points alone, without names." if mesh is None else name_known(value, {*mesh.boundaries, *mesh.lines})
        raise MeshError(f"{what} = {shown(value)}; expected (k + 1, n) nodes, or the name of a boundary or of lines; {names}")
    kinds = {
        element.n: element
        for element in ELEMENTS.values()
        if element.is_simplex and element.degree == degree and element.k <= len(p)
    }
    t = whole_array(value)
    if t is None or t.ndim != 2 or t.dtype == bool or len(t) not in kinds or not t.shape[1]:
        rows = ", ".join(f"{n} rows for {element.name}" for n, element in kinds.items())
        raise MeshError(f"{what} = {shown(value)}; expected (n, nt) ids of nodes from 0, one column for each element: {rows}.")
    nodes = p.shape[1] if mesh is None else mesh.space.count // mesh.d
    if len(bad := np.flatnonzero(((t < 0) | (t >= nodes)).any(axis=0))):
        raise MeshError(
            f"{what}: {name_ids(bad, 'element')} with ids of nodes outside 0 ... {nodes - 1}. Are they counted from 1? "
            "Subtract 1 then."
        )
    t = np.ascontiguousarray(t, dtype=np.int32)
    return t if mesh is None else mesh.local_cells(t, what), kinds[len(t)]


def _has_own_elements(term: Any) -> bool:
    """Return whether a term acts within its own elements; the simplices of a load are only the location where it acts."""
    return not is_load(term) and term.simplices is not None


def _points(value: Any) -> NDArray[np.float64] | None:
    """Return bare points (d, n); None for a mesh, and for input that the conversion to a mesh refuses."""
    if hasattr(value, "t") or hasattr(value, "cells"):
        return None
    points = real_array(value)
    return points if points is not None and points.ndim == 2 and len(points) in (1, 2, 3) else None


def _refuse_without_simplices(terms: Sequence[Any], with_elements: Sequence[Any]) -> None:
    """Refuse elastic laws without simplices if there are only points."""
    without = [
        f"{type(term).__name__} {number}"
        for number, term in enumerate(terms)
        if not is_load(term) and term.is_law and term.simplices is None
    ]
    if without or not with_elements:
        names_of_terms = ", ".join(without) or "No term"
        raise MeshError(
            f"Got points without elements, and {names_of_terms} {'have' if len(without) > 1 else 'has'} "
            f"{'no ' if without else ''}simplices. Give each law its own: StVK(..., simplices=t) with t (k + 1, n); or give a "
            "mesh, System((p, t), ...)."
        )


def _positions(t: NDArray[np.int32], simplices: Any, blocks: list[tuple[NDArray[np.int32], Any]], comm: Communicator) -> slice:
    """Return the positions of simplices among those of their kind; they are added unless the same ones exist in all parts."""
    begin = 0
    for block, _ in blocks:
        if not comm.any(not np.array_equal(block, t)):
            return slice(begin, begin + t.shape[1])
        begin += block.shape[1]
    blocks.append((t, simplices))
    return slice(begin, begin + t.shape[1])
