"""Matrices for the solvers: small bodies of every dimension, supported at one end."""

import numpy as np
import skfem
from bodies import distorted, turned_round

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.linear import Unknowns


def body(name):
    """Return a body with distorted coordinates, both orientations and nu != 0, longer than thick."""
    rng = np.random.default_rng(1)
    lines = [np.linspace(0, 2, 9), np.linspace(0, 1, 5), np.linspace(0, 1, 4)]
    if name == "cable":
        s = np.linspace(0, 1, 120) ** 1.2
        return System(ElementMesh(s[None], np.stack([np.arange(119), np.arange(1, 120)])), StVK(young=2.0, poisson=0.3))
    mesh = skfem.MeshTri.init_tensor(*lines[:2]) if name in ("sheet", "membrane") else skfem.MeshTet.init_tensor(*lines)
    p = distorted(mesh.p, rng, 0.1)
    if name == "membrane":
        p = np.stack([*p, 0.3 * np.sin(p[0]) + 0.2 * p[1] ** 2])
    young = np.where(p[0][mesh.t].mean(axis=0) > 1, 1e4, 1.0) if name == "soft and stiff" else 2.0
    return System(ElementMesh(p, turned_round(mesh.t, rng)), StVK(young=young, poisson=0.45 if name == "box" else 0.3))


NAMES = ("box", "soft and stiff", "sheet", "membrane", "cable")


def supported(system):
    """Return the unknowns of a body with one end fixed, and sliding supports on a part of the rest of its boundary.

    So vertices have one, two or three unknowns.
    """
    p, d = system.mesh.p, system.mesh.d
    wall = np.flatnonzero(p[0] < np.quantile(p[0], 0.12))
    sliding = np.flatnonzero(p[-1] < np.quantile(p[-1], 0.1)) if d > 1 else []
    fixed = [*(d * v + c for v in wall for c in range(d)), *(d * v + d - 1 for v in sliding)]
    if system.mesh.k < d:  # a membrane has no transverse stiffness, so its normal component is constrained
        fixed += [d * v + d - 1 for v in range(system.mesh.nv)]
    return system.free_dofs(np.unique(fixed).astype(int))


def problem(name="box", amount=0.0):
    """Return K of a body stretched by `amount`, so that K stays positive definite, and its unknowns."""
    system = body(name)
    free, d = supported(system), system.mesh.d
    x = system.mesh.p.T
    u = amount * np.stack([(x[:, 0] - x[:, 0].min()) * (1, 0.3, -0.2)[c] for c in range(d)], axis=1)
    K = free.matrix(system.tangent(free.vector(u.ravel()[free.free])))
    modes = rigid_motions(system.mesh.p)[free.free]
    vertex, component = np.divmod(free.free, d)
    return K, Unknowns(vertex, component, K.indptr, K.indices, lambda: modes)


def rigid_motions(p):
    d, nv = p.shape
    x = (p - p.mean(axis=1, keepdims=True)).T
    modes = [np.tile(axis, (nv, 1)) for axis in np.eye(d)]
    for a in range(d):
        for b in range(a):
            rotation = np.zeros((nv, d))
            rotation[:, a], rotation[:, b] = -x[:, b], x[:, a]
            modes.append(rotation)
    return np.stack(modes, axis=2).reshape(d * nv, -1)


class Matrix:
    """K as the operator of matrix-free solvers."""

    def __init__(self, K, unknowns):
        self.K, d = K, unknowns.component.max() + 1
        dense = np.full((unknowns.vertex.max() + 1, d, d), np.nan)  # constrained components are not read
        coo = K.tocoo()
        own = unknowns.vertex[coo.row] == unknowns.vertex[coo.col]
        rows, columns = coo.row[own], coo.col[own]
        dense[unknowns.vertex[rows], unknowns.component[rows], unknowns.component[columns]] = coo.data[own]
        self.blocks = dense

    def matvec(self, v):
        return self.K @ v

    def diagonal_blocks(self):
        return self.blocks


def matrix_for(solver, K, unknowns):
    """Return K in the form that the solver accepts."""
    return Matrix(K, unknowns) if solver.matrix_free else K


def indefinite(K, unknowns, below=3):
    """Return K shifted so that exactly `below` of its eigenvalues are negative, with the same structure."""
    values = np.linalg.eigvalsh(K.toarray())
    shift = (values[below - 1] + values[below]) / 2
    shifted = K.copy()
    row = np.repeat(np.arange(K.shape[0]), np.diff(K.indptr))
    shifted.data[row == K.indices] -= shift
    return shifted
