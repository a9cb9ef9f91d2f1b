"""What a term is: a specification that binds to a mesh, and what it is then."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..edges import Linearized, Rows
from ..edges.rows import Places
from ..mesh import SimplexMesh

Array = NDArray[np.floating[Any]]


class BoundTerm(Protocol):
    """A term on a mesh: it adds what it contributes at displacements `u` (nv, d) to arrays that it is handed."""

    @property
    def edges(self) -> NDArray[np.int32]:
        """(2, ne) pairs of vertices `a < b` that it couples, in lexicographic order."""

    def energy(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J]; adds the internal force [N] to `force` (nv, d)."""

    def rows(self, pattern: Places) -> Rows:
        """Where its blocks stand in the values of a matrix of this pattern."""

    def tangent(self, u: Array, rows: Rows, data: Array, add: bool, force: Array | None = None) -> Linearized:
        """Write the tangent stiffness [N/m] of its edges and vertices to CSR values, or add it; adds the force to `force` (nv, d)."""

    def edge_blocks(self, u: Array, force: Array | None = None, out: Array | None = None) -> tuple[float, Array]:
        """The energy [J], and what `add_product` needs at `u`; `out` is what it returned before, to be filled anew."""

    def add_product(self, blocks: Array, v: Array, out: Array) -> None:
        """Add `K v` to `out` (nv, d)."""

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""


class Term(Protocol):
    """A specification without a mesh."""

    def bind(self, mesh: SimplexMesh, dtype: DTypeLike) -> BoundTerm:
        """The term on this mesh, with results of this type."""
