"""Result of a simulation."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array
from ...errors import AnalysisError, StvkError
from ...mesh.locations import Where
from ...results import Fields, Reaction, State, animate, plot, write_vtu
from ...results.complete_files import of_leader
from ...results.contact_forces import ContactState, contact_state, contact_states, shapes_at
from ...results.monitors import Finding
from ...results.plotting import thumbnail
from ...results.reactions import ReactionPlace
from ...results.table import labels_of_files
from ...results.vtu import DEFAULT
from ...system import System
from ...terminal import html_table
from ...terms.loads.rigid_shapes import RigidShape
from ..newton.outcome import Status, with_remedy
from .guards import relative_closure_error
from .integrators import Integrator
from .ledger import Ledger
from .motion import Motion
from .record import MotionState


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """Motion that was simulated: its last state, its ledger and its status.

    Attributes
    ----------
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
    def system(self) -> System:
        """System of this motion."""
        return self.motion.system

    @property
    def success(self) -> bool:
        """Whether the run reached its end in a state without inverted elements."""
        return self.status.success

    @property
    def gained(self) -> float:
        """Final closure error, as a part of the initial or supplied energy. It is negative if the steps lost energy."""
        return relative_closure_error(self.ledger)

    @cached_property
    def contacts(self) -> tuple[ContactState, ...]:
        """States of all contacts, as `contact` returns them."""
        return contact_states(self.system, self.u, self.motion.moment(self.t), self.last.forces)

    @cached_property
    def state(self) -> State:
        """All fields of the last state: `run.state["von_mises_stress"]`; see `skfem_stvk.results.names()`."""
        return Fields.of(self.system).at(self.u, self.v, self.contacts)

    def reaction(self, where: Where | None = None) -> Reaction:
        """Return the force of supports and foundations on the body at a location.

        The result has `.resultant` [N], `.moment(about)` [N m] and `.by_node`.

        The force of supports is `M a + D v + F(u) - h(u, t)`. It carries the loads, and the inertia and damping of constrained
        degrees of freedom that move. The force of foundations is `-K_f (u + beta v)`, with the factor beta of `Rayleigh` damping.
        Together with the loads, these forces are the rate of the body's linear momentum. For a `System` with
        `EnergyMomentum`, or whose supports move, they are those in the equation of the last step, with the inertia `M (v1 - v)/T`.

        Parameters
        ----------
        where
            Boundary, node set, vertex ids or a predicate; None for all locations. As in `StaticResult.reaction`, the location of a
            support has its components and its share of common ones; any other has all constrained components at its nodes.

        Raises
        ------
        RegionError
            if there is no such location.
        SupportError
            if there is no support and no foundation at this location.
        """
        place, times = ReactionPlace.of(self.system, where), self.ledger["time"][-3:].tolist()
        return place.reaction(self.system, self.u, self.motion.ground_forces(self.last, times, self.dt, self.integrator.mean))

    def contact(self, name: str) -> ContactState:
        """Return the forces of a contact on the body: `.resultant` [N], `.pressure` [Pa], `.gap` [m] and `.force` by node.

        Forces are those that acted in the last step: the mean over it with `EnergyMomentum`, `F + K w` in equation 9.

        Parameters
        ----------
        name
            Name of the contact, as in `RigidContact(..., name="floor")`.

        Raises
        ------
        ContactError
            if there is no such contact.
        """
        return contact_state(self.system, name, self.u, self.motion.moment(self.t), self.last.forces)

    def plot(self, field: str | ArrayLike = "von_mises_stress", **options: Any) -> Any:
        """Draw the last state, coloured by a field.

        Parameters
        ----------
        field
            Name of a field, or values (nv,) at nodes or (nt,) of elements.
        **options
            Options of `results.plot`.
        """
        return plot(self.state, field, **options)

    def save(self, path: str | os.PathLike[str], fields: Any = DEFAULT) -> Path:
        """Write the last state to a .vtu file, for a body that is divided into parts to a .pvtu file.

        Parameters
        ----------
        path
            Path of the file, ending in .vtu or .pvtu.
        fields
            Names of the fields in it, see `skfem_stvk.results.names()`; by default stresses and strains.

        Raises
        ------
        StvkError
            as `results.write_vtu`.
        """
        return write_vtu(path, self.state, fields)

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

    def _repr_html_(self) -> str:
        rows = [
            ("status", self.status),
            ("message", self.message),
            (f"time [{self.system.units.of('s')}]", f"{self.t:.6g}"),
            ("steps", self.ledger.steps - 1),
            ("integrator", self.integrator),
            ("relative energy gain", f"{self.gained:.2g}"),
            *((f"seconds, {name}", f"{seconds:.2g}") for name, seconds in self.seconds.items()),
        ]
        return html_table("Run", rows, thumbnail(self.system, lambda: self.state))

    def __repr__(self) -> str:
        parts = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in self.seconds.items())
        return f"Run: {self.message}\n{self.ledger.steps - 1} steps with {self.integrator}; {parts}"


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
