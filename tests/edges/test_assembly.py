"""Assemblies store the arrays of the kernels correctly, and add to or overwrite the arrays of the caller as documented."""

import numpy as np
import pytest
from bodies import BODIES, MESHES, box, state
from kernels.parts import in_parts
from skfem import MeshTet

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.edges import TENSILE
from skfem_stvk.edges.topology import LOCAL_EDGES, alone, edge_topology, in_lanes, kernel_order, out_of_lanes
from skfem_stvk.errors import MaterialError
from skfem_stvk.kernels.lanes import LANES
from skfem_stvk.system import Pattern

TERM = StVK(young=2.0, poisson=0.3)


@pytest.mark.parametrize("n", [1, LANES - 1, LANES, LANES + 1, 5 * LANES + 3])
def test_lanes_are_packed_and_unpacked_without_change(n):
    rows = np.arange(3 * n).reshape(3, n)
    blocks = in_lanes(rows)
    assert blocks.flags.c_contiguous and len(blocks) == -(-n // LANES)
    assert np.array_equal(out_of_lanes(blocks, n), rows)
    last = blocks.reshape(-1, 3, LANES)[-1]
    left_over = last[:, n - LANES * (len(blocks) - 1) :]
    assert (left_over == rows[:, -1:]).all()
    assert blocks.reshape(-1, 3, LANES)[0, :, 0].tolist() == rows[:, 0].tolist()


@pytest.mark.parametrize("name", MESHES)
def test_the_own_order_is_another_order_of_the_same_simplices(name):
    mesh = MESHES[name]
    order = kernel_order(mesh.t, edge_topology(mesh.t)[0])
    assert sorted(order.vertices) == list(range(mesh.nv)) and sorted(order.elements) == list(range(mesh.nt))
    assert (np.diff(order.t, axis=0) > 0).all()
    assert np.array_equal(order.vertices[order.t], np.take_along_axis(mesh.t[:, order.elements], order.local, axis=0))
    assert np.array_equal(np.lexsort(order.t[::-1]), np.arange(mesh.nt))


def test_neighbours_in_the_own_order_are_near():
    """Vertices are shuffled first, as in many meshes of users, and the bandwidth is measured."""
    mesh = box(8)
    number = np.random.default_rng(0).permutation(mesh.nv).astype(np.int32)
    t = number[mesh.t]
    order = kernel_order(t, edge_topology(t)[0])
    assert np.ptp(order.t, axis=0).max() < 0.4 * np.ptp(t, axis=0).max()


def test_few_vertices_precede_all_their_neighbours_in_a_refined_mesh():
    """A refined mesh has the vertices of the coarse mesh first; a box keeps its order.

    Sweeps start again at each of these vertices.
    """
    for mesh in (MeshTet().refined(2), MeshTet().refined(3)):
        t, edges = mesh.t.astype(np.int32), edge_topology(mesh.t)[0]
        order = kernel_order(t, edges)
        assert alone(edges, mesh.nvertices) > 0.15
        assert alone(edge_topology(order.t)[0], mesh.nvertices) < 0.03
    mesh = box(4)
    order = kernel_order(mesh.t, edge_topology(mesh.t)[0])
    assert np.array_equal(order.vertices, np.arange(mesh.nv))


def test_vertices_of_other_terms_are_not_in_the_own_order():
    t = np.array([[9, 4, 7, 2], [4, 9, 11, 2]], dtype=np.int32).T
    order = kernel_order(t, edge_topology(t)[0])
    assert sorted(order.vertices) == [2, 4, 7, 9, 11] and order.t.max() == 4


@pytest.mark.few
@pytest.mark.parametrize("name", BODIES)
def test_force_is_added_and_K_is_written_or_added(name):
    mesh, terms = BODIES[name]
    assembly, u = terms[0].bind(mesh, np.float64), state(mesh).reshape(-1, mesh.d)
    pattern = Pattern(mesh.nv, mesh.d, [assembly.nodes_paired])
    rows = assembly.rows(pattern)
    before = np.random.default_rng(0).standard_normal(u.shape)
    F, sum_of_both, same = np.zeros_like(u), before.copy(), before.copy()
    W = assembly.energy_and_force(u, F)
    assert assembly.energy_and_force(u, sum_of_both) == W
    scale = np.abs(F).max() + 1
    assert np.abs(F).max() > 1e-3 and np.abs(sum_of_both - before - F).max() < 1e-14 * scale

    K = np.zeros(pattern.nnz)
    assembly.fill(u, rows, K, True)
    more = np.full(pattern.nnz, 7.0)
    linearized = assembly.fill(u, rows, more, True, same)
    assert linearized.energy == pytest.approx(W, rel=1e-14)
    assert np.abs(same - before - F).max() < 1e-14 * scale
    assert np.abs(more - K - 7).max() < 1e-14 * (np.abs(K).max() + 7)
    written = np.zeros(pattern.nnz)
    written[K != 0] = np.nan  # all entries of the term are overwritten
    assembly.fill(u, rows, written, False)
    assert np.array_equal(written, K)


@pytest.mark.parametrize("name", MESHES)
def test_blocks_of_edges_are_those_of_K_and_their_total_is_its_trace(name):
    """In fewer than three dimensions the total includes the components across the body, which are not used elsewhere."""
    mesh = MESHES[name]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, mesh.d)
    K = System(mesh, TERM).tangent(u.ravel()).toarray().reshape(mesh.nv, mesh.d, mesh.nv, mesh.d).swapaxes(1, 2)
    energy, blocks = assembly.blocks(u)
    alone = assembly.energy_and_force(u, np.zeros_like(u))
    assert energy == pytest.approx(alone, rel=1e-14)
    a, b = assembly.nodes_paired
    wanted = np.sort(np.einsum("exx->e", K[a, b]))
    found = blocks[: 9 * len(a)].reshape(-1, 3, 3)[:, : mesh.d, : mesh.d]
    assert np.abs(np.sort(np.einsum("exx->e", found)) - wanted).max() < 1e-13 * np.abs(wanted).max()
    pattern = Pattern(mesh.nv, mesh.d, [assembly.nodes_paired])
    data = np.zeros(pattern.nnz)
    total = assembly.fill(u, assembly.rows(pattern), data, False).total
    if mesh.d == 3:
        assert total == pytest.approx(np.einsum("aaxx->", K), rel=1e-13)
    assert total > 0


def test_blocks_are_refilled_in_place():
    mesh = MESHES["tetrahedra"]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, 3)
    _, wanted = assembly.blocks(u)
    _, blocks = assembly.blocks(-2 * u)
    assert np.abs(blocks - wanted).max() > 1e-3
    _, again = assembly.blocks(u, out=blocks)
    assert again is blocks and np.array_equal(again, wanted)
    _, other = assembly.blocks(u, out=np.empty(3))
    assert np.array_equal(other, wanted)


def test_simplices_that_only_fill_a_block_have_no_energy():
    """Seventeen simplices are stored in two blocks of sixteen, so that the last one is stored fifteen more times."""
    mesh = box(3)
    p, t = mesh.p, mesh.t[:, : LANES + 1]
    used, t = np.unique(t, return_inverse=True)
    part = ElementMesh(p[:, used], t.reshape(4, -1))
    u = state(part)
    alone = []
    for e in range(part.nt):
        corners = part.t[:, e]
        single = System((part.p[:, corners], np.arange(4)[:, None]), TERM)
        alone.append(single.energy(u.reshape(-1, 3)[corners].ravel()))
    assert System(part, TERM).energy(u) == pytest.approx(sum(alone), rel=1e-13)


@pytest.mark.parametrize("name", MESHES)
def test_edge_coefficients_and_kernel_data_give_the_same_energy(name):
    """W from `form.L` equals W from the kernels, which use base vectors from another vertex and in another order."""
    mesh = MESHES[name]
    u = state(mesh).reshape(-1, mesh.d)
    for terms in (BODIES[f"{name}, isotropic"][1], BODIES[f"{name}, anisotropic"][1], BODIES[f"{name}, fibres"][1]):
        assembly = terms[0].bind(mesh, np.float64)
        form = assembly.form
        assert len(form.t2e) == len(LOCAL_EDGES[mesh.k])
        zeta = form.squared_elongations(u)
        assert zeta @ form.L @ zeta / 4 == pytest.approx(assembly.energy_and_force(u, np.zeros_like(u)), rel=1e-13)


def test_work_vectors_are_reused_and_counted(monkeypatch):
    """Repeated calls of a solver allocate no array of the size of the mesh."""
    in_parts(monkeypatch, 2)
    mesh = MESHES["tetrahedra"]
    assembly, u = TERM.bind(mesh), state(mesh).reshape(-1, 3)
    pattern = Pattern(mesh.nv, 3, [assembly.nodes_paired])
    rows, data, force = assembly.rows(pattern), np.zeros(pattern.nnz), np.zeros_like(u)
    kept = []
    for _ in range(3):
        assembly.energy_and_force(u, force)
        assembly.fill(u, rows, data, False, force, TENSILE)
        assembly.along(u, u)
        assembly.add_round_off(u, force)
        assembly.pairs.add_product(assembly._scratch["blocks"], u, force)
        vectors = assembly.elements.own._scratch | {"blocks": assembly._scratch["blocks"]}
        kept.append({name: id(vector) for name, vector in vectors.items()})
    assert kept[0] == kept[1] == kept[2] and len(kept[0]) > 4
    memory = assembly.memory()
    assert memory["vectors"] + memory["blocks of edges"] == sum(vector.nbytes for vector in vectors.values())


@pytest.mark.parametrize(
    ("size", "young", "dtype"),
    [
        (1e45, 1e-250, np.float64),
        (1e-45, 1e250, np.float64),
        (1e20, 2.0, np.float32),
        (1e-20, 2.0, np.float32),
        (1.0, 1e-20, np.float32),
        (1.0, 1e20, np.float32),
    ],
)
def test_a_stiffness_out_of_range_is_refused(size, young, dtype):
    """Otherwise W, F and K would be zero without a message, or overflow."""
    mesh = MESHES["cable"]
    with pytest.raises(MaterialError, match=r"6 elements \(0, 1, 2, 3, 4, \.\.\.\) of the region: .* range of float.*units"):
        System(ElementMesh(size * mesh.p, mesh.t), StVK(young=young, poisson=0.3), dtype=dtype)


@pytest.mark.parametrize(("size", "young"), [(1e-6, 1e3), (1e-6, 1e11), (1e5, 1e4), (1e-3, 1e12)])
def test_bodies_of_1e_6_to_1e5_metres_fit_in_single_precision(size, young):
    mesh = MESHES["tetrahedra"]
    far, u = ElementMesh(size * mesh.p, mesh.t), state(mesh)
    single, double = (System(far, StVK(young=young, poisson=0.3), dtype=dtype) for dtype in (np.float32, np.float64))
    wanted = double.internal_force(size * u)
    assert np.abs(single.internal_force(size * u) - wanted).max() < 1e-5 * np.abs(wanted).max()
    K, wanted = single.tangent(size * u).data, double.tangent(size * u).data
    assert np.abs(K - wanted).max() < 1e-5 * np.abs(wanted).max()
