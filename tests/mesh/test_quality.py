"""Quality measures agree with hand calculation, and all faults of a refused mesh are reported."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from bodies import MESHES, distorted

from skfem_stvk import ElementMesh, MeshError, StvkError, mesh_quality
from skfem_stvk.mesh.diagnostics import check_mesh
from skfem_stvk.mesh.element import ELEMENTS

REGULAR = np.array([[1.0, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]])


def names(quality):
    return [fault.name for fault in quality.faults]


def test_a_regular_tetrahedron_has_textbook_values():
    quality = mesh_quality((REGULAR, np.arange(4)[:, None]))
    np.testing.assert_allclose(quality.angles, np.degrees(np.arccos(1 / 3)))
    np.testing.assert_allclose(quality.aspect, np.sqrt(3 / 2))
    np.testing.assert_allclose(quality.size, np.sqrt(8) ** 3 / (6 * np.sqrt(2)))
    np.testing.assert_allclose(quality.edges, np.sqrt(8))
    assert quality.sound and quality.parts.tolist() == [4]


def test_triangles_have_the_right_angles():
    quality = mesh_quality(([[0, 1, 0], [0, 0, np.sqrt(3)]], [[0], [1], [2]]))
    np.testing.assert_allclose(quality.angles[:, 0], [30, 90])
    np.testing.assert_allclose(quality.edges[:, 0], [1, 2])
    np.testing.assert_allclose(quality.aspect, 2 / (np.sqrt(3) / 2))
    space = mesh_quality(([[0, 0, 0], [0, 1, 0], [0, 0, np.sqrt(3)]], [[0], [1], [2]]))
    np.testing.assert_allclose(space.angles[:, 0], [30, 90])


def test_a_sheared_hexahedron_has_the_dihedral_angle_of_its_shear():
    mesh = skfem.MeshHex()
    sheared = skfem.MeshHex(mesh.p + np.array([[1.0], [0], [0]]) * mesh.p[2], mesh.t)
    quality = mesh_quality(sheared)
    np.testing.assert_allclose(quality.angles[:, 0], [45, 135])
    np.testing.assert_allclose(quality.size, 1)
    np.testing.assert_allclose(mesh_quality(skfem.MeshHex().refined(1)).angles, 90)


@pytest.mark.parametrize("name", MESHES)
def test_sizes_edges_and_aspects_are_those_of_each_kind_of_simplex(name):
    mesh = MESHES[name]
    quality = mesh_quality(mesh)
    x = mesh.p.T[mesh.t.T]
    pairs = [(i, j) for i in range(mesh.k + 1) for j in range(i)]
    lengths = np.array([np.linalg.norm(x[:, i] - x[:, j], axis=1) for i, j in pairs])
    np.testing.assert_allclose(quality.edges, [lengths.min(axis=0), lengths.max(axis=0)])
    base_vectors = x[:, 1:] - x[:, :1]
    gram = np.linalg.det(base_vectors @ base_vectors.transpose(0, 2, 1))
    np.testing.assert_allclose(quality.size, np.sqrt(gram) / (1, 1, 2, 6)[mesh.k])
    assert np.isnan(quality.angles).all() == (mesh.k == 1)
    if mesh.k == 2:  # the angles of a triangle add up to 180 degrees
        third = 180 - quality.angles.sum(axis=0)
        assert ((quality.angles[0] <= third + 1e-9) & (third <= quality.angles[1] + 1e-9)).all()
    if mesh.k == mesh.d == 3:
        np.testing.assert_array_equal(quality.turned, np.linalg.det(base_vectors) < 0)
        assert 0 < quality.turned.sum() < mesh.nt


@pytest.mark.parametrize("name", ELEMENTS)
def test_qualities_do_not_depend_on_the_unit_of_length(name):
    element = ELEMENTS[name]
    corners = element.nodes[: element.corners].T
    mesh = ElementMesh(corners, np.arange(element.corners)[:, None], element=None if element.is_simplex else element)
    mesh = mesh.with_degree(element.degree)
    mesh = replace(mesh, p=distorted(mesh.p, np.random.default_rng(1), 0.1))
    one, small = mesh_quality(mesh), mesh_quality(ElementMesh(1e-6 * mesh.p, mesh.t, element=mesh.element))
    np.testing.assert_allclose(small.aspect, one.aspect, rtol=1e-9)
    np.testing.assert_allclose(small.angles, one.angles, rtol=1e-9)
    np.testing.assert_allclose(small.size, 1e-6**mesh.k * one.size, rtol=1e-9)
    assert len(one.extremes()) == (5 if mesh.k == 1 else 7)


def test_the_aspect_ratio_is_1_for_segments_and_infinite_for_collapsed_elements():
    assert (mesh_quality(([[0.0, 49.0, 50.0]], [[0, 1], [1, 2]])).aspect == 1).all()
    assert mesh_quality(([[0.0, 1, 0, 2, 2, 2], [0.0, 0, 1, 3, 3, 3]], [[0, 3], [1, 4], [2, 5]])).aspect[1] == np.inf


def test_the_worst_elements_are_listed_first_with_their_ids():
    p = np.array([[0, 1, 1, 0, 2, 2.1], [0, 0, 1, 1, 0, 0.001]])
    quality = mesh_quality((p, [[0, 0, 1], [1, 2, 4], [2, 3, 5]]))
    worst = quality.worst("largest aspect ratio", 2)
    assert worst.elements[0] == 2 and worst.value == worst.values[0] > 1000
    assert quality.worst("shortest edge", 1).elements == (2,)
    assert names(quality) == ["slivers"] and not quality.faults[0].refused and "Remesh" in quality.faults[0].text
    assert "1 element (2)" in quality.faults[0].text
    with pytest.raises(StvkError, match="name = 'volume'"):
        quality.worst("volume")
    with pytest.raises(StvkError, match="n = 0"):
        quality.worst("shortest edge", 0)


def broken():
    """Return a mesh with every fault, and the number of elements of one of its two cubes."""
    cube = skfem.MeshTet().refined(1)
    far = cube.p + np.array([[3.0], [0], [0]])
    p = np.column_stack([cube.p, far, [9, 9, 9], [np.nan, 0, 0], cube.p[:, 0]])
    n = cube.nvertices
    flat = np.flatnonzero(cube.p[2] == 0)[:4]
    more = np.array([[5, 5, 6, 7], cube.t[[1, 0, 2, 3], 3], flat, [n, n + 1, n + 2, 2 * n + 1], [2 * n + 2, *cube.t[1:, 0]]]).T
    return ElementMesh(p, np.column_stack([cube.t, cube.t + n, more])), cube.nelements


def test_all_faults_of_a_mesh_are_reported_at_once():
    mesh, nt = broken()
    quality = mesh_quality(mesh)
    assert names(quality) == ["not finite", "collapsed", "flat", "duplicates", "unused", "coincident", "parts"]
    by_name = {fault.name: fault for fault in quality.faults}
    n = (mesh.nv - 3) // 2
    assert by_name["not finite"].ids.tolist() == [2 * n + 1]
    assert by_name["collapsed"].ids.tolist() == [2 * nt]
    assert by_name["duplicates"].ids.tolist() == [2 * nt + 1]
    assert by_name["flat"].ids.tolist() == [2 * nt + 2]
    assert by_name["unused"].ids.tolist() == [2 * n]
    assert by_name["coincident"].ids.tolist() == [2 * n + 2]
    assert len(quality.parts) == 2 and not quality.sound
    assert np.flatnonzero(np.isnan(quality.size)).tolist() == [2 * nt, 2 * nt + 3]
    assert quality.aspect[2 * nt + 2] > 1e12 and quality.worst("largest aspect ratio").elements[0] == 2 * nt + 2
    assert all(fault.text in repr(quality) for fault in quality.faults)


def test_a_system_reports_the_first_fault():
    mesh, _ = broken()
    with pytest.raises(MeshError) as refused:
        check_mesh(mesh)
    assert str(refused.value) == mesh_quality(mesh).faults[0].text


def test_a_mesh_without_one_sound_element_has_faults_too():
    quality = mesh_quality(([[np.nan, 1, 0], [0, 0, 1]], [[0], [1], [2]]))
    assert names(quality) == ["not finite"] and np.isnan(quality.aspect).all() and quality.extremes() == []
    in_one_place = mesh_quality((np.ones((3, 8)), np.arange(8).reshape(2, 4).T))
    assert names(in_one_place) == ["flat", "parts"]


@pytest.mark.parametrize("scale", [1e-60, 1e60])
def test_lengths_beyond_double_precision_are_a_fault(scale):
    quality = mesh_quality((scale * REGULAR, np.arange(4)[:, None]))
    assert names(quality) == ["range"]
    np.testing.assert_allclose(quality.angles, np.degrees(np.arccos(1 / 3)))


def test_folded_and_short_elements_are_named():
    mesh = skfem.MeshQuad()
    folded = mesh_quality(skfem.MeshQuad(np.array([[0, 1, 0.2, 0], [0, 0, 0.2, 1.0]]), mesh.t))
    assert names(folded) == ["folded"]
    s = np.append(np.linspace(0, 1, 9), 1 + 1e-5)
    short = mesh_quality((s[None], [np.arange(9), np.arange(1, 10)]))
    assert names(short) == ["short edges"] and short.faults[0].ids.tolist() == [8]
