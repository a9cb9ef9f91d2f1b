"""Locations on a mesh for supports and loads: by name, by node ids, by a predicate of the coordinates, by a shape."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem.assembly.dofs import DofsView

from ..arguments import number, points, shown, whole_array
from ..errors import RegionError, name_ids, name_known
from ..space import Space
from .element import named
from .facets import MeshArrays, find_facets

#: Location on a mesh: the name of a boundary or of a node set; node ids, or a mask; or a predicate of coordinates `x` (d, n), as in
#: scikit-fem: `lambda x: x[0] == 0`. The shapes `Box`, `Plane` and `NearestNode` are predicates. The result of scikit-fem's
#: `basis.get_dofs(...)` means its nodes. Nodes are vertices and, in quadratic elements, edge midpoints.
Where: TypeAlias = str | ArrayLike | Callable[[NDArray[np.float64]], ArrayLike] | DofsView
#: Vertices are at the same point within this fraction of the size of the mesh: files keep fewer digits than arrays.
SAME_POINT = 1e-6


class LocationShape(ABC):
    """Location by its shape: a predicate of coordinates `x` (d, n) as data, allowed in all arguments that take a location."""

    points: ClassVar[tuple[str, ...]]  # names of the fields with one coordinate per dimension

    def __post_init__(self) -> None:
        for name, point in points(type(self).__name__, {name: getattr(self, name) for name in self.points}, RegionError).items():
            object.__setattr__(self, name, point)

    @property
    def dimension(self) -> int:
        """Number of components of its coordinates."""
        return len(getattr(self, self.points[0]))

    @property
    @abstractmethod
    def words(self) -> str:
        """Location in words, for messages."""

    @abstractmethod
    def holds(self, x: NDArray[np.float64], size: float, space: Space) -> NDArray[np.bool_]:
        """Return whether (n,) each of the points (d, n) of a body of this size is at the location.

        The `space` has d numbers at each point. Its other parts have the other points of a divided body.
        """

    def __call__(self, x: NDArray[np.float64]) -> NDArray[np.bool_]:
        x = np.asarray(x)
        return self.among(x, float(np.ptp(x, axis=1).max()), Space(x.size))

    def among(self, x: NDArray[np.float64], size: float, space: Space) -> NDArray[np.bool_]:
        """Return what `holds` does; refuse points of another dimension."""
        if len(x) != self.dimension:
            raise RegionError(f"{self.words} is in {self.dimension} dimensions, the mesh in {len(x)}: give {len(x)} components.")
        return self.holds(x, size, space)


@dataclass(frozen=True)
class Box(LocationShape):
    """Nodes within a box along the axes, its sides included; as a region, the elements with their centres in it.

    Nodes outside by less than 1e-6 of the size of the mesh count as inside.

    Parameters
    ----------
    low, high
        (d,) smallest and largest coordinates [m]; equal ones make the box flat.

    Raises
    ------
    RegionError
        for coordinates that are not finite, and if `low` is above `high`.

    Examples
    --------
    >>> from skfem_stvk import ElementMesh
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
    >>> vertices_at(mesh, Box((0, 0), (1, 0.5))), mesh.elements(Box((0, 0), (0.5, 0.5)))
    (array([0, 1]), array([0]))
    """

    points = "low", "high"
    low: tuple[float, ...]
    high: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if wrong := [axis for axis, a, b in zip("xyz", self.low, self.high, strict=False) if a > b]:
            raise RegionError(f"Box: low = {self.low} is above high = {self.high} along {', '.join(wrong)}. Exchange them there.")

    @property
    def words(self) -> str:
        return f"the box from {_written(self.low)} to {_written(self.high)}"

    def holds(self, x: NDArray[np.float64], size: float, space: Space) -> NDArray[np.bool_]:
        low, high, slack = np.array(self.low)[:, None], np.array(self.high)[:, None], SAME_POINT * size
        return np.asarray(((x >= low - slack) & (x <= high + slack)).all(axis=0))


@dataclass(frozen=True)
class Plane(LocationShape):
    """Nodes on a plane; in two dimensions on a line, in one at a point.

    Parameters
    ----------
    point
        (d,) coordinates of a point of the plane [m].
    normal
        (d,) normal of the plane, of any nonzero length.
    within
        Largest distance of nodes from the plane [m]; by default 1e-6 of the size of the mesh.

    Raises
    ------
    RegionError
        for coordinates that are not finite, a normal of length zero, and a distance that is not positive.

    Examples
    --------
    >>> from skfem_stvk import ElementMesh
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
    >>> vertices_at(mesh, Plane(point=(1, 0), normal=(1, 1)))
    array([1, 2])
    """

    points = "point", "normal"
    point: tuple[float, ...]
    normal: tuple[float, ...]
    within: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.normal):
            raise RegionError(f"Plane: normal = {self.normal}; expected a vector that is not zero, such as (0, 0, 1).")
        if self.within is not None:
            within = number("Plane: within", self.within, "a positive distance, or None", 0.0, error=RegionError)
            object.__setattr__(self, "within", within)

    @property
    def words(self) -> str:
        return f"the plane through {_written(self.point)} with normal {_written(self.normal)}"

    def holds(self, x: NDArray[np.float64], size: float, space: Space) -> NDArray[np.bool_]:
        normal = np.array(self.normal) / np.abs(self.normal).max()  # normalised without overflow
        distance = (normal / np.linalg.norm(normal)) @ (x - np.array(self.point)[:, None])
        return np.asarray(np.abs(distance) <= (SAME_POINT * size if self.within is None else self.within))


@dataclass(frozen=True)
class NearestNode(LocationShape):
    """The node nearest to a point; among several equally near nodes the first.

    Parameters
    ----------
    point
        (d,) coordinates of the point [m].

    Raises
    ------
    RegionError
        for coordinates that are not finite; on a mesh, if the distance of the point from all nodes is larger than the mesh.

    Examples
    --------
    >>> from skfem_stvk import ElementMesh
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
    >>> vertices_at(mesh, NearestNode((1.1, 0.8)))
    array([3])
    >>> vertices_at(mesh, NearestNode((0, 3000)))
    Traceback (most recent call last):
    skfem_stvk.errors.RegionError: The location: the node nearest to (0, 3000) is 2999 away from it, at (0, 1), and the mesh is 1
    large. Is the point in the units of the mesh?
    """

    points = ("point",)
    point: tuple[float, ...]

    @property
    def words(self) -> str:
        return f"the node nearest to {_written(self.point)}"

    def holds(self, x: NDArray[np.float64], size: float, space: Space) -> NDArray[np.bool_]:
        distance = np.linalg.norm(x - np.array(self.point)[:, None], axis=0)
        node = int(np.argmin(distance))
        nearest = space.comm.least(float(distance[node]))
        if nearest > size:
            _, there = min(space.comm.broadcast(space.comm.collect((float(distance[node]), x[:, node].tolist()))))
            raise RegionError(
                f"{self.words} is {nearest:.6g} away from it, at {_written(there)}, and the mesh is {size:.6g} large. "
                "Is the point in the units of the mesh?"
            )
        numbers = np.where(distance == nearest, space.numbers[:: len(x)], space.count)
        return np.asarray(numbers == space.comm.least(float(numbers.min())))


def _written(point: Any) -> str:
    return f"({', '.join(f'{one:.6g}' for one in point)})"


class LabelledMesh(MeshArrays):
    """Elements with names for some of their facets (m, n), nodes and elements."""

    boundaries: Mapping[str, NDArray[np.int32]]
    node_sets: Mapping[str, NDArray[np.int32]]
    subdomains: Mapping[str, NDArray[np.int32]]
    lines: Mapping[str, NDArray[np.int32]]

    @property
    @abstractmethod
    def space(self) -> Space:
        """Space of vectors with `d` numbers at each node."""

    def name_nodes(self, chosen: NDArray[np.bool_]) -> str:
        """Return the number of the chosen nodes (nv,) in the whole mesh, and the first few; all parts call this together."""
        first, count = self.space.few(chosen)
        return name_ids(first, self.word, count=count)

    def local_nodes(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the indices of those nodes of the whole mesh with these `ids` that this part has, in their order."""
        return ids


def vertices_at(mesh: LabelledMesh, where: Where, what: str = "The location") -> NDArray[np.int64]:
    """Return ids of the nodes at a location, at least one: listed ids, each once, in the user's order, others ascending.

    Messages of the RegionError begin with the purpose `what`.

    >>> from skfem_stvk import ElementMesh
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]], node_sets={"corner": [3]})
    >>> vertices_at(mesh, "corner"), vertices_at(mesh, lambda x: x[0] == 0), vertices_at(mesh, [2, 0])
    (array([3]), array([0, 2]), array([2, 0]))
    """
    if isinstance(where, str):
        ids = _named(mesh, where, what)
    elif callable(where):
        ids = _satisfying(mesh, where, what)
    else:
        if isinstance(where, DofsView):
            refuse_foreign(mesh, where, what)
        ids = _listed(mesh, where, f"{what}: the {mesh.words}", mesh.space.count // mesh.d)
        unique, counts = np.unique(ids, return_counts=True)
        if len(unique) < len(ids):
            raise RegionError(
                f"{what}: the {mesh.words} name {name_ids(unique[counts > 1], mesh.word)} more than once. Name each once; values "
                "follow their order."
            )
        ids = mesh.local_nodes(ids)
    if not mesh.space.comm.any(len(ids) > 0):
        raise RegionError(f"{what}: no {mesh.word} there. {describe(where)} is empty.")
    return ids


def facets_at(mesh: LabelledMesh, where: Where, what: str = "The location") -> NDArray[np.int32]:
    """Return the facets (m, n) at a location, each once: those of a named boundary, or boundary facets with all nodes there.

    >>> from skfem_stvk import ElementMesh
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
    >>> facets_at(mesh, lambda x: x[0] == 0)
    array([[2],
           [0]], dtype=int32)
    """
    if isinstance(where, str) and where in mesh.boundaries:
        return checked_facets(mesh, where)
    ids = vertices_at(mesh, where, what)
    there = np.zeros(mesh.nv, dtype=bool)
    there[ids] = True
    facets = mesh.surface[:, there[mesh.surface].all(axis=0)]
    if not mesh.space.comm.any(facets.shape[1] > 0):
        count = int(mesh.space.comm.total(float(mesh.surface.shape[1])))
        raise RegionError(
            f"{what}: {describe(where)} has {mesh.name_nodes(there)}, but none of the {count} boundary facets "
            f"has all its {mesh.words} there. Widen it; for forces on {mesh.words} there is NodalLoad."
        )
    return facets


def in_value_order(mesh: LabelledMesh, where: Where, facets: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the nodes (n,) of the facets at a location in the order of values for them, that of `vertices_at`."""
    ids = np.unique(facets).astype(np.int64)
    if isinstance(where, str) or callable(where):
        return ids
    listed = vertices_at(mesh, where)
    return listed[np.isin(listed, ids)]


def describe(where: Any) -> str:
    """Return a location in words.

    >>> describe("tip"), describe([3, 4]), describe(lambda x: x[0] == 0)
    ("'tip'", '2 vertices (3, 4)', "the predicate '<lambda>'")
    >>> describe(Box((0, 0), (1, 0.5)))
    'the box from (0, 0) to (1, 0.5)'
    """
    if isinstance(where, str):
        return shown(where)
    if isinstance(where, LocationShape):
        return where.words
    if callable(where):
        return f"the predicate {getattr(where, '__name__', type(where).__name__)!r}"
    ids = _array(where)
    if ids is None or ids.ndim != 1:
        return shown(where)
    return name_ids(np.flatnonzero(ids) if ids.dtype == bool else ids, "vertex")


def _named(mesh: LabelledMesh, name: str, what: str) -> NDArray[np.int64]:
    _refuse_unknown(mesh, name, what)
    on_boundary = None
    if name in mesh.boundaries:
        on_boundary = mesh.space.union(np.unique(checked_facets(mesh, name)).astype(np.int64), mesh.nv)
    of_set = f"Node set {name!r}"
    in_set = np.unique(_listed(mesh, mesh.node_sets[name], of_set, mesh.nv)) if name in mesh.node_sets else None
    if on_boundary is None or in_set is None:
        return in_set if on_boundary is None else on_boundary  # type: ignore[return-value]
    if mesh.space.comm.any(not np.array_equal(on_boundary, in_set)):
        counts = [mesh.space.few(np.isin(np.arange(mesh.nv), ids))[1] for ids in (on_boundary, in_set)]
        raise RegionError(
            f"{what}: {name!r} is the name of a boundary with {counts[0]} {mesh.words} and of a node set with {counts[1]} "
            f"others. Say which: mesh.node_sets[{name!r}], or np.unique(mesh.boundaries[{name!r}])."
        )
    return in_set


def _refuse_unknown(mesh: LabelledMesh, name: str, what: str) -> None:
    known = {*mesh.boundaries, *mesh.node_sets}
    if name not in known:
        hint = (
            f" It is a subdomain: for its {mesh.words}, np.unique(mesh.t[:, mesh.elements(name)])."
            if name in mesh.subdomains
            else ""
        )
        raise RegionError(f"{what}: the mesh has no boundary or node set {shown(name)}; {name_known(name, known)}{hint}")


def checked_facets(mesh: LabelledMesh, name: str) -> NDArray[np.int32]:
    """Return the facets (m, n) of a named boundary, each once."""
    return _checked(mesh, mesh.boundaries[name], named(mesh.element.facet).n, f"Boundary {name!r}", "facet")


def checked_lines(mesh: LabelledMesh, name: str) -> NDArray[np.int32]:
    """Return the segments (m, n) of named lines, each once."""
    return _checked(mesh, mesh.lines[name], mesh.element.edge.n, f"Lines {name!r}", "segment")


def _checked(mesh: LabelledMesh, value: Any, m: int, what: str, word: str) -> NDArray[np.int32]:
    """Return the nodes (m, n) of facets or segments, each once; refuse other arrays with a RegionError that begins with `what`."""
    ids = np.asarray(value)
    if ids.ndim != 2 or len(ids) != m or not mesh.space.comm.any(ids.size > 0) or ids.dtype.kind not in "iu":
        raise RegionError(f"{what} has shape {ids.shape} and dtype {ids.dtype}; expected ({m}, n), n > 0: the nodes of {word}s.")
    if len(bad := np.flatnonzero(((ids < 0) | (ids >= mesh.nv)).any(axis=0))):
        raise RegionError(f"{what}: {name_ids(bad, word)} with {mesh.word} ids outside 0 ... {mesh.nv - 1}.")
    return ids[:, np.unique(find_facets(ids, ids, mesh.nv))].astype(np.int32)


def _satisfying(mesh: LabelledMesh, predicate: Callable[[Any], Any], what: str) -> NDArray[np.int64]:
    try:
        if isinstance(predicate, LocationShape):
            mask = predicate.among(mesh.p, float(mesh.extent.max()), mesh.space)
        else:
            mask = np.asarray(predicate(mesh.p.copy()))
    except RegionError as error:  # from a shape, with its own message
        raise RegionError(f"{what}: {error}") from error
    except Exception as error:
        raise RegionError(
            f"{what}: {describe(predicate)} failed with {type(error).__name__}: {error}. It gets coordinates x of shape "
            f"{mesh.p.shape}: x[0] ... x[{mesh.d - 1}]."
        ) from error
    if mask.dtype != bool or mask.shape != (mesh.nv,):
        raise RegionError(
            f"{what}: {describe(predicate)} returned shape {mask.shape} and dtype {mask.dtype}; expected a mask ({mesh.nv},), "
            f"True for the {mesh.words} that are meant, such as lambda x: x[0] == 0."
        )
    if not mesh.space.comm.any(bool(mask.any())):
        nodes = f"{mesh.space.count // mesh.d} {mesh.words}"
        box = ", ".join(f"x[{i}] from {low:.9g} to {high:.9g}" for i, (low, high) in enumerate(mesh.bounds))
        if isinstance(predicate, LocationShape):
            raise RegionError(f"{what}: none of the {nodes} is in {describe(predicate)}. The mesh has {box}.")
        raise RegionError(
            f"{what}: none of the {nodes} satisfies {describe(predicate)}. The mesh has {box}. Coordinates that are "
            "compared need a tolerance: np.isclose(x[0], 1)."
        )
    return np.flatnonzero(mask)


def _listed(mesh: LabelledMesh, value: Any, what: str, count: int) -> NDArray[np.int64]:
    """Return listed ids of `count` vertices in their order, or the ids of a mask."""
    ids = _array(value)
    if ids is None or ids.ndim != 1:
        raise RegionError(
            f"{what} are {shown(value)}; expected the name of a boundary or of a node set, a list of {mesh.word} ids, a mask, a "
            "predicate such as lambda x: x[0] == 0, or what scikit-fem's basis.get_dofs(...) returned."
        )
    if ids.dtype == bool:
        if ids.shape != (count,):
            raise RegionError(f"{what} are a mask of shape {ids.shape}; expected one value for each of the {count} {mesh.words}.")
        return np.flatnonzero(ids)
    if len(bad := ids[(ids < 0) | (ids >= count)] if ids.size else ids):
        raise RegionError(f"{what} name {name_ids(bad, mesh.word)} outside 0 ... {count - 1}.")
    return ids.astype(np.int64)


def _array(value: Any) -> NDArray[Any] | None:
    """Return ids or a mask as an array; None for anything else."""
    return nodes_of(value) if isinstance(value, DofsView) else whole_array(value)


def nodes_of(view: DofsView) -> NDArray[Any]:
    """Return the nodes of a view, possibly of another mesh: its vertices in its own order, then its edge midpoints."""
    dofs, d = view.obj, len(view.obj.nodal_dofs)
    others = [every[0, ix] // d for every, ix in _other_dofs(view)] if d else []
    return np.concatenate([np.arange(dofs.topo.nvertices)[view.nodal_ix], *others]).astype(np.int64)


def dofs_of(mesh: MeshArrays, view: DofsView, what: str) -> NDArray[np.int64]:
    """Return degrees of freedom of the view on this mesh, ascending; components that were dropped from it are not included.

    >>> import skfem
    >>> from skfem_stvk import ElementMesh
    >>> square = skfem.MeshTri()
    >>> view = skfem.Basis(square, skfem.ElementVector(skfem.ElementTriP1())).get_dofs(lambda x: x[0] == 0)
    >>> nodes_of(view), dofs_of(ElementMesh.of(square), view.keep("u^2"), "fixed")
    (array([0, 2]), array([1, 5]))
    """
    refuse_foreign(mesh, view, what)
    return np.unique(view.flatten()).astype(np.int64)


def refuse_foreign(mesh: MeshArrays, view: DofsView, what: str) -> None:
    """Refuse degrees of freedom of a basis on another mesh, or of elements other than vectors with the nodes of this mesh."""
    dofs, numbers = view.obj, np.arange(mesh.p.size).reshape(mesh.nv, mesh.d).T
    count, theirs = int(mesh.corners.max()) + 1 if mesh.element.degree > 1 else mesh.nv, dofs.topo.nvertices
    p, own = dofs.topo.doflocs[:, :theirs], mesh.p[:, :count]
    if p.shape != own.shape or np.abs(p - own).max() > SAME_POINT * np.ptp(own, axis=1).max():
        difference = f"{theirs} vertices in {len(p)}D" if p.shape != own.shape else "as many vertices elsewhere"
        raise RegionError(
            f"{what}: scikit-fem's degrees of freedom are of another mesh, with {difference}; this one has {count} vertices in "
            f"{mesh.d}D. Take them from a basis on the mesh of the system."
        )
    every = [dofs.nodal_dofs, *(of for of, _ in _other_dofs(view))]
    if any(len(of) != mesh.d for of in every) or not np.array_equal(np.concatenate(every, axis=1), numbers):
        expected = f"{'linear' if mesh.element.degree == 1 else 'quadratic'} vectors with {mesh.d} components"
        raise RegionError(
            f"{what}: scikit-fem's degrees of freedom are of {_in_words(dofs.element)}; expected those of {expected}, such as "
            f"ElementVector({mesh.element.scikit_fem.__name__}()). Vertices alone can be given by their ids: view.nodal_ix."
        )


def _other_dofs(view: DofsView) -> list[tuple[NDArray[Any], Any]]:
    """Return all degrees of freedom (d, n) of edges, facets and interiors, if there are any, and a mask of those in the view."""
    dofs = view.obj
    every = (dofs.edge_dofs, view.edge_ix), (dofs.facet_dofs, view.facet_ix), (dofs.interior_dofs, view.interior_ix)
    return [(of, ix) for of, ix in every if of.size]


def _in_words(element: Any) -> str:
    """Return an element in words, with the element that a vector element repeats."""
    inner = getattr(element, "elem", None)
    return type(element).__name__ + (f"({type(inner).__name__}())" if inner is not None else "")
