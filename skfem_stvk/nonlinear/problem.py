"""The joint of nonlinear solves: what Newton's method asks of a problem, and what the walk along a path asks in addition.

A static state, a time step, a model of twenty unknowns or one that is spread over ranks are siblings here: each knows where its
vectors live (`system.space`). Two kinds of vectors are told apart:

    u, v    states and directions, of the space `states`; Newton's method adds `u + s v` and does nothing else with them
    x, b    the unknowns of a linear solve, of `space`, which is part of `states`: `space.expand(x)` is their direction
"""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from scipy.sparse import csr_matrix
from scipy.sparse.linalg import LinearOperator

from ..arguments import Array
from ..linear import Factors, Solution, Unknowns
from ..linear.space import Space
from ..terms.load import Time


class Tangent(Enum):
    """What Newton's method solves with, in the order in which it tries them.

    exact       the Jacobian
    clamped     without negative tensions of edges: positive semi-definite
    shifted     that, and a little stiffness against the ground: positive definite, for flat membranes and slack cables
    """

    EXACT = "exact"
    CLAMPED = "clamped"
    SHIFTED = "shifted"


@dataclass(frozen=True)
class Residual:
    """Forces that are not in equilibrium."""

    vector: Array  # (n,) residual `F - f_ext`, one entry per unknown [N]
    size: float  # its norm
    scale: float  # norm of the loads plus that of the reactions, what `size` is small against

    @property
    def relative(self) -> float:
        """`size / scale`; 0 if there is no force at all."""
        return self.size / self.scale if self.scale > 0 else float(self.size > 0)


class Problem(Protocol):
    """An equation `r(u, t) = 0`, as Newton's method sees it."""

    @property
    def space(self) -> Space:
        """The space of the unknowns."""

    @property
    def states(self) -> Space:
        """The space of states and directions; those on the mesh are `states.expand(u)`."""

    @property
    def iterative(self) -> bool:
        """Whether linear solves iterate; otherwise factors count negative eigenvalues."""

    @property
    def quartic(self) -> bool:
        """Whether the residual is the gradient of a potential that is a quartic along any line."""

    def residual(self, u: Array, t: Time) -> Residual:
        """What is not in equilibrium at `u`; raises StateError where numbers overflow."""

    def round_off(self, u: Array, t: Time) -> float:
        """Size of the residual that is left by rounding alone [N]."""

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        """The Jacobian at `u`, or what stands in for it, ready to solve with."""

    def solve(self, factors: Factors, b: Array, rtol: float) -> Solution:
        """The solution of `K x = b` (n,)."""

    def take_over(self, u: Array, t: Time) -> bool:
        """Whether a direct solver takes over from here on, because an iterative one met its round-off in the Jacobian at `u`."""

    def negative_pivots(self) -> int | None:
        """How many eigenvalues of the exact tangent that was factorised last are negative; None if that is not known."""

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        """(5,) coefficients of the potential along `u + s v`, but for the constant one; for a problem that is `quartic`."""

    def step_limit(self, u: Array, v: Array) -> float:
        """How far along `u + s v` no more elements turn inside out; infinite where nothing limits a step."""

    def on_this_side(self, u: Array, found: Array) -> bool:
        """Whether no element would be flat on the straight way from `u` to `found`: none is turned through itself."""

    def inside_out(self, u: Array) -> Sized:
        """What is inside out at `u`; as many as it has entries, named by `named`."""

    def named(self, inside_out: Any) -> str:
        """The first few of what is inside out, and where they are; empty if there are none."""


class EigenProblem(Problem, Protocol):
    """A problem whose Jacobian is looked at for its eigenvalues, to tell whether a state is stable."""

    @property
    def symmetric(self) -> bool:
        """Whether the Jacobian that was factorised last is symmetric, to rounding."""

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """The Jacobian at `u`, beside what is factorised, and its unknowns."""

    def operator(self, u: Array, t: Time) -> LinearOperator | csr_matrix:
        """The Jacobian at `u`, beside what is factorised, for products `K @ x`."""

    def stiffness_norm(self, u: Array, t: Time) -> float:
        """What no eigenvalue of the Jacobian at `u` is much larger than [N/m]."""


def slope(problem: Problem, residual: Residual, v: Array) -> float:
    """`r . v` [J]: how the potential, if there is one, changes along a direction."""
    return problem.space.dot(residual.vector, problem.space.restrict(v))
