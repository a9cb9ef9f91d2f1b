"""Rigid modes and mechanisms of quadratic elements, hexahedra and quadrilaterals are the zero modes of scikit-fem's K."""

import numpy as np
import pytest
import skfem
from bodies import CURVED, scikit_fem_of
from skfem.models.elasticity import lame_parameters, linear_elasticity
from test_mechanisms import put_together, simplex

from skfem_stvk import ElementMesh
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.system.mechanisms import mechanisms, pieces
from skfem_stvk.system.rigid import free_rigid_modes, parts_of

HEX, QUAD = ELEMENTS["hexahedra"], ELEMENTS["quadrilaterals"]


def block(*corner):
    """Return a unit square or cube with its lowest corner at `corner`."""
    element = QUAD if len(corner) == 2 else HEX
    return element.nodes.T + np.array(corner, dtype=float)[:, None], np.arange(element.n)[:, None]


def boxes(*corners):
    return put_together(*[block(*corner) for corner in corners], element=QUAD if len(corners[0]) == 2 else HEX)


def by_an_edge(amount):
    """Return two quadratic tetrahedra that share an edge; its middle node is displaced by `amount`."""
    mesh = put_together(
        simplex((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), simplex((0, 0, 0), (0, 0, 1), (-1, 0, 0.3), (0, -1, 0.2))
    ).with_degree(2)
    p = mesh.p.copy()
    p[:, (p[:2] == 0).all(axis=0) & (p[2] == 0.5)] += amount * np.array([[1.0], [0.5], [0]])
    return ElementMesh(p, mesh.t, element=mesh.element)


CASES = {
    "one cube": (boxes((0, 0, 0)), 0),
    "cubes by a face": (boxes((0, 0, 0), (1, 0, 0)), 0),
    "cubes by an edge": (boxes((0, 0, 0), (1, 1, 0)), 1),
    "cubes by a vertex": (boxes((0, 0, 0), (1, 1, 1)), 3),
    "a ring of cubes": (boxes((0, 0, 0), (1, 1, 0), (2, 0, 0), (1, -1, 0)), None),
    "squares by a vertex": (boxes((0, 0), (1, 1)), 1),
    "squares by an edge": (boxes((0, 0), (1, 0), (1, 1)), 0),
    "quadratic tetrahedra by a straight edge": (by_an_edge(0.0), 1),
    "quadratic tetrahedra by a curved edge": (by_an_edge(0.1), 0),
    "quadratic triangles by a vertex": (
        put_together(simplex((0, 0), (1, 0), (0, 1)), simplex((0, 0), (-1, 0), (0, -1))).with_degree(2),
        1,
    ),
}


def zero_modes(mesh, held):
    K = linear_elasticity(*lame_parameters(1.0, 0.3)).assemble(scikit_fem_of(mesh)).toarray()
    free = np.setdiff1d(np.arange(mesh.p.size), held)
    return int((np.linalg.eigvalsh(K[np.ix_(free, free)]) < 1e-9 * np.abs(K).max()).sum())


def motions_left(mesh, held):
    t = mesh.t.T
    edges = np.sort(np.concatenate([t[:, [a, b]] for a, b in mesh.element.pairs]).T, axis=0)
    part = parts_of([edges], mesh.nv)
    left = free_rigid_modes(mesh.p, part, held)
    rigid = {each.part: each.count for each in left}
    found = mechanisms(mesh.p, mesh.t, np.arange(mesh.nt), part, held, rigid=rigid, edges=[edges], element=mesh.element)
    return sum(rigid.values()), sum(each.count for each in found)


@pytest.mark.few
@pytest.mark.parametrize("held", ["nothing", "an element", "one node", "three nodes"])
@pytest.mark.parametrize("name", CASES)
def test_rigid_modes_and_mechanisms_are_the_zero_modes_of_K(name, held):
    mesh, known = CASES[name]
    nodes = {"nothing": [], "an element": mesh.t[:, 0], "one node": mesh.t[-1:, -1], "three nodes": mesh.t[-3:, 0]}[held]
    dofs = np.sort((mesh.d * np.array(nodes, dtype=int)[:, None] + np.arange(mesh.d)).ravel())
    rigid, loose = motions_left(mesh, dofs)
    assert rigid + loose == zero_modes(mesh, dofs)
    if held == "an element" and known is not None:
        assert (rigid, loose) == (0, known)


@pytest.mark.parametrize("name", [name for name, mesh in CURVED.items() if scikit_fem_of(mesh) and mesh.k > 1])
def test_whole_bodies_are_one_piece_and_can_be_fixed_at_edge_nodes(name):
    mesh = CURVED[name]
    assert len(np.unique(pieces(mesh.t, mesh.nv, mesh.element))) == 1
    nodes = mesh.t[-3:, 0]
    for components in (mesh.d, 1):
        dofs = np.sort((mesh.d * nodes[:, None] + np.arange(components)).ravel())
        assert sum(motions_left(mesh, dofs)) == zero_modes(mesh, dofs)


def test_pieces_of_hexahedra_are_those_of_shared_facets():
    mesh = skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 5)] * 3)
    kept = np.flatnonzero(np.random.default_rng(0).random(mesh.nelements) < 0.5)
    t = np.ascontiguousarray(mesh.t[:, kept])
    piece = pieces(t, mesh.nvertices, HEX)
    f2t = mesh.f2t[:, (mesh.f2t >= 0).all(axis=0)]
    inside = np.isin(f2t, kept).all(axis=0)
    a, b = np.searchsorted(kept, f2t[:, inside])
    assert (piece[a] == piece[b]).all() and piece.max() > 2
    joined = np.eye(len(kept), dtype=int)
    joined[a, b] = joined[b, a] = 1
    reach = np.linalg.matrix_power(joined.astype(float), 40) > 0
    assert np.array_equal(reach, piece[:, None] == piece)
