"""St. Venant-Kirchhoff's energy, extended to flat and inverted elements so that these recover."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ...arguments import Quantity, choice, number
from ...edges.bound_laws import BoundEnergyOfStretches
from ...edges.materials import Isotropic
from ...edges.stiffness import IsotropicStiffness, flat_of
from ...edges.without_energy import StressExtension
from ...errors import MaterialError
from ...kernels.invertible_law import InvertibleLaw
from ...mesh import ElementMesh
from ..body import Body
from ..term import Deformation, PointResponse
from .elastic_law import ElasticLaw, response_of_stretches

#: Principal stretch below which the stress of `StVK` falls in compression.
LEAST = 1 / 3**0.5


@dataclass(frozen=True, eq=False)
class InvertibleStVK(ElasticLaw):
    """St. Venant-Kirchhoff's law, continued by a quadratic energy below a principal stretch `threshold`.

    With the singular values `s_i` of `F`, of which the smallest has the sign of `det F`, `c_i = max(s_i, threshold)`, `d = s - c`
    and the energy `w` of `StVK` in principal stretches::

        W = w(c) + sum w_i(c) d_i + sum_{i<j} w_ij(c) d_i d_j + k/2 |d|^2        k = lam + 2 mu

    Above the threshold the law is `StVK`. Below, the stress continues to fall with slope k, so that an element is pushed back more
    the more it is flattened or inverted. Any state has finite forces. Linear elements recover from inverted starts; quadratic ones
    also have stable inverted states.

    Parameters
    ----------
    material, region, plane, thickness, area, young, poisson, density, simplices
        Arguments of `StVK`, as there, of an isotropic material.
    threshold
        Principal stretch between 1/sqrt(3) = 0.577 and 1. Below 0.577, the stress of `StVK` falls in compression and would pull a
        mirrored element further in.
    extend
        Quantity that is extended below the threshold: "energy", as above, or "stress", the form of Irving, Teran and Fedkiw: each
        principal stress is `w_i(c) + k d_i`. This form has no energy, and a tangent that is not symmetric. It is meant for
        comparison, and written in plain NumPy.

    Raises
    ------
    MaterialError
        as `StVK`, and if the material is not isotropic or the threshold out of range.

    Notes
    -----
    Second derivatives of the energy jump at the threshold. Where two stretches cancel (`s_i + s_j = 0`: mirror images, lines and
    points), the energy is a cone. It falls in all directions that change the sum, and no rotation is the nearest to F. One
    rotation is chosen, and with it a side of the cone. The force is exact on that side. The unbounded curvature across the cone
    is left out of K at such states. Near them K is exact, and the estimate of rounding errors can exceed all forces; solves omit
    these entries of it.

    In plane stress and in cables, results have the thickness of `StVK`; below the threshold that is a convention.

    `EnergyMomentum` uses the force at the middle of the step, which conserves momenta, and energy to O(dt^2). A discrete gradient
    would need the second Piola-Kirchhoff stress, which is infinite in flat elements. With `extend="stress"` the forces equal
    those of stresses on area vectors (Teran et al. 2003).

    Source: Stomakhin, Howes, Schroeder, Teran, "Energetically consistent invertible elasticity" (2012); Irving, Teran,
    Fedkiw, "Invertible finite elements for robust simulation of large deformation" (2004) for the stress.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> u = lambda part: -part * (mesh.p * [[0], [0], [1]]).ravel("F")
    >>> bodies = System(mesh, StVK(young=1.0, poisson=0.3)), System(mesh, InvertibleStVK(young=1.0, poisson=0.3))
    >>> [[round(body.energy(u(part)), 4) for part in (0.3, 1.0, 2.0)] for body in bodies]
    [[0.0438, 0.1683, 0.0], [0.0438, 0.4663, 2.2055]]
    """

    resists_inversion: ClassVar[bool] = True
    has_response = True
    assembly = BoundEnergyOfStretches

    threshold: Annotated[float, Quantity(None, "Principal stretch below which it is continued.", gt=LEAST, lt=1)] = field(
        default=0.6, kw_only=True
    )
    extend: Annotated[
        str, Quantity(None, "What is continued: the energy, or the stress as Irving does.", values=("energy", "stress"))
    ] = field(default="energy", kw_only=True)

    def __post_init__(self, young: ArrayLike | None, poisson: ArrayLike | None, density: ArrayLike | None) -> None:
        super().__post_init__(young, poisson, density)
        choice("InvertibleStVK: extend", self.extend, ("energy", "stress"), MaterialError)
        expected = "a stretch between 1/sqrt(3) = 0.577, below which the stress of StVK falls in compression, and 1"
        threshold = number("InvertibleStVK: threshold", self.threshold, expected, LEAST, 1.0, error=MaterialError)
        object.__setattr__(self, "threshold", threshold)

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> Any:
        bound = super().bind(body, dtype)
        if self.extend == "energy":
            return bound
        mesh = body.mesh if isinstance(body, Body) else body
        if mesh.k < 2 or mesh.k < mesh.d:
            raise MaterialError(
                f"InvertibleStVK(extend='stress') is for solids and for elements in the plane; the mesh has {mesh.kind}. Take "
                "extend='energy'."
            )
        return StressExtension(mesh, mesh.t[:, mesh.elements(self.region)], self.lame(mesh), self.threshold, bound)

    def stiffness(self, mesh: ElementMesh) -> IsotropicStiffness:
        law = partial(InvertibleLaw, flat=flat_of(mesh.k, mesh.d), threshold=self.threshold)
        return IsotropicStiffness(*self.lame(mesh), law)

    @property
    def has_stress(self) -> bool:
        """Whether the law has fields of stress and energy density."""
        return self.extend == "energy"

    def response(self, at: Deformation) -> PointResponse:
        if not self.has_stress:
            raise MaterialError("InvertibleStVK: with extend='stress' there is no energy density. Take extend='energy'.")
        assert isinstance(self.material, Isotropic)
        return response_of_stretches(at, self.material, partial(InvertibleLaw, threshold=self.threshold), green=True)
