"""Cantilever as a competent user of FElupe writes it: `SolidBody`, `PointLoad`, and a `Job` of equal load steps."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import skfem

from skfem_stvk.referee.peers.felupe import FElupe
from skfem_stvk.referee.peers.peer import require

from .cantilever import POISSON, RTOL, TENTHS, TRACTION, YOUNG, Array, Run, end_centre, timed
from .with_scikit_fem import LinearSolver


def solve(mesh: skfem.MeshTet, linear: LinearSolver, factors: Array = TENTHS, most: int = 1000) -> Run:
    """Solve with FElupe's Newton method and the law of the benchmark's peer.

    `most` limits the iterations of runs that are only timed.
    """
    felupe = require("FElupe")
    seconds: dict[str, float] = {}
    with timed(seconds, "other"):
        solid, field = _body(mesh)
        wall = felupe.Boundary(field[0], fx=0.0)
        load = felupe.PointLoad(field, np.arange(mesh.nvertices))
        ramp = {load: np.asarray(factors)[:, None, None] * nodal_forces(mesh)}
        step = felupe.Step([solid, load], ramp=ramp, boundaries={"wall": wall})
        solver = _Counted(linear, most)
        with suppress(_IterationLimitError):
            felupe.Job([step]).evaluate(tol=RTOL, solver=solver, verbose=0, kwargs={"parallel": True})
    seconds["solve"] = solver.seconds["solve"]
    seconds["other"] -= seconds["solve"]
    return Run("FElupe P1", mesh.p.size, field[0].values[end_centre(mesh)], solver.count, seconds)


def _body(mesh: skfem.MeshTet) -> tuple[Any, Any]:
    """Return the solid body and its field."""
    peer = FElupe(mesh.p, mesh.t, YOUNG, POISSON)
    return peer._solid, peer._field


class _IterationLimitError(Exception):
    """End of the iterations at the requested number."""


class _Counted:
    """Linear solver that counts and times its calls."""

    def __init__(self, linear: LinearSolver, most: int) -> None:
        self.linear, self.most, self.count = linear, most, 0
        self.seconds: dict[str, float] = {}

    def __call__(self, K: Any, b: Array) -> Array:
        if self.count == self.most:
            raise _IterationLimitError
        self.count += 1
        with timed(self.seconds, "solve"):
            return self.linear(K, b)


def nodal_forces(mesh: skfem.MeshTet) -> Array:
    """Return the nodal forces of the traction [N], (nv, 3): a third of each facet's force on each of its corners."""
    facets = mesh.facets[:, mesh.boundaries["tip"]]
    a, b, c = (mesh.p[:, corner].T for corner in facets)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    forces = np.zeros((mesh.nvertices, 3))
    for corner in facets:
        np.add.at(forces, corner, areas[:, None] / 3 * np.array(TRACTION))
    return forces
