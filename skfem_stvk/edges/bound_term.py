"""Abilities of terms on a body, each with a default that works, for ordinary subclasses to override."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..errors import StvkError
from ..kernels.threads import CopyableLock
from .pairs import ALL, AccumulatedBlocks, NodeBlocks, PairTerm, Tensions

AnyBound = TypeVar("AnyBound", bound="Bound")
AnyTerm = TypeVar("AnyTerm", bound="BoundTerm")


class Bound:
    """Members that terms and loads on a body have in common: the nodes that their stiffness couples, and removal.

    The defaults are those of a term that couples no nodes and cannot lose elements.

    Attributes
    ----------
    symmetric
        Whether `K_ba = K_ab'`; if not, it supplies both.
    balanced
        Whether the rows of K sum to zero, so that `K_aa = -sum_b K_ab`; if not, it supplies those of its `nodes`.
    nodes_paired
        Pairs of nodes `a < b` (2, n) that K couples, each once, in any order.
    nodes
        Nodes (m,) with blocks `K_aa` of their own, unless K is balanced.
    pairs_change, pattern_version
        Whether `nodes_paired` follow the body, and how often they have changed.
    removable
        Whether it has a method `without`.
    """

    symmetric: bool = True
    balanced: bool = True
    nodes_paired: Any = np.empty((2, 0), dtype=np.int32)
    nodes: Any = np.empty(0, dtype=np.int32)
    pairs_change: bool = False
    pattern_version: int = 0
    removable: bool = False

    def look(self, u: Array) -> None:
        """Couple the pairs of nodes that the stiffness at `u` (nv, d) contains, if its pairs follow the body."""

    def without(self: AnyBound, removed: NDArray[np.bool_]) -> AnyBound:
        """Return the same without the `removed` elements (n,), in the order of its region; of the mesh, if it has no region.

        This one is not changed. `removed` includes all removed elements, also those of earlier calls. The new one couples the same
        pairs of nodes, with blocks of zeros, and continues the same history.
        """
        raise StvkError(f"{type(self).__name__}: elements cannot be removed from it; expected a method without(removed).")

    def memory(self) -> dict[str, int]:
        """Return the bytes of its arrays, by part."""
        return {}


class BoundTerm(Bound, ABC):
    """Elastic term on a body, with a force. It adds the blocks of its stiffness to arrays, or it is a `PairTerm` that has them.

    Attributes
    ----------
    has_energy
        Whether the force is the gradient of an energy; if not, `energy_and_force` returns 0.
    constant_tangent
        Whether K is the same at all displacements, so that it is factorised once.
    quartic
        Whether the energy along any line is exactly a quartic, with the coefficients `along`.
    has_strain_products
        Whether the energy is `1/2 sum y^2` of the rows of `strain_products`, apart from its quadratic part.
    has_mean_force
        Whether `mean_force` is a mean of the forces of two states, such that its work is the difference of their energies.
    damped
        Whether it can resist the rate of its strain by a `damping_force`.
    grounded
        Degrees of freedom that it ties to the ground, whose force is external; None if it ties the body to nothing else.
    where
        Place of a foundation, for results.
    takes_time
        Whether it depends on more than displacements: on time or the load factor, on a history, or on an assumption. Then `at`
        returns the term at a moment.
    has_history
        Whether it depends on a history, such as friction: numbers (n,) of any n, from which each step of an analysis continues. The
        analysis passes them to the methods.
    nodes_joined
        Pairs of nodes (2, m) that it joins, if it does not join all that it couples: contacts join none, and removed elements no
        more.
    """

    has_energy: bool = True
    constant_tangent: bool = False
    quartic: bool = False
    has_strain_products: bool = False
    has_mean_force: bool = False
    damped: bool = False
    grounded: Any = None
    where: Any = None
    takes_time: bool = False
    has_history: bool = False
    nodes_joined: Any = None

    def at(self: AnyTerm, moment: Any, history: Array | None) -> AnyTerm:
        """Return the term at a `Moment`, with its history at the beginning of the step; None outside of an analysis.

        The result shares the arrays of this term, which does not change.
        """
        return self

    def for_analysis(self: AnyTerm, in_time: bool) -> AnyTerm:
        """Return the term for a motion `in_time`, or along load factors; raise an error if it is not for this analysis."""
        return self

    def first_history(self) -> Array:
        """Return the history before the first step of an analysis."""
        return np.empty(0)

    def advanced(self, history: Array, u: Array, moment: Any) -> Array:
        """Return the history of a step that begins at displacements `u` (nv, d), after a step with this `history`."""
        return history

    def after_step(self, history: Array) -> Array:
        """Return the history after a step that began with it. Forces are still those of the equation of the step."""
        return history

    def return_to(self, history: Array) -> None:
        """Prepare for steps from a history; raise ValueError for numbers that are not its own."""

    @abstractmethod
    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return the strain energy [J] at displacements `u` (nv, d) [m]; add the internal force `dW/du` [N] to `force` (nv, d)."""

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of K [N/m] at `u` (nv, d).

        `kept`: which tensions K includes; a term without tensions may always add all of K.
        """
        raise NotImplementedError(f"{type(self).__name__} makes its blocks itself.")

    def with_blocks(self, nv: int, d: int, dtype: DTypeLike) -> PairTerm:
        """Return the term with the blocks of its stiffness, on a mesh of `nv` vertices in `d` dimensions."""
        return AccumulatedTerm(self, nv, d, dtype)

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add a force [N] between the states `u0` and `u1` to `force` (nv, d), and return `R >= 0` [J].

        For `theta = 1/2` and weights of sum 1, the work over `u1 - u0` is `W(u1) - W(u0) + (w1 - w0) R`. By default the force is
        that at `(1 - theta) u0 + theta u1`, whose work is the difference of energies to second order, and R is 0.
        """
        at_p = np.zeros_like(force)
        self.energy_and_force(u0 + theta * (u1 - u0), at_p)
        force += sum(weights) * at_p
        return 0.0

    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add its Gauss-Newton tangent at `u` times velocities `v` to `force` (nv, d); return half the dissipated power [W]."""
        return 0.0

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """Return the coefficients (5,) of the energy along `u + s v`: `c0 + c1 s + c2 s^2 + c3 s^3 + c4 s^4` [J]."""
        raise StvkError(f"{type(self).__name__}: its energy along a line is not a quartic; expected energy_and_force(u + s v).")

    def strain_products(self, fields: Array, most: int) -> Iterator[Array]:
        """Yield rows (m, n (n + 1)/2) `y = sum over a <= b of y_ab x_a x_b` for displacements `sum_a x_a fields_a`, `x_0 = 1`.

        `fields` is (nv, d, n - 1); the pair (a, b) is in column `b (b + 1)/2 + a`. About `most` rows are yielded at once, each time
        in the same array. The part of the energy that is quadratic in displacements is excepted, since K at rest determines it.
        """
        return iter(())

    def add_round_off(self, u: Array, out: Array) -> None:
        """Add the absolute values of the force's summands [N] to `out` (nv, d): times eps, its rounding error.

        By default they are those of the blocks of K, which are at least as large as the summands of a smooth force.
        """
        self.with_blocks(len(u), u.shape[1], out.dtype).add_magnitudes(u, out)


class BoundElements(BoundTerm):
    """Term with the volumes of elements, which can invert; its specification has their `region`.

    Attributes
    ----------
    passes_inversion
        Whether its forces are finite in inverted elements and push them back, so that motions may pass through such states.
    """

    passes_inversion: bool = False

    @abstractmethod
    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """Return the volume (n,) at `u` (nv, d) over that at rest of the region's elements, in their order."""

    def smallest_volume_ratio(self, u: Array) -> float:
        """Return the smallest entry of `volume_ratios(u)`."""
        return float(self.volume_ratios(u).min(initial=np.inf))

    def step_limit(self, u: Array, v: Array) -> float:
        """Return the smallest `s > 0` at which an element that is not inverted at `u` has no volume at `u + s v`, or infinity."""
        return np.inf

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """Return the smallest principal stretch (n,) at `u` (nv, d) of the region's elements, in their order, within them.

        It is infinite for a law that does not soften under compression.
        """
        return np.full(len(self.volume_ratios(u)), np.inf)

    def smallest_stretch(self, u: Array) -> float:
        """Return the smallest entry of `smallest_stretches(u)`."""
        return np.inf


class AccumulatedTerm(AccumulatedBlocks, PairTerm):
    """Term that adds its blocks to arrays, with these arrays."""

    def __init__(self, term: BoundTerm, nv: int, d: int, dtype: DTypeLike) -> None:
        AccumulatedBlocks.__init__(self, term, nv, d, dtype)
        PairTerm.__init__(self, CopyableLock())
        self.damped = term.damped

    def blocks(self, u: Array, force: Array | None = None, out: Array | None = None, kept: Tensions = ALL) -> tuple[float, Array]:
        self.term.look(u)
        pairs = self.pairs
        blocks = np.empty(pairs.size, dtype=pairs.own.dtype) if out is None or len(out) != pairs.size else out
        self.term.add_blocks(u, pairs.zeroed(blocks), kept)
        pairs.complete(blocks)
        return 0.0 if force is None else self.term.energy_and_force(u, force), blocks


class PlainBound(Bound):
    """Object of a user's class that does not inherit from `Bound`: its own members count, and the defaults of those that it lacks.

    `abilities` are the declarations that follow from a method of the object, if it does not make them itself.
    """

    abilities: ClassVar[dict[str, str]] = {"pairs_change": "pattern_version", "removable": "without"}

    def __init__(self, of: Any) -> None:
        vars(self).update(of=of, **{name: hasattr(of, method) for name, method in self.abilities.items()})

    def __getattribute__(self, name: str) -> Any:
        find = object.__getattribute__
        if name.startswith("__") or name in ("of", "abilities", "without", "at"):
            return find(self, name)
        of = find(self, "of")
        return getattr(of, name) if hasattr(of, name) else find(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.of, name, value)

    def without(self, removed: NDArray[np.bool_]) -> Any:
        return type(self)(self.of.without(removed)) if self.removable else super().without(removed)


class PlainTerm(PlainBound, BoundTerm):
    """Elastic term of a user's class that does not inherit from `BoundTerm`."""

    abilities = PlainBound.abilities | {
        "quartic": "along",
        "has_strain_products": "strain_products",
        "has_mean_force": "mean_force",
        "damped": "damping_force",
        "takes_time": "at",
        "has_history": "first_history",
    }

    def at(self, moment: Any, history: Array | None) -> Any:
        return type(self)(self.of.at(moment, history)) if self.takes_time else self

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        return float(self.of.energy_and_force(u, force))


class PlainElements(PlainTerm, BoundElements):
    """Term with volumes of elements, of a user's class that does not inherit from `BoundElements`."""

    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        return np.asarray(self.of.volume_ratios(u))


@runtime_checkable
class MinimalTerm(Protocol):
    """The least that a law without kernels has, of a class of its own; the members are those of `BoundTerm`."""

    symmetric: bool
    balanced: bool
    has_energy: bool
    nodes_paired: Any

    def energy_and_force(self, u: Array, force: Array | None = None) -> float:
        """Return the strain energy [J]; add the internal force [N] to `force`."""

    def add_blocks(self, u: Array, blocks: NodeBlocks, kept: Tensions = ALL) -> None:
        """Add the blocks of K [N/m]."""


def bound(term: Any) -> BoundTerm:
    """Return the term with all members of `BoundTerm`; refuse what has not the least of them."""
    if isinstance(term, BoundTerm):
        return term
    if not isinstance(term, MinimalTerm):
        raise StvkError(
            f"{type(term).__name__} is no elastic term; expected symmetric, balanced, has_energy, nodes_paired, "
            "energy_and_force(u, force) and add_blocks(u, blocks, kept), as in skfem_stvk.edges.bound_term.BoundTerm. An external "
            "force is a Load."
        )
    return (PlainElements if hasattr(term, "volume_ratios") else PlainTerm)(term)


def joined(term: BoundTerm) -> NDArray[np.int32]:
    """Return the pairs of vertices (2, n) that a term joins."""
    pairs: NDArray[np.int32] = term.nodes_paired if term.nodes_joined is None else term.nodes_joined
    return pairs


def couples_pairs_of(first: BoundTerm, term: BoundTerm) -> bool:
    """Return whether a term couples no other nodes than `first`, with symmetric blocks: products with K then need no matrix."""
    if not term.symmetric or term.pairs_change:
        return False
    pairs, known = (one.nodes_paired.astype(np.int64) for one in (term, first))
    count = max(pairs.max(initial=0), known.max(initial=0)) + 1
    return not pairs.size or (not term.balanced and bool(np.isin(pairs[0] * count + pairs[1], known[0] * count + known[1]).all()))
