"""Bounds of round-off errors, above which an estimate says nothing about a residual."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..edges.bound_term import joined
from .system import System

EPS = float(np.finfo(float).eps)
#: Largest round-off of a force that counts, as a fraction of the stiffness at rest times an edge length. Errors are at most 1e-10
#: of this product, unless stretches of inverted elements nearly cancel. In that case the tangent has no bound, and the errors are
#: 1e-3 to 100 of it.
MOST = 1e-6


def largest_error(system: System) -> Array:
    """Return `MOST |K_aa| l_a` (ndofs,) [N], with the tangent K at rest and the longest edge `l_a` of each node.

    Nodes without stiffness at rest get the largest value of all nodes.
    """
    p, d, lengths = system.mesh.p, system.mesh.d, np.zeros(system.mesh.nv)
    for term in system.bound_terms:
        ends = joined(term)
        edges = np.linalg.norm(p[:, ends[0]] - p[:, ends[1]], axis=0)
        for end in ends:
            np.maximum.at(lengths, end, edges)
    blocks = system.linear_operator(np.zeros(system.ndofs)).diagonal_blocks()
    errors = MOST * np.abs(blocks).max(axis=(1, 2)) * lengths
    return np.repeat(np.where(errors > 0, errors, system.space.comm.most(float(errors.max(initial=0.0)))), d)


def below(largest: Array, sums: Array) -> Array:
    """Return `sums`, which are round-off errors over eps, with 0 for entries with an error above `largest`."""
    return np.where(EPS * sums <= largest, sums, 0.0)
