"""A toy peer: the referee's reference with the interface of a peer; it requires NumPy."""

from skfem_stvk.referee.peers import require
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor


class Toy:
    """W and F by scikit-fem's assembly."""

    name = "Toy"

    def __init__(self, p, t, young, poisson):
        self.version = require("Toy").__version__
        self._body = ReferenceStVK(p, t, isotropic_tensor(young, poisson, 3, condensed=False))

    def energy(self, u):
        return self._body.energy(u)

    def internal_force(self, u):
        return self._body.internal_force(u)
