"""Mesh of elements of one kind as bare arrays, the basis of all computations in the package."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee
from skfem.assembly.dofs import DofsView
from skfem.mesh.mesh_dg import MeshDG

from ..arguments import check_index_range, frozen, number, real_array, shown, whole, whole_array
from ..errors import MeshError, RegionError, name_ids, name_known, warn
from ..kernels.threads import threads
from ..space import Space
from .element import ELEMENTS, Element, linear_simplex, named
from .facets import NamedFacets, edges_of, further_nodes, with_midpoints
from .locations import Box, LabelledMesh, checked_facets, checked_lines, describe, facets_at, vertices_at

if TYPE_CHECKING:
    from .content import Content

#: Meshes that `System` and `verify` accept: a scikit-fem mesh, arrays `(p, t)`, a `meshio.Mesh`, or an `ElementMesh`.
MeshLike: TypeAlias = Any

EXAMPLE_ELEMENT = "ELEMENTS['hexahedra']"


@dataclass(frozen=True, eq=False)
class ElementMesh(LabelledMesh):
    """Mesh of elements of dimension `k` in a space of dimension `d >= k`, all of one kind.

    Nodes are the vertices, followed in quadratic elements by the midpoints of their edges. They are numbered as scikit-fem numbers
    the degrees of freedom of the same element. Tetrahedra have one midpoint on each of `mesh.edges`, triangles on each of
    `mesh.facets`, and segments one each.

    Parameters
    ----------
    p
        (d, nv) coordinates of the nodes [m], as in scikit-fem.
    t
        (n, nt) nodes of the elements, in scikit-fem's local order; both orientations are allowed.
    subdomains
        Element ids by name.
    boundaries
        Facets by name, each as an (m, n) array of the nodes of a facet: its corners, then edge midpoints.
    node_sets
        Node ids by name.
    element
        The kind of elements, by default the linear simplices with as many vertices.
    lines
        Segments by name, each as an (m, n) array of the nodes of a segment: its ends, then its midpoint. Cables of a solid.

    Raises
    ------
    MeshError
        if the arrays do not have these shapes, or an index is out of range.

    Examples
    --------
    >>> cable = ElementMesh(p=[[0, 1, 2], [0, 0, 1], [0, 0, 1]], t=[[0, 1], [1, 2]])
    >>> cable
    ElementMesh: 2 segments in 3D, 3 vertices
    """

    p: NDArray[np.float64]
    t: NDArray[np.int32]
    subdomains: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    boundaries: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    node_sets: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)
    element: Element = field(default_factory=lambda: cast(Element, None))  # by default derived from t
    lines: Mapping[str, NDArray[np.int32]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        p = real_array(self.p)
        if p is None:
            raise MeshError(f"p = {shown(self.p)}; expected (d, nv) real numbers, the coordinates of the vertices.")
        p, t = np.array(p, order="C"), vertex_ids(self.t)
        if p.ndim != 2 or p.shape[0] not in (1, 2, 3):
            raise MeshError(f"p has shape {p.shape}; expected (d, nv) with d = 1, 2 or 3. Transpose arrays of shape (nv, d).")
        if self.element is not None and not isinstance(self.element, Element):
            raise MeshError(
                f"element = {shown(self.element)}; expected one of skfem_stvk.mesh.element.ELEMENTS, such as {EXAMPLE_ELEMENT}."
            )
        if self.element is not None:
            if t.ndim != 2 or len(t) != self.element.n or self.element.k > len(p):
                raise MeshError(
                    f"t has shape {t.shape} in a space of {p.shape[0]} dimensions; expected ({self.element.n}, nt), the nodes of "
                    f"{self.element.name}. Transpose arrays of shape (nt, {self.element.n})."
                )
        elif t.ndim != 2 or not 2 <= t.shape[0] <= p.shape[0] + 1:
            raise MeshError(
                f"t has shape {t.shape} in a space of {p.shape[0]} dimensions; expected (k + 1, nt) with 1 <= k <= {p.shape[0]}: "
                f"segments, triangles or tetrahedra. {_other_arrays(t)}"
            )
        if t.shape[1] == 0:
            raise MeshError("The mesh has no elements.")
        if not np.issubdtype(t.dtype, np.integer):
            raise MeshError(f"t has dtype {t.dtype}; expected integers (vertex ids from 0).")
        check_index_range(p.shape[1], "vertices")
        check_index_range(t.shape[1], "elements")
        if len(bad := np.flatnonzero(((t < 0) | (t >= p.shape[1])).any(axis=0))):
            raise MeshError(
                f"{name_ids(bad, 'element')}: vertex ids outside 0 ... {p.shape[1] - 1}. Are the ids counted from 1? Subtract 1 "
                "then."
            )
        if self.element is None:
            object.__setattr__(self, "element", linear_simplex(len(t) - 1))
        object.__setattr__(self, "p", p)
        object.__setattr__(self, "t", np.array(t, dtype=np.int32, order="C"))
        if self.element.degree == 2:
            check_numbers(self.t, self.element)
        for name in ("subdomains", "boundaries", "node_sets", "lines"):
            named = getattr(self, name)
            if named is not None and not isinstance(named, Mapping):
                raise MeshError(f"{name} = {shown(named)}; expected a dict of arrays of ids by name.")
            object.__setattr__(self, name, named if isinstance(named, NamedFacets) else frozen(named or {}))

    @classmethod
    def of(cls, mesh: MeshLike) -> ElementMesh:
        """Return the elements of a scikit-fem mesh, arrays `(p, t)`, a `meshio.Mesh`, or an `ElementMesh` (returned itself).

        MeshTet2 and MeshTri2 are quadratic simplices, with their curved edges. MeshHex1 and MeshQuad1 are hexahedra and
        quadrilaterals. Their nodes are scikit-fem's degrees of freedom of the same element. Arrays are linear simplices. A
        `meshio.Mesh` is read as `read_mesh` reads a file. Subdomains and boundaries are included. The facets of boundaries are
        computed at first use, which costs more than an assembly.

        Parameters
        ----------
        mesh
            A scikit-fem mesh, arrays `(p, t)`, a `meshio.Mesh`, or an `ElementMesh`.

        Raises
        ------
        MeshError
            for anything else, and for arrays that are not a mesh.
        """
        if isinstance(mesh, cls):
            return mesh
        if isinstance(mesh, skfem.Mesh):
            element = _element_of(mesh)
            p, t = mesh.doflocs, mesh.t
            if element.degree == 2:
                t = mesh.dofs.element_dofs
            return cls(p, t, mesh.subdomains or {}, NamedFacets(t, p.shape[1], element, mesh.boundaries or {}), element=element)
        if isinstance(mesh, tuple | list) and len(mesh) == 2:
            return cls(*mesh)
        if "meshio" in sys.modules and isinstance(mesh, sys.modules["meshio"].Mesh):  # else no meshio.Mesh exists
            from .content import content_in_memory

            return cls.made_of(content_in_memory(mesh, "The meshio.Mesh"), "The meshio.Mesh")
        raise MeshError(
            f"mesh = {shown(mesh)}; expected a scikit-fem mesh, arrays (p, t), a meshio.Mesh or an ElementMesh. Read files with "
            "read_mesh(path) or scikit-fem."
        )

    @classmethod
    def made_of(cls, content: Content, name: str) -> ElementMesh:
        """Return the mesh of the content of a file or a `meshio.Mesh`.

        Parameters
        ----------
        content
            Nodes, cells and sets.
        name
            Name of the source, with which messages begin.
        """
        try:
            return cls(*content)
        except MeshError as error:
            raise MeshError(f"{name}: {error}") from error

    @property
    def kind(self) -> str:
        """Elements in words, such as 'tetrahedra in 3D'."""
        return f"{self.element.name} in {self.d}D"

    def with_boundaries(self, boundaries: Mapping[str, Any]) -> ElementMesh:
        """Return the same mesh with further boundaries.

        Parameters
        ----------
        boundaries
            Locations by name, each a location (`mesh.locations.Where`) such as a predicate.

        Raises
        ------
        RegionError
            if there is no facet at a location.

        Examples
        --------
        >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
        >>> mesh.with_boundaries({"left": lambda x: x[0] == 0}).boundaries["left"]
        array([[2],
               [0]], dtype=int32)
        """
        if not isinstance(boundaries, Mapping):
            expected = "locations by name, such as {'left': lambda x: x[0] == 0}"
            raise RegionError(f"boundaries = {shown(boundaries)}; expected {expected}.")
        added = {name: facets_at(self, where, f"boundary {name!r}") for name, where in boundaries.items()}
        return replace(self, boundaries={**self.boundaries, **added})

    def with_degree(self, degree: int) -> ElementMesh:
        """Return the same body with shape functions of degree 1, on its corners, or 2, with straight edges.

        Boundaries and node sets are converted. With degree 2, a boundary also has the midpoints of its edges. A node set also has
        the midpoints of edges with both ends in the set, so that the vertices of a face give the whole face. With degree 1, both
        lose the midpoints.

        Parameters
        ----------
        degree
            Degree of the shape functions, 1 or 2.

        Raises
        ------
        MeshError
            for another degree, and for degree 2 of quadrilaterals and hexahedra.

        Warns
        -----
        StvkWarning
            if quadratic elements are reduced, with the number of curved edges.

        Examples
        --------
        >>> ElementMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [1], [2]]).with_degree(2)
        ElementMesh: 1 quadratic triangles in 2D, 6 nodes
        """
        degree = checked_degree(degree)
        if degree == self.element.degree:
            return self
        quadratic = self.element.linear.quadratic
        if quadratic is None:
            raise MeshError(
                f"degree = 2, but the elements are {self.element.name}, which are linear along each axis here. Leave the degree "
                "out, or split them: mesh.to_meshtet() or mesh.to_meshtri() in scikit-fem, then degree=2."
            )
        return self._to_linear() if degree == 1 else self._to_quadratic(quadratic)

    def _to_linear(self) -> ElementMesh:
        element, n = self.element.linear, self.nvertices
        edges = edges_of(self.corners, element, n)[0]
        midpoints = self.p[:, n : n + edges.shape[1]]
        off = np.abs(midpoints - self.p[:, edges].mean(axis=1)).max(axis=0)
        curved = np.count_nonzero(off > 1e-9 * self.extent.max())
        warn(
            f"The {self.nt} {self.element.name} are reduced to their corners, {n} vertices: {curved} of their {edges.shape[1]} "
            "edges are curved and become straight."
        )
        if isinstance(self.boundaries, NamedFacets):
            boundaries: Mapping[str, Any] = self.boundaries.on(self.corners, n, element)
        else:
            corners = self.facet.corners
            boundaries = {name: ids[:corners] if np.ndim(ids) == 2 else ids for name, ids in self.boundaries.items()}
        sets = {name: ids[ids < n] for name, ids in self._node_ids().items()}
        lines = {name: np.asarray(ends)[:2] for name, ends in self.lines.items()}
        return replace(self, p=self.p[:, :n], t=self.corners, boundaries=boundaries, node_sets=sets, element=element, lines=lines)

    def _to_quadratic(self, element: Element) -> ElementMesh:
        n = self.nv
        between, further = further_nodes(self.t, element, n)
        p = np.concatenate([self.p, *(self.p[:, corners].mean(axis=1) for corners in between)], axis=1)
        t = np.concatenate([self.t, n + further])
        if isinstance(self.boundaries, NamedFacets):
            boundaries: Mapping[str, Any] = self.boundaries.on(t, p.shape[1], element)
        else:
            facet = named(element.facet)
            boundaries = {
                name: _with_all_midpoints(checked_facets(self, name), facet, between, n, name) for name in self.boundaries
            }
        lines = {name: _with_all_midpoints(checked_lines(self, name), element.edge, between, n, name) for name in self.lines}
        sets: dict[str, NDArray[Any]] = {}
        for name, ids in self._node_ids().items():
            there = np.zeros(n, dtype=bool)
            there[ids] = True
            sets[name] = np.concatenate([ids, n + np.flatnonzero(np.concatenate([there[of].all(axis=0) for of in between]))])
        return replace(self, p=p, t=t, boundaries=boundaries, node_sets=sets, element=element, lines=lines)

    def scaled(self, factor: float) -> ElementMesh:
        """Return the same mesh with all coordinates times a positive factor.

        Parameters
        ----------
        factor
            Factor of the coordinates, such as 1e-3 for a file in mm in a model in m.

        Raises
        ------
        MeshError
            if the factor is not a finite positive number.

        Examples
        --------
        >>> ElementMesh(p=[[0, 2000, 3000]], t=[[0, 1], [1, 2]]).scaled(1e-3).p
        array([[0., 2., 3.]])
        """
        factor = number("factor", factor, "a positive number, such as 1e-3 from mm to m", 0.0, error=MeshError)
        return replace(self, p=factor * self.p)

    def renumbered(self) -> tuple[ElementMesh, NDArray[np.int32]]:
        """Return the same body with its vertices in reverse Cuthill-McKee order, and the old number of each new node (nv,).

        Rows of K of neighbouring nodes are then close in memory: K of a randomly numbered mesh takes two thirds of the time
        (`docs/measurements/speed.md`). Boundaries and node sets are renumbered; elements keep their order. A field `x` (nv, d) of
        this mesh is `x[nodes]` on the new mesh.

        Examples
        --------
        >>> line = ElementMesh(p=[[0, 2, 1, 3]], t=[[0, 1, 2], [2, 3, 1]])
        >>> mesh, nodes = line.renumbered()
        >>> mesh.p, nodes
        (array([[3., 2., 1., 0.]]), array([3, 1, 2, 0], dtype=int32))
        """
        n, element = self.nvertices, self.element
        a, b = edges_of(self.corners, element, n)[0]
        links = coo_matrix((np.ones(2 * len(a), dtype=np.int8), (np.append(a, b), np.append(b, a))), shape=(n, n)).tocsr()
        nodes = reverse_cuthill_mckee(links, symmetric_mode=True).astype(np.int32)
        number = np.empty(self.nv, dtype=np.int32)
        number[nodes] = np.arange(n, dtype=np.int32)
        if element.degree == 2:
            further = further_nodes(number[self.corners], element, n)[1]
            midpoints = np.empty(self.nv - n, dtype=np.int32)
            midpoints[further] = self.t[element.corners :]
            number[midpoints] = np.arange(n, self.nv, dtype=np.int32)
            nodes = np.append(nodes, midpoints)
        boundaries = {name: number[np.asarray(facets)] for name, facets in self.boundaries.items()}
        sets = {name: np.sort(number[ids]) for name, ids in self._node_ids().items()}
        lines = {name: number[np.asarray(ends)] for name, ends in self.lines.items()}
        mesh = replace(self, p=self.p[:, nodes], t=number[self.t], boundaries=boundaries, node_sets=sets, lines=lines)
        return mesh, nodes

    def ends(self) -> NDArray[np.int32] | None:
        """Return the two nodes (nv, 2) between which each edge midpoint lies; a vertex has itself twice.

        Return None for linear elements, and for elements with other nodes.

        Examples
        --------
        >>> ElementMesh(p=[[0.0, 2.0]], t=[[0], [1]]).with_degree(2).ends()
        array([[0, 0],
               [1, 1],
               [0, 1]], dtype=int32)
        """
        if self.element.means != self.element.edges:
            return None
        ends = np.repeat(np.arange(self.nv, dtype=np.int32)[:, None], 2, axis=1)
        for i, (a, b) in enumerate(self.element.edges):
            ends[self.t[self.element.corners + i]] = self.t[[a, b]].T
        return ends

    def beside(self, t: NDArray[np.int32], element: Element, simplices: Sequence[Any] = ()) -> ElementMesh:
        """Return the mesh of other elements on the same nodes.

        Parameters
        ----------
        t
            (n, nt) nodes of the elements.
        element
            Kind of the elements.
        simplices
            Names or nodes of the whole mesh, from which a part of a mesh numbers its elements; not used here.
        """
        return ElementMesh(self.p, t, element=element)

    def local_cells(self, t: NDArray[np.int32], what: str) -> NDArray[np.int32]:
        """Return those of other elements that belong to this part of a mesh, by the indices of their nodes: here all.

        Parameters
        ----------
        t
            (n, nt) nodes of the elements, by their numbers in the whole mesh.
        what
            Name of the elements, with which messages begin.
        """
        return t

    @cached_property
    def space(self) -> Space:
        """Space of vectors (d nv,) with `d` components at each node. A part of a divided mesh combines its results there."""
        return Space(self.p.size)

    @cached_property
    def element_count(self) -> int:
        """Number of elements of the whole mesh."""
        return self.nt

    @property
    def checked(self) -> bool:
        """Whether `check_mesh` has seen the whole mesh before."""
        return False

    @cached_property
    def node_numbers(self) -> NDArray[np.int64]:
        """Numbers (nv,) of the nodes in the whole mesh, which differ from their indices in a part of it."""
        return np.arange(self.nv)

    @cached_property
    def element_numbers(self) -> NDArray[np.int64]:
        """Numbers (nt,) of the elements in the whole mesh."""
        return np.arange(self.nt)

    def local_elements(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the indices of those elements that this part of a mesh has, in their order: here all.

        Parameters
        ----------
        ids
            (n,) numbers of elements in the whole mesh.
        """
        return ids

    def ids_of_all(self, elements: NDArray[np.int64], most: int | None = None) -> NDArray[np.int64]:
        """Return the numbers in the whole mesh of the elements that each part of a divided mesh names by its own ids, ascending.

        Parameters
        ----------
        elements
            Ids of elements of this part, ascending on one machine.
        most
            Return at most the first `most` numbers of a divided mesh.
        """
        if not self.space.comm.divided:
            return elements
        return np.unique(np.concatenate(self.space.comm.each(np.sort(self.element_numbers[elements])[:most])))[:most]

    def _node_ids(self) -> dict[str, NDArray[Any]]:
        """Return node sets as ids, from ids or masks."""
        return {name: vertices_at(self, np.asarray(ids), f"Node set {name!r}") for name, ids in self.node_sets.items() if len(ids)}

    def elements(self, region: str | Box | slice | NDArray[Any] | None) -> NDArray[np.int64]:
        """Return the ids (n,) of the elements of a region.

        Parameters
        ----------
        region
            A name in `subdomains`, a `Box` around their centres, element ids, a mask (nt,), or None for all; or a slice of the
            elements of this part. The centre of an element is the mean of its corners.

        Raises
        ------
        RegionError
            if the name is unknown, or the ids are empty, out of range or repeated.
        """
        if region is None or isinstance(region, slice):
            return np.arange(self.nt)[region or slice(None)]
        if isinstance(region, str):
            if region not in self.subdomains:
                raise RegionError(f"The mesh has no subdomain {shown(region)}; {name_known(region, self.subdomains)}")
            what, value = f"Subdomain {region!r}", self.subdomains[region]
        elif isinstance(region, Box):
            centres = self.p[:, self.corners].mean(axis=1)
            inside = np.flatnonzero(region.among(centres, float(self.extent.max()), self.space))
            if not self.space.comm.any(inside.size > 0):
                extent = f"{self.bounds[:, 0]} to {self.bounds[:, 1]}"
                raise RegionError(
                    f"The region is empty: no element has its centre in {describe(region)}. The mesh is from {extent}."
                )
            return inside
        else:
            if isinstance(region, DofsView):
                raise RegionError(
                    "The region is what scikit-fem's get_dofs returned, degrees of freedom; expected a name in subdomains, "
                    "element ids or a mask."
                )
            what, value = "The region", region
        ids, count = whole_array(value), self.element_count
        if ids is None or ids.ndim != 1 or not ids.size:
            raise RegionError(f"{what} is {shown(value)}; expected a list of at least one element id, a mask, or a name.")
        if ids.dtype == bool:
            if ids.shape != (count,):
                raise RegionError(f"{what} is a mask of shape {ids.shape}; expected one value for each of the {count} elements.")
            ids = np.flatnonzero(ids)
        if not ids.size:
            raise RegionError(f"{what} is a mask with no True; expected at least one element.")
        if len(bad := ids[(ids < 0) | (ids >= count)]):
            raise RegionError(f"{what} names {name_ids(bad, 'element')} outside 0 ... {count - 1}.")
        unique, counts = np.unique(ids, return_counts=True)
        if len(unique) < len(ids):
            raise RegionError(f"{what} names {name_ids(unique[counts > 1], 'element')} more than once.")
        return self.local_elements(ids.astype(np.int64))

    def __repr__(self) -> str:
        what = "vertices" if self.element.degree == 1 else "nodes"
        return f"ElementMesh: {self.nt} {self.kind}, {self.nv} {what}"


def _element_of(mesh: skfem.Mesh) -> Element:
    """Return the element of a scikit-fem mesh; refuse other meshes."""
    name = type(mesh).__name__
    if isinstance(mesh, MeshDG):
        raise MeshError(
            f"{name} is periodic or discontinuous: its elements have coordinates of their own for each vertex. Use the mesh that "
            "it was made of, and constrain its displacements."
        )
    of_mesh = {element.mesh: element for element in ELEMENTS.values() if element.mesh is not None}
    element = next((of_mesh[one] for one in type(mesh).__mro__ if one in of_mesh), None)
    if isinstance(mesh, skfem.MeshHex2 | skfem.MeshQuad2) and (element is None or element.degree == 1):
        linear = "MeshHex1" if mesh.dim() == 3 else "MeshQuad1"
        raise MeshError(
            f"{name} is of second order; hexahedra and quadrilaterals are linear along each axis here. Take {linear}(mesh.p[:, "
            f":mesh.nvertices], mesh.t), with straight edges; curved quadratic elements are MeshTet2 and MeshTri2."
        )
    if element is not None:
        return element
    raise MeshError(
        f"{name} is not a mesh of tetrahedra, hexahedra, triangles, quadrilaterals or segments; expected MeshTet1, MeshTet2, "
        "MeshHex1, MeshTri1, MeshTri2, MeshQuad1 or MeshLine1. Wedges can be split: mesh.to_meshtet()."
    )


def _with_all_midpoints(
    corners: NDArray[np.int32], kind: Element, between: Sequence[NDArray[np.int32]], n: int, name: str
) -> NDArray[np.int32]:
    """Return named facets or segments with their further nodes; refuse those on no edge of the elements (`further_nodes`)."""
    whole = with_midpoints(corners, kind, between, n)
    if len(bad := np.flatnonzero((whole < 0).any(axis=0))):
        raise MeshError(
            f"degree = 2, but {name_ids(bad, 'element')} of {name!r} {'are' if len(bad) > 1 else 'is'} on no edge of the other "
            "elements, so there are no midpoints. Leave the degree out."
        )
    return whole


def _other_arrays(t: NDArray[Any]) -> str:
    """Return a hint for an array of elements that are not linear simplices."""
    meant = [name for name, element in ELEMENTS.items() if t.ndim == 2 and not element.is_linear_simplex and element.n == len(t)]
    if not meant:
        return "Transpose arrays of shape (nt, k + 1)."
    arguments = "".join(f"{'' if name == meant[0] else ', or '}element=ELEMENTS['{name}']" for name in meant)
    return (
        f"Are they {' or '.join(meant)}? Pass a scikit-fem mesh, or ElementMesh(p, t, {arguments}), from skfem_stvk.mesh.element. "
        "Otherwise transpose arrays of shape (nt, k + 1)."
    )


def checked_degree(degree: Any) -> int:
    """Return the degree, 1 or 2; refuse anything else."""
    return whole("degree", degree, "1 or 2, the degree of the shape functions of simplices", 1, 2, MeshError)


def check_numbers(t: NDArray[np.int32], element: Element) -> None:
    """Refuse elements whose nodes are not the vertices followed by the further nodes, in scikit-fem's order."""
    corners, midpoints = t[: element.corners], t[element.corners :]
    first = int(midpoints.min())
    ascending = np.unique(midpoints)  # a part of a body, such as its skin, has only some of its midpoints
    expected = ascending[np.minimum(further_nodes(corners, element, int(t.max()) + 1)[1], len(ascending) - 1)]
    if len(bad := np.flatnonzero((corners >= first).any(axis=0) | (midpoints != expected).any(axis=0))):
        order = {1: "the segments", 2: "mesh.facets", 3: "mesh.edges"}[element.k]
        order += ", then those of faces and cells" * (element.means != element.edges)
        raise MeshError(
            f"{name_ids(bad, 'element')}: nodes are not numbered as scikit-fem numbers the degrees of freedom of these elements. "
            f"Expected vertices first, then edge midpoints in the order of {order}. A meshio.Mesh may have any numbers; "
            "ElementMesh.of renumbers it."
        )


def vertex_ids(value: Any) -> NDArray[Any]:
    """Return the vertices of the elements as an array of any type."""
    try:
        if np.ma.is_masked(value):
            raise ValueError
        return np.asarray(value)
    except Exception as error:  # ragged lists, masked entries, and objects whose own conversion fails
        raise MeshError(f"t = {shown(value)}; expected (k + 1, nt) whole numbers, the vertices of the elements from 0.") from error


def parts_line(mesh: ElementMesh) -> str:
    """Return a line on the parts of a divided body, for the header of a run; empty on one machine.

    The line has the number of ranks, and the numbers of elements and shared nodes of the smallest and the largest part.
    """
    comm = mesh.space.comm
    if not comm.divided:
        return ""
    elements, nodes = (f"{comm.least(n):.0f} to {comm.most(n):.0f}" for n in (mesh.nt, len(mesh.space.shared)))
    each = f"{threads()} thread{'s' * (threads() > 1)}"
    return f"\n{comm.size} ranks with {elements} elements, {nodes} shared nodes and {each} each"
