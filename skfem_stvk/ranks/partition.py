"""Division of a mesh into parts: the elements of each part, and all that a part knows of the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from ..arguments import shown, whole, whole_array
from ..errors import MeshError
from ..mesh import ElementMesh
from ..mesh.element import Element
from ..mesh.facets import facets_of, find_facets, linked, outer_facets
from ..mesh.locations import checked_facets, checked_lines, vertices_at

Ids = NDArray[np.int64]

#: Last sentence of messages about missing packages.
INSTALL = "Install the packages for ranks: pip install 'skfem-stvk[mpi]'."


@dataclass(frozen=True, eq=False)
class PartContent:
    """Part of a mesh: its elements with all of their nodes, and the other parts that have these nodes.

    Nodes are numbered within the part, elements too.

    Attributes
    ----------
    element
        Kind of the elements.
    p, t
        (d, nv) coordinates [m] and (n, nt) nodes of the elements.
    node_numbers, element_numbers
        (nv,) and (nt,) numbers in the whole mesh, ascending.
    surface
        (m, n) facets of the surface of the whole body, oriented outwards.
    subdomains, boundaries, node_sets, lines
        Names with their elements, facets (m, n), nodes and segments (m, n); every part has all names.
    boundary_numbers, line_numbers
        Names with the numbers (n,) of these facets and segments among those of the name in the whole mesh.
    shared
        (2, n) nodes, ascending, and numbers of the other parts that have them.
    bounds
        (d, 2) smallest and largest coordinates of the whole body.
    vertices
        Number of vertices, which are the first nodes.
    """

    element: Element
    p: NDArray[np.float64]
    t: NDArray[np.int32]
    node_numbers: Ids
    element_numbers: Ids
    surface: NDArray[np.int32]
    subdomains: Mapping[str, NDArray[np.int32]]
    boundaries: Mapping[str, NDArray[np.int32]]
    node_sets: Mapping[str, NDArray[np.int32]]
    lines: Mapping[str, NDArray[np.int32]]
    boundary_numbers: Mapping[str, NDArray[np.integer]]
    line_numbers: Mapping[str, NDArray[np.integer]]
    shared: Ids
    bounds: NDArray[np.float64]
    vertices: int


def divide(mesh: ElementMesh, parts: int, part_of: NDArray[np.integer] | None = None) -> Iterator[PartContent]:
    """Divide a mesh into parts, by METIS (Karypis, Kumar 1998, SISC 20, 359) on the graph of elements that share a facet.

    Each part is made when it is requested, so that no more than one of them is in memory. METIS bisects recursively: parts with
    neighbouring numbers are neighbours in the mesh.

    Parameters
    ----------
    mesh
        The whole mesh.
    parts
        Number of parts.
    part_of
        (nt,) part of each element, instead of METIS.

    Raises
    ------
    MeshError
        if there are fewer elements than parts, or a part would have none; if pymetis is missing.

    Examples
    --------
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
    >>> first, second = divide(mesh, 2, np.array([0, 1]))
    >>> second.node_numbers, second.shared
    (array([1, 2, 3]), array([[0, 1],
           [0, 0]]))
    """
    whole("parts", parts, f"a number of parts from 1 to the {mesh.nt} elements", 1, mesh.nt, MeshError)
    facets, t2f = facets_of(mesh.t, mesh.nv, mesh.element)
    first, last = _elements_of(t2f, facets.shape[1])
    del t2f
    part = _by_metis(first, last, mesh.nt, parts) if part_of is None else _checked(part_of, mesh.nt, parts)
    counts = np.bincount(part, minlength=parts)
    if len(empty := np.flatnonzero(counts == 0)):
        raise MeshError(
            f"The {mesh.nt} elements are in {parts - len(empty)} of {parts} parts, none in part {empty[0]}; expected some in each. "
            "Use fewer parts."
        )
    return _Division(mesh, parts, part, facets, np.minimum(part[first], part[last])).contents()


def _checked(part_of: NDArray[np.integer], nt: int, parts: int) -> Ids:
    """Return the part of each element; refuse other arrays."""
    part = whole_array(part_of)
    if part is None or part.shape != (nt,) or part.dtype == bool or not ((part >= 0) & (part < parts)).all():
        raise MeshError(f"part_of = {shown(part_of)}; expected a part from 0 to {parts - 1} for each of the {nt} elements.")
    return part.astype(np.int64)


def _elements_of(t2f: NDArray[np.int32], nf: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the first and the last element (nf,) that has each facet, from the facets (f, nt) of the elements."""
    facet, element = t2f.ravel("F"), np.repeat(np.arange(t2f.shape[1], dtype=np.int32), len(t2f))
    first, last = np.empty(nf, dtype=np.int32), np.empty(nf, dtype=np.int32)
    first[facet[::-1]] = element[::-1]
    last[facet] = element
    return first, last


def _by_metis(first: NDArray[np.int32], last: NDArray[np.int32], nt: int, parts: int) -> Ids:
    """Return the part (nt,) of each element, from the first and the last element of each facet."""
    if parts == 1:
        return np.zeros(nt, dtype=np.int64)
    try:
        import pymetis  # not needed where a partition file is read
    except ImportError as error:
        raise MeshError(f"Parts are made by METIS, and pymetis is missing ({error}). {INSTALL}") from error
    inner = first != last
    a, b = first[inner], last[inner]
    graph = coo_matrix((np.ones(2 * len(a), dtype=np.int8), (np.append(a, b), np.append(b, a))), shape=(nt, nt)).tocsr()
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    found = np.array(pymetis.part_graph(parts, adjacency, recursive=True)[1], dtype=np.int64)
    if (np.bincount(found, minlength=parts) == 0).any():  # METIS leaves parts empty if they have a few elements each
        found[np.argsort(found, kind="stable")] = np.arange(nt) * parts // nt
    return found


class _Division:
    """Division of a mesh whose elements have the parts `part` (nt,). The `facets` of elements have the parts `facet_part`."""

    def __init__(self, mesh: ElementMesh, parts: int, part: Ids, facets: NDArray[np.int32], facet_part: Ids) -> None:
        self._mesh, self._parts, self._part = mesh, parts, part
        names = {("boundaries", name): checked_facets(mesh, name) for name in mesh.boundaries if np.size(mesh.boundaries[name])}
        names |= {("lines", name): checked_lines(mesh, name) for name in mesh.lines if np.size(mesh.lines[name])}
        self._has = _unique([mesh.t.astype(np.int64) * parts + part])  # node * parts + part, ascending
        of_names = {key: self._part_of_facets(ids, facets, facet_part) for key, ids in names.items()}
        if names:
            keys = [(ids.astype(np.int64) * parts + of_names[key]) for key, ids in names.items()]
            self._has = _unique([self._has, *keys])
        alone = np.ones(mesh.nv, dtype=bool)  # on no element and no line
        alone[self._has // parts] = False
        if alone.any():
            self._has = _unique([self._has, np.flatnonzero(alone) * parts])
        self._named = {key: (ids, _groups(of_names[key], parts)) for key, ids in names.items()}

    def contents(self) -> Iterator[PartContent]:
        """Yield the parts."""
        mesh, parts = self._mesh, self._parts
        node, part = np.divmod(self._has, parts)
        nodes = [node[ids] for ids in _groups(part, parts)]
        del node, part
        elements, (surface, of_surface) = _groups(self._part, parts), outer_facets(mesh)
        surface_groups = _groups(self._part[of_surface], parts)
        sets = {name: np.unique(vertices_at(mesh, np.asarray(ids))) for name, ids in mesh.node_sets.items() if len(ids)}
        sets_by_part = {name: self._by_part(ids) for name, ids in sets.items()}
        regions = {name: np.sort(mesh.elements(name)) for name in mesh.subdomains if len(mesh.subdomains[name])}
        regions_by_part = {name: _groups(self._part[ids], parts) for name, ids in regions.items()}
        number = np.empty(mesh.nv, dtype=np.int32)
        for one, (own, ids) in enumerate(zip(nodes, elements, strict=True)):
            number[own] = np.arange(len(own))
            groups = {key: of[one] for key, (_, of) in self._named.items()}
            named = {key: number[self._named[key][0][:, ids]] for key, ids in groups.items()}
            index, every = self._entries(own)
            holder = self._has[every] % parts
            yield PartContent(
                element=mesh.element,
                p=np.ascontiguousarray(mesh.p[:, own]),
                t=number[mesh.t[:, ids]],
                node_numbers=own,
                element_numbers=ids,
                surface=number[surface[:, surface_groups[one]]],
                subdomains={
                    name: np.searchsorted(ids, of[regions_by_part[name][one]]).astype(np.int32) for name, of in regions.items()
                },
                boundaries={name: facets for (kind, name), facets in named.items() if kind == "boundaries"},
                node_sets={name: number[of[one]] for name, of in sets_by_part.items()},
                lines={name: ends for (kind, name), ends in named.items() if kind == "lines"},
                boundary_numbers={name: ids for (kind, name), ids in groups.items() if kind == "boundaries"},
                line_numbers={name: ids for (kind, name), ids in groups.items() if kind == "lines"},
                shared=np.stack([index, holder])[:, holder != one],
                bounds=mesh.bounds,
                vertices=int(np.searchsorted(own, mesh.nvertices)),
            )

    def _entries(self, nodes: Ids) -> tuple[Ids, Ids]:
        """Return the index of the node of each entry of `_has` that belongs to these nodes, and the entry."""
        begin, end = np.searchsorted(self._has, nodes * self._parts), np.searchsorted(self._has, (nodes + 1) * self._parts)
        index = np.repeat(np.arange(len(nodes)), end - begin)
        return index, np.arange(len(index)) + (begin - np.append(0, np.cumsum(end - begin)[:-1]))[index]

    def _by_part(self, nodes: Ids) -> list[Ids]:
        """Return those of the nodes that each part has."""
        index, every = self._entries(nodes)
        return [nodes[index[ids]] for ids in _groups(self._has[every] % self._parts, self._parts)]

    def _part_of_facets(self, wanted: NDArray[np.int32], facets: NDArray[np.int32], facet_part: Ids) -> Ids:
        """Return the part (n,) of facets or segments (m, n): the lowest with an element that has it, or with all of its nodes.

        Otherwise it is the lowest part of its first node, or of the nodes that lines connect with it.
        """
        parts, nv = self._parts, self._mesh.nv
        found = np.full(wanted.shape[1], parts)
        if len(wanted) == len(facets):
            there = np.zeros(nv, dtype=bool)
            there[wanted] = True
            near = np.flatnonzero(there[facets].all(axis=0))
            index = find_facets(wanted, facets[:, near], nv)
            found[index >= 0] = facet_part[near[index[index >= 0]]]
        rest = np.flatnonzero(found == parts)
        if not len(rest):
            return found
        ends = wanted[:, rest].astype(np.int64)
        index, every = self._entries(ends[0])
        holder = self._has[every] % parts
        keys = ends[:, index] * parts + holder
        by_all = (self._has[np.minimum(np.searchsorted(self._has, keys), len(self._has) - 1)] == keys).all(axis=0)
        np.minimum.at(found, rest[index[by_all]], holder[by_all])
        return self._of_neighbours(wanted, found)

    def _of_neighbours(self, wanted: NDArray[np.int32], found: Ids) -> Ids:
        """Return the part of each segment, for those without one the lowest part of its first node, or of connected nodes."""
        parts, nv = self._parts, self._mesh.nv
        if not len(rest := np.flatnonzero(found == parts)):
            return found
        ends = wanted[:, rest]
        node, first = np.unique(self._has // parts, return_index=True)
        owner = np.full(nv, parts)
        owner[node] = self._has[first] % parts
        piece = linked(np.tile(ends[0], len(ends) - 1), ends[1:].ravel(), nv)
        lowest = np.full(int(piece.max()) + 1, parts)
        np.minimum.at(lowest, piece, owner)
        of_segment = np.where(owner[ends[0]] < parts, owner[ends[0]], lowest[piece[ends[0]]])
        found[rest] = np.where(of_segment < parts, of_segment, 0)  # the first part has those that touch no element
        return found


def _unique(keys: Sequence[Ids]) -> Ids:
    """Return all keys, each once, ascending."""
    every = np.concatenate([one.ravel() for one in keys])
    every.sort()
    return every[np.append(True, every[1:] != every[:-1])]


def _groups(part: NDArray[np.integer], parts: int) -> list[Ids]:
    """Return the indices with each of the numbers 0 ... `parts - 1`, ascending."""
    return np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part, minlength=parts))[:-1])


def join(pieces: Sequence[PartContent], own: Sequence[int], rank_of: NDArray[np.integer]) -> PartContent:
    """Return the part of a rank from its pieces of a finer division.

    Parameters
    ----------
    pieces
        The rank's pieces.
    own
        Their numbers in the division, ascending.
    rank_of
        Rank of each piece of the division. The result names ranks in `shared`.

    Examples
    --------
    >>> mesh = ElementMesh(p=[[0, 1, 0, 1], [0, 0, 1, 1]], t=[[0, 1], [1, 2], [2, 3]])
    >>> join(list(divide(mesh, 2, np.array([1, 0]))), [0, 1], np.array([0, 0])).t
    array([[0, 1],
           [1, 2],
           [2, 3]], dtype=int32)
    """
    rank, first = int(rank_of[own[0]]), pieces[0]
    if len(pieces) == 1:
        return _with_ranks(first, first.shared, rank, rank_of)
    nodes, index = np.unique(np.concatenate([one.node_numbers for one in pieces]), return_index=True)
    elements = np.concatenate([one.element_numbers for one in pieces])
    order = np.argsort(elements)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    number = [np.searchsorted(nodes, one.node_numbers).astype(np.int32) for one in pieces]
    begins = np.cumsum([0, *(len(one.element_numbers) for one in pieces)])
    joined = PartContent(
        first.element,
        np.concatenate([one.p for one in pieces], axis=1)[:, index],
        np.concatenate([of[one.t] for of, one in zip(number, pieces, strict=True)], axis=1)[:, order],
        nodes,
        elements[order],
        np.concatenate([of[one.surface] for of, one in zip(number, pieces, strict=True)], axis=1),
        _joined(
            [{k: place[begin + v] for k, v in one.subdomains.items()} for begin, one in zip(begins, pieces, strict=False)], True
        ),
        _joined([{k: of[v] for k, v in one.boundaries.items()} for of, one in zip(number, pieces, strict=True)]),
        _joined([{k: of[v] for k, v in one.node_sets.items()} for of, one in zip(number, pieces, strict=True)], True),
        _joined([{k: of[v] for k, v in one.lines.items()} for of, one in zip(number, pieces, strict=True)]),
        _joined([one.boundary_numbers for one in pieces]),
        _joined([one.line_numbers for one in pieces]),
        first.shared,
        first.bounds,
        int(np.searchsorted(nodes, max(one.node_numbers[one.vertices - 1] for one in pieces), side="right")),
    )
    shared = np.concatenate([np.stack([of[one.shared[0]], one.shared[1]]) for of, one in zip(number, pieces, strict=True)], axis=1)
    return _with_ranks(joined, shared, rank, rank_of)


def _joined(names: Sequence[Mapping[str, NDArray[Any]]], unique: bool = False) -> dict[str, NDArray[np.int32]]:
    found = {name: np.concatenate([one[name] for one in names], axis=-1).astype(np.int32) for name in names[0]}
    return {name: np.unique(ids) for name, ids in found.items()} if unique else found


def _with_ranks(part: PartContent, shared: Ids, rank: int, rank_of: NDArray[np.integer]) -> PartContent:
    """Return the part with ranks instead of pieces in `shared`, each once, without its own rank."""
    ranks = int(rank_of.max()) + 1
    keys = np.unique(shared[0].astype(np.int64) * ranks + rank_of[shared[1]])
    node, other = np.divmod(keys, ranks)
    return replace(part, shared=np.stack([node, other])[:, other != rank])
