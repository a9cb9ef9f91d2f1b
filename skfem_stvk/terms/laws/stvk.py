"""St. Venant-Kirchhoff material on a region of the mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Quantity, flag
from ...edges import Assembly
from ...edges.bound_laws import BoundStVK, BoundTensionField
from ...edges.materials import FramedMaterial, Isotropic
from ...edges.stiffness import AnisotropicStiffness, IsotropicStiffness
from ...errors import MaterialError
from ...kernels.st_venant_kirchhoff import IsotropicLaw
from ...kernels.tension_fields import TensionLaw
from ...mesh import ElementMesh
from ..term import Deformation, PointResponse
from .elastic_law import ElasticLaw, stress_and_density


@dataclass(frozen=True, eq=False)
class StVK(ElasticLaw):
    """Elastic body with strain energy `W = integral of 1/2 E : C : E`, `E` the Green-Lagrange strain.

    It is a specification without a mesh, usable in many systems; `System` binds it.

    Parameters
    ----------
    material
        Material, as `Isotropic`, `Orthotropic`, `TransverselyIsotropic` or `Anisotropic`.
    region
        Name of a subdomain of the mesh, element ids, or None for all elements. Arrays of material constants follow the order of the
        region's elements.
    plane
        Assumption "strain" or "stress" for triangles in the plane, by default "strain". Triangles in space are in plane stress.
    thickness
        Thickness of triangles [m], by default 1; a number or one value per element.
    area
        Cross-section of segments [m^2], by default 1; a number or one value per element.
    young, poisson, density
        Shorthand for `material=Isotropic(young, poisson, density=density)`.
    simplices
        Nodes (k + 1, n) of the term's own elements on the nodes of the body, in addition to those of a mesh or instead of one; or
        the name of a boundary, whose facets they are: a skin. See `System`.
    wrinkling
        Whether surfaces and cables carry no compression, as thin ones do: the relaxed energy of tension fields, for isotropic
        materials of triangles and quadrilaterals in space, in plane stress, or of segments. With the principal strains `E1 >= E2`
        the energy per volume is `1/2 E : C : E` where `E2 >= -nu E1` (taut). It is `E E1^2/2` below (wrinkled, uniaxial tension),
        and 0 where `E1 <= 0` (slack). Wrinkles have no size. The energy is not a quartic along lines. K is positive semi-definite
        and jumps between the three; it is that of the present state.

    Raises
    ------
    MaterialError
        if a constant is missing, specified twice or out of range; when it is bound, if it does not fit the mesh, or if
        wrinkling does not apply to the elements or the material.
    RegionError
        when it is bound, if the region is not in the mesh.

    Notes
    -----
    Source of the relaxed energy: Pipkin, "The relaxed energy density for isotropic elastic membranes" (1986).

    Examples
    --------
    >>> StVK(young=1e5, poisson=0.3).material.poisson
    array(0.3)
    """

    wrinkling: Annotated[bool, Quantity(None, "Whether surfaces and cables give way to compression: tension fields.")] = field(
        default=False, kw_only=True
    )

    def __post_init__(self, young: ArrayLike | None, poisson: ArrayLike | None, density: ArrayLike | None) -> None:
        super().__post_init__(young, poisson, density)
        flag("StVK: wrinkling", self.wrinkling, MaterialError)
        if self.wrinkling and not isinstance(self.material, Isotropic):
            raise MaterialError(
                f"StVK(wrinkling=True): material = {type(self.material).__name__}(...); expected Isotropic. Give young= and "
                "poisson=, or leave wrinkling out."
            )

    @property
    def assembly(self) -> type[Assembly]:
        """Assembly class; its `form` is the edge form, which does not exist with wrinkling."""
        return BoundTensionField if self.wrinkling else BoundStVK

    @property
    def has_response(self) -> bool:
        return self.wrinkling

    def stiffness(self, mesh: ElementMesh) -> IsotropicStiffness | AnisotropicStiffness:
        hypothesis = self.hypothesis(mesh)
        if self.wrinkling and not hypothesis.condensed:
            flat = mesh.k == 2
            remedy = "Give plane='stress'" if flat else "Leave it out there, or give triangles of a skin: simplices='boundary'"
            raise MaterialError(
                "StVK(wrinkling=True) is for surfaces in space, segments, and elements in plane stress; the mesh has "
                f"{mesh.kind}{' in plane strain' * flat}. {remedy}."
            )
        if isinstance(self.material, Isotropic):
            return IsotropicStiffness(*self.lame(mesh), TensionLaw if self.wrinkling else IsotropicLaw)
        if isinstance(self.material, FramedMaterial):
            n = len(mesh.elements(self.region))
            self.material.check(n, hypothesis)
            return AnisotropicStiffness(self.material, hypothesis, np.broadcast_to(self.section(mesh, n), n))
        name = type(self.material).__name__
        raise MaterialError(f"{name} is neither Isotropic nor a FramedMaterial, which has a stiffness() in its frame.")

    def coefficients(self, mesh: ElementMesh) -> NDArray[np.float64]:
        """Return the coefficients `L` (n, m, m) of each linear simplex of the region, for the pairs of its edges [J/m^4].

        Parameters
        ----------
        mesh
            Mesh of the body.
        """
        if self.wrinkling:
            raise MaterialError(
                "StVK(wrinkling=True) has no coefficients of edges: where a membrane wrinkles, its energy is not quadratic in "
                "squared lengths. Leave wrinkling out."
            )
        return self.stiffness(mesh).coefficients(mesh.p, mesh.t[:, mesh.elements(self.region)])

    def response(self, at: Deformation) -> PointResponse:
        # Wrinkling: the strain is that which the stress causes in all directions, without the width that folds take.
        assert isinstance(self.material, Isotropic)
        n = len(at.gradient)
        lam, mu = (np.broadcast_to(value, n) for value in self.material.lame(at.hypothesis))
        stress, density = stress_and_density(IsotropicStiffness(lam, mu, TensionLaw), at)
        others = np.trace(stress, axis1=1, axis2=2)[:, None, None] * np.eye(3) - stress
        strain = (stress.T / np.asarray(self.material.young) + self.material.strain_across(others.T)).T  # all are symmetric
        return PointResponse(strain, stress, density, np.zeros(n, dtype=bool))
