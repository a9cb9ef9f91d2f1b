"""W, F and K of energies that are a sum over elements, and the volumes of those elements; laws are subclasses."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..errors import StateError, name_ids
from ..kernels import element_assembly as element_kernels
from ..kernels import node_blocks as block_kernels
from ..kernels import volumes as volume_kernels
from ..kernels.lanes import LANES, MeanPoints, Points
from ..kernels.rows import PairSlots, RowSlots
from ..kernels.threads import locked, run
from .bound_term import BoundElements
from .elements import KernelElements, Quadrature, nbytes, simplex_quadrature
from .pairs import ALL, BlockPattern, Linearized, PairBlocks, PairTerm, Tensions
from .stiffness import StoredLaw
from .streaming import ElementRows
from .topology import kernel_order, out_of_lanes, pairs_of


class Assembly(PairTerm, BoundElements):
    """Energy of a law at the points of elements, and the changes of the elements' volumes.

    Volume ratios are below zero for inverted elements, for either numbering of the nodes. For surfaces in space, and for segments
    in more than one dimension, they are ratios of areas and lengths, which have no sign. Elements other than linear simplices have
    a ratio at each point and at each node; the smallest of these counts. Their smallest stretch is taken over the points at which
    the law is evaluated.

    Parameters
    ----------
    p, t
        Rest coordinates (d, nv) [m], and nodes (n, nt) of the elements.
    stored
        The law and its stored numbers of each element: computed in double, then rounded.
    quadrature
        Kind of the elements and integration rule, by default linear simplices.
    dtype
        Type of results and of stored numbers.
    hourglass_stiffness
        (nt,) coefficients `hourglass/16 (lam + 2 mu)` times section, of boxes with one point.
    elements
        (nt,) ids of the elements, for messages; by default 0, 1, ...
    """

    removable = True

    def __init__(
        self,
        p: Array,
        t: NDArray[np.int32],
        stored: StoredLaw,
        quadrature: Quadrature | None = None,
        dtype: DTypeLike = np.float64,
        hourglass_stiffness: Array | None = None,
        *,
        elements: NDArray[Any] | None = None,
    ) -> None:
        quadrature = quadrature or simplex_quadrature(len(t) - 1)
        self.nodes_paired = pairs_of(t, quadrature.element)
        self.stored, self.quadrature, self.dtype = stored, quadrature, np.dtype(dtype)
        order = kernel_order(t, self.nodes_paired, quadrature.element.is_linear_simplex)
        self.elements = KernelElements(p, order, quadrature, hourglass_stiffness, dtype)
        super().__init__(self.elements.own.lock)
        n = len(order.elements)
        numbers = stored.numbers(p, quadrature, order, dtype).astype(self.dtype)
        self.points, self._D = self.elements.in_points(numbers)
        if n:
            last = self._D[-len(numbers) * LANES :] if self.points is None else self._D[self.points.starts[-2] :]
            last.reshape(-1, LANES)[:, n - (len(self.elements.t) - 1) * LANES :] = 0  # its unused lanes have no stiffness
        self.removed: NDArray[np.bool_] | None = None
        self._t_of_volumes = self.elements.t
        if stored.infinite_energy:  # for its messages
            self._ids = np.arange(t.shape[1]) if elements is None else elements

    @locked
    def without(self, removed: NDArray[np.bool_]) -> Assembly:
        """Return the term without the elements of the mask `removed` (nt,), in the user's order.

        The numbers of removed elements are zero, like those of the unused lanes of the last block. They have neither energy nor
        stiffness, and the pattern stays as it is. They have no volume that could be lost and no stretch: both count as infinite.
        """
        remaining, elements = copy(self), self.elements
        remaining.removed, remaining._D, remaining._t_of_volumes = removed, self._D.copy(), elements.t.copy()
        for name in ("nodes_joined", "form"):
            remaining.__dict__.pop(name, None)
        block, lane = np.divmod(np.flatnonzero(removed[elements.elements]), LANES)
        blocks = len(elements.t)
        starts = np.arange(blocks + 1) * (len(self._D) // blocks) if self.points is None else self.points.starts
        first, count = starts[block] // LANES, np.diff(starts)[block] // LANES
        rows = np.repeat(first - (np.cumsum(count) - count), count) + np.arange(count.sum())
        remaining._D.reshape(-1, LANES)[rows, np.repeat(lane, count)] = 0
        if isinstance(self.points, MeanPoints):
            remaining.points = self.points._replace(hourglass_stiffness=self.points.hourglass_stiffness.copy())
            remaining.points.hourglass_stiffness[block, lane] = 0
        nodes = remaining._t_of_volumes.reshape(blocks, -1, LANES)
        nodes[block, :, lane] = nodes[block, 0, lane][:, None]  # all nodes coincide, so the volume is always zero
        return remaining

    @cached_property
    def nodes_joined(self) -> NDArray[np.int32]:
        """Pairs of nodes (2, n) that elements join: `nodes_paired` without those of removed elements."""
        if self.removed is None:
            return self.nodes_paired
        elements = self.elements
        own = out_of_lanes(elements.t, len(elements.elements))[: elements.element.n, ~self.removed[elements.elements]]
        return pairs_of(elements.own.vertices[own.astype(np.int64)], elements.element)

    @cached_property
    def pairs(self) -> PairBlocks:
        """Products and matrices of the blocks."""
        return PairBlocks(self.elements.own, self.elements.edges, self.elements.d)

    @property
    def law(self) -> Any:
        """The law of the kernels with its numbers."""
        return self.stored.law(self._D)

    def run(
        self, kernel: Callable[..., Any], force: Array | None, *more: Any, law: Any = None, to: tuple[Any, ...] = ()
    ) -> list[Any]:
        """Run a kernel that adds forces to nodes, at the displacements gathered last, and return its results by part.

        The kernel's arguments are, in this order: nodes and slots of the blocks, its output `to`, points, law, rest coordinates,
        displacements, `more`, and slots of forces. The slots are added to `force` (nv, d) unless it is None. Nothing is added if
        the energy is infinite.
        """
        elements, shares = self.elements, self.elements.force_shares
        f = np.empty(0, dtype=self.dtype) if force is None else elements.own.slots("F", shares)
        law = self.law if law is None else law
        arrays = elements.t.ravel(), shares.slots, *to, self.points, law, elements.X, elements.u
        found = run(kernel, shares.parts, *arrays, *more, f)
        if self.stored.infinite_energy:
            self.check(found)
        if force is not None:
            elements.own.add(f, shares, force)
        return found

    @locked
    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return the strain energy [J] at displacements `u` (nv, d) [m]; add the internal force `dW/du` [N] to `force` (nv, d)."""
        self.elements.gather(u)
        W = sum(self._energies(force))
        return W if self.has_energy else 0.0

    def _energies(self, force: Array | None) -> list[float]:
        """Return the energy by part, at the displacements gathered last; add the force to `force`."""
        return self.run(element_kernels.energy_and_force, force)

    def _linearize(self, to: PairSlots | RowSlots, kept: Tensions, force: Array | None) -> list[tuple[float, float]]:
        """Do the same as `_energies`, write the blocks of the edges to `to`, and return energy and trace of K by part."""
        return self.run(element_kernels.linearize, force, float(kept.positive), float(kept.negative), to=(to,))

    def _total(self, found: list[tuple[float, float]]) -> tuple[float, float]:
        """Return the energy and the trace of K, summed over all parts."""
        energies, traces = zip(*found, strict=True)
        return sum(energies) if self.has_energy else 0.0, sum(traces)

    def check(self, found: list[Any]) -> None:
        """Refuse results of a kernel, energies or tuples that begin with one, that are not finite because elements are flat."""
        energies = [one[0] if isinstance(one, tuple) else one for one in found]
        if not np.isfinite(sum(energies)) and self._volume_ratios(self.elements.at_points).min() <= 0:
            self.refuse_inside_out()

    def refuse_inside_out(self) -> None:
        """Refuse the displacements gathered last if elements have no volume left at a point."""
        refuse_inside_out(self._volume_ratios(self.elements.at_points), self._ids, self.stored.infinite_energy)

    @locked
    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        """Return the blocks `K_ab` (9 ne,) of the edges, as in `PairTerm`, with extra space for the sums of threads."""
        elements = self.elements
        to, total = elements.block_shares, elements.edges.total
        size = 9 * (total + len(to.extra))
        blocks = np.empty(size, dtype=self.dtype) if out is None or len(out) != size else out
        blocks[9 * total :] = 0
        elements.gather(u)
        slots = PairSlots(to.slots.reshape(elements.edges.t2e.shape), elements.edges.marks, blocks)
        W, _ = self._total(self._linearize(slots, kept, force))
        block_kernels.fold(blocks, total, to.extra, 9)
        return W, blocks

    def rows(self, pattern: BlockPattern) -> ElementRows:
        return ElementRows(self.elements, self.pairs, pattern, self.dtype)

    def by_rows(self, kept: Tensions) -> bool:
        return True

    def fill(
        self, u: Array, rows: ElementRows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL
    ) -> Linearized:
        """Fill K as in `PairTerm`. If K is made `by_rows`, no array of all blocks is needed."""
        if not self.by_rows(kept):
            return super().fill(u, rows.of_all_pairs, data, add, force, kept)
        with self._lock:
            self.elements.gather(u)
            found, more = rows.fill(partial(self._linearize, kept=kept, force=force), data, add)
            W, total = self._total(found)
        return Linearized(W, total + more)

    @locked
    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """Return the volume ratios (nt,) of the elements at `u` (nv, d), in the user's order."""
        self.elements.gather(u)
        return np.min([self._volume_ratios(points) for points in self._checked_at], axis=0)

    @locked
    def smallest_volume_ratio(self, u: Array) -> float:
        """Return the smallest entry of `volume_ratios(u)`. For linear simplices this costs half as much as F."""
        if self.removed is not None:
            return float(self.volume_ratios(u).min())
        self.elements.gather(u)
        return min(self._smallest_volume_ratio(points, np.empty(0)) for points in self._checked_at)

    @locked
    def step_limit(self, u: Array, v: Array) -> float:
        """Return the smallest `s > 0` at which an element that is not inverted at `u` has no volume left at `u + s v` (nv, d); or
        infinity.
        """
        elements = self.elements
        if elements.k < elements.d:
            return np.inf
        elements.gather(u)
        V = elements.own.gathered("direction", v, np.float64)
        arrays, parts = (elements.X, elements.u, V, elements.k), elements.force_shares.parts
        t = self._t_of_volumes.ravel()
        return min(min(run(volume_kernels.step_limit, parts, t, points, *arrays)) for points in self._checked_at)

    @property
    def _checked_at(self) -> tuple[Points | MeanPoints | None, ...]:
        """Tables of the points at which volumes are checked: one for linear simplices, else each point and each node."""
        if self.points is None:
            return (None,)
        return self.elements.at_points, self.elements.at_nodes

    def _volume_ratios(self, points: Points | MeanPoints | None) -> NDArray[np.float64]:
        """Return the smallest ratio of each element over these points, at the displacements gathered last."""
        own = np.empty(len(self.elements.t) * LANES)
        self._smallest_volume_ratio(points, own)
        return self.of_elements(own)

    def _smallest_volume_ratio(self, points: Points | MeanPoints | None, out: Array) -> float:
        elements = self.elements
        arrays = elements.t.ravel(), points, elements.X, elements.u
        return min(run(volume_kernels.volume_ratios, elements.force_shares.parts, *arrays, elements.k, elements.d, out))

    def of_elements(self, own: Array) -> Array:
        """Return values of the elements in the user's order, (nt,); infinite for removed elements."""
        values = self.elements.in_user_order(own)
        if self.removed is not None:
            values[self.removed] = np.inf
        return values

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        parts = {"edges of the mesh": self.nodes_paired.nbytes} | self.elements.memory()
        parts["elements"] += self._D.nbytes
        return parts | {"blocks of edges": nbytes(list(self._scratch.values()))}


def refuse_inside_out(ratios: NDArray[np.float64], ids: NDArray[Any], infinite_energy: str) -> None:
    """Refuse a state of elements with these `ids` and ratios `J` of which at least one is not positive, within rounding.

    `infinite_energy` is the end of the message, as in `StoredLaw`.
    """
    least = ratios.min()
    raise StateError(
        f"{name_ids(ids[ratios <= max(least, 0.0)], 'element')} inverted or flat (J down to {least:.2g}), where {infinite_energy}"
    )
