"""Reduced body on its lowest vibration modes, projected from the full body at each call.

The class needs no precomputed coefficients. The class is slow and serves as a reference.
"""

import numpy as np
import skfem
from scipy.linalg import eigh

from skfem_stvk import Gravity, StVK, System, Traction
from skfem_stvk.system.coordinates import Coordinates

LOADS = (Traction(lambda x: x[0] > 1.99, (0.0, -40.0, 25.0)), Gravity((0.0, -3.0, 1.0)))


def bar(*more, prescribed=None, loads=LOADS):
    """Return a small bar with thick and thin elements, clamped at one end."""
    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 2, 5) ** 1.1 / 2**0.1, np.array([0.0, 0.3, 0.5]), np.array([0.0, 0.25]))
    material = StVK(young=2e3, poisson=0.3, density=3.0)
    return System(mesh, [material, *loads, *more], fixed={lambda x: x[0] == 0: "xyz"}, prescribed=prescribed)


def column(load):
    """Return a strip of boxes that is symmetric about its axis and buckles."""
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 2, 11), np.array([-0.1, 0.0, 0.1]))
    terms = [StVK(young=2e3, poisson=0.3, density=3.0), Traction(lambda x: x[0] > 1.99, (-load, 0.0))]
    return System(mesh, terms, fixed={lambda x: x[0] == 0: "xy"})


class OnModes(Coordinates):
    """Coordinates of `u = V q + Phi s` with `size` modes, by default all.

    `Phi` has one unit displacement for each prescribed degree of freedom.
    """

    quartic = True
    in_coordinates = property(lambda self: self)

    def __init__(self, body, size=None):
        self.body = body
        held, moving = body.supports.held, body.supports.prescribed
        free = np.setdiff1d(np.arange(body.ndofs), held)
        size = len(free) if size is None else size
        m = np.repeat(body.mass().vertex, body.mesh.d)
        K = body.tangent(np.zeros(body.ndofs)).toarray()
        V, Phi = np.zeros((body.ndofs, size)), np.zeros((body.ndofs, len(moving)))
        V[free] = eigh(K[np.ix_(free, free)], np.diag(m[free]))[1][:, :size]
        Phi[moving, np.arange(len(moving))] = 1
        Phi[free] = -np.linalg.solve(K[np.ix_(free, free)], K[np.ix_(free, moving)])
        Phi -= V @ (V.T @ (m[:, None] * Phi))
        super().__init__(body, np.hstack([V, Phi]), size, m)
        self._moving = np.searchsorted(held, moving)
        self.count = 0

    def prescribed_values(self, t):
        return self.body.supports.values(t)[self._moving]

    def response(self, z):
        self.count += 1
        u, B = self.columns @ z, self.columns
        energy, force = self.body.energy_and_force(u)
        return energy, force @ B, B.T @ (self.body.tangent(u) @ B)

    def energy_along(self, z, v):
        return self.body.energy_along(self.columns @ z, self.columns @ v)

    def external_force(self, z, t):
        return self.body.external_force(self.columns @ z, t) @ self.columns

    def load_stiffness(self, z, t):
        u, B = self.columns @ z, self.columns
        return None if self.body.dead else B.T @ ((self.body.jacobian(u, t) - self.body.tangent(u)) @ B)

    def __repr__(self):
        return f"{self.size} modes of {self.body!r}"
