"""Conversion of errors to measurements for `judged`: relative errors, their limits, and the worst location.

Each node, or entry of K, has its own scale and its own limit. The limit of a node is that of its worst element (`Limits`): 1e-12,
or 20 eps times its aspect ratio.
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
from .discretisation import Shape

Measurement = dict[str, Any]

LIMIT, LIMIT_BY_ASPECT, HIGHEST = 1e-12, 20 * float(np.finfo(float).eps), 1e-6
#: Largest number of elements that a message names.
MOST_NAMED = 5
FLAT = "20 eps x (longest edge + displacement)/smallest height of the flattest or farthest moved element"


def by_node(mesh: ElementMesh, error: Array, scale: Array, limit: Array, words: str, reason: str) -> Measurement:
    """Return the measurement of errors (ndofs,) at the node with the largest ratio of error to limit.

    `scale` (nv,) holds the reference values of the errors, which `words` describes. `limit` (nv,) holds the largest allowed errors
    relative to `scale`.
    """
    relative = _over(largest_component(error, mesh.d), scale)
    node = int(np.argmax(relative / limit))
    return {
        "measured": float(relative[node]) if scale.any() else np.inf,  # a body without any resistance is a failure
        "limit": float(limit[node]),
        "scale": f"{scale[node]:.3e} ({words})",
        "reason": _why(reason, limit),
        "worst": worst_locations(mesh, _over(np.abs(error), np.repeat(limit * scale, mesh.d)), 1.0),
    }


def by_entry(mesh: ElementMesh, difference: spmatrix, rows: Array, limits: csr_matrix, words: str, reason: str) -> Measurement:
    """Return the measurement of the entries of a difference of matrices.

    Each entry is divided by the geometric mean of `rows` (nv,) at its two nodes. `limits` (nv, nv) holds the largest allowed values
    of these ratios.
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
    entry = {"entry": [int(entries.row[worst]), int(entries.col[worst])]}
    return {
        "measured": float(relative[worst]),
        "limit": float(limit[worst]),
        "scale": f"{scale[worst]:.3e} ({words}, geometric mean)",
        "reason": _why(reason, limit),
        "worst": worst_locations(mesh, by_row, 1.0) | entry,
    }


def of_whole_body(error: float, scale: float, limit: float, words: str, reason: str) -> Measurement:
    """Return the measurement of one number of the whole body."""
    return relative(error, scale, limit, words, reason + (f"; up to {limit:.0e}, {FLAT}" if limit > LIMIT else ""))


def relative(error: float, scale: float, limit: float, words: str, reason: str) -> Measurement:
    """Return the measurement of an error relative to a scale, which `words` describes.

    The measured value is infinite if the scale is zero, because a body without resistance is a failure.
    """
    measured = error / scale if scale > 0 else np.inf
    return {"measured": measured, "limit": limit, "scale": f"{scale:.3e} ({words})", "reason": reason}


def largest_rows(K: spmatrix, d: int) -> Array:
    """Return the largest entry of a matrix in the rows of each node, (nv,)."""
    largest: Array = abs(K).max(axis=1).toarray().reshape(-1, d).max(axis=1)
    return largest


def largest_component(values: Array, d: int) -> Array:
    """Return the largest component of a vector (ndofs,) at each node, (nv,). Entries that are not finite count as infinite."""
    size = np.abs(values).reshape(-1, d)
    return np.asarray(np.where(np.isfinite(size), size, np.inf).max(axis=1))


def _over(error: Array, scale: Array) -> Array:
    """Return the relative errors. They are infinite where the error is not finite, or where only the scale is zero."""
    finite = np.isfinite(error)
    return np.divide(error, scale, out=np.where(finite & (error == 0), 0.0, np.inf), where=finite & (scale > 0))


def _why(reason: str, limit: Array) -> str:
    looser = limit > LIMIT
    if not looser.any():
        return reason
    where = f"in {looser.sum()} of {len(limit)} locations"
    return f"{reason}; up to {limit.max():.0e} {where}, {FLAT}"


def worst_locations(mesh: ElementMesh, error: NDArray[np.float64], limit: float) -> dict[str, Any]:
    """Return the location of the largest error (ndofs,), and the nodes and elements that exceed the limit.

    `suspects` are the elements with all nodes beyond the limit. A fault in single elements gives exactly these elements.
    """
    if not error.size:
        return {}
    error = np.where(np.isfinite(error), np.abs(error), np.inf)
    dof = int(np.argmax(error))
    node = dof // mesh.d
    around = np.flatnonzero((mesh.t == node).any(axis=0))
    locations: dict[str, Any] = {
        "dof": dof,
        "node": node,
        "component": "xyz"[dof % mesh.d],
        "elements": around[:MOST_NAMED].tolist(),
    }
    off: NDArray[np.bool_] = np.any((error > limit).reshape(-1, mesh.d), axis=1)
    if off.any():
        suspects = np.flatnonzero(off[mesh.t].all(axis=0))
        locations |= {"nodes_off": int(off.sum()), "elements_off": len(suspects), "suspects": suspects[:MOST_NAMED].tolist()}
    return locations


def plain(value: Any) -> str:
    """Return a value of a report as text, without the brackets of Python.

    >>> plain({"shortest": 0.30000000000000004, "ids": [1, 2]}), plain({})
    ('shortest 0.3, ids 1, 2', 'none')
    """
    if isinstance(value, dict):
        return ", ".join(f"{name} {plain(one)}" for name, one in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(plain, value)) or "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def location_in_words(locations: dict[str, Any]) -> str:
    """Return the result of `worst_locations` as one line of text.

    >>> worst = {"dof": 7, "node": 2, "component": "y", "elements": [1], "nodes_off": 4, "elements_off": 1, "suspects": [1]}
    >>> location_in_words(worst)
    'worst at dof 7 (node 2, y); 4 nodes off, all nodes of 1 element: 1'
    """
    if "dof" not in locations:
        return "; ".join(f"{name} {plain(value)}" for name, value in locations.items())
    words = f"worst at dof {locations['dof']} (node {locations['node']}, {locations['component']})"
    if locations.get("elements_off"):
        count = locations["elements_off"]
        ids = ", ".join(map(str, locations["suspects"])) + (", ..." if count > len(locations["suspects"]) else "")
        words += f"; {locations['nodes_off']} nodes off, all nodes of {count} element{'s' if count > 1 else ''}: {ids}"
    elif "nodes_off" in locations:
        words += f"; {locations['nodes_off']} nodes off"
    return words


class Limits:
    """Limits of the relative errors of a correct W, F or K, from the shape of the elements and their displacement.

    The limit of an element with the longest edge `l` and the smallest height `h`, displaced by up to `|u|`, is

        max(1e-12, 20 eps c (l + |u|/s)/h), at most 1e-6

    where `c` is 1, or the ratio of the largest parts of a sum to the sum. `s` is 1, or, for a difference of two states, the size of
    the change over the size of an element. `cancelled` (nt,) is a factor of `c` that applies to all quantities. For the edge form
    it is the aspect ratio (docs/topics/frames.md).

    `h` and `l` are those at the worst point of the element. The round-off of a rest frame and of a displacement is relative to `l`
    and `|u|`, and the strain divides it by `h`. Errors of correct forms stay below a seventh of the limit, on needles, single
    slivers, random clouds and boxes pressed flat.
    """

    def __init__(self, shape: Shape, cancelled: Array) -> None:
        self.shape, self.mesh, self._cancelled = shape, shape.mesh, cancelled

    def of_elements(self, u: Array, cancelled: float = 1.0, change: float = 1.0) -> Array:
        """Return the limits of the elements (nt,) at `u` (ndofs,), with `c = cancelled` and `s = change`."""
        moved = np.linalg.norm(u.reshape(-1, self.mesh.d), axis=1)[self.mesh.t].max(axis=0)
        limit = LIMIT_BY_ASPECT * cancelled * self._cancelled * (self.shape.aspect + moved / change * self.shape.steepest)
        return np.asarray(np.clip(limit, LIMIT, HIGHEST))

    def of_nodes(self, u: Array, change: float = 1.0) -> Array:
        """Return the largest limit of the elements of each node (nv,) at `u` (ndofs,)."""
        return np.maximum(self.by_node(self.of_elements(u, change=change)), LIMIT)

    def of_pairs(self, u: Array) -> csr_matrix:
        """Return the largest limit of the elements of each pair of nodes (nv, nv) at `u` (ndofs,)."""
        return self.by_pair(self.of_elements(u))

    def of_body(self, u: Array, cancelled: float = 1.0, change: float = 1.0) -> float:
        """Return the largest limit of all elements at `u` (ndofs,)."""
        return float(self.of_elements(u, cancelled, change).max())

    def by_node(self, values: Array) -> Array:
        """Return the largest of the element values (nt,) at each node, (nv,)."""
        largest = np.zeros(self.mesh.nv)
        np.maximum.at(largest, self.mesh.t.ravel(), np.tile(values, len(self.mesh.t)))
        return largest

    def by_pair(self, values: Array) -> csr_matrix:
        """Return the largest of the element values (nt,) at each pair of nodes, (nv, nv)."""
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
        """Return the largest nodal value (nv,) among all nodes of the elements around each node, (nv,)."""
        return self.by_node(values[self.mesh.t].max(axis=0))
