"""Coefficients of edges and pairs of edges agree with published values and closed forms."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, random_frames, some_voigt

from skfem_stvk import Anisotropic, ElementMesh, Isotropic, StVK
from skfem_stvk.edges.materials import Hypothesis
from skfem_stvk.edges.topology import LOCAL_EDGES

REGULAR = ElementMesh(
    p=np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(3) / 2, 0], [0.5, np.sqrt(3) / 6, np.sqrt(2 / 3)]]).T, t=[[0], [1], [2], [3]]
)


@pytest.mark.parametrize(
    ("poisson", "own", "adjacent", "opposite"),
    [
        (0.0, 0.0737, -0.0147, 0.0147),
        (0.25, 0.0648, -0.0059, 0.0177),
        (0.3, 0.0652, -0.0028, 0.0198),
        (0.4, 0.0737, 0.0105, 0.0316),
        (0.49, 0.2917, 0.2323, 0.2521),
    ],
)
def test_the_regular_tetrahedron_has_the_published_coefficients(poisson, own, adjacent, opposite):
    form = StVK(young=1.0, poisson=poisson).bind(REGULAR).form
    L = form.L.toarray()
    assert np.allclose(np.diag(L), own, atol=5e-5)
    assert np.allclose(L[tuple(form.pairs[:, form.adjacent])], adjacent, atol=5e-5)
    assert np.allclose(L[tuple(form.pairs[:, ~form.adjacent])], opposite, atol=5e-5)


@pytest.mark.parametrize("plane", [None, "stress"])
@pytest.mark.parametrize("name", ["triangles", "membrane"])
def test_triangles_have_delingettes_cotangent_coefficients(name, plane):
    """In the plane the default is plane strain, with plane stress as an option; in space, membranes are in plane stress."""
    mesh, young, poisson, h = MESHES[name], 2.0, 0.3, 0.7
    if name == "membrane":
        plane = None
    L = StVK(young=young, poisson=poisson, plane=plane, thickness=h).coefficients(mesh)
    G = young / (2 * (1 + poisson))
    lam = young * poisson / (1 - poisson**2) if plane == "stress" or name == "membrane" else 2 * G * poisson / (1 - 2 * poisson)
    x = mesh.p.T[mesh.t.T]
    cotangents, areas = [], None
    for a, b in LOCAL_EDGES[2]:
        c = 3 - a - b
        u, v = x[:, a] - x[:, c], x[:, b] - x[:, c]
        cross = np.sqrt((u**2).sum(axis=1) * (v**2).sum(axis=1) - (u * v).sum(axis=1) ** 2)
        cotangents.append((u * v).sum(axis=1) / cross)
        areas = cross / 2
    c = np.stack(cotangents, axis=1)
    expected = (lam + 2 * G) * c[:, :, None] * c[:, None, :] - G
    expected[:, range(3), range(3)] += 2 * G
    assert np.allclose(L, h * expected / (8 * areas[:, None, None]), rtol=1e-12)


def test_equilateral_triangles_at_one_third_in_plane_stress_are_a_spring_network():
    triangle = ElementMesh(p=[[0, 1, 0.5], [0, 0, np.sqrt(3) / 2]], t=[[0], [1], [2]])
    L = StVK(young=1.0, poisson=1 / 3, plane="stress").coefficients(triangle)[0]
    assert np.abs(L - np.diag(np.diag(L))).max() < 1e-15 * L.max()


def test_segments_have_half_the_axial_stiffness_over_the_length_cubed():
    mesh = MESHES["cable"]
    length = np.linalg.norm(mesh.p[:, mesh.t[0]] - mesh.p[:, mesh.t[1]], axis=0)
    L = StVK(young=3.0, area=0.2).coefficients(mesh)[:, 0, 0]
    assert np.allclose(L, 3.0 * 0.2 / (2 * length**3), rtol=1e-13)


def voigt_of(young, poisson):
    lam, mu = Isotropic(young, poisson).lame(Hypothesis.SOLID)
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    return C


@pytest.mark.few
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("plane", [None, "stress"])
def test_an_isotropic_matrix_in_any_frame_gives_the_isotropic_coefficients(name, plane):
    mesh = MESHES[name]
    if plane and mesh.k != 2:
        plane = None
    frames = random_frames(mesh.nt, np.random.default_rng(0))
    isotropic = StVK(young=2.0, poisson=0.35, plane=plane).coefficients(mesh)
    general = StVK(Anisotropic(voigt_of(2.0, 0.35), frame=frames), plane=plane).coefficients(mesh)
    assert np.abs(isotropic - general).max() < 1e-13 * np.abs(isotropic).max()


def test_rotating_body_and_frame_together_changes_nothing():
    mesh, rng = MESHES["tetrahedra"], np.random.default_rng(0)
    C, (Q, frame) = some_voigt(rng), random_frames(2, rng)
    before = StVK(Anisotropic(C, frame=frame)).coefficients(mesh)
    after = StVK(Anisotropic(C, frame=Q @ frame)).coefficients(ElementMesh(Q @ mesh.p, mesh.t))
    assert np.abs(before - after).max() < 1e-12 * np.abs(before).max()
    other = StVK(Anisotropic(C, frame=frame)).coefficients(ElementMesh(Q @ mesh.p, mesh.t))
    assert np.abs(before - other).max() > 1e-3 * np.abs(before).max()


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_coefficients_are_symmetric_and_positive_semi_definite(name):
    mesh, terms = BODIES[name]
    for term in terms:
        L = term.coefficients(mesh)
        assert np.abs(L - np.swapaxes(L, 1, 2)).max() <= 1e-14 * np.abs(L).max()
        assert np.linalg.eigvalsh(L).min() > -1e-13 * np.abs(L).max()
        assert (np.diagonal(L, axis1=1, axis2=2) > 0).all()
