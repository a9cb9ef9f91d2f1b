"""Displacements of the vertices or nodes of a mesh: checked vectors, one per degree of freedom, and the same by vertex."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, shown, vector
from ..errors import StateError, StvkError, name_ids
from ..kernels import node_blocks as block_kernels
from .mesh import ElementMesh


def by_vertex(mesh: ElementMesh, u: ArrayLike, name: str = "u") -> Array:
    """Return `u` (ndofs,) by vertex or node as (nv, d).

    `u` is not copied if it is in double or single precision and contiguous; otherwise it is converted as by `finite_vector`.

    >>> by_vertex(ElementMesh(p=[[0, 1], [0, 0]], t=[[0], [1]]), [1, 2, 3, 4])
    array([[1., 2.],
           [3., 4.]])
    """
    return finite_vector(name, u, mesh.p.size, f"degree of freedom d * {mesh.word} + component").reshape(-1, mesh.d)


def array_to_fill(mesh: ElementMesh, out: Array) -> Array:
    """Return a contiguous array of floats (ndofs,) as (nv, d) to write to; raise StvkError for any other object."""
    own = isinstance(out, np.ndarray) and not isinstance(out, np.ma.MaskedArray) and out.dtype.char in "df"
    if not own or out.shape != (mesh.p.size,) or not (out.flags.carray and out.dtype.isnative):
        raise StvkError(
            f"out = {shown(out)}; expected a contiguous, writable array of floats ({mesh.p.size},), such as np.zeros(system.ndofs)."
        )
    return out.reshape(-1, mesh.d)


def finite_vector(name: str, value: Any, n: int, each: str = "degree of freedom", *, kinds: str = "fiu") -> Array:
    """Return a vector of finite numbers as `arguments.vector` does; anything else raises StateError.

    >>> finite_vector("v", [0.0, np.nan, 1.0], 3)
    Traceback (most recent call last):
    skfem_stvk.errors.StateError: v is not finite in 1 entry (1): did the previous step diverge?
    """
    values = vector(name, value, n, each, kinds=kinds)
    if not all_finite(values):
        raise StateError(
            f"{name} is not finite in {name_ids(np.flatnonzero(~np.isfinite(values)), 'entry')}: did the previous step diverge?"
        )
    return values


def all_finite(values: Array) -> bool:
    """Return whether no entry is infinite or NaN.

    A finite sum proves this. If the sum is not finite, which may be overflow, every entry is checked.

    >>> all_finite(np.array([1e308, 1e308])), all_finite(np.array([np.inf, -np.inf]))
    (True, False)
    """
    flat = values.reshape(-1) if values.dtype.kind == "f" else values.reshape(-1).view(values.real.dtype)
    return bool(isfinite(block_kernels.total(flat)) or np.isfinite(values).all())
