"""Abilities of laws on elements in addition to W, F and K: a class for each kind of energy."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import StvkError
from ..kernels import element_assembly as element_kernels
from ..kernels import node_blocks as block_kernels
from ..kernels import reduced as reduced_kernels
from ..kernels import volumes as volume_kernels
from ..kernels.corotated_law import WarpedLaw
from ..kernels.discrete_gradient import DiscreteGradient
from ..kernels.element_assembly import MeanStress, StressOfRates
from ..kernels.lanes import LANES, MeanPoints
from ..kernels.laws import law_size
from ..kernels.rows import PairSlots, RowSlots
from ..kernels.st_venant_kirchhoff import IsotropicLaw
from ..kernels.threads import locked, run
from .assembly import Assembly
from .elements import Frames
from .form import EdgeForm
from .pairs import ALL, Tensions
from .stiffness import FramedStiffness, GeneralStiffness, Stiffness, flat_of
from .topology import in_lanes, out_of_lanes

#: Strain components of elements, by their dimension, as indices in the order 11, 22, 33, 12, 13, 23.
STRAIN_COMPONENTS = {1: (0,), 2: (0, 1, 3), 3: (0, 1, 2, 3, 4, 5)}


class BoundStVK(Assembly):
    """St. Venant-Kirchhoff's law on elements. On linear simplices it is an edge form, and many results are exact."""

    quartic = has_mean_force = damped = has_strain_products = True

    def __init__(self, p: Array, t: NDArray[np.int32], *arguments: Any, **options: Any) -> None:
        super().__init__(p, t, *arguments, **options)
        self._simplices = p, t

    @cached_property
    def form(self) -> EdgeForm:
        """Edge form of linear simplices; StvkError for other elements."""
        self._refuse_points()
        (p, t), stiffness = self._simplices, self.stored
        assert isinstance(stiffness, Stiffness)
        L = stiffness.coefficients
        if self.removed is None:
            return EdgeForm(p, t, stiffness)
        remaining = ~self.removed[:, None, None]
        return EdgeForm(p, t, GeneralStiffness(lambda: remaining * L(p, t)))

    @locked
    def tensions(self, u: Array) -> Array:
        """Return the tensions `t = L zeta` (ne,) [N/m] at `u` (nv, d) of the edges in lexicographic order, without `form`.

        Raises StvkError for elements other than linear simplices.
        """
        self._refuse_points()
        self.elements.gather(u)
        return np.asarray(self.kernel_tensions()[self.elements.lexicographic])

    def kernel_tensions(self) -> Array:
        """Return the tensions of the edges in their own order, at the displacements gathered last."""
        elements = self.elements
        to, total = elements.block_shares, elements.edges.total
        t = elements.own.scratch("t", total + len(to.extra), self.dtype)
        t[total:] = 0
        slots = to.slots.reshape(elements.edges.t2e.shape)
        arrays = elements.t.ravel(), slots, elements.edges.marks, self.law, elements.X, elements.u
        run(element_kernels.tensions, elements.force_shares.parts, *arrays, t)
        block_kernels.fold(t, total, to.extra, 1)
        return t[:total]

    def _refuse_points(self) -> None:
        """Refuse elements other than linear simplices: their strain differs from point to point."""
        if self.points is not None:
            raise StvkError(
                f"{self.quadrature.element.name} have no edge form, because their strain varies within an element and does not "
                "follow from the lengths of edges. Use degree=1 for edges and their pairs."
            )

    def _linearize(self, to: PairSlots | RowSlots, kept: Tensions, force: Array | None) -> list[tuple[float, float]]:
        """Linearize, with K at rest rotated with the elements if it is `kept.warped`."""
        if not kept.warped:
            return super()._linearize(to, kept, force)
        law = WarpedLaw(self.law.D, self.law, flat_of(self.elements.k, self.elements.d))
        return self.run(element_kernels.linearize, force, float(kept.positive), float(kept.negative), law=law, to=(to,))

    @locked
    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        """Return the blocks of `K = 2 J' L J + sum g t Lap (x) I`. `g` are the factors of `kept` for tensions `t`."""
        W, blocks = super().blocks(u, force, out, kept)
        if not self.by_rows(kept):
            less = kept.positive - kept.negative
            run(block_kernels.reduce_negative_tensions, self.pairs.products.parts, self.kernel_tensions(), less, blocks)
        return W, blocks

    def by_rows(self, kept: Tensions) -> bool:
        """Return whether signs of edge tensions do not matter: they are known only after all elements are added."""
        return kept.negative == kept.positive or self.points is not None

    @locked
    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """Return the coefficients `c` (5,) [J] of the energy along `u + s v`, both (nv, d): `c_0 + c_1 s + ... + c_4 s^4`, exact at
        any `s`.
        """
        elements = self.elements
        elements.gather(u)
        V = elements.own.gathered("direction", v, np.float64)
        arrays = elements.t.ravel(), self.points, self.law, elements.X, elements.u, V
        return np.asarray(np.sum(run(element_kernels.along, elements.force_shares.parts, *arrays), axis=0))

    @locked
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the force of the mean tensions of two states `u0`, `u1` (nv, d), along the edges in between, to `force` (nv, d) [N].

            f_a = sum_b t_ab (p_a - p_b)        t = L (w0 zeta(u0) + w1 zeta(u1)),  p at (1 - theta) u0 + theta u1

        Forces and torques about `p` balance. For `w0 = w1 = theta = 1/2`, the work over `u1 - u0` is `W(u1) - W(u0)`. With other
        weights of sum 1, the work is larger by `(w1 - w0)` times `1/4 dzeta' L dzeta` [J]. The method returns this last number,
        which is zero for a rigid motion and never negative.
        """
        rule = MeanStress(float(weights[0]), float(weights[1]), float(theta))
        return float(sum(self.run(element_kernels.forces_between, force, _change(self, u0, u1), rule)))

    @locked
    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add the resistance of the edges to velocities `v` at `u` (nv, d), for a relaxation time of 1 s, to `force` (nv, d).

            f_a = sum_b t_ab (p_a - p_b)        t = L dzeta/dt,  dzeta_ab/dt = 2 (p_a - p_b) . (v_a - v_b)

        The force is `2 J' L J v`, the product with the Gauss-Newton tangent. It is also the derivative of `R = 1/4 dzeta/dt' L
        dzeta/dt` [W] by `v`. The method returns `R`; the dissipated power is `2 R`. Rigid motions, including rotations, meet no
        resistance.
        """
        self.elements.gather(u)
        V = self.elements.own.gathered("direction", v, np.float64)
        return float(sum(self.run(element_kernels.forces_between, force, V, StressOfRates())))

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """Return the smallest principal stretch (nt,) of each element at `u` (nv, d), in the user's order."""
        own = np.empty(len(self.elements.t) * LANES)
        self._smallest_stretch(u, own)
        return self.of_elements(own)

    def smallest_stretch(self, u: Array) -> float:
        """Return the smallest entry of `smallest_stretches(u)`. For linear simplices this costs half as much again as F."""
        return self._smallest_stretch(u, np.empty(0)) if self.removed is None else float(self.smallest_stretches(u).min())

    @locked
    def _smallest_stretch(self, u: Array, out: Array) -> float:
        elements = self.elements
        elements.gather(u)
        arrays = elements.t.ravel(), elements.at_points, elements.X, elements.u
        return min(run(volume_kernels.smallest_stretches, elements.force_shares.parts, *arrays, elements.k, out))

    def strain_products(self, fields: Array, most: int) -> Iterator[Array]:
        """Yield rows as in `BoundElements`. The rows of removed elements are zero."""
        elements, X = self.elements, np.zeros((len(fields), 3))
        X[elements.own.vertices] = elements.X.reshape(-1, 3)
        k, nt = elements.k, len(elements.elements)
        fields = np.concatenate([X[:, : elements.d, None], fields], axis=2)  # x_0 = 1 multiplies the node's own coordinates
        n, s = fields.shape[2], k * (k + 1) // 2
        pairs, at_once = n * (n + 1) // 2, max(1, most // s)
        work, out = np.empty((s, pairs)), np.empty((min(at_once, nt) * s, pairs))
        nodes = elements.own.vertices[out_of_lanes(elements.t, nt)]
        tables = [None] if self.points is None else self.points.B
        for q, B in enumerate(tables if not isinstance(self.points, MeanPoints) else [self.points.B]):
            for first in range(0, nt, at_once):
                ids = np.arange(first, min(first + at_once, nt))
                own = nodes[: elements.element.n, ids]
                base_vectors = (fields[own[1:]] - fields[own[:1]]).transpose(1, 0, 2, 3)  # (n, nodes - 1, d, R + 1)
                Ri, L = self._factors(ids, q)
                if B is not None:
                    of = (B[None] if B.ndim == 2 else _of_elements(B, ids))[:, : base_vectors.shape[1], :k]
                    base_vectors = np.einsum("nai,nadr->nidr", np.broadcast_to(of, (len(ids), *of.shape[1:])), base_vectors)
                G = np.matmul(np.swapaxes(Ri, 1, 2), base_vectors[:, :k].reshape(len(ids), k, -1)).reshape(base_vectors.shape)
                rows = out[: len(ids) * s]
                reduced_kernels.strain_rows(np.ascontiguousarray(G), L, work, rows)
                yield rows

    def _factors(self, ids: NDArray[np.int64], q: int) -> tuple[Array, Array]:
        """Return `Ri` (n, k, k) at a point of elements in their own order, and the factor `L` (n, s, s) of `W = 1/2 |L M|^2`."""
        m, k, (block, lane) = law_size(self.law), self.elements.k, np.divmod(ids, LANES)
        at, weight = block * m * LANES, 1.0
        if self.points is not None:
            sets = np.diff(self.points.starts)[block] // (m * LANES)
            at, weight = self.points.starts[block] + np.minimum(q, sets - 1) * m * LANES, float(self.points.weights[q])
        numbers = self.law.D[(at + lane)[:, None] + LANES * np.arange(m)].astype(np.float64)
        components = np.array(STRAIN_COMPONENTS[k])
        return Frames.upper(numbers[:, :6].T)[:, :k, :k], square_roots(
            weight * _forms(numbers[:, 6:])[:, components[:, None], components]
        )

    @locked
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all summands of the force at `u` (nv, d) to `out` (nv, d) [N].

        Times eps, the sum bounds the rounding error of the force, including the error from rounding `u` itself.
        """
        self.elements.gather(u)
        self.run(element_kernels.round_off, out)


class BoundEnergyOfStrain(Assembly):
    """Energy of the strain, with a discrete gradient."""

    has_mean_force = True

    @locked
    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add the force of the stresses between the states `u0` and `u1` (nv, d) to `force` (nv, d) [N].

        The force is a discrete gradient of the energy (`kernels.discrete_gradient`). Forces and torques about `X + (1 - theta) u0 +
        theta u1` balance. For `w0 = w1 = theta = 1/2`, the work over `u1 - u0` is `W(u1) - W(u0)`, up to the rounding of both
        energies.
        """
        rule = DiscreteGradient(float(weights[0]), float(weights[1]), float(theta), self.elements.k == self.elements.d)
        R = float(sum(self.run(element_kernels.forces_between, force, _change(self, u0, u1), rule)))
        if not np.isfinite(R):
            self.energy_and_force(u1)  # raises an error with the reason
        return R


class BoundTensionField(BoundEnergyOfStrain):
    """Tension-only sheets and cables."""

    @locked
    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of all summands of the force, as `BoundStVK` does: errors are at most those of the same strains
        with the full stress.
        """
        self.elements.gather(u)
        self.run(element_kernels.round_off, out, law=IsotropicLaw(self.law.D))


class BoundEnergyOfStretches(Assembly):
    """Energy of principal stretches. Their decomposition has larger rounding errors than a sum."""

    passes_inversion = True

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add three times the result of `add_magnitudes` to `out` (nv, d) [N]: stretches have errors of several eps."""
        sizes = np.zeros(u.shape)
        self.add_magnitudes(u, sizes)
        out += 3 * sizes


class BoundInFrames(BoundEnergyOfStretches):
    """Linear elasticity in user-supplied frames. Energy that the body gains or loses as the frames rotate is external work."""

    has_energy = passes_inversion = False
    takes_time = True

    def at(self, moment: Any, history: Array | None) -> BoundInFrames:
        """Return the term with its frames in their orientation at a moment."""
        elements, m, _ = self.elements, law_size(self.law), self.pairs  # made once for all times
        rotated = copy(self)
        rotated._D = self._D.copy()
        assert isinstance(self.stored, FramedStiffness)
        R = in_lanes(self.stored.frames(moment).reshape(-1, 9)[elements.elements].T.astype(self.dtype)).reshape(-1, 9, LANES)
        counts = 1 if self.points is None else np.diff(self.points.starts) // (m * LANES)
        rotated._D.reshape(-1, m, LANES)[:, 8:] = np.repeat(R, counts, axis=0)
        return rotated


def _change(term: Assembly, u0: Array, u1: Array) -> Array:
    """Gather the state `u0` (nv, d) and return the change to `u1` in the order of the kernels."""
    term.elements.gather(u0)
    change = term.elements.own.gathered("direction", u1, np.float64)
    change -= term.elements.u
    return change


def _forms(numbers: Array) -> Array:
    """Return `C` (n, 6, 6) of `W = 1/2 M' C M`, for strains in the order of the kernels, from the numbers (n, m) of a law."""
    twice = np.array([1.0, 1, 1, 2, 2, 2])
    if numbers.shape[1] == 2:
        trace = np.outer(*[np.array([1.0, 1, 1, 0, 0, 0])] * 2)
        return np.asarray((numbers[:, :1, None] * trace + numbers[:, 1:, None] * np.diag(twice)) / 2)
    rows, columns = np.triu_indices(6)
    C = np.zeros((len(numbers), 6, 6))
    C[:, rows, columns] = C[:, columns, rows] = numbers
    return np.asarray(C * twice[:, None] * twice / 2)


def square_roots(C: Array) -> Array:
    """Return `L` (n, s, s) with `L' L = C`, for `C` symmetric and positive semi-definite up to rounding."""
    try:
        return np.ascontiguousarray(np.swapaxes(np.linalg.cholesky(C), 1, 2))
    except np.linalg.LinAlgError:  # no stiffness in some direction
        values, vectors = np.linalg.eigh(C)
        return np.ascontiguousarray(np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2))


def _of_elements(B: Array, ids: NDArray[np.int64]) -> Array:
    """Return the entries (n, m, 3) of elements from a table (blocks, m, 3, LANES)."""
    block, lane = np.divmod(ids, LANES)
    return np.asarray(B[block, :, :, lane])
