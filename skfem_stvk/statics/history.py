"""The path of a static solve: its steps, and the attempts that failed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from ..arguments import Array
from ..nonlinear.newton import End, Iterations
from ..nonlinear.outcome import Status
from ..results.monitors import Finding
from .critical import CriticalPoint

#: From here on a state is further from where the path pointed than bending or twisting bodies get (1.2 at most on the hard cases).
JUMPED = 5.0


@dataclass(frozen=True, eq=False, repr=False)
class Step:
    """A state of equilibrium on the path.

    Attributes
    ----------
    t : load factor.
    u : (ndofs,) displacements [m].
    status : of this state; unstable and inside-out states are equilibria too.
    end : how Newton's method ended.
    iterations : residuals (relative to loads and reactions), line-search factors, tangents and linear iterations of Newton's
        method.
    strain_energy : [J]; NaN if a term has no energy.
    potential : strain energy less the work of the loads [J]; NaN if a term has no energy, or a load no potential.
    smallest_volume_ratio : the smallest J of an element; below 0 it is inside out.
    lowest : the lowest eigenvalue of K [N/m], with an iterative solver and `stability=True`; otherwise None.
    jump : how far the state is from where the two before it pointed to, as a multiple of the way there. Above 5 the body has
        snapped or buckled: then it is that of the part of the step where it did, from where the tangent there points to. None if
        nothing pointed there.
    findings : where the model is not to be trusted, with element ids.
    critical : limit points and bifurcations between the state before and this one.
    seconds : that the step took, failed attempts included.
    """

    t: float
    u: Array
    status: Status
    end: End
    iterations: Iterations
    strain_energy: float
    potential: float
    smallest_volume_ratio: float
    lowest: float | None
    jump: float | None
    findings: tuple[Finding, ...]
    critical: tuple[CriticalPoint, ...]
    seconds: float

    @property
    def negative(self) -> int | None:
        """How many eigenvalues of K are negative, by the tangent of the state, or by the last one of Newton's
        method where load steps changed nothing; None if the solver does not count them."""
        return self.iterations.negative_pivots

    @property
    def jumped(self) -> bool:
        """Whether it is far from where the path pointed."""
        return self.jump is not None and self.jump > JUMPED

    def __str__(self) -> str:
        largest = float(np.abs(self.u).max())
        return (
            f"t {self.t:<9.4g} {len(self.iterations):>3} iterations   residual {self.iterations.residuals[-1]:.1e}   largest |u| "
            f"{largest:.4g}   {self.seconds:.2g} s"
            + (f"   {self.status}" if not self.status.success else "")
            + ("   jumped" if self.jumped else "")
        )

    __repr__ = __str__


@dataclass(frozen=True)
class Attempt:
    """A step that failed, and was cut back."""

    t: float
    end: End
    iterations: Iterations

    def __str__(self) -> str:
        detail = f" ({self.iterations.detail})" if self.iterations.detail else ""
        return f"t {self.t:<9.4g} {len(self.iterations):>3} iterations   failed: {self.end.value}{detail}"


class History(Sequence[Step]):
    """The steps of a path, in order.

    Attributes
    ----------
    attempts : steps that failed and were cut back.
    ends_in_failure : whether the last thing that happened was one of those.
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

    def judge_last(self, status: Status) -> None:
        """What was found about the last state when all was done."""
        self._steps[-1] = replace(self._steps[-1], status=status)

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
    def iterations(self) -> int:
        """Iterations of Newton's method in all, those of failed attempts included."""
        return sum(len(step.iterations) for step in self._steps) + sum(len(attempt.iterations) for attempt in self.attempts)

    def __repr__(self) -> str:
        return "\n".join(map(str, self._steps))
