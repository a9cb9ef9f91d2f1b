"""The command `skfem-stvk budget`: measure on this machine which simulations of a mesh fit in a time step."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np

from ...arguments import Array, number
from ...errors import StvkError
from ...kernels.threads import threads
from ...linear.choose import SOLVERS, solver_names
from ...mesh import read_mesh
from ...mesh.locations import vertices_at
from ...solvers.dynamics import INTEGRATORS, EnergyMomentum, Integrator, LinearBackwardEuler, Simulation, critical_step
from ...solvers.dynamics.at_rest import MANY, AtRest
from ...solvers.reduced import PrecomputedResponse, ReducedSystem
from ...solvers.statics import solve_static
from ...system import System
from ...system.coordinates import ReducedLike
from ...terminal import DONE
from ...terms import NodalLoad, StVK
from ...units import UNITS

#: Numbers of unknowns of the reduced bodies, and the integrators of their steps: the cheapest, and the one that conserves energy.
SIZES, ON_BASIS = (10, 20, 30, 60), (LinearBackwardEuler, EnergyMomentum)
#: Displacements by the push as parts of the longest side, of which the first with an equilibrium is taken; seconds and number of
#: steps after which a measurement ends; and the number of steps in which the push rises, falls and returns.
PARTS, SECONDS, STEPS, PERIOD = (0.1, 0.03, 0.01), 2.0, 5000, 200
#: Columns of the table: body, integrator, linear solver; median and 99.9 % of the times; steps, fit and static error.
LINE = "{:<14}{:<21}{:<17}{:>10}{:>11}{:>7}  {:<17}{:>12}"


class Budget:
    """Measurements on a body that a static push at the nodes `pushed` has bent. The push then varies by half of its size."""

    def __init__(self, body: System, pushed: str, step: float) -> None:
        body.check_held()
        mesh, d, rest = body.mesh, body.mesh.d, AtRest(body)
        self.body, self.pushed, self.step, self.nodes = body, pushed, step, vertices_at(mesh, pushed, "--pushed")
        if np.isin(d * self.nodes, body.supports.held).all():
            raise StvkError(f"--pushed {pushed}: all of its nodes are fixed; expected nodes that can move.")
        share = np.isin(np.arange(mesh.nv), self.nodes)[:, None] / len(self.nodes)
        compliances = [rest.solve(force) @ force for force in ((share * axis).ravel() for axis in np.eye(d))]
        self.axis = int(np.argmax(compliances))
        for part in PARTS:
            self.push = np.eye(d)[self.axis] * part * mesh.extent.max() / compliances[self.axis]
            terms = [*body.terms, NodalLoad(pushed, self.push / len(self.nodes))]
            self.loaded = System(mesh, **{**body.made_of, "terms": terms})
            found = solve_static(self.loaded, quiet=True, raise_on_failure=False)
            self.u = found.u
            if found.success:
                return
        raise StvkError(f"No push has an equilibrium: {found.message} Expected other names of --fixed and --pushed.")

    def lines(self) -> Iterator[str]:
        """Yield the lines of the table, each as soon as it is measured."""
        for name, kind in INTEGRATORS.items():
            for options in [{}] if kind.explicit else [{"solver": solver} for solver in solver_names() if solver != "auto"]:
                yield self._line("full", name, partial(self._full, kind(dt=self.step, **options)), **options)
        for size, method in product(SIZES, ON_BASIS):
            yield self._line(f"{size} unknowns", method.__name__, partial(self._reduced, size, method(dt=self.step)))
        yield self._line("precomputed", "", self._precomputed)

    def _line(self, body: str, integrator: str, work: Callable[[], tuple[Array, float | None]], solver: str = "") -> str:
        """Return a line of the table: the times (n,) [s] and the error that `work` returns, or the reason of its error."""
        try:
            times, error = work()
        except StvkError as reason:
            return f"{body:<14}{integrator:<21}{solver:<17}{reason}"
        (median, slow), step = np.quantile(times, [0.5, 0.999], method="higher"), self.step * self.body.units.factor("time")
        fits = "yes" if slow <= step else "median only" if median <= step else "no"
        shown = [f"{1e3 * x:.3g}" if x < 1 else f"{1e3 * x:.0f}" for x in (median, slow)]
        return LINE.format(
            body, integrator, solver, *shown, len(times), fits, "" if error is None else f"{100 * error:.2g} %"
        ).rstrip()

    def _full(self, integrator: Integrator) -> tuple[Array, None]:
        if integrator.explicit and (critical := critical_step(self.loaded, self.u).step) < self.step:
            raise StvkError(f"above the critical step, {critical:.3g} {self.body.units.of('s')}")
        direct = [one.name for one in SOLVERS if not one.iterative]
        if self.body.ndofs > MANY and getattr(integrator, "solver", "") in direct:
            raise StvkError(f"too large: direct solvers are measured up to {MANY} unknowns")
        return self._steps(self.loaded, integrator, self.u), None

    def _reduced(self, size: int, integrator: Integrator) -> tuple[Array, float]:
        reduced = ReducedSystem(self.loaded, size, quiet=True)
        u = solve_static(reduced, quiet=True).u
        return self._steps(reduced, integrator, u), float(np.abs(u - self.u).max() / np.abs(self.u).max())

    def _steps(self, body: System | ReducedLike, integrator: Integrator, u: Array) -> Array:
        """Return the times of steps from the displacements `u`."""
        sim = Simulation(body, integrator, pushed=[self.pushed], u0=u)
        times = seconds(lambda k: sim.step(**{self.pushed: np.sin(2 * np.pi * k / PERIOD) / 2 * self.push}))
        if len(sim.inside_out()):
            raise StvkError(f"{len(sim.inside_out())} elements are inverted after {sim.steps} steps")
        return times

    def _precomputed(self) -> tuple[Array, float]:
        d, moved = self.body.mesh.d, abs(self.u.reshape(-1, self.body.mesh.d)[self.nodes, self.axis].mean())
        size = moved * np.where(np.arange(d) == self.axis, 1.0, 0.1)
        axes = [np.linspace(-one, one, 5 if axis == self.axis else 3) for axis, one in enumerate(size)]
        answers = PrecomputedResponse(self.body, self.pushed, axes, checks=8, quiet=True)
        return seconds(lambda k: answers(size * np.sin(2 * np.pi * k / PERIOD + np.arange(d)))), answers.error.largest_u


def seconds(work: Callable[[int], object]) -> Array:
    """Return the times (n,) [s] of calls `work(2)`, `work(3)`, ... The first call is not timed: it compiles and allocates."""
    times: list[float] = []
    work(1)
    while sum(times) <= SECONDS and len(times) < STEPS:
        begin = perf_counter()
        work(len(times) + 2)
        times.append(perf_counter() - begin)
    return np.array(times)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `skfem-stvk budget`."""
    parser.add_argument("mesh", help="mesh file, in a format of docs/reference/mesh-files.md")
    parser.add_argument("--young", type=float, required=True, help="Young's modulus [Pa, or the unit of --units]")
    parser.add_argument("--poisson", type=float, required=True, help="Poisson's ratio")
    parser.add_argument("--density", type=float, required=True, help="mass density [kg/m^3, or the unit of --units]")
    parser.add_argument("--step", type=float, required=True, help="time step, also its time limit [s, or the unit of --units]")
    parser.add_argument("--units", choices=list(UNITS), default="SI", help="system of units of all values; by default SI")
    parser.add_argument("--fixed", default="lower end", help="fixed boundary or node set; by default one end of the longest side")
    parser.add_argument("--pushed", default="upper end", help="pushed boundary or node set; by default the other end")


def budget(options: argparse.Namespace) -> int:
    """Measure on this machine which simulations of a mesh fit in a time step: full, reduced and precomputed bodies.

    Nothing is estimated. Close other programs before, and interrupt it with Ctrl-C: the rows so far are printed.
    """
    step = number("--step", options.step, "a positive time step, such as 1e-3", 0.0)
    mesh, units = read_mesh(options.mesh), UNITS[options.units]
    x = mesh.p[np.argmax(mesh.extent)]
    near = 0.05 * np.ptp(x)
    ends: Any = {"lower end": np.flatnonzero(x <= x.min() + near), "upper end": np.flatnonzero(x >= x.max() - near)}
    mesh = replace(mesh, node_sets={**mesh.node_sets, **ends})
    material = StVK(young=options.young, poisson=options.poisson, density=options.density)
    body = System(mesh, material, fixed={options.fixed: "xyz"[: mesh.d]}, units=options.units)
    made = Budget(body, options.pushed, step)
    moved = np.linalg.norm(made.u.reshape(-1, mesh.d), axis=1).max()
    print(f"{options.mesh}: {mesh!r}; fixed: {options.fixed}; pushed: {options.pushed}; kernels on {threads()} threads")
    for text in body.implausible():
        print(f"note: {text}")
    push = f"{np.abs(made.push).max():.3g} {units.of('N')} along {'xyz'[made.axis]}"
    print(f"The push, {push}, moves nodes by up to {moved:.3g} {units.of('m')}. In motion it varies by half.")
    head = "body", "integrator", "solver", "median ms", "99.9 % ms", "steps", f"fits in {1e3 * step * units.factor('time'):g} ms?"
    print(LINE.format(*head, "static error"))
    for line in made.lines():
        print(line, flush=True)
    return DONE
