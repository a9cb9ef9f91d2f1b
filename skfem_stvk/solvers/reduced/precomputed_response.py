"""Precomputed response: static solves on a grid of displacements of a handle, and interpolation between them."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.progress import BarColumn, MofNCompleteColumn, TimeElapsedColumn, TimeRemainingColumn

from ... import arguments
from ...arguments import Array, array, number, shown, whole
from ...errors import StateError, StvkError, SupportError, name_ids, warn
from ...kernels.threads import threads
from ...linear import LinearSolver
from ...mesh.locations import Where, describe, vertices_at
from ...results.complete_files import output_path
from ...system import System
from ...system.free_tangent import solver_for
from ...system.protocol import checked_whole
from ...system.signature import Fingerprint, sums
from ...terminal import LINE_INTERVAL, Progress, duration, say
from ..newton.processes import is_worker_process
from .handle_solves import DisplacementGrid, DrivenSystem, HandleSolver, HandleSolves, HandleState

if TYPE_CHECKING:
    from .stores import PointsCheckpoint

#: Number of points of an axis in an interpolation, equally many on both sides where possible.
STENCIL = 4
#: Tolerance from which vectors are stored in single precision, which halves the memory and the time of an answer.
SINGLE = 1e-6
#: Displacements outside of an axis by this fraction of its length count as its end.
ROUNDED = 1e-12


@dataclass(frozen=True, eq=False)
class BetweenPoints:
    """Errors of the answers in the middle of cells, from solves outside the table.

    Attributes
    ----------
    points
        (m, d) displacements of the handle of these solves [m].
    force
        (m,) error of the force, as a fraction of the largest force in the table.
    u
        (m,) largest error of a node's displacement, as a fraction of the largest displacement in the table.
    unsolved
        Messages on midpoints without a stable equilibrium.
    """

    points: Array
    force: Array
    u: Array
    unsolved: tuple[str, ...] = ()

    @property
    def largest_force(self) -> float:
        """Largest error of a force; NaN without a measurement."""
        return float(self.force.max()) if len(self.force) else float("nan")

    @property
    def largest_u(self) -> float:
        """Largest error of displacements; NaN without a measurement."""
        return float(self.u.max()) if len(self.u) else float("nan")

    def __str__(self) -> str:
        if not len(self.points):
            return "errors between points were not measured"
        at_force, at_u = (_point_text(self.points[int(np.argmax(errors))]) for errors in (self.force, self.u))
        lost = f"; {len(self.unsolved)} more have no stable equilibrium: {self.unsolved[0]}" if self.unsolved else ""
        return (
            f"at {len(self.points)} midpoints wrong by at most {self.largest_force:.2g} of the largest force, at {at_force}, and "
            f"{self.largest_u:.2g} of the largest displacement, at {at_u}{lost}"
        )


class PrecomputedResponse:
    """Response of a body to displacements of a handle, from static solves on a grid of them: `answers(d) -> force, u`.

    The table has the exact forces, and the displacements of all nodes in a basis of their singular vectors. Between the points,
    polynomials of degree 3 interpolate the 4 nearest points of each axis (fewer on shorter axes). Answers are exact at the points,
    continuous, and have errors O(h^4) between them; `error` has measured values. The solves begin at rest, or at the point nearest
    to rest. They continue along the axes to the other points, so that they stay on the branch of equilibria through the first
    point.

    A point without a stable equilibrium is a hole, and a warning reports it. Answers in cells with a hole are refused. Cells next
    to them are interpolated linearly, with a jump of O(h^2) at their sides.

    Parameters
    ----------
    body
        A `System` with supports that leave no rigid motion once the handle is constrained. Its loads and prescribed displacements
        act in full, as at t = 1.
    handle
        The location whose nodes all have the same displacement: a name, node ids, a predicate, a shape; none of them fixed or
        prescribed in the body.
    displacements
        An axis of ascending displacements (n_c,) for each component [m], with zero on each or between its values. An axis of one
        value fixes its component there.
    tolerance
        Error of displacements in the table, as a fraction of the largest one, in the 2-norm over all nodes.
    checks
        Number of cells in whose middle the error is measured, spread over the grid; None for all of them.
    steps, rtol, solver
        Options of each solve, as in `solve_static`; the first step of each solve is 1/steps of its path.
    jobs
        Number of solves at a time, each in a separate process, in programs under `if __name__ == "__main__":`; 1 is this process.
    checkpoint
        A folder that stores each solve as it is found. The same call continues from the stored solves.
    quiet
        Print nothing.

    Attributes
    ----------
    axes
        Axes of the grid, the argument `displacements`.
    nodes
        (m,) ids of the nodes of the handle.
    forces
        (n_1, ..., n_d, d) force at each point of the grid [N].
    rank
        Number of basis vectors of the displacements.
    holes
        Reasons for missing answers, by displacement.
    error
        Errors between the points of the grid, as `BetweenPoints`.

    Raises
    ------
    StvkError, RegionError, SupportError
        for invalid arguments; for a checkpoint of another problem; if the first solve fails, from which all others start.
    KeyboardInterrupt
        after Ctrl-C; finished solves are in the checkpoint.

    Warns
    -----
    StvkWarning
        for holes, and for warnings of the solves.

    Notes
    -----
    After Zhong, Wachowiak and Peters (2005).

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTri.init_tensor(np.linspace(0, 4, 9), np.linspace(0, 1, 3)).with_defaults()
    >>> body = System(mesh, StVK(young=1e5, poisson=0.3), fixed={"left": "xy"})
    >>> x, y = [-0.2, 0.0, 0.2], np.linspace(-1, 1, 7)
    >>> answers = PrecomputedResponse(body, handle="right", displacements=(x, y), checks=4, quiet=True)
    >>> force, u = answers((0.1, 0.5))
    >>> force.shape, u.shape, bool(force[1] > 0), answers.error.largest_force < 0.01
    ((2,), (54,), True, True)
    """

    def __init__(
        self,
        body: System,
        handle: Where,
        displacements: Sequence[ArrayLike],
        *,
        tolerance: float = 1e-5,
        checks: int | None = 20,
        steps: int = 2,
        rtol: float = 1e-8,
        solver: str | LinearSolver = "auto",
        jobs: int = 1,
        checkpoint: str | os.PathLike[str] | None = None,
        quiet: bool = False,
    ) -> None:
        checked_whole(body, "PrecomputedResponse(body, ...)", "body")
        nodes = vertices_at(body.mesh, handle, "handle")
        grid = DisplacementGrid(_axes(displacements, body.mesh.d))
        number("tolerance", tolerance, "a part of the largest displacement, such as 1e-5", 0.0, 1.0)
        checks = None if checks is None else whole("checks", checks, "how many midpoints are solved, or None for all")
        whole("steps", steps, "a whole number of at least 1: the first step is 1/steps of the way", 1)
        number("rtol", rtol, "a number between 0 and 1, such as 1e-8", 0.0, 1.0)
        jobs = whole("jobs", jobs, "how many solves go on at a time, from 1", 1)
        arguments.flag("quiet", quiet)
        folder = None if checkpoint is None else arguments.path("checkpoint", checkpoint, "the path of a folder such as 'grip'")
        work = HandleSolver(body.made_from, dict(body.made_of), body.removed, nodes, steps, float(rtol), solver)
        if jobs > 1:
            if is_worker_process():
                raise StvkError("This process was started for solves. Make the response only under `if __name__ == ...:`.")
            work.refuse_processes()
        chosen = solver_for(_driven(body, nodes, describe(handle)), solver)
        options = {"axes": [axis.tolist() for axis in grid.axes], "steps": steps, "rtol": float(rtol), "solver": chosen.name}
        self._body = body
        self._problem = _fingerprint(body, options, nodes)
        with ExitStack() as stack:
            store: PointsCheckpoint | None = None
            if folder is not None:
                from .stores import PointsCheckpoint

                sizes, last = (body.ndofs, body.mesh.d), len(grid) + len(grid.cells) - 1
                store = stack.enter_context(PointsCheckpoint(folder, self._problem, sizes, last))
            states = _solved(HandleSolves(grid, work, checks, store.stored if store else {}), store, jobs, quiet)
        self._make(grid, nodes, states, float(tolerance))
        say(repr(self), quiet)
        self._warn(states)

    def __call__(self, displacement: ArrayLike) -> tuple[Array, Array]:
        """Return the force on the handle (d,) [N] and the displacements of all nodes (ndofs,) [m], for a displacement of the handle
        (d,).

        The force holds the handle there, `StaticResult.reaction(handle).resultant`; the handle's force on a hand is its negative.

        Raises
        ------
        StateError
            outside of an axis, with its name, the value and the range; near a hole; for numbers that are not finite.
        """
        d = array("displacement", displacement, (len(self.axes),), f"{len(self.axes)} finite numbers, one per axis [m]", StateError)
        found = self._interpolated(d)
        u = (self._basis @ found[len(d) :].astype(self._basis.dtype)).astype(np.float64)
        u[self._constrained] = self._constrained_at
        u.reshape(-1, len(d))[self.nodes] = d
        return found[: len(d)], u

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the table to an .npz file, for `PrecomputedResponse.load`; return the path.

        Parameters
        ----------
        path
            Path of the file (.npz).

        Raises
        ------
        StvkError
            as `results.write_vtu`.
        """
        from .stores import SavedTable, TableFile

        path = output_path(path, ".npz")
        table = SavedTable(
            axes=list(self.axes),
            nodes=self.nodes,
            table=self._table,
            basis=self._basis,
            solved=self._solved,
            error_points=self.error.points,
            error_force=self.error.force,
            error_u=self.error.u,
            holes={str(k): reason for k, reason in enumerate(self._hole_reasons) if reason},
            compression=self.compression,
            unsolved=list(self.error.unsolved),
        )
        TableFile.write_file(path, self._problem, table)
        return path

    @classmethod
    def load(cls, path: str | os.PathLike[str], body: System) -> PrecomputedResponse:
        """Return the response that `save` wrote.

        Parameters
        ----------
        path
            Path of the file (.npz).
        body
            The body, with the mesh, terms, supports and loads with which the file was made.

        Raises
        ------
        StvkError
            if the file is of a body with another mesh, other terms, supports or loads, if it cannot be read, or if its arrays
            are not those of a table.
        """
        from .stores import TableFile, refusing_damage

        path = arguments.path("path", path, "the path of an .npz file that save() wrote")
        checked_whole(body, "PrecomputedResponse.load(path, body)", "body")
        problem, saved = TableFile.read_file(path)
        self = cls.__new__(cls)
        self._body, self.nodes = body, saved.nodes
        self._problem = _fingerprint(body, problem.method, self.nodes)
        self._problem.refuse_other(problem, path, "Load it with the body of which it was made, or compute it again.")
        with refusing_damage(path, TableFile.remedy):
            saved.check(body.mesh.nv, body.mesh.d)
        self._grid = DisplacementGrid(tuple(saved.axes))
        self.axes = self._grid.axes
        self._table, self._basis, self._solved = saved.table, saved.basis, saved.solved
        self._hole_reasons = [saved.holes.get(str(k), "") for k in range(self._solved.size)]
        self.compression = saved.compression
        self.error = BetweenPoints(saved.error_points, saved.error_force, saved.error_u, tuple(saved.unsolved))
        self._set_supports()
        return self

    @property
    def body(self) -> System:
        """Body of the response."""
        return self._body

    @property
    def forces(self) -> Array:
        """Forces (n_1, ..., n_d, d) at each point of the grid [N]; zero at holes."""
        return self._table[..., : len(self.axes)]

    @property
    def rank(self) -> int:
        """Number of basis vectors of the displacements."""
        return int(self._basis.shape[1])

    @property
    def holes(self) -> dict[tuple[float, ...], str]:
        """Reasons for missing answers, by displacement of the handle, in order of the distance from rest."""
        near = sorted(range(len(self._grid)), key=lambda k: (self._grid.steps(k), k))
        return {tuple(self._grid.point(k).tolist()): self._hole_reasons[k] for k in near if self._hole_reasons[k]}

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self._solved.shape))
        holes = f", {len(self.holes)} of them holes" if not self._solved.all() else ""
        return (
            f"PrecomputedResponse: {len(self.nodes)} nodes at {shape} displacements{holes}; {self._body.ndofs} degrees of freedom "
            f"from {self.rank} vectors, which leave out {self.compression:.1g}; {self.error}"
        )

    def _make(self, grid: DisplacementGrid, nodes: NDArray[np.int64], states: Mapping[int, HandleState], tolerance: float) -> None:
        """Make the table and its basis from the states at the points of the grid, and its errors from those between."""
        self._grid, self.axes, self.nodes, n = grid, grid.axes, nodes, len(grid)
        self._hole_reasons = [states[k].message for k in range(n)]
        self._solved = np.array([not reason for reason in self._hole_reasons]).reshape(grid.shape)
        basis, amounts, self.compression = _compressed(np.array([states[k].u for k in range(n)]), tolerance)
        self._basis = basis.astype(np.float32 if tolerance >= SINGLE else np.float64)
        forces = np.array([states[k].force for k in range(n)])
        self._table = np.concatenate([forces, amounts], axis=1).reshape(*grid.shape, -1)
        self._set_supports()
        middles = [(grid.point(k), state) for k, state in sorted(states.items()) if k >= n]
        good = [(at, state) for at, state in middles if not state.message]
        points = np.array([at for at, _ in good]).reshape(-1, len(grid.axes))
        largest_u = max(np.abs(state.u).max() for state in states.values())
        largest_force = np.linalg.norm(forces, axis=1).max()
        errors = []
        for point, state in good:
            force, u = self(point)
            apart = np.linalg.norm((u - state.u).reshape(-1, len(point)), axis=1).max()
            errors.append((np.linalg.norm(force - state.force) / largest_force, apart / largest_u))
        of_force, of_u = np.array(errors).reshape(-1, 2).T
        lost = [f"{_point_text(at)}: {state.message}" for at, state in middles if state.message]
        self.error = BetweenPoints(points, of_force, of_u, tuple(lost))

    def _set_supports(self) -> None:
        """Find the exact displacements of the body's own supports, and whether the table has holes."""
        supports = self._body.supports
        self._constrained, self._constrained_at, self._has_no_holes = supports.held, supports.values(1.0), bool(self._solved.all())

    def _interpolated(self, d: Array) -> Array:
        """Return the force and the amounts of the vectors (d + rank,) at a displacement of the handle."""
        stencil = [_weights(axis, value, "xyz"[c], STENCIL) for c, (axis, value) in enumerate(zip(self.axes, d, strict=True))]
        if not self._has_no_holes and not self._covered(stencil):
            stencil = [_weights(axis, value, "xyz"[c], 2) for c, (axis, value) in enumerate(zip(self.axes, d, strict=True))]
            if not self._covered(stencil):
                raise StateError(self._near_hole(d, stencil))
        values = self._table[tuple(slice(begin, begin + len(weights)) for begin, weights in stencil)]
        for _, weights in stencil:
            values = np.tensordot(weights, values, axes=1)
        return values

    def _covered(self, stencil: list[tuple[int, Array]]) -> bool:
        """Return whether no point of the stencil is a hole."""
        return not len(self._missing(stencil))

    def _missing(self, stencil: list[tuple[int, Array]]) -> Array:
        """Return the indices (m, d) of the holes in the stencil."""
        solved = self._solved[tuple(slice(begin, begin + len(weights)) for begin, weights in stencil)]
        counts = np.ones((), dtype=bool)
        for _, weights in stencil:
            counts = np.logical_and.outer(counts, weights != 0)
        return np.argwhere(counts & ~solved) + [begin for begin, _ in stencil]

    def _near_hole(self, d: Array, stencil: list[tuple[int, Array]]) -> str:
        indices = self._missing(stencil)[0]
        hole = self._grid.number(tuple(indices))
        at = _point_text(self._grid.point(hole))
        return f"displacement = {_point_text(d)} is in a cell with the hole {at}: {self._hole_reasons[hole]}"

    def _warn(self, states: Mapping[int, HandleState]) -> None:
        """Warn of holes, and repeat warnings of the solves."""
        holes = self.holes
        if holes:
            named = ", ".join(_point_text(at) for at in list(holes)[:3]) + (", ..." if len(holes) > 3 else "")
            warn(
                f"No stable equilibrium at {len(holes)} of {len(self._hole_reasons)} displacements ({named}): "
                f"{next(iter(holes.values()))}"
            )
        warned = [(k, state.warning) for k, state in sorted(states.items()) if state.warning]
        if warned:
            at = _point_text(self._grid.point(warned[0][0]))
            warn(f"{len(warned)} of {len(states)} solves warned, the first of them at {at}: {warned[0][1]}")


class _GridProgress(Progress):
    """Progress bar on a terminal, elsewhere a line every few seconds."""

    def __init__(self, header: str, total: int, quiet: bool) -> None:
        super().__init__("response", quiet, (BarColumn(24), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()))
        self._total, self._begin, self._next = total, time.perf_counter(), time.perf_counter() + LINE_INTERVAL
        self.print(header)
        self.show(total=total)

    def count(self, done: int) -> None:
        """Show how many solves are done."""
        now = time.perf_counter()
        self.show(completed=done)
        if self._bar is None and now >= self._next:
            self.print(f"{done} of {self._total} solves, {duration(now - self._begin)}")
            self._next = now + LINE_INTERVAL


def _solved(solves: HandleSolves, store: PointsCheckpoint | None, jobs: int, quiet: bool) -> Mapping[int, HandleState]:
    """Return all states of a grid and of midpoints."""
    grid, cores = solves.grid, threads()
    total = len(grid) + solves.checks
    jobs = max(1, min(jobs, cores, total))
    stored = f", {len(store.stored)} of them solved already" if store is not None and store.stored else ""
    at_a_time = f"; {jobs} at a time" if jobs > 1 else ""
    header = f"{len(grid)} displacements of the handle and {solves.checks} between them{stored}{at_a_time}"
    done = len(store.stored) if store is not None else 0
    with _GridProgress(header, total, quiet) as progress:
        try:
            for k, state, complete in solves.run(jobs, max(1, cores // jobs)):
                done += 1
                progress.count(done)
                if store is not None and complete:
                    store.add(k, state)
        except KeyboardInterrupt:
            where = "no checkpoint was requested" if store is None else f"they are in {store.folder}; the same call continues"
            progress.print(f"{done} of {total} solves are done: {where}")
            raise
    return solves.states


def _axes(value: Any, d: int) -> tuple[Array, ...]:
    """Return the axes of displacements, checked for a grid."""
    expected = f"a tuple of {d} axes of displacements, one per component, such as (x, y, z) with x = np.linspace(-0.1, 0.1, 5)"
    if not isinstance(value, list | tuple) or len(value) != d:
        raise StvkError(f"displacements = {shown(value)}; expected {expected[:-1] if d == 1 else expected}.")
    axes = []
    for letter, one in zip("xyz", value, strict=False):
        name = f"displacements: {letter}"
        axis = array(name, one, (None,), "(n,) finite displacements").copy()
        if not len(axis) or (np.diff(axis) <= 0).any():
            raise StvkError(f"{name} = {shown(one)}; expected at least one displacement, ascending.")
        if len(axis) > 1 and not axis[0] <= 0 <= axis[-1]:
            raise StvkError(
                f"{name} goes from {axis[0]:.6g} to {axis[-1]:.6g}; expected zero within this range, because solves begin at rest."
            )
        axes.append(axis)
    if all(len(axis) == 1 for axis in axes):
        raise StvkError("displacements: each axis has one value; expected two or more on at least one axis.")
    return tuple(axes)


def _driven(body: System, nodes: NDArray[np.int64], where: str) -> DrivenSystem:
    """Return the body with its handle constrained. Refuse it if the handle's nodes have other supports, or rigid motions remain."""
    both = np.intersect1d(nodes, body.supports.held // body.mesh.d)
    if len(both):
        raise SupportError(
            f"handle: of {where}, {name_ids(both, body.mesh.word)} are fixed or prescribed in the body. Leave them out of the "
            "handle, or of the supports."
        )
    driven = DrivenSystem.of(body, nodes)
    driven.check_held()
    return driven


def _fingerprint(body: System, options: Mapping[str, Any], nodes: NDArray[np.int64]) -> Fingerprint:
    return Fingerprint("path of equilibria", body, options, (1.0,), {"the handle": [len(nodes), *sums(nodes)]})


def _weights(axis: Array, value: float, letter: str, most: int) -> tuple[int, Array]:
    """Return the first point of an axis in the interpolation at a value, and the weights of Lagrange's polynomials."""
    low, high, n = axis[0], axis[-1], len(axis)
    if not low <= value <= high:
        slack = ROUNDED * max(high - low, abs(low), abs(high))
        if not low - slack <= value <= high + slack:
            raise StateError(f"displacement along {letter} = {value:.9g}, outside of its axis from {low:.9g} to {high:.9g}.")
        value = min(max(value, low), high)
    count = min(most, n)
    cell = min(max(int(np.searchsorted(axis, value, side="right")) - 1, 0), max(n - 2, 0))
    begin = min(max(cell - (count - 1) // 2, 0), n - count)
    at = axis[begin : begin + count].tolist()
    weights = []
    for i, own in enumerate(at):
        weight = 1.0
        for j, other in enumerate(at):
            if j != i:
                weight *= (value - other) / (own - other)
        weights.append(weight)
    return begin, np.array(weights)


def _compressed(states: Array, tolerance: float) -> tuple[Array, Array, float]:
    """Return vectors (ndofs, r) and their amounts (n, r) that represent the states (n, ndofs), and the largest remainder of a
    state.

    The remainder is less than the tolerance. Both are fractions of the largest state, in the 2-norm.
    """
    left, sizes, right = np.linalg.svd(states, full_matrices=False)
    amounts = left * sizes
    lost = np.sqrt(np.cumsum(amounts[:, ::-1] ** 2, axis=1)[:, ::-1])  # (n, r) norms without the vectors from each on
    largest = np.linalg.norm(amounts, axis=1).max()
    worst = np.append(lost.max(axis=0), 0.0)
    rank = max(1, int(np.argmax(worst <= tolerance * largest)))
    return np.ascontiguousarray(right[:rank].T), np.ascontiguousarray(amounts[:, :rank]), float(worst[rank] / largest)


def _point_text(point: Array | tuple[float, ...]) -> str:
    return f"({', '.join(f'{one:.4g}' for one in point)})"
