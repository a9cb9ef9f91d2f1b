"""What a vertex, an edge, a face and a tetrahedron cost each algorithm: counted on small pieces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .algorithms import Algorithm, count, state
from .body import Body
from .meshes import pieces

#: Lame's constants; the counts do not depend on them.
LAM, MU = 1.2, 0.8


def operations(chosen: Algorithm, body: Body) -> int:
    """Counted operations of one run on a body."""
    return count(chosen, body, state(body))[0].operations


def costs(chosen: Algorithm) -> NDArray[np.int64]:
    """(4,) operations for each vertex, edge, face and tetrahedron.

    No algorithm asks for values, only for lists, so its operations are a sum over entities: the counts on a few pieces determine
    what each one costs.

    Raises
    ------
    ArithmeticError
        if no whole numbers explain the counts on all pieces.
    """
    bodies = [Body(mesh, LAM, MU) for mesh in pieces()]
    entities = np.stack([body.entities for body in bodies])
    counted = np.array([operations(chosen, body) for body in bodies])
    found = np.rint(np.linalg.lstsq(entities.astype(float), counted.astype(float), rcond=None)[0]).astype(np.int64)
    if np.linalg.matrix_rank(entities) < 4 or (entities @ found != counted).any():
        raise ArithmeticError(f"{chosen.name}, {chosen.quantity}: {counted} operations are no sum over {entities.tolist()}.")
    return found
