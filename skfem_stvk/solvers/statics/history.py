"""Path of a static solve: its steps and the failed attempts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...arguments import Array
from ...npz import Measured, Vector, Within
from ...results.monitors import Finding
from ...space import ONE_PROCESS, Communicator
from ..newton.newton import End, Iterations
from ..newton.outcome import Status
from .critical import CriticalPoint

#: Value of `Step.jump` above which a state counts as a jump. Bending and twisting bodies stay below it (1.2 at most on the hard
#: cases).
JUMPED = 5.0


@dataclass(frozen=True, eq=False, repr=False)
class Step:
    """State of equilibrium on the path.

    Attributes
    ----------
    t
        Load factor.
    u
        (ndofs,) displacements [m].
    status
        Status of this state. Unstable and inverted states are equilibria too.
    end
        Reason why Newton's method ended.
    iterations
        Residuals (relative to loads and reactions), line-search factors, tangents and linear iterations of Newton's method.
    strain_energy
        Strain energy [J]; NaN if a term has no energy.
    potential
        Strain energy less the work of the loads [J]; NaN if a term has no energy, or a load no potential.
    smallest_volume_ratio
        Smallest volume ratio J of an element. An element with J below 0 is inverted.
    lowest
        The lowest eigenvalue of K [N/m], with an iterative solver and `stability=True`; otherwise None.
    jump
        Distance of the state from the extrapolation of the two states before it, as a multiple of the extrapolated distance. Above
        5 the body has snapped or buckled. Then the value refers to the part of the step with the jump, and to its extrapolation by
        the tangent. None if there is no extrapolation.
    findings
        Elements in which the model is not reliable, with their ids, and contacts.
    critical
        Limit points and bifurcations between the previous state and this one.
    seconds
        Duration of the step [s], including failed attempts.
    """

    t: float
    u: Vector
    status: Status
    end: End
    iterations: Iterations
    strain_energy: Measured
    potential: Measured
    smallest_volume_ratio: Measured
    lowest: float | None
    jump: Annotated[float, Within(0.0, finite=False)] | None
    findings: tuple[Finding, ...]
    critical: tuple[CriticalPoint, ...]
    seconds: Annotated[float, Within(0.0)]

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of K; None if the solver does not count them.

        The count comes from the tangent at the state. If a load step does not change the count, it comes from the last tangent of
        Newton's method.
        """
        return self.iterations.negative_pivots

    @property
    def jumped(self) -> bool:
        """Whether the state is far from the extrapolated one, see `jump`."""
        return self.jump is not None and self.jump > JUMPED

    def line(self, comm: Communicator) -> str:
        """Return a line on the step of a body whose parts communicate by `comm`."""
        largest = comm.most(float(np.abs(self.u).max()))
        return (
            f"t {self.t:<9.4g} {len(self.iterations):>3} iterations   residual {self.iterations.residuals[-1]:.1e}   largest |u_i| "
            f"{largest:.4g}   {self.seconds:.2g} s"
            + (f"   {self.status}" if not self.status.success else "")
            + ("   jumped" if self.jumped else "")
        )

    def __str__(self) -> str:
        return self.line(ONE_PROCESS)

    __repr__ = __str__


@dataclass(frozen=True)
class Attempt:
    """Failed step, which was cut back."""

    t: float
    end: End
    iterations: Iterations

    def __str__(self) -> str:
        detail = f" ({self.iterations.detail})" if self.iterations.detail else ""
        return f"t {self.t:<9.4g} {len(self.iterations):>3} iterations   failed: {self.end.value}{detail}"


class History(list[Step]):
    """Steps of a path, in order.

    Attributes
    ----------
    attempts
        Failed steps, which were cut back.
    ends_in_failure
        Whether the last outcome was a failed attempt.
    """

    def __init__(self) -> None:
        super().__init__()
        self.attempts: list[Attempt] = []
        self.ends_in_failure = False

    def record(self, outcome: Step | Attempt) -> None:
        """Append a step, or a failed attempt to `attempts`."""
        self.ends_in_failure = isinstance(outcome, Attempt)
        if isinstance(outcome, Step):
            self.append(outcome)
        else:
            self.attempts.append(outcome)

    @property
    def t(self) -> Array:
        """(n,) load factors."""
        return np.array([step.t for step in self])

    @property
    def u(self) -> Array:
        """(n, ndofs) displacements [m]."""
        return np.array([step.u for step in self])

    @property
    def critical_points(self) -> tuple[CriticalPoint, ...]:
        """Limit points and bifurcations on the path, in order."""
        return tuple(point for step in self for point in step.critical)

    @property
    def jumps(self) -> tuple[Step, ...]:
        """States before which the body snapped or buckled, see `Step.jump`."""
        return tuple(step for step in self if step.jumped)

    @property
    def iterations(self) -> int:
        """Total number of iterations of Newton's method, including failed attempts."""
        return sum(len(step.iterations) for step in self) + sum(len(attempt.iterations) for attempt in self.attempts)

    def __repr__(self) -> str:
        return "\n".join(map(str, self))
