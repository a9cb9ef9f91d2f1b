"""Corotated linear elasticity: linear in each element's own frame, which rotates with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ...arguments import Array, Quantity, choice, real_array, shown
from ...edges import Assembly
from ...edges.bound_laws import BoundEnergyOfStretches, BoundInFrames
from ...edges.materials import Isotropic
from ...edges.stiffness import FramedStiffness, IsotropicStiffness, StoredLaw, flat_of
from ...edges.without_energy import VertexWarping
from ...errors import MaterialError, name_ids
from ...kernels.corotated_law import CorotatedLaw
from ...mesh import ElementMesh
from ..body import Body
from ..loads.load import Moment, Time
from ..term import Deformation, PointResponse
from .elastic_law import ElasticLaw, response_of_stretches

#: How far from orthonormal the columns of a rotation may be.
ORTHONORMAL = 1e-8


@dataclass(frozen=True, eq=False)
class Corotated(ElasticLaw):
    """Linear elasticity in frames that rotate with the elements: `W = integral of mu |S - 1|^2 + lam/2 tr(S - 1)^2`, `F = R S`.

    `R` is the rotation nearest to `F`, also where `F` is singular or mirrored. In a mirrored element the smallest stretch counts as
    negative, and the element is pushed back. The law is isotropic. It is exact under rotation, and equals linear elasticity for
    small strains. In plane stress `lam* = 2 mu lam/(lam + 2 mu)` is exact. In compression the tangent is not positive definite
    (`kept=TENSILE` is semi-definite). Where two stretches of a mirrored element sum to zero, its nearest rotation jumps.

    Parameters
    ----------
    material, region, plane, thickness, area, young, poisson, density, simplices
        Arguments of `StVK`, as there, of an isotropic material.
    rotation
        Source of the frames. "element": from F at each point of an element, with the energy above. "vertex": one frame for each
        node, from the mean of F around it, `F_a = R_a sum_b K_ab (R_a' x_b - X_b)` with K at rest. This form has no energy, and its
        torques do not balance. A function of time, or of the load factor in statics: `rotation(t)` returns (n, 3, 3) for the
        elements of the region, `f = R K0 (R'x - X)`. Energy that the body gains as the frames rotate is external work: this form
        has no energy of its own.

    Raises
    ------
    MaterialError
        as `StVK`, and if the material is not isotropic.

    Notes
    -----
    Frames at nodes, and frames that are a function, have no energy (`has_energy = False` of the bound term). `energy`,
    `energy_and_force`, `linearize` and `potential` of the system raise an error for them. Lists of energies have NaN for the law
    and for sums with it. The energy ledger of a motion counts the work of these forces as external. Stress and energy density are
    masked.

    The warped tangent omits the derivative of the rotations: K at rest, rotated with each element, which is positive
    semi-definite. It is `kept=WARPED` of `System.jacobian` and `tangent="warped"` of the implicit integrators, also for `StVK`.
    At strains of a few percent it is a few percent off. `EnergyMomentum` uses the force at the middle of the step, which
    conserves momenta, and energy to O(dt^2).

    Source: Mueller et al., "Stable real-time deformations" (2002), for frames at nodes. Capell et al., "Interactive skeleton-driven
    dynamic deformations" (2002), for user-supplied frames. McAdams et al., "Efficient elasticity for character skinning" (2011),
    for the energy and its exact tangent. Mueller and Gross, "Interactive virtual materials" (2004), for the warped tangent.

    Examples
    --------
    >>> import numpy as np, skfem
    >>> from skfem_stvk import System
    >>> mesh = skfem.MeshTet().refined(1)
    >>> body = System(mesh, Corotated(young=1e5, poisson=0.3))
    >>> turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ mesh.p - mesh.p
    >>> bool(body.energy(turned.ravel("F")) < 1e-20)
    True
    """

    resists_inversion: ClassVar[bool] = True
    has_response = True

    rotation: Annotated[
        str | Callable[[float], ArrayLike],
        Quantity(None, "Where the frames are: in elements, or at nodes.", values=("element", "vertex")),
    ] = field(default="element", kw_only=True)

    def __post_init__(self, young: ArrayLike | None, poisson: ArrayLike | None, density: ArrayLike | None) -> None:
        if not callable(self.rotation):
            expected = ("element", "vertex")
            choice("Corotated: rotation", self.rotation, expected, MaterialError)
        super().__post_init__(young, poisson, density)

    def bind(self, body: Body | ElementMesh, dtype: DTypeLike = np.float64) -> Any:
        bound, mesh = super().bind(body, dtype), body.mesh if isinstance(body, Body) else body
        if callable(self.rotation):
            bound = bound.at(0.0, None)
        if self.rotation != "vertex":
            return bound
        if mesh.k < 2 or mesh.k < mesh.d:
            raise MaterialError(
                f"Corotated(rotation='vertex'): the mesh has {mesh.kind}; expected solids or elements in the plane, where F has a "
                "mean around nodes. Take rotation='element'."
            )
        return VertexWarping(mesh, mesh.t[:, mesh.elements(self.region)], bound)

    @property
    def assembly(self) -> type[Assembly]:
        return BoundInFrames if callable(self.rotation) else BoundEnergyOfStretches

    @property
    def per_element(self) -> bool:  # type: ignore[override]
        """Whether the forces are sums over elements, with frames that no user supplies for all elements."""
        return self.rotation == "element"

    @property
    def has_stress(self) -> bool:
        """Whether stresses are known; with frames at nodes or user-supplied frames only the forces on nodes are."""
        return self.rotation == "element"

    def response(self, at: Deformation) -> PointResponse:
        if not self.has_stress:
            raise MaterialError("Corotated: stresses exist only for rotation='element'; other frames have only forces on nodes.")
        assert isinstance(self.material, Isotropic)
        return response_of_stretches(at, self.material, CorotatedLaw)

    def stiffness(self, mesh: ElementMesh) -> StoredLaw:
        if callable(self.rotation):
            return FramedStiffness(*self.lame(mesh), self._frames(mesh))
        return IsotropicStiffness(*self.lame(mesh), partial(CorotatedLaw, flat=flat_of(mesh.k, mesh.d)))

    def _frames(self, mesh: ElementMesh) -> Callable[[Time], Array]:
        """Return a function of load factor or time for the rotations (n, 3, 3), checked."""
        assert callable(self.rotation)
        rotation, ids, d = self.rotation, mesh.elements(self.region), mesh.d
        if d == 1:
            raise MaterialError("Corotated(rotation=...): elements on a line have no rotation. Leave rotation out.")

        def frames(t: Time) -> Array:
            time = Moment.of(t).time
            try:
                R = real_array(rotation(time))
            except Exception as error:
                raise MaterialError(
                    f"Corotated: the function rotation failed with {type(error).__name__}: {error}. It gets the load factor or "
                    f"time ({time:g}), and must return rotations of shape ({len(ids)}, {d}, {d})."
                ) from error
            if R is None or R.shape not in {(len(ids), 3, 3), (len(ids), d, d)}:
                raise MaterialError(
                    f"Corotated: rotation({time:g}) returned {shown(R)}; expected an array of shape ({len(ids)}, {d}, {d}), a "
                    "rotation for each element of the region."
                )
            whole = np.zeros((len(ids), 3, 3)) + np.diag([0.0] * R.shape[1] + [1.0] * (3 - R.shape[1]))
            whole[:, : R.shape[1], : R.shape[1]] = R
            with np.errstate(invalid="ignore", over="ignore"):
                off = np.abs(np.swapaxes(whole, 1, 2) @ whole - np.eye(3)).max(axis=(1, 2))
                bad = ids[~((off < ORTHONORMAL) & (np.linalg.det(whole) > 0))]
            if len(bad):
                raise MaterialError(
                    f"Corotated: rotation({time:g}) is no rotation of {name_ids(bad, 'element')}: expected orthonormal columns and "
                    "determinant +1. Use the polar factor of the result."
                )
            return whole

        return frames
