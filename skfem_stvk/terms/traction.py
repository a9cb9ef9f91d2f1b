"""Forces on the surface that keep their direction and size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..mesh.places import Where, describe, facets_at, in_order
from .body import Body
from .dead import DeadLoad
from .load import Load, Value
from .spread import Spread


@dataclass(frozen=True, eq=False)
class Traction(Load):
    """Dead traction: `f_a = integral of N_a T dA` over facets of the body at rest.

    The facets of triangles are edges, whose area is length times thickness; those of segments are ends, with the segment's area.

    Parameters
    ----------
    where : name of a boundary; or another place (name of a node set, vertex ids or a mask, predicate of x (d, n), scikit-fem's get_dofs(...)):
        all boundary facets whose vertices are all there.
    traction : `T` per area at rest [N/m^2]: components, or (d, n) with one column for each vertex of the facets, in the order of ids as given,
        otherwise ascending; these ramp with the load factor. Or a function of t or of (x, t), taken as it is. Interpolated linearly between vertices.

    Raises
    ------
    RegionError
        when it is bound, if there is no facet.
    LoadError
        when it is bound, if `traction` does not have one finite value a component.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), Traction(lambda x: x[0] == 1, (0, 0, -2e6))])
    >>> cube.external_force(np.zeros(cube.ndofs), t=0.5).reshape(-1, 3).sum(axis=0)
    array([       0.,        0., -1000000.])
    """

    where: Where
    traction: Any

    def bind(self, body: Body) -> DeadLoad:
        what = f"Traction on {describe(self.where)}"
        facets = facets_at(body.mesh, self.where, what)
        spread = Spread(body.mesh, facets, body.facet_areas(facets), in_order(body.mesh, self.where, facets))
        return DeadLoad(body.mesh, spread, Value(self.traction, (body.mesh.d,), spread.x, what, name="traction"))
