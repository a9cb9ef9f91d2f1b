import numpy as np
import pytest
from bodies import MESHES, state

from skfem_stvk import StVK, System
from skfem_stvk.referee.exact import ExactStVK

TERM = StVK(young=2.0, poisson=0.3)


@pytest.mark.parametrize("name", MESHES)
def test_fifty_digits_agree_with_the_edge_form(name):
    mesh = MESHES[name]
    body, u, v = System(mesh, TERM), state(mesh), state(mesh, seed=8)
    lam, mu = (float(value) for value in TERM.material.lame(TERM.hypothesis(mesh)))
    W, F = ExactStVK(mesh.p, mesh.t, (lam, mu)).energy_and_force(u)
    Kv = ExactStVK(mesh.p, mesh.t, (lam, mu)).product(u, v)
    assert body.energy(u) == pytest.approx(W, rel=1e-13)
    assert np.abs(body.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert np.abs(body.tangent(u) @ v - Kv).max() < 1e-13 * np.abs(Kv).max()


def test_fifty_digits_are_exact_where_doubles_are_not():
    """A uniaxial stretch by 1e-12 has the stress (lam + 2 mu) (1e-12 + ...) to all digits of a double, on a unit tetrahedron."""
    p, t = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), np.arange(4)[:, None]
    u = np.zeros(12)
    u[3] = 1e-12
    _, F = ExactStVK(p, t, (1.5, 1.0)).energy_and_force(u)
    e = 1e-12
    assert F[3] == pytest.approx(3.5 / 6 * (e + 1.5 * e**2), rel=1e-15)
