"""At rest K has no zero mode besides the rigid ones: all pivots are positive once those are grounded."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csc_matrix, csr_matrix, diags, issparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ...mesh import SimplexMesh
from ...mesh.facets import facet_ids
from ..case import Case
from ..players import Player
from ..tasks import CannotTell, NotApplicable, Task
from .balance import rigid_motions

#: A larger body is checked on a piece of this size, all else held: a factorisation of 60 000 unknowns takes 15 s. Of an operator,
#: the columns of the piece are found one by one.
LARGEST, LARGEST_OPERATOR = 60_000, 600
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
    if case.bare:
        raise NotApplicable(f"{case.bare} elements belong to no term, so the body has holes that the mesh does not show")
    if facet_connected_parts(mesh) > 1:
        raise NotApplicable("the body is in parts that share no facet, which can move or turn against each other")
    K = player.K(np.zeros(mesh.p.size))
    free, how = _supported(case, LARGEST if issparse(K) else LARGEST_OPERATOR)
    pivots, diagonal = _pivots(csc_matrix(K[free][:, free] if issparse(K) else _columns(K, free)))
    relative = pivots / np.maximum(diagonal, np.finfo(float).tiny)
    bad = np.flatnonzero(~(relative > ZERO))
    dofs = free[bad]
    worst = {"dof": int(dofs[0]), "vertex": int(dofs[0]) // mesh.d, "component": "xyz"[dofs[0] % mesh.d]} if len(bad) else {}
    return {
        "measured": float(len(bad)),
        "limit": 0.0,
        "scale": f"pivots, the smallest {np.min(relative):.1e} of its diagonal entry ({how})",
        "reason": f"a mode without energy leaves a pivot that is zero (here: below {ZERO:g} of the diagonal entry) or negative",
        "worst": worst,
    }


def _supported(case: Case, largest: int) -> tuple[NDArray[np.int64], str]:
    """Degrees of freedom that stay free when the rigid motions are taken away, and how that was done."""
    d, ndofs = case.mesh.d, case.mesh.p.size
    if ndofs > largest:
        centre = case.centred[case.random("zero modes").integers(case.mesh.nv)]
        near = np.argsort(((case.centred - centre) ** 2).sum(axis=1))[: largest // (2 * d)]
        return np.sort((d * near[:, None] + np.arange(d)).ravel()), f"{len(near)} vertices around one, all others held"
    motions = rigid_motions(case.centred)
    grounded = qr(motions.T, mode="r", pivoting=True)[1][: motions.shape[1]]
    return np.setdiff1d(np.arange(ndofs), grounded), f"dofs {', '.join(map(str, sorted(grounded.tolist())))} grounded"


def _columns(K: Any, free: NDArray[np.int64]) -> NDArray[np.float64]:
    """The square block of an operator on some degrees of freedom, column by column."""
    unit, columns = np.zeros(K.shape[1]), []
    for dof in free:
        unit[dof] = 1.0
        columns.append(np.asarray(K @ unit)[free])
        unit[dof] = 0.0
    return np.stack(columns, axis=1)


def _pivots(K: csc_matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pivots of a factorisation that keeps to the diagonal, and the diagonal entries, in the order of K.

    A shift far below what counts as zero keeps an exactly singular matrix from stopping it.
    """
    diagonal = np.abs(K.diagonal())
    shift = np.where(diagonal > 0, 0.01 * ZERO * diagonal, 1e-3 * ZERO * diagonal.max())
    try:
        lu = splu(
            K + diags(shift, format="csc"), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise CannotTell(f"the factorisation of K at rest stopped: {error}") from error
    if not np.array_equal(lu.perm_r, lu.perm_c):
        raise CannotTell("the factorisation of K at rest left the diagonal: K is not symmetric, or has a zero pivot")
    return lu.U.diagonal()[lu.perm_c], np.maximum(diagonal, shift / (0.1 * ZERO))


def facet_connected_parts(mesh: SimplexMesh) -> int:
    """Number of parts of simplices that hang together by whole facets."""
    ids = facet_ids(mesh)
    incidence = csr_matrix((np.ones(ids.size), (ids.ravel(), np.tile(np.arange(mesh.nt), mesh.k + 1))))
    return int(connected_components(incidence.T @ incidence, directed=False)[0])
