"""Response of the laws at points of elements: their formulas are those of the kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ...arguments import Array
from ...edges.elements import Frames
from ...edges.materials import Hypothesis, Isotropic
from ...edges.stiffness import IsotropicStiffness, LawInFrames, flat_of
from ...edges.topology import in_lanes
from ...kernels import fields_at_points as point_kernels
from ..term import Deformation, PointResponse

#: A smaller stretch counts as zero.
FLAT = 1e-9


def stress_and_density(stiffness: LawInFrames, at: Deformation) -> tuple[Array, Array]:
    """Return the stress (n, 3, 3) [Pa] and the energy density (n,) of a law that is a function of strain (`response_to_strain`)."""
    M, (n, _, k) = 2 * embedded(at.strain), at.gradient.shape
    S, W = np.empty((n, 3, 3)), np.empty(n)
    point_kernels.stress_by_strain(_at_points(stiffness, k, n), k, M, W, S)
    return S, W


def response_of_stretches(at: Deformation, material: Isotropic, kind: Callable[..., Any], *, green: bool = False) -> PointResponse:
    """Return the response of a law of principal stretches: `S = V diag(p/s) V'`, infinite where a stretch vanishes.

    `kind` makes the law from its numbers and `flat`. In plane stress, the strain across the elements is that of Hooke's law of the
    `material` between elongations or, if `green`, between Green-Lagrange strains.
    """
    n, d, k = at.gradient.shape
    lam, mu = (np.broadcast_to(value, n) for value in material.lame(at.hypothesis))
    flat = flat_of(k, d)
    law = IsotropicStiffness(lam, mu, partial(kind, flat=None if at.hypothesis is Hypothesis.PLANE_STRAIN else flat))
    Q, h, V = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.empty((n, 3, 3))
    p, W = np.empty((n, 3)), np.empty(n)
    e: Array = np.empty((n, 3))
    Q[:, :k, :d], h[:, :k, :d] = np.swapaxes(at.axes, 1, 2), np.swapaxes(at.gradient, 1, 2)
    point_kernels.response_to_stretches(_at_points(law, k, n), flat, Q, h, W, e, p, V)
    none = np.abs(1 + e) < FLAT
    infinite = none.any(axis=1)
    pull = np.where(infinite[:, None], 0, p / np.where(none, 1, 1 + e))
    strain = embedded(at.strain)
    if at.hypothesis.condensed:
        within = np.trace(at.strain, axis1=1, axis2=2) if green else e.sum(axis=1)
        across = material.strain_across((k * lam + 2 * mu) * within)[:, None, None] * np.eye(3 - k)
        strain[:, k:, k:] = across if green else green_strain_of(across)
    return PointResponse(strain, (V * pull[:, None]) @ np.swapaxes(V, 1, 2), W, infinite)


def embedded(tensor: Array) -> Array:
    """Return the tensors (n, k, k) within elements as new tensors (n, 3, 3), zero across."""
    solid = np.zeros((len(tensor), 3, 3))
    solid[:, : tensor.shape[1], : tensor.shape[2]] = tensor
    return solid


def green_strain_of(e: Array) -> Array:
    """Return the Green-Lagrange strains `e + e e/2` of elongations `U - I` (n, m, m); -1/2 where no positive stretch is left."""
    values, axes = np.linalg.eigh(e)
    values = np.maximum(values, -1.0)
    return np.asarray((axes * (values * (1 + values / 2))[:, None]) @ np.swapaxes(axes, 1, 2))


def _at_points(stiffness: LawInFrames, k: int, n: int) -> Any:
    """Return the law of the kernels with its numbers at n points, per unit of rest volume, in the axes of the elements."""
    Ri = np.repeat(np.array([1.0, 0.0, 0.0, k > 1, 0.0, k > 2])[:, None], n, axis=1)
    frames = Frames(k, np.broadcast_to(np.eye(k), (n, k, k)), Ri, np.ones(n), None)
    return stiffness.law(in_lanes(np.concatenate([Ri, stiffness.stored(frames, np.arange(n, dtype=np.int32))])).ravel())
