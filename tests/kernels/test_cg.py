"""Compiled conjugate gradients agree with conjugate gradients on the dense system of unknowns."""

import numpy as np
import pytest
from linear.problems import NAMES, body, supported

from skfem_stvk.kernels import compiled_cg as cg
from skfem_stvk.kernels.compiled_cg import CONVERGED, NEGATIVE, NOT_FINITE, UNFINISHED, P, S, T, U, X
from skfem_stvk.linear import BlockJacobiCg, Kind, SsorCg, Unknowns
from skfem_stvk.system import FreeOperator

DIAGONAL = BlockJacobiCg()
preconditioned = pytest.mark.parametrize("solver", [DIAGONAL, SsorCg()], ids=lambda solver: solver.name)


class Problem:
    """Data of a stretched body with a shift and ground blocks, both as arrays of the kernels and as the matrix of its unknowns."""

    def __init__(self, name="box", dtype=np.float64, shift=0.5, solver=DIAGONAL, stiff=1.0):
        system = body(name)
        self.free, d, x = supported(system), system.mesh.d, system.mesh.p.T
        u = self.free.vector((0.1 * (x - x.min(axis=0)) @ np.eye(d)[::-1]).ravel()[self.free.free])
        n = len(self.free.free)
        tangent = system.linear_operator(u)
        self.shift = shift * np.random.default_rng(2).uniform(1, 2, n)
        self.operator = FreeOperator(tangent, self.free, self.shift)
        self.K = self.free.matrix(system.tangent(u)).toarray() + np.diag(self.shift)
        search = solver.analyse(Unknowns(self.free.free // d, self.free.free % d))
        edges = self.operator.by_edges()
        self.grounded, roots = np.arange(0, len(edges.vertices), 3), np.zeros((len(edges.vertices[::3]), 3, 3))
        roots[:, :d, :d] = np.random.default_rng(5).standard_normal((len(roots), d, d))
        self.ground = (roots @ roots.transpose(0, 2, 1)).ravel() * np.abs(self.K).max() / 9 * stiff
        self.operator.by_edges = lambda: edges._replace(grounded=self.grounded, ground=self.ground)
        search = search.factorise(self.operator, Kind.SYMMETRIC)._search
        self.edges, self.constrained, self.indices, self.omega = search.edges, search._constrained, search._indices, solver.omega
        self.blocks, self.diagonal, self.inverse = search._blocks.astype(dtype), search.diagonal.copy(), search.inverse.copy()
        self.b = np.random.default_rng(3).standard_normal(n)
        for row, block in zip(self.grounded, self.ground.reshape(-1, 3, 3), strict=True):
            own = np.flatnonzero(self.indices // 3 == row)
            self.K[np.ix_(own, own)] += block[np.ix_(self.indices[own] % 3, self.indices[own] % 3)]

    @property
    def own_ground(self):
        return self.grounded, self.ground

    def begin(self, kernels=cg, x0=0.0, constrained=None):
        work, state = np.zeros((6, 3 * (len(self.inverse) // 9))), np.zeros(4)
        work[X, self.indices] = x0
        constrained = self.constrained if constrained is None else constrained
        own = self.edges, self.blocks, self.diagonal, *self.own_ground
        kernels.residual(*own, constrained, self.indices, self.b, state, work)
        return work, state

    def iterate(self, work, state, most, kernels=cg, enough=0.0, constrained=None):
        constrained = self.constrained if constrained is None else constrained
        own = self.edges, self.blocks, self.diagonal, *self.own_ground, self.inverse, constrained, self.omega
        return kernels.iterate(*own, enough, most, state, work)

    def iterates(self, most, constrained=None):
        """Yield x after each iteration."""
        work, state = self.begin(constrained=constrained)
        for _ in range(most):
            self.iterate(work, state, 1, constrained=constrained)
            yield work[X, self.indices].copy()

    def preconditioner(self):
        """Return M of the unknowns, dense, in their order; rows of K and their vertices have the numbers of the kernels."""
        row = self.indices // 3
        D = np.where(row[:, None] == row, self.K, 0)
        if not self.omega:
            return D
        E, L = D / self.omega, np.where(row[:, None] > row, self.K, 0)
        return (E + L) @ np.linalg.inv(E) @ (E + L).T


def textbook(K, b, M, most):
    """Yield iterates of preconditioned conjugate gradients on the dense matrix of the unknowns."""
    x, r = np.zeros_like(b), b.copy()
    z = p = np.linalg.solve(M, r)
    for _ in range(most):
        alpha = z @ r / (p @ K @ p)
        x, rho = x + alpha * p, z @ r
        r = r - alpha * K @ p
        z = np.linalg.solve(M, r)
        p = z + z @ r / rho * p
        yield x


@preconditioned
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_filtered_iterates_are_those_of_the_system_of_unknowns(name, shift, solver):
    problem = Problem(name, shift=shift, solver=solver)
    assert len(problem.constrained) > 3
    found = list(problem.iterates(15))
    for x, wanted in zip(found, textbook(problem.K, problem.b, problem.preconditioner(), 15), strict=True):
        assert np.abs(x - wanted).max() < 1e-9 * np.abs(wanted).max()
    assert np.abs(found[1] - found[0]).max() > 1e-3 * np.abs(found[0]).max()


@preconditioned
def test_iterates_differ_without_the_filter(solver):
    problem = Problem(solver=solver)
    problem.inverse = np.where(problem.inverse == 0, 1.0, problem.inverse)
    found = list(problem.iterates(10, constrained=problem.constrained[:0]))[-1]
    *_, wanted = textbook(problem.K, problem.b, problem.preconditioner(), 10)
    assert np.abs(found - wanted).max() > 1e-2 * np.abs(wanted).max()


@pytest.mark.few
@preconditioned
@pytest.mark.parametrize("name", NAMES)
def test_constrained_components_stay_zero_in_all_vectors(name, solver):
    problem = Problem(name, solver=solver)
    work, state = problem.begin(x0=0.1)
    problem.iterate(work, state, 3)
    vectors = work[[X, S, P, T, U]]
    assert not vectors[:, problem.constrained].any() and (np.abs(vectors[:, problem.indices]).max(axis=1) > 1e-3).all()


@pytest.mark.few
@preconditioned
@pytest.mark.parametrize("name", NAMES)
def test_the_preconditioner_is_the_inverse_of_m_symmetric_and_positive_definite(name, solver):
    problem = Problem(name, solver=solver)
    inverse = np.empty_like(problem.K)
    for column, unit in zip(inverse.T, np.eye(len(problem.b)), strict=True):
        work = np.full((6, 3 * (len(problem.inverse) // 9)), 7.0)
        work[S] = 0
        work[S, problem.indices] = unit
        cg.precondition(problem.edges, problem.blocks, problem.inverse, problem.constrained, problem.omega, work)
        column[:] = work[T, problem.indices]
        assert not work[T, problem.constrained].any()
    assert np.abs(inverse @ problem.preconditioner() - np.eye(len(inverse))).max() < 1e-9
    assert np.abs(inverse - inverse.T).max() < 1e-12 * np.abs(inverse).max() and np.linalg.eigvalsh(inverse).min() > 0
    assert np.linalg.cond(inverse @ problem.K) < np.linalg.cond(problem.K)


@pytest.mark.few
@pytest.mark.parametrize("shifted", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_diagonals_are_those_of_the_matrix(name, shifted):
    problem = Problem(name)
    shift = problem.shift if shifted else problem.shift[:0]
    diagonal, out = np.zeros_like(problem.diagonal), np.full_like(problem.inverse, 7.0)
    own = problem.edges, problem.blocks, *problem.own_ground, problem.constrained, problem.indices
    cg.shifted_diagonal(*own, shift, diagonal, out)
    K = problem.K - (0 if shifted else np.diag(problem.shift))
    row, component = np.divmod(problem.indices, 3)
    found = out.reshape(-1, 3, 3)[row, component, component]
    assert np.abs(found - K.diagonal()).max() < 1e-13 * np.abs(K).max()


def matrix_of_edges(edges, blocks, diagonal, n):
    """Return the dense matrix (3 n, 3 n) of blocks above the diagonal, and of diagonal blocks."""
    A = np.zeros((n, n, 3, 3))
    A[range(n), range(n)] = diagonal.reshape(n, 3, 3)
    for (a, b), block in zip(edges, blocks.reshape(-1, 3, 3), strict=True):
        A[a, b] += block
        A[b, a] += block.T
    return A.swapaxes(1, 2).reshape(3 * n, 3 * n)


@pytest.mark.parametrize("name", NAMES)
def test_edge_blocks_of_a_matrix_are_that_matrix(name):
    problem = Problem(name)
    structure = problem.free.structure
    row = np.repeat(range(len(problem.b)), np.diff(structure.indptr))
    K = structure.matrix(problem.K[row, structure.indices])
    d = problem.operator.tangent.nodal_shape[1]
    analysis = BlockJacobiCg(assembled=True).analyse(Unknowns(*np.divmod(problem.free.free, d), K.indptr, K.indices))
    rows, above = analysis._rows, analysis._above
    arrays = [np.full(9 * n, 7.0) for n in (len(above.columns), above.n)]
    cg.fill_edges(above.rows, above.columns, rows.first, rows.row, rows.component, K.indptr, K.indices, K.data, *arrays)
    A = matrix_of_edges(analysis._search.edges, *arrays, above.n)
    A = A[np.ix_(rows.unknown_indices, rows.unknown_indices)]
    assert np.abs(A - problem.K).max() < 1e-13 * np.abs(problem.K).max()


@preconditioned
def test_an_interrupted_loop_continues_bit_for_bit(solver):
    problem = Problem(solver=solver)
    whole, parts = problem.begin(), problem.begin()
    assert problem.iterate(*whole, 12) == (UNFINISHED, 12)
    for most in (1, 4, 7):
        problem.iterate(*parts, most)
    assert np.array_equal(whole[0], parts[0]) and np.array_equal(whole[1], parts[1])


@pytest.mark.few
@preconditioned
@pytest.mark.parametrize("name", NAMES)
def test_the_loop_ends_soon_after_the_residual_is_small(name, solver):
    problem = Problem(name, solver=solver)
    work, state = problem.begin()
    enough = 1e-6 * state[0]
    ended, done = problem.iterate(work, state, 1000, enough=enough)
    residuals = [np.linalg.norm(problem.b - problem.K @ x) for x in problem.iterates(done)]
    assert ended == CONVERGED and state[0] <= enough
    assert 5 < done <= 3 + 1.1 * np.argmax(np.array(residuals) <= enough)
    assert np.linalg.norm(problem.b - problem.K @ work[X, problem.indices]) == pytest.approx(state[0], rel=1e-6)
    assert problem.iterate(work, state, 1000, enough=enough) == (CONVERGED, 0)


def test_the_residual_of_a_nonzero_start_is_that_of_the_matrix():
    problem = Problem("sheet")
    x0 = np.random.default_rng(4).standard_normal(len(problem.b))
    work, state = problem.begin(x0=x0)
    wanted = problem.b - problem.K @ x0
    assert np.abs(work[S, problem.indices] - wanted).max() < 1e-13 * np.abs(wanted).max()
    assert state[0] == pytest.approx(np.linalg.norm(wanted)) and not work[P].any()


def test_negative_curvature_is_noticed_before_the_step():
    problem = Problem()
    problem.blocks *= -1
    work, state = problem.begin()
    assert problem.iterate(work, state, 5) == (NEGATIVE, 0) and not work[X].any()


@preconditioned
def test_negative_curvature_behind_a_positive_definite_diagonal_is_found(solver):
    problem = Problem(shift=-0.02, solver=solver, stiff=0.0)
    assert np.linalg.eigvalsh(problem.K)[0] < 0 < np.linalg.eigvalsh(problem.preconditioner())[0]
    work, state = problem.begin()
    ended, done = problem.iterate(work, state, 300)
    assert ended == NEGATIVE and done < 100 and np.isfinite(work).all()


@preconditioned
def test_values_that_are_not_finite_are_reported(solver):
    problem = Problem(solver=solver)
    work, state = problem.begin()
    problem.blocks[17] = np.nan
    assert problem.iterate(work, state, 5)[0] == NOT_FINITE


@preconditioned
def test_blocks_in_single_precision_are_multiplied_in_double(solver):
    problem, rounded = Problem(solver=solver), Problem(dtype=np.float32, solver=solver)
    (*_, x), (*_, y) = problem.iterates(5), rounded.iterates(5)
    assert 1e-9 < np.abs(x - y).max() / np.abs(x).max() < 1e-5
