"""The kernels of multigrid and of conjugate gradients agree with their readable twins and have the stated properties."""

from itertools import pairwise

import numpy as np
import pytest
from kernels import readable
from scipy.sparse import csr_matrix
from scipy.sparse import random as random_graph

from skfem_stvk.kernels import sparse

N = 13
PARTS = {"one part": [0, N], "two parts": [0, 5, N], "an empty part": [0, 5, 5, 9, N]}
TWINS = pytest.mark.parametrize("parts", PARTS.values(), ids=PARTS)


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


def on_both(name, parts, arguments, outputs):
    """Return the results of the kernel and of its twin: the arguments numbered `outputs` and the returned values."""
    found = []
    for module in (sparse, readable):
        own = [a.copy() if isinstance(a, np.ndarray) else a for a in arguments]
        returned = [getattr(module, name)(b, e, *own) for b, e in pairwise(parts)]
        found.append([own[k] for k in outputs] + [np.array(returned, dtype=float)])
    return found


def assert_twins(name, parts, arguments, outputs, limit=1e-12):
    kernel, twin = on_both(name, parts, arguments, outputs)
    for one, other in zip(kernel, twin, strict=True):
        one, other = np.nan_to_num(one), np.nan_to_num(other)
        assert np.abs(one - other).max() <= limit * max(np.abs(other).max(), 1e-300)
    assert max(np.abs(np.nan_to_num(value)).max() for value in twin) > 1e-3


@TWINS
def test_products_and_sweeps_agree_with_their_twins(parts):
    rng = np.random.default_rng(1)
    rows, columns, diagonal, blocks = matrix(rng)
    b, x, y, extra = rng.standard_normal(3 * N), rng.standard_normal(3 * N), rng.standard_normal(3 * N), rng.uniform(0, 1, N)
    inverse = np.zeros(9 * N)
    for begin, end in pairwise(parts):
        sparse.invert_diagonal(begin, end, diagonal, blocks, extra, inverse)
    assert_twins("invert_diagonal", parts, [diagonal, blocks, extra, np.zeros(9 * N)], [3])
    assert_twins("outside_norms", parts, [rows, columns, blocks, np.zeros(N)], [3]) if len(parts) > 2 else None
    for add in (False, True):
        assert_twins("product", parts, [rows, columns, blocks, x, add, y], [5])
    assert_twins("sweep_forward", parts, [rows, columns, diagonal, blocks, inverse, b, np.zeros(3 * N)], [6])
    assert_twins("residual_after_forward", parts, [rows, columns, diagonal, blocks, extra, x, y], [6])
    assert_twins("sweep_backward", parts, [rows, columns, blocks, inverse, b, y, x], [6])
    assert_twins("multiply_diagonal", parts, [inverse, x, y], [2])


@TWINS
def test_vector_kernels_agree_with_their_twins(parts):
    p, q, x, r = np.random.default_rng(2).standard_normal((4, N))
    assert_twins("dot", parts, [p, q], [])
    assert_twins("step", parts, [0.7, p, q, x, r], [3, 4])
    assert_twins("update_search_direction", parts, [0.7, p, q], [2])


@TWINS
def test_products_of_matrices_and_prolongators_agree_with_their_twins(parts):
    rng = np.random.default_rng(3)
    rows, columns, _, blocks = matrix(rng)
    other_rows, other_columns = graph(rng, N, 6)
    other = rng.standard_normal(9 * len(other_columns))
    pattern = csr_matrix((np.ones(len(columns)), columns, rows)) @ csr_matrix(
        (np.ones(len(other_columns)), other_columns, other_rows), shape=(N, 6)
    )
    pattern.sort_indices()
    out = np.full(9 * pattern.nnz, 7.0)
    factors = [rows, columns, blocks, other_rows, other_columns, other, pattern.indptr, pattern.indices, 6]
    assert_twins("multiply_blocks", parts, [*factors, out], [9])
    count, inverse, tentative = 2, rng.standard_normal(9 * N), rng.standard_normal(18 * N)
    out_rows = 4 * np.arange(N + 1)
    own, products = out_rows[:-1] + rng.integers(0, 3, N), rng.standard_normal(36 * N)
    assert_twins("smooth_prolongator", parts, [out_rows, own, count, inverse, 0.6, products, tentative, np.zeros(36 * N)], [7])
    assert_twins("transpose_blocks", parts, [rng.permutation(N), tentative, np.zeros(9 * N)], [2])


def aggregate_modes(rng, count=2):
    """Return aggregates of several block rows, of one block row, and with dependent modes."""
    members, starts = rng.permutation(N).astype(np.int32), np.array([0, 4, 5, 9, N], dtype=np.int32)
    modes = rng.standard_normal((N, 3, 3 * count))
    modes[members[5:9], :, 4] = 2 * modes[members[5:9], :, 1]
    return starts, members, np.ascontiguousarray(modes.reshape(N, 3, count, 3).transpose(0, 2, 1, 3)).ravel()


@pytest.mark.parametrize("parts", [[0, 4], [0, 1, 4]])
def test_modes_are_made_orthonormal_like_their_twins(parts):
    starts, members, modes = aggregate_modes(np.random.default_rng(4))
    assert_twins("orthonormalise", parts, [starts, members, 2, modes, np.zeros(4 * 36)], [3, 4], limit=1e-10)


def test_orthonormal_modes_times_coarse_ones_are_the_modes():
    starts, members, modes = aggregate_modes(np.random.default_rng(5))
    Q, R = modes.copy(), np.zeros(4 * 36)
    sparse.orthonormalise(0, 4, starts, members, 2, Q, R)
    for a, size in enumerate(np.diff(starts)):
        ids = members[starts[a] : starts[a + 1]]
        q, b = (m.reshape(N, 2, 3, 3)[ids].transpose(0, 2, 1, 3).reshape(3 * size, 6) for m in (Q, modes))
        r = R.reshape(4, 2, 2, 3, 3)[a].transpose(0, 2, 1, 3).reshape(6, 6)
        assert np.abs(q @ r - b).max() < 1e-12
        gram = q.T @ q
        assert np.abs(gram - np.diag(np.diag(gram))).max() < 1e-12
        assert sorted(np.diag(gram).round(12)) == [0.0] * (6 - min(3 * size, 6) + (a == 2)) + [1.0] * (min(3 * size, 6) - (a == 2))


def unknowns(rng):
    """Return block rows with some constrained components, and their CSR matrix."""
    rows, columns, diagonal, blocks = matrix(rng)
    is_free = rng.random((N, 3)) < 0.7
    is_free[:, 0] |= ~is_free.any(axis=1)
    block, component = np.nonzero(is_free)
    K = csr_matrix(readable._dense(rows, columns, blocks, N)[np.ix_(is_free.ravel(), is_free.ravel())])
    first = np.flatnonzero(np.diff(block, prepend=-1))
    return rows, columns, diagonal, first, block, component, K


@TWINS
def test_csr_values_become_blocks_like_in_the_twin(parts):
    rows, columns, diagonal, first, block, component, K = unknowns(np.random.default_rng(6))
    blank = np.full(9 * len(columns), 7.0)
    own = [rows, columns, diagonal, first, block, component, K.indptr, K.indices, K.data, 0.1, blank, blank.astype(np.float32)]
    assert_twins("fill_blocks", parts, own, [10, 11], limit=1e-6)


def test_dense_inverses_agree_with_the_twin_and_indefinite_matrices_are_noticed():
    a = readable._dense(*(matrix(np.random.default_rng(7))[k] for k in (0, 1, 3)), N)
    assert_twins_of_inverse(a)
    values, vectors = np.linalg.eigh(a)
    values[0] = -1.0
    assert not sparse.invert_dense((vectors * values) @ vectors.T)


def assert_twins_of_inverse(a):
    one, other = a.copy(), a.copy()
    assert sparse.invert_dense(one) and readable.invert_dense(other)
    assert np.abs(one - other).max() < 1e-12 * np.abs(other).max()


def test_inverses_of_indefinite_diagonal_blocks_are_positive_definite():
    rng = np.random.default_rng(8)
    blocks = rng.standard_normal((N, 3, 3))
    blocks = (blocks + blocks.transpose(0, 2, 1)).ravel()
    assert np.linalg.eigvalsh(blocks.reshape(N, 3, 3)).min() < -0.1
    assert_twins("invert_diagonal", [0, N], [np.arange(N), blocks, np.zeros(N), np.zeros(9 * N)], [3], limit=1e-9)
    out = np.zeros(9 * N)
    negative = [kernels.invert_diagonal(0, N, np.arange(N), blocks, np.zeros(N), out) for kernels in (sparse, readable)]
    assert negative == 2 * [(np.linalg.eigvalsh(blocks.reshape(N, 3, 3)) < 0).sum()]
    assert np.linalg.eigvalsh(out.reshape(N, 3, 3)).min() > 0


def test_a_backward_sweep_is_the_adjoint_of_a_forward_one_in_parts():
    """Both sweeps together are a symmetric positive definite operator, and the error decreases in the norm of A."""
    rng = np.random.default_rng(9)
    rows, columns, diagonal, blocks = matrix(rng)
    A, parts = readable._dense(rows, columns, blocks, N), [0, 4, 9, N]
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


def test_every_kernel_that_python_calls_has_a_twin_with_its_signature():
    called = {name: value.py_func for name, value in vars(sparse).items() if hasattr(value, "py_func") and name[0] != "_"}
    annotated = {name: function for name, function in called.items() if function.__annotations__}
    assert len(annotated) == 16
    for name, function in annotated.items():
        assert getattr(readable, name).__annotations__ == function.__annotations__, name
