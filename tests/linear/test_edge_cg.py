"""The compiled loop on edge blocks gives the same results as products do.

It uses the newest matrix, and arrays that are made once.
"""

import tracemalloc

import numpy as np
import pytest
import skfem
from bodies import MESHES, state
from linear.problems import NAMES, body, problem, supported

from skfem_stvk import StVK, System
from skfem_stvk.errors import StateError, StvkError
from skfem_stvk.linear import BlockJacobiCg, Kind, Outcome, SsorCg, Unknowns, cg
from skfem_stvk.linear.block_cg import BlockJacobiFactors
from skfem_stvk.linear.cg import EdgeFactors
from skfem_stvk.system import FreeOperator

SYMMETRIC = Kind.SYMMETRIC
preconditioned = pytest.mark.parametrize("solver", [BlockJacobiCg(), SsorCg()], ids=lambda solver: solver.name)


class Products:
    """Operator that does not offer its edge blocks."""

    def __init__(self, operator):
        self.matvec, self.diagonal_blocks = operator.matvec, operator.diagonal_blocks


def operator_of(name="box", amount=0.05, shift=None):
    """Return the operator of a stretched body, its unknowns, and a load."""
    system = body(name)
    free, d, x = supported(system), system.mesh.d, system.mesh.p.T
    u = free.vector(amount * (x - x.min(axis=0)).ravel()[free.free])
    operator = FreeOperator(system.linear_operator(u), free, shift)
    return operator, Unknowns(*np.divmod(free.free, d)), np.random.default_rng(3).standard_normal(len(free.free))


@pytest.mark.few
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shifted", [False, True])
def test_both_loops_take_the_same_iterations(name, shifted):
    operator, unknowns, b = operator_of(name)
    if shifted:
        operator.shift = np.linspace(1, 2, len(b))
    compiled = BlockJacobiCg().analyse(unknowns).factorise(operator, SYMMETRIC)
    other = BlockJacobiCg().analyse(unknowns).factorise(Products(operator), SYMMETRIC)
    assert isinstance(compiled, EdgeFactors) and isinstance(other, BlockJacobiFactors)
    one, two = compiled.solve(b, 1e-8), other.solve(b, 1e-8)
    assert one.outcome is two.outcome is Outcome.SOLVED and abs(one.iterations - two.iterations) <= 2 + 0.02 * two.iterations
    assert np.abs(one.x - two.x).max() < 1e-5 * np.abs(two.x).max()
    assert np.linalg.norm(b - operator @ one.x) <= 1e-8 * np.linalg.norm(b) * (1 + 1e-6)
    assert np.abs(compiled.precondition(b) - other.precondition(b)).max() < 1e-12 * np.abs(other.precondition(b)).max()


@preconditioned
def test_new_factors_use_only_the_changed_operator(solver):
    operator, unknowns, b = operator_of(shift=np.zeros(len(operator_of()[2])))
    analysis = solver.analyse(unknowns)
    old = analysis.factorise(operator, SYMMETRIC).solve(b, 1e-9)
    operator.shift[:] = 3.0
    operator.tangent.scale_and_add(2.0)
    new = analysis.factorise(operator, SYMMETRIC).solve(b, 1e-9)
    assert np.linalg.norm(b - operator @ new.x) <= 1.1e-9 * np.linalg.norm(b) < 1e-3 < np.abs(new.x - old.x).max()
    operator.shift = None
    unshifted = analysis.factorise(operator, SYMMETRIC).solve(2 * b, 1e-9)
    assert np.abs(unshifted.x - old.x).max() < 1e-6 * np.abs(old.x).max()


@preconditioned
def test_unknowns_without_an_element_are_solved_for_with_products(solver):
    mesh = MESHES["tetrahedra"]
    with pytest.warns(match="in no term"):
        system = System(mesh, StVK(young=2.0, poisson=0.3, region=np.arange(20)))
    free = system.free_dofs(np.arange(6))
    operator = FreeOperator(system.linear_operator(0 * state(mesh)), free, np.full(len(free.free), 2.0))
    factors = solver.analyse(Unknowns(*np.divmod(free.free, 3))).factorise(operator, SYMMETRIC)
    b = np.cos(np.arange(len(free.free)))
    assert isinstance(factors, BlockJacobiFactors) and operator.by_edges() is not None
    assert np.linalg.norm(b - operator @ factors.solve(b, 1e-9).x) <= 1.1e-9 * np.linalg.norm(b)


@preconditioned
def test_the_iteration_limit_returns_the_last_iterate(monkeypatch, solver):
    monkeypatch.setattr(cg, "MAX_ITERATIONS", 7)
    operator, unknowns, b = operator_of()
    solution = solver.analyse(unknowns).factorise(operator, SYMMETRIC).solve(b, 1e-12)
    assert solution.outcome is Outcome.OUT_OF_ITERATIONS and solution.iterations == 7
    assert solution.residual == pytest.approx(np.linalg.norm(b - operator @ solution.x) / np.linalg.norm(b))


@preconditioned
@pytest.mark.parametrize("stretch", [1, 100_000])
def test_interruptible_sections_do_not_change_the_result(stretch, monkeypatch, solver):
    operator, unknowns, b = operator_of()
    factors = solver.analyse(unknowns).factorise(operator, SYMMETRIC)
    whole = factors.solve(b, 1e-10)
    monkeypatch.setattr(cg, "STRETCH", stretch)
    again = factors.solve(b, 1e-10)
    assert np.array_equal(again.x, whole.x) and again.iterations == whole.iterations


@preconditioned
def test_a_shift_that_is_not_finite_is_refused_with_the_vertex(solver):
    operator, unknowns, _ = operator_of(shift=np.ones(len(operator_of()[2])))
    operator.shift[11] = np.nan
    with pytest.raises(StateError, match=rf"not finite at 1 vertex \({unknowns.vertex[11]}\)"):
        solver.analyse(unknowns).factorise(operator, SYMMETRIC)


@preconditioned
def test_a_shift_of_another_length_is_refused(solver):
    operator, unknowns, b = operator_of()
    operator.shift = np.ones(len(b) + 1)
    with pytest.raises(StvkError, match=rf"shape \({len(b) + 1},\); expected \({len(b)},\)"):
        solver.analyse(unknowns).factorise(operator, SYMMETRIC)


@pytest.mark.few
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_ssor_solves_with_fewer_iterations_than_diagonal_blocks(name, shift):
    operator, unknowns, b = operator_of(name, shift=np.full(len(operator_of(name)[2]), shift))
    start = np.cos(np.arange(len(b)))
    factors = [solver.analyse(unknowns).factorise(operator, SYMMETRIC) for solver in (SsorCg(), BlockJacobiCg())]
    one, other = (each.solve(b, 1e-9, start) for each in factors)
    wanted = np.linalg.solve(operator @ np.eye(len(b)), b)
    assert one.outcome is Outcome.SOLVED and np.abs(one.x - wanted).max() < 1e-5 * np.abs(wanted).max()
    assert one.iterations < 0.6 * other.iterations or name == "cable"
    assert factors[0].solve(b, 1e-6, one.x).iterations == 0


def test_an_indefinite_diagonal_block_is_negative_curvature_before_any_iteration():
    operator, unknowns, b = operator_of(shift=np.zeros(len(operator_of()[2])))
    operator.shift[7] = -100.0
    analysis = SsorCg().analyse(unknowns)
    solution = analysis.factorise(operator, SYMMETRIC).solve(b, 1e-9, 0.1 * b)
    assert solution.outcome is Outcome.NEGATIVE_CURVATURE and np.array_equal(solution.x, 0.1 * b) and solution.iterations == 0
    operator.shift[7] = 1.0
    assert analysis.factorise(operator, SYMMETRIC).solve(b, 1e-9).outcome is Outcome.SOLVED


@preconditioned
def test_assembled_and_edge_solvers_take_the_same_iterations(solver):
    K, unknowns = problem("box")
    operator, _, b = operator_of(amount=0.0)
    one = type(solver)(assembled=True).analyse(unknowns).factorise(K, SYMMETRIC).solve(b, 1e-8)
    two = solver.analyse(unknowns).factorise(operator, SYMMETRIC).solve(b, 1e-8)
    assert abs(one.iterations - two.iterations) <= 2 + 0.1 * one.iterations * (solver == SsorCg())  # rows are numbered differently
    assert np.abs(one.x - two.x).max() < 1e-6 * np.abs(two.x).max()


def grown(call, times=5):
    """Return the largest number of bytes that calls allocate temporarily, after three calls that make permanent arrays."""
    for _ in range(3):
        call()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        tracemalloc.reset_peak()
        for _ in range(times):
            call()
        return tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


@preconditioned
def test_repeated_steps_allocate_no_arrays(solver):
    system = System(skfem.MeshTet().refined(4), StVK(young=2.0, poisson=0.3))
    free = system.free_dofs(np.flatnonzero(np.repeat(system.mesh.p[0] == 0, 3)))
    n = len(free.free)
    rest, tangent = system.linear_operator(np.zeros(system.ndofs)), system.linear_operator(np.zeros(system.ndofs))
    operator, analysis = FreeOperator(tangent, free, np.ones(n)), solver.analyse(Unknowns(*np.divmod(free.free, 3)))
    u, force, b, x = 0.01 * state(system.mesh), np.zeros((system.mesh.nv, 3)), np.cos(np.arange(n)), np.zeros(n)

    def step():
        tangent.prepare(u, force=force)
        tangent.scale_and_add(1.1, [(0.1, rest)])
        analysis.factorise(operator, SYMMETRIC).solve(b, 1e-6, x, x)

    assert n > 10_000 and grown(step) < 4 * n
