"""Displacements of the vertices of a mesh: flat for users, by vertex within."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import plain_array, shown
from ..errors import StateError, name_ids
from ..kernels import blocks as block_kernels
from .simplices import SimplexMesh


def by_vertex(mesh: SimplexMesh, u: ArrayLike, name: str = "u") -> NDArray[np.floating[Any]]:
    """`u` (ndofs,) as (nv, d), not copied if it is in double or single precision and contiguous.

    Raises
    ------
    StateError
        if it does not have one finite entry for each degree of freedom; messages call it by `name`.

    >>> by_vertex(SimplexMesh(p=[[0, 1], [0, 0]], t=[[0], [1]]), [1, 2, 3, 4])
    array([[1., 2.],
           [3., 4.]])
    """
    given = u if type(u) is np.ndarray else plain_array(u)
    if given is None or given.dtype.kind not in "fiu":
        what = f"is {shown(u)}" if given is None or not given.ndim else f"has dtype {given.dtype}"
        hint = ", without masked entries" if isinstance(u, np.ma.MaskedArray) else ""
        raise StateError(f"{name} {what}; expected real numbers, displacements in m{hint}.")
    u = np.ascontiguousarray(given, dtype=np.float32 if given.dtype == np.float32 else np.float64)
    if u.shape != (mesh.p.size,):
        raise StateError(
            f"{name} has shape {u.shape}; expected ({mesh.p.size},): {mesh.d} components at each of {mesh.nv} vertices, "
            "degree of freedom d * vertex + component. Is it of another mesh or of second order?"
        )
    if not all_finite(u):
        bad = np.flatnonzero(~np.isfinite(u))
        raise StateError(f"{name} is not finite in {name_ids(bad, 'entry')}: did the step before diverge?")
    return u.reshape(-1, mesh.d)


def all_finite(values: NDArray[np.floating[Any]]) -> bool:
    """Whether no entry is infinite or NaN: then their sum is finite, and only where that overflows every entry is looked at.

    >>> all_finite(np.array([1e308, 1e308])), all_finite(np.array([np.inf, -np.inf]))
    (True, False)
    """
    return bool(isfinite(block_kernels.total(values.reshape(-1))) or np.isfinite(values).all())
