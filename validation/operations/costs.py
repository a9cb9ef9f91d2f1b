"""Operations per vertex, edge, face and tetrahedron of each algorithm, from counts on small meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .algorithms import Algorithm, count, state
from .body import Body
from .meshes import pieces

#: Lame constants; the counts do not depend on them.
LAM, MU = 1.2, 0.8


def operations(chosen: Algorithm, body: Body) -> int:
    """Return the counted operations of one run on a body."""
    return count(chosen, body, state(body))[0].operations


def costs(chosen: Algorithm) -> NDArray[np.int64]:
    """Return the operations per vertex, edge, face and tetrahedron, (4,).

    No algorithm branches on values, only on index lists, so its operations are a sum over entities. The counts on a few small
    meshes determine the operations per entity.

    Raises
    ------
    ArithmeticError
        if no whole numbers explain the counts on all meshes.
    """
    bodies = [Body(mesh, LAM, MU) for mesh in pieces()]
    entities = np.stack([body.entities for body in bodies])
    counted = np.array([operations(chosen, body) for body in bodies])
    found = np.rint(np.linalg.lstsq(entities.astype(float), counted.astype(float), rcond=None)[0]).astype(np.int64)
    if np.linalg.matrix_rank(entities) < 4 or (entities @ found != counted).any():
        raise ArithmeticError(
            f"{chosen.name}, {chosen.quantity}: counts = {counted}; expected sums over entities {entities.tolist()}"
        )
    return found
