"""The referee's bodies: the reference for given terms, and a homogeneous isotropic copy.

Whatever a term's constants mean is worked out anew here and in `reference`, from the constants that the user gave: the player's own
elasticity matrices, Lame pairs and plane hypotheses are not asked, so that a fault in them shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from ..arguments import Array
from ..errors import MaterialError
from ..materials import Anisotropic, FramedMaterial, Isotropic, Material, Orthotropic, TransverselyIsotropic
from ..mesh import ElementMesh
from ..reference import anisotropic_tensor, engineering_matrix, isotropic_tensor, simplex_axes
from ..terms import StVK


def volumes(mesh: ElementMesh) -> Array:
    """(nt,) lengths, areas or volumes, from the Gram determinant [m^k]."""
    x = mesh.p.T[mesh.t.T]
    spokes = x[:, 1:] - x[:, :1]
    squared: Array = np.linalg.det(spokes @ np.swapaxes(spokes, 1, 2))
    return np.sqrt(np.abs(squared)) / factorial(mesh.k)


def is_condensed(mesh: ElementMesh, term: StVK) -> bool:
    """Whether there is no stress across the simplices: segments, membranes in space, plane stress on request."""
    return mesh.k == 1 or (mesh.k == 2 and (mesh.d == 3 or term.plane == "stress"))


def elasticity(mesh: ElementMesh, terms: Sequence[StVK]) -> Array:
    """(nt or 1, k, k, k, k) sums of the elasticity tensors of each element's terms in its own axes, times its section."""
    axes = simplex_axes(mesh.p, mesh.t)
    if len(terms) == 1 and terms[0].region is None:
        return _tensor(mesh, terms[0], axes)
    total = np.zeros((mesh.nt, *4 * (mesh.k,)))
    for term in terms:
        elements = mesh.elements(term.region)
        total[elements] += _tensor(mesh, term, axes[elements])
    return total


def _tensor(mesh: ElementMesh, term: StVK, axes: Array) -> Array:
    condensed, material = is_condensed(mesh, term), term.material
    if isinstance(material, Isotropic):
        tensor = isotropic_tensor(material.young, np.nan if material.poisson is None else material.poisson, mesh.k, condensed)
    else:
        frame = material.frame if isinstance(material, FramedMaterial) else None
        tensor = anisotropic_tensor(_voigt_matrix(material), frame, axes, condensed)
    section = _section(mesh, term)
    return tensor if section is None else tensor * section.reshape(-1, 1, 1, 1, 1)


def _voigt_matrix(material: Material | None) -> Array:
    """(n, 6, 6) in material axes, from the constants as they were given."""
    if isinstance(material, Orthotropic):
        return engineering_matrix(material.young, material.poisson, material.shear)
    if isinstance(material, TransverselyIsotropic):
        axial, across = material.young_axial, np.asarray(material.young_transverse)
        nu_axial, nu_across = material.poisson_axial, np.asarray(material.poisson_transverse)
        shear = across / (2 * (1 + nu_across)), material.shear_axial, material.shear_axial
        return engineering_matrix((axial, across, across), (nu_across, nu_axial, nu_axial), shear)
    if isinstance(material, Anisotropic):
        return np.asarray(material.voigt)
    raise MaterialError(f"The referee has no reference for a {type(material).__name__}; add its matrix to referee/bodies.py.")


def _section(mesh: ElementMesh, term: StVK) -> Array | None:
    value = {1: term.area, 2: term.thickness}.get(mesh.k)
    return None if value is None else np.asarray(value)


@dataclass(frozen=True)
class Homogeneous:
    """A homogeneous isotropic copy of a body, or the body itself (`same`), for checks that have a closed form.

    Its Lame pair within the simplices' dimensions and its elasticity tensor (1, k, k, k, k) are times the section.
    """

    term: StVK
    lame: tuple[float, float]
    tensor: Array
    same: bool


def homogeneous_copy(mesh: ElementMesh, terms: Sequence[StVK]) -> Homogeneous:
    """The body itself if it is homogeneous and isotropic, else one with the mean of its isotropic constants over its volume."""
    first = terms[0]
    if len(terms) == 1 and first.region is None and _is_uniform(mesh, first):
        copy = first
    else:
        volume = volumes(mesh)
        parts = [(volume[mesh.elements(term.region)], *_isotropic_constants(term)) for term in terms]
        total = sum(float(v.sum()) for v, _, _ in parts)
        young = sum(float((E * v).sum()) for v, E, _ in parts) / total
        poisson = sum(float((nu * v).sum()) for v, _, nu in parts) / total
        copy = StVK(Isotropic(young, min(poisson, 0.49)), plane=first.plane)
    tensor = _tensor(mesh, copy, simplex_axes(mesh.p, mesh.t[:, :1]))
    lam, mu = (tensor[0, 0, 0, 1, 1], tensor[0, 0, 1, 0, 1]) if mesh.k > 1 else (tensor[0, 0, 0, 0, 0], 0.0)
    return Homogeneous(copy, (float(lam), float(mu)), tensor, same=copy is first)


def _is_uniform(mesh: ElementMesh, term: StVK) -> bool:
    """Isotropic, with one value of every constant."""
    if not isinstance(term.material, Isotropic):
        return False
    constants = (term.material.young, term.material.poisson, _section(mesh, term))
    return all(value is None or np.ndim(value) == 0 for value in constants)


def _isotropic_constants(term: StVK) -> tuple[Array, Array]:
    """Young's modulus and Poisson's ratio, of an anisotropic material those of its average over all directions (Voigt)."""
    material = term.material
    if isinstance(material, Isotropic):
        return np.asarray(material.young), np.asarray(0.0 if material.poisson is None else material.poisson)
    C = _voigt_matrix(material).reshape(-1, 6, 6)
    axial, mixed = np.einsum("nii->n", C[:, :3, :3]), C[:, 0, 1] + C[:, 0, 2] + C[:, 1, 2]
    shear = np.einsum("nii->n", C[:, 3:, 3:])
    bulk, mu = (axial + 2 * mixed) / 9, (axial - mixed + 3 * shear) / 15
    return 9 * bulk * mu / (3 * bulk + mu), (3 * bulk - 2 * mu) / (2 * (3 * bulk + mu))
