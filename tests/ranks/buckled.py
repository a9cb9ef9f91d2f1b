"""A strut that is compressed beyond its first three critical loads, in its straight state."""

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System


def strut():
    return ElementMesh.of(skfem.MeshTet.init_tensor(np.linspace(0, 10, 21), np.linspace(0, 1, 3), np.linspace(0, 1, 3)))


def compressed(mesh):
    pushed = {lambda x: x[0] > 10 - 1e-9: {"x": -1.0, "y": 0, "z": 0}}
    return System(mesh, StVK(young=1.0, poisson=0.0), fixed={lambda x: x[0] < 1e-9: "xyz"}, prescribed=pushed)
