"""Interface between nonlinear solvers and problems: the requirements of Newton's method, and those of continuation along a path.

A static state, a time step, a model with twenty unknowns and a model distributed over ranks all implement this interface. Each
problem defines the space of its vectors (`system.space`). There are two kinds of vectors:

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

from ...arguments import Array
from ...linear import Factors, Solution, Unknowns
from ...space import Space
from ...terms.loads.load import Time


class Tangent(Enum):
    """Tangents that Newton's method solves with, in the order in which it tries them.

    exact       the Jacobian
    clamped     without negative tensions of edges: positive semi-definite
    shifted     clamped, with a small stiffness against the ground: positive definite, for flat membranes and slack cables
    """

    EXACT = "exact"
    CLAMPED = "clamped"
    SHIFTED = "shifted"


@dataclass(frozen=True)
class Residual:
    """Residual force of a state."""

    vector: Array  # (n,) residual `F - f_ext`, one entry per unknown [N]
    size: float  # norm of `vector`
    scale: float  # norm of the loads plus norm of the reactions, the reference for `size`

    @property
    def relative(self) -> float:
        """Relative residual `size / scale`; 0 if all forces are zero."""
        return self.size / self.scale if self.scale > 0 else float(self.size > 0)


class Problem(Protocol):
    """Equation `r(u, t) = 0` to be solved by Newton's method."""

    @property
    def space(self) -> Space:
        """Space of the unknowns."""

    @property
    def states(self) -> Space:
        """Space of states and directions; `states.expand(u)` are the displacements on the mesh."""

    @property
    def iterative(self) -> bool:
        """Whether linear solves are iterative; direct factors count negative eigenvalues."""

    @property
    def quartic(self) -> bool:
        """Whether the residual is the gradient of a potential that is a quartic along any line."""

    @property
    def has_barrier(self) -> bool:
        """Whether the potential is infinite in some states, which full steps would jump over."""

    def residual(self, u: Array, t: Time) -> Residual:
        """Return the residual at `u`; raise StateError if numbers overflow."""

    def round_off(self, u: Array, t: Time) -> float:
        """Return the norm of the residual that is due to round-off [N]."""

    def factorise(self, u: Array, t: Time, tangent: Tangent = Tangent.EXACT) -> Factors:
        """Return the factors of the Jacobian at `u`, or of the requested substitute."""

    def solve(self, factors: Factors, b: Array, rtol: float) -> Solution:
        """Solve `K x = b`, with `b` and `x` (n,), to the relative tolerance `rtol`."""

    def switch_to_direct(self, u: Array, t: Time) -> bool:
        """Switch to a direct solver if the iterative one failed at `u` only by round-off; return whether it switched."""

    def negative_pivots(self) -> int | None:
        """Return the number of negative eigenvalues of the last factorised exact tangent; None if it is unknown."""

    def energy_along(self, u: Array, v: Array, t: Time) -> Array:
        """Return the coefficients (5,) of the potential along `u + s v`.

        The constant coefficient is arbitrary. The problem must be `quartic`.
        """

    def step_limit(self, u: Array, v: Array) -> float:
        """Return the largest `s` up to which no further element inverts along `u + s v`; infinity if there is no limit."""

    def contact_limit(self, u: Array, v: Array, t: Time) -> tuple[float, str]:
        """Return the largest `s` up to which the body passes through nothing along `u + s v`, and the name of the contact."""

    def way_is_free(self, u: Array, found: Array, t: Time) -> bool:
        """Return whether no element becomes flat and no contact is passed on the straight line from `u` to `found`."""

    def inside_out(self, u: Array) -> Sized:
        """Return the inverted elements at `u`. The length of the result is their number, and `named` describes them."""

    def named(self, inside_out: Any) -> str:
        """Return a description of the first few inverted elements with their locations; empty if there are none."""


class EigenProblem(Problem, Protocol):
    """Problem with access to the eigenvalues of its Jacobian, which say whether a state is stable."""

    @property
    def symmetric(self) -> bool:
        """Whether the last factorised Jacobian is symmetric, to round-off."""

    def matrix(self, u: Array, t: Time) -> tuple[csr_matrix, Unknowns]:
        """Return the Jacobian at `u`, independent of the factorised one, and its unknowns."""

    def operator(self, u: Array, t: Time) -> LinearOperator | csr_matrix:
        """Return the Jacobian at `u`, independent of the factorised one, as an operator for products `K @ x`."""

    def stiffness_norm(self, u: Array, t: Time) -> float:
        """Return an approximate upper bound of the eigenvalues of the Jacobian at `u` [N/m]."""


def slope(problem: Problem, residual: Residual, v: Array) -> float:
    """Return the slope `r . v` [J], the derivative of the potential, if one exists, along the direction `v`."""
    return problem.space.dot(residual.vector, problem.space.restrict(v))
