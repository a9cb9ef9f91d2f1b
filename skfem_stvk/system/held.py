"""Whether a body is held: no rigid motion of a part, and no mechanism, is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SupportError
from ..mesh import SimplexMesh
from ..terms import BoundTerm
from .mechanisms import mechanisms
from .rigid import parts_of, rigid_modes_left

MOST = 5


def check_held(mesh: SimplexMesh, terms: Sequence[BoundTerm], held: NDArray[Any], solid: NDArray[np.bool_]) -> None:
    """Refuse a body that can move without strain.

    Mechanisms are looked for where elements are rigid as long as they are not strained: tetrahedra, and triangles in the plane. What holds
    cables, trusses and membranes in space is their tension, which is not known here.

    Parameters
    ----------
    terms : whose edges hold it together; those that also tie it to the ground have `grounded` degrees of freedom.
    held : degrees of freedom of the supports.
    solid : (nt,) whether an element has an elastic material.

    Raises
    ------
    SupportError
        with the rigid modes that are left, by part; and with the pieces that turn, and the joints about which.
    """
    edges = [term.edges for term in terms]
    held = np.union1d(held, grounded_dofs(terms)).astype(np.int64)
    part = parts_of(edges, mesh.nv)
    left = rigid_modes_left(mesh.p, part, held)
    said = []
    if left:
        said.append(
            f"{_listed(left, 'parts')}. Fix more components (fixed={{place: 'xyz'}}), prescribe them, or add an "
            "ElasticFoundation. Parts that should hold together: merge the vertices of their common faces."
        )
    if mesh.k == mesh.d > 1 and solid.any():
        rigid = {each.part: each.count for each in left}
        loose = mechanisms(mesh.p, mesh.t, np.flatnonzero(solid), part, held, rigid, edges)
        if loose:
            facet = ("an edge", "edges") if mesh.d == 2 else ("a face", "faces")
            said.append(
                f"{_listed(loose, 'parts')}. Less than {facet[0]} joins these elements to the others: hold them as well, join them by "
                f"{facet[1]}, or mesh anew."
            )
    if said:
        raise SupportError(f"Not held: {' Besides, '.join(said)}")


def grounded_dofs(terms: Sequence[Any]) -> NDArray[np.int64]:
    """Degrees of freedom that terms tie to the ground, ascending."""
    found = [term.grounded for term in terms if hasattr(term, "grounded")]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *found]))


def _listed(items: Sequence[Any], what: str) -> str:
    """The first few in words, and how many more there are."""
    more = f"; and {len(items) - MOST} more {what}" if len(items) > MOST else ""
    return "; ".join(str(item) for item in items[:MOST]) + more
