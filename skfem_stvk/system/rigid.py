"""Rigid motions of a body, and rigid motions that the supports leave to its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.bound_term import joined
from ..errors import name_ids
from ..mesh.facets import linked
from ..space import Space

#: Resistance to a motion below this fraction of the largest is round-off. Supports that are closer together than 3e-7 of a body
#: count as one.
NOTHING = 1e-13
#: Number of disconnected parts that messages name.
SHOWN = 3


def rigid_modes(x: Array, space: Space | None = None) -> Array:
    """Return (ndofs, r) unit translations and rotations about the centre of the nodes `x` (nv, d), of unit size at most.

    `r` is 1, 3, 6 for d = 1, 2, 3. If all nodes lie on a line, fewer of the motions are independent. Centre and size are those of
    the whole body, whose displacements have the `space`; by default there are no other nodes.

    >>> rigid_modes(np.array([[0.0, 0.0], [2.0, 0.0]]))
    array([[ 1.,  0., -0.],
           [ 0.,  1., -1.],
           [ 1.,  0., -0.],
           [ 0.,  1.,  1.]])
    """
    space = space or Space(x.size)
    x = x - mean_of_nodes(x, space)
    modes = motions(x / (space.comm.most(float(np.linalg.norm(x, axis=1).max())) or 1.0))
    return modes.reshape(x.size, -1)


def mean_of_nodes(x: Array, space: Space) -> Array:
    """Return the mean (d,) of values (nv, d) at all nodes of a body, whose displacements have the `space`."""
    own = space.counted(np.ones(len(x)))[:, None] * x if space.comm.divided else x
    mean: Array = space.comm.total(own.sum(axis=0)) / (space.count // x.shape[1])
    return mean


@dataclass(frozen=True)
class FreeMotions:
    """Rigid motions left to a part of a body: its number, its nodes in words, the number of modes and their names."""

    part: int
    name: str
    count: int
    names: list[str]

    def __str__(self) -> str:
        return f"{self.name} has {self.count} rigid mode{'s' * (self.count > 1)} left, {', '.join(self.names)}"


def free_rigid_modes(
    p: Array,
    part: NDArray[Any],
    constrained: NDArray[Any],
    word: str = "vertex",
    space: Space | None = None,
    touching: tuple[NDArray[Any], Array] | None = None,
) -> list[FreeMotions]:
    """Return the rigid motions of each part of a body when degrees of freedom `constrained` are constrained.

    `part` (nv,) are the numbers of the parts. `touching` are vertices (m,) that are also constrained along directions (m, d).

    `word` is the name of a node in messages. The `space` of the displacements has the other nodes of a divided body.

    >>> square, one = np.array([[0.0, 1, 0, 1], [0, 0, 1, 1]]), np.zeros(4, dtype=int)
    >>> str(free_rigid_modes(square, one, constrained=np.array([0, 4]))[0])
    'the body of 4 vertices has 1 rigid mode left, translation along y'
    >>> str(free_rigid_modes(square, one, constrained=np.array([0, 1]))[0])
    'the body of 4 vertices has 1 rigid mode left, rotation about the point (0, 0)'
    """
    d, space = len(p), space or Space(p.size)
    own = space.counted(np.ones(len(part)))
    centre, size, x = centred(p, part, space, own)
    modes = motions(x)
    vertex, component = np.divmod(np.unique(constrained).astype(np.int64), d)
    vertex, component = vertex[own[vertex] > 0], component[own[vertex] > 0]
    resisted = space.comm.total(_gram(modes[vertex, component][:, None], part[vertex], len(size)))
    if touching is not None:
        vertex, directions = touching
        resisted += _gram(np.einsum("mc,mcr->mr", directions, modes[vertex])[:, None], part[vertex], len(size))
    lowest, trace = np.linalg.eigvalsh(resisted)[:, 0], np.trace(resisted, axis1=1, axis2=2)
    loose = np.flatnonzero(lowest <= NOTHING * trace)
    if not len(loose):
        return []
    moved = space.comm.total(_gram(modes[own > 0], part[own > 0], len(size)))
    free = {int(i): _free(resisted[i], moved[i]) for i in loose}
    return [
        FreeMotions(i, name_part(part, i, word, space), f.shape[1], names(f, d, centre[i], size[i]))
        for i, f in free.items()
        if f.size
    ]


def parts_of(edges: Sequence[NDArray[np.int32]], nv: int, space: Space | None = None) -> NDArray[np.int32]:
    """Return the part number (nv,) of each node: parts are connected by `edges` (2, ne), and in a divided body by shared nodes.

    The `space` of the displacements has the other nodes of a divided body.
    """
    a, b = np.concatenate([np.empty((2, 0), dtype=np.int32), *edges], axis=1)
    part, space = linked(a, b, nv), space or Space(nv)
    numbers = node_numbers(space, nv)
    return space.comm.united(part, numbers, space.shared, numbers[space.shared][None])


def parts_of_body(system: Any) -> NDArray[np.int32]:
    """Return the part number (nv,) of each node of a system: parts are connected by terms."""
    return parts_of([joined(term) for term in system.bound_terms], system.mesh.nv, system.space)


def node_numbers(space: Space, nv: int) -> NDArray[np.int64]:
    """Return the numbers (nv,) of nodes in the whole body, from the space of the displacements."""
    d = space.n // nv
    return space.numbers[::d] // d


def name_part(part: NDArray[Any], i: int, word: str = "vertex", space: Space | None = None) -> str:
    """Return a description of a part by its nodes; `word` is the name of a node."""
    space = space or Space(len(part))
    whole = space.count // (space.n // len(part))
    first, count = space.few(part == i)
    if count < whole:
        return f"the part of {name_ids(first, word, count=count)}"
    return f"the body of {whole} {'vertices' if word == 'vertex' else word + 's'}"


def centred(p: Array, part: NDArray[Any], space: Space, weights: Array | None = None) -> tuple[Array, Array, Array]:
    """Return the centre (n, d) and the size (n,) of the parts, and centred coordinates (nv, d) in units of the size.

    Nodes have equal `weights` (nv,) by default. All parts of a divided body, which the `space` combines, count.
    """
    n = int(space.comm.most(float(part.max(initial=-1)))) + 1
    weights = np.ones(len(part)) if weights is None else weights
    count = space.comm.total(np.bincount(part, weights=weights, minlength=n))
    centre = np.stack([space.comm.total(np.bincount(part, weights=weights * row, minlength=n)) / count for row in p])
    x = p - centre[:, part]
    size = np.zeros(len(count))
    np.maximum.at(size, part, np.linalg.norm(x, axis=0))
    size = space.comm.most(size)
    size[size == 0] = 1.0
    return centre.T, size, (x / size[part]).T


def motions(x: Array) -> Array:
    """Return (nv, d, r) unit translations and rotations about zero: in the plane, or about each axis."""
    nv, d = x.shape
    modes = np.zeros((nv, d, {1: 1, 2: 3, 3: 6}[d]))
    modes[:, range(d), range(d)] = 1
    if d == 2:
        modes[:, 0, 2], modes[:, 1, 2] = -x[:, 1], x[:, 0]
    for axis in range(3 if d == 3 else 0):
        y, z = (axis + 1) % 3, (axis + 2) % 3
        modes[:, y, 3 + axis], modes[:, z, 3 + axis] = -x[:, z], x[:, y]
    return modes


def _gram(modes: Array, part: NDArray[Any], parts: int) -> Array:
    """Return the Gram matrices (parts, r, r) of motions `modes` (n, c, r), summed over each part."""
    r = modes.shape[2]
    gram = np.empty((parts, r, r))
    for i in range(r):
        for j in range(i + 1):
            product = np.einsum("nc,nc->n", modes[:, :, i], modes[:, :, j])
            gram[:, i, j] = gram[:, j, i] = np.bincount(part, weights=product, minlength=parts)
    return gram


def _free(resisted: Array, moved: Array) -> Array:
    """Return orthonormal motions (r, m) that meet no resistance and move the part."""
    values, vectors = np.linalg.eigh(resisted)
    free = vectors[:, values <= NOTHING * np.trace(resisted)]
    values, vectors = np.linalg.eigh(free.T @ moved @ free)
    return np.asarray(free @ vectors[:, values > NOTHING * np.trace(moved)])


def names(free: Array, d: int, centre: Array, size: float) -> list[str]:
    """Return descriptions of motions.

    `free` (r, m) are orthonormal coefficients of translations, and of rotations about the `centre` in units of the `size`.

    >>> names(np.eye(3)[:, [1, 2]], 2, np.zeros(2), 1.0)
    ['translation along y', 'rotation in the plane']
    """
    if d == 1 or not free.size:
        return ["translation along x"] * free.shape[1]
    _, values, right = np.linalg.svd(free[d:])
    still = np.append(values, np.zeros(len(right) - len(values))) < 1e-6
    translations = free[:d] @ right[still].T
    names = [f"translation along {_direction(a)}" for a in _axes(translations)]
    rotating = free @ right[~still].T
    return names + [_rotation(rotating, axis, translations, centre, size) for axis in _axes(np.linalg.qr(rotating[d:])[0])]


def _rotation(rotating: Array, axis: Array, translations: Array, centre: Array, size: float) -> str:
    """Return a description of the motion among `rotating` (r, m) that rotates about the direction `axis`."""
    d = len(centre)
    motion = rotating @ np.linalg.lstsq(rotating[d:], axis, rcond=None)[0]
    v = motion[:d]  # orthogonal to the translations, since `rotating` is
    if d == 2:
        point = centre + size * np.array([-v[1], v[0]]) * np.sign(axis[0])
        return "rotation in the plane" if translations.shape[1] else f"rotation about the point {_numbers(point, size)}"
    along = v @ axis
    if abs(along) > 1e-6:
        return f"screw motion along {_direction(axis)}, {2 * np.pi * size * along:.4g} per revolution"
    name = _direction(axis)
    if np.linalg.matrix_rank(np.column_stack([translations, axis]), tol=1e-6) == d:
        return f"rotation about the {name} axis" if name in "xyz" else f"rotation about the direction {name}"
    return f"rotation about the line along {name} through {_numbers(centre + size * np.cross(axis, v), size)}"


def _axes(basis: Array) -> list[Array]:
    """Return directions with the same span as the orthonormal columns of `basis` (d, m): coordinate axes if possible."""
    axes = [e for e in np.eye(len(basis)) if np.linalg.norm(basis.T @ e) > 1 - 1e-9]
    rest = basis - sum((np.outer(e, e @ basis) for e in axes), np.zeros_like(basis))
    left, values, _ = np.linalg.svd(rest, full_matrices=False)
    others = left[:, values > 1e-6].T
    return axes + [other * np.sign(other[np.abs(other).argmax()]) for other in others]


def _direction(a: Array) -> str:
    """Return `x`, `y`, `z`, or components.

    >>> _direction(np.array([0.0, 1.0])), _direction(np.array([0.6, 0.8]))
    ('y', '(0.6, 0.8)')
    """
    return "xyz"[int(a.argmax())] if a.max() > 1 - 1e-9 else _numbers(a, 1.0)


def _numbers(x: Array, size: float) -> str:
    """Return coordinates in words; values that are negligible against the size are shown as zero."""
    x = np.where(np.abs(x) < 1e-6 * size, 0.0, x)
    return f"({', '.join(f'{value:.6g}' for value in x)})"


class Pieces(NamedTuple):
    """Parts that terms connect at present.

    Attributes
    ----------
    part
        (nv,) part number of each node.
    bare
        (nv,) whether a node has lost all its elements.
    supported
        (parts,) whether a support or a foundation acts on a part.
    element
        (nt,) part number of each element, -1 if it was removed.
    word
        Name of a node in messages.
    """

    part: NDArray[Any]
    bare: NDArray[np.bool_]
    supported: NDArray[np.bool_]
    element: NDArray[Any]
    word: str

    @classmethod
    def of(cls, system: Any) -> Pieces:
        """Return the present parts of a system."""
        mesh, part = system.mesh, parts_of_body(system)
        bare, supported = np.zeros(mesh.nv, dtype=bool), np.zeros(int(part.max()) + 1, dtype=bool)
        bare[system.bare] = True
        supported[part[np.union1d(system.supports.held, system.grounded) // mesh.d]] = True
        element = part[mesh.t[0]].astype(np.int64)
        element[system.removed] = -1
        return cls(part, bare, supported, element, mesh.word)

    def newly_loose(self, before: Pieces) -> str:
        """Return a description of the parts that have become loose since `before`; empty if there are none.

        A part is loose if no support or foundation acts on it now. It has become so if it was supported before, or was no part of
        its own.

        The largest piece of a part that was unsupported before still counts as the body.
        """
        size = np.bincount(self.part[~self.bare], minlength=len(self.supported))
        first = np.unique(self.part, return_index=True)[1]
        was = before.part[first]
        largest = np.zeros(len(before.supported), dtype=np.int64)
        np.maximum.at(largest, was, size)
        candidates = np.flatnonzero((size > 0) & (size == largest[was]))
        the_body = np.zeros(len(size), dtype=bool)
        the_body[candidates[np.unique(was[candidates], return_index=True)[1]]] = True
        loose = np.flatnonzero((size > 0) & ~self.supported & (before.supported[was] | ~the_body))
        if not len(loose):
            return ""
        shown = [
            f"{name_ids(np.flatnonzero(self.element == i), 'element')} with "
            f"{name_ids(np.flatnonzero((self.part == i) & ~self.bare), self.word)}"
            for i in loose[:SHOWN]
        ]
        more = f"; and {len(loose) - SHOWN} more" if len(loose) > SHOWN else ""
        return f"{len(loose)} part{'s become' if len(loose) > 1 else ' becomes'} loose: {'; '.join(shown)}{more}."
