import numpy as np
import pytest
from bodies import MESHES, state
from homogeneous import rotation
from hypothesis import given
from hypothesis import strategies as st

from skfem_stvk import RegionError, StateError, StVK, StvkError, System
from skfem_stvk.results import Reaction


def setting(name):
    mesh = MESHES[name]
    u = state(mesh)
    return mesh, u, System(mesh, StVK(young=2.0, poisson=0.3)).internal_force(u)


@pytest.mark.parametrize("name", MESHES)
def test_internal_forces_are_in_balance_about_any_point(name):
    mesh, u, force = setting(name)
    everything = Reaction.of(mesh, u, force, np.arange(mesh.nv))
    size = np.abs(force).max()
    assert np.abs(everything.resultant).max() < 1e-13 * size
    for about in (None, np.full(mesh.d, 3.0)):
        assert np.abs(everything.moment(about)).max() < 1e-12 * size
    part = Reaction.of(mesh, u, force, np.arange(mesh.nv // 2))
    assert np.abs(part.resultant).max() > 0.01 * size  # the forces of a part are not in balance
    assert mesh.d == 1 or np.abs(part.moment()).max() > 1e-4 * size


def test_the_moment_is_the_sum_of_lever_arms_times_forces_where_the_vertices_are_now():
    mesh, u, force = setting("tetrahedra")
    ids = [7, 3, 11]
    reaction = Reaction.of(mesh, u, force.reshape(-1, 3), ids)
    x, f = (mesh.p.T + u.reshape(-1, 3))[sorted(ids)], force.reshape(-1, 3)[sorted(ids)]
    assert list(reaction.vertices) == [3, 7, 11] and np.array_equal(reaction.by_node, f)
    assert np.allclose(reaction.resultant, f.sum(axis=0), rtol=1e-14)
    assert np.allclose(reaction.moment((1, 2, 3)), sum(np.cross(a - [1, 2, 3], b) for a, b in zip(x, f, strict=True)), rtol=1e-12)
    assert np.allclose(reaction.moment(), sum(np.cross(a - x.mean(axis=0), b) for a, b in zip(x, f, strict=True)), rtol=1e-12)


def test_the_moment_in_the_plane_is_the_one_about_the_third_axis():
    mesh, u, force = setting("triangles")
    reaction = Reaction.of(mesh, u, force, [1, 2, 5])
    x, f = (mesh.p.T + u.reshape(-1, 2))[[1, 2, 5]], force.reshape(-1, 2)[[1, 2, 5]]
    moment = reaction.moment(about=(0.3, -0.2))
    assert isinstance(moment, float)
    assert moment == pytest.approx(((x[:, 0] - 0.3) * f[:, 1] - (x[:, 1] + 0.2) * f[:, 0]).sum(), rel=1e-13)


@given(st.floats(-3, 3), st.lists(st.floats(-5, 5), min_size=3, max_size=3))
def test_moments_rotate_with_the_body_and_change_with_the_point(angle, shift):
    mesh, u, force = setting("tetrahedra")
    Q, ids = rotation([1, 2, -1], angle), [2, 3, 5, 8]
    moved = (Q @ (mesh.p + u.reshape(-1, 3).T) - mesh.p).ravel("F")
    here = Reaction.of(mesh, u, force, ids)
    there = Reaction.of(mesh, moved, force.reshape(-1, 3) @ Q.T, ids)
    size = np.abs(force).max()
    assert np.allclose(there.moment(), Q @ here.moment(), rtol=0, atol=1e-12 * size)
    away = here.centroid + np.array(shift)
    assert np.allclose(here.moment(away), here.moment() - np.cross(shift, here.resultant), rtol=0, atol=1e-11 * size)


def test_the_moment_about_the_centroid_is_accurate_far_from_the_origin():
    mesh, u, force = setting("tetrahedra")
    far = type(mesh)(np.round((mesh.p + 2.0**20) * 2**20) / 2**20, mesh.t)
    near = type(mesh)(far.p - 2.0**20, mesh.t)
    here, there = (Reaction.of(body, 1e-6 * u, force, [1, 2, 9]).moment() for body in (near, far))
    assert np.abs(here - there).max() < 1e-13 * np.abs(here).max()


def test_arrays_of_wrong_shape_are_refused():
    mesh, u, force = setting("triangles")
    with pytest.raises(RegionError, match="Reaction at vertices: no vertex there"):
        Reaction.of(mesh, u, force, [])
    with pytest.raises(RegionError, match=r"1 vertex \(25\) outside 0 ... 24"):
        Reaction.of(mesh, u, force, [1, 25])
    with pytest.raises(StateError, match=r"forces has shape \(3,\); expected \(50,\), one number for each"):
        Reaction.of(mesh, u, np.zeros(3), [1])
    with pytest.raises(StateError, match="not finite"):
        Reaction.of(mesh, u, np.full(50, np.nan), [1])
    with pytest.raises(StvkError, match="expected a point with 2 coordinates"):
        Reaction.of(mesh, u, force, [1]).moment(about=(1, 2, 3))
    with pytest.raises(StvkError, match="expected a point with 2 coordinates"):
        Reaction.of(mesh, u, force, [1]).moment(about=(1, np.nan))
