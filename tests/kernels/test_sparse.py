"""The kernels of multigrid and of conjugate gradients are operations of dense matrices, and have the stated properties."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse import random as random_graph

from skfem_stvk.kernels import sparse

N = 13
PARTS = {"one part": [0, N], "two parts": [0, 5, N], "an empty part": [0, 5, 5, 9, N]}
in_parts = pytest.mark.parametrize("parts", PARTS.values(), ids=PARTS)


def graph(rng, n=N, m=None):
    """Return the structure of a random block matrix; square structures contain the diagonal and are symmetric."""
    pattern = random_graph(n, m or n, density=0.35, random_state=rng, format="csr")
    if m is None:
        pattern = pattern + pattern.T + csr_matrix(np.eye(n))
    pattern.sort_indices()
    return pattern.indptr.astype(np.int32), pattern.indices.astype(np.int32)


def matrix(rng, n=N):
    """Return a symmetric positive definite matrix of blocks: rows, columns, diagonal, blocks."""
    rows, columns = graph(rng, n)
    row = np.repeat(np.arange(n), np.diff(rows))
    blocks = rng.standard_normal((len(columns), 3, 3))
    place = {pair: k for k, pair in enumerate(zip(row.tolist(), columns.tolist(), strict=True))}
    for (i, j), k in place.items():
        if i > j:
            blocks[k] = blocks[place[j, i]].T
        elif i == j:
            blocks[k] = blocks[k] + blocks[k].T + 40 * np.eye(3)
    return rows, columns, np.flatnonzero(row == columns), blocks.ravel()


def dense(rows, columns, blocks, width=N):
    """Return all entries of a matrix of blocks, (3 n, 3 width)."""
    matrix = np.zeros((len(rows) - 1, width, 3, 3))
    matrix[np.repeat(np.arange(len(rows) - 1), np.diff(rows)), columns] = blocks.reshape(-1, 3, 3)
    return matrix.transpose(0, 2, 1, 3).reshape(3 * len(matrix), 3 * width)


def blocks_of(matrix, rows, columns):
    """Return the blocks of the structure, the inverse of `dense`."""
    every = matrix.reshape(len(rows) - 1, 3, -1, 3).transpose(0, 2, 1, 3)
    return every[np.repeat(np.arange(len(rows) - 1), np.diff(rows)), columns].ravel()


def run(kernel, parts, *arguments):
    """Run a kernel for all parts, and return the last array and the sum of the results."""
    results = [kernel(begin, end, *arguments) for begin, end in pairwise(parts)]
    return arguments[-1], None if results[0] is None else sum(results)


def assert_close(found, wanted, limit=1e-12):
    assert np.abs(found - wanted).max() <= limit * np.abs(wanted).max() > 1e-3 * limit


@in_parts
def test_products_and_sweeps_are_those_of_dense_triangles(parts):
    """Sweeps use the blocks before or after the diagonal within each part, and blocks of other parts only in `A x`."""
    rng = np.random.default_rng(1)
    rows, columns, diagonal, blocks = matrix(rng)
    b, x, y, extra = rng.standard_normal(3 * N), rng.standard_normal(3 * N), rng.standard_normal(3 * N), rng.uniform(0, 1, N)
    part, A = np.searchsorted(parts, np.arange(N), side="right"), dense(rows, columns, blocks)
    own, lower = (np.kron(mask, np.ones((3, 3))) for mask in (part[:, None] == part, np.tri(N, k=-1)))
    D = A * np.kron(np.eye(N), np.ones((3, 3))) + np.diag(np.repeat(extra, 3))
    L, U = A * own * lower, A * own * lower.T
    inverse, _ = run(sparse.invert_diagonal, parts, diagonal, blocks, extra, np.zeros(9 * N))
    assert_close(dense(np.arange(N + 1), np.arange(N), inverse), np.linalg.inv(D))
    norms = np.linalg.norm(A.reshape(N, 3, N, 3), axis=(1, 3)) * (part[:, None] != part)
    assert np.abs(run(sparse.outside_norms, parts, rows, columns, blocks, np.zeros(N))[0] - norms.sum(axis=1) / 2).max() < 1e-12
    for add in (False, True):
        assert_close(run(sparse.product, parts, rows, columns, blocks, x, add, y.copy())[0], A @ x + add * y)
    forward = run(sparse.sweep_forward, parts, rows, columns, diagonal, blocks, inverse, b, np.zeros(3 * N))[0]
    assert_close(forward, np.linalg.solve(L + D, b))
    after = run(sparse.residual_after_forward, parts, rows, columns, diagonal, blocks, extra, x, np.zeros(3 * N))[0]
    assert_close(after, (L + D) @ x - A @ x)
    backward = run(sparse.sweep_backward, parts, rows, columns, blocks, inverse, b, y, x.copy())[0]
    assert_close(backward, x + np.linalg.solve(U + D, b - (A * own) @ x - (A * (1 - own)) @ y))
    assert_close(run(sparse.multiply_diagonal, parts, inverse, x, y.copy())[0], np.linalg.solve(D, x))


@in_parts
def test_vector_kernels_are_the_operations_of_conjugate_gradients(parts):
    p, q, x, r = np.random.default_rng(2).standard_normal((4, N))
    y = x.copy()
    assert sum(sparse.dot(begin, end, p, q) for begin, end in pairwise(parts)) == pytest.approx(p @ q, rel=1e-12)
    s, square = run(sparse.step, parts, 0.7, p, q, y, r.copy())
    assert_close(y, x + 0.7 * p)
    assert_close(s, r - 0.7 * q)
    assert square == pytest.approx(s @ s, rel=1e-12)
    assert_close(run(sparse.update_search_direction, parts, 0.7, p, q.copy())[0], p + 0.7 * q)


@in_parts
def test_products_of_matrices_and_prolongators_are_those_of_dense_matrices(parts):
    rng = np.random.default_rng(3)
    rows, columns, _, blocks = matrix(rng)
    other_rows, other_columns = graph(rng, N, 6)
    other = rng.standard_normal(9 * len(other_columns))
    pattern = csr_matrix((np.ones(len(columns)), columns, rows)) @ csr_matrix(
        (np.ones(len(other_columns)), other_columns, other_rows), shape=(N, 6)
    )
    pattern.sort_indices()
    out_structure = pattern.indptr, pattern.indices
    factors = [rows, columns, blocks, other_rows, other_columns, other, *out_structure, 6]
    wanted = blocks_of(dense(rows, columns, blocks) @ dense(other_rows, other_columns, other, 6), *out_structure)
    assert_close(run(sparse.multiply_blocks, parts, *factors, np.full(9 * pattern.nnz, 7.0))[0], wanted)
    count, inverse, tentative = 2, rng.standard_normal((N, 3, 3)), rng.standard_normal((2 * N, 3, 3))
    out_rows = 4 * np.arange(N + 1)
    own, products = out_rows[:-1] + rng.integers(0, 3, N), rng.standard_normal((4 * N, 3, 3))
    wanted = -0.6 * np.repeat(inverse, 4, axis=0) @ products
    wanted[(own[:, None] + np.arange(count)).ravel()] += tentative
    arguments = out_rows, own, count, inverse.ravel(), 0.6, products.ravel(), tentative.ravel(), np.zeros(36 * N)
    assert_close(run(sparse.smooth_prolongator, parts, *arguments)[0], wanted.ravel())
    order = rng.permutation(N)
    found = run(sparse.transpose_blocks, parts, order, tentative.ravel(), np.zeros(9 * N))[0]
    assert np.array_equal(found.reshape(N, 3, 3), tentative[order].transpose(0, 2, 1))


def aggregate_modes(rng, count=2):
    """Return aggregates of several block rows, of one block row, and with dependent modes."""
    members, starts = rng.permutation(N).astype(np.int32), np.array([0, 4, 5, 9, N], dtype=np.int32)
    modes = rng.standard_normal((N, 3, 3 * count))
    modes[members[5:9], :, 4] = 2 * modes[members[5:9], :, 1]
    return starts, members, np.ascontiguousarray(modes.reshape(N, 3, count, 3).transpose(0, 2, 1, 3)).ravel()


@pytest.mark.parametrize("parts", [[0, 4], [0, 1, 4]])
def test_orthonormal_modes_times_coarse_ones_are_the_modes(parts):
    starts, members, modes = aggregate_modes(np.random.default_rng(5))
    Q, R = modes.copy(), np.zeros(4 * 36)
    run(sparse.orthonormalise, parts, starts, members, 2, Q, R)
    for a, size in enumerate(np.diff(starts)):
        ids = members[starts[a] : starts[a + 1]]
        q, b = (m.reshape(N, 2, 3, 3)[ids].transpose(0, 2, 1, 3).reshape(3 * size, 6) for m in (Q, modes))
        r = R.reshape(4, 2, 2, 3, 3)[a].transpose(0, 2, 1, 3).reshape(6, 6)
        assert np.abs(q @ r - b).max() < 1e-12 and np.abs(np.tril(r, -1)).max() < 1e-12
        gram = q.T @ q
        assert np.abs(gram - np.diag(np.diag(gram))).max() < 1e-12
        assert sorted(np.diag(gram).round(12)) == [0.0] * (6 - min(3 * size, 6) + (a == 2)) + [1.0] * (min(3 * size, 6) - (a == 2))


def unknowns(rng):
    """Return block rows with some constrained components, and their CSR matrix."""
    rows, columns, diagonal, blocks = matrix(rng)
    is_free = rng.random((N, 3)) < 0.7
    is_free[:, 0] |= ~is_free.any(axis=1)
    block, component = np.nonzero(is_free)
    K = csr_matrix(dense(rows, columns, blocks)[np.ix_(is_free.ravel(), is_free.ravel())])
    first = np.flatnonzero(np.diff(block, prepend=-1))
    return rows, columns, diagonal, first, block, component, K


@in_parts
def test_csr_values_become_blocks_with_a_diagonal_at_constrained_components(parts):
    rows, columns, diagonal, first, block, component, K = unknowns(np.random.default_rng(6))
    blocks, single = np.full(9 * len(columns), 7.0), np.full(9 * len(columns), 7.0, np.float32)
    arguments = rows, columns, diagonal, first, block, component, K.indptr, K.indices, K.data, 0.1, blocks, single
    run(sparse.fill_blocks, parts, *arguments)
    wanted, at = 10 * np.eye(3 * N), 3 * block + component
    wanted[np.ix_(at, at)] = K.toarray()
    assert np.array_equal(dense(rows, columns, blocks), wanted)
    assert_close(single, 0.1 * blocks, 1e-6)


def test_dense_matrices_are_inverted_and_indefinite_ones_are_noticed():
    a = dense(*(matrix(np.random.default_rng(7))[k] for k in (0, 1, 3)))
    inverse = a.copy()
    assert sparse.invert_dense(inverse) and np.abs(inverse @ a - np.eye(3 * N)).max() < 1e-12
    values, vectors = np.linalg.eigh(a)
    values[0] = -1.0
    assert not sparse.invert_dense((vectors * values) @ vectors.T)


def test_inverses_of_indefinite_diagonal_blocks_are_positive_definite():
    rng = np.random.default_rng(8)
    blocks = rng.standard_normal((N, 3, 3))
    blocks = (blocks + blocks.transpose(0, 2, 1)).ravel()
    assert np.linalg.eigvalsh(blocks.reshape(N, 3, 3)).min() < -0.1
    D, out = blocks.reshape(N, 3, 3), np.zeros(9 * N)
    negative = sparse.invert_diagonal(0, N, np.arange(N), blocks, np.zeros(N), out)
    found = out.reshape(N, 3, 3)
    assert negative == (np.linalg.eigvalsh(D) < 0).sum() and np.linalg.eigvalsh(found).min() > 0
    assert np.abs(found @ D @ found @ D - np.eye(3)).max() < 1e-9  # L^-T |P|^-1 L^-1 of D = L P L'


def test_zero_pivots_are_replaced_by_the_size_of_the_block():
    blocks, out = np.array([np.diag([2.0, 0, -3]), np.zeros((3, 3))]), np.zeros(18)
    assert sparse.invert_diagonal(0, 2, np.arange(2), blocks.ravel(), np.zeros(2), out) == 1
    assert np.allclose(out.reshape(2, 3, 3), [np.diag([1 / 2, 1 / 5, 1 / 3]), np.eye(3)], rtol=1e-15)


def test_a_backward_sweep_is_the_adjoint_of_a_forward_one_in_parts():
    """Both sweeps together are a symmetric positive definite operator, and the error decreases in the norm of A."""
    rng = np.random.default_rng(9)
    rows, columns, diagonal, blocks = matrix(rng)
    A, parts = dense(rows, columns, blocks), [0, 4, 9, N]
    extra, inverse, M = np.zeros(N), np.zeros(9 * N), np.zeros((3 * N, 3 * N))
    pairs = list(pairwise(parts))
    for begin, end in pairs:
        sparse.outside_norms(begin, end, rows, columns, blocks, extra)
        sparse.invert_diagonal(begin, end, diagonal, blocks, extra, inverse)
    for k, b in enumerate(np.eye(3 * N)):
        x = np.zeros(3 * N)
        for begin, end in pairs:
            sparse.sweep_forward(begin, end, rows, columns, diagonal, blocks, inverse, b, x)
        before = x.copy()
        for begin, end in pairs:
            sparse.sweep_backward(begin, end, rows, columns, blocks, inverse, b, before, x)
        M[k] = x
    assert np.abs(M - M.T).max() < 1e-12 * np.abs(M).max()
    assert np.linalg.eigvalsh(M).min() > 0
    assert np.abs(np.linalg.eigvals(np.eye(3 * N) - M @ A)).max() < 1
