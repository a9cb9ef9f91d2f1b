"""MuJoCo on the same bar: cost of a step, and agreement of the motions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_stvk import System
from skfem_stvk.referee.peers import PEERS
from skfem_stvk.referee.peers.mujoco import compiled, flex
from skfem_stvk.referee.peers.peer import require
from skfem_stvk.solvers.dynamics import ForwardEuler

from ..statics.study import Study
from .scenes import Array
from .swing import GRAVITY, POISSON, REPEATS, RTOL, YOUNG, bar, clock, eq9, push, timed

#: Cells across the bar, and the largest relative difference of the motions.
COMPARED, QUICK_COMPARED, AGREE = (8, 12), (4,), 1e-2


@dataclass(frozen=True)
class Moving:
    """Parameters of the motion of a flex.

    Parameters
    ----------
    masses
        (nv,) masses of the vertices [kg].
    held
        Ids of constrained vertices.
    gravity
        (3,) acceleration [m/s^2].
    dt
        Time step [s].
    integrator
        "discrete", MuJoCo's implicit integrator for flexes, with one linear solve per step with `M + dt^2 K`, where K has only
        tensile tensions; or the explicit "Euler".
    rtol, iterations
        Tolerance and iteration limit of the linear solve.
    """

    masses: Array
    held: NDArray[Any]
    gravity: tuple[float, float, float]
    dt: float
    integrator: str = "discrete"
    rtol: float = 1e-8
    iterations: int = 1000


class MuJoCoMotion:
    """Flex in motion. Constrained vertices have no joints. Parameters and errors are those of `peers.mujoco.MuJoCo`."""

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, moving: Moving) -> None:
        self._engine = mujoco = require("MuJoCo")
        rest = np.ascontiguousarray(p.T, dtype=float)
        spec = flex(mujoco, rest, t, young, poisson, masses=moving.masses, held=moving.held)
        spec.memory = 2**24 + 2**11 * rest.size
        spec.option.timestep, spec.option.gravity = moving.dt, moving.gravity
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{moving.integrator.upper()}")
        spec.option.tolerance, spec.option.iterations = moving.rtol, moving.iterations
        self._model = compiled(mujoco, spec)
        self._data = mujoco.MjData(self._model)
        self._free = np.setdiff1d(np.arange(len(rest)), moving.held)

    def begin(self, u: Array, v: Array) -> None:
        """Start from displacements [m] and velocities [m/s] (3 nv,). Entries of constrained vertices are ignored."""
        self._data.qpos[:] = u.reshape(-1, 3)[self._free].ravel()
        self._data.qvel[:] = v.reshape(-1, 3)[self._free].ravel()

    def step(self) -> None:
        """Advance by one time step."""
        self._engine.mj_step(self._model, self._data)

    def displacements(self) -> Array:
        """Return the displacements (3 nv,) of the current state [m]."""
        u = np.zeros((self._model.nbody - 1, 3))
        u[self._free] = self._data.qpos.reshape(-1, 3)
        return u.ravel()

    def solved(self) -> bool:
        """Return whether MuJoCo has given no warning.

        MuJoCo warns if a solve ran out of iterations or the state is not finite.
        """
        return not any(warning.number for warning in self._data.warning)


def against_mujoco(quick: bool) -> Iterator[Study]:
    """Compare motion and time of the same bar with MuJoCo, if it is installed."""
    if PEERS["MuJoCo"].version() is None:
        return
    rows, failures = [], []
    for n in QUICK_COMPARED if quick else COMPARED:
        for name, ours, steps in (
            ("discrete", eq9(60), 12),
            ("discrete", eq9(1000), 60),
            ("Euler", ForwardEuler(dt=1e-4), 200),
        ):
            system, v, dt = bar(n), push(n), float(ours.dt or 0)
            found = timed(system, ours, v, steps * dt)
            theirs, u = _their_step(
                system, v, Moving(system.mass().vertex, _constrained_vertices(system), GRAVITY, dt, name, RTOL), steps
            )
            off = float(np.abs(u - found.run.u).max() / np.abs(u).max())
            rows.append(
                (
                    name,
                    f"{1e3 * dt:.3g}",
                    str(12 * n**3),
                    f"{1e3 * theirs:.2f}",
                    f"{1e3 * found.seconds:.2f}",
                    f"{theirs / found.seconds:.1f}",
                    f"{off:.1e}",
                )
            )
            if off > AGREE:
                failures.append(f"MuJoCo's {name}, {12 * n**3} tetrahedra, dt = {dt:g} s: motions differ by {off:.1e}")
    yield Study(
        "MuJoCo",
        f"the same motion to {AGREE:g}, after {', '.join(str(steps) for steps in (12, 60, 200))} steps",
        ("integrator", "dt, ms", "tetrahedra", "MuJoCo, ms", "ours, ms", "x", "motions differ by"),
        tuple(rows),
        tuple(failures),
        (
            "ms: time per step on one thread; 'discrete': MuJoCo's implicit integrator for flexes, eq. 9 with K clamped element "
            f"by element, rtol = {RTOL:g} on both sides; 'implicit' and 'implicitfast' refuse flexes since 4.0",
        ),
    )


def _their_step(system: System, v: Array, moving: Moving, steps: int) -> tuple[float, Array]:
    """Return MuJoCo's shortest time of a step [s], averaged over the motion, and the last displacements."""
    best = np.inf
    for _ in range(REPEATS):
        peer = MuJoCoMotion(system.mesh.p, system.mesh.t, YOUNG, POISSON, moving)
        peer.begin(0 * v, v)
        begin = clock()
        for _ in range(steps):
            peer.step()
        best = min(best, clock() - begin)
    return best / steps, peer.displacements()


def _constrained_vertices(system: System) -> Array:
    return np.unique(system.supports.held // 3)
