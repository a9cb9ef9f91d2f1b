"""Hourglass control of boxes with one point: mean gradients are zero in hourglass modes.

Energy, force and tangent are compared with the formulas of the continuum in `tests/kernels/test_continuum.py`.
"""

import numpy as np
import pytest
import skfem
from scipy.spatial.transform import Rotation

from skfem_stvk import StVK, System
from skfem_stvk.errors import StvkError
from skfem_stvk.mesh import ElementMesh

YOUNG, POISSON = 2.0, 0.3
LAM, MU = YOUNG * POISSON / (1.3 * 0.4), YOUNG / 2.6


def shaken(mesh, amount=0.05):
    p = mesh.p + amount * np.random.default_rng(0).normal(size=mesh.p.shape)
    t = mesh.t.copy()
    if len(p) == 3:  # one box has the other orientation
        t[:, 1] = t[[1, 0, 4, 5, 2, 3, 7, 6], 1]
    return ElementMesh.of(type(mesh)(p, t))


MESHES = {
    "hexahedra": shaken(skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 3)] * 3)),
    "quadrilaterals": shaken(skfem.MeshQuad().refined(2), 0.02),
}


def body(name, **more):
    return System(MESHES[name], StVK(young=YOUNG, poisson=POISSON), quadrature="one-point", **more)


@pytest.mark.parametrize("d", [2, 3])
def test_the_stiffness_of_a_mode_is_that_of_the_literature(d):
    """Bending of a square or cube with the side h: `u_x = a` at half of the nodes, `-a` at the others.

    With all points, the energy is `2/3 (lam + 3 mu) h^(d-2) a^2`. With one point, it is `(2 or 6) hourglass (lam + 2 mu) h^(d-2)
    a^2`. The signs of Flanagan and Belytschko are +-1, and `gamma' u` is 4 or 8 a. So 0.05 gives about an eighth of the energy with
    all points in the plane, and two fifths in space.
    """
    h, a, hourglass = 0.5, 1e-4, 0.4
    mesh = (skfem.MeshQuad if d == 2 else skfem.MeshHex)().scaled(h)
    u = np.zeros((mesh.nvertices, d))
    u[:, 0] = a * np.prod(np.sign(mesh.p[:2] - h / 2), axis=0)
    material = StVK(young=YOUNG, poisson=POISSON)
    own = [System(mesh, material, **more).energy(u.ravel()) for more in ({}, {"quadrature": "one-point", "hourglass": hourglass})]
    assert own[0] == pytest.approx(2 / 3 * (LAM + 3 * MU) * h ** (d - 2) * a**2, rel=1e-3)
    assert own[1] == pytest.approx({2: 2, 3: 6}[d] * hourglass * (LAM + 2 * MU) * h ** (d - 2) * a**2, rel=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_an_affine_displacement_passes_the_patch_test(name):
    """With mean gradients, the forces of a homogeneous strain balance inside; gradients at the centre have errors of some 1e-3."""
    mesh, system = MESHES[name], body(name)
    A = 0.2 * np.random.default_rng(3).normal(size=(mesh.d, mesh.d))
    force = system.internal_force((A @ mesh.p).ravel("F")).reshape(-1, mesh.d)
    inner = np.setdiff1d(np.arange(mesh.nv), mesh.surface)
    assert len(inner) and np.abs(force[inner]).max() < 1e-13 * np.abs(force).max()


@pytest.mark.parametrize("name", MESHES)
def test_hourglass_control_is_invariant_under_rigid_motions(name):
    mesh, system = MESHES[name], body(name, hourglass=0.4)
    R = Rotation.from_rotvec([0, 0, 1.1] if mesh.d == 2 else [0.3, -0.5, 1.1]).as_matrix()[: mesh.d, : mesh.d]
    u = 0.1 * np.random.default_rng(4).normal(size=(mesh.nv, mesh.d))
    rotated = (mesh.p.T + u) @ R.T + 1 - mesh.p.T
    assert system.energy(rotated.ravel()) == pytest.approx(system.energy(u.ravel()), rel=1e-12)
    force, other = (system.internal_force(x.ravel()).reshape(-1, mesh.d) for x in (u, rotated))
    np.testing.assert_allclose(other, force @ R.T, atol=1e-12 * np.abs(force).max())


def test_single_precision_agrees_with_double_and_round_off_is_bounded():
    system, single = (body("quadrilaterals", hourglass=0.3, dtype=dtype) for dtype in (np.float64, np.float32))
    u, sizes = 0.1 * np.random.default_rng(2).normal(size=system.ndofs), np.zeros((system.mesh.nv, 2))
    F, K = system.internal_force(u), system.tangent(u)
    assert 0 < np.abs(single.internal_force(u) - F).max() < 1e-5 * np.abs(F).max()
    assert 0 < abs(single.tangent(u) - K).max() < 1e-5 * abs(K).max()
    system.bound_terms[0].add_round_off(u.reshape(sizes.shape), sizes)
    assert (sizes.ravel() >= np.abs(F)).all()


@pytest.mark.parametrize("name", MESHES)
def test_modes_without_energy_exist_only_without_control(name):
    rigid = 3 if MESHES[name].d == 2 else 6
    zeros = [
        int((np.abs(np.linalg.eigvalsh(body(name, hourglass=h).tangent(np.zeros(MESHES[name].p.size)).toarray())) < 1e-12).sum())
        for h in (0.0, 0.05)
    ]
    assert zeros[0] > zeros[1] == rigid


def test_one_point_is_refused_for_other_elements_and_negative_control():
    tets = skfem.MeshTet().refined(1)
    with pytest.raises(StvkError, match="hexahedra"):
        System(tets, StVK(young=1.0, poisson=0.3), quadrature="one-point")
    with pytest.raises(StvkError, match="hourglass"):
        System(tets, StVK(young=1.0, poisson=0.3), hourglass=0.05)
    with pytest.raises(StvkError, match="zero or more"):
        body("hexahedra", hourglass=-1.0)
