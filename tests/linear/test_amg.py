"""Multigrid: iterations hardly grow, hierarchies are reused or rebuilt, and results do not depend on the number of threads."""

from dataclasses import replace

import numpy as np
import pytest
import skfem
from kernels.parts import in_parts
from linear.problems import problem, rigid_motions

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.errors import StvkError
from skfem_stvk.linear import AmgCg, Kind, Outcome, Unknowns, amg
from skfem_stvk.linear.block_matrices import VertexRows
from skfem_stvk.linear.multigrid import MIN_AGGREGATE_SIZE, ToCorners, aggregates


def beam(size, young=1.0, flat=1.0):
    """Return K of a beam five times as long as thick, and its unknowns."""
    lines = np.linspace(0, 5, 5 * size + 1), np.linspace(0, 1, size + 1), np.linspace(0, flat, size + 1)
    mesh = skfem.MeshTet.init_tensor(*lines)
    if young != 1.0:
        young = np.where(mesh.p[1][mesh.t].mean(axis=0) > 0.5, young, 1.0)
    system = System(mesh, StVK(young=young, poisson=0.3))
    free = system.free_dofs(np.flatnonzero(np.repeat(mesh.p[0] == 0, 3)))
    K, modes = free.matrix(system.tangent(np.zeros(system.ndofs))), rigid_motions(mesh.p)[free.free]
    return K, Unknowns(*np.divmod(free.free, 3), K.indptr, K.indices, lambda: modes)


def across(unknowns):
    return np.where(unknowns.component == unknowns.component.max(), -1.0, 0.0)


def solved(K, unknowns, rtol=1e-8):
    solution = AmgCg().analyse(unknowns).factorise(K, Kind.SYMMETRIC).solve(across(unknowns), rtol)
    assert solution.outcome is Outcome.SOLVED
    return solution


def test_iterations_hardly_grow_with_the_number_of_unknowns():
    small, large = solved(*beam(3)), solved(*beam(9))
    assert len(large.x) > 18 * len(small.x)
    assert 5 < small.iterations <= large.iterations + 3 <= small.iterations + 10


def test_stiffnesses_in_contrast_cost_few_iterations():
    assert solved(*beam(5, young=1e4)).iterations <= solved(*beam(5)).iterations + 6


def test_slender_elements_are_aggregated_along_strong_couplings(monkeypatch):
    K, unknowns = beam(6, flat=0.15)
    few = solved(K, unknowns, 1e-6).iterations
    monkeypatch.setattr("skfem_stvk.linear.multigrid.STRONG", 0.0)
    assert few < 0.7 * solved(K, unknowns, 1e-6).iterations


def test_rotations_are_needed():
    K, unknowns = beam(5)
    shifts = unknowns.near_null_space()[:, :3]
    without = Unknowns(unknowns.vertex, unknowns.component, K.indptr, K.indices, lambda: shifts)
    assert solved(K, unknowns).iterations < 0.6 * solved(K, without).iterations


@pytest.mark.parametrize("parts", [2, 5])
def test_parts_give_the_same_result_in_at_most_twice_the_iterations(parts, monkeypatch):
    K, unknowns = problem("box")
    whole = solved(K, unknowns, 1e-10)
    in_parts(monkeypatch, parts)
    shared = solved(K, unknowns, 1e-10)
    assert np.abs(shared.x - whole.x).max() < 1e-7 * np.abs(whole.x).max()
    assert shared.iterations <= 2 * whole.iterations


def test_equal_solves_give_bitwise_equal_results():
    K, unknowns = beam(5)
    assert (solved(K, unknowns).x == solved(K, unknowns).x).all()


def test_a_hierarchy_is_reused_for_a_similar_matrix():
    K, unknowns = beam(4)
    analysis = AmgCg().analyse(unknowns)
    first = analysis.factorise(K, Kind.SYMMETRIC).solve(across(unknowns), 1e-8)
    retained = analysis.hierarchy
    again = analysis.factorise(2 * K, Kind.SYMMETRIC).solve(across(unknowns), 1e-8)
    assert analysis.hierarchy is retained and again.iterations == first.iterations
    assert np.abs(2 * again.x - first.x).max() < 1e-6 * np.abs(first.x).max()


def test_a_hierarchy_is_rebuilt_with_current_modes_when_iterations_have_grown():
    (K, unknowns), other = beam(5), beam(5, young=1e4)[0]
    asked = []

    def modes():
        asked.append(1)
        return unknowns.near_null_space()

    analysis = AmgCg().analyse(Unknowns(unknowns.vertex, unknowns.component, K.indptr, K.indices, modes))
    analysis.factorise(K, Kind.SYMMETRIC).solve(across(unknowns), 1e-8)
    retained = analysis.hierarchy
    slow = analysis.factorise(other, Kind.SYMMETRIC).solve(across(unknowns), 1e-8)
    assert analysis.hierarchy is retained and len(asked) == 1
    fast = analysis.factorise(other, Kind.SYMMETRIC).solve(across(unknowns), 1e-8)
    assert analysis.hierarchy is not retained and len(asked) == 2
    assert amg.GROWTH * fast.iterations < slow.iterations
    assert fast.iterations == solved(other, unknowns).iterations


def test_grown_iterations_are_detected_after_a_warm_start_too():
    (K, unknowns), other = beam(5), beam(5, young=1e4)[0]
    analysis, x = AmgCg().analyse(unknowns), solved(other, unknowns, 1e-10).x
    analysis.factorise(K, Kind.SYMMETRIC).solve(across(unknowns), 1e-8)
    retained = analysis.hierarchy
    slow = analysis.factorise(other, Kind.SYMMETRIC).solve(across(unknowns), 1e-8, (1 - 1e-5) * x)
    assert slow.outcome is Outcome.SOLVED and 0.5e-5 < slow.start < 2e-5
    analysis.factorise(other, Kind.SYMMETRIC)
    assert analysis.hierarchy is not retained


@pytest.mark.parametrize("threshold", [None, 0.4])
def test_aggregates_cover_all_vertices_and_have_moderate_sizes(threshold, monkeypatch):
    """A threshold that gives tiny aggregates is lowered."""
    if threshold:
        monkeypatch.setattr("skfem_stvk.linear.multigrid.STRONG", threshold)
    K, unknowns = beam(6)
    rows = VertexRows(unknowns)
    blocks, single = rows.structure.empty_values(), rows.structure.empty_values(np.float32)
    rows.fill(K.data, 1.0, blocks, single)
    numbers = aggregates(rows.graph, rows.structure, blocks)
    sizes = np.bincount(numbers)
    assert len(numbers) == rows.structure.n and sizes.min() >= 1 and MIN_AGGREGATE_SIZE <= sizes.mean() <= 40


def test_diagonals_of_all_levels_are_positive_for_a_cable():
    K, unknowns = problem("cable")
    analysis = AmgCg().analyse(unknowns)
    analysis.factorise(K, Kind.SYMMETRIC)
    levels = analysis.hierarchy._levels
    assert len(levels) > 1
    for level in levels:
        assert np.diag(level.A.dense(level.blocks)).min() > 0


def test_blocks_represent_the_matrix_and_vectors_are_converted_both_ways():
    K, unknowns = problem("box")
    rows = VertexRows(unknowns)
    blocks, single = rows.structure.empty_values(), rows.structure.empty_values(np.float32)
    rows.fill(K.data, 0.5, blocks, single)
    x = np.random.default_rng(0).standard_normal(unknowns.n)
    product = rows.structure.product(blocks, rows.padded(x), np.empty(3 * rows.structure.n))
    assert np.abs(rows.unpadded(product) - K @ x).max() < 1e-13 * np.abs(K @ x).max()
    assert len(product) > unknowns.n and (rows.unpadded(rows.padded(x)) == x).all()
    assert np.abs(single - 0.5 * blocks).max() < 1e-6 * np.abs(blocks).max()


def test_missing_and_wrong_modes_are_refused():
    K, unknowns = problem("box")
    bare = Unknowns(unknowns.vertex, unknowns.component, K.indptr, K.indices)
    with pytest.raises(StvkError, match="near_null_space"):
        AmgCg().analyse(bare)
    wrong = Unknowns(unknowns.vertex, unknowns.component, K.indptr, K.indices, lambda: np.ones((3, 6)))
    with pytest.raises(StvkError, match=rf"shape \(3, 6\); expected \({unknowns.n}, r\)"):
        AmgCg().analyse(wrong).factorise(K, Kind.SYMMETRIC)


def test_vertices_without_full_blocks_are_refused():
    K, unknowns = problem("box")
    K.data[K.indptr[8]] = 0
    K.eliminate_zeros()
    with pytest.raises(StvkError, match="no full block"):
        AmgCg().analyse(Unknowns(unknowns.vertex, unknowns.component, K.indptr, K.indices, unknowns.near_null_space))


def quadratic(size, k=3, bend=0.0, slides=False):
    """Return K of a beam of quadratic elements, curved by `bend` and fixed at one end, and its unknowns.

    With `slides`, the end is fixed only along the beam, except at two nodes.
    """
    lines = np.linspace(0, 5, 5 * size + 1), np.linspace(0, 1, size + 1), np.linspace(0, 1, size + 1)
    mesh = {2: skfem.MeshTri, 3: skfem.MeshTet}[k].init_tensor(*lines[:k])
    straight = ElementMesh(mesh.p, mesh.t).with_degree(2)
    p = straight.p.copy()
    p[1] += bend * np.sin(p[0])
    system = System(ElementMesh(p, straight.t, element=straight.element), StVK(young=1.0, poisson=0.3))
    wall = np.flatnonzero(p[0] == 0)
    constrained = [k * v + c for v in wall for c in range(k) if c == 0 or not slides or v == wall[0]]
    constrained += [k * wall[-1] + c for c in range(k)] if slides else []
    free = system.free_dofs(np.unique(constrained))
    K, modes = free.matrix(system.tangent(np.zeros(system.ndofs))), rigid_motions(p)[free.free]
    return K, Unknowns(*np.divmod(free.free, k), K.indptr, K.indices, lambda: modes, system.mesh.ends())


@pytest.mark.parametrize("of", [{}, {"bend": 0.3}, {"slides": True}, {"k": 2, "bend": 0.3}], ids=str)
def test_corners_are_a_better_second_level_of_quadratic_elements(of):
    K, unknowns = quadratic(2 if of.get("k") != 2 else 6, **of)
    corners, aggregates = solved(K, unknowns), solved(K, replace(unknowns, ends=None))
    assert np.abs(corners.x - aggregates.x).max() < 1e-6 * np.abs(corners.x).max()
    assert corners.iterations < aggregates.iterations


def test_supports_of_a_few_nodes_cost_no_iterations_of_their_own():
    assert solved(*quadratic(3, slides=True)).iterations <= solved(*quadratic(3)).iterations


def test_factors_of_middles_exceed_one_only_next_to_single_supports():
    """Factors are 1 next to a wall, because P is linear on a plane layer; next to single constrained nodes they are larger."""
    for slides in (False, True):
        K, unknowns = quadratic(2, slides=slides)
        analysis = AmgCg().analyse(unknowns)
        analysis.factorise(K, Kind.SYMMETRIC)
        transfer = analysis.hierarchy._transfers[0]
        factors = transfer._factors(analysis.finest)
        assert factors.min() >= 1 and (1.5 < factors.max() <= 2 if slides else factors.max() < 1 + 1e-9)


def test_iterations_of_quadratic_elements_hardly_grow():
    small, large = solved(*quadratic(1, bend=0.3)), solved(*quadratic(3, bend=0.3))
    assert len(large.x) > 12 * len(small.x)
    assert large.iterations <= small.iterations + 6


def test_the_second_level_of_straight_quadratic_elements_is_that_of_linear_ones():
    mesh = ElementMesh.of(skfem.MeshTet().refined(1))
    fine, coarse = (System(mesh, StVK(young=1.0, poisson=0.3), degree=degree) for degree in (2, 1))
    v = 0.2 * np.random.default_rng(0).standard_normal((coarse.mesh.nv, 3))
    A, B = fine.tangent(v[fine.mesh.ends()].mean(axis=1).ravel()), coarse.tangent(v.ravel())
    unknowns = Unknowns(*np.divmod(np.arange(fine.ndofs), 3), A.indptr, A.indices, lambda: np.eye(fine.ndofs, 6), fine.mesh.ends())
    analysis = AmgCg().analyse(unknowns)
    analysis.rows.fill(A.data, 1.0, analysis.finest.blocks, analysis.finest.single)
    transfer = ToCorners(analysis.finest, analysis.rows.midpoints())
    level = transfer.structure.empty_values()
    transfer.galerkin(analysis.finest, level)
    order = analysis.rows.vertices[transfer._corners]
    assert sorted(order) == list(range(coarse.mesh.nv))
    dofs = (3 * order[:, None] + np.arange(3)).ravel()
    expected = B.toarray()[np.ix_(dofs, dofs)]
    assert np.abs(transfer.structure.dense(level) - expected).max() < 1e-13 * np.abs(expected).max()


@pytest.mark.parametrize("ends", [[[0, 1]], "corner", [0, 1], [[0.5, 1.0]] * 9])
def test_ends_are_pairs_of_vertices(ends):
    with pytest.raises(StvkError, match=r"ends = .*; expected \(nv, 2\) vertices"):
        Unknowns(np.arange(3), np.zeros(3, dtype=int), ends=ends)
