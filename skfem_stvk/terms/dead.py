"""Dead loads: forces on vertices that do not depend on where those go."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.rows import Places
from ..mesh import SimplexMesh
from .load import Moment, Time, Value
from .spread import Spread

Values = NDArray[np.float64]


class Nodes:
    """Vertices that take the values as they are: what `Spread` is for forces on vertices."""

    def __init__(self, mesh: SimplexMesh, vertices: NDArray[np.int64]) -> None:
        self.vertices, self.x = vertices, mesh.p[:, vertices]

    def integrate(self, values: Values) -> Values:
        """(nv, d) the `values` (d, nv) or (d, 1)."""
        return np.broadcast_to(values.T, self.x.T.shape)


class DeadLoad:
    """Values `f(t)` with the potential `-f . u`. Those of constants are computed once, others once for each new `t`.

    Parameters
    ----------
    spread : vertices, and how values go to them.
    value : what acts there, (d,) components at each of them.
    """

    has_potential = True
    dead = True
    edges: NDArray[np.int32] = np.empty((2, 0), dtype=np.int32)

    def __init__(self, mesh: SimplexMesh, spread: Spread | Nodes, value: Value) -> None:
        self._at: Any = slice(None) if np.array_equal(spread.vertices, np.arange(mesh.nv)) else spread.vertices
        self._spread, self._value = spread, value
        self._unit = None if value.constant is None else spread.integrate(value.constant)
        self._known = Moment(1.0, 1.0), self._compute(Moment(1.0, 1.0))

    @property
    def steady(self) -> bool:
        """Whether it is given by constants."""
        return self._unit is not None

    def forces(self, t: Time) -> Values:
        """(n, d) forces on its vertices [N]."""
        moment = Moment.of(t)
        known, forces = self._known
        if moment != known and not (self.steady and moment.factor == known.factor):
            forces = self._compute(moment)
            self._known = moment, forces
        return forces

    def _compute(self, moment: Moment) -> Values:
        return self._spread.integrate(self._value.at(moment)) if self._unit is None else moment.factor * self._unit

    def potential(self, u: Array, t: Time) -> float:
        """`-f(t) . u` [J]."""
        return -float(np.einsum("ic,ic", self.forces(t), u[self._at]))  # not by BLAS, whose threads wait for ours

    def add_force(self, u: Array, t: Time, out: Array) -> None:
        """Add the forces [N] to `out` (nv, d)."""
        out[self._at] += self.forces(t)

    def places(self, pattern: Places) -> None:
        """It has no stiffness."""

    def add_stiffness(self, u: Array, t: Time, places: None, data: Array) -> None:
        """It has no stiffness."""

    def memory(self) -> dict[str, int]:
        """Bytes of what there is now, by part."""
        return {"loads": self._known[1].nbytes}
