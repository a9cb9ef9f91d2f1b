"""MuJoCo: the passive force of a flex, an edge form summed element by element in C."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkError
from .packages import require
from .peer import Array


class MuJoCo:
    """A flex of tetrahedra, each vertex a body of its own that slides along x, y and z; see `Peer`.

    MuJoCo's engine has the force only: its energy leaves flexes out, and its tangent keeps tensile tensions alone. The positions
    are handed to it as those of the bodies, without its kinematics, which would find the same ones from joint coordinates.
    """

    name = "MuJoCo"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None:
        self._engine = mujoco = require("mujoco")
        self.version: str = mujoco.__version__
        if not 0 <= poisson < 0.5:
            raise StvkError(f"Poisson's ratio {poisson} came; MuJoCo takes those from 0 up to, but not, 1/2.")
        self._rest = np.ascontiguousarray(p.T, dtype=float)
        spec = mujoco.MjSpec()
        spec.memory = 2**20 + 256 * p.size  # [B]; by itself it would take many times that
        slide, axes = mujoco.mjtJoint.mjJNT_SLIDE, np.eye(3)
        for vertex, place in enumerate(self._rest):
            # of some mass, about its own place: else the engine takes a slower path
            body = spec.worldbody.add_body(
                name=str(vertex), pos=place, mass=1.0, inertia=[1, 1, 1], ipos=[0, 0, 0], explicitinertial=True
            )
            for axis in axes:
                body.add_joint(type=slide, axis=axis)
        spec.add_flex(
            name="body",
            dim=3,
            vertbody=[str(vertex) for vertex in range(p.shape[1])],
            elem=np.ascontiguousarray(t.T).ravel().tolist(),
            young=young,
            poisson=poisson,
            contype=0,
            conaffinity=0,
            selfcollide=0,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that nothing integrates the force implicitly
            self._model = spec.compile()
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_GRAVITY
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
