"""The command `skfem-stvk budget`: measure on this machine which simulations of a mesh fit in a time step."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ...about import machine
from ...arguments import Array, number
from ...errors import AnalysisError, StateError, StvkError, SupportError
from ...kernels.threads import threads
from ...linear import SOLVERS, Petsc
from ...linear.pardiso import pardiso_is_installed
from ...mesh import ElementMesh, read_mesh
from ...mesh.locations import vertices_at
from ...solvers.dynamics import INTEGRATORS, EnergyMomentum, Integrator, LinearBackwardEuler, Simulation, critical_step
from ...solvers.dynamics.at_rest import MANY, AtRest
from ...solvers.reduced import PrecomputedResponse, ReducedSystem
from ...solvers.statics import solve_static
from ...system import System
from ...system.protocol import ReducedLike
from ...terminal import DONE, CountedProgress, console, printable
from ...terms import NodalLoad, StVK
from ...units import UNITS

#: Numbers of unknowns of the reduced bodies, and the integrators of their steps: the cheapest, and the one that conserves energy.
SIZES = 10, 20, 30, 60
ON_BASIS: tuple[type[Any], ...] = LinearBackwardEuler, EnergyMomentum
#: Displacements that the push is to cause, as parts of the longest side. The first one with an equilibrium is taken.
PARTS = 0.1, 0.03, 0.01
#: Seconds and number of steps after which a measurement ends, and the number of steps in which the push rises, falls and returns.
SECONDS, STEPS, PERIOD = 2.0, 5000, 200
#: Width of the ends of the longest side, as a part of it.
END = 0.05
#: Precomputed response: displacements of the handle along the push and along each other axis, and cells for its error.
ALONG, ACROSS, CHECKS = 5, 3, 8
#: Columns of the table.
LINE = "{:<14}{:<21}{:<17}{:>10}{:>11}{:>7}  {:<17}{:>12}"


class NotMeasured(StvkError):
    """Reason in a few words why a row of the table has no times, with its explanation."""

    def __init__(self, words: str, explanation: str) -> None:
        super().__init__(explanation)
        self.words = words


@dataclass(frozen=True)
class BudgetRow:
    """Row of the table: the times (n,) of steps [s] and the error of the body, or the reason why there are none."""

    body: str
    integrator: str = ""
    solver: str = ""
    times: Array | None = None
    error: float | None = None
    reason: str = ""
    explanation: str = ""

    def fits(self, step: float) -> str:
        """Return whether the times are at most `step` [s], or the reason why there are none."""
        if self.times is None:
            return self.reason
        median, slow = _median_and_slow(self.times)
        return "yes" if slow <= step else "median only" if median <= step else "no"

    def line(self, step: float) -> str:
        """Return the row as text."""
        numbers: tuple[Any, ...] = "-", "-", "-"
        if self.times is not None:
            numbers = *(f"{1e3 * x:.3g}" if x < 1 else f"{1e3 * x:.0f}" for x in _median_and_slow(self.times)), len(self.times)
        error = "" if self.error is None else f"{100 * self.error:.2g} %"
        return LINE.format(self.body, self.integrator, self.solver, *numbers, self.fits(step), error).rstrip()


#: Work of a row: returns the times (n,) of its steps [s], and the error of the body if it has one.
Work = Callable[[], tuple[Array, float | None]]


class Budget:
    """Measurements on a body in a state that a static push has bent. The push then varies by half of its size.

    Parameters
    ----------
    mesh, material
        Mesh and material of the body.
    fixed, pushed
        Names of the nodes that are fixed, and of those that are pushed, each with an equal part of the force.
    step
        Time step [s].
    units
        System of units of all values.

    Attributes
    ----------
    loaded, push, u
        Body with the push, the force (d,) [N], and the displacements (ndofs,) [m] of its equilibrium.

    Raises
    ------
    StvkError
        if supports leave a motion without strain, if all pushed nodes are fixed, or if no push has an equilibrium.
    """

    def __init__(self, mesh: ElementMesh, material: StVK, fixed: str, pushed: str, step: float, units: str = "SI") -> None:
        supports, d = {fixed: "xyz"[: mesh.d]}, mesh.d
        self.body, self.pushed, self.step = System(mesh, material, fixed=supports, units=units), pushed, step
        self.unknowns = self.body.ndofs - len(self.body.supports.held)
        self._reduced = cache(self._make_reduced)
        try:
            self.body.check_held()
        except SupportError as error:
            raise SupportError(f"{error} Name the boundary or node set that is fixed: --fixed NAME.") from None
        self.nodes = vertices_at(mesh, pushed, "--pushed")
        if np.isin(self.nodes, vertices_at(mesh, fixed)).all():
            raise StvkError(f"--pushed {pushed}: all of its nodes are fixed; expected nodes that can move.")
        compliances, rest = np.zeros(d), AtRest(self.body)
        for axis in range(d):
            force = np.zeros((mesh.nv, d))
            force[self.nodes, axis] = 1 / len(self.nodes)
            compliances[axis] = rest.solve(force.ravel()) @ force.ravel()
        self.axis = int(np.argmax(compliances))
        for part in PARTS:
            self.push = np.eye(d)[self.axis] * part * np.ptp(mesh.p, axis=1).max() / compliances[self.axis]
            self.loaded = System(mesh, [material, NodalLoad(pushed, self.push / len(self.nodes))], fixed=supports, units=units)
            found = solve_static(self.loaded, quiet=True, raise_on_failure=False)
            self.u = found.u
            if found.success:
                return
        raise StvkError(f"No push has an equilibrium: {found.message} Expected other names of --fixed and --pushed.")

    def rows(self) -> Iterator[tuple[BudgetRow, Work]]:
        """Yield the rows without times, and the work that measures them."""
        for name, kind in INTEGRATORS.items():
            for solver in [""] if kind.explicit else _solvers()[0]:
                integrator = kind(dt=self.step, **({"solver": solver} if solver else {}))
                yield BudgetRow("full", name, solver), partial(self._full, integrator)
        for size in SIZES:
            for kind in ON_BASIS:
                yield BudgetRow(f"{size} unknowns", kind.__name__), partial(self._on_basis, size, kind(dt=self.step))
        yield BudgetRow("precomputed"), self._precomputed

    def _full(self, integrator: Integrator) -> tuple[Array, None]:
        if integrator.explicit and self.step > self._critical:
            s = self.body.units.of("s")
            raise NotMeasured("above critical", f"The critical step of explicit integrators is {self._critical:.3g} {s}.")
        solver = next((one for one in (*SOLVERS, Petsc()) if one.name == getattr(integrator, "solver", "")), None)
        if solver is not None and not solver.iterative and self.unknowns > MANY:
            raise NotMeasured("too large", f"Direct solvers are measured up to {MANY} unknowns; the body has {self.unknowns}.")
        return self._steps(self.loaded, integrator, self.u), None

    @cached_property
    def _critical(self) -> float:
        return critical_step(self.loaded, self.u).step

    def _on_basis(self, size: int, integrator: Integrator) -> tuple[Array, float]:
        reduced, u = self._reduced(size)
        return self._steps(reduced, integrator, u), float(np.abs(u - self.u).max() / np.abs(self.u).max())

    def _make_reduced(self, size: int) -> tuple[ReducedSystem, Array]:
        """Return the reduced body and its displacements under the push."""
        if size > self.unknowns:
            raise NotMeasured("too few unknowns", f"The full body has {self.unknowns} unknowns.")
        most = min(max(SIZES), self.unknowns)
        if size == most:
            reduced = ReducedSystem(self.loaded, size, quiet=True)
        else:  # the same fields without computing them again: the first principal components of the largest basis
            fields = self._reduced(most)[0].basis[:, :size]
            reduced = ReducedSystem(self.loaded, size, 0, snapshots=fields, quiet=True)
        return reduced, solve_static(reduced, quiet=True).u

    def _steps(self, body: System | ReducedLike, integrator: Integrator, u: Array) -> Array:
        """Return the times of steps from the displacements `u`."""
        sim = Simulation(body, integrator, pushed=[self.pushed], u0=u)
        times = seconds(lambda k: sim.step(**{self.pushed: np.sin(2 * np.pi * k / PERIOD) / 2 * self.push}))
        if len(sim.inside_out()):
            raise StateError(f"{len(sim.inside_out())} elements are inverted after {sim.steps} steps.")
        return times

    def _precomputed(self) -> tuple[Array, float]:
        d, moved = self.body.mesh.d, abs(self.u.reshape(-1, self.body.mesh.d)[self.nodes, self.axis].mean())
        size = moved * np.where(np.arange(d) == self.axis, 1.0, 0.1)
        axes = [np.linspace(-a, a, ALONG if axis == self.axis else ACROSS) for axis, a in enumerate(size)]
        answers = PrecomputedResponse(self.body, self.pushed, axes, checks=CHECKS, quiet=True)
        phases = np.arange(d)
        return seconds(lambda k: answers(size * np.sin(2 * np.pi * k / PERIOD + phases))), answers.error.largest_u


def seconds(work: Callable[[int], object]) -> Array:
    """Return the times (n,) [s] of calls `work(2)`, `work(3)`, ... The first call is not timed: it compiles and allocates."""
    work(1)
    times: list[float] = []
    begin = perf_counter()
    for k in count(2):
        before = perf_counter()
        work(k)
        after = perf_counter()
        times.append(after - before)
        if after - begin > SECONDS or len(times) == STEPS:
            break
    return np.array(times)


def measured(row: BudgetRow, work: Work) -> BudgetRow:
    """Return the row with its times, or with the reason why there are none."""
    try:
        times, error = work()
        return replace(row, times=times, error=error)
    except NotMeasured as error:
        return replace(row, reason=error.words, explanation=str(error))
    except StvkError as error:
        reason = "no state" if isinstance(error, AnalysisError) else "inverted" if isinstance(error, StateError) else "refused"
        return replace(row, reason=reason, explanation=str(error))


def with_ends(mesh: ElementMesh, fixed: str | None, pushed: str | None) -> tuple[ElementMesh, str, str]:
    """Return the mesh and the names of its fixed and pushed nodes: by default the ends of the longest side, as node sets."""
    axis = int(np.argmax(np.ptp(mesh.p, axis=1)))
    letter, x = "xyz"[axis], mesh.p[axis]
    part = END * np.ptp(x)
    lower, upper = f"lower end along {letter}", f"upper end along {letter}"
    ends: dict[str, Any] = {lower: np.flatnonzero(x <= x.min() + part), upper: np.flatnonzero(x >= x.max() - part)}
    made = replace(mesh, node_sets={**mesh.node_sets, **ends})
    return made, lower if fixed is None else fixed, upper if pushed is None else pushed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk budget`."""
    parser.add_argument("mesh", help="mesh file, in a format of docs/reference/mesh-files.md")
    parser.add_argument("--young", type=float, required=True, help="Young's modulus [Pa, or the unit of --units]")
    parser.add_argument("--poisson", type=float, required=True, help="Poisson's ratio")
    parser.add_argument("--density", type=float, required=True, help="mass density [kg/m^3, or the unit of --units]")
    parser.add_argument(
        "--step", type=float, required=True, help="time step, which is also the time that it may take [s, or the unit of --units]"
    )
    parser.add_argument("--units", choices=list(UNITS), default="SI", help="system of units of all values; by default SI")
    parser.add_argument("--fixed", metavar="NAME", help="fixed boundary or node set; by default the lower end of the longest side")
    parser.add_argument(
        "--pushed", metavar="NAME", help="pushed boundary or node set; by default the upper end of the longest side"
    )


def budget(options: argparse.Namespace) -> int:
    """Measure on this machine which simulations of a mesh fit in a time step: full, reduced and precomputed bodies.

    Nothing is estimated. Close other programs before, and interrupt it with Ctrl-C: the rows so far are printed.
    """
    step = number("--step", options.step, "a positive time step, such as 1e-3", 0.0)
    mesh, fixed, pushed = with_ends(read_mesh(Path(options.mesh)), options.fixed, options.pushed)
    material = StVK(young=options.young, poisson=options.poisson, density=options.density)
    (solvers, missing), units = _solvers(), UNITS[options.units]
    _print(f"{options.mesh}: {mesh!r}; fixed: {fixed}; pushed: {pushed}")
    _print(
        f"To measure, for {SECONDS:g} s each: steps of {step:g} {units.of('s')} of the full body with {len(INTEGRATORS)} "
        f"integrators and the solvers {', '.join(solvers)}; of bodies reduced to {', '.join(map(str, SIZES))} unknowns, and their "
        f"errors under a static push; answers of a precomputed response, from some {ALONG * ACROSS ** (mesh.d - 1) + CHECKS} "
        "static solves."
    )
    if missing:
        _print(f"Not installed, so not measured: {', '.join(missing)}")
    facts = machine()
    _print(f"Machine: {facts['processor']}, {facts['cores']} cores; kernels on {threads()} threads")
    made = Budget(mesh, material, fixed, pushed, step, options.units)
    for text in made.body.implausible():
        _print(f"note: {text}")
    rows = list(made.rows())
    moved = np.linalg.norm(made.u.reshape(-1, mesh.d), axis=1).max()
    _print(
        f"The push, {np.abs(made.push).max():.3g} {units.of('N')} along {'xyz'[made.axis]}, moves nodes by up to {moved:.3g} "
        f"{units.of('m')}. In motion it varies by half."
    )
    print_table(rows, step * units.factor("time"))
    return DONE


def print_table(rows: list[tuple[BudgetRow, Work]], step: float) -> None:
    """Print each row of the table, for steps of `step` [s], as it is measured, then the explanations of rows without times."""
    explained: dict[str, None] = {}
    with CountedProgress("budget", len(rows), quiet=False) as progress:
        head = "body", "integrator", "solver", "median ms", "99.9 % ms", "steps", f"fits in {1e3 * step:g} ms?", "static error"
        progress.print(LINE.format(*head))
        for row, work in rows:
            progress.show(description=f"{row.body} {row.integrator} {row.solver}")
            done = measured(row, work)
            progress.print(done.line(step))
            progress.show(advance=1)
            if done.reason:
                explained[f"{done.reason}: {done.explanation}"] = None
    for text in explained:
        _print(text)


def _print(text: str) -> None:
    """Print a line, for any width of the terminal."""
    console().print(printable(text), soft_wrap=True)


def _median_and_slow(times: Array) -> Array:
    """Return the median and the smallest time that 99.9 % of the times (n,) do not exceed."""
    return np.quantile(times, [0.5, 0.999], method="higher")


def _solvers() -> tuple[list[str], list[str]]:
    """Return the names of the linear solvers that are installed, and of those that are not."""
    here = {one.name: True for one in SOLVERS} | {"pardiso": pardiso_is_installed(), "petsc": Petsc().available}
    return [name for name in here if here[name]], [name for name in here if not here[name]]
