"""Pieces of a mesh: what its facets hold together, in time proportional to the mesh."""

from __future__ import annotations

import numpy as np

from .compiled import Ids, inlined, kernel


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
    """(nt,) number of the piece of each of the triangles or tetrahedra `t` (k + 1, nt), in the order of the pieces' first simplices.

    Simplices that share a facet are of one piece. `n` is larger than every vertex.

    Facets are met by their lowest vertex `a`: it is the lowest of a simplex or the one after it. Those at `a` with the same second vertex
    `b` make a list, in which a triangle's facet stands alone and a tetrahedron's is told from others by its third vertex `c`.
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
