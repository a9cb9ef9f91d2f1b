"""The stiffness of simplices, as the coefficients L of their edges and as the kernels store it, by their spokes.

For edges `(a, b)` and `(c, d)` of a simplex of volume `V` with gradients `g_a` of its barycentric coordinates:

    isotropic    L = V [ lam/2 G_ab G_cd + mu/2 (G_ac G_bd + G_ad G_bc) ],    G_ab = g_a . g_b
    general      L = 2 V M_ab : C : M_cd,    M_ab = -1/4 (g_a (x) g_b + g_b (x) g_a),    E = sum zeta_ab M_ab

Source: Kikuuwe, Tabuchi, Yamamoto (2009) (isotropic tetrahedra); Delingette (2008) (isotropic triangles).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..elements.element import LOCAL_EDGES
from ..errors import MaterialError, name_ids
from ..kernels.geometry import scaled_gram
from ..materials import FramedMaterial, Hypothesis, Isotropic, Material
from ..mesh.geometry import Geometry

#: Components of a symmetric tensor in one, two and three dimensions: the Voigt order of the package.
VOIGT = {1: ((0, 0),), 2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}
#: Pairs of spokes: the order of the strains `M_ij` and tensions `S_ij` of the kernels.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Stiffness(Protocol):
    """The stiffness of simplices with vertices `t` (k + 1, n)."""

    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        """(n, m, m) `L` of each simplex, for the pairs of its edges [J/m^4]."""

    def stored(self, p: Array, t: NDArray[np.int32], elements: NDArray[np.int32], local: NDArray[np.int64]) -> Array:
        """(7 or 21, n) what the kernels store of these `elements` with vertices `t` (k + 1, n), which were their `local` ones."""


class IsotropicStiffness:
    """Lame constants times section, (n,) each: those that act within the simplices' own dimensions."""

    def __init__(self, lam: Array, mu: Array) -> None:
        self.lam, self.mu = lam, mu

    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        return isotropic_coefficients(Geometry(p, t), self.lam, self.mu)

    def stored(self, p: Array, t: NDArray[np.int32], elements: NDArray[np.int32], local: NDArray[np.int64]) -> Array:
        """`g_ij = sqrt(V mu) G_ij` of the spokes and `r = lam / (2 mu)`; zero for the spokes that a triangle or segment lacks."""
        lam, mu = self.lam[elements], self.mu[elements]
        if len(t) == 2:  # one strain: lam + 2 mu is all there is, and mu may be zero
            lam, mu = 0 * lam, mu + lam / 2
        return np.concatenate([scaled_gram(p, t, mu), [lam / (2 * mu)]])


class GeneralStiffness:
    """Any coefficients `L` (n, m, m) of the edges of each simplex, symmetric; computed when they are needed, for they are large."""

    def __init__(self, compute: Callable[[], Array]) -> None:
        self._compute = compute

    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        return self._compute()

    def stored(self, p: Array, t: NDArray[np.int32], elements: NDArray[np.int32], local: NDArray[np.int64]) -> Array:
        """The upper half of `D`: with `zeta = Q M`, `W = 1/4 zeta' L zeta` is `1/4 M' (Q' L Q) M`."""
        k = len(t) - 1
        edges = np.array(LOCAL_EDGES[k])
        number = np.zeros((k + 1, k + 1), dtype=np.int64)
        number[edges[:, 0], edges[:, 1]] = number[edges[:, 1], edges[:, 0]] = np.arange(len(edges))
        own = number[local[edges[:, 0]], local[edges[:, 1]]].T  # (n, m) the edges in their old order
        L = self._compute()[elements[:, None, None], own[:, :, None], own[:, None, :]]
        Q = elongations_of_pairs(k)
        D = np.swapaxes(Q, 0, 1) @ L @ Q
        rows, columns = np.triu_indices(6)
        return np.ascontiguousarray(D[:, rows, columns].T)


def in_range(stored: Array, elements: NDArray[np.int32], dtype: DTypeLike) -> Array:
    """What the kernels store, if its squares, and a little more, are numbers: else W, F and K would be zero, or overflow."""
    limits = np.finfo(dtype)
    low, high = 1e4 * float(np.sqrt(limits.tiny)), 1e-4 * float(np.sqrt(limits.max))
    largest = np.abs(stored).max(axis=0)
    bad = np.sort(elements[~((largest > low) & (largest < high))])
    if len(bad):
        raise MaterialError(
            f"{name_ids(bad, 'element')} of the region: sizes and moduli so small or large that the stiffness leaves the range of "
            f"{limits.dtype}. Are units mixed up? Choose others, such as mm and MPa."
        )
    return stored


def elongations_of_pairs(k: int) -> Array:
    """(m, 6) `Q` with `zeta = Q M`, `M` in both orders of each pair: `zeta_0i = M_ii`, `zeta_ij = M_ii + M_jj - M_ij - M_ji`."""
    Q = np.zeros((len(LOCAL_EDGES[k]), len(PAIRS)))
    for edge, (a, b) in enumerate(LOCAL_EDGES[k]):
        for column, (i, j) in enumerate(PAIRS):
            # M_ij belongs to the vertices i + 1 and j + 1; each off-diagonal one counts half for ij and half for ji
            ends = [int(v == i + 1) for v in (a, b)], [int(v == j + 1) for v in (a, b)]
            Q[edge, column] = (ends[0][1] - ends[0][0]) * (ends[1][1] - ends[1][0])
    return Q


def simplex_coefficients(geometry: Geometry, material: Material, hypothesis: Hypothesis) -> Array:
    """(nt, m, m) coefficients per unit of section [Pa m^(k-4)], symmetric and positive semi-definite."""
    if isinstance(material, Isotropic):
        return isotropic_coefficients(geometry, *material.lame(hypothesis))
    if not isinstance(material, FramedMaterial):
        name = type(material).__name__
        raise MaterialError(f"{name} is neither Isotropic nor a FramedMaterial, which has a stiffness() in its frame.")
    return general_coefficients(geometry, material, hypothesis)


def isotropic_coefficients(geometry: Geometry, lam: Array, mu: Array) -> Array:
    """(nt, m, m) from the Gram matrix; `lam` and `mu` are those that act within the simplex's own dimensions."""
    G = geometry.gram
    a, b = np.array(LOCAL_EDGES[G.shape[1] - 1]).T
    edge = G[:, a, b]
    volumetric = edge[:, :, None] * edge[:, None, :]
    deviatoric = G[:, a[:, None], a] * G[:, b[:, None], b] + G[:, a[:, None], b] * G[:, b[:, None], a]
    lam, mu = np.asarray(lam)[..., None, None], np.asarray(mu)[..., None, None]
    return geometry.volume[:, None, None] / 2 * (lam * volumetric + mu * deviatoric)


def general_coefficients(geometry: Geometry, material: FramedMaterial, hypothesis: Hypothesis) -> Array:
    """(nt, m, m) from the elasticity tensor, in material axes or, if stresses across vanish, in the simplex's own."""
    a, b = np.array(LOCAL_EDGES[geometry.gradients.shape[1] - 1]).T
    axes = _in_material_axes(geometry.axes, material)  # (nt, 3, k)
    C, g = material.stiffness(), geometry.gradients
    if hypothesis.condensed:
        C = _condensed(C, axes)
    else:
        g = g @ np.swapaxes(axes, 1, 2)  # (nt, k + 1, 3)
    M = -0.25 * (g[:, a, :, None] * g[:, b, None, :] + g[:, b, :, None] * g[:, a, None, :])
    strain = _voigt(M, shear=2.0)  # (nt, m, s)
    return 2 * geometry.volume[:, None, None] * (strain @ C @ np.swapaxes(strain, 1, 2))


def _in_material_axes(axes: Array, material: FramedMaterial) -> Array:
    """The simplices' own axes (nt, d, k) as columns (nt, 3, k) in material axes."""
    solid = np.zeros((axes.shape[0], 3, axes.shape[2]))
    solid[:, : axes.shape[1]] = axes
    return solid if material.frame is None else np.swapaxes(np.asarray(material.frame), -1, -2) @ solid


def _condensed(C: Array, axes: Array) -> Array:
    """(nt, s, s) stiffness within the simplices when the stress across them vanishes.

    The compliance acts on what stress there is: `C_own = (N' C^-1 N)^-1` with `N` the simplex's own stresses in material axes.
    """
    pairs = np.array(VOIGT[axes.shape[2]]).T
    first, second = np.swapaxes(axes[:, :, pairs[0]], 1, 2), np.swapaxes(axes[:, :, pairs[1]], 1, 2)  # (nt, s, 3)
    dyads = first[..., :, None] * second[..., None, :]
    off_diagonal = (pairs[0] != pairs[1])[:, None, None]
    N = _voigt(dyads + off_diagonal * np.swapaxes(dyads, -1, -2), shear=1.0)  # (nt, s, 6)
    return np.asarray(np.linalg.inv(N @ np.linalg.inv(C) @ np.swapaxes(N, 1, 2)))


def _voigt(tensor: Array, shear: float) -> Array:
    """Symmetric tensors (..., n, n) as Voigt vectors; `shear` is 2 for strains and 1 for stresses."""
    i, j = np.array(VOIGT[tensor.shape[-1]]).T
    return tensor[..., i, j] * np.where(i == j, 1.0, shear)
