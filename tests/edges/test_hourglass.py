"""Boxes with one point agree with NumPy's formulas of mean gradients and of hourglass control.

Mean gradients are zero in hourglass modes, so these modes need a control.
"""

import numpy as np
import pytest
import skfem
from scipy.spatial.transform import Rotation
from skfem.quadrature import get_quadrature
from skfem.refdom import RefHex, RefQuad
from slow import slow

from skfem_stvk import StVK, System
from skfem_stvk.edges import NONE
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


def energies(mesh, u, hourglass):
    """Return W and the energy of hourglass modes, element by element."""
    x, X, W, W_h = u.reshape(-1, mesh.d), mesh.p.T, 0.0, 0.0
    element, xi = mesh.element, get_quadrature(RefHex if mesh.d == 3 else RefQuad, 5)
    signs = 2 * element.nodes - 1
    modes = [signs[:, 0] * signs[:, 1]]
    if mesh.d == 3:
        modes += [signs[:, 1] * signs[:, 2], signs[:, 2] * signs[:, 0], signs.prod(axis=1)]
    for nodes in mesh.t.T:
        base_vectors = np.einsum("qai,ad->qid", element.derivatives(xi[0].T), X[nodes])
        dV = xi[1] * np.abs(np.linalg.det(base_vectors))
        g = np.einsum("qai,qdi,q->ad", element.derivatives(xi[0].T), np.linalg.inv(base_vectors), dV) / dV.sum()
        H = x[nodes].T @ g
        E = (H + H.T + H.T @ H) / 2
        W += dV.sum() * (LAM / 2 * np.trace(E) ** 2 + MU * (E**2).sum())
        gamma = [h - g @ (X[nodes].T @ h) for h in modes]
        c = hourglass / 16 * (LAM + 2 * MU) * dV.sum() * (g**2).sum()
        W_h += c * sum(((k @ x[nodes]) ** 2).sum() for k in gamma)
    return W, W_h


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("hourglass", [0.0, 0.05, 0.4])
def test_the_energy_is_that_of_the_formula(name, hourglass):
    mesh, system = MESHES[name], body(name, hourglass=hourglass)
    u = 0.2 * np.random.default_rng(1).normal(size=system.ndofs)
    W, W_h = energies(mesh, u, hourglass)
    assert system.energy(u) == pytest.approx(W + W_h, rel=1e-13)
    assert (W_h > 1e-4 * W) == (hourglass > 0)


@pytest.mark.parametrize("d", [2, 3])
def test_the_stiffness_of_a_mode_is_that_of_the_literature(d):
    """Bending of a square or cube with the side h: `u_x = a` at half of the nodes, `-a` at the others.

    With all points, the energy is `2/3 (lam + 3 mu) h^(d-2) a^2`. With one point, it is `(2 or 6) hourglass (lam + 2 mu) h^(d-2)
    a^2`. The signs of Flanagan and Belytschko are +-1, and `gamma' u` is 4 or 8 a. So 0.05 gives about an eighth of the energy with
    all points in the plane, and two fifths in space.
    """
    h, a, hourglass = 0.5, 1e-4, 0.05
    mesh = (skfem.MeshQuad if d == 2 else skfem.MeshHex)().scaled(h)
    u = np.zeros((mesh.nvertices, d))
    u[:, 0] = a * np.prod(np.sign(mesh.p[:2] - h / 2), axis=0)
    material = StVK(young=YOUNG, poisson=POISSON)
    own = [System(mesh, material, **more).energy(u.ravel()) for more in ({}, {"quadrature": "one-point", "hourglass": hourglass})]
    assert own[0] == pytest.approx(2 / 3 * (LAM + 3 * MU) * h ** (d - 2) * a**2, rel=1e-3)
    assert own[1] == pytest.approx({2: 2, 3: 6}[d] * hourglass * (LAM + 2 * MU) * h ** (d - 2) * a**2, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.float64, slow(np.float32)])
@pytest.mark.parametrize("name", MESHES)
def test_force_and_tangent_are_derivatives_of_a_quartic(name, dtype):
    """Five points along a line give the derivatives of a quartic, and of its cubic force, to rounding."""
    system, rng = body(name, hourglass=0.3), np.random.default_rng(2)
    u, v = 0.1 * rng.normal(size=(2, system.ndofs))
    weights, at = np.array([1, -8, 8, -1]) / 12, (-2, -1, 1, 2)
    slope = sum(w * system.energy(u + s * v) for w, s in zip(weights, at, strict=True))
    bend = sum(w * system.internal_force(u + s * v) for w, s in zip(weights, at, strict=True))
    own = body(name, hourglass=0.3, dtype=dtype)
    limit = 1e-13 if dtype == np.float64 else 1e-5
    scale = np.abs(bend).max()
    assert own.internal_force(u) @ v == pytest.approx(slope, rel=10 * limit)
    assert np.abs(own.tangent(u) @ v - bend).max() < limit * scale
    assert np.abs(own.product(u, v) - bend).max() < limit * scale
    assert abs(own.tangent(u) - own.tangent(u).T).max() < limit * scale
    bound = own.bound_terms[0]
    c = bound.along(u.reshape(-1, system.mesh.d), v.reshape(-1, system.mesh.d))
    assert np.polyval(c[::-1], 1.7) == pytest.approx(system.energy(u + 1.7 * v), rel=limit)


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


@pytest.mark.parametrize("name", MESHES)
def test_modes_without_energy_exist_only_without_control(name):
    rigid = 3 if MESHES[name].d == 2 else 6
    zeros = [
        int((np.abs(np.linalg.eigvalsh(body(name, hourglass=h).tangent(np.zeros(MESHES[name].p.size)).toarray())) < 1e-12).sum())
        for h in (0.0, 0.05)
    ]
    assert zeros[0] > zeros[1] == rigid


@pytest.mark.parametrize("name", [slow("hexahedra"), "quadrilaterals"])
def test_work_over_a_step_and_damping_agree_with_the_energy(name):
    system, rng = body(name, hourglass=0.3), np.random.default_rng(5)
    u, v = 0.1 * rng.normal(size=(2, system.mesh.nv, system.mesh.d))
    bound, mean, damping = system.bound_terms[0], np.zeros_like(u), np.zeros_like(u)
    bound.mean_force(u, u + v, (0.5, 0.5), 0.5, mean)
    assert (mean * v).sum() == pytest.approx(system.energy((u + v).ravel()) - system.energy(u.ravel()), rel=1e-12)
    R = bound.damping_force(u, v, damping)
    assert (damping * v).sum() == pytest.approx(2 * R, rel=1e-13)
    np.testing.assert_allclose(
        damping.ravel(), system.jacobian(u.ravel(), kept=NONE) @ v.ravel(), atol=1e-13 * np.abs(damping).max()
    )
    sizes = np.zeros_like(u)
    bound.add_round_off(u, sizes)
    assert (sizes >= np.abs(system.internal_force(u.ravel()).reshape(u.shape))).all()


def test_one_point_is_refused_for_other_elements_and_negative_control():
    tets = skfem.MeshTet().refined(1)
    with pytest.raises(StvkError, match="hexahedra"):
        System(tets, StVK(young=1.0, poisson=0.3), quadrature="one-point")
    with pytest.raises(StvkError, match="hourglass"):
        System(tets, StVK(young=1.0, poisson=0.3), hourglass=0.05)
    with pytest.raises(StvkError, match="zero or more"):
        body("hexahedra", hourglass=-1.0)
