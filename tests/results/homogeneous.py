"""Homogeneous states for the tests of this folder."""

import numpy as np
from bodies import MESHES

from skfem_stvk import StVK
from skfem_stvk.mesh.geometry import Geometry
from skfem_stvk.results import Fields

YOUNG, POISSON = 1.7, 0.3
LAM = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
MU = YOUNG / (2 * (1 + POISSON))


def affine(mesh, F):
    """Return the displacements of x = F X."""
    return ((np.asarray(F)[: mesh.d, : mesh.d] - np.eye(mesh.d)) @ mesh.p).ravel("F")


def homogeneous(name, F, **term):
    mesh = MESHES[name]
    return Fields(mesh, StVK(young=YOUNG, poisson=POISSON, **term)).at(affine(mesh, F))


def rotation(axis, angle):
    """Return the rotation matrix about an axis (3,)."""
    a = np.asarray(axis) / np.linalg.norm(axis)
    K = np.cross(np.eye(3), -a)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def gradients(p, t):
    """Return the gradients (nt, k + 1, d) of the shape functions of simplices at coordinates `p` (d, nv)."""
    geometry = Geometry(p, t)
    return np.einsum("ndk,nak->nad", geometry.axes, geometry.gradients)


def forces(mesh, stress, gradients, volume):
    """Return nodal forces `sum of V stress . grad N_a` (ndofs,)."""
    local = volume[:, None, None] * np.einsum("nij,naj->nai", np.asarray(stress)[:, : mesh.d, : mesh.d], gradients)
    total = np.zeros((mesh.nv, mesh.d))
    np.add.at(total, mesh.t.T, local)
    return total.ravel()
