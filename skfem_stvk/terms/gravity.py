"""Gravity, and whatever else accelerates all of a body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .body import Body
from .dead import DeadLoad
from .load import Load, Value
from .spread import Spread


@dataclass(frozen=True, eq=False)
class Gravity(Load):
    """Weight: `f_a = integral of rho N_a g dV`, with the densities of the materials.

    Parameters
    ----------
    g : acceleration [m/s^2]: components, which ramp with the load factor; or a function of t or of (x, t), taken as it is.

    Raises
    ------
    MaterialError
        when it is bound, if a material has no density.
    LoadError
        when it is bound, if `g` does not have one finite value a component.

    >>> import numpy as np, skfem
    >>> from skfem_stvk import StVK, System
    >>> cube = System(skfem.MeshTet(), [StVK(young=1.0, poisson=0.3, density=2700.0), Gravity(g=(0, 0, -9.81))])
    >>> cube.external_force(np.zeros(cube.ndofs)).reshape(-1, 3).sum(axis=0).round(6)
    array([     0.,      0., -26487.])
    """

    g: Any

    def bind(self, body: Body) -> DeadLoad:
        spread = Spread(body.mesh, body.mesh.t, body.mass)
        return DeadLoad(body.mesh, spread, Value(self.g, (body.mesh.d,), spread.x, "Gravity", name="g"))
