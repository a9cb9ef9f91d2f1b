"""What a term is: a specification that binds to a mesh, and what it is then."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..edges import Places
from ..mesh import SimplexMesh

Array = NDArray[np.float64]


class BoundTerm(Protocol):
    """A term on a mesh: it adds what it contributes at displacements `u` (nv, d) to arrays that it is handed."""

    edges: NDArray[np.int32]
    """(2, ne) pairs of vertices `a < b` that it couples."""

    def energy(self, u: Array) -> float:
        """Strain energy [J]."""

    def add_force(self, u: Array, out: Array) -> None:
        """Add the internal force [N] to `out` (nv, d)."""

    def add_tangent(self, u: Array, places: Places, data: Array) -> None:
        """Add the tangent stiffness [N/m] to the values of a CSR matrix."""


class Term(Protocol):
    """A specification without a mesh."""

    def bind(self, mesh: SimplexMesh) -> BoundTerm:
        """The term on this mesh."""
