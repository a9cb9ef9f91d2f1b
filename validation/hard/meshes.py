"""Meshes of the hard cases: boxes with inner vertices moved at random, elements of both orientations, and deliberate flaws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import skfem
from numpy.typing import NDArray

from skfem_stvk import ElementMesh

from ..meshes import dihedral_angles
from .case import Array


def box(lines: Sequence[Array], amount: float = 0.2, seed: int = 1) -> ElementMesh:
    """Return a box of cells between these coordinates, with elements of both orientations.

    Inner vertices are moved at random by up to `amount` of a cell.
    """
    mesh, rng = skfem.MeshTet.init_tensor(*lines), np.random.default_rng(seed)
    p = mesh.p.copy()
    for x, line in zip(p, lines, strict=True):
        inner = (x > line[0]) & (x < line[-1])
        cell = np.gradient(line)[np.searchsorted(line, x)]
        x += amount * cell * inner * rng.uniform(-1, 1, len(x))
    on_face = np.array([(mesh.p[i] == line[j]) for i, line in enumerate(lines) for j in (0, -1)]).any(axis=0)
    p[:, on_face] = mesh.p[:, on_face]
    return of_both_orientations(ElementMesh(p, mesh.t))


def bar(length: float = 3.0, n: int = 3, **options: float) -> ElementMesh:
    """Return a bar along x with cross-section 1 x 1 and cells of size 1/n."""
    across = np.linspace(0, 1, n + 1)
    return box([np.linspace(0, length, round(length * n) + 1), across, across], **options)  # type: ignore[arg-type]


def cube(n: int = 6) -> ElementMesh:
    """Return the unit cube of (n + 1)^3 nodes as scikit-fem makes it."""
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return ElementMesh(mesh.p, mesh.t)


def of_both_orientations(mesh: ElementMesh, seed: int = 0) -> ElementMesh:
    """Return the mesh with two vertices exchanged in about half of its elements."""
    t = mesh.t.copy()
    half = np.random.default_rng(seed).random(mesh.nt) < 0.5
    t[:2, half] = t[1::-1, half]
    return ElementMesh(mesh.p, t)


def with_slivers(mesh: ElementMesh, degrees: float, share: float = 0.3, seed: int = 2) -> ElementMesh:
    """Move inner vertices until an element at each has a dihedral angle of `degrees`; return the mesh.

    No two moved vertices share an element.
    """
    rng, p = np.random.default_rng(seed), mesh.p.copy()
    low, high = p.min(axis=1, keepdims=True), p.max(axis=1, keepdims=True)
    inner = np.flatnonzero(((p > low) & (p < high)).all(axis=0))
    rng.shuffle(inner)
    taken = np.zeros(mesh.nv, dtype=bool)
    for vertex in inner[: max(1, round(share * len(inner)))]:
        around = mesh.t[:, (mesh.t == vertex).any(axis=0)]
        if not taken[around].any():
            taken[around] = True
            direction = rng.standard_normal(3)
            p[:, vertex] = _pushed(p, around, vertex, direction / np.linalg.norm(direction), degrees)
    return ElementMesh(p, mesh.t)


def _pushed(p: Array, around: NDArray[np.int32], vertex: int, direction: Array, degrees: float) -> Array:
    """Return the farthest position of the vertex along `direction`, by bisection, without an angle below `degrees`."""
    start, low, high = p[:, vertex].copy(), 0.0, 2 * float(np.ptp(p[:, around], axis=1).max())
    signs = np.sign(_volumes(p, around))
    for _ in range(60):
        middle = (low + high) / 2
        moved = p.copy()
        moved[:, vertex] = start + middle * direction
        flat = (np.sign(_volumes(moved, around)) != signs).any() or _smallest_angle(moved, around) < degrees
        low, high = (low, middle) if flat else (middle, high)
    return np.asarray(start + low * direction)


def _volumes(p: Array, t: NDArray[np.int32]) -> Array:
    x = p.T[t.T]
    return np.asarray(np.linalg.det(x[:, 1:] - x[:, :1]))


def _smallest_angle(p: Array, t: NDArray[np.int32]) -> float:
    """Return the smallest dihedral angle [degrees]."""
    used, local = np.unique(t, return_inverse=True)
    return float(dihedral_angles(ElementMesh(p[:, used], local.reshape(t.shape).astype(np.int32))).min())


def graded(layers: int = 5, factor: float = 11.0) -> ElementMesh:
    """Return the unit cube in layers around one corner, each layer `factor` times as thick as the inner one."""
    mesh = skfem.MeshTet.init_tensor(*[np.arange(layers + 1.0)] * 3)
    layer = mesh.p.max(axis=0)
    size = np.where(layer > 0, factor ** (layer - layers), 0)
    return of_both_orientations(ElementMesh(mesh.p * size / np.maximum(layer, 1), mesh.t))
