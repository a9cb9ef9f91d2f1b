"""A load that has a potential and is not dead: springs from vertices to a point."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from skfem_stvk.mesh.locations import vertices_at
from skfem_stvk.terms import Load
from skfem_stvk.terms.loads.load import Moment, Value


@dataclass(frozen=True, eq=False)
class PointSpring(Load):
    """Springs to a point, with the energy `1/2 k (|x + u - point| - length)^2` for each vertex at a location.

    `point` is either one point (d,) for all vertices or one point for each vertex (n, d). `k` is a number that ramps, or a function
    of t.
    """

    where: Any
    point: Any
    stiffness: Any
    length: float = 0.0

    def bind(self, body):
        return BoundSprings(body.mesh, vertices_at(body.mesh, self.where, "PointSpring"), self)


class BoundSprings:
    has_potential, dead, symmetric, balanced = True, False, True, False
    nodes_paired = np.empty((2, 0), dtype=np.int32)  # each vertex is coupled only with itself

    def __init__(self, mesh, vertices, spring):
        self._vertices, self.nodes, self._rest, self._length = (
            vertices,
            np.unique(vertices),
            mesh.p.T[vertices] - np.asarray(spring.point),
            spring.length,
        )
        self._stiffness = Value(spring.stiffness, (), mesh.p[:, vertices], "PointSpring")

    @property
    def steady(self):
        return self._stiffness.constant is not None

    def _springs(self, u, t):
        """Return stiffnesses, lengths and directions of the springs."""
        arms = self._rest + u[self._vertices]
        lengths = np.linalg.norm(arms, axis=1)
        directions = np.divide(arms, lengths[:, None], out=np.zeros_like(arms), where=lengths[:, None] > 0)
        return self._stiffness.at(Moment.of(t)), lengths, directions

    def potential(self, u, t):
        k, lengths, _ = self._springs(u, t)
        return float((k * (lengths - self._length) ** 2).sum() / 2)

    def add_force(self, u, t, out):
        k, lengths, directions = self._springs(u, t)
        out[self._vertices] -= (k * (lengths - self._length))[:, None] * directions

    def add_blocks(self, u, t, blocks):
        k, lengths, n = self._springs(u, t)
        slack = np.divide(self._length, lengths, out=np.zeros_like(lengths), where=lengths > 0)
        own = (k * (1 - slack))[:, None, None] * np.eye(n.shape[1]) + (k * slack)[:, None, None] * n[:, :, None] * n[:, None, :]
        np.add.at(blocks.own, np.searchsorted(self.nodes, self._vertices), own)

    def memory(self):
        return {"loads": self._rest.nbytes}
