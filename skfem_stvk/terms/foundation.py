"""Springs between the surface of a body and the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ..arguments import own, real_array, shown
from ..errors import LoadError
from ..mesh import SimplexMesh
from ..mesh.places import Where, describe, facets_at
from .bedding import Bedding
from .body import Body
from .spread import Spread


@dataclass(frozen=True, eq=False)
class ElasticFoundation:
    """Elastic bedding: `W = 1/2 integral of k_x u_x^2 + k_y u_y^2 + k_z u_z^2 dA` over facets of the body at rest.

    It pulls and pushes along the coordinate axes. The area of edges is length times thickness, that of ends of segments the segment's area.

    Parameters
    ----------
    where : as of `Traction`.
    stiffness : `k` per area at rest [N/m^3], a number for all components or one for each; zero lets go of a component.

    Raises
    ------
    LoadError
        if the stiffness is negative, not finite or zero altogether; when it is bound, if it does not have one value a component.
    RegionError
        when it is bound, if there is no facet.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3), ElasticFoundation(lambda x: x[2] == 0, (0, 0, 1e6))])
    >>> round(cube.energy(np.full(cube.ndofs, 0.01)), 9)
    50.0
    """

    where: Where
    stiffness: ArrayLike

    def __post_init__(self) -> None:
        given = real_array(self.stiffness)
        if given is None or given.ndim > 1:
            raise LoadError(
                f"ElasticFoundation: stiffness is {shown(self.stiffness)}; expected a number, or one a component [N/m^3]."
            )
        k = given
        if not np.isfinite(k).all() or (k < 0).any() or not k.any():
            raise LoadError(
                f"ElasticFoundation: stiffness is {self.stiffness!r}; expected finite values, none negative and not all zero."
            )
        object.__setattr__(self, "stiffness", k)
        own(self)

    def bind(self, body: Body | SimplexMesh, dtype: DTypeLike = np.float64) -> Bedding:
        """The bedding of a body; of a mesh alone, with thickness or area 1."""
        body = body if isinstance(body, Body) else Body(body, [])
        what, d = f"ElasticFoundation on {describe(self.where)}", body.mesh.d
        k = np.asarray(self.stiffness)
        if k.shape not in ((), (d,)):
            raise LoadError(
                f"{what}: stiffness has shape {k.shape}; expected a number, or {d} components ({', '.join('xyz'[:d])})."
            )
        facets = facets_at(body.mesh, self.where, what)
        return Bedding(Spread(body.mesh, facets, body.facet_areas(facets)), facets, np.broadcast_to(k, d), dtype)
