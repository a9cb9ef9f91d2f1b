"""Linear elasticity on a region of the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...edges import Assembly
from ...edges.stiffness import StoredLaw
from ...kernels.linear_law import LINEAR
from ...mesh import ElementMesh
from .elastic_law import ElasticLaw
from .stvk import StVK


class BoundLinearElastic(Assembly):
    """A force that is linear in displacements: it determines every result between two states."""

    constant_tangent = quartic = has_mean_force = damped = True

    def along(self, u: Array, v: Array) -> NDArray[np.float64]:
        """Return the coefficients (5,) of the energy along `u + s v`, both (nv, d): the last two are zero."""
        force = np.zeros(u.shape, dtype=self.dtype)
        W = self.energy_and_force(u, force)
        return np.array([W, np.vdot(force, v), self.energy_and_force(v), 0.0, 0.0])

    def mean_force(self, u0: Array, u1: Array, weights: tuple[float, float], theta: float, force: Array) -> float:
        """Add `K (w0 u0 + w1 u1)` to `force` (nv, d); return `R = W(u1 - u0)`."""
        self.energy_and_force(weights[0] * u0 + weights[1] * u1, force)
        return self.energy_and_force(u1 - u0)

    def damping_force(self, u: Array, v: Array, force: Array) -> float:
        """Add `K v` to `force` (nv, d), which also resists rotation; return half the dissipated power [W]."""
        return self.energy_and_force(v, force)


@dataclass(frozen=True, eq=False)
class LinearElastic(ElasticLaw):
    """Elastic body of small strain, wrong under rotation: `W = integral of 1/2 eps : C : eps`, `eps = (H + H')/2`.

    `H` is the displacement gradient. The stiffness K is the same at all displacements, that of `StVK` at rest. If the whole body is
    linear and loads are dead, K is factorised once. Then `solve_static` takes one iteration, and a run with constant step length
    one factorisation. The law is wrong under rotation. A body that only rotates by `t` about z has the stress `s_xx = s_yy = 2 (mu
    + lam) (cos t - 1)`, `s_zz = 2 lam (cos t - 1)`, as if it had shrunk.

    Parameters
    ----------
    material, region, plane, thickness, area, young, poisson, density, simplices
        Arguments of `StVK`, as there.

    Raises
    ------
    MaterialError
        as `StVK`.
    RegionError
        when it is bound, if the region is not in the mesh.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> body = System(mesh, LinearElastic(young=1e5, poisson=0.3))
    >>> u = 0.01 * mesh.p.ravel("F")                     # 1 % larger in all directions
    >>> round(body.energy(u), 4), round(9 / 2 * 1e5 / 1.2 * 0.01**2, 4)
    (37.5, 37.5)
    >>> bool(abs(body.internal_force(3 * u) - 3 * body.internal_force(u)).max() < 1e-9)
    True
    """

    #: Whether its stress is that of the small strain.
    small_strain: ClassVar[bool] = True
    assembly = BoundLinearElastic

    def stiffness(self, mesh: ElementMesh) -> StoredLaw:
        # the numbers of St. Venant-Kirchhoff's law, for the linear one
        found = StVK(self.material, self.region, self.plane, self.thickness, self.area).stiffness(mesh)
        found.law = LINEAR[found.law]
        return found
