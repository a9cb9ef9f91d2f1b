"""The compiled loop of conjugate gradients: against its twin, and every iterate against that of the system without what is held."""

import numpy as np
import pytest
from linear.problems import NAMES, body, held

from skfem_stvk.kernels import cg, readable
from skfem_stvk.kernels.cg import MORE, NEGATIVE, NOT_FINITE, SMALL, P, Q, R, X
from skfem_stvk.linear import BlockJacobiCg, Kind, Unknowns
from skfem_stvk.system import FreeOperator


class Problem:
    """A body, stretched and shifted, as what the kernels read and as the matrix of its unknowns."""

    def __init__(self, name="box", dtype=np.float64, shift=0.5):
        system = body(name)
        self.free, d, x = held(system), system.mesh.d, system.mesh.p.T
        u = self.free.vector((0.1 * (x - x.min(axis=0)) @ np.eye(d)[::-1]).ravel()[self.free.free])
        n = len(self.free.free)
        tangent = system.linear_operator(u)
        self.shift = shift * np.random.default_rng(2).uniform(1, 2, n)
        self.operator = FreeOperator(tangent, self.free, self.shift)
        self.K = self.free.matrix(system.tangent(u)).toarray() + np.diag(self.shift)
        search = BlockJacobiCg().analyse(Unknowns(self.free.free // d, self.free.free % d))
        search = search.factorise(self.operator, Kind.SYMMETRIC)._search
        self.edges, self.held, self.places = search.edges, search._held, search._places
        self.blocks, self.diagonal, self.inverse = search._blocks.astype(dtype), search.diagonal.copy(), search.inverse.copy()
        self.b = np.random.default_rng(3).standard_normal(n)
        self.vertex = self.free.free // d

    def begin(self, kernels=cg, x0=0.0, held=None):
        work, state = np.zeros((4, 3 * (len(self.inverse) // 9))), np.zeros(3)
        work[X, self.places] = x0
        held = self.held if held is None else held
        kernels.residual(self.edges, self.blocks, self.diagonal, self.inverse, held, self.places, self.b, state, work)
        return work, state

    def iterate(self, work, state, most, kernels=cg, enough=0.0, held=None):
        held = self.held if held is None else held
        return kernels.iterate(self.edges, self.blocks, self.diagonal, self.inverse, held, enough, most, state, work)

    def iterates(self, most, held=None):
        """x after each iteration."""
        work, state = self.begin(held=held)
        for _ in range(most):
            self.iterate(work, state, 1, held=held)
            yield work[X, self.places].copy()


def textbook(K, b, vertex, most):
    """Iterates over the unknowns alone, with the inverses of the blocks of vertices."""
    D = np.linalg.inv(np.where(vertex[:, None] == vertex, K, 0))
    x, r = np.zeros_like(b), b.copy()
    z = p = D @ r
    for _ in range(most):
        alpha = z @ r / (p @ K @ p)
        x, rho = x + alpha * p, z @ r
        r = r - alpha * K @ p
        z = D @ r
        p = z + z @ r / rho * p
        yield x


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_to_filter_what_is_held_is_to_leave_it_out_of_the_system(name, shift):
    problem = Problem(name, shift=shift)
    assert len(problem.held) > 3
    found = list(problem.iterates(25))
    for x, wanted in zip(found, textbook(problem.K, problem.b, problem.vertex, 25), strict=True):
        assert np.abs(x - wanted).max() < 1e-9 * np.abs(wanted).max()
    assert np.abs(found[1] - found[0]).max() > 1e-3 * np.abs(found[0]).max()


def test_without_the_filter_the_iterates_are_others():
    problem = Problem()
    found = list(problem.iterates(10, held=problem.held[:0]))[-1]
    *_, wanted = textbook(problem.K, problem.b, problem.vertex, 10)
    assert np.abs(found - wanted).max() > 1e-2 * np.abs(wanted).max()


@pytest.mark.parametrize("name", NAMES)
def test_what_is_held_stays_zero_in_all_vectors(name):
    problem = Problem(name)
    work, state = problem.begin(x0=0.1)
    problem.iterate(work, state, 7)
    assert not work[:, problem.held].any() and (np.abs(work[:, problem.places]).max(axis=1) > 1e-3).all()


@pytest.mark.parametrize("assembled", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_compiled_and_readable_loops_agree(name, assembled):
    problem = Problem(name)
    if assembled:
        rows = np.arange(len(problem.inverse) // 9)
        A = readable.matrix_of_edges(problem.edges, problem.blocks, problem.diagonal, len(rows))
        problem.diagonal = A.reshape(len(rows), 3, len(rows), 3)[rows, :, rows].ravel()
    x0 = 0.1 * np.random.default_rng(4).standard_normal(len(problem.b))
    one, other = problem.begin(x0=x0), problem.begin(readable, x0)
    for most in (0, 1, 9):
        assert problem.iterate(*one, most) == problem.iterate(*other, most, readable) == (MORE, most)
        for compiled, twin in zip(one, other, strict=True):
            assert np.abs(twin).max() > 1e-3 and np.abs(compiled - twin).max() < 1e-9 * np.abs(twin).max()


@pytest.mark.parametrize("shifted", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_diagonals_agree_and_are_those_of_the_matrix(name, shifted):
    problem = Problem(name)
    shift = problem.shift if shifted else problem.shift[:0]
    found = {}
    for kernels in (cg, readable):
        diagonal, out = np.zeros_like(problem.diagonal), np.full_like(problem.inverse, 7.0)
        total = kernels.shifted_diagonal(problem.edges, problem.blocks, problem.held, problem.places, shift, diagonal, out)
        found[kernels] = total, diagonal, out
    for one, other in zip(found[cg], found[readable], strict=True):
        assert np.abs(one - other).max() <= 1e-13 * np.abs(other).max()
    K = problem.K - (0 if shifted else np.diag(problem.shift))
    row, component = np.divmod(problem.places, 3)
    found = found[cg][2].reshape(-1, 3, 3)[row, component, component]
    assert np.abs(found - K.diagonal()).max() < 1e-13 * np.abs(K).max()


@pytest.mark.parametrize("name", NAMES)
def test_a_matrix_becomes_the_same_edges_by_both_ways(name):
    problem = Problem(name)
    structure = problem.free.structure
    row = np.repeat(range(len(problem.b)), np.diff(structure.indptr))
    K = structure.matrix(problem.K[row, structure.indices])
    d = problem.operator.tangent.nodal_shape[1]
    analysis = BlockJacobiCg(assembled=True).analyse(Unknowns(*np.divmod(problem.free.free, d), K.indptr, K.indices))
    rows, above = analysis._rows, analysis._above
    found = {}
    for kernels in (cg, readable):
        room = [np.full(9 * n, 7.0) for n in (len(above.columns), above.n)]
        kernels.fill_edges(above.rows, above.columns, rows.first, rows.row, rows.component, K.indptr, K.indices, K.data, *room)
        found[kernels] = room
    for one, other in zip(found[cg], found[readable], strict=True):
        assert np.abs(one - other).max() <= 1e-13 * np.abs(other).max()
    A = readable.matrix_of_edges(analysis._search.edges, found[cg][0], found[cg][1], above.n)[rows.places][:, rows.places]
    assert np.abs(A - problem.K).max() < 1e-13 * np.abs(problem.K).max()


def test_the_loop_goes_on_bit_for_bit_where_it_was_left():
    problem = Problem()
    whole, parts = problem.begin(), problem.begin()
    assert problem.iterate(*whole, 12) == (MORE, 12)
    for most in (1, 4, 7):
        problem.iterate(*parts, most)
    assert np.array_equal(whole[0], parts[0]) and np.array_equal(whole[1], parts[1])


def test_it_ends_when_the_residual_is_small():
    problem = Problem()
    work, state = problem.begin()
    enough = 1e-6 * state[0]
    ended, done = problem.iterate(work, state, 1000, enough=enough)
    assert ended == SMALL and 5 < done < 300 and state[0] <= enough
    assert np.linalg.norm(problem.b - problem.K @ work[X, problem.places]) == pytest.approx(state[0], rel=1e-6)
    assert problem.iterate(work, state, 1000, enough=enough) == (SMALL, 0)


def test_a_residual_from_somewhere_is_that_of_the_matrix():
    problem = Problem("sheet")
    x0 = np.random.default_rng(4).standard_normal(len(problem.b))
    work, state = problem.begin(x0=x0)
    wanted = problem.b - problem.K @ x0
    assert np.abs(work[R, problem.places] - wanted).max() < 1e-13 * np.abs(wanted).max()
    assert state[0] == pytest.approx(np.linalg.norm(wanted)) and not work[P].any() and work[Q].any()


def test_negative_curvature_is_noticed_before_the_step():
    problem = Problem()
    problem.blocks *= -1
    work, state = problem.begin()
    assert problem.iterate(work, state, 5) == (NEGATIVE, 0) and not work[X].any()


def test_what_is_not_finite_is_noticed():
    problem = Problem()
    work, state = problem.begin()
    problem.blocks[17] = np.nan
    assert problem.iterate(work, state, 5)[0] == NOT_FINITE


def test_blocks_in_single_precision_are_multiplied_in_double():
    problem, rounded = Problem(), Problem(dtype=np.float32)
    (*_, x), (*_, y) = problem.iterates(5), rounded.iterates(5)
    assert 1e-9 < np.abs(x - y).max() / np.abs(x).max() < 1e-5
