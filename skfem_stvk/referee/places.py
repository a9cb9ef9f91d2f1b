"""Where an error is: the worst degree of freedom, and the elements that explain all of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mesh import SimplexMesh

MOST = 5


def worst_places(mesh: SimplexMesh, error: NDArray[np.float64], limit: float) -> dict[str, Any]:
    """The worst place of an error (ndofs,), and what is beyond the limit.

    `suspects` are the elements all of whose vertices are beyond the limit: a fault in single elements leaves just those.
    """
    if not error.size:
        return {}
    error = np.where(np.isfinite(error), np.abs(error), np.inf)
    dof = int(np.argmax(error))
    node = dof // mesh.d
    around = np.flatnonzero((mesh.t == node).any(axis=0))
    places: dict[str, Any] = {
        "dof": dof,
        "vertex": node,
        "component": "xyz"[dof % mesh.d],
        "elements": around[:MOST].tolist(),
    }
    off: NDArray[np.bool_] = np.any((error > limit).reshape(-1, mesh.d), axis=1)
    if off.any():
        suspects = np.flatnonzero(off[mesh.t].all(axis=0))
        places |= {"vertices_off": int(off.sum()), "elements_off": len(suspects), "suspects": suspects[:MOST].tolist()}
    return places


def in_words(places: dict[str, Any]) -> str:
    """The places in a line.

    >>> in_words({"dof": 7, "vertex": 2, "component": "y", "elements": [1], "vertices_off": 4, "elements_off": 1, "suspects": [1]})
    'worst at dof 7 (vertex 2, y); 4 vertices off, all vertices of 1 element: 1'
    """
    if "dof" not in places:
        return "; ".join(f"{name} {value}" for name, value in places.items())
    words = f"worst at dof {places['dof']} (vertex {places['vertex']}, {places['component']})"
    if places.get("elements_off"):
        count = places["elements_off"]
        ids = ", ".join(map(str, places["suspects"])) + (", ..." if count > len(places["suspects"]) else "")
        words += f"; {places['vertices_off']} vertices off, all vertices of {count} element{'s' if count > 1 else ''}: {ids}"
    elif "vertices_off" in places:
        words += f"; {places['vertices_off']} vertices off"
    return words
