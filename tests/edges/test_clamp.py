"""Tangents without compression of elements other than linear simplices use eigenvalues of S at the points, by sign."""

import numpy as np
import pytest
import skfem
from slow import slow

from skfem_stvk import Orthotropic, StVK, System
from skfem_stvk.edges import ALL, NONE, TENSILE, Tensions
from skfem_stvk.mesh import ElementMesh

CUBE = [np.linspace(0, 1, 3)] * 3
WOOD = Orthotropic(young=(1.0, 0.8, 0.6), poisson=(0.3, 0.2, 0.25), shear=(0.3, 0.4, 0.35))
MESHES = {
    "quadratic tetrahedra": ElementMesh.of(skfem.MeshTet.init_tensor(*CUBE)).with_degree(2),
    "quadratic triangles": ElementMesh.of(skfem.MeshTri().refined(2)).with_degree(2),
    "hexahedra": ElementMesh.of(skfem.MeshHex.init_tensor(*CUBE)),
}
MATERIALS = {"isotropic": {"young": 1.0, "poisson": 0.3}, "orthotropic": {"material": WOOD}}


@pytest.mark.few
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("name", MESHES)
def test_the_clamped_tangent_is_semi_definite_and_exact_in_tension(name, material):
    mesh = MESHES[name]
    body = System(mesh, StVK(**MATERIALS[material]))
    noise = 0.02 * np.random.default_rng(0).normal(size=mesh.p.shape)
    pulled, pushed = ((amount * mesh.p + noise * abs(amount)).ravel("F") for amount in (0.2, -0.2))
    scale = abs(body.tangent(pulled)).max()
    assert abs(body.jacobian(pulled, kept=TENSILE) - body.tangent(pulled)).max() < 1e-14 * scale
    assert np.linalg.eigvalsh(body.tangent(pushed).toarray())[0] < -0.01 * scale
    assert np.linalg.eigvalsh(body.jacobian(pushed, kept=TENSILE).toarray())[0] > -1e-13 * scale


@pytest.mark.parametrize("dtype", [np.float64, slow(np.float32)])
def test_signs_of_eigenvalues_have_factors(dtype):
    """K = 2 J'LJ + positive part + negative part; each part is multiplied by its factor."""
    mesh = MESHES["quadratic tetrahedra"]
    body = System(mesh, StVK(young=1.0, poisson=0.3), dtype=dtype)
    u = 0.1 * np.random.default_rng(1).normal(size=body.ndofs)
    part = {kept: body.jacobian(u, kept=kept).toarray().astype(float) for kept in (ALL, TENSILE, NONE, Tensions(0.0, 1.0))}
    scale, limit = np.abs(part[ALL]).max(), 1e-14 if dtype == np.float64 else 1e-6
    assert np.abs(part[TENSILE] + part[Tensions(0.0, 1.0)] - part[NONE] - part[ALL]).max() < limit * scale
    mixed = body.jacobian(u, kept=Tensions(0.7, 0.2)).toarray()
    expected = part[NONE] + 0.7 * (part[TENSILE] - part[NONE]) + 0.2 * (part[Tensions(0.0, 1.0)] - part[NONE])
    assert np.abs(mixed - expected).max() < limit * scale
    assert np.abs(part[TENSILE] - part[NONE]).max() > 0.01 * scale < np.abs(part[TENSILE] - part[ALL]).max()
