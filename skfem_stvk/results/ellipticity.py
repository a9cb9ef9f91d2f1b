"""Strong ellipticity: whether small motions of an element propagate as waves, or the material itself localises in a band.

A plane wave `a cos(N . X - w t)` of small amplitude in a homogeneous body has `rho w^2 = a . Q(N) a`, with the acoustic tensor

    Q(N) = (N . S N) I + F [N . C . N] F' + psi'' n n'        [N . C . N]_MN = C_MJNL N_J N_L        n = cof F N

The last term is that of `VolumePenalty`. `a . Q(N) a` is also the second derivative of the energy density along `F + s a (x) N`. If
it is not positive for all unit `a` and `N`, strong ellipticity is lost. Results then depend on the mesh, however fine it is.

`a . Q(N) a` is a form `sum M_ik,JL a_i a_k N_J N_L`, of second degree in each. Directions `N` in the element and motions `a` have
its own dimensions. In plane strain and plane stress both are in the plane, since triangles can only move there. Membranes and
cables in space are left out: under any compression they move transversely, which is wrinkling, and at rest they are at this limit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..edges.stiffness import VOIGT, multiplicity, voigt_indices
from ..errors import StvkError, name_ids
from ..terms.laws.volume_penalty import ENERGIES
from .law_on_elements import adjugate, dilation, strain_and_stress
from .response import ElasticBody, Masked, Response

Ids = NDArray[np.int64]

#: Number of starting directions, on half a circle and half a sphere.
DIRECTIONS = {2: 24, 3: 150}
#: Minimum angle between the best direction and the second one [rad].
MIN_ANGLE = 0.5
#: Number of elements at a time: their data fit into the cache.
CHUNK = 256
#: Newton steps from the best directions, the longest step [rad], and the tolerance of the value over the largest number of the
#: form.
MAX_STEPS, LONGEST_STEP, TOLERANCE = 30, 0.3, 1e-13


def smallest_acoustic_eigenvalue(state: Response) -> Masked:
    """Return the smallest eigenvalue (nt,) [Pa] of the acoustic tensors `Q(N)` over all unit `N`.

    Strong ellipticity is lost where it is not positive.

    Directions are sampled. The best one, and the best one away from it, are improved by Newton's method. An isotropic solid at rest
    has `mu`. Elements without a term, and all membranes and cables in space, are masked.
    """
    mesh, lowest = state.fields.mesh, np.zeros(state.fields.mesh.nt)
    missing = state.fields.without_term | (mesh.k < mesh.d)
    if mesh.k == mesh.d and any(part.known for part in state.fields.parts):
        refuse_other_laws(state.fields)  # alike in all parts of a divided body, also in one without elements of the law
    if len(ids := np.flatnonzero(~missing)):
        lowest[ids] = _smallest_of(ids, *_response(state))
    return lowest, missing


def refuse_other_laws(fields: ElasticBody) -> None:
    """Refuse a body with a law other than St. Venant-Kirchhoff's: the tensors here are those of that law."""
    for part in fields.parts:
        if part.law is not None or part.linear:
            law = "LinearElastic" if part.linear else type(part.law).__name__
            ids = fields.mesh.element_numbers[part.elements]
            where = f"{name_ids(ids, 'element')} in {law}" if len(ids) else law
            raise StvkError(
                f"{where}: expected StVK, the only law with a check of strong ellipticity. Leave out ellipticity, or the field "
                "smallest_acoustic_eigenvalue."
            )


def without_ellipticity(responses: Sequence[Response]) -> tuple[Ids, Array]:
    """Return the ascending ids (n,) of elements without strong ellipticity, and their `smallest_acoustic_eigenvalue` (n,) [Pa].

    `responses` are those at each point of the elements. One point without ellipticity is enough, and the smallest eigenvalue
    counts. It is computed only where ellipticity may be lost. This takes a fraction of the time unless the whole body is
    compressed.

    Ellipticity is not lost if `S_min + c/2 s_min^2 > 0`, with the smallest principal stress and stretch, and the smallest
    eigenvalue `c` of the elasticity tensor. The reason is `a . Q(N) a >= N . S N + B : C : B` with the symmetric part `B` of `F'a
    (x) N`: `|B|^2 >= |F'a|^2/2`.
    """
    found = [_lost(response) for response in responses]
    all_ids, lowest = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    ids, index = np.unique(all_ids, return_inverse=True)
    least = np.full(len(ids), np.inf)
    np.minimum.at(least, index, lowest)
    return ids, least


def _lost(state: Response) -> tuple[Ids, Array]:
    """Return `without_ellipticity` at one point of the elements."""
    mesh = state.fields.mesh
    if mesh.k < mesh.d:
        return np.empty(0, dtype=np.int64), np.empty(0)
    F, S, C, curvature = _response(state)
    mandel = np.sqrt(multiplicity(mesh.k))
    softest = np.linalg.eigvalsh(mandel[:, None] * C * mandel)[:, 0]
    bound = np.linalg.eigvalsh(S)[:, 0] + softest / 2 * np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F)[:, 0]
    ids = np.flatnonzero(~(bound > 0) & ~state.fields.without_term)
    lowest = _smallest_of(ids, F, S, C, curvature)
    return ids[lowest <= 0], lowest[lowest <= 0]


def _response(state: Response) -> tuple[Array, Array, Array, Array]:
    """Return, within the elements' own dimensions, `F`, `S` (nt, k, k), `C_MJ,NL` (nt, m, m), pairs in Voigt order, and `psi''`
    (nt,) [Pa].

    `S` and `C` are those of the materials alone, by their law for one unit of each strain. Vanishing components across are
    condensed out.
    """
    fields, k = state.fields, state.fields.mesh.k
    refuse_other_laws(fields)
    i, j = np.array(VOIGT[k]).T
    C = np.zeros((fields.mesh.nt, len(i), len(i)))
    for part in fields.parts:
        ids = part.elements
        share = (part.section / fields.section[ids])[:, None]
        for column in range(len(i)):
            unit = np.zeros((len(ids), k, k))
            unit[:, i[column], j[column]] = unit[:, j[column], i[column]] = 1.0 if i[column] == j[column] else 0.5
            C[ids, :, column] += (
                share * strain_and_stress(part.material, part.hypothesis, unit, state.point.frames[ids])[1][:, i, j]
            )
    E = state.strain[:, i, j] * multiplicity(k)
    S = (C @ E[..., None])[..., 0]
    return state.point.geometry.axes + state.gradient, S[:, voigt_indices(k)], C, _curvature(state)


def _curvature(state: Response) -> Array:
    """Return `psi''(J)` (nt,) [Pa] of all volume penalties."""
    curvature = np.zeros(state.fields.mesh.nt)
    for part in state.fields.volume_parts:
        e = dilation(state.gradient[part.elements])
        curvature[part.elements] += part.stiffness * ENERGIES[part.term.kind].curvature(e)
    return curvature


def _smallest_of(ids: Ids, F: Array, S: Array, C: Array, curvature: Array) -> Array:
    lowest = np.empty(len(ids))
    for begin in range(0, len(ids), CHUNK):
        chunk = ids[begin : begin + CHUNK]
        lowest[begin : begin + CHUNK] = smallest(acoustic_form(F[chunk], S[chunk], C[chunk], curvature[chunk]))
    return lowest


def acoustic_form(F: Array, S: Array, C: Array, curvature: Array) -> Array:
    """Return the form `M_ik,JL` (n, k, k, k, k), symmetric in `ik` and `JL`, of `F`, `S` (n, k, k), `C_MJ,NL` (n, m, m), `psi''`
    (n,).
    """
    n, k, _ = F.shape
    index = voigt_indices(k)
    tensor = C[:, index[:, :, None, None], index].reshape(n, k, -1)  # M JNL
    half = (F @ tensor).reshape(n, k, k, k, k)  # i J N L
    M = np.moveaxis(F[:, None, None] @ half, 3, 2)  # i k J L
    if curvature.any():
        solid = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        solid[:, :k, :k] = F
        cofactors = np.ascontiguousarray(np.swapaxes(adjugate(solid), 1, 2))[:, :k, :k]  # derivatives of det F
        M = M + np.einsum("n,niJ,nkL->nikJL", curvature, cofactors, cofactors)
    M = (M + np.swapaxes(M, 3, 4)) / 2
    return M + np.eye(k)[:, :, None, None] * S[:, None, None]


def smallest(form: Array) -> Array:
    """Return the smallest values (n,) of forms `M_ik,JL a_i a_k N_J N_L` (n, k, k, k, k) over unit `a` and `N`.

    The results are never below the true minima. For 6000 random and very anisotropic forms all minima were found; from the best
    direction alone, all but 13.
    """
    k = form.shape[1]
    if k == 1:
        return form[:, 0, 0, 0, 0]
    (i, j), N = np.array(VOIGT[k]).T, directions(k)
    values = _lowest_eigenvalue(form[:, i, j][:, :, i, j] @ (N[:, i] * N[:, j] * multiplicity(k)).T)
    best = values.argmin(axis=1)
    second_best = np.where(np.abs(N @ N.T)[best] < np.cos(MIN_ANGLE), values, np.inf).argmin(axis=1)
    return np.minimum(_improved(form, N[best]), _improved(form, N[second_best]))


def directions(k: int) -> Array:
    """Return unit vectors (n, k), spread evenly over half a circle or half a sphere."""
    n = DIRECTIONS[k]
    if k == 2:
        angle = np.pi * np.arange(n) / n
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    height, angle = (np.arange(n) + 0.5) / n, np.pi * (3 - np.sqrt(5)) * np.arange(n)  # rotates by the golden angle
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _lowest_eigenvalue(Q: Array) -> Array:
    """Return the smallest eigenvalue (n, s) of symmetric matrices (n, m, s) in Voigt order, to half the digits if it is double."""
    if Q.shape[1] == 3:
        a, b, c = Q[:, 0], Q[:, 1], Q[:, 2]
        return (a + b) / 2 - np.sqrt(((a - b) / 2) ** 2 + c**2)
    mean = Q[:, :3].sum(axis=1) / 3
    a, b, c = Q[:, 0] - mean, Q[:, 1] - mean, Q[:, 2] - mean
    f, e, d = Q[:, 3], Q[:, 4], Q[:, 5]
    off = d**2 + e**2 + f**2
    p = np.sqrt((a**2 + b**2 + c**2 + 2 * off) / 6)
    determinant = a * (b * c - f**2) - d * (d * c - e * f) + e * (d * f - b * e)
    r = determinant / (2 * np.where(p > 0, p, 1.0) ** 3)
    return mean + 2 * p * np.cos((np.arccos(np.clip(r, -1, 1)) + 2 * np.pi) / 3)


def _improved(form: Array, N: Array) -> Array:
    """Return local minima (n,) of the smallest eigenvalue of `Q(N)`, from `N` (n, k), by a Newton method that always descends.

    With the unit eigenvector `a` of the smallest eigenvalue `q`, the others `b` of `q_b`, and `N` moved to `N + T d`, `T` across
    `N`:

        g = T' G N    G_JL = M_ik,JL a_i a_k        H = T' G T - q I - sum_b c_b c_b'/(q_b - q)    c_b = 2 T' (M_ik,JL b_i a_k N_L)
    """
    k, ids = N.shape[1], np.arange(len(N))
    size = np.abs(form).max(axis=(1, 2, 3, 4))
    q, V = np.linalg.eigh(_acoustic_tensor(form, N))
    radius, lowest = np.full(len(N), LONGEST_STEP), q[:, 0].copy()
    for _ in range(MAX_STEPS):
        T = _across(N)
        with_a = np.einsum("nikJL,nk->niJL", form, V[:, :, 0])
        G = np.einsum("niJL,ni->nJL", with_a, V[:, :, 0])
        c = 2 * np.swapaxes(V[:, :, 1:], 1, 2) @ (with_a @ N[:, None, :, None])[..., 0] @ T
        gap = np.maximum(q[:, 1:] - q[:, :1], 1e-3 * size[:, None])
        H = np.swapaxes(T, 1, 2) @ G @ T - q[:, :1, None] * np.eye(k - 1) - np.swapaxes(c, 1, 2) @ (c / gap[..., None])
        g = (np.swapaxes(T, 1, 2) @ G @ N[..., None])[..., 0]
        curvature, W = np.linalg.eigh(H)
        along = (np.swapaxes(W, 1, 2) @ g[..., None])[..., 0]
        d = -along / np.maximum(np.abs(curvature), 1e-9 * size[:, None])
        length = np.linalg.norm(d, axis=1)
        d *= np.minimum(1.0, radius / np.maximum(length, 1e-300))[:, None]
        moved = N + (T @ W @ d[..., None])[..., 0]
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        q_moved, V_moved = np.linalg.eigh(_acoustic_tensor(form, moved))
        better = q_moved[:, 0] < q[:, 0]
        radius = np.where(better, radius, np.minimum(radius, length) / 4)
        N, q = np.where(better[:, None], moved, N), np.where(better[:, None], q_moved, q)
        V = np.where(better[:, None, None], V_moved, V)
        lowest[ids] = q[:, 0]
        active = -(along * d).sum(axis=1) > TOLERANCE * size
        if not active.any():
            break
        ids, form, size, radius, N, q, V = (array[active] for array in (ids, form, size, radius, N, q, V))
    return lowest


def _acoustic_tensor(form: Array, N: Array) -> Array:
    """Return the acoustic tensors `Q(N)` (n, k, k) of forms, each for one `N`."""
    return ((form @ N[:, None, None, :, None])[..., 0] @ N[:, None, :, None])[..., 0]


def _across(N: Array) -> Array:
    """Return orthonormal vectors (n, k, k - 1) across unit vectors: columns of the reflection that takes the last axis to `N` or
    `-N`.
    """
    k = N.shape[1]
    v = N.copy()
    v[:, -1] += np.where(N[:, -1] < 0, -1.0, 1.0)
    reflection = np.eye(k) - 2 * v[:, :, None] * v[:, None] / (v**2).sum(axis=1)[:, None, None]
    return reflection[:, :, : k - 1]
