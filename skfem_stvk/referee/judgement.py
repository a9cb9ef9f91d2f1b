"""From errors to what `judged` takes: each vertex, or entry of K, has its own scale and its own limit, and the worst place is told.

The limit of a vertex is `LIMIT` of its scale, or what round-off may cost a right form in its elements (`round_off`), and never more
than `HIGHEST` of its scale.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, spmatrix

from ..arguments import Array
from ..mesh import SimplexMesh
from .places import worst_places

Measurement = dict[str, Any]

LIMIT, HIGHEST = 1e-12, 1e-6


def by_vertex(
    mesh: SimplexMesh, error: Array, scale: Array, lost: Array, words: str, reason: str, least: float = LIMIT
) -> Measurement:
    """A measurement of the errors (ndofs,), at the vertex where they are largest for their limit.

    `scale` and `lost` (nv,) are what they are relative to, `words` what that is, and the round-off that a right form may have.
    """
    limit = limits(scale, lost, least)
    relative = _over(largest_component(error, mesh.d), scale)
    vertex = int(np.argmax(relative / limit))
    return {
        "measured": float(relative[vertex]) if scale.any() else np.inf,  # a body that does not resist is none
        "limit": float(limit[vertex]),
        "scale": f"{scale[vertex]:.3e} ({words})",
        "reason": _why(reason, limit, least),
        "worst": worst_places(mesh, _over(np.abs(error), np.repeat(limit * scale, mesh.d)), 1.0),
    }


def by_entry(mesh: SimplexMesh, difference: spmatrix, rows: Array, lost: csr_matrix, words: str, reason: str) -> Measurement:
    """A measurement of the entries of a difference of matrices.

    An entry is relative to the geometric mean of `rows` (nv,) of its two vertices; `lost` (nv, nv) is the round-off that a right form
    may have.
    """
    entries = abs(difference).tocoo()
    if not entries.nnz or not rows.any():
        none = {"measured": 0.0 if rows.any() else np.inf, "limit": LIMIT, "scale": f"{rows.max():.3e} ({words})"}
        return none | {"reason": reason, "worst": {}}
    a, b = entries.row // mesh.d, entries.col // mesh.d
    scale = np.sqrt(rows[a] * rows[b])
    limit = limits(scale, np.asarray(lost[a, b]).ravel(), LIMIT)
    relative = _over(entries.data, scale)
    worst = int(np.argmax(relative / limit))
    by_row = np.zeros(mesh.p.size)
    np.maximum.at(by_row, entries.row, relative / limit)
    place = {"entry": [int(entries.row[worst]), int(entries.col[worst])]}
    return {
        "measured": float(relative[worst]),
        "limit": float(limit[worst]),
        "scale": f"{scale[worst]:.3e} ({words}, geometric mean)",
        "reason": _why(reason, limit, LIMIT),
        "worst": worst_places(mesh, by_row, 1.0) | place,
    }


def as_a_whole(error: float, scale: float, lost: float, words: str, reason: str, least: float = LIMIT) -> Measurement:
    """A measurement of one number of the whole body."""
    limit = float(limits(np.array([scale]), np.array([lost]), least)[0])
    return {
        "measured": error / scale if scale else np.inf,  # a body that does not resist is none
        "limit": limit,
        "scale": f"{scale:.3e} ({words})",
        "reason": reason
        if limit == least
        else f"{reason}; above {least:.0e} for what round-off may cost in its flat or small elements",
        "worst": {},
    }


def limits(scale: Array, lost: Array, least: float) -> Array:
    """Relative limits: what round-off costs over the scale, but between `least` and the highest."""
    return np.clip(np.divide(lost, scale, out=np.zeros_like(scale), where=scale > 0), least, HIGHEST)


def largest_rows(K: spmatrix, d: int) -> Array:
    """(nv,) largest entry of a matrix in the rows of each vertex."""
    largest: Array = abs(K).max(axis=1).toarray().reshape(-1, d).max(axis=1)
    return largest


def largest_component(values: Array, d: int) -> Array:
    """(nv,) largest component of a vector (ndofs,) at each vertex; what is not a number is infinite."""
    size = np.abs(values).reshape(-1, d)
    return np.asarray(np.where(np.isfinite(size), size, np.inf).max(axis=1))


def _over(error: Array, scale: Array) -> Array:
    """Relative errors: where the scale is zero any error is infinite; what is not a number is infinite too."""
    error = np.where(np.isfinite(error), error, np.inf)
    return np.divide(error, scale, out=np.where(error > 0, np.inf, 0.0), where=scale > 0)


def _why(reason: str, limit: Array, least: float) -> str:
    looser = limit > least
    if not looser.any():
        return reason
    return f"{reason}; up to {limit.max():.0e} in {looser.sum()} of {len(limit)} places, for what round-off may cost in their flat or small elements"
