"""The coefficients L of each simplex: all of its stiffness, for pairs of its edges.

For edges `(a, b)` and `(c, d)` of a simplex of volume `V` with gradients `g_a` of its barycentric coordinates:

    isotropic    L = V [ lam/2 G_ab G_cd + mu/2 (G_ac G_bd + G_ad G_bc) ],    G_ab = g_a . g_b
    general      L = 2 V M_ab : C : M_cd,    M_ab = -1/4 (g_a (x) g_b + g_b (x) g_a),    E = sum zeta_ab M_ab

Source: Kikuuwe, Tabuchi, Yamamoto 2009 (isotropic tetrahedra); Delingette 2008 (isotropic triangles).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import MaterialError
from ..materials import FramedMaterial, Hypothesis, Isotropic, Material
from ..mesh.geometry import Geometry
from .topology import LOCAL_EDGES

#: Components of a symmetric tensor in one, two and three dimensions: the Voigt order of the package.
VOIGT = {
    1: ((0, 0),),
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
}


def simplex_coefficients(geometry: Geometry, material: Material, hypothesis: Hypothesis) -> Array:
    """(nt, m, m) coefficients per unit of section [Pa m^(k-4)], symmetric and positive semi-definite."""
    if isinstance(material, Isotropic):
        return isotropic_coefficients(geometry, *material.lame(hypothesis))
    if not isinstance(material, FramedMaterial):
        raise MaterialError(
            f"{type(material).__name__} is neither Isotropic nor a FramedMaterial, which has a stiffness() in its frame."
        )
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
    own: NDArray[Any] = np.linalg.inv(N @ np.linalg.inv(C) @ np.swapaxes(N, 1, 2))
    return own


def _voigt(tensor: Array, shear: float) -> Array:
    """Symmetric tensors (..., n, n) as Voigt vectors; `shear` is 2 for strains and 1 for stresses."""
    i, j = np.array(VOIGT[tensor.shape[-1]]).T
    return tensor[..., i, j] * np.where(i == j, 1.0, shear)
