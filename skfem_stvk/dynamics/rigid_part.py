"""How much of a motion is rigid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..system import System
from ..system.mass import Mass
from ..system.rigid import motions

#: Singular values below this part of the largest are zero.
ZERO = 1e-10


def rigid_part(system: System, mass: Mass, u: Array, shapes: Array) -> Array:
    """(n,) `|P x|^2 / |x|^2` in M for motions x, the rows of `shapes` (n, ndofs).

    P projects on the rigid motions, at displacements `u` (ndofs,), of each part of the body that the supports allow.
    """
    mesh = system.mesh
    where = mesh.p.T + u.reshape(-1, mesh.d)
    part = system.parts()
    is_held = np.zeros(system.ndofs, dtype=bool)
    is_held[system.supports.held] = True
    found, all_of_it = np.zeros(len(shapes)), _products(mass, shapes, shapes)
    for own in np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1]):
        rigid = _allowed(where[own], is_held.reshape(-1, mesh.d)[own])
        padded = np.zeros((rigid.shape[1], mesh.nv, mesh.d))
        padded[:, own] = rigid.T.reshape(-1, len(own), mesh.d)
        for motion in _orthonormal(mass, padded.reshape(len(padded), system.ndofs)):
            found += (shapes @ mass.multiply(motion)) ** 2
    return found / all_of_it


def _allowed(x: Array, is_held: NDArray[np.bool_]) -> Array:
    """(dofs, m) rigid motions of vertices at `x` (nv, d) that leave in place what is held."""
    x = x - x.mean(axis=0)
    every = motions(x / (np.linalg.norm(x, axis=1).max() or 1.0)).reshape(x.size, -1)
    held = every[is_held.ravel()]
    if not len(held):
        return every
    _, values, right = np.linalg.svd(held, full_matrices=True)
    rank = int((values > ZERO * values.max()).sum())
    allowed: Array = every @ right[rank:].T
    return allowed


def _orthonormal(mass: Mass, vectors: Array) -> Array:
    """Rows that span the same, orthonormal in M."""
    if not len(vectors):
        return vectors
    values, c = np.linalg.eigh(vectors @ np.array([mass.multiply(v) for v in vectors]).T)
    kept = values > ZERO * values.max()
    basis: Array = (c[:, kept] / np.sqrt(values[kept])).T @ vectors
    return basis


def _products(mass: Mass, a: Array, b: Array) -> Array:
    return np.array([x @ mass.multiply(y) for x, y in zip(a, b, strict=True)])
