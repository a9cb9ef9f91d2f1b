"""Mechanisms of elements that share less than a facet: their number is that of the zero modes of K, and they are named."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from bodies import distorted, turned_round
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from slow import slow

from skfem_stvk import ElasticFoundation, ElementMesh, StVK, System
from skfem_stvk.edges.topology import edge_topology
from skfem_stvk.errors import SupportError
from skfem_stvk.kernels.simplex_topology import pieces_of_simplices
from skfem_stvk.mesh.facets import facet_ids
from skfem_stvk.system.constraints import Block, free_motions
from skfem_stvk.system.mechanisms import check_held, mechanisms
from skfem_stvk.system.rigid import free_rigid_modes, parts_of

MATERIAL = StVK(young=2.0, poisson=0.3)
UNIT = skfem.MeshTet()


def cube(*corner):
    """Return the unit cube of five tetrahedra with its lowest corner at `corner`, in one of its two subdivisions."""
    return UNIT.p + np.array(corner, dtype=float)[:, None], UNIT.t


def simplex(*corners):
    return np.array(corners, dtype=float).T, np.arange(len(corners))[:, None]


def put_together(*bodies, element=None):
    """Return meshes (p, t) as one mesh, in which coincident vertices are merged."""
    p = np.concatenate([p for p, _ in bodies], axis=1)
    first = np.cumsum([0, *[p.shape[1] for p, _ in bodies]])
    t = np.concatenate([t + n for (_, t), n in zip(bodies, first, strict=False)], axis=1)
    p, inverse = np.unique(np.round(p, 12), axis=1, return_inverse=True)
    return ElementMesh(p, inverse.ravel()[t], element=element)


def shuffled(mesh, seed):
    """Return the same body with renumbered vertices and elements, and half of the elements reversed."""
    rng = np.random.default_rng(seed)
    new, p = rng.permutation(mesh.nv), np.empty_like(mesh.p)
    p[:, new] = mesh.p
    return ElementMesh(p, turned_round(new[mesh.t[:, rng.permutation(mesh.nt)]], rng))


def at(*point):
    """Return a predicate that is true at this point."""
    return lambda x: (np.abs(x - np.array(point, dtype=float)[:, None]) < 1e-9).all(axis=0)


WALL = {lambda x: x[0] == 0: "xyz"}
LEFT = {lambda x: x[0] == 0: "xy"}


def message(mesh, fixed, *terms):
    with pytest.raises(SupportError) as error:
        System(mesh, [MATERIAL, *terms], fixed=fixed).check_held()
    return str(error.value)


def zero_modes(system):
    """Return the number of zero eigenvalues of K at rest, including foundations."""
    K = system.tangent(np.zeros(system.ndofs)).toarray()
    free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
    values = np.linalg.eigvalsh(K[np.ix_(free, free)])
    return int((values < 1e-9 * np.abs(K).max()).sum())


def motions_left(mesh, held):
    """Return the numbers of rigid modes and of mechanisms of all parts."""
    edges = edge_topology(mesh.t)[0]
    part = parts_of([edges], mesh.nv)
    rigid = {left.part: left.count for left in free_rigid_modes(mesh.p, part, held)}
    found = mechanisms(mesh.p, mesh.t, np.arange(mesh.nt), part, held, rigid=rigid, edges=[edges])
    return sum(rigid.values()), sum(mechanism.count for mechanism in found)


ONE_NODE = put_together(cube(0, 0, 0), cube(1, 1, 1))
ONE_EDGE = put_together(cube(0, 0, 0), cube(1, 1, 0))
#: A cube and a tetrahedron that share two corners of the face x = 1, without or with a common edge, or three of its corners. The
#: three corners are a face of the cube in one of the two cases.
TWO_NODES = put_together(cube(0, 0, 0), simplex((1, 0, 0), (1, 1, 1), (2, 0.3, 0.5), (2, 0.9, 0.2)))
OTHER_DIAGONAL = put_together(cube(0, 0, 0), simplex((1, 1, 0), (1, 0, 1), (2, 0.3, 0.5), (2, 0.9, 0.2)))
THREE_NODES = [
    put_together(cube(0, 0, 0), simplex(*corners, (2, 0.3, 0.5)))
    for corners in (((1, 0, 0), (1, 1, 1), (1, 1, 0)), ((1, 0, 1), (1, 1, 0), (1, 1, 1)))
]
FACE = put_together(cube(0, 0, 0), (np.diag([-1.0, 1, 1]) @ UNIT.p + np.array([[2.0], [0], [0]]), UNIT.t))
CHAIN = put_together(cube(0, 0, 0), cube(1, 1, 1), cube(2, 2, 1))
BODIES = {
    "one node": (ONE_NODE, 2, 3),
    "one edge": (ONE_EDGE, 2, 1),
    "two nodes": (TWO_NODES, 2, 1),
    "two nodes of an edge": (OTHER_DIAGONAL, 2, 1),
    "three nodes": (THREE_NODES[0], None, 0),
    "three other nodes": (THREE_NODES[1], None, 0),
    "face": (FACE, 1, 0),
    "chain of a node and an edge": (CHAIN, 3, 4),
}
SCALES = [(1.0, 0.0), (1.0, 1e6), (1.0, -1e8), (1e-6, 0.0), (1e6, 0.0), (1e-3, 1e3)]


def test_three_shared_nodes_are_a_face_in_one_of_the_two_cases():
    assert sorted(pieces_of_simplices(mesh.t, mesh.nv).max() + 1 for mesh in THREE_NODES) == [1, 2]


@pytest.mark.few
@pytest.mark.parametrize(("scale", "offset"), SCALES)
@pytest.mark.parametrize("name", BODIES)
def test_mechanisms_are_counted_at_any_size_location_and_order(name, scale, offset):
    mesh, pieces, count = BODIES[name]
    for seed in range(3):
        unit = shuffled(mesh, seed)
        assert pieces in (None, pieces_of_simplices(unit.t, unit.nv).max() + 1)
        body = ElementMesh(scale * unit.p + offset, unit.t)
        held = (3 * np.flatnonzero(unit.p[0] == 0)[:, None] + np.arange(3)).ravel()
        assert motions_left(body, held) == (0, count)
        assert motions_left(body, held[:0]) == (6, count)


@pytest.mark.parametrize("name", BODIES)
def test_mechanisms_are_the_zero_eigenvalues_of_the_stiffness(name):
    mesh, _, count = BODIES[name]
    assert zero_modes(System(mesh, MATERIAL, fixed=WALL)) == count


def crumbs(d, seed, share, regular):
    """Return some of the simplices of a block, joined by faces, edges or vertices, or not at all."""
    rng = np.random.default_rng(seed)
    mesh = (skfem.MeshTet if d == 3 else skfem.MeshTri).init_tensor(*[np.linspace(0, 1, {2: 6, 3: 4}[d])] * d)
    t = mesh.t[:, rng.random(mesh.t.shape[1]) < share]
    if not t.size:
        t = mesh.t[:, :1]
    used, t = np.unique(t, return_inverse=True)
    p = mesh.p if regular else distorted(mesh.p, rng)
    return ElementMesh(p[:, used], turned_round(t.reshape(d + 1, -1), rng)), rng


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    share=st.floats(0.05, 0.7),
    regular=st.booleans(),
    held=st.floats(0, 0.4),
    offset=st.sampled_from([0.0, 1e5]),
)
@pytest.mark.parametrize("d", [2, slow(3)])
def test_random_simplices_have_as_many_motions_as_the_stiffness_has_zero_eigenvalues(d, seed, share, regular, held, offset):
    mesh, rng = crumbs(d, seed, share, regular)
    dofs = np.flatnonzero(rng.random(mesh.p.size) < held)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        system = System(mesh, MATERIAL)
    K = system.tangent(np.zeros(system.ndofs)).toarray()
    free = np.setdiff1d(np.arange(system.ndofs), dofs)
    zeros = int((np.linalg.eigvalsh(K[np.ix_(free, free)]) < 1e-12 * np.abs(K).max()).sum()) if len(free) else 0
    assert sum(motions_left(ElementMesh(mesh.p + offset, mesh.t), dofs)) == zeros


ADVICE = " These elements share less than a face with the others: fix them as well, join them by faces, or remesh."


def test_a_ball_joint_is_named():
    (corner,) = np.flatnonzero(at(1, 1, 1)(ONE_NODE.p))
    assert message(ONE_NODE, WALL) == (
        f"Not held: the body of 15 vertices has 3 mechanisms: 5 elements (5, 6, 7, 8, 9) can rotate about 1 vertex ({corner}) "
        "at (1, 1, 1)." + ADVICE
    )


def test_a_hinge_is_named():
    a, b = np.flatnonzero((ONE_EDGE.p[:2] == 1).all(axis=0))[:2]
    assert (ONE_EDGE.p[:, [a, b]].T == [[1, 1, 0], [1, 1, 1]]).all()
    text = message(ONE_EDGE, {lambda x: x[0] == 2: "xyz"})
    assert text == (
        "Not held: the body of 14 vertices has 1 mechanism: 5 elements (0, 1, 2, 3, 4) can rotate about "
        f"the line through 2 vertices ({a}, {b}) "
        "from (1, 1, 0) to (1, 1, 1)." + ADVICE
    )
    assert "1 element (5) can rotate about the line through 2 vertices" in message(TWO_NODES, WALL)


def test_each_loose_joint_of_a_chain_is_named():
    text = message(CHAIN, WALL)
    assert "has 4 mechanisms: " in text
    assert "5 elements (5, 6, 7, 8, 9) can rotate about 1 vertex (" in text and ") at (1, 1, 1)" in text
    assert "5 elements (10, 11, 12, 13, 14) can rotate about the line through 2 vertices (" in text
    middle = message(CHAIN, {lambda x: (x[2] == 2) & (x[0] <= 2): "xyz"})
    assert (
        "has 3 mechanisms: 5 elements (0, 1, 2, 3, 4) can rotate about 1 vertex" in middle and "(10, 11, 12, 13, 14)" not in middle
    )


def test_rigid_modes_and_mechanisms_are_reported_together():
    text = message(ONE_NODE, None)
    assert text.startswith("Not held: the body of 15 vertices has 6 rigid modes left, translation along x")
    assert "merge the vertices of their common faces. Also, the body of 15 vertices has 3 mechanisms: 5 elements" in text


@pytest.mark.parametrize("name", BODIES)
def test_parts_with_their_own_supports_are_no_mechanism(name):
    mesh, *_ = BODIES[name]
    far = mesh.p[0].max()
    System(
        mesh, MATERIAL, fixed={**WALL, (lambda x: x[0] > (1 if name == "chain of a node and an edge" else far - 0.2)): "xyz"}
    ).check_held()


def test_supports_of_one_node_lock_a_hinge_but_not_the_spin_of_a_ball_joint():
    corner = {at(2, 2, 0): "xyz"}
    System(ONE_EDGE, MATERIAL, fixed={**WALL, **corner}).check_held()
    assert "has 1 mechanism: 5 elements (5, 6, 7, 8, 9) can rotate about 1 vertex" in message(
        ONE_NODE, {**WALL, at(2, 2, 2): "xyz"}
    )


def test_symmetric_supports_lock_a_hinge():
    middle = {lambda x: x[1] == 1: "y"}
    assert "1 mechanism" in message(ONE_EDGE, {**WALL, at(1, 1, 0): "xyz"})
    System(ONE_EDGE, MATERIAL, fixed={**WALL, **middle}).check_held()


def test_a_foundation_locks_a_hinge():
    outer = lambda x: x[0] == 2  # noqa: E731
    System(ONE_EDGE, [MATERIAL, ElasticFoundation(outer, (0, 1.0, 0))], fixed=WALL).check_held()
    assert "1 mechanism" in message(ONE_EDGE, WALL, ElasticFoundation(outer, (0, 0, 1.0)))  # along the axis of the hinge


TRIANGLES = put_together(
    simplex((0, 0), (1, 0), (0, 1)),
    simplex((0, 1), (1, 0), (1, 1)),
    simplex((1, 1), (2, 1.2), (1.3, 2)),
    simplex((2, 1.2), (3, 1), (3, 2)),
)


def test_triangles_in_the_plane_rotate_about_a_vertex():
    first, second = (int(np.flatnonzero(at(*point)(TRIANGLES.p))[0]) for point in ((1, 1), (2, 1.2)))
    assert message(TRIANGLES, LEFT) == (
        "Not held: the body of 8 vertices has 2 mechanisms: 1 element (2) can rotate about "
        f"1 vertex ({first}) at (1, 1), 1 element (3) can rotate "
        f"about 1 vertex ({second}) at (2, 1.2). These elements share less than an edge with the others: "
        "fix them as well, join them by edges, "
        "or remesh."
    )
    System(TRIANGLES, MATERIAL, fixed={**LEFT, at(3, 1): "xy"}).check_held()  # a linkage of two bars, supported at both ends


def ring(n):
    """Return triangles on the sides of a polygon, each joined to the next at a corner."""
    angle = 2 * np.pi * np.arange(n) / n
    inner, outer = (
        np.stack([np.cos(angle), np.sin(angle)], axis=1),
        2 * np.stack([np.cos(angle + 3 / n), np.sin(angle + 3 / n)], axis=1),
    )
    return put_together(*[simplex(inner[i], inner[(i + 1) % n], outer[i]) for i in range(n)])


@pytest.mark.parametrize("n", [3, 4, 5, 12])
def test_a_ring_of_three_is_rigid_and_others_are_linkages(n):
    mesh = shuffled(ring(n), n)
    assert motions_left(mesh, np.empty(0, dtype=int)) == (3, n - 3)
    assert zero_modes(System(mesh, MATERIAL)) == n


def test_a_rigid_ring_that_rotates_as_a_whole_is_one_mechanism():
    more = put_together((ring(3).p, ring(3).t), simplex((1, 0), (2, -1), (3, 1)), simplex((2, -1), (3, 1), (3, -1)))
    text = message(more, {lambda x: x[0] == 3: "xy"})
    assert "has 1 mechanism: 3 elements (0, 1, 2) can rotate about 1 vertex (" in text and text.count("can rotate") == 1


def test_the_smaller_of_two_moving_pieces_is_named():
    text = message(TWO_NODES, None)
    assert "1 element (5) can rotate" in text and text.count("can rotate") == 1


def test_each_piece_on_one_edge_is_named():
    pages = [simplex((0, 0, 0), (0, 0, 1), (np.cos(a), np.sin(a), 0), (np.cos(a + 0.2), np.sin(a + 0.2), 1)) for a in range(4)]
    text = message(put_together(*pages), {lambda x: x[0] > 0.9: "xyz"})
    for page in (1, 2, 3):
        assert f"1 element ({page}) can rotate about the line through 2 vertices (" in text
    assert "has 3 mechanisms" in text and text.count("can rotate") == 3


def fan(n):
    """Return tetrahedra that share one vertex."""
    rng = np.random.default_rng(4)
    return put_together(*[simplex((0, 0, 0), *(rng.standard_normal((3, 3)) + 1)) for _ in range(n)])


def test_many_joints_are_counted():
    text = message(fan(40), {at(*fan(40).p[:, 0]): "xyz"})
    assert text.count("can rotate about 1 vertex") == 5 and ", and 34 more joints. These elements share less than a face" in text
    assert "has 117 mechanisms" in text and "has 3 rigid modes left" in text


def test_messages_have_the_ids_of_the_mesh_if_terms_act_on_a_part():
    """Messages have the ids of the mesh if terms act on a part of it.

    Elements without a term do not join others: the wedge between two cubes at an edge.
    """
    wedge = simplex((1, 1, 0), (1, 1, 1), (2, 1, 0), (1, 0, 1)), simplex((1, 1, 0), (1, 1, 1), (2, 1, 1), (1, 0, 0))
    mesh = put_together(wedge[0], cube(0, 0, 0), cube(1, 1, 0))
    System(put_together(wedge[0], wedge[1], cube(0, 0, 0), cube(1, 1, 0)), MATERIAL, fixed=WALL).check_held()
    cubes = StVK(young=2.0, poisson=0.3, region=np.arange(1, 11))
    with pytest.raises(SupportError, match=r"1 mechanism: 5 elements \(6, 7, 8, 9, 10\) can rotate about the line"):
        System(mesh, cubes, fixed=WALL).check_held()
    both = [StVK(young=1.0, poisson=0.3, region=np.arange(1, 6)), StVK(young=3.0, poisson=0.2, region=np.arange(6, 11))]
    with pytest.raises(SupportError, match=r"1 mechanism: 5 elements \(6, 7, 8, 9, 10\) can rotate about the line"):
        System(mesh, both, fixed=WALL).check_held()


def test_parts_have_mechanisms_of_their_own():
    far = (ONE_NODE.p + 5, ONE_NODE.t)
    mesh = put_together(cube(0, 0, 0), far, (ONE_EDGE.p + np.array([[9.0], [0], [0]]), ONE_EDGE.t))
    held = np.flatnonzero(at_any(mesh.p[0], (0, 5, 9)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        system = System(mesh, MATERIAL, fixed={tuple(held): "xyz"})
    with pytest.raises(
        SupportError, match=r"^Not held: the part of 1\d vertices .* mechanisms?: .*; the part of 1\d vertices"
    ) as error:
        system.check_held()
    assert str(error.value).count("mechanism") == 2 and "rigid mode" not in str(error.value)


def at_any(x, values):
    return np.isin(np.round(x, 9), values)


def test_parts_joined_by_another_term_are_no_mechanism():
    edges = System(ONE_EDGE, MATERIAL).bound_terms[0].nodes_paired
    held = (3 * np.flatnonzero(ONE_EDGE.p[0] == 0)[:, None] + np.arange(3)).ravel()
    solid, term = np.ones(ONE_EDGE.nt, dtype=bool), SimpleNamespace(nodes_paired=edges, nodes_joined=None, grounded=None)
    a, b = (np.flatnonzero(at(*point)(ONE_EDGE.p))[0] for point in ((0, 0, 0), (2, 2, 0)))
    with pytest.raises(SupportError, match="1 mechanism"):
        check_held(ONE_EDGE, [term, SimpleNamespace(nodes_paired=edges[:, ::2], nodes_joined=None, grounded=None)], held, solid)
    check_held(ONE_EDGE, [term, SimpleNamespace(nodes_paired=np.array([[a], [b]]), nodes_joined=None, grounded=None)], held, solid)


def test_cables_trusses_and_membranes_in_space_are_not_checked():
    chain = ElementMesh([[0, 1, 2.0, 3], [0, 1, 0, 0], [0, 0, 1, 0]], [[0, 1, 2], [1, 2, 3]])
    System(chain, StVK(young=1.0, poisson=0.3), fixed={(0, 2, 3): "xyz"}).check_held()
    sails = ElementMesh([[0, 0, 1, 2.0, 2], [0, 1, 0, 0, 1], [0, 0, 0, 0, 1]], [[0, 2], [1, 3], [2, 4]])
    System(sails, StVK(young=1.0, poisson=0.3), fixed={(0, 1, 2): "xyz"}).check_held()


def facet_pieces(mesh):
    """Return pieces by the graph of simplices and facets, as a slow reference."""
    t2f = facet_ids(mesh)
    nodes = mesh.nt + int(t2f.max()) + 1
    links = coo_matrix((np.ones(t2f.size), (np.tile(np.arange(mesh.nt), len(t2f)), mesh.nt + t2f.ravel())), shape=(nodes, nodes))
    return connected_components(links, directed=False)[1][: mesh.nt]


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), nt=st.integers(1, 40), nv=st.integers(4, 30))
@pytest.mark.parametrize("d", [2, 3])
def test_pieces_are_connected_by_facets(d, seed, nt, nv):
    """Pieces are connected by facets, for random simplices and also where three share a facet."""
    rng = np.random.default_rng(seed)
    t = np.stack([rng.permutation(nv)[: d + 1] for _ in range(nt)], axis=1)
    mesh = ElementMesh(rng.random((d, nv)), t)
    piece, expected = pieces_of_simplices(mesh.t, nv), facet_pieces(mesh)
    assert len(set(zip(piece, expected, strict=True))) == len(set(piece)) == len(set(expected))
    assert list(np.unique(piece, return_index=True)[1]) == sorted(np.unique(piece, return_index=True)[1])


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), bodies=st.integers(1, 12), blocks=st.integers(0, 25), r=st.sampled_from([1, 3, 6]))
def test_free_motions_are_the_null_space_of_the_constraints(seed, bodies, blocks, r):
    rng = np.random.default_rng(seed)
    constraints = []
    for _ in range(blocks):
        chosen = rng.permutation(bodies)[: rng.integers(1, 4)]
        rows = rng.standard_normal((rng.integers(1, 2 * r + 1), 2)) @ rng.standard_normal((2, len(chosen) * r))
        constraints.append(Block(tuple(chosen.tolist()), rows / np.linalg.norm(rows)))
    A = np.zeros((1, bodies * r))
    for chosen, rows in constraints:
        columns = (np.array(chosen)[:, None] * r + np.arange(r)).ravel()
        more = np.zeros((len(rows), bodies * r))
        more[:, columns] = rows
        A = np.concatenate([A, more])
    free, samples, at_rest = free_motions(constraints, bodies, r)
    null = bodies * r - np.linalg.matrix_rank(A, tol=1e-9)
    samples = samples.reshape(bodies * r, -1)
    assert free.sum() == null and not at_rest.any()
    assert np.abs(A @ samples).max() <= 1e-9 * max(1.0, np.abs(samples).max())
    assert np.linalg.matrix_rank(samples, tol=1e-6 * max(1.0, np.abs(samples).max())) == min(null, samples.shape[1])


def welded(n):
    """Return a chain of pieces of two tetrahedra.

    Each piece is on three corners of the previous one that are not a face. The first piece contains the vertices 0, 1 and 2.
    """
    rng = np.random.default_rng(6)
    p, t, corners = [np.zeros(3), np.array([0.0, 1, 0]), np.array([0.0, 0, 1])], [], (0, 1, 2)
    for _ in range(n):
        tips = len(p), len(p) + 1
        centre = np.mean([p[v] for v in corners], axis=0)
        p += [centre + a + 0.2 * rng.random(3) for a in ((1, 0.2, -0.1), (0.8, -0.5, 0.6))]
        t += [(*corners, tip) for tip in tips]
        corners = (*tips, corners[1 + rng.integers(2)])
    return ElementMesh(np.array(p).T, np.array(t).T)


def test_long_chains_are_constrained_by_their_end():
    mesh = welded(300)
    assert pieces_of_simplices(mesh.t, mesh.nv).max() == 299
    assert motions_left(mesh, np.arange(9)) == (0, 0)
    assert motions_left(mesh, np.arange(6)) == (1, 0)
    balls = put_together(*[cube(i, i, i) for i in range(300)])
    held = (3 * np.flatnonzero(balls.p[0] == 0)[:, None] + np.arange(3)).ravel()
    assert motions_left(balls, held) == (0, 3 * 299)


def checkerboard(n):
    mesh = skfem.MeshTet.init_tensor(*[np.arange(n + 1.0)] * 3)
    cell = np.floor(mesh.p[:, mesh.t].mean(axis=1)).astype(int)
    return mesh.p, mesh.t[:, cell.sum(axis=0) % 2 == 0]


def test_with_too_many_pieces_to_count_reported_pieces_are_mechanisms():
    """If there are too many pieces to count, reported pieces are mechanisms nevertheless.

    The core is assumed to be at rest. A spike on one node and a flap on one edge at its outside are found.
    """
    spike = simplex((10, 10, 9), (11, 10.5, 10), (10.5, 11, 10.2), (11, 11, 11))
    flap = simplex((10, 10, 0), (10, 9, 0), (11, 9, -0.5), (11, 10, -1))
    p, t = checkerboard(10)
    used, inverse = np.unique(t, return_inverse=True)
    heap = put_together((p[:, used], inverse.reshape(t.shape)), spike, flap)
    text = message(heap, WALL)
    assert "has 4 mechanisms: " in text and text.count("can rotate") == 2
    assert (
        "1 element (3000) can rotate about 1 vertex" in text
        and "1 element (3001) can rotate about the line through 2 vertices" in text
    )
    assert " rigid modes left" in message(heap, None) and "has 4 mechanisms: " in message(heap, None)


def test_pieces_assumed_at_rest_may_hide_mechanisms_but_add_none(monkeypatch):
    some = False
    for seed in range(20):
        mesh, rng = crumbs(2, seed, 0.4, regular=False)
        held = np.flatnonzero(rng.random(mesh.p.size) < 0.1)
        monkeypatch.setattr("skfem_stvk.system.constraints.MOST_NEIGHBOURS", 10**9)
        _, true = motions_left(mesh, held)
        monkeypatch.setattr("skfem_stvk.system.constraints.MOST_NEIGHBOURS", 2)
        _, found = motions_left(mesh, held)
        assert found <= true
        some |= 0 < found < true
    assert some
