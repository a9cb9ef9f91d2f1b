"""Forces on vertices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..mesh.places import Where, describe, vertices_at
from .body import Body
from .dead import DeadLoad, Nodes
from .load import Load, Value


@dataclass(frozen=True, eq=False)
class NodalLoad(Load):
    """Dead force on each vertex at a place.

    Parameters
    ----------
    where : name of a boundary or of a node set, vertex ids or a mask, predicate of x (d, n), or scikit-fem's get_dofs(...).
    force : on *each* vertex [N]: components, or (d, n) with one column for each vertex, in the order of ids as given, otherwise ascending; these
        ramp with the load factor. Or a function of t or of (x, t), taken as it is.

    Raises
    ------
    RegionError
        when it is bound, if there is no vertex.
    LoadError
        when it is bound, if `force` does not have one finite value a component.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> bar = System(skfem.MeshLine(), [StVK(young=1.0, poisson=0.3), NodalLoad(lambda x: x[0] == 1, [5.0])])
    >>> bar.external_force(np.zeros(2), t=0.1)
    array([0. , 0.5])
    """

    where: Where
    force: Any

    def bind(self, body: Body) -> DeadLoad:
        what = f"NodalLoad on {describe(self.where)}"
        nodes = Nodes(body.mesh, vertices_at(body.mesh, self.where, what))
        return DeadLoad(body.mesh, nodes, Value(self.force, (body.mesh.d,), nodes.x, what, name="force"))
