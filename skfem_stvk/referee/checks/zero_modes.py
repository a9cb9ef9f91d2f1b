"""At rest K has no zero mode besides the rigid ones: all pivots are positive once those are grounded."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csc_matrix, csr_matrix, issparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ...mesh import SimplexMesh
from ...mesh.facets import facet_ids
from ..case import Case
from ..players import Player
from ..tasks import NotApplicable, Task
from .balance import rigid_motions

#: A larger body is checked on a piece of this size, all else held: a factorisation of 60 000 unknowns takes 15 s.
LARGEST = 60_000
#: Zero pivots come out at 1e-12 of the diagonal at this size; those of a beam 1000 times longer than thick are 1e-10.
ZERO = 1e-11


def zero_modes(case: Case) -> Iterator[Task]:
    """Number of pivots that are not positive."""
    for player in case.players:
        yield Task("no further zero mode", player, "K", "rest", "K", partial(_count, case, player))


def _count(case: Case, player: Player) -> dict[str, Any]:
    mesh = case.mesh
    if mesh.k < mesh.d:
        raise NotApplicable("membranes and cables in space resist no bending: K has further zero modes at rest")
    if facet_connected_parts(mesh) > 1:
        raise NotApplicable("the body is in parts that share no facet, which can move or turn against each other")
    K = player.K(np.zeros(mesh.p.size))
    if not issparse(K):
        if mesh.p.size > 3000:
            raise NotApplicable(f"K is an operator with {mesh.p.size} columns; a factorisation needs a matrix")
        K = csr_matrix(K @ np.eye(mesh.p.size))
    free, how = _supported(case)
    pivots, diagonal = _pivots(csc_matrix(K[free][:, free]))
    bad = np.flatnonzero(~(pivots > ZERO * diagonal))
    dofs = free[bad]
    worst = {"dof": int(dofs[0]), "vertex": int(dofs[0]) // mesh.d, "component": "xyz"[dofs[0] % mesh.d]} if len(bad) else {}
    return {
        "measured": float(len(bad)),
        "limit": 0.0,
        "scale": f"pivots, the smallest {np.min(pivots / diagonal):.1e} of its diagonal entry ({how})",
        "reason": f"a mode without energy leaves a pivot that is zero (here: below {ZERO:g} of the diagonal entry) or negative",
        "worst": worst,
    }


def _supported(case: Case) -> tuple[NDArray[np.int64], str]:
    """Degrees of freedom that stay free when the rigid motions are taken away, and how that was done."""
    d, ndofs = case.mesh.d, case.mesh.p.size
    if ndofs > LARGEST:
        centre = case.centred[case.random("zero modes").integers(case.mesh.nv)]
        near = np.argsort(((case.centred - centre) ** 2).sum(axis=1))[: LARGEST // (2 * d)]
        return np.sort((d * near[:, None] + np.arange(d)).ravel()), f"{len(near)} vertices around one, all others held"
    motions = rigid_motions(case.centred)
    grounded = qr(motions.T, mode="r", pivoting=True)[1][: motions.shape[1]]
    return np.setdiff1d(np.arange(ndofs), grounded), f"dofs {', '.join(map(str, sorted(grounded.tolist())))} grounded"


def _pivots(K: csc_matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pivots of a factorisation that keeps to the diagonal, and the diagonal entries, in the order of K."""
    diagonal = np.abs(K.diagonal())
    try:
        lu = splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # "Factor is exactly singular"
        return np.zeros(len(diagonal)), np.maximum(diagonal, np.finfo(float).tiny)
    if not np.array_equal(lu.perm_r, lu.perm_c):  # a zero on the diagonal was avoided
        return np.zeros(len(diagonal)), np.maximum(diagonal, np.finfo(float).tiny)
    return lu.U.diagonal()[lu.perm_c], diagonal


def facet_connected_parts(mesh: SimplexMesh) -> int:
    """Number of parts of simplices that hang together by whole facets."""
    ids = facet_ids(mesh)
    incidence = csr_matrix((np.ones(ids.size), (ids.ravel(), np.tile(np.arange(mesh.nt), mesh.k + 1))))
    return int(connected_components(incidence.T @ incidence, directed=False)[0])
