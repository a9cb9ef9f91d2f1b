"""Stiffness of elements: the coefficients L of the edges of linear simplices, and the stored numbers of the kernels' laws.

For edges `(a, b)` and `(c, d)` of a simplex of volume `V` with gradients `g_a` of its barycentric coordinates:

    isotropic    L = V [ lam/2 G_ab G_cd + mu/2 (G_ac G_bd + G_ad G_bc) ],    G_ab = g_a . g_b
    general      L = 2 V M_ab : C : M_cd,    M_ab = -1/4 (g_a (x) g_b + g_b (x) g_a),    E = sum zeta_ab M_ab

Source: Kikuuwe, Tabuchi, Yamamoto (2009) (isotropic tetrahedra); Delingette (2008) (isotropic triangles).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..arguments import Array
from ..errors import MaterialError, name_ids
from ..kernels.corotated_law import FramedLaw
from ..kernels.st_venant_kirchhoff import GeneralLaw, IsotropicLaw
from ..kernels.svd import CABLE, LINE, MEMBRANE, SHEET, Flat
from ..mesh.element import LOCAL_EDGES
from ..mesh.geometry import Geometry
from .elements import Frames, Quadrature, frames_at
from .materials import FramedMaterial, Hypothesis
from .topology import KernelOrder

#: Components of a symmetric tensor in one, two and three dimensions: the Voigt order of the package.
VOIGT = {1: ((0, 0),), 2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}
#: Kinds of elements of fewer than three dimensions, by their dimension and whether their space has more.
FLAT = {(1, False): LINE, (1, True): CABLE, (2, False): SHEET, (2, True): MEMBRANE}
#: The order of the strains `M_ij` and stresses `S_ij` of the kernels.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class StoredLaw(ABC):
    """Law on elements, as assembly sees it.

    Attributes
    ----------
    law
        The law of the kernels, made of its numbers `D`; its type selects the formulas of the kernels.
    infinite_energy
        End of messages about inverted or flat elements: the energy that is infinite there, and the remedy; "" without one.
    """

    law: Any
    infinite_energy: str = ""

    @abstractmethod
    def numbers(self, p: Array, quadrature: Quadrature, order: KernelOrder, dtype: DTypeLike) -> Array:
        """Return the numbers (m, nq, nt) that the kernels read at the points of elements in their own order, in double."""


class LawInFrames(StoredLaw):
    """Law on elements with formulas in frames at their points.

    Attributes
    ----------
    moduli
        Number of stored numbers that are moduli times a size; these come first, and must not over- or underflow.
    """

    moduli: int

    @abstractmethod
    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """Return the law's stored numbers (m, n), other than `Ri`, of these `elements` in their frames, per unit of the points'
        weights.
        """

    def numbers(self, p: Array, quadrature: Quadrature, order: KernelOrder, dtype: DTypeLike) -> Array:
        found = []
        for frames in frames_at(p, order.vertices[order.t], quadrature, order):
            numbers = self.stored(frames, order.elements)
            check_range(numbers[: self.moduli], frames, order.elements, dtype)
            found.append(np.concatenate([frames.Ri, numbers]))
        return np.stack(found, axis=1)


class Stiffness(LawInFrames):
    """The stiffness of elements for St. Venant-Kirchhoff's law: on linear simplices, an edge form."""

    @abstractmethod
    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        """Return `L` (n, m, m) of linear simplices with vertices `t` (k + 1, n), for the pairs of their edges [J/m^4]."""


class IsotropicStiffness(Stiffness):
    """Lame constants times section, (n,) each, within the elements' own dimensions.

    `law` makes the law of the kernels from these two numbers: St. Venant-Kirchhoff's or another one. Only St. Venant-Kirchhoff's
    has coefficients.
    """

    moduli = 2

    def __init__(self, lam: Array, mu: Array, law: Callable[[Any], Any] = IsotropicLaw) -> None:
        self.lam, self.mu, self.law = lam, mu, law

    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        return isotropic_coefficients(Geometry(p, t), self.lam, self.mu)

    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """Return `lam/2` and `mu` times the size."""
        lam, mu = self.lam[elements], self.mu[elements]
        if at.k == 1:  # with one strain only lam + 2 mu counts, and mu may be zero
            lam, mu = 0 * lam, mu + lam / 2
        return np.stack([at.size * lam / 2, at.size * mu])


def flat_of(k: int, d: int) -> Flat | None:
    """Return the kind of elements of dimension `k` in `d` dimensions for laws of principal stretches; None for solids."""
    return None if k == 3 else Flat(FLAT[k, k < d])


class FramedStiffness(IsotropicStiffness):
    """Lame constants as in `IsotropicStiffness`, and a rotation for each element, at first the identity.

    `frames` returns checked rotations (nt, 3, 3) for a time or load factor.
    """

    def __init__(self, lam: Array, mu: Array, frames: Callable[[Any], Array]) -> None:
        super().__init__(lam, mu, FramedLaw)
        self.frames = frames

    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """Return `lam/2` and `mu` times the size, and the nine entries of the rotation, row by row."""
        return np.concatenate([super().stored(at, elements), np.repeat(np.eye(3).reshape(9, 1), len(elements), axis=1)])


class AnisotropicStiffness(Stiffness):
    """A material with a stiffness in its own axes, times section (n,)."""

    law: Any = GeneralLaw
    moduli = 21

    def __init__(self, material: FramedMaterial, hypothesis: Hypothesis, section: Array) -> None:
        self.material, self.hypothesis, self.section = material, hypothesis, section

    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        geometry = Geometry(p, t)
        C = own_stiffness(self.material, self.hypothesis, geometry.axes, np.arange(t.shape[1]))
        return general_coefficients(geometry, C * self.section[:, None, None])

    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """Return `C/2` times the size, in the frames."""
        inner = own_stiffness(self.material, self.hypothesis, at.axes, elements)
        return _upper_half(inner, at.k, at.size * self.section[elements] / 2)


class GeneralStiffness(Stiffness):
    """Any coefficients `L` (n, m, m) of the edges of each linear simplex, symmetric; computed when they are needed."""

    law: Any = GeneralLaw
    moduli = 21

    def __init__(self, compute: Callable[[], Array]) -> None:
        self._compute = compute

    def coefficients(self, p: Array, t: NDArray[np.int32]) -> Array:
        return self._compute()

    def stored(self, at: Frames, elements: NDArray[np.int32]) -> Array:
        """Return the numbers of `1/4 M' (Q' L Q) M = W = 1/4 zeta' L zeta`, with `zeta = Q M` and `M` of the frames."""
        assert at.local is not None
        edges = np.array(LOCAL_EDGES[at.k])
        number = np.zeros((at.k + 1, at.k + 1), dtype=np.int64)
        number[edges[:, 0], edges[:, 1]] = number[edges[:, 1], edges[:, 0]] = np.arange(len(edges))
        own = number[at.local[edges[:, 0]], at.local[edges[:, 1]]].T  # (n, m) the edges in the user's order
        L = self._compute()[elements[:, None, None], own[:, :, None], own[:, None, :]]
        R = np.zeros((len(elements), 3, 3))
        R[:, : at.k, : at.k] = np.linalg.inv(Frames.upper(at.Ri)[:, : at.k, : at.k])
        pairs = np.array(VOIGT[at.k]).T
        ends = np.concatenate([np.zeros((len(elements), 3, 1)), R], axis=2)[:, :, : at.k + 1]  # corners in the frame, (n, 3, k + 1)
        e = ends[:, :, edges[:, 1]] - ends[:, :, edges[:, 0]]  # zeta = e' M e
        Q = e[:, pairs[0]] * e[:, pairs[1]]  # (n, s, m): off the diagonal M_ij and M_ji are separate
        return _upper_half(Q @ L @ np.swapaxes(Q, 1, 2), at.k, np.ones(len(elements)))


def _upper_half(C: Array, k: int, scale: Array) -> Array:
    """Return the upper half of `C` (n, s, s), in Voigt order, as (21, n) in the order of the kernels. Components missing from three
    dimensions are zero.
    """
    indices = [PAIRS.index((min(pair), max(pair))) for pair in VOIGT[k]]
    full = np.zeros((len(C), 6, 6))
    full[:, np.array(indices)[:, None], indices] = C * scale[:, None, None]
    rows, columns = np.triu_indices(6)
    return np.ascontiguousarray(full[:, rows, columns].T)


def check_range(moduli: Array, at: Frames, elements: NDArray[np.int32], dtype: DTypeLike) -> None:
    """Refuse moduli times size, of the size `w`, unless W, F and K of the sizes `w`, `w Ri` and `w Ri Ri` are in the range of
    `dtype`.

    The squares of F and K, which solvers add up, and a margin must be in this range too. Otherwise they would overflow, or become
    zero without an error.
    """
    limits = np.finfo(dtype)
    low, high = 1e4 * float(np.sqrt(limits.tiny)), 1e-4 * float(np.sqrt(limits.max))
    w, Ri = np.abs(moduli).max(axis=0), np.abs(at.Ri).max(axis=0)
    in_range = (low**2 < w) & (w < high**2) & (low < w * Ri) & (w * Ri < high) & (low < w * Ri**2) & (w * Ri**2 < high)
    bad = np.sort(elements[~in_range])
    if len(bad):
        raise MaterialError(
            f"{name_ids(bad, 'element')} of the region: the stiffness leaves the range of {limits.dtype}, because sizes or moduli "
            "are too small or too large. Are units mixed up? Choose others, such as mm and MPa."
        )


def isotropic_coefficients(geometry: Geometry, lam: Array, mu: Array) -> Array:
    """Return the coefficients (nt, m, m) from the Gram matrix; `lam` and `mu` act within the simplex's own dimensions."""
    G = geometry.gram
    a, b = np.array(LOCAL_EDGES[G.shape[1] - 1]).T
    edge = G[:, a, b]
    volumetric = edge[:, :, None] * edge[:, None, :]
    deviatoric = G[:, a[:, None], a] * G[:, b[:, None], b] + G[:, a[:, None], b] * G[:, b[:, None], a]
    lam, mu = np.asarray(lam)[..., None, None], np.asarray(mu)[..., None, None]
    return geometry.volume[:, None, None] / 2 * (lam * volumetric + mu * deviatoric)


def general_coefficients(geometry: Geometry, C: Array) -> Array:
    """Return the coefficients (nt, m, m) from the elasticity tensor `C` (nt, s, s) in the simplex's own axes, in Voigt order."""
    a, b = np.array(LOCAL_EDGES[geometry.gradients.shape[1] - 1]).T
    g = geometry.gradients
    M = -0.25 * (g[:, a, :, None] * g[:, b, None, :] + g[:, b, :, None] * g[:, a, None, :])
    strain = _voigt(M, shear=2.0)  # (nt, m, s)
    return np.asarray(2 * geometry.volume[:, None, None] * (strain @ C @ np.swapaxes(strain, 1, 2)))


def own_stiffness(material: FramedMaterial, hypothesis: Hypothesis, axes: Array, elements: NDArray[Any]) -> Array:
    """Return the elasticity tensor (n, s, s) of these `elements` in their own axes (n, d, k), in Voigt order.

    If the stress across elements vanishes, the compliance acts on the other stresses: `C_own = (N' C^-1 N)^-1`. `N` are the unit
    stresses within elements, in material axes.
    """
    solid, C = np.zeros((len(elements), 3, axes.shape[2])), material.stiffness()
    solid[:, : axes.shape[1]] = axes
    if material.frame is not None:
        frame = np.asarray(material.frame)
        solid = np.swapaxes(frame if frame.ndim == 2 else frame[elements], -1, -2) @ solid
    C, N = C[elements] if C.ndim == 3 else C, unit_stresses(solid)
    if hypothesis.condensed:
        return np.asarray(np.linalg.inv(N @ np.linalg.inv(C) @ np.swapaxes(N, 1, 2)))
    strain = N * multiplicity(3) / multiplicity(axes.shape[2])[:, None]
    return np.asarray(strain @ C @ np.swapaxes(strain, 1, 2))


def unit_stresses(axes: Array) -> Array:
    """Return the Voigt vectors (n, s, 6) of each unit stress component within elements with axes as columns (n, 3, k)."""
    i, j = np.array(VOIGT[axes.shape[2]]).T
    first, second = np.swapaxes(axes[:, :, i], 1, 2), np.swapaxes(axes[:, :, j], 1, 2)  # (n, s, 3)
    dyads = first[..., :, None] * second[..., None, :]
    return _voigt(dyads + (i != j)[:, None, None] * np.swapaxes(dyads, -1, -2), shear=1.0)


def voigt_indices(k: int) -> NDArray[np.int64]:
    """Return the index (k, k) of each component of a tensor in its Voigt vector."""
    indices = np.empty((k, k), dtype=np.int64)
    for number, (i, j) in enumerate(VOIGT[k]):
        indices[i, j] = indices[j, i] = number
    return indices


def multiplicity(k: int) -> Array:
    """Return how often (m,) a symmetric tensor has each entry of its Voigt vector: 1 or 2."""
    return np.array([1.0 if i == j else 2.0 for i, j in VOIGT[k]])


def _voigt(tensor: Array, shear: float) -> Array:
    """Return symmetric tensors (..., n, n) as Voigt vectors; `shear` is 2 for strains and 1 for stresses."""
    i, j = np.array(VOIGT[tensor.shape[-1]]).T
    return tensor[..., i, j] * np.where(i == j, 1.0, shear)
