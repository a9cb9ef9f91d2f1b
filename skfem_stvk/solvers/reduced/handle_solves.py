"""Static solves on a grid of displacements of a handle, each started from its neighbour nearer to rest; in processes on request."""

from __future__ import annotations

import pickle
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StvkError, StvkWarning
from ...linear import LinearSolver
from ...mesh import MeshLike
from ...npz import Count, Numbers
from ...results.complete_files import output_folder
from ...system import System
from ...system.signature import Fingerprint
from ...terms.loads.load import Moment, Time
from ..newton.outcome import finishing_steps, stop_if_requested
from ..newton.processes import Crashed, in_processes
from ..runs.archive import STRICT, FolderStore, refusing_damage
from ..statics import solve_static


class DisplacementGrid:
    """Product of axes of displacements (n_c,), ascending, numbered with the last axis fastest, and the order of its points.

    The order begins at the point nearest to zero, `first`. The `nearer` neighbours of a point are one step closer to `first`.
    """

    def __init__(self, axes: tuple[Array, ...]) -> None:
        self.axes = axes
        self.shape = tuple(map(len, axes))
        self.points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        self._first = tuple(int(np.argmin(np.abs(axis))) for axis in axes)
        self.first = self.number(self._first)

    def __len__(self) -> int:
        return len(self.points)

    def number(self, indices: tuple[int, ...]) -> int:
        """Return the number of a point from its indices on the axes."""
        return int(np.ravel_multi_index(indices, self.shape))

    def indices(self, number: int) -> tuple[int, ...]:
        """Return the indices of a point on the axes."""
        return tuple(map(int, np.unravel_index(number, self.shape)))

    def steps(self, number: int) -> int:
        """Return the number of steps along axes from the first point."""
        return sum(abs(i - first) for i, first in zip(self.indices(number), self._first, strict=True))

    def neighbours(self, number: int, nearer: bool) -> list[int]:
        """Return the neighbours along axes one step closer to the first point, or further from it; the least distant first."""
        here, found = self.indices(number), []
        for c, (i, first, axis) in enumerate(zip(here, self._first, self.axes, strict=True)):
            for j in (i - 1, i + 1):
                if 0 <= j < len(axis) and (abs(j - first) < abs(i - first)) == nearer:
                    found.append((abs(float(axis[j] - axis[i])), self.number((*here[:c], j, *here[c + 1 :]))))
        return [neighbour for _, neighbour in sorted(found)]

    @cached_property
    def cells(self) -> Array:
        """Numbers (m, 2^d) of the corners of each cell between neighbours; axes of one value have no extent."""
        spans = [range(max(n - 1, 1)) for n in self.shape]
        corners = list(product(*((0, 1) if n > 1 else (0,) for n in self.shape)))
        return np.array([[self.number(tuple(np.add(cell, corner))) for corner in corners] for cell in product(*spans)])

    def point(self, number: int) -> Array:
        """Return the displacement (d,) of a point; numbers beyond the grid are midpoints of cells."""
        if number < len(self):
            return np.asarray(self.points[number])
        return np.asarray(self.points[self.cells[number - len(self)]].mean(axis=0))


@dataclass
class HandlePath:
    """The path of a handle: a straight line from displacement `start` to `end` (d,) [m] as t goes from 0 to 1.

    Loads and the body's own prescribed displacements are constant at their values at t = 1. With `from_rest` they grow as the
    handle moves.
    """

    start: Array
    end: Array
    from_rest: bool = True

    def displacements(self, x: Array, t: float) -> Array:
        """Return the displacements (d, n) of nodes `x` (d, n) of the handle."""
        return np.repeat(((1 - t) * self.start + t * self.end)[:, None], x.shape[1], axis=1)

    def loads_at(self, t: Time) -> Time:
        """Return the load factor of the loads at `t`."""
        return t if self.from_rest else Moment.of(t)._replace(time=1.0, factor=1.0)


class DrivenSystem(System):
    """A body whose handle moves along its `path`, under all of its loads."""

    def __init__(self, body: System, handle: NDArray[np.int64]) -> None:
        d, own = body.mesh.d, body.supports
        self.path = path = HandlePath(np.zeros(d), np.zeros(d))
        nodes, components = np.divmod(own.prescribed, d)
        indices = np.searchsorted(own.held, own.prescribed)

        def prescribed(indices: NDArray[np.int64]) -> Callable[[Array, float], Array]:
            return lambda x, t: own.values(path.loads_at(t))[indices]

        moved: list[tuple[Any, Any]] = [
            (nodes[components == c], {"xyz"[c]: prescribed(indices[components == c])}) for c in np.unique(components)
        ]
        super().__init__(body.made_from, **{**body.made_of, "prescribed": [*moved, (handle, path.displacements)]})

    @classmethod
    def of(cls, body: System, handle: NDArray[np.int64]) -> DrivenSystem:
        """Return the body, without its removed elements, with the `handle` among its supports."""
        return cls(body, handle).without(body.removed)

    def _moment(self, t: Time) -> Moment:
        return super()._moment(self.path.loads_at(t))


class HandleTask(NamedTuple):
    """Data of one solve: the handle moves from `start`, where the displacements are `u0` (None at rest), to `end`."""

    number: int
    start: Array
    end: Array
    u0: Array | None


@dataclass(frozen=True, eq=False)
class HandleState:
    """Result of a displacement of the handle: `u` (ndofs,) [m], and the `force` (d,) on the handle [N].

    If there is no stable equilibrium, `message` says why; `warning` lists unreliable results.
    """

    u: Numbers
    force: Numbers
    message: str = ""
    warning: str = ""


@dataclass(frozen=True)
class HandleSolver:
    """Solver for a body with its handle displaced, one displacement after the other; it can be pickled for processes."""

    made_from: MeshLike
    made_of: Mapping[str, Any]
    removed: NDArray[np.int64]
    handle: NDArray[np.int64]
    steps: int
    rtol: float
    solver: str | LinearSolver

    @cached_property
    def driven(self) -> DrivenSystem:
        """Body with the handle among its supports."""
        body = System(self.made_from, **self.made_of).without(self.removed)
        return DrivenSystem.of(body, self.handle)

    def __call__(self, task: HandleTask) -> HandleState | None:
        """Return the state, or None if Ctrl-C came before it was found."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                driven = self.driven
                path = driven.path
                path.start, path.end, path.from_rest = task.start, task.end, task.u0 is None
                result = solve_static(
                    driven,
                    self.steps,
                    u0=task.u0,
                    solver=self.solver,
                    rtol=self.rtol,
                    quiet=True,
                    raise_on_failure=False,
                )
            except KeyboardInterrupt:
                return None
            except StvkError as error:
                return self._failed(str(error))
        if not result.success:
            return self._failed(result.message)
        if task.u0 is not None and any(step.jumped for step in result.history):
            return self._failed("the body snaps on the way to it, where its branch of equilibria ends.")
        force = driven.residual(result.u).reshape(-1, driven.mesh.d)[self.handle].sum(axis=0)
        messages = [str(one.message) for one in caught if issubclass(one.category, StvkWarning)]
        return HandleState(result.u, force, warning=messages[0] if messages else "")

    def _failed(self, message: str) -> HandleState:
        return HandleState(np.zeros(self.driven.ndofs), np.zeros(self.driven.mesh.d), message)

    def refuse_processes(self) -> None:
        """Refuse bodies that cannot be pickled for processes."""
        try:
            pickle.dumps(self)
        except Exception as error:  # pickle raises many kinds of errors
            raise StvkError(
                f"The body cannot be sent to other processes ({error}). Is a location or a load a lambda, or a function within "
                "another one? Use names, Box(...), functions of a module, or jobs=1."
            ) from error


class HandleSolves:
    """All solves of a grid, and of `checks` midpoints of cells, in an order in which each has a solved neighbour to start from.

    The neighbour does not depend on the order of the solves. So the states do not depend on the number of processes, nor on the
    earlier states in `stored`.
    """

    def __init__(self, grid: DisplacementGrid, solver: HandleSolver, checks: int | None, stored: Mapping[int, HandleState]) -> None:
        cells = len(grid.cells)
        self.grid, self._solver, self._stored = grid, solver, stored
        #: Number of midpoints to solve, if all points of the grid are solved.
        self.checks = cells if checks is None else min(checks, cells)
        self._midpoints_added = False
        self.states: dict[int, HandleState] = {}
        self._unsolved_neighbours = {number: len(grid.neighbours(number, nearer=True)) for number in range(len(grid))}
        self._waiting: deque[HandleTask] = deque()

    def run(self, jobs: int, threads: int) -> Iterator[tuple[int, HandleState, bool]]:
        """Yield numbers of points and their states as they are found, and whether to store them; midpoints have numbers after the
        grid.

        After Ctrl-C, KeyboardInterrupt is raised when running solves have ended.
        """
        start = np.zeros(self.grid.points.shape[1])
        self._add_task(HandleTask(self.grid.first, start, self.grid.points[self.grid.first], None))
        self._add_midpoints()
        outcomes = self._in_this_process() if jobs == 1 else in_processes(self._solver, self._waiting, jobs, threads)
        for task, outcome in outcomes:
            if outcome is None:
                continue
            crashed = isinstance(outcome, Crashed)
            state = self._solver._failed("its process ended abnormally") if isinstance(outcome, Crashed) else outcome
            if state.message and task.number == self.grid.first:
                raise StvkError(
                    f"The first displacement of the handle, from which all others are reached, has no equilibrium: {state.message}"
                )
            yield task.number, state, not crashed
            self._store(task.number, state)
            self._add_midpoints()

    def _in_this_process(self) -> Iterator[tuple[HandleTask, HandleState | None]]:
        with finishing_steps():
            while self._waiting:
                task = self._waiting.popleft()
                yield task, self._solver(task)
                stop_if_requested()

    def _add_midpoints(self) -> None:
        """Request the midpoints once the whole grid is known."""
        grid = self.grid
        if self._midpoints_added or len(self.states) != len(grid):
            return
        self._midpoints_added = True
        solved = np.array([not self.states[number].message for number in range(len(grid))])
        cells = np.flatnonzero(solved[grid.cells].all(axis=1))
        if self.checks < len(cells):
            cells = np.sort(np.random.default_rng(0).choice(cells, self.checks, replace=False))
        for cell in cells.tolist():
            corner = min(grid.cells[cell].tolist(), key=lambda number: (grid.steps(number), number))
            number = len(grid) + cell
            self._add_task(HandleTask(number, grid.points[corner], grid.point(number), self.states[corner].u))

    def _add_task(self, task: HandleTask) -> None:
        if task.number in self._stored:
            self._store(task.number, self._stored[task.number])
        else:
            self._waiting.append(task)

    def _store(self, number: int, state: HandleState) -> None:
        """Store a state, and offer the points with all of their nearer neighbours known."""
        grid, known = self.grid, [(number, state)]
        while known:
            number, state = known.pop()
            self.states[number] = state
            for other in grid.neighbours(number, nearer=False) if number < len(grid) else ():
                self._unsolved_neighbours[other] -= 1
                if self._unsolved_neighbours[other]:
                    continue
                begin = next((one for one in grid.neighbours(other, nearer=True) if not self.states[one].message), None)
                if begin is None:
                    known.append((other, self._solver._failed("no neighbour nearer to rest has been reached")))
                elif other in self._stored:
                    known.append((other, self._stored[other]))
                else:
                    self._waiting.append(HandleTask(other, grid.points[begin], grid.points[other], self.states[begin].u))


@dataclass(frozen=True)
class SavedPoint:
    """Record of one point of a grid, by its number."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    number: Count
    state: HandleState


class PointsCheckpoint(FolderStore[SavedPoint]):
    """Folder with a file for each solve of a grid: its states, `stored` by number, are not solved again."""

    known, name, schema = ("point of a precomputed response of skfem-stvk", 1), "point_{:06d}.npz", SavedPoint
    remedy = "Remove it, so that its point is solved again."

    def __init__(self, folder: Path, problem: Fingerprint, size: tuple[int, int], last: int) -> None:
        super().__init__(output_folder(folder))
        self.problem, self._size, self._last = problem, size, last
        self.stored: dict[int, HandleState] = {}

    def opened(self) -> None:
        for file in self.existing():
            saved = self.read_own(file, "Name another folder, or remove its files.")
            with refusing_damage(file, self.remedy):
                if saved.number > self._last or file != self.numbered(saved.number):
                    raise ValueError(f"its number is {saved.number}; expected that of its name, at most {self._last}")
                if (saved.state.u.size, saved.state.force.size) != self._size:
                    raise ValueError(f"its state has {saved.state.u.size} displacements; expected {self._size[0]}")
            self.stored[saved.number] = saved.state

    def add(self, number: int, state: HandleState) -> None:
        """Write a state."""
        self.write(self.numbered(number), SavedPoint(number, state))


def point_text(point: Array | tuple[float, ...]) -> str:
    """Return a displacement as text."""
    return f"({', '.join(f'{one:.4g}' for one in point)})"
