"""MuJoCo: the passive force of a flex, which is an edge form summed element by element in C, and flexes in motion."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import StvkError
from .peer import require


class MuJoCo:
    """A flex of tetrahedra, each vertex a body of its own that slides along x, y and z; see `Peer`.

    MuJoCo's engine has the force only: its energy leaves flexes out, and its tangent keeps tensile tensions alone. The positions
    are handed to it as those of the bodies, without its kinematics, which would find the same ones from joint coordinates.
    """

    name = "MuJoCo"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None:
        self._engine = mujoco = require("MuJoCo")
        self.version: str = mujoco.__version__
        self._rest = np.ascontiguousarray(p.T, dtype=float)
        self._model = _model(mujoco, self._rest, t, young, poisson)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
        self._data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)  # the directions of the joints, which do not depend on the positions
        self._places = self._data.xpos[1:]

    def internal_force(self, u: Array) -> Array:
        np.add(self._rest, u.reshape(self._rest.shape), out=self._places)
        self._engine.mj_flex(self._model, self._data)
        self._engine.mj_passive(self._model, self._data)
        force: Array = -self._data.qfrc_spring
        return force


@dataclass(frozen=True)
class Moving:
    """How a flex moves.

    Parameters
    ----------
    masses : (nv,) of its vertices [kg].
    held : ids of vertices that do not move.
    gravity : (3,) [m/s^2].
    dt : time step [s].
    integrator : "discrete", MuJoCo's implicit one for flexes: one linear solve per step with `M + dt^2 K`, where K has tensile
        tensions alone; or "Euler", which is explicit.
    rtol, iterations : of the linear solve.
    """

    masses: Array
    held: NDArray[Any]
    gravity: tuple[float, float, float]
    dt: float
    integrator: str = "discrete"
    rtol: float = 1e-8
    iterations: int = 1000


class MuJoCoMotion:
    """A flex in motion, whose held vertices have no joints; parameters and errors as in `MuJoCo`."""

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, moving: Moving) -> None:
        self._engine = mujoco = require("MuJoCo")
        self.version: str = mujoco.__version__
        rest = np.ascontiguousarray(p.T, dtype=float)
        self._model = _model(mujoco, rest, t, young, poisson, moving)
        self._data = mujoco.MjData(self._model)
        self._free = np.setdiff1d(np.arange(len(rest)), moving.held)

    def begin(self, u: Array, v: Array) -> None:
        """Start from displacements [m] and velocities [m/s] (3 nv,); those of held vertices are left out."""
        self._data.qpos[:] = u.reshape(-1, 3)[self._free].ravel()
        self._data.qvel[:] = v.reshape(-1, 3)[self._free].ravel()

    def step(self) -> None:
        """Advance by one time step."""
        self._engine.mj_step(self._model, self._data)

    def displacements(self) -> Array:
        """Displacements (3 nv,) of the current state [m]."""
        u = np.zeros((self._model.nbody - 1, 3))
        u[self._free] = self._data.qpos.reshape(-1, 3)
        return u.ravel()

    def solved(self) -> bool:
        """Whether MuJoCo has not warned, as it does of a solve that ran out of iterations and of a state that is not finite."""
        return not any(warning.number for warning in self._data.warning)


def _model(mujoco: Any, rest: Array, t: NDArray[np.int32], young: float, poisson: float, moving: Moving | None = None) -> Any:
    """A flex whose vertices are bodies that slide along x, y and z; without a mass and inertia the engine takes a slower path."""
    if not 0 <= poisson < 0.5:
        raise StvkError(f"Expected a Poisson's ratio from 0 to below 1/2, as MuJoCo needs it; got {poisson}.")
    spec = mujoco.MjSpec()
    spec.memory = 2**20 + 256 * rest.size  # [B]; by itself it would take many times that
    masses, held = (np.ones(len(rest)), ()) if moving is None else (moving.masses, moving.held)
    is_held = np.isin(np.arange(len(rest)), held)
    for vertex, (place, mass) in enumerate(zip(rest, masses, strict=True)):
        inertia = [mass] * 3  # of a body that does not turn
        body = spec.worldbody.add_body(
            name=str(vertex), pos=place, mass=mass, inertia=inertia, ipos=[0, 0, 0], explicitinertial=True
        )
        for axis in () if is_held[vertex] else np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    names, elements = [str(vertex) for vertex in range(len(rest))], np.ascontiguousarray(t.T).ravel().tolist()
    without = {"contype": 0, "conaffinity": 0, "selfcollide": 0}
    spec.add_flex(name="body", dim=3, vertbody=names, elem=elements, young=young, poisson=poisson, **without)
    if moving is not None:
        spec.memory = 2**24 + 2**11 * rest.size
        spec.option.timestep, spec.option.gravity = moving.dt, moving.gravity
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{moving.integrator.upper()}")
        spec.option.tolerance, spec.option.iterations = moving.rtol, moving.iterations
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that nothing integrates the force implicitly
        model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    return model
