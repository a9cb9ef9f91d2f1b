"""Edge form (Kikuuwe, Tabuchi, Yamamoto 2009): data on edges and on pairs of edges that share a tetrahedron (TSEPs).

    zeta_i = |p_i|^2 - |P_i|^2        t_i = sum_j L_ij zeta_j        F = sum_i t_i p_i on a, -t_i p_i on b

    K_ab = -t_ab I + sum over edges j at b of  +-h_aj (x) p_j,        h_aj = dt_j/du_a = sum over edges i at a of  +-2 L_ij p_i

The tangent stiffness sums the vectors `h` before it forms matrices. For a face `a < b < c`, `K_ab` and `K_ac` use the same product
`h (x) p` with `h = h_a,bc`, and `K_bc` uses `h_b,ac`. So a face needs two products, an edge one, and a TSEP none.
`tangent_by_pairs` is the straightforward version with a matrix per TSEP. It adds `2 L_ij p_i (x) p_j` to three blocks if the edges
meet, to four if not.
"""

from __future__ import annotations

from typing import Any

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
    """Add F [N] at positions `x` (nv, 3) to `out`: 19 operations per edge and 4 per TSEP."""
    elongations(rest, x)
    tensions(rest)
    spread(rest, out)


def force_displacement(rest: Rest, u: Any, out: Any) -> None:
    """Add F [N] at displacements `u` (nv, 3) to `out`, without cancellation: 5 more operations per edge."""
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
    """Add K [N/m] at displacements `u`, as `tangent` does at positions."""
    elongations_displacement(rest, u)
    tensions(rest)
    add_blocks(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


def tangent_by_pairs(rest: Rest, x: Any, blocks: Any, diagonal: Any) -> None:
    """Add K [N/m] as `tangent` does, but with a matrix for each TSEP."""
    elongations(rest, x)
    tensions(rest)
    add_blocks_by_pairs(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


def tangent_by_pairs_displacement(rest: Rest, u: Any, blocks: Any, diagonal: Any) -> None:
    """Add K [N/m] at displacements `u`, as `tangent_by_pairs` does at positions."""
    elongations_displacement(rest, u)
    tensions(rest)
    add_blocks_by_pairs(rest, blocks)
    close_rows(rest.ends, blocks, diagonal)


def elongations(rest: Rest, x: Any) -> None:
    """Compute the current edges `p` and `zeta = |p|^2 - |P|^2`, the textbook form: 9 operations per edge."""
    for i in range(len(rest.ends)):
        p = minus(vector(x, rest.ends[i, 0]), vector(x, rest.ends[i, 1]))
        put(rest.p, i, p)
        rest.zeta[i] = dot(p, p) - rest.square[i]


def elongations_displacement(rest: Rest, u: Any) -> None:
    """Compute the current edges `p = P + U` and `zeta = (P + p) . U`: 14 operations per edge."""
    for i in range(len(rest.ends)):
        U, P = minus(vector(u, rest.ends[i, 0]), vector(u, rest.ends[i, 1])), vector(rest.P, i)
        p = plus(P, U)
        put(rest.p, i, p)
        rest.zeta[i] = dot(plus(P, p), U)


def tensions(rest: Rest) -> None:
    """Compute `t = L zeta`, each TSEP once for both of its edges: 1 operation per edge, 4 per TSEP."""
    for i in range(len(rest.L)):
        rest.tension[i] = rest.L[i] * rest.zeta[i]
    for i in range(len(rest.L)):
        zeta, tension = rest.zeta[i], rest.tension[i]
        for k in range(rest.start[i], rest.start[i + 1]):
            L, j = rest.pair_L[k], rest.other[k]
            tension += L * rest.zeta[j]
            rest.tension[j] += L * zeta
        rest.tension[i] = tension


def spread(rest: Rest, out: Any) -> None:
    """Add `t p` at one end of each edge and `-t p` at the other: 9 operations per edge."""
    for i in range(len(rest.ends)):
        f = times(rest.tension[i], vector(rest.p, i))
        add(out, rest.ends[i, 0], f)
        subtract(out, rest.ends[i, 1], f)


def change_of_tension(rest: Rest, slot: Any) -> Vector:
    """Return `h = sum +-2 L_ij p_i`: 6 operations per term, 3 fewer for the first."""
    first, end = rest.h_start[slot], rest.h_start[slot + 1]
    h = times(rest.h_L[first], vector(rest.p, rest.h_edge[first]))
    for k in range(first + 1, end):
        h = plus(h, times(rest.h_L[k], vector(rest.p, rest.h_edge[k])))
    return h


def add_blocks(rest: Rest, blocks: Any) -> None:
    """Add `K_ab` from the vectors `h`: 21 operations per edge, 45 per face, in addition to those of `h`."""
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


def add_blocks_by_pairs(rest: Rest, blocks: Any) -> None:
    """Add `K_ab` from a matrix for each TSEP: 39 operations if its edges meet, 48 if not."""
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


def add_own(block: Any, h: Vector, p: Vector, tension: Any) -> None:
    """Add `h (x) p - t I` to `K_ab` for the edge `ab` itself, where `h = -2 L p`. The product is symmetric: 18 operations."""
    xy, xz, yz = h[0] * p[1], h[0] * p[2], h[1] * p[2]
    add(block, 0, (h[0] * p[0] - tension, xy, xz))
    add(block, 1, (xy, h[1] * p[1] - tension, yz))
    add(block, 2, (xz, yz, h[2] * p[2] - tension))
