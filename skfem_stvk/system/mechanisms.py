"""Check of supports: no part may keep a rigid motion, nor a mechanism of pieces joined by less than a facet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges.pairs import joined
from ..elements import Element, linear_simplex
from ..errors import SupportError, name_ids
from ..kernels.topology import pieces_of_simplices
from ..mesh import ElementMesh
from ..mesh.facets import facets_of, linked
from ..terms import BoundTerm
from .constraints import Block, compressed, free_motions
from .rigid import centred, free_rigid_modes, motions, name_part, parts_of

Ids = NDArray[Any]

#: Relative rotations of pieces below this fraction of the largest motion count as zero.
ALIKE = 1e-6
MOST = 5


@dataclass(frozen=True)
class Mechanism:
    """Motions of a part other than rigid ones: their number, and the first few of its joints in words."""

    part: int
    name: str
    count: int
    shown: list[str]
    joints: int

    def __str__(self) -> str:
        more = f", and {self.joints - len(self.shown)} more joints" if self.joints > len(self.shown) else ""
        return f"{self.name} has {self.count} mechanism{'s' * (self.count > 1)}: {', '.join(self.shown)}{more}"


class Corners(NamedTuple):
    """Nodes of each piece, each once: `vertex` (n,), ascending, and `piece` (n,)."""

    vertex: Ids
    piece: Ids


def check_held(mesh: ElementMesh, terms: Sequence[BoundTerm], constrained: NDArray[Any], solid: NDArray[np.bool_]) -> None:
    """Raise SupportError if a body can move without strain.

    The `terms` connect the body and tie it to the ground. The supports constrain the degrees of freedom `constrained`.

    Mechanisms are searched among elements that are rigid when unstrained. These elements are `solid` (nt,), that is, of an elastic
    material, and have the dimension of the space or the plane. Cables, trusses and membranes in space are stabilised by tension,
    which is not known here.
    """
    edges = [joined(term) for term in terms]
    constrained = np.union1d(constrained, grounded_dofs(terms)).astype(np.int64)
    part = parts_of(edges, mesh.nv)
    free = free_rigid_modes(mesh.p, part, constrained, mesh.word)
    messages = []
    if free:
        messages.append(
            f"{_listed(free, 'parts')}. Fix more components (fixed={{place: 'xyz'}}), prescribe them, or add an "
            "ElasticFoundation. To join parts, merge the vertices of their common faces."
        )
    if mesh.k == mesh.d > 1 and solid.any():
        rigid = {each.part: each.count for each in free}
        ids = np.flatnonzero(solid)
        loose = mechanisms(mesh.p, mesh.t, ids, part, constrained, rigid=rigid, edges=edges, element=mesh.element, word=mesh.word)
        if loose:
            facet = ("an edge", "edges") if mesh.d == 2 else ("a face", "faces")
            messages.append(
                f"{_listed(loose, 'parts')}. These elements share less than {facet[0]} with the others: fix them as well, join "
                f"them by {facet[1]}, or remesh."
            )
    if messages:
        raise SupportError(f"Not held: {' Also, '.join(messages)}")


def grounded_dofs(terms: Sequence[Any]) -> NDArray[np.int64]:
    """Return the degrees of freedom that terms tie to the ground, ascending."""
    found = [term.grounded for term in terms if hasattr(term, "grounded")]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *found]))


def _listed(items: Sequence[Any], what: str) -> str:
    """Return the first few items in words, and the number of the others."""
    more = f"; and {len(items) - MOST} more {what}" if len(items) > MOST else ""
    return "; ".join(str(item) for item in items[:MOST]) + more


def mechanisms(
    p: Array,
    t: Ids,
    solid: Ids,
    part: Ids,
    constrained: Ids,
    *,
    rigid: Mapping[int, int],
    edges: Sequence[Ids] = (),
    element: Element | None = None,
    word: str = "vertex",
) -> list[Mechanism]:
    """Return the relative motions of pieces of a part without strain, to first order.

    A piece consists of elements joined by facets: tetrahedra by triangles, triangles in the plane by edges. An unstrained piece is
    rigid. Pieces have equal motions at shared nodes. One shared node is a ball joint, in the plane a hinge. Several shared nodes on
    a line are a hinge. Other sets of shared nodes join the pieces rigidly.

    The elements `t` (n, nt) are linear simplices by default; those with ids `solid` are rigid. `part` (nv,) are the numbers of the
    parts, and `rigid` gives the number of rigid modes of each part as a whole. A part counts as connected if `edges` (2, ne) of
    terms join nodes without a common piece. `word` is the name of a node in messages.

    >>> p = np.array([[0.0, 1, 0, 1, 2], [0, 0, 1, 2, 1]])   # two triangles that share vertex 1
    >>> t = np.array([[0, 1], [1, 3], [2, 4]])
    >>> str(mechanisms(p, t, np.arange(2), np.zeros(5, dtype=int), constrained=np.array([0, 1, 4, 5]), rigid={})[0])
    'the body of 5 vertices has 1 mechanism: 1 element (1) can rotate about 1 vertex (1) at (1, 0)'
    """
    nv = p.shape[1]
    own = np.ascontiguousarray(t if len(solid) == t.shape[1] else t[:, solid], dtype=np.int32)
    piece = pieces(own, nv, element or linear_simplex(len(t) - 1))
    of_part = part[own[0, np.unique(piece, return_index=True)[1]]]
    several = np.bincount(of_part, minlength=part.max() + 1) > 1
    if not several.any():
        return []
    corners = _corners(own, piece)
    several[part[_bridges(corners, edges, nv)]] = False
    chosen = several[part[corners.vertex]]
    if not chosen.any():
        return []
    numbers, of_corner = np.unique(corners.piece[chosen], return_inverse=True)
    corners, of_part = Corners(corners.vertex[chosen], of_corner), of_part[numbers]
    _, size, x = centred(p[:, corners.vertex], corners.piece)
    modes = motions(x)
    free, samples, at_rest = free_motions(
        [*_joints(corners, modes), *_supports(corners, modes, constrained)], len(size), modes.shape[2]
    )
    largest = np.zeros(len(several))
    np.maximum.at(largest, of_part, np.abs(samples).max(axis=(1, 2)))
    samples = samples / np.maximum(largest, np.finfo(float).tiny)[of_part, None, None]

    cluster = _clusters(corners, samples[:, len(p) :], size)
    of_element = np.append(cluster, -1)[_indices(piece, numbers)]
    moves = np.zeros(len(size), dtype=bool)
    moves[cluster[np.abs(samples).max(axis=(1, 2)) > ALIKE]] = True
    rotating = _rotating(corners, cluster, moves, np.bincount(of_element[of_element >= 0], minlength=len(size)))
    count = np.bincount(of_part, weights=free, minlength=len(several)).astype(int)
    whole = np.bincount(of_part, weights=at_rest, minlength=len(several)) == 0  # then the motions found include its rigid modes
    found: list[Mechanism] = []
    for own in _grouped(np.array([part[vertices[0]] for _, vertices in rotating])):
        i = int(part[rotating[own[0]][1][0]])
        joints = [
            f"{name_ids(solid[of_element == one], 'element')} can rotate about {_location(p, vertices, word)}"
            for one, vertices in (rotating[joint] for joint in own[:MOST])
        ]
        found.append(Mechanism(i, name_part(part, i, word), int(count[i]) - (rigid.get(i, 0) if whole[i] else 0), joints, len(own)))
    return [mechanism for mechanism in found if mechanism.count > 0]


def pieces(t: Ids, nv: int, element: Element) -> Ids:
    """Return the piece number (nt,) of each element `t` (n, nt): elements that share a facet belong to one piece.

    >>> from skfem_stvk.elements import ELEMENTS
    >>> pieces(np.array([[0, 2, 6], [1, 4, 7], [3, 5, 8], [2, 3, 5]]), 9, ELEMENTS["quadrilaterals"])
    array([0, 0, 1], dtype=int32)
    """
    if element.is_simplex:
        return pieces_of_simplices(np.ascontiguousarray(t[: element.corners]), nv)
    t2f = facets_of(t, nv, element)[1]
    elements, facets = np.tile(np.arange(t.shape[1]), len(t2f)), t2f.ravel() + t.shape[1]
    return linked(elements, facets, int(facets.max()) + 1)[: t.shape[1]]


def _corners(t: Ids, piece: Ids) -> Corners:
    pieces = int(piece.max()) + 1
    return Corners(*np.divmod(np.unique(t.astype(np.int64) * pieces + piece), pieces))


def _indices(keys: Ids, among: Ids) -> Ids:
    """Return the indices of `keys` in the ascending array `among`; -1 for missing keys."""
    index = np.minimum(np.searchsorted(among, keys), len(among) - 1)
    return np.where(among[index] == keys, index, -1)


def _bridges(corners: Corners, edges: Sequence[Ids], nv: int) -> Ids:
    """Return the first vertices of the edges with ends in no common piece."""
    has = csr_matrix((np.ones(len(corners.vertex), dtype=np.int8), corners), shape=(nv, int(corners.piece.max()) + 1))
    a, b = np.concatenate([np.empty((2, 0), dtype=np.int32), *edges], axis=1)
    return a[np.asarray(has[a].multiply(has[b]).sum(axis=1)).ravel() == 0]


def _joints(corners: Corners, modes: Array) -> Iterator[Block]:
    """Yield the joint constraints, one block for each pair of pieces.

    The motion of a vertex is equal in its first piece and in each of its other pieces.
    """
    first = np.unique(corners.vertex, return_index=True, return_inverse=True)
    one, other = first[1][first[2]], np.arange(len(corners.vertex))
    joint = one != other
    one, other = one[joint], other[joint]
    for own in _grouped(corners.piece[one] * (corners.piece.max() + 1) + corners.piece[other]):
        rows = np.concatenate([modes[one[own]], -modes[other[own]]], axis=2)
        pieces = int(corners.piece[one[own[0]]]), int(corners.piece[other[own[0]]])
        yield Block(pieces, compressed(rows.reshape(-1, rows.shape[2])))


def _supports(corners: Corners, modes: Array, constrained: Ids) -> Iterator[Block]:
    """Yield the support constraints, one block for each piece: constrained components of vertices do not move."""
    vertex, component = np.divmod(constrained, modes.shape[1])
    begin, end = np.searchsorted(corners.vertex, vertex), np.searchsorted(corners.vertex, vertex, side="right")
    row = np.repeat(np.arange(len(constrained)), end - begin)
    corner = begin[row] + np.arange(len(row)) - np.repeat(np.cumsum(end - begin) - (end - begin), end - begin)
    for own in _grouped(corners.piece[corner]):
        yield Block((int(corners.piece[corner[own[0]]]),), compressed(modes[corner[own], component[row[own]]]))


def _grouped(keys: Ids) -> list[Ids]:
    """Return groups of indices with equal keys."""
    if not len(keys):
        return []
    order = np.argsort(keys, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(keys[order])) + 1)


def _clusters(corners: Corners, rotations: Array, size: Array) -> Ids:
    """Return the cluster number of each piece.

    A cluster consists of pieces that share vertices and never rotate against each other.

    `rotations` (n, 1 or 3, m) are the rotations of pieces in random motions, in units of 1/size. At each vertex the pieces are
    sorted by the rotation about a random axis. Then pieces with equal rotations are neighbours.
    """
    rotations = rotations / size[:, None, None]
    axis = np.random.default_rng(1).standard_normal(rotations.shape[1])
    order = np.lexsort((np.einsum("nc,c->n", rotations[:, :, 0], axis)[corners.piece], corners.vertex))
    piece, same = corners.piece[order], np.diff(corners.vertex[order]) == 0
    one, other = piece[:-1][same], piece[1:][same]
    rotating = np.abs(rotations[one] - rotations[other]).max(axis=(1, 2), initial=0) * np.minimum(size[one], size[other])
    alike = rotating <= ALIKE
    return linked(one[alike], other[alike], len(size))


def _rotating(corners: Corners, cluster: Ids, moves: NDArray[np.bool_], elements: Ids) -> list[tuple[int, Ids]]:
    """Return the clusters that rotate, and the vertices about which they rotate.

    The reference is a cluster at rest at the same vertices, or else the largest one.
    """
    rank = np.empty(len(moves), dtype=np.int64)
    rank[np.lexsort((-elements, moves))] = np.arange(len(moves))
    vertex, ranked = _corners(corners.vertex[None], rank[cluster][corners.piece])
    several = np.bincount(vertex)[vertex] > 1
    vertex, ranked = vertex[several], ranked[several]
    first = np.unique(vertex, return_index=True, return_inverse=True)
    base = ranked[first[1][first[2]]]
    by_rank, own = np.argsort(rank), {int(ranked[group[0]]): vertex[group] for group in _grouped(ranked)}
    pairs = sorted({(one, other) for one, other in zip(ranked.tolist(), base.tolist(), strict=True) if one != other})
    return [(int(by_rank[one]), np.intersect1d(own[one], own[other])) for one, other in pairs]


def _location(p: Array, vertices: Ids, word: str) -> str:
    """Return a description of nodes on a line, with coordinates."""
    ends = vertices[np.lexsort(p[:, vertices][::-1])[[0, -1]]]
    points = [f"({', '.join(f'{c:.9g}' for c in p[:, v])})" for v in ends]
    if len(vertices) == 1:
        return f"{name_ids(vertices, word)} at {points[0]}"
    return f"the line through {name_ids(vertices, word)} from {points[0]} to {points[1]}"
