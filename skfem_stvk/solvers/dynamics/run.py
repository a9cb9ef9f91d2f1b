"""Result of a simulation."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import AnalysisError, StvkError
from ...results import animate
from ...results.complete_files import of_leader
from ...results.contact_forces import shapes_at
from ...results.monitors import Finding
from ...results.table import labels_of_files
from ...system import System
from ...terms.loads.load import Moment
from ...terms.loads.rigid_shapes import RigidShape
from ..newton.outcome import Status, with_remedy
from ..runs.ledger import Ledger
from ..runs.run_result import RunResult
from .guards import relative_closure_error
from .integrators import Integrator
from .motion import Motion
from .record import MotionState


@dataclass(frozen=True, eq=False, repr=False)
class Run(RunResult):
    """Motion that was simulated: its last state, its ledger and its status.

    Attributes
    ----------
    system
        Body of the last state, without removed elements.
    motion
        System with its masses and its damping.
    integrator
        Integrator of the run.
    u, v
        (ndofs,) displacements [m] and velocities [m/s] of the last good state.
    last
        This state as the integrator stores it, with the forces of supports, contacts and foundations in the step to it.
    t
        Time of this state [s].
    dt
        Length of the last whole step [s].
    status, message
        How the run ended, as a status and as a text.
    findings
        Unreliable elements in the last state, as in `step.findings` of statics: inverted, or compressed beyond the point where the
        material softens. And rigid contacts that were too deep during the motion or too short for its steps, and shapes
        thinner than the facets.
    ledger
        One array per name, one value per step: `run.ledger["total_energy"]`.
    iterations
        Iterations of Newton's method, or of the linear solver if a step is one linear solve. Like `cuts` and `seconds`, they count
        the whole motion, including the part before it was resumed.
    cuts
        Number of steps that were made in parts, because no state was found at their end at once.
    blow_ups
        Number of times the motion blew up and continued from its last good state with shorter steps.
    seconds
        Run time by part: assemble, factor, solve, write (results and checkpoints), other.
    series
        The .pvd file, if there is one.
    removed, removed_at
        (n,) removed elements, in order, and the times of their removal [s]; NaN if they were removed before the run.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System, VelocityVerlet, simulate
    >>> bar = System(skfem.MeshLine(), StVK(young=4.0, poisson=0.3, density=2.0), fixed={lambda x: x[0] == 0: "x"})
    >>> run = simulate(bar, VelocityVerlet(dt=0.01), until=1.0, v0=[0.0, 1e-3], quiet=True)
    >>> run.success, run.t, len(run.ledger["time"]), (run.u * 1e3).round(3)       # sin(2 t)/2 mm, of mode omega = 2/s
    (True, 1.0, 101, array([0.   , 0.454]))
    """

    system: System
    motion: Motion
    integrator: Integrator
    u: Array
    v: Array
    last: MotionState
    t: float
    dt: float
    status: Status
    message: str
    findings: tuple[Finding, ...]
    ledger: Ledger
    iterations: int
    cuts: int
    blow_ups: int
    seconds: dict[str, float]
    series: Path | None
    removed: NDArray[np.int64]
    removed_at: Array

    @property
    def _end(self) -> tuple[Moment, Array, Array]:
        return self.motion.moment(self.t), self.v, self.last.forces

    def _ground_forces(self) -> Array:
        return self.motion.ground_forces(self.last, self.ledger["time"][-3:].tolist(), self.dt, self.integrator.mean)

    @property
    def gained(self) -> float:
        """Final closure error, as a part of the initial or supplied energy. It is negative if the steps lost energy."""
        return relative_closure_error(self.ledger)

    def animate(self, path: str | os.PathLike[str], field: str = "displacement", **options: Any) -> Path:
        """Write a .gif or .mp4 of the saved states, coloured by a field.

        Parameters
        ----------
        path
            Path of the file, ending in .gif or .mp4.
        field
            Name of a field.
        **options
            Options of `results.animate`.

        Raises
        ------
        StvkError
            if no states were saved.
        """
        if self.series is None:
            raise StvkError("There is nothing to animate: no states were saved. Name a series: simulate(..., save='run.pvd').")
        series, system = self.series, self.system
        options = labels_of_files(field, system.units) | {"shapes": self._shapes} | options
        return of_leader(system.space.comm, lambda: animate(series, path, field, **options))

    def _shapes(self, t: float) -> list[RigidShape]:
        """Return the rigid shapes at time `t`."""
        return shapes_at(self.system, self.motion.moment(t))

    def _rows(self) -> list[tuple[str, Any]]:
        return [
            (f"time [{self.system.units.of('s')}]", f"{self.t:.6g}"),
            ("steps", self.ledger.steps - 1),
            ("integrator", self.integrator),
            ("relative energy gain", f"{self.gained:.2g}"),
        ]

    def __repr__(self) -> str:
        return self._summary(f"{self.ledger.steps - 1} steps with {self.integrator}")


class SimulationError(AnalysisError):
    """Error for a simulation that did not reach its end, or reached it with inverted elements.

    Attributes
    ----------
    run
        The run so far, with the last good state; None for a step of a `Simulation`, which is as it was before the step.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import NodalLoad, StVK, System, VelocityVerlet, simulate
    >>> force = lambda t: [1e-3 / (not 0.45 < t < 0.95)]
    >>> bar = System(skfem.MeshLine(), [StVK(young=4.0, poisson=0.3, density=2.0), NodalLoad([1], force)], fixed={(0,): "x"})
    >>> try:
    ...     simulate(bar, VelocityVerlet(dt=0.1), until=1.0, quiet=True)
    ... except SimulationError as error:
    ...     print(error.run.success, type(error.__cause__).__name__)
    False LoadError
    """

    def __init__(self, run: Run | None, message: str = "") -> None:
        super().__init__(message if run is None else with_remedy(run))
        self.run: Any = run

    def __reduce__(self) -> Any:
        return type(self), (self.run, str(self))
