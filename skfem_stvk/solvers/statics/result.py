"""Result of a static solve."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ... import arguments
from ...arguments import Array
from ...errors import AnalysisError, StvkError
from ...results.contact_forces import contact_states
from ...results.reactions import ground_forces_at_rest
from ...results.series import save_series
from ...results.vtu import DEFAULT
from ...system import System
from ...terms.loads.load import Moment, StepStart
from ..newton.outcome import Status, with_remedy
from ..runs.run_result import RunResult
from .critical import CriticalPoint
from .history import History, Step


@dataclass(frozen=True, eq=False, repr=False)
class StaticResult(RunResult):
    """State of equilibrium with the path to it and its outcome.

    Attributes
    ----------
    system
        Body with its loads and supports.
    u
        (ndofs,) displacements [m] of the last state of equilibrium.
    t
        Load factor of this state; 1 where load steps reached the full load.
    status, message
        Outcome, and its full description.
    history
        States on the path, with iterations, residuals, line-search factors and tangents; `history.attempts` are the failed steps.
    solver
        Name of the linear solver.
    seconds
        Seconds by part: assemble, factor, solve, other.
    projected
        Whether the states are those of a `ReducedSystem`, in equilibrium on its basis. Then reactions need a linear solve.
    step
        Beginning of the last step, from which friction acts; None if no term has a history.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import NodalLoad, StVK, System, solve_static
    >>> bar = System(skfem.MeshLine(), [StVK(young=1.0, poisson=0.3), NodalLoad([1], [1.0])], fixed={(0,): "x"})
    >>> result = solve_static(bar, quiet=True)
    >>> s = float(1 + result.u[1])                                        # stretch, with the force (s^3 - s)/2
    >>> result.success, result.t, round((s**3 - s) / 2, 6), result.reaction().resultant.round(6)
    (True, 1.0, 1.0, array([-1.]))
    """

    system: System
    u: Array
    t: float
    status: Status
    message: str
    history: History
    solver: str
    seconds: dict[str, float]
    projected: bool = False
    step: StepStart | None = None

    @property
    def _end(self) -> tuple[Moment, None, None]:
        return Moment(self.t, self.t, step=self.step), None, None

    def _ground_forces(self) -> Array:
        return ground_forces_at_rest(self.system, self.u, self.t, self.projected)

    @property
    def critical_points(self) -> tuple[CriticalPoint, ...]:
        """Limit points and bifurcations on the path, in order, each with its mode. Load steps may jump over them: see `jumps`."""
        return self.history.critical_points

    @property
    def jumps(self) -> tuple[Step, ...]:
        """States before which the body snapped or buckled, far from the extrapolation of the states before; see `Step.jump`."""
        return self.history.jumps

    def stress(self, measure: str = "cauchy", at: str = "elements") -> Array:
        """Return the stress [Pa] of a measure, (nt, 3, 3) or (nt,).

        Parameters
        ----------
        measure
            Measure of the stress, "cauchy", "pk1", "pk2" (nt, 3, 3) or "von_mises" (nt,).
        at
            Location of the values, "elements"; or "nodes", where the stress is averaged over the elements around each node.

        Raises
        ------
        StvkError
            if the measure is unknown, or `at` is neither "elements" nor "nodes".
        """
        at = arguments.choice("at", at, ("elements", "nodes"))
        name = f"{measure.removesuffix('_stress')}_stress" if isinstance(measure, str) else measure
        return self.state[name] if at == "elements" else self.state.at_nodes(name)

    def energies(self) -> dict[str, float]:
        """Return the energy by term [J]: strain energies, NaN for a term without one, and the potentials of loads that have one."""
        return self.system.energies(self.u, self.t)

    def save(self, path: str | os.PathLike[str], fields: Sequence[str] = DEFAULT) -> Path:
        """Write displacements and fields of the last state to a .vtu file, or of the whole path to a .pvd file.

        A .pvd file has one .vtu file per state. All files are written under temporary names and then renamed, so that either all or
        none change. For a body that is divided into parts, only the last state can be written, to a .pvtu file.

        Parameters
        ----------
        path
            Path of the file, ending in .vtu or .pvd.
        fields
            Names of the fields in it, see `skfem_stvk.results.names()`; by default stresses and strains.

        Raises
        ------
        StvkError
            as `results.write_vtu`.
        """
        if arguments.path("path", path, "the path of a .vtu or of a .pvd file").suffix != ".pvd":
            return super().save(path, fields)
        if not len(self.history):
            raise StvkError(f"There is no state to write to {path}: none was found.")
        if self.system.space.comm.divided:
            raise StvkError(
                f"path = {arguments.shown(str(path))}; expected the path of a .pvtu file, for the last state of a body that is "
                "divided into parts. For all states, use solve_static(..., save=...)."
            )
        increasing = bool((np.diff(self.history.t) > 0).all())
        times = self.history.t if increasing else range(1, len(self.history) + 1)
        at, system = self.state.fields.at, self.system
        rubs = any(contact.has_friction for contact in system.contacts)
        contacts = (() if rubs else contact_states(system, step.u, step.t) for step in self.history)
        states = (at(step.u, contacts=known) for step, known in zip(self.history, contacts, strict=True))
        return save_series(path, fields, zip(map(float, times), states, strict=True))

    def _rows(self) -> list[tuple[str, Any]]:
        history = self.history
        counts = [("states", len(history)), ("Newton iterations", history.iterations)]
        return [("load factor", f"{self.t:.6g}"), *counts, ("solver", self.solver)]

    def __repr__(self) -> str:
        counts = f"{len(self.history)} states, {self.history.iterations} Newton iterations"
        return self._summary(f"{counts}, solver '{self.solver}'")


class SolveError(AnalysisError):
    """Error of a static solve that did not end successfully.

    Attributes
    ----------
    result
        The result so far, with the last good state.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import NodalLoad, StVK, System, solve_static
    >>> bar = System(skfem.MeshLine(), [StVK(young=1.0, poisson=0.3), NodalLoad([1], [-1.0])], fixed={(0,): "x"})
    >>> try:
    ...     solve_static(bar, quiet=True)
    ... except SolveError as error:                                       # limit point, 1/(3 sqrt(3)) of the load
    ...     print(error.result.success, round(error.result.t, 2))
    False 0.19
    """

    def __init__(self, result: StaticResult) -> None:
        super().__init__(with_remedy(result))
        self.result = result

    def __reduce__(self) -> Any:
        return type(self), (self.result,)
