"""The parts of a divided mesh are the mesh: each element and name once, each node where it is used; and joined parts are larger
parts.
"""

import numpy as np
import pytest
import skfem
from bodies import EVERY_MESH

from skfem_stvk import ElementMesh
from skfem_stvk.errors import MeshError
from skfem_stvk.ranks.partition import divide, join

pytest.importorskip("pymetis")

SOLIDS = [name for name, mesh in EVERY_MESH.items() if mesh.k == mesh.d > 1]


def named(mesh):
    """Return the mesh with two regions, its skin, inner facets, nodes at one end, and cables within elements and across them."""
    centre = mesh.p[0, mesh.t].mean(axis=0)
    low = np.flatnonzero(centre < np.median(centre))
    nodes = np.flatnonzero(mesh.p[0] < np.median(mesh.p[0]))
    ends = np.array([mesh.t[0, :5], mesh.t[1, :5]])
    cables = np.append(ends, [[mesh.t[0, 0]], [mesh.t[0, -1]]], axis=1).astype(np.int32)
    lines = {"cables": cables} if mesh.element.degree == 1 else {}
    return ElementMesh(mesh.p, mesh.t, {"low": low}, {"skin": mesh.surface}, {"end": nodes}, mesh.element, lines)


def columns(*arrays):
    """Return the columns of all arrays, each as a sorted tuple, ascending."""
    return sorted(tuple(sorted(column)) for array in arrays for column in np.asarray(array).T.tolist())


def assert_are_the_mesh(parts, mesh):
    """Assert that parts are the mesh, and that each says which other parts have its nodes."""
    assert columns(*(part.node_numbers[part.t] for part in parts)) == columns(mesh.t)
    assert np.array_equal(np.sort(np.concatenate([part.element_numbers for part in parts])), np.arange(mesh.nt))
    assert columns(*(part.node_numbers[part.surface] for part in parts)) == columns(mesh.surface)
    assert columns(*(part.element_numbers[part.subdomains["low"]][None] for part in parts)) == columns(mesh.subdomains["low"][None])
    for name, facets in mesh.boundaries.items():
        assert columns(*(part.node_numbers[part.boundaries[name]] for part in parts)) == columns(facets)
        for part in parts:
            assert np.array_equal(part.node_numbers[part.boundaries[name]], facets[:, part.boundary_numbers[name]])
    for name, ends in mesh.lines.items():
        assert columns(*(part.node_numbers[part.lines[name]] for part in parts)) == columns(ends)
        for part in parts:
            assert np.array_equal(part.node_numbers[part.lines[name]], np.asarray(ends)[:, part.line_numbers[name]])
    having = [[number for number, part in enumerate(parts) if node in part.node_numbers] for node in range(mesh.nv)]
    for number, part in enumerate(parts):
        assert np.array_equal(part.p, mesh.p[:, part.node_numbers])
        assert np.array_equal(mesh.t[:, part.element_numbers], part.node_numbers[part.t])
        assert (np.diff(part.node_numbers) > 0).all() and (np.diff(part.element_numbers) > 0).all()
        assert part.vertices == np.count_nonzero(part.node_numbers < mesh.nvertices)
        assert np.array_equal(part.node_numbers[part.node_sets["end"]], np.intersect1d(part.node_numbers, mesh.node_sets["end"]))
        shared = [[] for _ in part.node_numbers]
        for node, other in part.shared.T:
            shared[node].append(other)
        assert shared == [[other for other in having[node] if other != number] for node in part.node_numbers]


@pytest.mark.few
@pytest.mark.parametrize("how", ["METIS", "random"])
@pytest.mark.parametrize("name", SOLIDS)
def test_parts_are_the_mesh(name, how):
    mesh = named(EVERY_MESH[name])
    for parts in (1, 2, 5):
        part_of = None if how == "METIS" else np.random.default_rng(3).permutation(np.arange(mesh.nt) % parts)
        assert_are_the_mesh(list(divide(mesh, parts, part_of)), mesh)


@pytest.mark.parametrize("name", SOLIDS)
def test_joined_parts_are_the_mesh(name):
    mesh = named(EVERY_MESH[name])
    pieces = list(divide(mesh, 8, np.random.default_rng(3).permutation(np.arange(mesh.nt) % 8)))
    for ranks in (1, 3, 8):
        rank_of = np.arange(8) * ranks // 8
        own = [np.flatnonzero(rank_of == rank).tolist() for rank in range(ranks)]
        assert_are_the_mesh([join([pieces[number] for number in ids], ids, rank_of) for ids in own], mesh)


def test_elements_of_facets_and_cables_have_all_their_nodes_on_their_part():
    """Facets and lines on an element are on its part; others are on the lowest part with all of their nodes."""
    mesh = ElementMesh.of(skfem.MeshTri.init_tensor(np.linspace(0, 4, 5), np.linspace(0, 1, 2)))
    at = {tuple(x): node for node, x in enumerate(mesh.p.T.tolist())}
    lines = {"cables": np.array([[at[0, 0], at[4, 1], at[0, 0], at[2, 0]], [at[1, 1], at[4, 0], at[4, 0], at[4, 0]]])}
    mesh = ElementMesh(mesh.p, mesh.t, lines=lines)
    parts = list(divide(mesh, 2, (mesh.p[0, mesh.t].mean(axis=0) > 2).astype(int)))
    names = [columns(part.node_numbers[part.lines["cables"]]) for part in parts]
    assert names == [columns(lines["cables"][:, [0, 2]]), columns(lines["cables"][:, [1, 3]])]
    assert at[4, 0] in parts[0].node_numbers and at[4, 0] not in parts[0].node_numbers[parts[0].t]


def test_nodes_of_cables_that_hang_are_on_the_part_of_the_cable():
    p = np.array([[0.0, 1, 0, 1, 2, 3, 4], [0, 0, 1, 1, 1, 1, 1]])
    lines = {"rope": np.array([[3, 4, 5], [4, 5, 6]])}
    mesh = ElementMesh(p, [[0, 1], [1, 2], [2, 3]], lines=lines)
    first, second = divide(mesh, 2, np.array([0, 1]))
    assert first.node_numbers.tolist() == [0, 1, 2] and second.node_numbers.tolist() == [1, 2, 3, 4, 5, 6]
    assert columns(second.node_numbers[second.lines["rope"]]) == columns(lines["rope"])


def test_parts_with_neighbouring_numbers_are_neighbours():
    """Halves of 16 parts share as few nodes as two parts."""
    mesh = ElementMesh.of(skfem.MeshTet.init_tensor(np.linspace(0, 4, 17), *[np.linspace(0, 1, 5)] * 2))
    pieces = list(divide(mesh, 16))
    rank_of = np.arange(16) // 8
    two = [join([pieces[number] for number in ids], ids, rank_of) for ids in (list(range(8)), list(range(8, 16)))]
    assert len({len(part.element_numbers) for part in two}) == 1
    assert len(two[0].shared.T) <= 1.2 * len(next(divide(mesh, 2)).shared.T)


def test_parts_are_made_one_after_another():
    """A part is made when it is requested: the nodes of a later part are those of the mesh at that time."""
    mesh = ElementMesh.of(skfem.MeshTri().refined(2))
    parts = divide(mesh, 2)
    next(parts)
    mesh.p[:] = 7
    assert (next(parts).p == 7).all()


@pytest.mark.parametrize(
    ("parts", "part_of", "text"),
    [
        (0, None, "parts = 0; expected a number of parts from 1 to the 32 elements"),
        (33, None, "parts = 33; expected a number of parts from 1 to the 32 elements"),
        (2, np.zeros(32, dtype=int), "in 1 of 2 parts, none in part 1"),
        (2, np.zeros(31, dtype=int), "expected a part from 0 to 1 for each of the 32 elements"),
        (2, np.full(32, 2), "expected a part from 0 to 1 for each of the 32 elements"),
        (2, "strips", "part_of = 'strips'; expected a part"),
    ],
)
def test_other_divisions_are_refused(parts, part_of, text):
    with pytest.raises(MeshError, match=text):
        divide(ElementMesh.of(skfem.MeshTri().refined(2)), parts, part_of)


def test_as_many_parts_as_elements_have_one_each():
    mesh = ElementMesh.of(skfem.MeshTri().refined(2))
    assert [len(part.element_numbers) for part in divide(mesh, 32)] == [1] * 32


def test_the_error_without_metis_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pymetis", None)
    with pytest.raises(MeshError, match=r"pip install 'skfem-stvk\[mpi\]'"):
        divide(ElementMesh.of(skfem.MeshTri().refined(2)), 2)
