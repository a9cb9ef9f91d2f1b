"""A toy load: a force per volume that each element distributes evenly to its nodes."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from skfem_stvk.arguments import Quantity
from skfem_stvk.terms import Load
from skfem_stvk.terms.loads.dead_loads import DeadLoad, Nodes
from skfem_stvk.terms.loads.load import Value


@dataclass(frozen=True, eq=False)
class SharedForce(Load):
    """Dead force `f_a = sum V/n b(x_a)` over the elements of each node, which have `n` nodes and the volume `V`."""

    given_by = "force"

    force: Annotated[Any, Quantity("force per volume", "Force per volume at rest.", components=True)]

    def bind(self, body):
        mesh, n = body.mesh, len(body.mesh.t)
        shares = np.bincount(mesh.t.ravel(), np.tile(body.volumes / n, n), mesh.nv)
        nodes = Nodes(mesh, np.arange(mesh.nv), shares)
        return DeadLoad(mesh, nodes, Value(self.force, (mesh.d,), nodes.x, "SharedForce", name="force"))
