"""Precomputed response: static solves on a grid of displacements of a handle, and interpolation between them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ... import arguments
from ...arguments import Array, array, number, shown, whole
from ...errors import StateError, StvkError, SupportError, name_ids, warn
from ...kernels.threads import threads
from ...linear import LinearSolver
from ...mesh.locations import Where, describe, vertices_at
from ...npz import Ids, Numbers, Stored, Within
from ...results.complete_files import output_path
from ...system import System
from ...system.coordinates import checked_whole
from ...system.free_tangent import solver_for
from ...system.signature import Fingerprint, sums
from ...terminal import CountedProgress, say
from ..newton.processes import is_worker_process
from ..runs.archive import STRICT, Store, refusing_damage
from .handle_solves import (
    DisplacementGrid,
    DrivenSystem,
    HandleSolver,
    HandleSolves,
    HandleState,
    PointsCheckpoint,
    point_text,
)

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

    points: Annotated[Array, Stored(2)]
    force: Numbers
    u: Numbers
    unsolved: list[str] = field(default_factory=list)

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
        at_force, at_u = (point_text(self.points[int(np.argmax(errors))]) for errors in (self.force, self.u))
        lost = f"; {len(self.unsolved)} more have no stable equilibrium: {self.unsolved[0]}" if self.unsolved else ""
        return (
            f"at {len(self.points)} midpoints wrong by at most {self.largest_force:.2g} of the largest force, at {at_force}, and "
            f"{self.largest_u:.2g} of the largest displacement, at {at_u}{lost}"
        )


@dataclass(frozen=True)
class ResponseTable:
    """Table of a precomputed response: forces and amounts of the basis at each point of the grid, and reasons of its holes."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    axes: list[Numbers]
    nodes: Ids
    values: Annotated[Array, Stored(None)]
    basis: Annotated[Array, Stored(2, (np.float32, np.float64))]
    holes: dict[str, str]
    compression: Annotated[float, Within(0.0)]
    error: BetweenPoints = field(default_factory=lambda: BetweenPoints(np.empty((0, 1)), np.empty(0), np.empty(0)))

    def check(self, nv: int, d: int) -> None:
        """Raise ValueError if this cannot be a table on a mesh with `nv` nodes in `d` dimensions."""
        nodes, shape, count = self.nodes, tuple(map(len, self.axes)), len(self.error.points)
        if len(nodes) == 0 or len(np.unique(nodes)) < len(nodes) or nodes.min() < 0 or nodes.max() >= nv:
            raise ValueError(f"the array 'nodes' does not hold different numbers of nodes from 0 to {nv - 1}")
        if len(shape) != d or any(len(axis) == 0 or (np.diff(axis) <= 0).any() for axis in self.axes):
            raise ValueError("the displacements of an axis are not ascending")
        expected = (*shape, d + self.basis.shape[1]), (nv * d, self.basis.shape[1]), (count, d), (count,), (count,)
        arrays = self.values, self.basis, self.error.points, self.error.force, self.error.u
        if (got := tuple(array.shape for array in arrays)) != expected:
            raise ValueError(f"its arrays have shapes {got}; expected {expected}")
        if not all(self.holes.values()) or not self.holes.keys() <= set(map(str, range(self.values[..., 0].size))):
            raise ValueError("the holes in its header are not those of the grid")


class TableFile(Store[ResponseTable]):
    """File of the table of a response."""

    known, schema = ("precomputed response of skfem-stvk", 1), ResponseTable
    remedy = "Compute it again."


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
        self._problem = _fingerprint(body, options, nodes)
        with ExitStack() as stack:
            store: PointsCheckpoint | None = None
            if folder is not None:
                sizes, last = (body.ndofs, body.mesh.d), len(grid) + len(grid.cells) - 1
                store = stack.enter_context(PointsCheckpoint(folder, self._problem, sizes, last))
            states = _solved(HandleSolves(grid, work, checks, store.stored if store else {}), store, jobs, quiet)
        self._set(body, _table_of(grid, nodes, states, float(tolerance)))
        self._measure(states)
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
        found, basis = self._interpolated(d), self._table.basis
        u = (basis @ found[len(d) :].astype(basis.dtype)).astype(np.float64)
        u[self._body.supports.held] = self._constrained_at
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
        path = output_path(path, ".npz")
        TableFile.write_file(path, self._problem, self._table)
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
        path = arguments.path("path", path, "the path of an .npz file that save() wrote")
        checked_whole(body, "PrecomputedResponse.load(path, body)", "body")
        problem, table = TableFile.read_file(path)
        self = cls.__new__(cls)
        self._problem = _fingerprint(body, problem.method, table.nodes)
        self._problem.refuse_other(problem, path, "Load it with the body of which it was made, or compute it again.")
        with refusing_damage(path, TableFile.remedy):
            table.check(body.mesh.nv, body.mesh.d)
        self._set(body, table)
        return self

    def _set(self, body: System, table: ResponseTable) -> None:
        self._body, self._table, self._grid = body, table, DisplacementGrid(tuple(table.axes))
        self.axes, self.nodes, self.compression = self._grid.axes, table.nodes, table.compression
        self._constrained_at = body.supports.values(1.0)

    @property
    def body(self) -> System:
        """Body of the response."""
        return self._body

    @property
    def forces(self) -> Array:
        """Forces (n_1, ..., n_d, d) at each point of the grid [N]; zero at holes."""
        return self._table.values[..., : len(self.axes)]

    @property
    def rank(self) -> int:
        """Number of basis vectors of the displacements."""
        return int(self._table.basis.shape[1])

    @property
    def error(self) -> BetweenPoints:
        """Errors between the points of the grid."""
        return self._table.error

    @property
    def holes(self) -> dict[tuple[float, ...], str]:
        """Reasons for missing answers, by displacement of the handle, in order of the distance from rest."""
        near = sorted(map(int, self._table.holes), key=lambda k: (self._grid.steps(k), k))
        return {tuple(self._grid.point(k).tolist()): self._table.holes[str(k)] for k in near}

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self._grid.shape))
        holes = f", {len(self.holes)} of them holes" if self.holes else ""
        return (
            f"PrecomputedResponse: {len(self.nodes)} nodes at {shape} displacements{holes}; {self._body.ndofs} degrees of freedom "
            f"from {self.rank} vectors, which leave out {self.compression:.1g}; {self.error}"
        )

    def _measure(self, states: Mapping[int, HandleState]) -> None:
        """Add the errors of the answers between the points, from the states there."""
        middles = [(self._grid.point(k), state) for k, state in sorted(states.items()) if k >= len(self._grid)]
        good = [(at, state) for at, state in middles if not state.message]
        largest_u = max(np.abs(state.u).max() for state in states.values())
        largest_force, errors = np.linalg.norm(self.forces, axis=-1).max(), []
        for point, state in good:
            force, u = self(point)
            apart = np.linalg.norm((u - state.u).reshape(-1, len(point)), axis=1).max()
            errors.append((np.linalg.norm(force - state.force) / largest_force, apart / largest_u))
        of_force, of_u = np.array(errors).reshape(-1, 2).T
        points = np.array([at for at, _ in good]).reshape(-1, len(self.axes))
        lost = [f"{point_text(at)}: {state.message}" for at, state in middles if state.message]
        self._table = replace(self._table, error=BetweenPoints(points, of_force, of_u, lost))

    def _interpolated(self, d: Array) -> Array:
        """Return the force and the amounts of the vectors (d + rank,) at a displacement of the handle."""
        hole: int | None = None
        for most in (STENCIL, 2):
            stencil = [_weights(axis, value, "xyz"[c], most) for c, (axis, value) in enumerate(zip(self.axes, d, strict=True))]
            values = self._table.values[tuple(slice(begin, begin + len(weights)) for begin, weights in stencil)]
            hole = self._hole_in(stencil) if self._table.holes else None
            if hole is None:
                for _, weights in stencil:
                    values = np.tensordot(weights, values, axes=1)
                return values
        assert hole is not None
        at = f"{point_text(d)} is in a cell with the hole {point_text(self._grid.point(hole))}"
        raise StateError(f"displacement = {at}: {self._table.holes[str(hole)]}")

    def _hole_in(self, stencil: list[tuple[int, Array]]) -> int | None:
        """Return the number of a hole in the stencil, or None."""
        indices = (begin + np.flatnonzero(weights) for begin, weights in stencil)
        numbers = np.arange(len(self._grid)).reshape(self._grid.shape)[np.ix_(*indices)].ravel()
        return next((number for number in numbers.tolist() if str(number) in self._table.holes), None)

    def _warn(self, states: Mapping[int, HandleState]) -> None:
        """Warn of holes, and repeat warnings of the solves."""
        holes = self.holes
        if holes:
            named = ", ".join(point_text(at) for at in list(holes)[:3]) + (", ..." if len(holes) > 3 else "")
            count = f"{len(holes)} of {len(self._grid)} displacements"
            warn(f"No stable equilibrium at {count} ({named}): {next(iter(holes.values()))}")
        warned = [(k, state.warning) for k, state in sorted(states.items()) if state.warning]
        if warned:
            at = point_text(self._grid.point(warned[0][0]))
            warn(f"{len(warned)} of {len(states)} solves warned, the first of them at {at}: {warned[0][1]}")


def _solved(solves: HandleSolves, store: PointsCheckpoint | None, jobs: int, quiet: bool) -> Mapping[int, HandleState]:
    """Return all states of a grid and of midpoints."""
    grid, cores, done = solves.grid, threads(), len(store.stored) if store is not None else 0
    total = len(grid) + solves.checks
    jobs = max(1, min(jobs, cores, total))
    say(f"{len(grid)} displacements of the handle and {solves.checks} between them, {done} solved already", quiet)
    with CountedProgress("response", total, quiet, lines=True) as progress:
        try:
            for k, state, complete in solves.run(jobs, max(1, cores // jobs)):
                done += 1
                progress.step(point_text(grid.point(k)))
                if store is not None and complete:
                    store.add(k, state)
        except KeyboardInterrupt:
            where = "no checkpoint was requested" if store is None else f"they are in {store.folder}; the same call continues"
            progress.print(f"{done} of {total} solves are done: {where}")
            raise
    return solves.states


def _table_of(
    grid: DisplacementGrid, nodes: NDArray[np.int64], states: Mapping[int, HandleState], tolerance: float
) -> ResponseTable:
    """Return the table of the states at the points of the grid, without errors between them."""
    at_points = [states[k] for k in range(len(grid))]
    basis, amounts, compression = _compressed(np.array([state.u for state in at_points]), tolerance)
    basis = basis.astype(np.float32 if tolerance >= SINGLE else np.float64)
    values = np.concatenate([np.array([state.force for state in at_points]), amounts], axis=1).reshape(*grid.shape, -1)
    holes = {str(k): state.message for k, state in enumerate(at_points) if state.message}
    return ResponseTable(list(grid.axes), nodes, values, basis, holes, compression)


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
