"""The edge form: sums of the energy, the matrix L, and tensions."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state

from skfem_stvk import StVK

TERM = StVK(young=2.0, poisson=0.3)


@pytest.mark.parametrize("name", MESHES)
def test_three_sums_of_the_energy_agree(name):
    """The sums are eq. 12 (all pairs), eq. 14 (springs plus pairs) and the sum over simplices."""
    mesh = MESHES[name]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, mesh.d)
    form = assembly.form
    x = mesh.p.T + u
    zeta = ((x[form.edges[0]] - x[form.edges[1]]) ** 2).sum(axis=1) - (form.P**2).sum(axis=1)
    i, j = form.pairs
    all_pairs = zeta @ form.L @ zeta / 4
    springs_and_pairs = form.L.diagonal() @ zeta**2 / 4 + (form.L.toarray()[i, j] @ (zeta[i] * zeta[j])) / 2
    simplices = np.einsum("te,tef,tf->", zeta[form.t2e].T, TERM.coefficients(mesh), zeta[form.t2e].T) / 4
    for energy in (all_pairs, springs_and_pairs, simplices):
        assert energy == pytest.approx(assembly.energy_and_force(u, np.zeros_like(u)), rel=1e-12)


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_L_is_symmetric_to_the_last_digit(name):
    mesh, terms = BODIES[name]
    L = terms[0].bind(mesh).form.L
    assert abs(L - L.T).max() == 0


@pytest.mark.parametrize("name", MESHES)
def test_tension_is_the_projection_of_the_second_piola_kirchhoff_stress(name):
    """`t_ab = -sum V g_a . S g_b`, here for one simplex."""
    from skfem_stvk import ElementMesh
    from skfem_stvk.mesh.geometry import Geometry

    mesh = MESHES[name]
    one = ElementMesh(mesh.p[:, mesh.t[:, 3]], np.arange(mesh.k + 1)[:, None])
    geometry = Geometry(one.p, one.t)
    lam, mu = TERM.material.lame(TERM.hypothesis(one))
    u = state(one, 0.2).reshape(-1, one.d)
    F = geometry.axes[0] + u.T @ geometry.gradients[0]
    E = (F.T @ F - np.eye(one.k)) / 2
    S = lam * np.trace(E) * np.eye(one.k) + 2 * mu * E
    form = TERM.bind(one).form
    tension, (a, b) = form.tensions(u), form.edges
    expected = -geometry.volume[0] * np.einsum("ei,ij,ej->e", geometry.gradients[0][a], S, geometry.gradients[0][b])
    assert np.allclose(tension, expected, rtol=1e-11, atol=1e-13)


def test_small_strains_keep_all_digits():
    """`|p|^2 - |P|^2` would keep 8 digits."""
    from skfem_stvk.referee.exact import ExactStVK

    mesh = MESHES["tetrahedra"]
    u = state(mesh, 1e-8)
    lam, mu = (float(value) for value in TERM.material.lame(TERM.hypothesis(mesh)))
    W, F = ExactStVK(mesh.p, mesh.t, (lam, mu)).energy_and_force(u)
    force = np.zeros((mesh.nv, 3))
    assert TERM.bind(mesh).energy_and_force(u.reshape(-1, 3), force) == pytest.approx(W, rel=1e-13)
    assert np.abs(force.ravel() - F).max() < 1e-13 * np.abs(F).max()
