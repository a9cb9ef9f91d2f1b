"""Corotated linear elasticity: linear in each element's own frame, which turns with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import DTypeLike

from ..edges.assembly import StretchesAssembly
from ..edges.stiffness import StretchesStiffness
from ..kernels.principal import CorotatedLaw
from ..mesh import ElementMesh
from .body import Body
from .elastic_law import ElasticLaw


@dataclass(frozen=True, eq=False)
class Corotated(ElasticLaw):
    """Linear elasticity in frames that turn with the elements: `W = integral of mu |S - 1|^2 + lam/2 tr(S - 1)^2`, `F = R S`.

    `R` is the rotation nearest to `F`, also where `F` is singular or mirrored: of a mirrored element the smallest stretch counts as
    negative, and it is pushed back. Isotropic. Under rotation it is exact, where strains are small it is linear elasticity, and in
    plane stress `lam* = 2 mu lam/(lam + 2 mu)` is exact. In compression the tangent is not positive definite (`kept=TENSILE` is
    semi-definite), and where two stretches of a mirrored element add up to nothing the rotation nearest to it jumps.

    Parameters as in `StVK`, of an isotropic material.

    Source: McAdams et al., "Efficient elasticity for character skinning" (2011) for the energy and its exact tangent; Mueller and
    Gross, "Interactive virtual materials" (2004) for the warped one.

    Raises
    ------
    MaterialError
        as `StVK`, and if the material is not isotropic.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> body = System(mesh, Corotated(young=1e5, poisson=0.3))
    >>> turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ mesh.p - mesh.p
    >>> bool(body.energy(turned.ravel("F")) < 1e-20)
    True
    """

    resists_inversion: ClassVar[bool] = True

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> StretchesAssembly:
        """The assembly of this law on a body's mesh."""
        return self._bound(StretchesAssembly, body, dtype)

    def stiffness(self, mesh: ElementMesh) -> StretchesStiffness:
        """The law of the kernels, and what it stores of each element of the region."""
        return StretchesStiffness(*self.lame(mesh), CorotatedLaw, mesh)
