"""From errors to what `judged` takes: each node, or entry of K, has its own scale and its own limit, and the worst place is told.

The limit of a node is `LIMIT` of its scale, or what round-off may cost a right form in its elements (`RoundOff`), and never more
than `HIGHEST` of its scale.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, spmatrix

from ..arguments import Array
from ..mesh import ElementMesh
from .shape import Shape

Measurement = dict[str, Any]

LIMIT, HIGHEST = 1e-12, 1e-6
#: Largest number of elements that a message names.
MOST = 5
#: Several elements meet at a vertex, and twice what was seen: the margin of ordinary elements, and of the flattest.
MARGIN, LARGEST_MARGIN = 4.0, 32.0
#: In between the margin is the aspect ratio times this.
MARGIN_BY_ASPECT = 0.2
#: Number of states whose round-off is kept: those of the stencils along two lines.
KEPT = 9


def by_node(mesh: ElementMesh, error: Array, scale: Array, lost: Array, words: str, reason: str) -> Measurement:
    """A measurement of the errors (ndofs,), at the node where they are largest for their limit.

    `scale` (nv,) is what they are relative to, in `words`, and `lost` (nv,) the round-off that a right form may have.
    """
    limit = limits(scale, lost)
    relative = _over(largest_component(error, mesh.d), scale)
    node = int(np.argmax(relative / limit))
    return {
        "measured": float(relative[node]) if scale.any() else np.inf,  # a body that does not resist is none
        "limit": float(limit[node]),
        "scale": f"{scale[node]:.3e} ({words})",
        "reason": _why(reason, limit),
        "worst": worst_places(mesh, _over(np.abs(error), np.repeat(limit * scale, mesh.d)), 1.0),
    }


def by_entry(mesh: ElementMesh, difference: spmatrix, rows: Array, lost: csr_matrix, words: str, reason: str) -> Measurement:
    """A measurement of the entries of a difference of matrices.

    An entry is relative to the geometric mean of `rows` (nv,) of its nodes; `lost` (nv, nv) is what a right form may lose.
    """
    entries = abs(difference).tocoo()
    if not entries.nnz or not rows.any():
        none = {"measured": 0.0 if rows.any() else np.inf, "limit": LIMIT, "scale": f"{rows.max():.3e} ({words})"}
        return none | {"reason": reason, "worst": {}}
    a, b = entries.row // mesh.d, entries.col // mesh.d
    scale = np.sqrt(rows[a] * rows[b])
    limit = limits(scale, np.asarray(lost[a, b]).ravel())
    relative = _over(entries.data, scale)
    worst = int(np.argmax(relative / limit))
    by_row = np.zeros(mesh.p.size)
    np.maximum.at(by_row, entries.row, relative / limit)
    place = {"entry": [int(entries.row[worst]), int(entries.col[worst])]}
    return {
        "measured": float(relative[worst]),
        "limit": float(limit[worst]),
        "scale": f"{scale[worst]:.3e} ({words}, geometric mean)",
        "reason": _why(reason, limit),
        "worst": worst_places(mesh, by_row, 1.0) | place,
    }


def as_a_whole(error: float, scale: float, lost: float, words: str, reason: str) -> Measurement:
    """A measurement of one number of the whole body."""
    limit = float(limits(np.array([scale]), np.array([lost]))[0])
    if limit != LIMIT:
        reason += f"; above {LIMIT:.0e} for what round-off may cost in its flat or small elements"
    return {
        "measured": error / scale if scale else np.inf,  # a body that does not resist is none
        "limit": limit,
        "scale": f"{scale:.3e} ({words})",
        "reason": reason,
        "worst": {},
    }


def limits(scale: Array, lost: Array) -> Array:
    """Relative limits: what round-off costs over the scale, but at least `LIMIT` and at most `HIGHEST`.

    A scale from a candidate's own forces or stiffness may be infinite; nothing is lost relative to it.
    """
    usable = (scale > 0) & np.isfinite(scale)
    return np.clip(np.divide(lost, scale, out=np.zeros_like(scale), where=usable), LIMIT, HIGHEST)


def largest_rows(K: spmatrix, d: int) -> Array:
    """(nv,) largest entry of a matrix in the rows of each node."""
    largest: Array = abs(K).max(axis=1).toarray().reshape(-1, d).max(axis=1)
    return largest


def largest_component(values: Array, d: int) -> Array:
    """(nv,) largest component of a vector (ndofs,) at each node; what is not a number is infinite."""
    size = np.abs(values).reshape(-1, d)
    return np.asarray(np.where(np.isfinite(size), size, np.inf).max(axis=1))


def _over(error: Array, scale: Array) -> Array:
    """Relative errors: infinite where the error is not finite, whatever the scale, and where only the scale is zero."""
    finite = np.isfinite(error)
    return np.divide(error, scale, out=np.where(finite & (error == 0), 0.0, np.inf), where=finite & (scale > 0))


def _why(reason: str, limit: Array) -> str:
    looser = limit > LIMIT
    if not looser.any():
        return reason
    where = f"in {looser.sum()} of {len(limit)} places"
    return f"{reason}; up to {limit.max():.0e} {where}, for what round-off may cost in their flat or small elements"


def worst_places(mesh: ElementMesh, error: NDArray[np.float64], limit: float) -> dict[str, Any]:
    """The worst place of an error (ndofs,), and the nodes and elements that are beyond the limit.

    `suspects` are the elements all of whose nodes are beyond the limit: a fault in single elements leaves just those.
    """
    if not error.size:
        return {}
    error = np.where(np.isfinite(error), np.abs(error), np.inf)
    dof = int(np.argmax(error))
    node = dof // mesh.d
    around = np.flatnonzero((mesh.t == node).any(axis=0))
    places: dict[str, Any] = {"dof": dof, "node": node, "component": "xyz"[dof % mesh.d], "elements": around[:MOST].tolist()}
    off: NDArray[np.bool_] = np.any((error > limit).reshape(-1, mesh.d), axis=1)
    if off.any():
        suspects = np.flatnonzero(off[mesh.t].all(axis=0))
        places |= {"nodes_off": int(off.sum()), "elements_off": len(suspects), "suspects": suspects[:MOST].tolist()}
    return places


def in_words(places: dict[str, Any]) -> str:
    """The worst places in one line of words.

    >>> in_words({"dof": 7, "node": 2, "component": "y", "elements": [1], "nodes_off": 4, "elements_off": 1, "suspects": [1]})
    'worst at dof 7 (node 2, y); 4 nodes off, all nodes of 1 element: 1'
    """
    if "dof" not in places:
        return "; ".join(f"{name} {value}" for name, value in places.items())
    words = f"worst at dof {places['dof']} (node {places['node']}, {places['component']})"
    if places.get("elements_off"):
        count = places["elements_off"]
        ids = ", ".join(map(str, places["suspects"])) + (", ..." if count > len(places["suspects"]) else "")
        words += f"; {places['nodes_off']} nodes off, all nodes of {count} element{'s' if count > 1 else ''}: {ids}"
    elif "nodes_off" in places:
        words += f"; {places['nodes_off']} nodes off"
    return words


class Lost(NamedTuple):
    """Round-off of the elements in a state, each (nt,), times its margin: of W [J], of F over V C g^2 [m], of K over V C g^2."""

    energy: Array
    force: Array
    stiffness: Array


class RoundOff:
    """What round-off may cost a right W, F and K in a given state: the model behind the limits of the checks.

    Of an element with the steepest gradient `g` of its reference coordinates (1/smallest height), longest edge `l`, deformation
    gradient `A` and displacements up to `|u|`, with `V C` its volume times the largest entry of its elasticity tensor, what is
    lost, over eps, is

        form                          what is lost                  of W              of F                   of K
        gradient of the displacement  gradient g |u| (strain: |A|)  V C |E| x strain  V C g^2 (1+A^2) |u|    V C g^2 (1+|A|) g |u|
        gradients of shape functions  g l, relative                 W g l             V C g^2 (1+A^2) l |A|  V C g^2 (1+A^2) g l

    at the worst of its points. Nothing in it grows with the square of the aspect ratio `g l`: forms in an orthonormal rest frame
    and scikit-fem's keep to it. Slivers stand in groups where one vertex lies almost in the plane of its neighbours, up to six of
    them around an edge, and what they lose adds up, for which the margin of flat elements is larger than that of ordinary ones.
    """

    def __init__(self, shape: Shape, modulus: Array) -> None:
        self.shape, self.mesh = shape, shape.mesh
        self._weight = shape.volume * modulus
        self._in_state = lru_cache(KEPT)(self._lost)

    def lost(self, u: Array) -> Lost:
        """Round-off of each element at `u` (ndofs,); that of the latest states is kept, as several checks ask for it."""
        return self._in_state(u.tobytes())

    def _lost(self, state: bytes) -> Lost:
        mesh, g, l = self.mesh, self.shape.steepest, self.shape.longest
        displacement = np.frombuffer(state).reshape(-1, mesh.d).T
        A = self.shape.deformation(displacement)
        strain = (np.linalg.norm(np.swapaxes(A, 2, 3) @ A - np.eye(mesh.k), axis=(2, 3)) / 2).max(axis=1)
        stretch = np.linalg.norm(A, axis=(2, 3)).max(axis=1)
        moved = np.linalg.norm(displacement, axis=0)[mesh.t].max(axis=0)
        eps = np.clip(MARGIN_BY_ASPECT * self.shape.aspect, MARGIN, LARGEST_MARGIN) * np.finfo(float).eps
        return Lost(
            eps * self._weight * strain * (stretch * g * moved + strain * g * l),
            eps * (1 + stretch**2) * (moved + l * stretch),
            eps * ((1 + stretch) * g * moved + (1 + stretch**2) * g * l),
        )

    def by_node(self, values: Array) -> Array:
        """(nv,) the largest value (nt,) of the elements of each node."""
        largest = np.zeros(self.mesh.nv)
        np.maximum.at(largest, self.mesh.t.ravel(), np.tile(values, len(self.mesh.t)))
        return largest

    def by_pair(self, values: Array) -> csr_matrix:
        """(nv, nv) the largest value (nt,) of the elements of each pair of nodes."""
        order, first, rows, columns = self._pairs
        largest = np.maximum.reduceat(values[order], first)
        return csr_matrix((largest, (rows, columns)), shape=(self.mesh.nv,) * 2)

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.int64], ...]:
        """Elements in the order of their pairs of nodes, the first element of each pair, and its two nodes."""
        local = np.array(list(product(range(len(self.mesh.t)), repeat=2)))
        a, b = self.mesh.t[local[:, 0]].ravel(), self.mesh.t[local[:, 1]].ravel()
        order = np.lexsort((b, a))
        first = np.flatnonzero(np.diff(a[order], prepend=-1) | np.diff(b[order], prepend=-1))
        return order % self.mesh.nt, first, a[order][first], b[order][first]

    def around(self, values: Array) -> Array:
        """(nv,) the largest value (nv,) among the nodes of the elements of each node."""
        return self.by_node(values[self.mesh.t].max(axis=0))
