"""Edges, orders, neighbours and pieces of simplices, each in time and memory proportional to the mesh: sorting is counting."""

from __future__ import annotations

import numpy as np

from .compiled import Ids, inlined, kernel

#: An entry of a star: the vertex itself.
OWN = np.iinfo(np.int32).min


@kernel
def _counting_sort(keys, order, n):
    """`order` sorted by `keys[order]` in 0 ... n - 1; equal keys stay as they are."""
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
    """(items,) order of the columns of `rows` (m, items), with entries in 0 ... n - 1, first row first."""
    order = np.empty(rows.shape[1], np.int32)
    for item in range(len(order)):
        order[item] = item
    for row in range(len(rows) - 1, -1, -1):
        order = _counting_sort(rows[row], order, n)
    return order


@kernel
def edges_of_simplices(t: Ids, local: Ids, n: int) -> tuple[Ids, Ids]:
    """Edges (2, ne), `a < b` in lexicographic order, and (m, nt) edges of the simplices `t` (k + 1, nt).

    `local` (m, 2) are the local edges, `n` is larger than every vertex.
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
    """New numbers (count,) of the ids in `blocks` (n, m) by first use, and how many (n + 1,) blocks 0 ... i - 1 use."""
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
    """The star of each vertex in compressed rows: `begin` (n + 1,), `others` (neighbours and itself, ascending), `entries` edges.

    `edges` (2, ne) are `a < b` in lexicographic order: then a vertex meets its lower neighbours in ascending order, after them
    itself and its upper ones. An entry is the place of the edge to an upper neighbour, -1 - place to a lower one, OWN for the
    vertex itself.
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
        while own <= a:  # all lower neighbours of `own` have come
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
    """The part that uses each of `n` nodes, the number of parts for those of several, and the last of the rows of `t` with each.

    `t` (blocks, m) are nodes of blocks of elements, in `parts` as in `threads.parts_of`.
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
    """Slots for the pairs of nodes of blocks of elements, that others have as soon as both rows of a pair are written.

    `t2e` (blocks, m) are the pairs of blocks, in `parts` as in `threads.parts_of`; `pairs` (ne, 2) their nodes, with rows `row_of`
    (n,). Before block `i` `done[i]` rows are complete; others are written in the end. The pairs of the row of a node, -1 for the
    node itself, are `pair_of[begin[row]]` ...

    Returned are `slots` (blocks, m), the slots in the order in which pairs begin to use them, `marks` (blocks + 1,) how many the
    blocks before begin to use, the slot (ne,) of each pair, `targets` (extra,), and how many slots there are. The first ones are
    those of pairs that are written in the end, as many as come before the extra ones; what other parts add to such a pair stands in
    an extra slot, and belongs to its target.
    """
    blocks, m = t2e.shape
    ne, count = len(pairs), len(parts) - 1
    in_work = done[blocks]
    row = np.empty(ne, np.int64)  # the later one of a pair
    for e in range(ne):
        row[e] = max(row_of[pairs[e, 0]], row_of[pairs[e, 1]])
    slot, seen = np.full(ne, -1, np.int32), np.full(ne, -1, np.int32)
    lasting, extra = 0, 0
    if in_work < len(begin) - 1:
        for part in range(count):
            for block in range(parts[part], parts[part + 1]):
                for e in t2e[block]:
                    if row[e] >= in_work and seen[e] != part:
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
                    if row[e] < in_work:
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
    """`indptr` and `indices` of scipy's CSR format for `d x d` blocks in compressed rows."""
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
def first_places(begin: Ids, columns: Ids, d: int, a: Ids, b: Ids) -> Ids:
    """(n,) place in the CSR values of the first value of each block `(a, b)`, -1 for a block that is not there."""
    places = np.empty(len(a), np.int64)
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
        places[i] = d * d * first + d * (low - first) if found else -1
    return places


# Pieces take 70 to 370 ns per simplex here; scipy's connected_components, on the graph of simplices and facets that it needs, takes
# 1700 to 2800 ns: as long as forty assemblies of K, before each solve.
@inlined
def _root(above, e):
    """The first simplex of the piece that `e` is known to belong to."""
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
    """The number (nt,) of the piece of each triangle or tetrahedron `t` (k + 1, nt), in the order of first simplices.

    Simplices that share a facet are of one piece. `n` is larger than every vertex.

    Facets are met by their lowest vertex `a`: it is the lowest of a simplex or the one after it. Those at `a` with the same second
    vertex `b` make a list, in which a triangle's facet stands alone and a tetrahedron's is told from others by its third vertex
    `c`.
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
        for place in range(begin[a], begin[a + 1]):
            e = star[place]
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
