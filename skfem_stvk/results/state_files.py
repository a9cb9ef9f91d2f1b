"""Displacements and velocities from files that this package wrote, to begin with."""

from __future__ import annotations

import os

import meshio
import numpy as np

from ..arguments import Array
from ..arguments import path as checked_path
from ..errors import StvkError
from ..mesh import ElementMesh
from .series import read_list


def read_state(path: str | os.PathLike[str], mesh: ElementMesh, time: float | None = None) -> tuple[Array, Array | None]:
    """Displacements and, if there are any, velocities (ndofs,) in a .vtu file, or in the last (or that of a time) of a .pvd file.

    StvkError if there is no such state, or it is of another mesh.
    """
    file = checked_path("path", path, "the path of a .vtu or .pvd file")
    if file.suffix == ".pvd":
        states = read_list(file)
        if not states:
            raise StvkError(f"{file} lists no states.")
        at = states[-1][0] if time is None else time
        found = min(states, key=lambda one: abs(one[0] - at))
        if time is not None and abs(found[0] - time) > 1e-9 * max(abs(time), 1e-300):
            raise StvkError(f"{file} has no state at {time:g}; the nearest is at {found[0]:g}.")
        file = file.with_name(found[1])
    data = meshio.read(file)
    d = mesh.d
    if data.points.shape[0] != mesh.nv or np.abs(data.points[:, :d] - mesh.p.T).max() > 1e-9 * np.abs(mesh.p).max():
        raise StvkError(f"{file} has {len(data.points)} nodes of another mesh; this one has {mesh.nv}.")
    u, v = (data.point_data.get(name) for name in ("displacement", "velocity"))
    if u is None:
        raise StvkError(f"{file} has no displacements.")
    return np.ascontiguousarray(u[:, :d]).ravel(), None if v is None else np.ascontiguousarray(v[:, :d]).ravel()
