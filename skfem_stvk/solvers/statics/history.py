"""Path of a static solve: its steps and the failed attempts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, overload

import numpy as np

from ...arguments import Array
from ...npz import Measured, Vector, Within
from ...results.monitors import Finding
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

    @property
    def largest(self) -> float:
        """The largest absolute value in `u`."""
        return float(np.abs(self.u).max())

    def line(self, largest: float) -> str:
        """Return a line on the step, with the `largest` absolute value in `u`, which may be on another rank."""
        return (
            f"t {self.t:<9.4g} {len(self.iterations):>3} iterations   residual {self.iterations.residuals[-1]:.1e}   largest |u_i| "
            f"{largest:.4g}   {self.seconds:.2g} s"
            + (f"   {self.status}" if not self.status.success else "")
            + ("   jumped" if self.jumped else "")
        )

    def __str__(self) -> str:
        return self.line(self.largest)

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


class History(Sequence[Step]):
    """Steps of a path, in order.

    Attributes
    ----------
    attempts
        Failed steps, which were cut back.
    ends_in_failure
        Whether the last outcome was a failed attempt.
    """

    def __init__(self) -> None:
        self._steps: list[Step] = []
        self.attempts: list[Attempt] = []
        self.ends_in_failure = False

    def append(self, outcome: Step | Attempt) -> None:
        self.ends_in_failure = isinstance(outcome, Attempt)
        if isinstance(outcome, Step):
            self._steps.append(outcome)
        else:
            self.attempts.append(outcome)

    def set_last_status(self, status: Status) -> None:
        """Set the final status of the last state, after the end of the solve."""
        self._steps[-1] = replace(self._steps[-1], status=status)

    def add_findings(self, findings: Iterable[Finding]) -> None:
        """Add findings on the whole path to its last state."""
        last = self._steps[-1]
        self._steps[-1] = replace(last, findings=(*last.findings, *findings))

    @overload
    def __getitem__(self, i: int) -> Step: ...
    @overload
    def __getitem__(self, i: slice) -> list[Step]: ...
    def __getitem__(self, i: int | slice) -> Step | list[Step]:
        return self._steps[i]

    def __len__(self) -> int:
        return len(self._steps)

    @property
    def t(self) -> Array:
        """(n,) load factors."""
        return np.array([step.t for step in self._steps])

    @property
    def u(self) -> Array:
        """(n, ndofs) displacements [m]."""
        return np.array([step.u for step in self._steps])

    @property
    def critical_points(self) -> tuple[CriticalPoint, ...]:
        """Limit points and bifurcations on the path, in order."""
        return tuple(point for step in self._steps for point in step.critical)

    @property
    def jumps(self) -> tuple[Step, ...]:
        """States before which the body snapped or buckled, see `Step.jump`."""
        return tuple(step for step in self._steps if step.jumped)

    @property
    def iterations(self) -> int:
        """Total number of iterations of Newton's method, including failed attempts."""
        return sum(len(step.iterations) for step in self._steps) + sum(len(attempt.iterations) for attempt in self.attempts)

    def __repr__(self) -> str:
        return "\n".join(map(str, self._steps))
