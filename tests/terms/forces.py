"""Common helpers of load tests: a quadrature that is exact for quadratics, the force of a load, and its stiffness."""

import numpy as np

from skfem_stvk.edges.pairs import AccumulatedBlocks
from skfem_stvk.system.pattern import Pattern


def quadrature(m):
    """Return barycentric coordinates (q, m) of points with equal weights on a simplex of m vertices, exact for quadratics."""
    beta = (1 - 1 / np.sqrt(m + 1)) / m
    return beta + (1 - m * beta) * np.eye(m)


def integral(p, simplices, sizes, integrand):
    """Return the integral of `integrand(x (d, n)) -> (c, n)` over simplices (m, n) of the given sizes, (c,)."""
    corners = p[:, simplices]
    values = [integrand(np.einsum("m,dmn->dn", point, corners)) for point in quadrature(len(simplices))]
    return np.mean(values, axis=0) @ sizes


def moment(x, f):
    """Return the sum of `x f' - f x'` for `x` and `f` (d, n): all components of the moment in any dimension, (d, d)."""
    return x @ f.T - f @ x.T


def force(load, mesh, u=None, t=1.0):
    """Return the external force (d, nv) at displacements `u` (nv, d)."""
    out = np.zeros((mesh.nv, mesh.d))
    load.add_force(np.zeros_like(out) if u is None else u, t, out)
    return out.T


def stiffness(load, mesh, u, t=1.0):
    """Return the dense stiffness `-df/du` of the load, (ndofs, ndofs)."""
    if load.dead:
        return np.zeros((mesh.p.size, mesh.p.size))
    pattern, of = Pattern(mesh.nv, mesh.d, [load.nodes_paired]), AccumulatedBlocks(load, mesh.nv, mesh.d, np.float64)
    K = pattern.matrix(np.zeros(pattern.nnz))
    of.add_stiffness(u, t, of.pairs.rows(pattern), K.data)
    return K.toarray()
