"""K with streamed rows against K from stored blocks: ns per tetrahedron, over sizes, vertex orders and threads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.system import Pattern

from .bench.costs import best_and_median
from .bench.meshes import box

SIZES = 5_000, 40_000, 250_000, 2_000_000
THREADS = 1, 2
SECONDS = 4.0


def main(quick: bool) -> int:
    """Time K with streamed rows, and with the blocks of all pairs first: boxes, shuffled, and renumbered."""
    console, term = Console(width=200), StVK(young=1e5, poisson=0.3)
    table = Table(box=None, header_style="bold")
    for column in ("tetrahedra", "vertices", "threads", "all blocks first", "rows at once", "gain", "slots"):
        table.add_column(column, justify="left" if column == "vertices" else "right")
    before = numba.get_num_threads()
    try:
        for size in SIZES[:2] if quick else SIZES:
            for name, mesh in orders(box(size)).items():
                calls = Calls(mesh, term)
                for threads in THREADS:
                    numba.set_num_threads(min(threads, before))
                    table.add_row(f"{mesh.nt}", name, f"{threads}", *calls.costs(0.2 if quick else SECONDS))
    finally:
        numba.set_num_threads(before)
    console.print(table)
    return 0


def orders(mesh: ElementMesh) -> dict[str, ElementMesh]:
    """Return the mesh with three vertex orders: row by row, random, and reverse Cuthill-McKee.

    In the last two, the order of the elements is random, too.
    """
    rng = np.random.default_rng(0)
    shuffled = numbered(mesh, rng.permutation(mesh.nv), rng.permutation(mesh.nt))
    a, b = StVK(young=1.0, poisson=0.3).bind(shuffled).nodes_paired
    links = csr_matrix((np.ones(2 * len(a)), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(mesh.nv, mesh.nv))
    number = np.argsort(reverse_cuthill_mckee(links, symmetric_mode=True))
    return {"row by row": mesh, "shuffled": shuffled, "renumbered": numbered(shuffled, number, np.arange(mesh.nt))}


def numbered(mesh: ElementMesh, number: NDArray[np.int64], elements: NDArray[np.int64]) -> ElementMesh:
    """Return the mesh with new vertex numbers `number` (nv,), and with its elements in the order `elements`."""
    p = np.empty_like(mesh.p)
    p[:, number] = mesh.p
    return ElementMesh(p, number[mesh.t][:, elements].astype(np.int32))


class Calls:
    """Both ways to compute K on a mesh."""

    def __init__(self, mesh: ElementMesh, term: StVK) -> None:
        self._nt, self._assembly = mesh.nt, term.bind(mesh)
        pattern = Pattern(mesh.nv, mesh.d, [self._assembly.nodes_paired])
        self._u = 0.1 * np.sin(2 * np.pi * mesh.p[[1, 2, 0]]).T.copy()
        self._rows, self._data, self._blocks = self._assembly.rows(pattern), np.zeros(pattern.nnz), np.empty(0)

    def costs(self, seconds: float) -> tuple[str, str, str, str]:
        """Return ns per tetrahedron of both ways, their ratio, and the size of the buffers for rows in progress."""
        ways: dict[str, Callable[[], Any]] = {"before": self._all_blocks_first, "now": self._rows_at_once}
        for way in ways.values():
            way()
        best = {name: 1e9 * taken.best / self._nt for name, taken in best_and_median(ways, seconds).items()}
        slots = self._rows.plan.slots.first_eight.nbytes + self._rows.plan.slots.ninth.nbytes
        return f"{best['before']:.0f} ns", f"{best['now']:.0f} ns", f"{best['before'] / best['now']:.2f} x", f"{slots / 1e6:.2f} MB"

    def _all_blocks_first(self) -> None:
        _, self._blocks = self._assembly.blocks(self._u, None, self._blocks)
        self._assembly.pairs.fill(self._rows.of_all_pairs, self._blocks, False, self._data)

    def _rows_at_once(self) -> None:
        self._assembly.fill(self._u, self._rows, self._data, False)
