"""W, F and K of energies that are a sum over elements: of a law at points, and of an edge form with what solvers ask of it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..errors import StateError, StvkError, name_ids
from ..kernels import blocks as block_kernels
from ..kernels import discrete_gradient as gradient_kernels
from ..kernels import elements as element_kernels
from ..kernels import reduced as reduced_kernels
from ..kernels import stretches as stretch_kernels
from ..kernels import volumes as volume_kernels
from ..kernels.lanes import LANES, MeanPoints, Points
from ..kernels.laws import IsotropicLaw, numbers_in
from ..kernels.principal import WarpedLaw
from ..kernels.rows import PairSlots, RowSlots
from ..kernels.threads import in_turn, run
from .elements import OwnElements, Quadrature, frames_at, nbytes, simplex_quadrature
from .form import EdgeForm
from .pairs import ALL, BlockPattern, Linearized, PairBlocks, PairTerm, Tensions
from .stiffness import Frames, GeneralStiffness, Stiffness, StoredLaw, check_range, flat_of
from .streaming import ElementRows
from .topology import OwnOrder, Shares, in_lanes, out_of_lanes, own_order, pairs_of

#: Places of the strains of elements of so many dimensions in the order 11, 22, 33, 12, 13, 23.
PLACES = {1: (0,), 2: (0, 1, 3), 3: (0, 1, 2, 3, 4, 5)}


class ElementTerm(PairTerm):
    """The calls of the kernels on elements, and how the volumes of those change.

    Ratios of volumes are below zero where an element is inside out, whichever way round its nodes are numbered. Of surfaces in
    space, and of segments in more than one dimension, they are ratios of areas and lengths, which have no sign. Elements that
    are no linear simplices have a ratio at each point and at each node, and the smallest of these counts; their smallest
    stretch is that of their points, where the law is asked.

    Elements `t` (n, nt) have rest coordinates `p` (d, nv) [m]. `stored` gives what the kernels store of them at each point, (m,
    nq, nt) from their nodes in the mesh (n, nt), the order, and the `quadrature`: computed in double, then rounded.
    """

    symmetric = balanced = has_energy = True

    def __init__(
        self,
        p: NDArray[np.float64],
        t: NDArray[np.int32],
        quadrature: Quadrature,
        stored: Callable[[NDArray[np.int32], OwnOrder], NDArray[np.float64]],
        dtype: DTypeLike = np.float64,
        resistance: Array | None = None,
    ) -> None:
        self.nodes_paired = pairs_of(t, quadrature.element)
        self.quadrature, self.dtype = quadrature, np.dtype(dtype)
        order = own_order(t, self.nodes_paired, quadrature.element.is_linear_simplex)
        self.elements = OwnElements(p, order, quadrature, resistance, dtype)
        super().__init__(self.elements.own.turn)
        n = len(order.elements)
        numbers = stored(order.vertices[order.t], order).astype(self.dtype)
        self.points, self._D = self.elements.in_points(numbers)
        last = self._D[-len(numbers) * LANES :] if self.points is None else self._D[self.points.starts[-2] :]
        last.reshape(-1, LANES)[:, n - (len(self.elements.t) - 1) * LANES :] = 0  # what only fills it has no stiffness
        self.gone: NDArray[np.bool_] | None = None
        self._t_of_volumes = self.elements.t

    @in_turn
    def without(self, gone: NDArray[np.bool_]) -> ElementTerm:
        """Return the term without the elements that are `gone` (nt,), in the order in which they were given.

        Their numbers are zero, as those of the lanes that only fill the last block: they have neither energy nor stiffness, and the
        pattern stays as it is. They have no volume that could be lost, and no stretch: both count as infinite.
        """
        left = copy(self)
        left._D = self._D.copy()
        left._take_out(gone)
        return left

    def _take_out(self, gone: NDArray[np.bool_]) -> None:
        """Write zeros for elements to arrays that belong to this term alone."""
        elements = self.elements
        self.gone = gone
        self.__dict__.pop("nodes_joined", None)
        block, lane = np.divmod(np.flatnonzero(gone[elements.elements]), LANES)
        blocks = len(elements.t)
        starts = np.arange(blocks + 1) * (len(self._D) // blocks) if self.points is None else self.points.starts
        first, count = starts[block] // LANES, np.diff(starts)[block] // LANES
        rows = np.repeat(first - (np.cumsum(count) - count), count) + np.arange(count.sum())
        self._D.reshape(-1, LANES)[rows, np.repeat(lane, count)] = 0
        if isinstance(self.points, MeanPoints):
            self.points = self.points._replace(resistance=self.points.resistance.copy())
            self.points.resistance[block, lane] = 0
        self._t_of_volumes = elements.t.copy()
        nodes = self._t_of_volumes.reshape(blocks, -1, LANES)
        nodes[block, :, lane] = nodes[block, 0, lane][:, None]  # all in one place: no volume, now or later

    @cached_property
    def nodes_joined(self) -> NDArray[np.int32]:
        """(2, n) the pairs of nodes that elements hold together: `nodes_paired`, but for those of elements that were taken out."""
        if self.gone is None:
            return self.nodes_paired
        elements = self.elements
        own = out_of_lanes(elements.t, len(elements.elements))[: elements.element.n, ~self.gone[elements.elements]]
        return pairs_of(elements.own.vertices[own.astype(np.int64)], elements.element)

    @cached_property
    def pairs(self) -> PairBlocks:
        """Products and matrices that are made of the blocks."""
        return PairBlocks(self.elements.own, self.elements.edges, self.elements.d)

    def _open(self, u: Array, force: Array | None) -> tuple[Shares, Array]:
        """Shares, and slots at displacements `u` (nv, d) that `_close` adds to `force` (nv, d): none without a force."""
        own, shares = self.elements.own, self.elements.forces
        f = np.empty(0, dtype=self.dtype) if force is None else own.slots("F", shares)
        self.elements.gather(u)
        return shares, f

    def _close(self, f: Array, force: Array | None) -> None:
        """Add what stands in the slots to `force` (nv, d). No `with` statement: it takes Python 0.4 kB a call."""
        if force is not None:
            self.elements.own.add(f, self.elements.forces, force)

    @in_turn
    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Strain energy [J] at displacements `u` (nv, d) [m]; adds the internal force `dW/du` [N] to `force` (nv, d)."""
        shares, f = self._open(u, force)
        W = self._energy(shares, f)
        self._close(f, force)
        return W

    @abstractmethod
    def _energy(self, shares: Shares, f: Array) -> float:
        """The energy at the displacements that were gathered last; adds the forces to the slots `f`, unless that is empty."""

    @in_turn
    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        """Return, as in `PairTerm`, the blocks `K_ab` (9 ne,) of the edges, with room for the sums of threads."""
        elements = self.elements
        to, total = elements.blocks, elements.edges.total
        size = 9 * (total + len(to.extra))
        blocks = np.empty(size, dtype=self.dtype) if out is None or len(out) != size else out
        blocks[9 * total :] = 0
        shares, f = self._open(u, force)
        slots = PairSlots(to.slots.reshape(len(elements.t), -1), elements.edges.marks, blocks)
        W, _ = self._total(self._linearize(shares, slots, f, kept))
        self._close(f, force)
        block_kernels.fold(blocks, total, to.extra, 9)
        return W, blocks

    def rows(self, pattern: BlockPattern) -> ElementRows:
        return ElementRows(self.elements, self.pairs, pattern, self.dtype)

    def by_rows(self, kept: Tensions) -> bool:
        return True

    @in_turn
    def fill(
        self, u: Array, rows: ElementRows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL
    ) -> Linearized:
        """Fill K as in `PairTerm`, without an array of all blocks."""
        shares, f = self._open(u, force)
        found, more = rows.fill(lambda to: self._linearize(shares, to, f, kept), data, add)
        self._close(f, force)
        W, total = self._total(found)
        return Linearized(W, total + more)

    @abstractmethod
    def _linearize(self, shares: Shares, to: PairSlots | RowSlots, f: Array, kept: Tensions) -> list[Any]:
        """Do what `_energy` does, and write the blocks of the edges to `to`; return the kernel's results by part, for `_total`."""

    def _total(self, found: list[Any]) -> tuple[float, float]:
        """The energy and the trace of K from all parts."""
        energies, traces = zip(*found, strict=True)
        return sum(energies), sum(traces)

    @in_turn
    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """(nt,) ratios at `u` (nv, d), of the elements in the order in which they were given."""
        self.elements.gather(u)
        return np.min([self._volume_ratios(points) for points in self._checked_at], axis=0)

    @in_turn
    def smallest_volume_ratio(self, u: Array) -> float:
        """The smallest of `volume_ratios(u)`, of linear simplices for half the price of F."""
        self.elements.gather(u)
        if self.gone is not None:
            return min(float(self._volume_ratios(points).min()) for points in self._checked_at)
        return min(self._smallest_volume_ratio(points, np.empty(0)) for points in self._checked_at)

    @in_turn
    def step_limit(self, u: Array, v: Array) -> float:
        """The smallest `s > 0` at which an element right side out at `u` has no volume left at `u + s v` (nv, d); or infinity."""
        elements = self.elements
        if elements.k < elements.d:
            return np.inf
        elements.gather(u)
        V = elements.own.gathered("direction", v, np.float64)
        arrays, parts = (elements.X, elements.u, V, elements.k), elements.forces.parts
        t = self._t_of_volumes.ravel()
        return min(min(run(volume_kernels.step_limit, parts, t, points, *arrays)) for points in self._checked_at)

    @property
    def _checked_at(self) -> tuple[Points | MeanPoints | None, ...]:
        """Tables of the places where volumes are looked at: linear simplices have one volume, others one at each point and node."""
        if self.points is None:
            return (None,)
        return self.elements.at_points, self.elements.at_nodes

    def _volume_ratios(self, points: Points | MeanPoints | None) -> NDArray[np.float64]:
        """The smallest ratio of each element among these points, at the displacements that were gathered last."""
        own = np.empty(len(self.elements.t) * LANES)
        self._smallest_volume_ratio(points, own)
        return self._infinite_if_gone(self.elements.in_their_order(own))

    def _infinite_if_gone(self, values: Array) -> Array:
        if self.gone is not None:
            values[self.gone] = np.inf
        return values

    def _smallest_volume_ratio(self, points: Points | MeanPoints | None, out: Array) -> float:
        elements = self.elements
        arrays = elements.t.ravel(), points, elements.X, elements.u
        return min(run(volume_kernels.volume_ratios, elements.forces.parts, *arrays, elements.k, elements.d, out))

    def memory(self) -> dict[str, int]:
        """Bytes of its arrays, by part."""
        parts = {"edges of the mesh": self.nodes_paired.nbytes} | self.elements.memory()
        parts["elements"] += self._D.nbytes
        return parts | {"blocks of edges": nbytes([] if self._filled is None else self._filled)}


class LawAssembly(ElementTerm):
    """A law at the points of elements, whatever it is: what its kernels need beside its numbers.

    Parameters
    ----------
    p, t : rest coordinates (d, nv) [m], and nodes (n, nt) of the elements.
    law : the law, and what it stores of each element.
    quadrature : the kind of elements and the rule, by default linear simplices.
    dtype : of results and of what is stored, which is computed in double and rounded then.
    resistance : (nt,) `hourglass/16 (lam + 2 mu)` times section, of boxes with one point.
    elements : (nt,) their ids, for messages; by default 0, 1, ...
    """

    def __init__(
        self,
        p: Array,
        t: NDArray[np.int32],
        law: StoredLaw,
        quadrature: Quadrature | None = None,
        dtype: DTypeLike = np.float64,
        resistance: Array | None = None,
        *,
        elements: NDArray[Any] | None = None,
    ) -> None:
        quadrature = quadrature or simplex_quadrature(len(t) - 1)

        def stored(nodes: NDArray[np.int32], own: OwnOrder) -> Array:
            at = []
            for frames in frames_at(p, nodes, quadrature, own):
                numbers = law.stored(frames, own.elements)
                check_range(numbers[: law.moduli], frames, own.elements, dtype)
                at.append(np.concatenate([frames.Ri, numbers]))
            return np.stack(at, axis=1)

        super().__init__(p, t, quadrature, stored, dtype, resistance)
        self._law_of, self._barrier = law.law, law.barrier
        if law.barrier:  # which needs them for its messages
            self._ids = np.arange(t.shape[1]) if elements is None else elements

    @property
    def law(self) -> Any:
        """The law of the kernels with its numbers."""
        return self._law_of(self._D)

    def _energy(self, shares: Shares, f: Array) -> float:
        return self._checked(sum(run(element_kernels.energy_and_force, shares.parts, *self._arrays(shares), f)))

    def _linearize(self, shares: Shares, to: PairSlots | RowSlots, f: Array, kept: Tensions) -> list[Any]:
        elements = self.elements
        arrays = elements.t.ravel(), shares.slots, to, self.points, self.law, elements.X, elements.u
        return run(element_kernels.linearize, shares.parts, *arrays, float(kept.positive), float(kept.negative), f)

    def _total(self, found: list[Any]) -> tuple[float, float]:
        W, total = super()._total(found)
        return self._checked(W), total

    def _arrays(self, shares: Shares) -> tuple[Any, ...]:
        """The arguments of kernels that add to nodes, behind the blocks that they go over."""
        return self.elements.t.ravel(), shares.slots, self.points, self.law, self.elements.X, self.elements.u

    def _checked(self, W: float) -> float:
        """The energy, unless that is not finite because elements have no volume left at a point."""
        if self._barrier and not np.isfinite(W):
            ratios = self._volume_ratios(self.elements.at_points)
            if ratios.min() <= 0:
                refuse_inside_out(ratios, self._ids, self._barrier)
        return W


class StretchesAssembly(LawAssembly):
    """A law of principal stretches, whose decomposition rounds more than a sum does."""

    passes_inversion = True

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add what `add_sizes` does, three times, to `out` (nv, d) [N]: stretches have errors of several eps."""
        sizes = np.zeros(u.shape)
        self.add_sizes(u, sizes)
        out += 3 * sizes


class EnergyAssembly(LawAssembly):
    """A law with an energy that is one of the strain: it has a force between two states. Parameters as in `LawAssembly`."""

    @in_turn
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add to `force` (nv, d) [N] what stresses between two states `u0`, `u1` (nv, d) pull, as in `HasMeanForce`.

        It is a discrete gradient of the energy (`kernels.discrete_gradient`): forces and torques about `X + (1 - theta) u0 + theta
        u1` balance, and for `w0 = w1 = theta = 1/2` the work over `u1 - u0` is `W(u1) - W(u0)` to rounding of these two.
        """
        shares, f = self._open(u0, force)
        change = self.elements.own.gathered("direction", u1, np.float64)
        change -= self.elements.u
        arrays = *self._arrays(shares), change, self.elements.k == self.elements.d, *map(float, weights), float(theta)
        R = self._checked(sum(run(gradient_kernels.discrete_mean_force, shares.parts, *arrays, f)))
        self._close(f, force)
        if not np.isfinite(R):
            self.energy_and_force(u1)  # which says why
        return R


class TensionAssembly(EnergyAssembly):
    """Sheets and cables that bear no compression: their rounding errors are at most those of St. Venant-Kirchhoff's law."""

    @in_turn
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add what `Assembly.add_round_off` does, of the same strains with all of their stress."""
        shares, f = self._open(u, out)
        t, slots, points, law, X, own = self._arrays(shares)
        run(element_kernels.round_off, shares.parts, t, slots, points, IsotropicLaw(law.D), X, own, f)
        self._close(f, out)


class FramedAssembly(LawAssembly):
    """Linear elasticity in frames that are given for each moment: what the body gains or loses as they turn is work from outside.

    `frames` gives rotations (nt, 3, 3) for a time or load factor, checked.
    """

    has_energy = False

    def __init__(self, frames: Callable[[Any], Array], *arguments: Any, **others: Any) -> None:
        super().__init__(*arguments, **others)
        self._frames = frames
        self.at(0.0)

    @in_turn
    def at(self, t: Any) -> None:
        """Turn the frames to where they are at load factor or moment `t`."""
        elements, m = self.elements, 6 + 11
        R = in_lanes(self._frames(t).reshape(-1, 9)[elements.elements].T.astype(self.dtype)).reshape(-1, 9, LANES)
        sets = self._D.reshape(-1, m, LANES)
        counts = 1 if self.points is None else np.diff(self.points.starts) // (m * LANES)
        sets[:, 8:] = np.repeat(R, counts, axis=0)

    @in_turn
    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """0; adds the internal force [N] at `u` (nv, d) to `force` (nv, d)."""
        super().energy_and_force(u, force)
        return 0.0

    def _total(self, found: list[Any]) -> tuple[float, float]:
        return 0.0, super()._total(found)[1]

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add what `add_sizes` does, three times, to `out` (nv, d) [N]: frames at rest are turned, with errors of their own."""
        sizes = np.zeros(u.shape)
        self.add_sizes(u, sizes)
        out += 3 * sizes


class Assembly(LawAssembly):
    """St. Venant-Kirchhoff: on linear simplices an edge form. Its strains are quadratic in displacements, so much is known exactly.

    Parameters as in `LawAssembly`, with the stiffness of each element as its law.
    """

    def __init__(
        self,
        p: Array,
        t: NDArray[np.int32],
        stiffness: Stiffness,
        quadrature: Quadrature | None = None,
        dtype: DTypeLike = np.float64,
        resistance: Array | None = None,
        *,
        elements: NDArray[Any] | None = None,
    ) -> None:
        super().__init__(p, t, stiffness, quadrature, dtype, resistance, elements=elements)
        self._mesh = p, t, stiffness

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """(nt,) smallest principal stretch at `u` (nv, d) within their own dimensions, of the elements in the order in which they
        were given."""
        own = np.empty(len(self.elements.t) * LANES)
        self._smallest_stretch(u, own)
        return self._infinite_if_gone(self.elements.in_their_order(own))

    def smallest_stretch(self, u: Array) -> float:
        """The smallest of `smallest_stretches(u)`, of linear simplices for one and a half times the price of F."""
        return self._smallest_stretch(u, np.empty(0)) if self.gone is None else float(self.smallest_stretches(u).min())

    @in_turn
    def _smallest_stretch(self, u: Array, out: Array) -> float:
        elements = self.elements
        elements.gather(u)
        arrays = elements.t.ravel(), elements.at_points, elements.X, elements.u
        return min(run(stretch_kernels.smallest_stretches, elements.forces.parts, *arrays, elements.k, out))

    def _linearize(self, shares: Shares, to: PairSlots | RowSlots, f: Array, kept: Tensions) -> list[Any]:
        if not kept.warped:
            return super()._linearize(shares, to, f, kept)
        elements = self.elements
        law = WarpedLaw(self.law.D, self.law, flat_of(elements.k, elements.d))
        arrays = elements.t.ravel(), shares.slots, to, self.points, law, elements.X, elements.u
        return run(element_kernels.linearize, shares.parts, *arrays, 0.0, 0.0, f)

    @cached_property
    def form(self) -> EdgeForm:
        """The edge form of linear simplices.

        StvkError for other elements, whose strain is not the same everywhere.
        """
        self._refuse_points()
        p, t, stiffness = self._mesh
        if self.gone is None:
            return EdgeForm(p, t, stiffness)
        kept = ~self.gone[:, None, None]
        return EdgeForm(p, t, GeneralStiffness(lambda: kept * stiffness.coefficients(p, t)))

    def _refuse_points(self) -> None:
        """Refuse elements that are no linear simplices, whose strain differs from point to point."""
        if self.points is not None:
            raise StvkError(
                f"{self.quadrature.element.name} have no edge form: their strain is not the same everywhere, so the lengths of "
                "their edges do not say it. Take degree=1 to look at edges and their pairs."
            )

    def _take_out(self, gone: NDArray[np.bool_]) -> None:
        super()._take_out(gone)
        self.__dict__.pop("form", None)

    @in_turn
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all that adds up to the force at `u` (nv, d) to `out` (nv, d) [N].

        Times eps it is the size of the force's rounding error, of which that of `u` itself is a part.
        """
        shares, f = self._open(u, out)
        run(element_kernels.round_off, shares.parts, *self._arrays(shares), f)
        self._close(f, out)

    @in_turn
    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """(5,) coefficients `c` [J] of the energy along `u + s v`, both (nv, d): exactly `c_0 + c_1 s + ... + c_4 s^4`, at any
        `s`."""
        elements = self.elements
        elements.gather(u)
        V = elements.own.gathered("direction", v, np.float64)
        arrays = elements.t.ravel(), self.points, self.law, elements.X, elements.u, V
        return np.asarray(np.sum(run(element_kernels.along, elements.forces.parts, *arrays), axis=0))

    def strain_products(self, fields: Array, most: int) -> Iterator[Array]:
        """Yield rows as in `HasStrainProducts`; rows of zeros for elements that were taken out."""
        elements, X = self.elements, np.zeros((len(fields), 3))
        X[elements.own.vertices] = elements.X.reshape(-1, 3)
        k, nt = elements.k, len(elements.elements)
        fields = np.concatenate([X[:, : elements.d, None], fields], axis=2)  # with x_0 = 1 the place where a node is
        n, s = fields.shape[2], k * (k + 1) // 2
        pairs, at_once = n * (n + 1) // 2, max(1, most // s)
        work, out = np.empty((s, pairs)), np.empty((min(at_once, nt) * s, pairs))
        nodes = elements.own.vertices[out_of_lanes(elements.t, nt)]
        tables = [None] if self.points is None else self.points.B
        for q, B in enumerate(tables if not isinstance(self.points, MeanPoints) else [self.points.B]):
            for first in range(0, nt, at_once):
                ids = np.arange(first, min(first + at_once, nt))
                own = nodes[: elements.element.n, ids]
                spokes = (fields[own[1:]] - fields[own[:1]]).transpose(1, 0, 2, 3)  # (n, nodes - 1, d, R + 1)
                Ri, L = self._factors(ids, q)
                if B is not None:
                    of = B[None, : spokes.shape[1], :k] if B.ndim == 2 else _of_elements(B, ids)[:, : spokes.shape[1], :k]
                    spokes = np.einsum("nai,nadr->nidr", np.broadcast_to(of, (len(ids), *of.shape[1:])), spokes)
                G = np.matmul(np.swapaxes(Ri, 1, 2), spokes[:, :k].reshape(len(ids), k, -1)).reshape(spokes.shape)
                rows = out[: len(ids) * s]
                reduced_kernels.strain_rows(np.ascontiguousarray(G), L, work, rows)
                yield rows

    def _factors(self, ids: NDArray[np.int64], q: int) -> tuple[Array, Array]:
        """`Ri` (n, k, k) at a point of elements in their own order, and `L` (n, s, s) with `W = 1/2 |L M|^2` there."""
        m, k, (block, lane) = numbers_in(self.law), self.elements.k, np.divmod(ids, LANES)
        at, weight = block * m * LANES, 1.0
        if self.points is not None:
            sets = np.diff(self.points.starts)[block] // (m * LANES)
            at, weight = self.points.starts[block] + np.minimum(q, sets - 1) * m * LANES, float(self.points.weights[q])
        numbers = self._D[(at + lane)[:, None] + LANES * np.arange(m)].astype(np.float64)
        kept = np.array(PLACES[k])
        return Frames.upper(numbers[:, :6].T)[:, :k, :k], square_roots(weight * _forms(numbers[:, 6:])[:, kept[:, None], kept])

    @in_turn
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add to `force` (nv, d) [N] what mean tensions of two states `u0`, `u1` (nv, d) pull along the edges as they are in
        between.

            f_a = sum_b t_ab (p_a - p_b)        t = L (w0 zeta(u0) + w1 zeta(u1)),  p at (1 - theta) u0 + theta u1

        Forces and torques about `p` balance. The work over `u1 - u0` is `W(u1) - W(u0)` for `w0 = w1 = theta = 1/2`, and with other
        weights of sum 1 more by `(w1 - w0)` times `1/4 dzeta' L dzeta` [J], which is returned: zero for a rigid motion, and never
        negative.
        """
        shares, f = self._open(u0, force)
        change = self.elements.own.gathered("direction", u1, np.float64)
        change -= self.elements.u
        states = change, *map(float, weights), float(theta)
        R = sum(run(element_kernels.mean_force, shares.parts, *self._arrays(shares), *states, f))
        self._close(f, force)
        return R

    @in_turn
    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add to `force` (nv, d) the resistance of the edges to velocities `v` at `u` (nv, d), for a relaxation time of 1 s.

            f_a = sum_b t_ab (p_a - p_b)        t = L dzeta/dt,  dzeta_ab/dt = 2 (p_a - p_b) . (v_a - v_b)

        It is `2 J' L J v`, the product with the Gauss-Newton tangent, and the derivative by `v` of `R = 1/4 dzeta/dt' L dzeta/dt`
        [W], which is returned: the power that it takes is `2 R`. Rigid motions, turning ones too, meet no resistance.
        """
        shares, f = self._open(u, force)
        V = self.elements.own.gathered("direction", v, np.float64)
        R = sum(run(element_kernels.damping_force, shares.parts, *self._arrays(shares), V, f))
        self._close(f, force)
        return R

    @in_turn
    def tensions(self, u: Array) -> Array:
        """Return the tensions `t = L zeta` (ne,) [N/m] at `u` (nv, d) of the edges in lexicographic order, without `form`.

        StvkError for other elements than linear simplices.
        """
        self._refuse_points()
        self.elements.gather(u)
        return np.asarray(self._tensions()[self.elements.lexicographic])

    def _tensions(self) -> Array:
        """Tensions of the edges in their own order, at the displacements that were gathered last."""
        elements = self.elements
        to, total = elements.blocks, elements.edges.total
        t = elements.own.room("t", total + len(to.extra), self.dtype)
        t[total:] = 0
        slots = to.slots.reshape(len(elements.t), -1)
        arrays = elements.t.ravel(), slots, elements.edges.marks, self.law, elements.X, elements.u
        run(element_kernels.tensions, elements.forces.parts, *arrays, t)
        block_kernels.fold(t, total, to.extra, 1)
        return t[:total]

    @in_turn
    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        """Return the blocks as in `ElementTerm`: `K = 2 J' L J + sum g t Lap (x) I`, `g` the factors of `kept` for tensions `t`."""
        W, blocks = super().blocks(u, force, out, kept)
        if kept.negative != kept.positive and self.points is None:
            less = kept.positive - kept.negative
            run(block_kernels.weigh_negative, self.pairs.products.parts, self._tensions(), less, blocks)
        return W, blocks

    def by_rows(self, kept: Tensions) -> bool:
        """Return as in `PairTerm`; the signs of tensions of linear simplices are known only when all elements have been added."""
        return kept.negative == kept.positive or self.points is not None

    @in_turn
    def fill(
        self, u: Array, rows: ElementRows, data: Array, add: bool, force: Array | None = None, kept: Tensions = ALL
    ) -> Linearized:
        """Fill K as in `ElementTerm`; by the blocks of all pairs where not `by_rows`."""
        if self.by_rows(kept):
            return super().fill(u, rows, data, add, force, kept)
        W, blocks = self.blocks(u, force, self._filled, kept)
        self._filled = blocks
        return Linearized(W, self.pairs.fill(rows.of_all_pairs, blocks, add, data))


def refuse_inside_out(ratios: NDArray[np.float64], ids: NDArray[Any], barrier: str) -> None:
    """Refuse a state of elements with these `ids` and ratios `J`, of which one at least is not positive, but for rounding.

    `barrier`: what is infinite there, and what to take instead.
    """
    least = ratios.min()
    raise StateError(
        f"{name_ids(ids[ratios <= max(least, 0.0)], 'element')} inside out or flat (J down to {least:.2g}), where {barrier}"
    )


def _forms(numbers: Array) -> Array:
    """(n, 6, 6) `C` with `W = 1/2 M' C M` for strains in the order of the kernels, from the numbers of a law of StVK (n, m)."""
    twice = np.array([1.0, 1, 1, 2, 2, 2])
    if numbers.shape[1] == 2:
        trace = np.outer(*[np.array([1.0, 1, 1, 0, 0, 0])] * 2)
        return np.asarray((numbers[:, :1, None] * trace + numbers[:, 1:, None] * np.diag(twice)) / 2)
    rows, columns = np.triu_indices(6)
    C = np.zeros((len(numbers), 6, 6))
    C[:, rows, columns] = C[:, columns, rows] = numbers
    return np.asarray(C * twice[:, None] * twice / 2)


def square_roots(C: Array) -> Array:
    """(n, s, s) L with `L' L = C`, symmetric and positive semi-definite but for rounding."""
    try:
        return np.ascontiguousarray(np.swapaxes(np.linalg.cholesky(C), 1, 2))
    except np.linalg.LinAlgError:  # no stiffness in some direction
        values, vectors = np.linalg.eigh(C)
        return np.ascontiguousarray(np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2))


def _of_elements(B: Array, ids: NDArray[np.int64]) -> Array:
    """(n, m, 3) of elements from a table (blocks, m, 3, LANES)."""
    block, lane = np.divmod(ids, LANES)
    return np.asarray(B[block, :, :, lane])
