"""Result of a static solve."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ... import arguments
from ...arguments import Array
from ...errors import AnalysisError, StvkError
from ...mesh.locations import Where
from ...results import Fields, Reaction, State, plot, write_vtu
from ...results.contact_forces import ContactState, contact_state, contact_states
from ...results.plotting import thumbnail
from ...results.reactions import ReactionPlace, ground_forces_at_rest
from ...results.series import save_series
from ...results.vtu import DEFAULT
from ...system import System
from ...terminal import html_table
from ...terms.loads.load import Moment, StepStart
from ..newton.outcome import Status, with_remedy
from .critical import CriticalPoint
from .history import History, Step


@dataclass(frozen=True, eq=False, repr=False)
class StaticResult:
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
    def _moment(self) -> Moment:
        return Moment(self.t, self.t, step=self.step)

    @property
    def success(self) -> bool:
        """Whether the body carries the full load without inverted elements, in a state that is stable as far as known."""
        return self.status.success

    @property
    def critical_points(self) -> tuple[CriticalPoint, ...]:
        """Limit points and bifurcations on the path, in order, each with its mode. Load steps may jump over them: see `jumps`."""
        return self.history.critical_points

    @property
    def jumps(self) -> tuple[Step, ...]:
        """States before which the body snapped or buckled, far from the extrapolation of the states before; see `Step.jump`."""
        return self.history.jumps

    def reaction(self, where: Where | None = None) -> Reaction:
        """Return the force of the ground on the body at a location: `.resultant` [N], `.moment(about)` [N m], `.by_node`.

        The force is that of supports and foundations. The sum of all reactions and loads is zero.

        Parameters
        ----------
        where
            Boundary, node set, vertex ids or a predicate; None for the whole body. The location of a support, as passed to `fixed`
            or `prescribed`, has the components that this support constrains. If k supports constrain a component at a node, each
            has 1/k of the force. Any other location has all constrained components at its nodes.

        Raises
        ------
        RegionError
            if there is no such location.
        SupportError
            if no support or foundation acts there.
        """
        place = ReactionPlace.of(self.system, where)
        return place.reaction(self.system, self.u, ground_forces_at_rest(self.system, self.u, self.t, self.projected))

    def contact(self, name: str) -> ContactState:
        """Return the forces of a contact on the body: `.resultant` [N], `.pressure` [Pa], `.gap` [m] and `.force` by node.

        Parameters
        ----------
        name
            Name of the contact, as in `RigidContact(..., name="floor")`.

        Raises
        ------
        ContactError
            if there is no such contact.
        """
        return contact_state(self.system, name, self.u, self._moment)

    @cached_property
    def contacts(self) -> tuple[ContactState, ...]:
        """States of all contacts, as `contact` returns them."""
        return contact_states(self.system, self.u, self._moment)

    @cached_property
    def state(self) -> State:
        """All fields, see `skfem_stvk.results.names()`: `state["green_strain"]` by element, `state.at_nodes("volume_ratio")`."""
        return Fields.of(self.system).at(self.u, contacts=self.contacts)

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
            return write_vtu(path, self.state, fields)
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

    def plot(self, field: str | ArrayLike = "von_mises_stress", **options: Any) -> Any:
        """Draw the deformed body, coloured by a field.

        Parameters
        ----------
        field
            Name of a field, or values (nv,) at nodes or (nt,) of elements.
        **options
            Options of `results.plot`.
        """
        return plot(self.state, field, **options)

    def _repr_html_(self) -> str:
        rows = [
            ("status", self.status),
            ("message", self.message),
            ("load factor", f"{self.t:.6g}"),
            ("states", len(self.history)),
            ("Newton iterations", self.history.iterations),
            ("solver", self.solver),
            *((f"seconds, {name}", f"{seconds:.2g}") for name, seconds in self.seconds.items()),
        ]
        return html_table("StaticResult", rows, thumbnail(self.system, lambda: self.state))

    def __repr__(self) -> str:
        parts = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in self.seconds.items())
        return (
            f"StaticResult: {self.message}\n{len(self.history)} states, {self.history.iterations} Newton iterations, solver "
            f"'{self.solver}'; {parts}"
        )


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
