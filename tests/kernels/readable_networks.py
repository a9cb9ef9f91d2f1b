"""Readable twins of the kernels of networks; `readable` has the twins of kernels of elements."""

from __future__ import annotations

from itertools import product

import numpy as np

from skfem_stvk.kernels.compiled import Ids, Reals
from skfem_stvk.kernels.lanes import TRANSPOSED
from skfem_stvk.kernels.networks import EDGES, SPARE


def in_blocks_of_edges(x: Reals, edges: int) -> Reals:
    """Return the values in blocks of edges, (edges, 3), one row per edge."""
    return x.reshape(-1, 3, EDGES).transpose(0, 2, 1).reshape(-1, 3)[:edges]


def elongate(
    begin: int, end: int, by_length: bool, edges: Ids, rest: Reals, u: Reals, z: Reals, g: Reals, inverse_length: Reals
) -> None:
    part = slice(begin * EDGES, end * EDGES)
    a, b = edges[part].T
    P, U = in_blocks_of_edges(rest, len(edges))[part], u.reshape(-1, 3)[a] - u.reshape(-1, 3)[b]
    p = P + U
    squared, lengths = ((2 * P + U) * U).sum(axis=1), np.linalg.norm(p, axis=1)
    both = lengths + np.linalg.norm(P, axis=1)
    z[part], g.reshape(-1, 3)[part], inverse_length[part] = squared, 2 * p, 0
    if by_length:
        inverse_length[part] = np.divide(1, lengths, out=np.zeros_like(lengths), where=lengths > 0)
        z[part] = np.divide(squared, both, out=np.zeros_like(both), where=both > 0)
        g.reshape(-1, 3)[part] = inverse_length[part][:, None] * p


def springs(begin: int, end: int, by_length: bool, edges: Ids, slots: Ids, rest: Reals, own: Reals, u: Reals, f: Reals) -> float:
    z, g, inverse_length = np.zeros(len(edges)), np.zeros(3 * len(edges)), np.zeros(len(edges))
    elongate(begin, end, by_length, edges, rest, u, z, g, inverse_length)
    return pull(begin, end, slots, z, own * z, g, f)


def couple(begin: int, end: int, pairs: Ids, slots: Ids, between: Reals, z: Reals, s: Reals) -> None:
    for (i, j), (first, second), A in zip(pairs[begin:end], slots[begin:end], between[begin:end], strict=True):
        s[first] += A * z[j]
        s[second] += A * z[i]


def pull(begin: int, end: int, slots: Ids, z: Reals, s: Reals, g: Reals, f: Reals) -> float:
    part = slice(begin * EDGES, end * EDGES)
    if len(f):
        force = s[part, None] * g.reshape(-1, 3)[part]
        np.add.at(f.reshape(-1, 3), slots[part, 0], force)
        np.subtract.at(f.reshape(-1, 3), slots[part, 1], force)
    return float(s[part].astype(float) @ z[part].astype(float)) / 2


def put_blocks(
    begin: int,
    end: int,
    by_length: bool,
    own: Reals,
    s: Reals,
    g: Reals,
    inverse_length: Reals,
    positive: float,
    negative: float,
    blocks: Reals,
) -> None:
    part = slice(begin, end)
    n = g.reshape(-1, 3)[part]
    dyad, kept = n[:, :, None] * n[:, None, :], (s * np.where(s > 0, positive, negative))[part]
    H = inverse_length[part, None, None] * (np.eye(3) - dyad) if by_length else 2 * np.eye(3)
    blocks[: 9 * (len(blocks) // 9)].reshape(-1, 3, 3)[part] = -(own[part, None, None] * dyad + kept[:, None, None] * H)


def couple_blocks(begin: int, end: int, pairs: Ids, to: Ids, between: Reals, g: Reals, blocks: Reals) -> None:
    slopes, targets = g.reshape(-1, 3), blocks.reshape(-1, 3, 3)
    for (i, j), slots, A in zip(pairs[begin:end], to[begin:end], between[begin:end], strict=True):
        for slot, sigma in zip(slots, (1, -1, -1, 1), strict=True):
            block = sigma * A * np.outer(slopes[i], slopes[j])
            targets[slot & ~TRANSPOSED] += block.T if slot & TRANSPOSED else block


def find_blocks(begin: int, end: int, edges: Ids, starts: Ids, pairs: Ids, out: Ids) -> int:
    number = {(a, b): e for e, (a, b) in enumerate(edges)}
    missing = 0
    for n in range(begin, end):
        for place, (r, s) in enumerate(product(edges[pairs[n, 0]], edges[pairs[n, 1]])):
            found = number.get((min(r, s), max(r, s)))
            missing += found is None and r != s
            at = len(edges) + n % SPARE if r == s else len(edges) + SPARE if found is None else found
            out[n, place] = np.uint32(at) | (TRANSPOSED if r > s else np.uint32(0))
    return missing
