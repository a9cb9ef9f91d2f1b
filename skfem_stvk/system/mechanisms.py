"""Check of supports: no part may keep a rigid motion, nor a mechanism of pieces joined by less than a facet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..edges.bound_term import joined
from ..errors import SupportError, name_ids
from ..kernels.simplex_topology import pieces_of_simplices
from ..mesh import ElementMesh
from ..mesh.element import Element, linear_simplex, named
from ..mesh.facets import facets_of, linked
from ..space import Space
from ..terms import BoundTerm
from .constraints import Block, compressed, free_motions
from .rigid import centred, free_rigid_modes, motions, name_part, node_numbers, parts_of

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

    def among(self, number: Ids) -> Corners:
        """Return the nodes of pieces with a new `number` (pieces,) from 0; those with -1 are dropped."""
        chosen = number[self.piece] >= 0
        return Corners(self.vertex[chosen], number[self.piece[chosen]])


class Joints(NamedTuple):
    """Nodes at which pieces may be joined: their `numbers` (n,), coordinates `x` (d, n), and `corners` of pieces by index."""

    numbers: Ids
    x: Array
    corners: Corners


class PieceShapes(NamedTuple):
    """Centres (n, d) and sizes (n,) of pieces [m], and the numbers (n,) of their parts."""

    centre: Array
    size: Array
    part: Ids


class PartMotions(NamedTuple):
    """Motions of a part: its number, the number of motions, whether they are without rigid ones, the first few joints in words,
    and the number of joints.
    """

    part: int
    motions: int
    joints_only: bool
    shown: list[str]
    joints: int


def check_held(
    mesh: ElementMesh,
    terms: Sequence[BoundTerm],
    constrained: NDArray[Any],
    solid: NDArray[np.bool_],
    touching: tuple[NDArray[Any], Array] | None = None,
) -> None:
    """Raise SupportError if a body can move without strain; in a divided body, on all of its parts.

    The `terms` connect the body and tie it to the ground. The supports constrain the degrees of freedom `constrained`. Contacts, if
    there are any, hold vertices (m,) that are `touching` along directions (m, d).

    Mechanisms are searched among elements that are rigid when unstrained. These elements are `solid` (nt,), that is, of an elastic
    material, and have the dimension of the space or the plane. Cables, trusses and membranes in space are stabilised by tension,
    which is not known here.
    """
    edges, space = [joined(term) for term in terms], mesh.space
    constrained = space.union(np.union1d(constrained, grounded_dofs(terms)).astype(np.int64), mesh.p.size)
    part = parts_of(edges, mesh.nv, space)
    free = free_rigid_modes(mesh.p, part, constrained, mesh.word, space, touching)
    messages = []
    if free:
        messages.append(
            f"{_listed(free, 'parts')}. Fix more components (fixed={{place: 'xyz'}}), prescribe them, or add an "
            "ElasticFoundation. To join parts, merge the vertices of their common faces."
            + " A contact holds a body along its normals alone, and where it touches at the start; otherwise simulate the motion "
            "with damping." * (touching is not None)
        )
    if mesh.k == mesh.d > 1 and space.comm.any(bool(solid.any())):
        loose = mechanisms(
            mesh.p,
            mesh.t,
            np.flatnonzero(solid),
            part,
            constrained,
            rigid={each.part: each.count for each in free},
            edges=edges,
            element=mesh.element,
            word=mesh.word,
            space=space,
            numbers=mesh.element_numbers,
        )
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
    found = [term.grounded for term in terms if term.grounded is not None]
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
    space: Space | None = None,
    numbers: Ids | None = None,
) -> list[Mechanism]:
    """Return the relative motions of pieces of a part without strain, to first order.

    A piece consists of elements joined by facets: tetrahedra by triangles, triangles in the plane by edges. An unstrained piece is
    rigid. Pieces have equal motions at shared nodes. One shared node is a ball joint, in the plane a hinge. Several shared nodes on
    a line are a hinge. Other sets of shared nodes join the pieces rigidly.

    The elements `t` (n, nt) are linear simplices by default; those with ids `solid` are rigid. `part` (nv,) are the numbers of the
    parts, and `rigid` gives the number of rigid modes of each part as a whole. A part counts as connected if `edges` (2, ne) of
    terms join nodes without a common piece. `word` is the name of a node in messages.

    Of a divided body, the `space` of the displacements has the other nodes, and `numbers` (nt,) are those of the elements in the
    whole body. Only joints and supports of pieces are gathered.

    >>> p = np.array([[0.0, 1, 0, 1, 2], [0, 0, 1, 2, 1]])   # two triangles that share vertex 1
    >>> t = np.array([[0, 1], [1, 3], [2, 4]])
    >>> str(mechanisms(p, t, np.arange(2), np.zeros(5, dtype=int), constrained=np.array([0, 1, 4, 5]), rigid={})[0])
    'the body of 5 vertices has 1 mechanism: 1 element (1) can rotate about 1 vertex (1) at (1, 0)'
    """
    nv, element, space = p.shape[1], element or linear_simplex(len(t) - 1), space or Space(p.size)
    nodes, solid_numbers = node_numbers(space, nv), solid if numbers is None else numbers[solid]
    own = np.ascontiguousarray(t if len(solid) == t.shape[1] else t[:, solid], dtype=np.int32)
    piece = space.comm.united(pieces(own, nv, element), solid_numbers, *_shared_facets(own, element, space.shared, nodes))
    of_part = np.full(int(space.comm.most(float(piece.max(initial=-1)))) + 1, -1.0)
    of_part[piece] = part[own[0]]
    of_part = space.comm.most(of_part).astype(np.int64)
    several = np.bincount(of_part, minlength=int(space.comm.most(float(part.max()))) + 1) > 1
    if not several.any():
        return []
    corners = _corners(own, piece)
    joints, bridged = _joints_of(corners, edges, p, part, several, space)
    several[bridged] = False
    chosen = np.flatnonzero(several[of_part])
    if not len(chosen):
        return []
    number = _indices(np.arange(len(of_part)), chosen)
    corners = corners.among(number)
    centre, size, x = centred(p[:, corners.vertex], corners.piece, space)
    supports = space.comm.collect(list(_supports(corners, motions(x), constrained)))
    elements = space.comm.collect(_first_elements(number[piece], solid_numbers, len(chosen)))
    found: list[PartMotions] = []
    if space.comm.leads:
        joints = joints._replace(corners=joints.corners.among(number))
        found = _motions_of_pieces(joints, PieceShapes(centre, size, of_part[chosen]), supports, elements, word)
    mechanisms = []
    for i, count, joints_only, shown, total in space.comm.broadcast(found):
        if (others := count - (0 if joints_only else rigid.get(i, 0))) > 0:
            mechanisms.append(Mechanism(i, name_part(part, i, word, space), others, shown, total))
    return mechanisms


def pieces(t: Ids, nv: int, element: Element) -> Ids:
    """Return the piece number (nt,) of each element `t` (n, nt): elements that share a facet belong to one piece.

    >>> from skfem_stvk.mesh.element import ELEMENTS
    >>> pieces(np.array([[0, 2, 6], [1, 4, 7], [3, 5, 8], [2, 3, 5]]), 9, ELEMENTS["quadrilaterals"])
    array([0, 0, 1], dtype=int32)
    """
    if element.is_simplex:
        return pieces_of_simplices(np.ascontiguousarray(t[: element.corners]), nv)
    t2f = facets_of(t, nv, element)[1]
    elements, facets = np.tile(np.arange(t.shape[1]), len(t2f)), t2f.ravel() + t.shape[1]
    return linked(elements, facets, int(facets.max()) + 1)[: t.shape[1]]


def _corners(t: Ids, piece: Ids) -> Corners:
    pieces = int(piece.max(initial=0)) + 1
    return Corners(*np.divmod(np.unique(t.astype(np.int64) * pieces + piece), pieces))


def _indices(keys: Ids, among: Ids) -> Ids:
    """Return the indices of `keys` in the ascending array `among`; -1 for missing keys."""
    index = np.searchsorted(among, keys)
    return np.where(np.append(among, -1)[index] == keys, index, -1)


def _apart(corners: Corners, edges: Ids, nv: int) -> NDArray[np.bool_]:
    """Return whether the ends of each of the `edges` (2, ne) are in no common piece; -1 is a node without pieces."""
    shape = nv + 1, int(corners.piece.max(initial=0)) + 1
    has = csr_matrix((np.ones(len(corners.vertex), dtype=np.int8), corners), shape=shape)
    return np.asarray(np.asarray(has[edges[0]].multiply(has[edges[1]]).sum(axis=1)).ravel() == 0)


def _joints_of(
    corners: Corners, edges: Sequence[Ids], p: Array, part: Ids, several: NDArray[np.bool_], space: Space
) -> tuple[Joints, Ids]:
    """Return the joints of the parts with `several` pieces, and the parts in which edges connect nodes without a common piece.

    In a divided body its leading part has the joints, and the others have none. A node is a joint if it has several pieces.
    """
    nv = p.shape[1]
    numbers, every = node_numbers(space, nv), np.concatenate([np.empty((2, 0), dtype=np.int32), *edges], axis=1)
    apart = every[:, _apart(corners, every, nv)]
    first, joint = np.zeros(nv), np.zeros(nv)
    vertex, index = np.unique(corners.vertex, return_index=True)
    first[vertex] = corners.piece[index] + 1
    first = space.share(space.counted(first))  # of the part that counts the node
    joint[corners.vertex[corners.piece + 1 != first[corners.vertex]]] = 1
    joint[apart] = 1
    own = np.flatnonzero((space.share(joint)[corners.vertex] > 0) & several[part[corners.vertex]])
    vertex = corners.vertex[own]
    gathered = space.comm.collect((numbers[vertex], corners.piece[own], p[:, vertex], numbers[apart], part[apart[0]]))
    joints, bridged = Joints(vertex[:0], p[:, :0], Corners(vertex[:0], vertex[:0])), None
    if gathered:
        number, piece, x, ends, of_ends = (np.concatenate(arrays, axis=-1) for arrays in zip(*gathered, strict=True))
        nodes, index, at = np.unique(number, return_index=True, return_inverse=True)
        joints = Joints(nodes, x[:, index], _corners(at[None], piece))
        bridged = np.unique(of_ends[_apart(joints.corners, _indices(ends, nodes), len(nodes))])
    return joints, space.comm.broadcast(bridged)


def _shared_facets(t: Ids, element: Element, shared: Ids, numbers: Ids) -> tuple[Ids, Ids]:
    """Return the elements that have facets with all corners among the `shared` nodes, and the numbers (m, n) of these corners."""
    there, m = np.zeros(len(numbers), dtype=bool), named(element.facet).corners
    there[shared] = True
    near = np.flatnonzero(there[t[: element.corners]].sum(axis=0) >= m) if len(shared) else shared
    corners = np.concatenate([t[list(facet[:m])][:, near] for facet in element.facets], axis=1)
    chosen = there[corners].all(axis=0)
    return np.tile(near, len(element.facets))[chosen], np.sort(numbers[corners[:, chosen]], axis=0)


def _first_elements(piece: Ids, numbers: Ids, count: int) -> tuple[Ids, Ids, Ids]:
    """Return the number of elements of each piece (count,), and the pieces and numbers of their first few elements.

    `piece` (nt,) is -1 for other elements.
    """
    order = np.lexsort((numbers, piece))[np.count_nonzero(piece < 0) :]
    sizes = np.bincount(piece[order], minlength=count)
    few = order[np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes) < MOST]
    return sizes, piece[few], numbers[few]


def _motions_of_pieces(
    joints: Joints,
    shapes: PieceShapes,
    supports: Sequence[Sequence[Block]],
    elements: Sequence[tuple[Ids, Ids, Ids]],
    word: str,
) -> list[PartMotions]:
    """Return the motions of pieces of these `shapes` under the constraints of `joints` and `supports`.

    `supports` and `elements` (`_first_elements`) are those of all parts of a divided body.
    """
    corners, d, (centre, size, of_part) = joints.corners, len(joints.x), shapes
    modes = motions(((joints.x[:, corners.vertex] - centre.T[:, corners.piece]) / size[corners.piece]).T)
    free, samples, at_rest = free_motions([*_joints(corners, modes), *_combined(supports)], len(size), modes.shape[2])
    largest = np.zeros(int(of_part.max()) + 1)
    np.maximum.at(largest, of_part, np.abs(samples).max(axis=(1, 2)))
    samples = samples / np.maximum(largest, np.finfo(float).tiny)[of_part, None, None]

    cluster = _clusters(corners, samples[:, d:], size)
    moves = np.zeros(len(size), dtype=bool)
    moves[cluster[np.abs(samples).max(axis=(1, 2)) > ALIKE]] = True
    sizes, few_pieces, few = (np.concatenate(arrays, axis=-1) for arrays in zip(*elements, strict=True))
    sizes = np.bincount(np.tile(cluster, len(elements)), weights=sizes, minlength=len(size)).astype(int)
    rotating = _rotating(corners, cluster, moves, sizes)
    count = np.bincount(of_part, weights=free).astype(int)
    joints_only = np.bincount(of_part, weights=at_rest) > 0  # otherwise the motions found include its rigid modes
    of_node = np.zeros(len(joints.numbers), dtype=np.int64)
    of_node[corners.vertex] = of_part[corners.piece]
    found = []
    for own in _grouped(np.array([of_node[vertices[0]] for _, vertices in rotating])):
        i = int(of_node[rotating[own[0]][1][0]])
        shown = []
        for one, vertices in (rotating[joint] for joint in own[:MOST]):
            ids = name_ids(np.unique(few[cluster[few_pieces] == one]), "element", count=int(sizes[one]))
            shown.append(f"{ids} can rotate about {_location(joints, vertices, word)}")
        found.append(PartMotions(i, int(count[i]), bool(joints_only[i]), shown, len(own)))
    return found


def _combined(supports: Sequence[Sequence[Block]]) -> Iterator[Block]:
    """Yield the support constraints of all parts of a divided body, one block for each piece."""
    by_piece: dict[int, list[Array]] = {}
    for block in (block for one in supports for block in one):
        by_piece.setdefault(block.bodies[0], []).append(block.rows)
    for piece, rows in sorted(by_piece.items()):
        yield Block((piece,), rows[0] if len(rows) == 1 else compressed(np.concatenate(rows)))


def _joints(corners: Corners, modes: Array) -> Iterator[Block]:
    """Yield the joint constraints, one block for each pair of pieces.

    The motion of a vertex is equal in its first piece and in each of its other pieces.
    """
    first = np.unique(corners.vertex, return_index=True, return_inverse=True)
    one, other = first[1][first[2]], np.arange(len(corners.vertex))
    joint = one != other
    one, other = one[joint], other[joint]
    for own in _grouped(corners.piece[one] * (corners.piece.max(initial=0) + 1) + corners.piece[other]):
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


def _location(joints: Joints, vertices: Ids, word: str) -> str:
    """Return a description of nodes on a line, with coordinates."""
    ends = vertices[np.lexsort(joints.x[:, vertices][::-1])[[0, -1]]]
    points = [f"({', '.join(f'{c:.9g}' for c in joints.x[:, v])})" for v in ends]
    if len(vertices) == 1:
        return f"{name_ids(joints.numbers[vertices], word)} at {points[0]}"
    return f"the line through {name_ids(joints.numbers[vertices], word)} from {points[0]} to {points[1]}"
