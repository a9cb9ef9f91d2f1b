"""The reference equals an independent form of the kind that scikit-fem's users write, and closed forms."""

import numpy as np
import pytest
import skfem
from bodies import MESHES, random_frames, some_voigt, state
from skfem.helpers import ddot, eye, grad, identity, mul, trace, transpose

from skfem_stvk.referee.reference import ReferenceStVK, anisotropic_tensor, isotropic_tensor, simplex_axes


def test_the_reference_is_the_textbook_form_at_default_quadrature():
    mesh, lam, mu = MESHES["tetrahedra"], 1.5, 1.0
    young, poisson = mu * (3 * lam + 2 * mu) / (lam + mu), lam / (2 * (lam + mu))
    reference = ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(young, poisson, 3, condensed=False))
    basis = skfem.Basis(skfem.MeshTet1(mesh.p, mesh.t), skfem.ElementVector(skfem.ElementTetP1()))
    u = state(mesh)

    def kinematics(w):
        F = grad(w["u"]) + identity(grad(w["u"]))
        E = 0.5 * (mul(transpose(F), F) - identity(F))
        return F, lam * eye(trace(E), 3) + 2 * mu * E

    @skfem.LinearForm
    def force(v, w):
        F, S = kinematics(w)
        return ddot(mul(F, S), grad(v))

    @skfem.BilinearForm
    def tangent(du, v, w):
        F, S = kinematics(w)
        dE = 0.5 * (mul(transpose(F), grad(du)) + mul(transpose(grad(du)), F))
        dS = lam * eye(trace(dE), 3) + 2 * mu * dE
        return ddot(mul(grad(du), S) + mul(F, dS), grad(v))

    F, K = force.assemble(basis, u=basis.interpolate(u)), tangent.assemble(basis, u=basis.interpolate(u))
    assert np.abs(reference.internal_force(u) - F).max() < 1e-13 * np.abs(F).max()
    assert abs(reference.tangent(u) - K).max() < 1e-13 * abs(K).max()


def test_a_rotated_tensor_has_the_rotated_strain_energy():
    rng = np.random.default_rng(0)
    C, frame = some_voigt(rng), random_frames(1, rng)[0]
    strain = rng.standard_normal((3, 3))
    strain = strain + strain.T
    own = frame.T @ strain @ frame  # components in material axes
    voigt = np.array([own[0, 0], own[1, 1], own[2, 2], 2 * own[1, 2], 2 * own[0, 2], 2 * own[0, 1]])
    tensor = anisotropic_tensor(C, frame, np.eye(3)[None], condensed=False)[0]
    assert np.einsum("ij,ijkl,kl->", strain, tensor, strain) == pytest.approx(voigt @ C @ voigt, rel=1e-12)


@pytest.mark.parametrize("k", [1, 2])
def test_condensation_finds_the_smallest_energy(k):
    """The condensed energy, at zero stress across the simplex, is the smallest over all strains across the simplex."""
    rng = np.random.default_rng(0)
    C = some_voigt(rng)
    axes = random_frames(1, rng)[:, :, :k]
    tensor = anisotropic_tensor(C, None, axes, condensed=True)[0]
    within = rng.standard_normal((k, k))
    within = within + within.T
    least = np.einsum("ij,ijkl,kl->", within, tensor, within)
    full = anisotropic_tensor(C, None, np.concatenate([axes, _rest(axes)], axis=2), condensed=False)[0]
    for _ in range(200):
        strain = rng.standard_normal((3, 3))
        strain = strain + strain.T
        strain[:k, :k] = within
        assert np.einsum("ij,ijkl,kl->", strain, full, strain) >= least * (1 - 1e-12)


def _rest(axes):
    return np.linalg.qr(axes, mode="complete")[0][:, :, axes.shape[2] :]


def test_axes_are_orthonormal_and_span_the_simplices():
    for mesh in MESHES.values():
        axes = simplex_axes(mesh.p, mesh.t)
        assert np.allclose(np.swapaxes(axes, 1, 2) @ axes, np.eye(mesh.k))
        vectors = (mesh.p[:, mesh.t[1]] - mesh.p[:, mesh.t[0]]).T
        inside = np.einsum("nij,nkj,nk->ni", axes, axes, vectors)
        assert np.allclose(inside, vectors)
