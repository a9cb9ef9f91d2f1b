"""K, F and u have scikit-fem's format, so that its functions accept them unchanged."""

import numpy as np
import pytest
import scipy.sparse.linalg
import skfem

from skfem_stvk import StVK, System

MESH = skfem.MeshTet.init_tensor(np.linspace(0, 3, 7), *[np.linspace(0, 1, 3)] * 2).with_boundaries(
    {"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == 3}
)
BASIS = skfem.Basis(MESH, skfem.ElementVector(skfem.ElementTetP1()))
BODY = System(MESH, StVK(young=1e5, poisson=0.3))


def test_newton_with_condense_and_solve_reaches_equilibrium():
    f = np.zeros(BASIS.N)
    f[BASIS.nodal_dofs[2, MESH.nodes_satisfying(lambda x: x[0] == 3)]] = -3.0
    u, wall = np.zeros(BASIS.N), BASIS.get_dofs("wall")
    for _ in range(12):
        u += skfem.solve(*skfem.condense(BODY.tangent(u), f - BODY.internal_force(u), D=wall))
    free = BASIS.complement_dofs(wall)
    assert np.abs((BODY.internal_force(u) - f)[free]).max() < 1e-9
    assert u[BASIS.nodal_dofs[2]].min() < -0.01


def test_condense_accepts_K_for_eigenproblems():
    M = skfem.BilinearForm(lambda u, v, w: u[0] * v[0] + u[1] * v[1] + u[2] * v[2]).assemble(BASIS)
    K, M, *_ = skfem.condense(BODY.tangent(np.zeros(BASIS.N)), M, D=BASIS.get_dofs("wall"))
    values = scipy.sparse.linalg.eigsh(K, k=3, M=M, sigma=0.0, return_eigenvectors=False)
    assert values.min() > 0


def test_dofs_are_scikit_fems():
    values = BASIS.project(lambda x: np.array([x[0] * x[1], -x[2], 2 * x[0]]))
    x, y, z = MESH.p
    assert values.reshape(-1, 3) == pytest.approx(
        np.stack([x * y, -z, 2 * x], axis=1), abs=0.2
    )  # tests the order of the values, not the accuracy of the projection
    assert np.array_equal(BASIS.nodal_dofs, np.arange(BASIS.N).reshape(-1, 3).T)
