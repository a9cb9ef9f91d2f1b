"""A force on the volume of a body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from .body import Body
from .dead import DeadLoad
from .load import Load, Value
from .spread import Spread


@dataclass(frozen=True, eq=False)
class BodyForce(Load):
    """Dead force on the volume: `f_a = integral of N_a b dV` over the body at rest; thickness and area of its terms count.

    Parameters
    ----------
    force : `b` per volume at rest [N/m^3]: components, which ramp with the load factor; or a function of t or of (x, t), taken as it is
        and interpolated linearly between vertices.
    region : name of a subdomain, element ids, or None for all elements.

    Raises
    ------
    RegionError
        when it is bound, if the region is not in the mesh.
    LoadError
        when it is bound, if `force` does not have one finite value a component.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), BodyForce(lambda x, t: (t * x[2], 0, 0))])
    >>> cube.external_force(np.zeros(cube.ndofs), t=0.5).reshape(-1, 3).sum(axis=0).round(6)
    array([0.25, 0.  , 0.  ])
    """

    force: Any
    region: str | NDArray[Any] | None = None

    def bind(self, body: Body) -> DeadLoad:
        ids = body.mesh.elements(self.region)
        spread = Spread(body.mesh, body.mesh.t[:, ids], body.volumes[ids])
        return DeadLoad(body.mesh, spread, Value(self.force, (body.mesh.d,), spread.x, "BodyForce", name="force"))
