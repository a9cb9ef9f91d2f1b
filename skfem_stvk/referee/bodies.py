"""The referee's bodies: the reference for given terms, and a homogeneous isotropic copy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkError
from ..materials import FramedMaterial, Isotropic
from ..mesh import SimplexMesh
from ..reference import ReferenceStVK, anisotropic_tensor, isotropic_tensor, simplex_axes
from ..terms import StVK

Array = NDArray[np.float64]


def volumes(p: Array, t: NDArray[np.int32]) -> Array:
    """(nt,) lengths, areas or volumes, from the Gram determinant [m^k]."""
    x = p.T[t.T]
    spokes = x[:, 1:] - x[:, :1]
    squared: Array = np.linalg.det(spokes @ np.swapaxes(spokes, 1, 2))
    return np.sqrt(np.abs(squared)) / factorial(len(t) - 1)


def reference_of(mesh: SimplexMesh, terms: Sequence[StVK]) -> ReferenceStVK:
    """scikit-fem's assembly of these terms: one tensor an element, the sum over the terms that cover it."""
    axes = simplex_axes(mesh.p, mesh.t)
    if len(terms) == 1 and terms[0].region is None:
        return ReferenceStVK(mesh.p, mesh.t, _tensor(mesh, terms[0], axes))
    total = np.zeros((mesh.nt, *4 * (mesh.k,)))
    for term in terms:
        elements = mesh.elements(term.region)
        total[elements] += _tensor(mesh, term, axes[elements])
    return ReferenceStVK(mesh.p, mesh.t, total)


def _tensor(mesh: SimplexMesh, term: StVK, axes: Array) -> Array:
    condensed, material = term.hypothesis(mesh).condensed, term.material
    if isinstance(material, Isotropic):
        tensor = isotropic_tensor(material.young, np.nan if material.poisson is None else material.poisson, mesh.k, condensed)
    else:
        assert isinstance(material, FramedMaterial)
        tensor = anisotropic_tensor(material.stiffness(), material.frame, axes, condensed)
    section = {1: term.area, 2: term.thickness}.get(mesh.k)
    return tensor if section is None else tensor * np.reshape(section, (-1, 1, 1, 1, 1))


@dataclass(frozen=True)
class Homogeneous:
    """A homogeneous isotropic copy of a body, of unit section, for checks that have a closed form.

    Attributes
    ----------
    term : the copy's only term.
    lame : its Lame pair within the simplices' dimensions [Pa].
    tensor : (1, k, k, k, k) its elasticity tensor for the reference.
    same : whether the body itself is this one.
    """

    term: StVK
    lame: tuple[float, float]
    tensor: Array
    same: bool


def homogeneous_copy(mesh: SimplexMesh, terms: Sequence[StVK]) -> Homogeneous:
    """The body itself if it is homogeneous and isotropic, else one with the mean of its isotropic constants over its volume."""
    volume = volumes(mesh.p, mesh.t)
    weight, young, poisson = 0.0, 0.0, 0.0
    for term in terms:
        v = volume[mesh.elements(term.region)]
        E, nu = _isotropic_constants(term)
        weight, young, poisson = weight + v.sum(), young + (E * v).sum(), poisson + (nu * v).sum()
    first = terms[0]
    same = (
        len(terms) == 1
        and first.region is None
        and isinstance(first.material, Isotropic)
        and np.ndim(first.material.young) == 0
        and np.ndim(first.material.poisson if first.material.poisson is not None else 0.0) == 0
        and first.thickness is None
        and first.area is None
    )
    material = first.material if same else Isotropic(young / weight, poisson / weight)
    assert isinstance(material, Isotropic)
    copy = StVK(material, plane=first.plane)
    lam, mu = material.lame(copy.hypothesis(mesh))
    poisson_or_none = np.nan if material.poisson is None else material.poisson
    tensor = isotropic_tensor(material.young, poisson_or_none, mesh.k, copy.hypothesis(mesh).condensed)
    return Homogeneous(copy, (float(lam), float(mu)), tensor, same)


def _isotropic_constants(term: StVK) -> tuple[Array, Array]:
    """Young's modulus and Poisson's ratio, of an anisotropic material those of its average over all directions (Voigt)."""
    material = term.material
    if isinstance(material, Isotropic):
        return np.asarray(material.young), np.asarray(0.0 if material.poisson is None else material.poisson)
    if not isinstance(material, FramedMaterial):
        raise StvkError(f"A material of type {type(material).__name__} came; expected one of skfem_stvk.materials.")
    C = material.stiffness()
    axial, mixed = np.einsum("...ii->...", C[..., :3, :3]), C[..., 0, 1] + C[..., 0, 2] + C[..., 1, 2]
    shear = np.einsum("...ii->...", C[..., 3:, 3:])
    bulk, mu = (axial + 2 * mixed) / 9, (axial - mixed + 3 * shear) / 15
    return 9 * bulk * mu / (3 * bulk + mu), (3 * bulk - 2 * mu) / (2 * (3 * bulk + mu))
