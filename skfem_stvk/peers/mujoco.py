"""MuJoCo: the passive force of a flex, which is an edge form summed element by element in C."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import Array
from ..errors import StvkError
from .peer import require


class MuJoCo:
    """A flex of tetrahedra, each vertex a body of its own that slides along x, y and z; see `Peer`.

    MuJoCo's engine has the force only: its energy leaves flexes out, and its tangent keeps tensile tensions alone. The positions
    are handed to it as those of the bodies, without its kinematics, which would find the same ones from joint coordinates.
    """

    name = "MuJoCo"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float, *, any_version: bool = False) -> None:
        self._engine = mujoco = require("MuJoCo", any_version)
        self.version: str = mujoco.__version__
        self._rest = np.ascontiguousarray(p.T, dtype=float)
        self._model = compiled(mujoco, flex(mujoco, self._rest, t, young, poisson))
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


def flex(
    mujoco: Any, rest: Array, t: NDArray[np.int32], young: float, poisson: float, *, masses: Any = None, held: ArrayLike = ()
) -> Any:
    """A flex whose vertices are bodies that slide along x, y and z, but for those that are held.

    Without a mass and inertia the engine takes a slower path; it is 1 kg by default.
    """
    if not 0 <= poisson < 0.5:
        raise StvkError(f"Expected a Poisson's ratio from 0 to below 1/2, as MuJoCo needs it; got {poisson}.")
    spec = mujoco.MjSpec()
    spec.memory = 2**20 + 256 * rest.size  # [B]; by itself it would take many times that
    is_held = np.isin(np.arange(len(rest)), held)
    for vertex, (place, mass) in enumerate(zip(rest, np.ones(len(rest)) if masses is None else masses, strict=True)):
        inertia = {"mass": mass, "inertia": [mass] * 3, "ipos": [0, 0, 0], "explicitinertial": True}  # it does not turn
        body = spec.worldbody.add_body(name=str(vertex), pos=place, **inertia)
        for axis in () if is_held[vertex] else np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    names, elements = [str(vertex) for vertex in range(len(rest))], np.ascontiguousarray(t.T).ravel().tolist()
    without = {"contype": 0, "conaffinity": 0, "selfcollide": 0}
    spec.add_flex(name="body", dim=3, vertbody=names, elem=elements, young=young, poisson=poisson, **without)
    return spec


def compiled(mujoco: Any, spec: Any) -> Any:
    """The compiled model, without the warning that nothing integrates the force implicitly."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    return model
