"""Ratios of volumes, and detection of inverted simplices."""

from fractions import Fraction

import numpy as np
import pytest
from bodies import BODIES, MESHES, box, state

from skfem_stvk import ElementMesh, StVK
from skfem_stvk.kernels.lanes import LANES

TERM = StVK(young=2.0, poisson=0.3)


@pytest.mark.parametrize("name", MESHES)
def test_ratios_at_rest_are_one_for_both_orientations(name):
    """Ratios are one up to rounding, which depends on the compiler, and change their sign in a mirror image."""
    mesh = MESHES[name]
    assembly = TERM.bind(mesh)
    np.testing.assert_allclose(assembly.volume_ratios(np.zeros((mesh.nv, mesh.d))), 1, rtol=1e-15)
    mirrored = -2 * mesh.p.T * (np.arange(mesh.d) == 0)
    assert np.allclose(assembly.volume_ratios(mirrored), -1 if mesh.k == mesh.d else 1, rtol=1e-12)


@pytest.mark.parametrize("count", [1, LANES - 1, LANES, LANES + 1])
def test_an_inverted_element_is_found_at_any_index(count):
    whole = box(2)
    used, t = np.unique(whole.t[:, :count], return_inverse=True)
    mesh = ElementMesh(whole.p[:, used], t.reshape(4, -1))
    assembly = TERM.bind(mesh)
    for e in range(count):
        top, base = mesh.t[0, e], mesh.t[1:, e]
        u = np.zeros((mesh.nv, 3))
        u[top] = 1.2 * (mesh.p[:, base].mean(axis=1) - mesh.p[:, top])  # through the opposite facet
        found = assembly.volume_ratios(u)
        assert found[e] == pytest.approx(-0.2) and assembly.smallest_volume_ratio(u) == found.min() <= found[e]


def test_the_sign_is_right_for_slivers():
    """Signs of slivers of 1 : 1e10 agree with exact arithmetic.

    The slivers are rotated and moved so far that `X + u` would lose their thickness.
    """
    rng = np.random.default_rng(8)
    p = rng.random((3, 400))
    p[2] *= 1e-10
    mesh = ElementMesh(p, np.arange(400).reshape(4, 100))
    rotation = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    u = mesh.p.T @ (rotation.T - np.eye(3)) + 2.0**20 + 2e-11 * rng.standard_normal((400, 3)) * [[0, 0, 1]] @ rotation.T
    found = TERM.bind(mesh).volume_ratios(u)
    signs = []
    for corners in mesh.t.T:
        P = [[Fraction(value) for value in row] for row in mesh.p.T[corners].tolist()]
        x = [[a + Fraction(b) for a, b in zip(*pair, strict=True)] for pair in zip(P, u[corners].tolist(), strict=True)]
        signs.append(determinant(x) * determinant(P) > 0)
    assert 10 < sum(signs) < 90 and np.array_equal(found > 0, signs)


def determinant(x):
    (a, b, c), (d, e, f), (g, h, i) = [[v - w for v, w in zip(corner, x[0], strict=True)] for corner in x[1:]]
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


@pytest.mark.parametrize("name", ["tetrahedra, two regions", "membrane, anisotropic"])
def test_stretches_are_the_same_in_single_precision(name):
    mesh, terms = BODIES[name]
    u = state(mesh).reshape(-1, mesh.d)
    single, double = (terms[0].bind(mesh, dtype).volume_ratios(u) for dtype in (np.float32, np.float64))
    assert np.array_equal(single, double)
