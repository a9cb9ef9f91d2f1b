"""Assemblies store the arrays of the kernels correctly, and add to or overwrite the arrays of the caller as documented."""

import numpy as np
import pytest
from bodies import MESHES, box, state
from kernels.parts import in_parts
from skfem import MeshTet

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.edges import TENSILE
from skfem_stvk.edges.topology import alone, edge_topology, in_lanes, kernel_order, out_of_lanes
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
