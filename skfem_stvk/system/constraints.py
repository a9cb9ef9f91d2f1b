"""Null space of linear constraints between bodies, by elimination of one body after another."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ..arguments import Array

#: A unit constraint with a pivot below this value does not constrain. Joints that are closer together than 3e-7 of a body count as
#: one.
NOTHING = 3e-7
SAMPLES = 8
#: Largest number of neighbours of a body that is eliminated, which limits the time for one body to some ms.
MOST_NEIGHBOURS = 24


class Block(NamedTuple):
    """Constraints `rows @ concatenate(q of the bodies) = 0`.

    `rows` are (n, m r) coefficients of the r unknowns of each of m bodies.
    """

    bodies: tuple[int, ...]
    rows: Array


class _Eliminated(NamedTuple):
    """Eliminated body: its unknowns follow from those of its neighbours and from its free ones.

    The equation is `R q[order] + others @ q(neighbours) = 0`.
    """

    body: int
    neighbours: tuple[int, ...]
    order: NDArray[np.int64]
    R: Array
    others: Array


def free_motions(blocks: Sequence[Block], count: int, r: int) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
    """Return the numbers of free unknowns of bodies under constraints, and samples of the null space.

    There are `count` bodies with `r` unknowns each.

    The method is a sparse QR factorisation. Each front is a body, and bodies with the fewest neighbours come first. An unknown
    without a pivot is free. The assignment of free unknowns to bodies depends on the order, but their sum over connected bodies
    does not. Rows are orthogonally transformed and never scaled, so round-off does not grow.

    If the connections form trees, time and memory are proportional to the number of bodies. If thousands of bodies fill the plane
    or space, elimination stops when each remaining body has more than 24 neighbours. The remaining bodies are assumed at rest. Then
    all motions found are free, but some free motions may be missed.

    Entries of every row and the norm of every block should be about 1.

    Returns
    -------
    free
        (count,) numbers of free unknowns, whose sum is the dimension of the null space.
    samples
        (count, r, 8) random vectors of the null space.
    at_rest
        (count,) whether a body is assumed at rest.

    Examples
    --------
    >>> equal = Block((0, 1), np.array([[1.0, -1.0]]))
    >>> free, samples, _ = free_motions([equal], count=2, r=1)
    >>> int(free.sum()), bool(np.allclose(samples[0], samples[1]))
    (1, True)
    """
    eliminated = _eliminate(blocks, count, r)
    free, at_rest = np.zeros(count, dtype=np.int64), np.ones(count, dtype=bool)
    samples, rng = np.zeros((count, r, SAMPLES)), np.random.default_rng(0)
    for body, neighbours, order, R, others in reversed(eliminated):
        rank = len(R)
        free[body], at_rest[body] = r - rank, False
        own = rng.standard_normal((r, SAMPLES))
        known = R[:, rank:] @ own[rank:] + others @ samples[list(neighbours)].reshape(r * len(neighbours), SAMPLES)
        if rank:  # SciPy refuses empty ones before 1.14
            own[:rank] = -solve_triangular(R[:, :rank], known, check_finite=False)
        samples[body, order] = own
    return free, samples, at_rest


def compressed(rows: Array) -> Array:
    """Return constraints equivalent to `rows` (n, m), of norm 1 at most, and at most m of them."""
    if len(rows) > rows.shape[1]:
        rows = _triangle(rows)
    return rows / max(1.0, float(np.linalg.norm(rows)))


def _eliminate(blocks: Sequence[Block], count: int, r: int) -> list[_Eliminated]:
    at: list[dict[int, Block]] = [{} for _ in range(count)]
    neighbours: list[set[int]] = [set() for _ in range(count)]
    made = 0

    def add(block: Block) -> None:
        nonlocal made
        for body in block.bodies:
            at[body][made] = block
            neighbours[body].update(block.bodies)
        made += 1

    for block in blocks:
        add(block)
    done: list[_Eliminated] = []
    eliminated = np.zeros(count, dtype=bool)
    queue = [(len(around), body) for body, around in enumerate(neighbours)]
    heapq.heapify(queue)
    while queue:
        size, body = heapq.heappop(queue)
        if eliminated[body] or size != len(neighbours[body]):
            continue
        if size > MOST_NEIGHBOURS:
            break
        eliminated[body] = True
        around = tuple(sorted(neighbours[body] - {body}))
        own, rest = _front(at[body], (body, *around), r)
        step, remaining = _pivots(body, around, own, rest)
        done.append(step)
        for number, block in list(at[body].items()):
            for other in block.bodies:
                del at[other][number]
        for other in around:
            neighbours[other].discard(body)
        if around and len(remaining):
            add(Block(around, remaining))
        for other in around:
            heapq.heappush(queue, (len(neighbours[other]), other))
    return done


def _front(blocks: dict[int, Block], bodies: tuple[int, ...], r: int) -> tuple[Array, Array]:
    """Return the coefficients (n, r) of the first of the `bodies` in the `blocks`, and those of the other bodies."""
    position = {body: i for i, body in enumerate(bodies)}
    rows = np.zeros((sum(len(block.rows) for block in blocks.values()), len(bodies), r))
    first = 0
    for block in blocks.values():
        last = first + len(block.rows)
        rows[first:last, [position[body] for body in block.bodies]] = block.rows.reshape(-1, len(block.bodies), r)
        first = last
    return rows[:, 0], rows[:, 1:].reshape(len(rows), r * (len(bodies) - 1))


def _triangle(rows: Array) -> Array:
    """Return R (m, m) of the QR factorisation of `rows` (n, m), n >= m, which are equivalent constraints."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _pivots(body: int, around: tuple[int, ...], own: Array, rest: Array) -> tuple[_Eliminated, Array]:
    """Return the eliminated body from the rows with pivots, and the other rows, which no longer contain it.

    The elimination uses Householder reflections with column pivoting.
    """
    r = own.shape[1]
    order, rank = np.arange(r), 0
    while rank < min(own.shape):
        norms = np.linalg.norm(own[rank:, rank:], axis=0)
        best = rank + int(norms.argmax())
        if norms[best - rank] <= NOTHING:
            break
        order[[rank, best]], own[:, [rank, best]] = order[[best, rank]], own[:, [best, rank]]
        reflector = own[rank:, rank].copy()
        reflector[0] += np.copysign(norms[best - rank], reflector[0])
        reflector /= np.linalg.norm(reflector)
        for rows in (own[rank:, rank:], rest[rank:]):
            rows -= np.outer(2 * reflector, reflector @ rows)
        rank += 1
    remaining = rest[rank:]
    if len(remaining) > remaining.shape[1]:
        remaining = _triangle(remaining)
    return _Eliminated(body, around, order, own[:rank].copy(), rest[:rank].copy()), remaining
