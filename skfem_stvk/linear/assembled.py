"""The compiled loop of conjugate gradients on a matrix: of its blocks those above the diagonal are kept, as if they were those of edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import triu

from ..kernels import cg as kernels
from .blocks import BlockStructure
from .checks import Newest, check_kind, checked_values
from .edge_cg import EdgeCg, EdgeFactors
from .solver import Kind, LinearSolver, Unknowns
from .vertices import VertexRows


class AssembledAnalysis:
    """The edges of the graph of K, and room for the values."""

    def __init__(self, solver: LinearSolver, unknowns: Unknowns, omega: float) -> None:
        self._solver, self._unknowns, self._newest = solver, unknowns, Newest()
        self._rows = VertexRows(unknowns)
        self._above = BlockStructure.of(triu(self._rows.graph, 1, format="csr"))
        edges = np.stack([self._above.row_of_each(), self._above.columns], axis=1)
        self._blocks = self._above.room()
        self._search = EdgeCg(edges, self._rows.vertices, self._rows.places, assembled=True, omega=omega)

    def factorise(self, K: Any, kind: Kind) -> EdgeFactors:
        """The values, and the inverses of the diagonal blocks."""
        check_kind(self._solver, kind)
        values, rows, search = checked_values(K, self._unknowns), self._rows, self._search
        unknowns = rows.first, rows.row, rows.component, K.indptr, K.indices, values
        kernels.fill_edges(self._above.rows, self._above.columns, *unknowns, self._blocks, search.diagonal)
        search.fill(self._blocks)
        return EdgeFactors(search, self._unknowns.n, self._newest)
