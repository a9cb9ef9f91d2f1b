"""Strains and stretches are consistent with each other, accurate at small strain, and equal to closed forms."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, state
from homogeneous import affine, homogeneous, rotation
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk import ElementMesh, Gravity, StateError, StVK, StvkError
from skfem_stvk.mesh.geometry import Geometry
from skfem_stvk.results import Fields, names
from skfem_stvk.results.law_on_elements import current_normals, rest_frames


def at(name, amount=0.03):
    mesh, terms = BODIES[name]
    return Fields(mesh, terms).at(state(mesh, amount))


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_right_cauchy_green_tensor_is_one_plus_twice_the_strain(name):
    now = at(name)
    F, E = np.asarray(now["deformation_gradient"]), np.asarray(now["green_strain"])
    assert F.shape == E.shape == (now.fields.mesh.nt, 3, 3)
    assert np.abs(np.swapaxes(F, 1, 2) @ F - np.eye(3) - 2 * E).max() < 1e-13
    assert np.allclose(np.prod(now["principal_stretches"], axis=1), np.abs(now["volume_ratio"]), rtol=1e-12)
    assert (np.diff(now["principal_stretches"], axis=1) <= 0).all()


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_the_deformation_gradient_maps_rest_edges_to_current_edges(name):
    now = at(name)
    mesh = now.fields.mesh
    rest, moved = np.zeros((2, mesh.k, mesh.nt, 3))
    for edges, x in ((rest, mesh.p.T), (moved, mesh.p.T + now.u)):
        edges[:, :, : mesh.d] = x[mesh.t[1:]] - x[mesh.t[:1]]
    assert np.allclose(np.einsum("nij,knj->kni", now["deformation_gradient"], rest), moved, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["tetrahedra", "triangles", "segments"])
def test_the_volume_ratio_is_positive_for_the_orientation_at_rest(name):
    mesh = MESHES[name]
    signed = np.linalg.det((mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]).T)
    assert (signed < 0).any() or mesh.k == 1
    for F in (np.diag([1.1, 0.9, 0.8]), np.diag([-1.1, 0.9, 0.8])):
        now = homogeneous(name, F)
        within = np.linalg.det(F[: mesh.k, : mesh.k])
        across = 1.0 if mesh.k > 1 else 1 - 0.3 * (1.1**2 - 1)
        assert np.allclose(now["volume_ratio"], within * across, rtol=1e-12)


@pytest.mark.parametrize("name", MESHES)
def test_strain_does_not_cancel_at_small_displacements_far_from_the_origin(name):
    mesh = MESHES[name]
    far = ElementMesh(mesh.p + 1024.0, mesh.t)  # coordinates are exact, so that only the strain could lose digits
    far = ElementMesh(np.round(far.p * 2**30) / 2**30, mesh.t)
    near = ElementMesh(far.p - 1024.0, mesh.t)
    u = 1e-11 * state(mesh)
    term = StVK(young=2.0, poisson=0.3)
    here, there = (Fields(m, term).at(u)["green_strain"] for m in (near, far))
    assert np.abs(here - there).max() < 1e-13 * np.abs(here).max()
    rows = near.p[:, mesh.t]
    edge, change = rows[:, 1] - rows[:, 0], u.reshape(-1, mesh.d).T[:, mesh.t[1]] - u.reshape(-1, mesh.d).T[:, mesh.t[0]]
    direction = np.zeros((mesh.nt, 3))
    direction[:, : mesh.d] = edge.T
    stretched = ((edge + change / 2) * change).sum(axis=0)  # half the squared elongation
    assert np.allclose(
        np.einsum("ni,nij,nj->n", direction, here, direction), stretched, rtol=1e-10, atol=1e-14 * np.abs(stretched).max()
    )


@pytest.mark.parametrize("name", MESHES)
def test_a_rigid_motion_leaves_no_strain_and_the_rotation_as_deformation_gradient(name):
    mesh = MESHES[name]
    Q = {1: np.eye(3), 2: rotation([0, 0, 1], 2.5), 3: rotation([1, -2, 0.5], 2.5)}[mesh.d]
    now = homogeneous(name, Q)
    assert np.abs(now["green_strain"]).max() < 1e-14
    assert np.allclose(now["volume_ratio"], 1, rtol=1e-13)
    if mesh.k > 1 or mesh.d < 3:  # a segment in space does not determine the rotation about its axis
        assert np.allclose(now["deformation_gradient"], Q, rtol=0, atol=1e-13)


def test_plane_strain_has_no_stretch_across():
    now = homogeneous("triangles", np.diag([1.3, 0.8, 1]))
    assert np.allclose(now["deformation_gradient"], np.diag([1.3, 0.8, 1]), rtol=0, atol=1e-14)
    assert np.allclose(now["principal_stretches"], [1.3, 1.0, 0.8], rtol=1e-14)


def test_segments_without_a_poissons_ratio_have_a_constant_section():
    now = Fields(MESHES["cable"], StVK(young=2.0)).at(affine(MESHES["cable"], 1.2 * np.eye(3)))
    assert np.allclose(now["principal_stretches"], [1.2, 1, 1], rtol=1e-14)


@given(st.floats(0, np.pi), st.floats(0, 2 * np.pi))
def test_the_normals_of_a_segment_follow_its_smallest_rotation(angle, about):
    rest = rest_frames(np.array([[[1.0], [0], [0]], [[0.6], [0], [-0.8]]]))
    for frame in rest:
        new = np.cos(angle) * frame[:, 0] + np.sin(angle) * (np.cos(about) * frame[:, 1] + np.sin(about) * frame[:, 2])
        normals = current_normals(frame[None], 1.7 * new[None, :, None], 3)[0]
        R = np.column_stack([new, normals]) @ frame.T
        assert np.allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-9) and np.linalg.det(R) > 0
        assert np.allclose(R @ frame[:, 0], new, rtol=0, atol=1e-12)
        if angle < 3:  # the smallest rotation has no part about the axis of the segment
            assert np.trace(R) == pytest.approx(1 + 2 * np.cos(angle), abs=1e-9)


def test_a_segment_that_is_reversed_or_shrunk_to_a_point_has_normals():
    frames = rest_frames(np.array([[[1.0], [0], [0]]]))
    for tangent in (-1.0, 0.0):
        normals = current_normals(frames, tangent * frames[..., :1], 3)[0]
        assert np.allclose(normals.T @ normals, np.eye(2)) and np.allclose(normals[0], 0)


def test_a_membrane_shrunk_to_a_line_has_no_nan():
    mesh = MESHES["membrane"]
    now = Fields(mesh, BODIES["membrane, isotropic"][1]).at(affine(mesh, np.diag([1, 0, 0])))
    for name in ("deformation_gradient", "volume_ratio", "pk1", "principal_stretches"):
        assert np.isfinite(np.ma.getdata(now[name])).all()
    assert np.abs(np.asarray(now["volume_ratio"])).max() < 1e-12


@pytest.mark.parametrize("axes", [Geometry(m.p, m.t).axes for m in MESHES.values()], ids=list(MESHES))
def test_rest_frames_are_right_handed_and_begin_with_the_axes(axes):
    frames = rest_frames(axes)
    assert np.allclose(np.swapaxes(frames, 1, 2) @ frames, np.eye(3)) and np.allclose(np.linalg.det(frames), 1)
    assert np.array_equal(frames[:, : axes.shape[1], : axes.shape[2]], axes)


def test_unknown_fields_are_refused_with_the_known_ones():
    now = at("triangles, isotropic")
    with pytest.raises(StvkError, match=r"no field 'sigma'; known: 'cauchy_stress', 'deformation_gradient', .*'von_mises_stress'"):
        now["sigma"]
    assert {"pk2_stress", "cauchy_stress", "green_strain", "volume_ratio"} <= set(names())


def test_displacements_that_do_not_fit_are_refused():
    fields = Fields(MESHES["triangles"], StVK(young=1.0, poisson=0.3))
    with pytest.raises(StateError, match=r"u has shape \(3,\); expected \(50,\)"):
        fields.at(np.zeros(3))
    with pytest.raises(StateError, match=r"not finite in 1 entry \(7\)"):
        fields.at(np.where(np.arange(50) == 7, np.nan, 0.0))


def test_bodies_with_only_terms_without_stress_are_refused():
    with pytest.raises(StvkError, match="None of the terms carries stress"):
        Fields(MESHES["triangles"], [Gravity((0.0, -9.81))])


def test_only_requested_fields_are_computed():
    now = at("tetrahedra, isotropic")
    now["volume_ratio"]
    (response,) = now.responses
    known = {function.__name__ for function in response._cache}
    assert known == {"volume_ratio", "deformation_gradient"} and "_response" not in response.__dict__
    first = now["cauchy"]
    assert now["cauchy_stress"] is first
