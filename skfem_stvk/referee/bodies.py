"""Reference bodies of the referee: the reference model for given terms, and a homogeneous isotropic copy.

This module and `reference` compute all moduli independently from the user-supplied constants. They do not use the elasticity
matrices, Lame pairs and plane hypotheses of the package under test, so that a fault in these is detected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.materials import Anisotropic, FramedMaterial, Isotropic, Material, Orthotropic, TransverselyIsotropic
from ..errors import MaterialError
from ..mesh import ElementMesh
from ..terms import StVK
from .discretisation import Discretisation, Shape
from .reference import ReferenceOnePoint, ReferenceStVK, anisotropic_tensor, element_axes, engineering_matrix, isotropic_tensor


def is_condensed(mesh: ElementMesh, term: StVK) -> bool:
    """Return whether the transverse stress is zero: for segments, membranes in space, and plane stress on request."""
    return mesh.k == 1 or (mesh.k == 2 and (mesh.d == 3 or term.plane == "stress"))


def elasticity(mesh: ElementMesh, terms: Sequence[StVK], discretisation: Discretisation | None = None) -> Array:
    """Return the sum of the elasticity tensors of each element's terms, in its own axes, times its section (nt or 1, k, k, k, k).

    For surfaces and lines in space whose axes change within an element, the shape is (nt, nq, k, k, k, k), one tensor per point.
    """
    discretisation = Discretisation(mesh.element.name) if discretisation is None else discretisation
    axes = element_axes(mesh.p, mesh.t, discretisation.kind, discretisation.points)
    if len(terms) == 1 and terms[0].region is None:
        return tensor_of(terms[0], mesh, axes)
    total = np.zeros((*axes.shape[:-2], *4 * (mesh.k,)))
    for term in terms:
        elements = mesh.elements(term.region)
        total[elements] += tensor_of(term, mesh, axes[elements])
    return total


def hourglass_control(mesh: ElementMesh, terms: Sequence[StVK], discretisation: Discretisation) -> Array:
    """Return the hourglass coefficient times `lam + 2 mu` times section of each element, summed over all terms, (nt,).

    `lam + 2 mu` is taken within the elements' dimensions. For a material that is not isotropic, it is replaced by the largest of
    `C_1111, C_2222, C_3333` in material axes.
    """
    total = np.zeros(mesh.nt)
    for term in terms:
        if isinstance(term.material, Isotropic):
            modulus = tensor_of(term, mesh)[:, 0, 0, 0, 0]
        else:
            section = section_of(mesh, term)
            modulus = np.einsum("nii->ni", voigt_matrix(term.material))[:, :3].max(axis=1) * (1.0 if section is None else section)
        total[mesh.elements(term.region)] += discretisation.hourglass * modulus
    return total


def tensor_of(term: StVK, mesh: ElementMesh, axes: Array | None = None) -> Array:
    """Return the elasticity tensors of a term times its section, in axes (nt, d, k) or (nt, nq, d, k).

    The default is the global axes.
    """
    axes, section = np.eye(mesh.d)[None, :, : mesh.k] if axes is None else axes, section_of(mesh, term)
    tensor = tensor_in(axes, term.material, is_condensed(mesh, term))
    return tensor if section is None else tensor * section.reshape(-1, *[1] * (tensor.ndim - 1))


def tensor_in(axes: Array, material: Material | None, condensed: bool) -> Array:
    """Return the elasticity tensors of a material in axes (nt, d, k) or (nt, nq, d, k).

    If `condensed`, the stress transverse to the axes is zero.
    """
    k, points = axes.shape[-1], axes.shape[1] if axes.ndim == 4 else 1
    if isinstance(material, Isotropic):
        tensor = isotropic_tensor(material.young, np.nan if material.poisson is None else material.poisson, k, condensed)
        return tensor[:, None] if axes.ndim == 4 else tensor
    given = material.frame if isinstance(material, FramedMaterial) else None
    voigt, frame = _at_points(voigt_matrix(material), points), None if given is None else _at_points(np.asarray(given), points)
    tensor = anisotropic_tensor(voigt, frame, axes.reshape(-1, *axes.shape[-2:]), condensed)
    return tensor.reshape(*axes.shape[:-2], *4 * (k,))


def _at_points(matrices: Array, points: int) -> Array:
    """Return the matrices of elements repeated for each of their points, (n points, m, m). A single matrix is not repeated."""
    each = matrices.reshape(-1, *matrices.shape[-2:])
    return each if len(each) == 1 else np.repeat(each, points, axis=0)


def voigt_matrix(material: Material | None) -> Array:
    """Return the elasticity matrices (n, 6, 6) in material axes, from the user-supplied constants.

    Raise MaterialError for a material without a reference.
    """
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


def with_material(term: StVK, material: Material | None) -> StVK:
    """Return the term with another material."""
    return StVK(material, term.region, plane=term.plane, thickness=term.thickness, area=term.area)


def section_of(mesh: ElementMesh, term: StVK) -> Array | None:
    """Return the user-supplied thickness of surfaces or area of segments, or None."""
    value = {1: term.area, 2: term.thickness}.get(mesh.k)
    return None if value is None else np.asarray(value)


def reference_on(
    p: Array, t: NDArray[np.int32], tensor: Array, discretisation: Discretisation, control: Array | None = None
) -> ReferenceStVK | ReferenceOnePoint:
    """Return the reference model of elements with these elasticity tensors.

    `control` is the result of `hourglass_control`, needed for one-point elements with mean gradients.
    """
    if discretisation.is_one_point:
        assert control is not None
        return ReferenceOnePoint(p, t, tensor, control)
    return ReferenceStVK(p, t, tensor, discretisation.kind, discretisation.points)


@dataclass(frozen=True)
class Homogeneous:
    """Homogeneous isotropic copy of a body, or the body itself (`same`), for checks with a closed form.

    The Lame pair within the elements' dimensions and the elasticity tensor (1, k, k, k, k) include the section as a factor.
    """

    term: StVK
    lame: tuple[float, float]
    tensor: Array
    same: bool

    def control(self, discretisation: Discretisation) -> Array:
        """Return the hourglass coefficient `h (lambda + 2 mu)` [Pa] of this body, times its section, (1,)."""
        lam, mu = self.lame
        return np.array([discretisation.hourglass * (lam + 2 * mu)])


def homogeneous_copy(mesh: ElementMesh, terms: Sequence[StVK], shape: Shape) -> Homogeneous:
    """Return the body itself if it is homogeneous and isotropic, else a copy with volume averages of its isotropic constants."""
    first = terms[0]
    if len(terms) == 1 and first.region is None and _is_uniform(mesh, first):
        copy = first
    else:
        volume = shape.volume
        parts = [(volume[mesh.elements(term.region)], *_isotropic_constants(term)) for term in terms]
        total = sum(float(v.sum()) for v, _, _ in parts)
        young = sum(float((E * v).sum()) for v, E, _ in parts) / total
        poisson = sum(float((nu * v).sum()) for v, _, nu in parts) / total
        copy = StVK(Isotropic(young, min(poisson, 0.49)), plane=first.plane)
    tensor = tensor_of(copy, mesh)
    lam, mu = (tensor[0, 0, 0, 1, 1], tensor[0, 0, 1, 0, 1]) if mesh.k > 1 else (tensor[0, 0, 0, 0, 0], 0.0)
    return Homogeneous(copy, (float(lam), float(mu)), tensor, same=copy is first)


def _is_uniform(mesh: ElementMesh, term: StVK) -> bool:
    """Return whether the term is isotropic, with one value of every constant."""
    if not isinstance(term.material, Isotropic):
        return False
    constants = (term.material.young, term.material.poisson, section_of(mesh, term))
    return all(value is None or np.ndim(value) == 0 for value in constants)


def _isotropic_constants(term: StVK) -> tuple[Array, Array]:
    """Return Young's modulus and Poisson's ratio. For an anisotropic material, use its average over all directions (Voigt)."""
    material = term.material
    if isinstance(material, Isotropic):
        return np.asarray(material.young), np.asarray(0.0 if material.poisson is None else material.poisson)
    C = voigt_matrix(material).reshape(-1, 6, 6)
    axial, mixed = np.einsum("nii->n", C[:, :3, :3]), C[:, 0, 1] + C[:, 0, 2] + C[:, 1, 2]
    shear = np.einsum("nii->n", C[:, 3:, 3:])
    bulk, mu = (axial + 2 * mixed) / 9, (axial - mixed + 3 * shear) / 15
    return 9 * bulk * mu / (3 * bulk + mu), (3 * bulk - 2 * mu) / (2 * (3 * bulk + mu))
