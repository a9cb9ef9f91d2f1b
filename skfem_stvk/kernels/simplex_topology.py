"""Edges, orders, neighbours and pieces of simplices.

Each takes time and memory proportional to the mesh, because all sorts are counting sorts.
"""

from __future__ import annotations

import numpy as np

from .compiled import Ids, inlined, kernel

#: Entry of a star for the vertex itself.
OWN = np.iinfo(np.int32).min


@kernel
def _counting_sort(keys, order, n):
    """Return `order` sorted by `keys[order]`, which lie in 0 ... n - 1. The sort is stable."""
    begin = np.zeros(n + 1, np.int64)
    for key in keys:
        begin[key + 1] += 1
    for i in range(n):
        begin[i + 1] += begin[i]
    result = np.empty_like(order)
    for item in order:
        key = keys[item]
        result[begin[key]] = item
        begin[key] += 1
    return result


@kernel
def lexicographic_order(rows: Ids, n: int) -> Ids:
    """Return the lexicographic order (items,) of the columns of `rows` (m, items), with entries in 0 ... n - 1.

    The first row is the most significant.
    """
    order = np.empty(rows.shape[1], np.int32)
    for item in range(len(order)):
        order[item] = item
    for row in range(len(rows) - 1, -1, -1):
        order = _counting_sort(rows[row], order, n)
    return order


@kernel
def edges_of_simplices(t: Ids, local: Ids, n: int) -> tuple[Ids, Ids]:
    """Return the edges (2, ne), `a < b` in lexicographic order, and the edges (m, nt) of the simplices `t` (k + 1, nt).

    `local` (m, 2) are the local edges; `n` is larger than every vertex.
    """
    m, nt = len(local), t.shape[1]
    ends = np.empty((2, m * nt), np.int32)
    for i in range(m):
        for e in range(nt):
            a, b = t[local[i, 0], e], t[local[i, 1], e]
            ends[0, i * nt + e], ends[1, i * nt + e] = (a, b) if a < b else (b, a)
    order = lexicographic_order(ends, n)
    t2e = np.empty((m, nt), np.int32)
    edges = np.empty((2, m * nt), np.int32)
    last, a, b = -1, -1, -1
    for item in order:
        if ends[0, item] != a or ends[1, item] != b:
            last += 1
            a, b = ends[0, item], ends[1, item]
            edges[0, last], edges[1, last] = a, b
        t2e[item // nt, item % nt] = last
    return edges[:, : last + 1].copy(), t2e


@kernel
def numbers_by_first_use(blocks: Ids, count: int) -> tuple[Ids, Ids]:
    """Return new numbers (count,) of the ids in `blocks` (n, m) by first use, and counts (n + 1,) of the ids in use.

    Count `i` is the number of ids that blocks 0 ... i - 1 use.
    """
    number, marks = np.empty(count, np.int32), np.zeros(len(blocks) + 1, np.int64)
    number[:] = -1
    used = 0
    for block in range(len(blocks)):
        for item in blocks[block]:
            if number[item] < 0:
                number[item] = used
                used += 1
        marks[block + 1] = used
    return number, marks


@kernel
def stars(edges: Ids, n: int) -> tuple[Ids, Ids, Ids]:
    """Return the star of each vertex, that is, its neighbours and itself, in compressed rows: `begin`, `others`, `entries`.

    The rows begin at `begin` (n + 1,). `others` are the vertices of the star in ascending order. The entry of an upper neighbour is
    the index of the edge to it. The entry of a lower neighbour is -1 - index, and that of the vertex itself is OWN.

    `edges` (2, ne) are `a < b` in lexicographic order. Therefore a loop over the edges visits the lower neighbours of a vertex
    first, in ascending order, then its upper neighbours.
    """
    begin = np.zeros(n + 1, np.int64)
    for v in range(n):
        begin[v + 1] = 1
    for e in range(edges.shape[1]):
        begin[edges[0, e] + 1] += 1
        begin[edges[1, e] + 1] += 1
    for v in range(n):
        begin[v + 1] += begin[v]
    others, entries = np.empty(begin[n], np.int32), np.empty(begin[n], np.int32)
    at = begin[:-1].copy()
    own = 0
    for e in range(edges.shape[1] + 1):
        a = edges[0, e] if e < edges.shape[1] else n - 1
        while own <= a:  # all lower neighbours of `own` are entered
            others[at[own]], entries[at[own]] = own, OWN
            at[own] += 1
            own += 1
        if e < edges.shape[1]:
            b = edges[1, e]
            others[at[a]], entries[at[a]] = b, e
            others[at[b]], entries[at[b]] = a, -1 - e
            at[a] += 1
            at[b] += 1
    return begin, others, entries


@kernel
def last_uses(t: Ids, parts: Ids, n: int) -> tuple[Ids, Ids]:
    """Return the part that uses each of `n` nodes, and the last row of `t` with each node.

    For nodes of several parts, the first result is the number of parts. `t` (blocks, m) are the nodes of blocks of elements;
    `parts` are those of `threads.parts_of`.
    """
    count = len(parts) - 1
    part_of, last = np.full(n, -1, np.int32), np.zeros(n, np.int64)
    for part in range(count):
        for block in range(parts[part], parts[part + 1]):
            for node in t[block]:
                last[node] = block
                if part_of[node] < 0:
                    part_of[node] = part
                elif part_of[node] != part:
                    part_of[node] = count
    return part_of, last


@kernel
def assign_slots(
    t2e: Ids, pairs: Ids, parts: Ids, row_of: Ids, done: Ids, begin: Ids, pair_of: Ids
) -> tuple[Ids, Ids, Ids, Ids, Ids, int]:
    """Assign slots to the node pairs of blocks of elements; a slot is reused as soon as both rows of its pair are written.

    `t2e` (blocks, m) are the pairs of blocks, in `parts` as in `threads.parts_of`. `pairs` (ne, 2) are the nodes of pairs, and
    `row_of` (n,) the rows of nodes. Before block `i`, `done[i]` rows are complete. Rows from `done[blocks]` on are written at the
    end. The pairs of a row are `pair_of[begin[row]]` ..., with -1 for the node itself.

    Returns `slots` (blocks, m); `fresh`, the slots in the order in which pairs begin to use them; and `marks` (blocks + 1,). The
    blocks before `i` use the first `marks[i]` entries of `fresh`. Then follow the slot (ne,) of each pair, `targets` (extra,), and
    the number of slots.

    The first slots are those of pairs whose rows are written at the end. The extra slots come next. The contributions of other
    parts to such a pair are stored in an extra slot, and are added to its target.
    """
    blocks, m = t2e.shape
    ne, count = len(pairs), len(parts) - 1
    in_parallel = done[blocks]
    row = np.empty(ne, np.int64)  # the later of the two rows of a pair
    for e in range(ne):
        row[e] = max(row_of[pairs[e, 0]], row_of[pairs[e, 1]])
    slot, seen = np.full(ne, -1, np.int32), np.full(ne, -1, np.int32)
    lasting, extra = 0, 0
    if in_parallel < len(begin) - 1:
        for part in range(count):
            for block in range(parts[part], parts[part + 1]):
                for e in t2e[block]:
                    if row[e] >= in_parallel and seen[e] != part:
                        if seen[e] < 0:
                            slot[e] = lasting
                            lasting += 1
                        else:
                            extra += 1
                        seen[e] = part
        seen[:] = -1
    slots, marks = np.empty((blocks, m), np.uint32), np.zeros(blocks + 1, np.int64)
    fresh, targets = np.empty(ne + extra, np.uint32), np.empty(extra, np.int64)
    now, free = np.empty(ne, np.int32), np.empty(ne, np.int32)
    size, used, extra = lasting + extra, 0, 0
    for part in range(count):
        left = 0
        for block in range(parts[part], parts[part + 1]):
            for i in range(m):
                e = t2e[block, i]
                if seen[e] != part:
                    if row[e] < in_parallel:
                        if left > 0:
                            left -= 1
                            slot[e] = free[left]
                        else:
                            slot[e] = size
                            size += 1
                        now[e] = slot[e]
                    elif seen[e] < 0:
                        now[e] = slot[e]
                    else:
                        now[e], targets[extra] = lasting + extra, slot[e]
                        extra += 1
                    seen[e] = part
                    fresh[used] = now[e]
                    used += 1
                slots[block, i] = now[e]
            marks[block + 1] = used
            for complete in range(done[block], done[block + 1]):
                for i in range(begin[complete], begin[complete + 1]):
                    e = pair_of[i]
                    if e >= 0 and row[e] == complete:
                        free[left] = slot[e]
                        left += 1
    return slots, fresh, marks, slot, targets, size


@kernel
def expand(begin: Ids, columns: Ids, d: int) -> tuple[Ids, Ids]:
    """Return `indptr` and `indices` of SciPy's CSR format for `d x d` blocks in compressed rows."""
    n = len(begin) - 1
    indptr, indices = np.empty(d * n + 1, np.int32), np.empty(d * d * len(columns), np.int32)
    indptr[0] = 0
    at = 0
    for v in range(n):
        for r in range(d):
            for i in range(begin[v], begin[v + 1]):
                for c in range(d):
                    indices[at] = d * columns[i] + c
                    at += 1
            indptr[d * v + r + 1] = at
    return indptr, indices


@kernel
def block_indices(begin: Ids, columns: Ids, d: int, a: Ids, b: Ids) -> Ids:
    """Return the index (n,) in the CSR values of the first value of each block `(a, b)`, or -1 if the block does not exist."""
    indices = np.empty(len(a), np.int64)
    for i in range(len(a)):
        low, high = begin[a[i]], begin[a[i] + 1]
        count, first = high - low, low
        while low < high:
            middle = (low + high) // 2
            if columns[middle] < b[i]:
                low = middle + 1
            else:
                high = middle
        found = low < first + count and columns[low] == b[i]
        indices[i] = d * d * first + d * (low - first) if found else -1
    return indices


# This takes 70 to 370 ns per simplex. SciPy's connected_components needs the graph of simplices and facets and takes 1700 to
# 2800 ns with it, as long as forty assemblies of K, before each solve.
@inlined
def _root(above, e):
    """Return the current root of simplex `e` in the union-find forest `above`, and shorten the path to it."""
    while above[e] != e:
        above[e] = above[above[e]]
        e = above[e]
    return e


@inlined
def _join(above, e, f):
    e, f = _root(above, e), _root(above, f)
    above[max(e, f)] = min(e, f)


@kernel
def pieces_of_simplices(t: Ids, n: int) -> Ids:
    """Return the number (nt,) of the piece of each triangle or tetrahedron `t` (k + 1, nt), in the order of first simplices.

    Simplices that share a facet belong to the same piece. `n` is larger than every vertex.

    Facets are processed by their lowest vertex `a`, which is the lowest or second lowest vertex of a simplex. Facets at `a` with
    the same second vertex `b` form a list. For triangles this list has one facet. For tetrahedra the third vertex `c` distinguishes
    them.
    """
    m, nt = t.shape
    ordered = np.empty((nt, m), np.int32)
    begin = np.zeros(n + 1, np.int64)
    for e in range(nt):
        for i in range(m):
            v, j = t[i, e], i
            while j > 0 and ordered[e, j - 1] > v:
                ordered[e, j] = ordered[e, j - 1]
                j -= 1
            ordered[e, j] = v
        begin[ordered[e, 0] + 1] += 1
        begin[ordered[e, 1] + 1] += 1
    largest = 0
    for v in range(n):
        largest = max(largest, begin[v + 1])
        begin[v + 1] += begin[v]
    at, star = begin[:-1].copy(), np.empty(2 * nt, np.int32)
    for e in range(nt):
        for i in range(2):
            a = ordered[e, i]
            star[at[a]] = e
            at[a] += 1
    above = np.arange(nt).astype(np.int32)
    head, seen = np.empty(n, np.int32), np.full(n, -1, np.int32)
    after, third, owner = np.empty(3 * largest, np.int32), np.empty(3 * largest, np.int32), np.empty(3 * largest, np.int32)
    for a in range(n):
        count = 0
        for k in range(begin[a], begin[a + 1]):
            e = star[k]
            first = 1 if ordered[e, 0] == a else 2
            for i in range(first, m if m == 3 else m - 1):
                for j in range(i + 1, m if m == 4 else i + 2):
                    b, c = ordered[e, i], ordered[e, j] if m == 4 else 0
                    found = head[b] if seen[b] == a else -1
                    while found >= 0 and third[found] != c:
                        found = after[found]
                    if found >= 0:
                        _join(above, owner[found], e)
                        continue
                    after[count], third[count], owner[count] = head[b] if seen[b] == a else -1, c, e
                    head[b], seen[b] = count, a
                    count += 1
    piece = np.empty(nt, np.int32)
    pieces = 0
    for e in range(nt):
        if above[e] == e:
            piece[e] = pieces
            pieces += 1
        else:
            piece[e] = piece[_root(above, e)]
    return piece
