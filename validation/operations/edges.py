"""The edge form (Kikuuwe, Tabuchi, Yamamoto 2009): data on edges and on pairs of edges that share a tetrahedron.

    zeta_i = |p_i|^2 - |P_i|^2        t_i = sum_j L_ij zeta_j        F = sum_i t_i p_i on a, -t_i p_i on b

    K_ab = -t_ab I + sum over edges j at b of  +-h_aj (x) p_j,        h_aj = dt_j/du_a = sum over edges i at a of  +-2 L_ij p_i

The tangent stiffness sums the vectors `h` before it forms matrices: `K_ab` and `K_ac` of a face `a < b < c` take the same product
`h (x) p` with `h = h_a,bc`, and `K_bc` takes `h_b,ac`. So a face needs two of them, an edge one, and a TSEP never forms a matrix.
`tangent_by_pairs` does, and is what one writes first: `2 L_ij p_i (x) p_j` goes to three blocks if the edges meet, to four if not.
"""

from __future__ import annotations

from typing import Any

from .compiled import jitable
from .edge_lists import Rest, prepare
from .vectors import (
    Vector,
    add,
    add_matrix,
    close_rows,
    dot,
    minus,
    outer,
    plus,
    put,
    subtract,
    subtract_matrix,
    times,
    transposed,
    vector,
)

__all__ = [
    "Rest",
    "force",
    "force_displacement",
    "prepare",
    "tangent",
    "tangent_by_pairs",
    "tangent_by_pairs_displacement",
    "tangent_displacement",
]


def force(rest: Rest, x: Any, out: Any) -> None:
    """Add F [N] at positions `x` (nv, 3) to `out`: 19 operations an edge and 4 a TSEP."""
    elongations(rest, x)
    tensions(rest)
    spread(rest, out)


def force_displacement(rest: Rest, u: Any, out: Any) -> None:
    """Add F [N] at displacements `u` (nv, 3) to `out`, without cancellation: 5 operations more an edge."""
    elongations_displacement(rest, u)
    tensions(rest)
    spread(rest, out)


def tangent(rest: Rest, x: Any, blocks: Any, diagonal: Any) -> None:
    """Add K [N/m] at positions `x` to its blocks `K_ab` (ne, 3, 3), `a < b`, and `K_aa` (nv, 3, 3)."""
    elongations(rest, x)
    tensions(rest)
    add_blocks(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


def tangent_displacement(rest: Rest, u: Any, blocks: Any, diagonal: Any) -> None:
    """`tangent` at displacements `u`."""
    elongations_displacement(rest, u)
    tensions(rest)
    add_blocks(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


def tangent_by_pairs(rest: Rest, x: Any, blocks: Any, diagonal: Any) -> None:
    """`tangent` with a matrix for each TSEP."""
    elongations(rest, x)
    tensions(rest)
    add_blocks_by_pairs(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


def tangent_by_pairs_displacement(rest: Rest, u: Any, blocks: Any, diagonal: Any) -> None:
    """`tangent_by_pairs` at displacements `u`."""
    elongations_displacement(rest, u)
    tensions(rest)
    add_blocks_by_pairs(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


@jitable
def elongations(rest: Rest, x: Any) -> None:
    """Current edges `p` and `zeta = |p|^2 - |P|^2`: the textbook's form, 9 operations an edge."""
    for i in range(len(rest.ends)):
        p = minus(vector(x, rest.ends[i, 0]), vector(x, rest.ends[i, 1]))
        put(rest.p, i, p)
        rest.zeta[i] = dot(p, p) - rest.square[i]


@jitable
def elongations_displacement(rest: Rest, u: Any) -> None:
    """Current edges `p = P + U` and `zeta = (P + p) . U`: 14 operations an edge."""
    for i in range(len(rest.ends)):
        U, P = minus(vector(u, rest.ends[i, 0]), vector(u, rest.ends[i, 1])), vector(rest.P, i)
        p = plus(P, U)
        put(rest.p, i, p)
        rest.zeta[i] = dot(plus(P, p), U)


@jitable
def tensions(rest: Rest) -> None:
    """`t = L zeta`, each TSEP once for both of its edges: 1 operation an edge, 4 a TSEP."""
    for i in range(len(rest.L)):
        rest.tension[i] = rest.L[i] * rest.zeta[i]
    for i in range(len(rest.L)):
        zeta, tension = rest.zeta[i], rest.tension[i]
        for k in range(rest.start[i], rest.start[i + 1]):
            L, j = rest.pair_L[k], rest.other[k]
            tension += L * rest.zeta[j]
            rest.tension[j] += L * zeta
        rest.tension[i] = tension


@jitable
def spread(rest: Rest, out: Any) -> None:
    """`t p` on one end of each edge, `-t p` on the other: 9 operations an edge."""
    for i in range(len(rest.ends)):
        f = times(rest.tension[i], vector(rest.p, i))
        add(out, rest.ends[i, 0], f)
        subtract(out, rest.ends[i, 1], f)


@jitable
def change_of_tension(rest: Rest, slot: Any) -> Vector:
    """`h = sum +-2 L_ij p_i`: 6 operations a term, 3 less for the first."""
    first, end = rest.h_start[slot], rest.h_start[slot + 1]
    h = times(rest.h_L[first], vector(rest.p, rest.h_edge[first]))
    for k in range(first + 1, end):
        h = plus(h, times(rest.h_L[k], vector(rest.p, rest.h_edge[k])))
    return h


@jitable
def add_blocks(rest: Rest, blocks: Any) -> None:
    """`K_ab` from the vectors `h`: 21 operations an edge, 45 a face, besides those of `h`."""
    ne = len(rest.ends)
    for i in range(ne):
        add_matrix(blocks, i, outer(change_of_tension(rest, i), vector(rest.p, i)))
        for r in range(3):
            blocks[i, r, r] -= rest.tension[i]
    for f in range(len(rest.face_edges)):
        ab, ac, bc = vector(rest.face_edges, f)
        shared = outer(change_of_tension(rest, ne + 2 * f), vector(rest.p, bc))
        add_matrix(blocks, ab, shared)
        subtract_matrix(blocks, ac, shared)
        add_matrix(blocks, bc, outer(change_of_tension(rest, ne + 2 * f + 1), vector(rest.p, ac)))


@jitable
def add_blocks_by_pairs(rest: Rest, blocks: Any) -> None:
    """`K_ab` from a matrix for each TSEP: 39 operations if its edges meet, 48 if not."""
    for i in range(len(rest.ends)):
        p = vector(rest.p, i)
        add_own(blocks[i], times(rest.minus_double_own[i], p), p, rest.tension[i])
    for k in range(len(rest.double_L)):
        i, j = rest.pair_edges[k, 0], rest.pair_edges[k, 1]
        M = outer(times(rest.double_L[k], vector(rest.p, i)), vector(rest.p, j))
        subtract_matrix(blocks, rest.targets[k, 0], transposed(M) if rest.flips[k, 0] else M)
        subtract_matrix(blocks, rest.targets[k, 1], transposed(M) if rest.flips[k, 1] else M)
        add_matrix(blocks, rest.targets[k, 2], transposed(M) if rest.flips[k, 2] else M)
        if k >= rest.meeting[0]:
            add_matrix(blocks, rest.targets[k, 3], transposed(M) if rest.flips[k, 3] else M)


@jitable
def add_own(block: Any, h: Vector, p: Vector, tension: Any) -> None:
    """`K_ab += h (x) p - t I` for the edge `ab` itself, where `h = -2 L p`: its products are symmetric, 18 operations."""
    xy, xz, yz = h[0] * p[1], h[0] * p[2], h[1] * p[2]
    add(block, 0, (h[0] * p[0] - tension, xy, xz))
    add(block, 1, (xy, h[1] * p[1] - tension, yz))
    add(block, 2, (xz, yz, h[2] * p[2] - tension))
