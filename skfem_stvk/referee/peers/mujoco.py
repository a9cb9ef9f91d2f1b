"""MuJoCo, with the passive force of a flex, an edge form that is summed element by element in C."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array
from ...errors import StvkError
from . import require


class MuJoCo:
    """Peer with a flex of tetrahedra. Each vertex is a body that slides along x, y and z. See `Peer`.

    This peer has the force only, because MuJoCo's energy omits flexes, and its tangent has only the tensile tensions. The positions
    are written to those of the bodies directly. MuJoCo's kinematics would compute the same positions from joint coordinates.
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
    """Return a model with a flex whose vertices are bodies that slide along x, y and z. Vertices in `held` are fixed.

    `masses` are the masses of the vertices, by default 1 kg. Without mass and inertia the engine uses a slower path. Raise
    StvkError if Poisson's ratio is not from 0 to below 1/2.
    """
    if not 0 <= poisson < 0.5:
        raise StvkError(f"Expected a Poisson's ratio from 0 to below 1/2, as MuJoCo needs it; got {poisson}.")
    spec = mujoco.MjSpec()
    spec.memory = 2**20 + 256 * rest.size  # [B]; the default is many times larger
    is_held = np.isin(np.arange(len(rest)), held)
    for vertex, (place, mass) in enumerate(zip(rest, np.ones(len(rest)) if masses is None else masses, strict=True)):
        inertia = {"mass": mass, "inertia": [mass] * 3, "ipos": [0, 0, 0], "explicitinertial": True}  # the body does not rotate
        body = spec.worldbody.add_body(name=str(vertex), pos=place, **inertia)
        for axis in () if is_held[vertex] else np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    names, elements = [str(vertex) for vertex in range(len(rest))], np.ascontiguousarray(t.T).ravel().tolist()
    without = {"contype": 0, "conaffinity": 0, "selfcollide": 0}
    spec.add_flex(name="body", dim=3, vertbody=names, elem=elements, young=young, poisson=poisson, **without)
    return spec


def compiled(mujoco: Any, spec: Any) -> Any:
    """Return the compiled model, without MuJoCo's warning that the force is not integrated implicitly."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
    return model
