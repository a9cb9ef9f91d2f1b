"""Checks with rigid motions: invariance, balance of forces and torques, symmetry of K, and zero modes at rest.

Translations, rotations and reflections of the deformed body leave W unchanged, and rotate F and K with the body. K is symmetric. At
rest all its pivots are positive once the rigid motions are constrained.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.sparse import csc_matrix, csr_matrix, diags, issparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ...arguments import Array
from ...mesh import ElementMesh
from ..case import EPS, STRETCH, Case, random_rotation
from ..discretisation import facet_ids
from ..implementations import Implementation
from ..judgement import by_entry, by_node, largest_component, largest_rows, of_whole_body
from ..results import CannotDecide, NotApplicable, Task

REASON = "1e-12 allows for round-off of moving the body by about its own size: 1e-14 on a hundred elements in a row"
#: For a larger body, zero modes are checked on a piece of this size, with all other nodes constrained. A factorisation of 60 000
#: unknowns takes 15 s. For an operator, the columns of the piece are computed one by one.
LARGEST, LARGEST_OPERATOR = 60_000, 600
#: Pivots below this part of the diagonal count as zero. Zero pivots are 1e-12 of the diagonal at the size LARGEST. The smallest
#: pivots of a beam 1000 times longer than thick are 1e-10.
ZERO = 1e-11


def invariance(case: Case) -> Iterator[Task]:
    """Yield the tests of `W(g u) = W(u)`, `F(g u) = Q F(u)`, `K(g u) Q = Q K(u)` for motions `g` with orthogonal `Q`."""
    d = case.mesh.d
    rng = case.random("invariance")
    mirror = np.eye(d) - 2 * np.outer(np.eye(d)[0], np.eye(d)[0])
    shift = np.ptp(case.centred, axis=0).max() * rng.standard_normal(d)
    Q, little, far = (random_rotation(d, rng, degrees) for degrees in (115.0, 35.0, 165.0))
    motions = {"translation": (np.eye(d), shift), "rotation": (Q, 0 * shift), "reflection": (Q @ mirror, 0 * shift)}
    further = {"rotation by 35 degrees": (little, 0 * shift), "rotation by 165 degrees": (far, 0 * shift)}
    for implementation in case.implementations:  # agreement compares St. Venant-Kirchhoff in rotated states
        for motion, (Q, c) in (motions if case.is_stvk(implementation) else motions | further).items():
            for quantity in "WFK":
                measure = partial(_change, case, implementation, quantity, motion, Q, c)
                yield Task("invariance", implementation, quantity, motion, quantity, measure)


def _change(case: Case, implementation: Implementation, quantity: str, motion: str, Q: Array, c: Array) -> dict[str, Any]:
    d = case.mesh.d
    if np.linalg.det(Q) < 0 and not case.is_stvk(implementation):
        raise NotApplicable("a law may tell a body from its mirror image; the candidate does not claim to be St. Venant-Kirchhoff")
    if case.mesh.d == 1 and motion.startswith("rotation"):
        raise NotApplicable("a line cannot rotate")
    u = case.states[STRETCH]
    moved = (case.centred @ (Q - np.eye(d)).T + u.reshape(-1, d) @ Q.T + c).ravel()

    def rotated(f: Array) -> Array:
        return (f.reshape(-1, d) @ Q.T).ravel()

    if quantity == "W":
        W, words = implementation.W(u), "W before, or K at rest x edge squared, median"
        scale = max(abs(W), case.energy_floor(implementation))
        return of_whole_body(abs(implementation.W(moved) - W), scale, case.limits.of_body(moved), words, REASON)
    if quantity == "F":
        F, after = rotated(implementation.F(u)), implementation.F(moved)
        words = "largest |F| around before, or K at rest x edge"
        return by_node(case.mesh, after - F, case.force_scale(implementation, F), case.limits.of_nodes(moved), words, REASON)
    v = case.direction(u, case.random("invariance K"))
    Kv, after = rotated(np.asarray(implementation.K(u) @ v)), np.asarray(implementation.K(moved) @ rotated(v))
    scale = np.maximum(case.limits.around(largest_component(Kv, d)), case.stiffness(implementation) * largest_component(v, d))
    words = "largest |K v| around before, or K at rest x |v|"
    return by_node(case.mesh, after - Kv, scale, case.limits.of_nodes(moved), words, REASON)


def balance(case: Case) -> Iterator[Task]:
    """Yield the sums of forces and torques and the symmetry of K in every state, and the rigid modes at rest."""
    for implementation in case.implementations:
        for state in case.states:
            yield Task("balance", implementation, "sum of forces", state, "F", partial(_forces, case, implementation, state))
            yield Task("balance", implementation, "sum of torques", state, "F", partial(_torques, case, implementation, state))
            yield Task("symmetry", implementation, "K", state, "K", partial(_symmetry, case, implementation, state))
        yield Task("rigid modes", implementation, "K", "rest", "K", partial(_rigid_modes, case, implementation))


def _forces(case: Case, implementation: Implementation, state: str) -> dict[str, Any]:
    case.refuse_undefined(implementation, state)
    F = case.value(implementation, "F", state).reshape(-1, case.mesh.d)
    return _resultant(case, implementation, state, F.sum(axis=0), 1.0, "sum of |F|, or K at rest x edge")


def _torques(case: Case, implementation: Implementation, state: str) -> dict[str, Any]:
    case.refuse_undefined(implementation, state)
    d = case.mesh.d
    if d == 1:
        raise NotApplicable("there are no torques on a line")
    F = case.value(implementation, "F", state).reshape(-1, d)
    x = case.centred + case.states[state].reshape(-1, d)
    x = x - x.mean(axis=0)
    torque = np.array([(x[:, i] * F[:, j] - x[:, j] * F[:, i]).sum() for i, j in combinations(range(d), 2)])
    reach = float(np.abs(x).max())
    return _resultant(case, implementation, state, torque, reach, "sum of |F| x size of the body")


def _resultant(case: Case, implementation: Implementation, state: str, total: Array, reach: float, words: str) -> dict[str, Any]:
    scale = max(float(np.abs(case.value(implementation, "F", state)).sum()), float(case.force_floor(implementation).max())) * reach
    limit = case.limits.of_body(case.states[state])
    reason = "1e-12 allows for round-off: forces between the nodes of an element cancel"
    return of_whole_body(float(np.abs(total).max()), scale, limit, words, reason)


def _symmetry(case: Case, implementation: Implementation, state: str) -> dict[str, Any]:
    case.refuse_undefined(implementation, state)
    K, u = case.value(implementation, "K", state), case.states[state]
    reason = "1e-12 allows for round-off of the diagonal blocks: second derivatives commute"
    if issparse(K):
        rows = np.maximum(largest_rows(K, case.mesh.d), case.stiffness(implementation))
        return by_entry(case.mesh, K - K.T, rows, case.limits.of_pairs(u), "largest |K| of the rows, now or at rest", reason)
    rng = case.random("symmetry")
    x, y = rng.standard_normal((2, K.shape[0]))
    Kx, Ky = K @ x, K @ y
    scale, limit = float(np.abs(y * Kx).sum()), case.limits.of_body(u)
    return of_whole_body(abs(float(y @ Kx - x @ Ky)), scale, limit, "sum of |y K x|, random x and y", reason)


def rigid_motions(X: Array) -> Array:
    """Return translations and infinitesimal rotations about the origin of `X` (nv, d), (ndofs, d (d + 1)/2).

    The largest entry is 1.
    """
    d = X.shape[1]
    modes = [np.tile(axis, (len(X), 1)) for axis in np.eye(d)]
    for i, j in combinations(range(d), 2):
        spin = np.zeros_like(X)
        spin[:, i], spin[:, j] = -X[:, j], X[:, i]
        modes.append(spin / np.abs(X).max())
    return np.stack([mode.ravel() for mode in modes], axis=1)


def _rigid_modes(case: Case, implementation: Implementation) -> dict[str, Any]:
    u = np.zeros(case.mesh.p.size)
    K = implementation.K(u)
    error = np.max([np.abs(K @ mode) for mode in rigid_motions(case.centred).T], axis=0)
    reason = "1e-12 allows for round-off: translations and rotations strain nothing to first order"
    return by_node(
        case.mesh, error, case.stiffness(implementation), case.limits.of_nodes(u), "largest |K| of the row, modes of size 1", reason
    )


def zero_modes(case: Case) -> Iterator[Task]:
    """Yield the check that all pivots of K at rest are positive, so that only rigid motions have no energy."""
    for implementation in case.implementations:
        yield Task("no further zero mode", implementation, "K", "rest", "K", partial(_count, case, implementation))


def _count(case: Case, implementation: Implementation) -> dict[str, Any]:
    mesh = case.mesh
    if mesh.k < mesh.d:
        raise NotApplicable("membranes and cables in space resist no bending: K has further zero modes at rest")
    if case.elements_without_term:
        raise NotApplicable(
            f"{case.elements_without_term} elements belong to no term, so the body has holes that the mesh does not show"
        )
    if facet_connected_parts(mesh) > 1:
        raise NotApplicable("the body has parts that share no facet and can move or rotate against each other")
    K = implementation.K(np.zeros(mesh.p.size))
    free, supports = _supported(case, LARGEST if issparse(K) else LARGEST_OPERATOR)
    pivots, diagonal = _pivots(csc_matrix(K[free][:, free] if issparse(K) else _columns(K, free)))
    relative = pivots / np.maximum(diagonal, np.finfo(float).tiny)
    bad = np.flatnonzero(~(relative > ZERO))
    dofs = free[bad]
    worst = {"dof": int(dofs[0]), "node": int(dofs[0]) // mesh.d, "component": "xyz"[dofs[0] % mesh.d]} if len(bad) else {}
    return {
        "measured": float(len(bad)),
        "limit": 0.0,
        "scale": f"pivots, the smallest {np.min(relative):.1e} of its diagonal entry ({supports})",
        "reason": f"a mode without energy leaves a pivot that is zero (here: below {ZERO:g} of the diagonal entry) or negative",
        "worst": worst,
    }


def _supported(case: Case, largest: int) -> tuple[NDArray[np.int64], str]:
    """Return the degrees of freedom that stay free after the rigid motions are constrained, and a description of the constraint."""
    d, ndofs = case.mesh.d, case.mesh.p.size
    if ndofs > largest:
        centre = case.centred[case.random("zero modes").integers(case.mesh.nv)]
        near = np.argsort(((case.centred - centre) ** 2).sum(axis=1))[: largest // (2 * d)]
        return np.sort((d * near[:, None] + np.arange(d)).ravel()), f"{len(near)} nodes around one node, all others constrained"
    motions = rigid_motions(case.centred)
    grounded = qr(motions.T, mode="r", pivoting=True)[1][: motions.shape[1]]
    return np.setdiff1d(np.arange(ndofs), grounded), f"dofs {', '.join(map(str, sorted(grounded.tolist())))} grounded"


def _columns(K: Any, free: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the square block of an operator on some degrees of freedom, computed column by column."""
    unit, columns = np.zeros(K.shape[1]), []
    for dof in free:
        unit[dof] = 1.0
        columns.append(np.asarray(K @ unit)[free])
        unit[dof] = 0.0
    return np.stack(columns, axis=1)


def _pivots(K: csc_matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pivots of a factorisation with diagonal pivoting, and the diagonal entries, in the order of K.

    A shift of the diagonal prevents an error for an exactly singular matrix. The pivot of a mode that involves all degrees of
    freedom grows by their number times the shift. It must stay far below ZERO. Raise CannotDecide if the factorisation fails.
    """
    diagonal = np.abs(K.diagonal())
    part = max(0.01 * ZERO / max(len(diagonal), 1), EPS)
    shift = np.where(diagonal > 0, part * diagonal, 1e-3 * ZERO * diagonal.max())
    try:
        shifted, symmetric = K + diags(shift, format="csc"), {"SymmetricMode": True}
        lu = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
    except RuntimeError as error:
        raise CannotDecide(f"the factorisation of K at rest stopped: {error}") from error
    if not np.array_equal(lu.perm_r, lu.perm_c):
        raise CannotDecide("the factorisation of K at rest pivoted off the diagonal: K is not symmetric, or has a zero pivot")
    return lu.U.diagonal()[lu.perm_c], np.maximum(diagonal, shift / (0.1 * ZERO))


def facet_connected_parts(mesh: ElementMesh) -> int:
    """Return the number of parts of the mesh whose elements are connected by whole facets."""
    ids = facet_ids(mesh)
    incidence = csr_matrix((np.ones(ids.size), (ids.ravel(), np.tile(np.arange(mesh.nt), len(ids)))))
    return int(connected_components(incidence.T @ incidence, directed=False)[0])
