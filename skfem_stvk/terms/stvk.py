"""St. Venant-Kirchhoff material on a region of the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..edges import Assembly
from ..edges.stiffness import AnisotropicStiffness, IsotropicStiffness, Stiffness
from ..errors import MaterialError
from ..materials import FramedMaterial, Isotropic
from ..mesh import ElementMesh
from .body import Body
from .elastic_law import ElasticLaw


@dataclass(frozen=True, eq=False)
class StVK(ElasticLaw):
    """Elastic body with strain energy `W = integral of 1/2 E : C : E`, `E` the Green-Lagrange strain.

    A specification without a mesh, good for many systems; `System` binds it.

    Parameters
    ----------
    material : `Isotropic`, `Orthotropic`, `TransverselyIsotropic` or `Anisotropic`.
    region : name of a subdomain of the mesh, element ids, or None for all elements. Arrays of material constants follow the
        order of the region's elements.
    plane : "strain" or "stress" for triangles in the plane, by default "strain". Triangles in space are in plane stress.
    thickness : of triangles [m], by default 1; a number or one value per element.
    area : cross-section of segments [m^2], by default 1; a number or one value per element.
    simplices : (k + 1, n) nodes of elements of its own on the nodes of the body, beside those of a mesh or in place of one; or the
        name of a boundary, whose facets they are: a skin. See `System`.
    young, poisson, density : shorthand for `material=Isotropic(young, poisson, density=density)`.

    Raises
    ------
    MaterialError
        if a constant is missing, given twice or out of range; when it is bound, if it does not fit the mesh.
    RegionError
        when it is bound, if the region is not in the mesh.

    >>> StVK(young=1e5, poisson=0.3).material.poisson
    array(0.3)
    """

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> Assembly:
        """The assembly of this material on a body's mesh; its `form` is the edge form."""
        return self._bound(Assembly, body, dtype)

    def stiffness(self, mesh: ElementMesh) -> Stiffness:
        """The stiffness of each simplex of the region, in the form that stores least."""
        assert self.material is not None
        n, hypothesis = len(mesh.elements(self.region)), self.hypothesis(mesh)
        self.material.check(n, hypothesis)
        section = self.section(mesh, n)
        if isinstance(self.material, Isotropic):
            lam, mu = (np.broadcast_to(value * section, n) for value in self.material.lame(hypothesis))
            return IsotropicStiffness(lam, mu)
        if isinstance(self.material, FramedMaterial):
            return AnisotropicStiffness(self.material, hypothesis, np.broadcast_to(section, n))
        name = type(self.material).__name__
        raise MaterialError(f"{name} is neither Isotropic nor a FramedMaterial, which has a stiffness() in its frame.")

    def coefficients(self, mesh: ElementMesh) -> NDArray[np.float64]:
        """(n, m, m) coefficients `L` of each linear simplex of the region, for the pairs of its edges [J/m^4]."""
        return self.stiffness(mesh).coefficients(mesh.p, mesh.t[:, mesh.elements(self.region)])
