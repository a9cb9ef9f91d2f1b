"""Edges, orders, stars and indices agree with readable twins and with scikit-fem, on irregular meshes."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from skfem_stvk.edges.topology import LOCAL_EDGES
from skfem_stvk.kernels import simplex_geometry as geometry
from skfem_stvk.kernels import simplex_topology as topology
from skfem_stvk.kernels.simplex_topology import OWN

HUB = 10_000


def random_simplices(seed, k, n, nt):
    """Return simplices with distinct vertices out of `n`, in any order, (k + 1, nt).

    Most vertices may belong to no simplex, and simplices may share edges.
    """
    rng = np.random.default_rng(seed)
    return np.stack([rng.choice(n, k + 1, replace=False) for _ in range(nt)], axis=1).astype(np.int32)


def fan():
    """Return tetrahedra around an axis; its first vertex has HUB neighbours on a circle.

    There are isolated vertices before and after them.
    """
    ring = np.arange(HUB, dtype=np.int32) + 7
    hub, top = np.full(HUB, 3, np.int32), np.full(HUB, HUB + 9, np.int32)
    return np.stack([ring, hub, np.roll(ring, -1), top])


def lexicographic_order_twin(rows, n):
    """Return the order of the columns of `rows` (m, items), first row first, (items,); the order of equal columns is unchanged."""
    return np.lexsort(rows[::-1]).astype(np.int32)


def edges_of_simplices_twin(t, local, n):
    """Return edges (2, ne), `a < b` in lexicographic order, and the edges of the simplices, (m, nt)."""
    ends = np.sort(t[local.T], axis=0).reshape(2, -1)  # all edges of the first local pair, then of the second, ...
    edges, number = np.unique(ends, axis=1, return_inverse=True)
    return edges.astype(np.int32), number.reshape(len(local), -1).astype(np.int32)


def numbers_by_first_use_twin(blocks, count):
    """Return new numbers of the ids in `blocks` (n, m) by their first use, (count,), and numbers of ids used so far, (n + 1,).

    Entry i of the second array is the number of ids that the blocks 0 ... i - 1 use.
    """
    ids, first = np.unique(blocks.ravel(), return_index=True)
    number = np.full(count, -1)
    number[ids[np.argsort(first)]] = np.arange(len(ids))
    marks = np.searchsorted(np.sort(first), blocks.shape[1] * np.arange(len(blocks) + 1))
    return number.astype(np.int32), marks.astype(np.int64)


def stars_twin(edges, n):
    """Return `begin`, `others` and `entries`: rows of a matrix with `e` at `(a, b)`, `-1 - e` at `(b, a)` and OWN at `(a, a)`."""
    (a, b), e, own = edges, np.arange(edges.shape[1]), np.arange(n)
    row, others = np.concatenate([a, b, own]), np.concatenate([b, a, own])
    entries = np.concatenate([e, -1 - e, np.full(n, OWN)])
    order = np.lexsort([others, row])
    begin = np.searchsorted(row[order], np.arange(n + 1))
    return begin.astype(np.int64), others[order].astype(np.int32), entries[order].astype(np.int32)


def expand_twin(begin, columns, d):
    """Return `indptr` and `indices` of scipy's CSR format; each row of blocks becomes `d` rows with `d` columns per block."""
    blocks = np.split(d * columns[:, None] + np.arange(d), begin[1:-1])
    rows = [block.ravel() for block in blocks for _ in range(d)]
    indptr = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
    return indptr.astype(np.int32), np.concatenate(rows).astype(np.int32)


def block_indices_twin(begin, columns, d, a, b):
    """Return the index in the CSR values of the first value of each block `(a, b)`, (n,), or -1 for a missing block."""
    row = np.repeat(np.arange(len(begin) - 1), np.diff(begin))
    first = d * d * begin[row] + d * (np.arange(len(columns)) - begin[row])
    known = dict(zip(zip(row.tolist(), columns.tolist(), strict=True), first.tolist(), strict=True))
    return np.array([known.get(pair, -1) for pair in zip(a.tolist(), b.tolist(), strict=True)], dtype=np.int64)


def assert_same(one, other):
    for a, b in zip(one, other, strict=True):
        assert a.dtype == b.dtype and a.shape == b.shape and np.array_equal(a, b)


def compare(t, n, d):
    """Compare all kernels on the edges of these simplices with their twins."""
    local = np.array(LOCAL_EDGES[len(t) - 1])
    edges, t2e = topology.edges_of_simplices(t, local, n)
    assert_same((edges, t2e), edges_of_simplices_twin(t, local, n))
    begin, others, entries = topology.stars(edges, n)
    assert_same((begin, others, entries), stars_twin(edges, n))
    assert_same(topology.expand(begin, others, d), expand_twin(begin, others, d))
    assert_same(topology.numbers_by_first_use(t2e.T, edges.shape[1]), numbers_by_first_use_twin(t2e.T, edges.shape[1]))
    rng = np.random.default_rng(0)
    a, b = np.concatenate([edges, edges[::-1], rng.integers(0, n, (2, 50))], axis=1)
    indices = topology.block_indices(begin, others, d, a, b)
    assert_same([indices], [block_indices_twin(begin, others, d, a, b)])
    assert (indices[: 2 * edges.shape[1]] >= 0).all()
    return edges, begin, others, entries


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), k=st.integers(1, 3), n=st.integers(4, 40), nt=st.integers(1, 30), d=st.integers(1, 3))
def test_kernels_on_random_simplices_are_their_twins(seed, k, n, nt, d):
    compare(random_simplices(seed, k, n, nt), n, d)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), m=st.integers(1, 4), items=st.integers(0, 60), n=st.integers(1, 9))
def test_the_lexicographic_order_is_stable(seed, m, items, n):
    """The numbers are few and the columns many, so that equal columns occur."""
    rows = np.random.default_rng(seed).integers(0, n, (m, items)).astype(np.int32)
    assert_same([topology.lexicographic_order(rows, n)], [lexicographic_order_twin(rows, n)])


def test_a_hub_of_ten_thousand_neighbours_is_a_vertex_like_others():
    n = HUB + 20
    edges, begin, others, entries = compare(fan(), n, 3)
    valence = np.diff(begin) - 1
    assert valence[3] == valence[HUB + 9] == HUB + 1
    assert (valence[[0, 1, 2, 4, 5, 6, HUB + 10, n - 1]] == 0).all() and edges.shape[1] == 3 * HUB + 1
    star = slice(begin[3], begin[4])
    assert (np.diff(others[star]) > 0).all() and others[star][entries[star] == OWN] == [3]


@pytest.mark.parametrize("k", [1, 2, 3])
def test_one_simplex_has_all_pairs_of_its_vertices_as_edges(k):
    t = np.array([[5], [2], [4], [0]], dtype=np.int32)[: k + 1]
    edges, begin, _, entries = compare(t, 6, 3)
    assert edges.shape[1] == k * (k + 1) // 2
    assert (entries == OWN).sum() == 6 and begin[-1] == 6 + 2 * edges.shape[1]


def test_vertices_without_edges_have_a_star_of_their_own():
    begin, others, entries = topology.stars(np.empty((2, 0), dtype=np.int32), 4)
    assert begin.tolist() == [0, 1, 2, 3, 4] and others.tolist() == [0, 1, 2, 3] and (entries == OWN).all()


@pytest.mark.parametrize("k", [1, 2, 3])
def test_frames_of_base_vectors_are_orthonormal(k):
    """The diagonal of `Ri` is positive for both orientations."""
    P = np.random.default_rng(0).standard_normal((50, k, 3))
    kernel = geometry.frames_of_base_vectors(P)
    Ri = np.zeros((50, 3, 3))
    Ri[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]] = kernel[:6].T
    Q = np.einsum("nij,nix->njx", Ri[:, :k], P)[:, :k]
    assert np.abs(Q @ np.swapaxes(Q, 1, 2) - np.eye(k)).max() < 1e-12 and (np.diagonal(Ri[:, :k, :k], axis1=1, axis2=2) > 0).all()
    if k == 3:
        assert 0 < (np.linalg.det(P) < 0).sum() < 50 and np.allclose(kernel[6], np.abs(np.linalg.det(P)), rtol=1e-12)
