"""From errors to what `judged` takes: each node, or entry of K, has its own scale and its own limit, and the worst place is told.

The limit of a node is that of its worst element (`Limits`): 1e-12, or 20 eps times its aspect ratio.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, spmatrix

from ..arguments import Array
from ..mesh import ElementMesh
from .shape import Shape

Measurement = dict[str, Any]

LIMIT, LIMIT_BY_ASPECT, HIGHEST = 1e-12, 20 * float(np.finfo(float).eps), 1e-6
#: Largest number of elements that a message names.
MOST = 5
FLAT = "20 eps x (longest edge + displacement)/smallest height of the flattest or farthest moved element"


def by_node(mesh: ElementMesh, error: Array, scale: Array, limit: Array, words: str, reason: str) -> Measurement:
    """A measurement of the errors (ndofs,), at the node where they are largest for their limit.

    `scale` (nv,) is what they are relative to, in `words`, and `limit` (nv,) how large they may be relative to it.
    """
    relative = _over(largest_component(error, mesh.d), scale)
    node = int(np.argmax(relative / limit))
    return {
        "measured": float(relative[node]) if scale.any() else np.inf,  # a body that does not resist is none
        "limit": float(limit[node]),
        "scale": f"{scale[node]:.3e} ({words})",
        "reason": _why(reason, limit),
        "worst": worst_places(mesh, _over(np.abs(error), np.repeat(limit * scale, mesh.d)), 1.0),
    }


def by_entry(mesh: ElementMesh, difference: spmatrix, rows: Array, limits: csr_matrix, words: str, reason: str) -> Measurement:
    """A measurement of the entries of a difference of matrices.

    An entry is relative to the geometric mean of `rows` (nv,) of its nodes; `limits` (nv, nv) is how large it may be.
    """
    entries = abs(difference).tocoo()
    if not entries.nnz or not rows.any():
        none = {"measured": 0.0 if rows.any() else np.inf, "limit": LIMIT, "scale": f"{rows.max():.3e} ({words})"}
        return none | {"reason": reason, "worst": {}}
    a, b = entries.row // mesh.d, entries.col // mesh.d
    scale = np.sqrt(rows[a] * rows[b])
    limit = np.maximum(np.asarray(limits[a, b]).ravel(), LIMIT)  # also where the nodes share no element
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


def as_a_whole(error: float, scale: float, limit: float, words: str, reason: str) -> Measurement:
    """A measurement of one number of the whole body."""
    return relative(error, scale, limit, words, reason + (f"; up to {limit:.0e}, {FLAT}" if limit > LIMIT else ""))


def relative(error: float, scale: float, limit: float, words: str, reason: str) -> Measurement:
    """Return the measurement of an error that is relative to a scale, in `words`; infinite without a scale: a body resists."""
    measured = error / scale if scale > 0 else np.inf
    return {"measured": measured, "limit": limit, "scale": f"{scale:.3e} ({words})", "reason": reason}


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
    return f"{reason}; up to {limit.max():.0e} {where}, {FLAT}"


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


class Limits:
    """How large a relative error of a right W, F or K may be, from the shape of the elements and how far they have moved.

    Of an element with the longest edge `l` and the smallest height `h`, displaced by up to `|u|`:

        max(1e-12, 20 eps c (l + |u|/s)/h), at most 1e-6

    where `c` is 1, or how much larger the parts of a sum are than itself, and `s` is 1, or the size of the change, over that of an
    element, if what is judged is a difference of two states. `cancelled` (nt,) is a `c` that all forms have there: the edge form's
    is the aspect ratio itself (docs/precision.md).
    `h` and `l` are those at the worst of its points. A rest frame and a displacement hold their digits relative to `l` and `|u|`,
    and strain divides what is lost by `h`. Right forms keep to a seventh of it, on needles, single slivers, random clouds and
    boxes pressed flat.
    """

    def __init__(self, shape: Shape, cancelled: Array) -> None:
        self.shape, self.mesh, self._cancelled = shape, shape.mesh, cancelled

    def of_elements(self, u: Array, cancelled: float = 1.0, change: float = 1.0) -> Array:
        """(nt,) limits at `u` (ndofs,), with `c = cancelled` and `s = change`."""
        moved = np.linalg.norm(u.reshape(-1, self.mesh.d), axis=1)[self.mesh.t].max(axis=0)
        limit = LIMIT_BY_ASPECT * cancelled * self._cancelled * (self.shape.aspect + moved / change * self.shape.steepest)
        return np.asarray(np.clip(limit, LIMIT, HIGHEST))

    def of_nodes(self, u: Array, change: float = 1.0) -> Array:
        """(nv,) largest limits of the elements of each node at `u` (ndofs,)."""
        return np.maximum(self.by_node(self.of_elements(u, change=change)), LIMIT)

    def of_pairs(self, u: Array) -> csr_matrix:
        """(nv, nv) largest limits of the elements of each pair of nodes at `u` (ndofs,)."""
        return self.by_pair(self.of_elements(u))

    def of_body(self, u: Array, cancelled: float = 1.0, change: float = 1.0) -> float:
        """The largest limit of an element at `u` (ndofs,)."""
        return float(self.of_elements(u, cancelled, change).max())

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
