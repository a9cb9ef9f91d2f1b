"""Rows of K written after their last element equal the rows from blocks of all pairs.

They are equal to the last bit from run to run.
"""

import numpy as np
import pytest
from bodies import MESHES, bar, box, boxes, curved, state
from kernels.parts import in_parts
from slow import slow

from skfem_stvk import ElementMesh, StVK, System, VolumePenalty
from skfem_stvk.edges import ALL, NONE, TENSILE, streaming
from skfem_stvk.kernels.lanes import TRANSPOSED
from skfem_stvk.kernels.simplex_topology import assign_slots

STVK = StVK(young=2.0, poisson=0.3)


def renumbered(mesh, seed=0):
    """Return the same linear simplices with vertices and elements in random order."""
    rng = np.random.default_rng(seed)
    number = rng.permutation(mesh.nv)
    p = np.empty_like(mesh.p)
    p[:, number] = mesh.p
    return ElementMesh(p, number[mesh.t][:, rng.permutation(mesh.nt)])


#: Bodies of at least two blocks of lanes, so that parts share pairs.
KINDS = {
    "box": lambda: (box(4), {}),
    "shuffled": lambda: (renumbered(box(4)), {}),
    "plane triangles": lambda: (MESHES["triangles"], {}),
    "membrane": lambda: (MESHES["membrane"], {}),
    "cable": lambda: (bar(20, d=3), {}),
    "curved tetrahedra": lambda: (curved(box(2)), {}),
    "curved triangles": lambda: (curved(MESHES["triangles"]), {}),
    "hexahedra": lambda: (boxes(3, n=3), {}),
    "quadrilaterals": lambda: (boxes(2, n=5), {}),
    "hexahedra, one point": lambda: (boxes(3, n=3), {"quadrature": "one-point"}),
}


def in_both_ways(body, u, data, add=False, kept=ALL):
    """Return values of K written row by row, values from the blocks of all pairs, the force of each, and the rows."""
    term, x = body.pair_terms[0], u.reshape(-1, body.mesh.d)
    rows, other = term.rows(body.pattern), data.copy()
    F, G = np.zeros_like(x, dtype=body.dtype), np.zeros_like(x, dtype=body.dtype)
    found = term.fill(x, rows, data, add, F, kept)
    W, blocks = term.blocks(x, G, None, kept)
    total = term.pairs.fill(rows.of_all_pairs, blocks, add, other)
    assert found.energy == pytest.approx(W, rel=1e-6)
    assert found.total == pytest.approx(total, rel=1e-4 if body.dtype == np.float32 else 1e-11)
    return data, other, F, G, rows


@pytest.mark.few
@pytest.mark.parametrize(
    ("kind", "dtype"), [*((kind, np.float64) for kind in KINDS), ("shuffled", np.float32), slow("hexahedra", np.float32)]
)
@pytest.mark.parametrize("parts", [1, 3])
def test_streamed_rows_are_those_of_all_pairs(kind, parts, dtype, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh, options = KINDS[kind]()
    body, limit = System(mesh, STVK, dtype=dtype, **options), 3e-6 if dtype == np.float32 else 1e-14
    u = state(body.mesh, 0.1)
    for before in (np.full(body.pattern.nnz, np.nan, dtype), np.ones(body.pattern.nnz, dtype)):
        K, expected, F, G, rows = in_both_ways(body, u, before.copy(), add=bool(before[0] == 1))
        assert np.abs(K).max() > 1e-2 and np.abs(K - expected).max() <= limit * np.abs(expected).max()
        assert np.abs(F - G).max() <= limit * np.abs(G).max()
    assert len(rows.plan.parts) == parts + 1
    assert (len(rows.plan.sources) > 0) == (parts > 1 and mesh.k > 1)  # parts of a chain share vertices, but no pairs


@pytest.mark.parametrize("kept", [TENSILE, NONE])
@pytest.mark.parametrize("kind", ["box", "curved tetrahedra"])
def test_tensions_have_the_same_factors_as_in_blocks(kind, kept, monkeypatch):
    in_parts(monkeypatch, 2)
    mesh, options = KINDS[kind]()
    body = System(mesh, STVK, **options)
    u = state(body.mesh, 0.2) - 0.2 * body.mesh.p.ravel("F")
    exact = body.tangent(u).data
    K, expected, *_ = in_both_ways(body, u, np.zeros_like(exact), kept=kept)
    assert np.abs(K - exact).max() > 1e-2 * np.abs(exact).max()
    assert np.abs(K - expected).max() <= 1e-14 * np.abs(expected).max()


@pytest.mark.few
@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize(
    ("kind", "dtype"),
    [*((kind, np.float64) for kind in ("box", "plane triangles", "cable", "curved tetrahedra")), ("shuffled", np.float32)],
)
def test_stores_past_the_caches_write_the_same_values_and_nothing_else(kind, parts, dtype, monkeypatch):
    """The claim holds for any offset of the values within a cache line."""
    in_parts(monkeypatch, parts)
    mesh, options = KINDS[kind]()
    body = System(mesh, STVK, dtype=dtype, **options)
    term, x, n = body.pair_terms[0], state(body.mesh, 0.1).reshape(-1, body.mesh.d), body.pattern.nnz
    rows, expected = term.rows(body.pattern), np.empty(n, dtype)
    term.fill(x, rows, expected, False)
    monkeypatch.setattr(streaming, "PAST_CACHES", 0)
    for begin in range(9):
        scratch = np.full(n + 40, 7.0, dtype)
        data = scratch[begin : begin + n]
        data[:] = np.nan
        term.fill(x, rows, data, False)
        assert np.array_equal(data, expected) and (scratch[:begin] == 7).all() and (scratch[begin + n :] == 7).all()


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_results_are_bitwise_reproducible_and_agree_across_thread_counts(parts, monkeypatch):
    mesh = renumbered(box(6))
    u = state(mesh, 0.1)
    alone = System(mesh, STVK).tangent(u)
    in_parts(monkeypatch, parts)
    body = System(mesh, STVK)
    first = body.tangent(u).data.copy()
    for _ in range(3):
        assert np.array_equal(body.tangent(u).data, first)
    assert np.array_equal(System(mesh, STVK).tangent(u).data, first)
    assert np.abs(first - alone.data).max() <= 1e-14 * np.abs(first).max()


@pytest.mark.parametrize("parts", [1, 3])
def test_terms_of_several_regions_add_up(parts, monkeypatch):
    in_parts(monkeypatch, parts)
    monkeypatch.setattr(streaming, "PAST_CACHES", 0)
    mesh = renumbered(box(4))
    left = np.flatnonzero(mesh.p[0, mesh.t].mean(axis=0) < 0.5)
    right = np.setdiff1d(np.arange(mesh.nt), left)
    terms = [StVK(young=1.0, poisson=0.3, region=left), StVK(young=5.0, poisson=0.1, region=right), VolumePenalty(2.0, "quadratic")]
    both, u = System(mesh, terms), state(mesh, 0.1)
    K = both.tangent(u)
    expected = np.zeros_like(K.data)
    for term in both.pair_terms:
        _, blocks = term.blocks(u.reshape(-1, 3))
        term.pairs.fill(term.pairs.rows(both.pattern), blocks, True, expected)
    assert np.abs(K.data - expected).max() <= 1e-14 * np.abs(expected).max()
    whole = System(mesh, terms[2:] + terms[:2])  # the first term writes, the others add
    assert np.abs(whole.tangent(u).data - K.data).max() <= 1e-14 * np.abs(K.data).max()


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("name", ["shuffled", "curved tetrahedra"])
def test_pairs_in_work_have_separate_slots_and_slots_are_few(name, parts, monkeypatch):
    in_parts(monkeypatch, parts)
    body = System(KINDS[name]()[0] if name != "shuffled" else renumbered(box(8)), STVK)
    term, found = body.pair_terms[0], {}
    monkeypatch.setattr(streaming, "assign_slots", lambda *given: found.setdefault("made", (given, assign_slots(*given)))[1])
    _ = term.rows(body.pattern).plan
    (t2e, pairs, of_parts, row_of, done, begin, pair_of), (slots, fresh, marks, slot, targets, size) = found["made"]
    assigned, blocks = {}, len(t2e)  # the part and pair to which each slot is assigned
    for part in range(len(of_parts) - 1):
        for block in range(of_parts[part], of_parts[part + 1]):
            for s in fresh[marks[block] : marks[block + 1]]:
                assert s not in assigned
                assigned[s] = None
            for e, s in zip(t2e[block].tolist(), (slots[block] & ~TRANSPOSED).tolist(), strict=True):
                if assigned[s] is None:
                    assigned[s] = part, e
                assert assigned[s] == (part, e)
            for row in range(done[block], done[block + 1]):
                for e in pair_of[begin[row] : begin[row + 1]]:
                    assert e < 0 or assigned[slot[e]] == (part, e)
                    if e >= 0 and row_of[pairs[e]].max() == row:
                        del assigned[slot[e]]
    lasting = (row_of[pairs] >= done[blocks]).any(axis=1)
    assert len(assigned) == np.count_nonzero(lasting) + len(targets)
    assert {e for _, e in assigned.values()} == set(np.flatnonzero(lasting).tolist())
    assert size < (0.5 if parts == 1 and name == "shuffled" else 1.5) * len(pairs)


@pytest.mark.parametrize("parts", [1, 2])
def test_an_overflow_in_any_row_is_detected(parts, monkeypatch):
    in_parts(monkeypatch, parts)
    mesh = box(4)
    body = System(mesh, STVK)
    term, rows, data = body.pair_terms[0], body.pair_terms[0].rows(body.pattern), np.zeros(body.pattern.nnz)
    for vertex in range(0, mesh.nv, 17):
        u = np.zeros((mesh.nv, 3))
        u[vertex] = 1e160
        with np.errstate(all="ignore"):
            assert not np.isfinite(term.fill(u, rows, data, False).total)
