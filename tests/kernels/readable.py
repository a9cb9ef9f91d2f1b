"""Twins of the kernels in plain NumPy: the same signatures, slow and readable.

Only tests call the twins, and compare the kernels with them. The twins use a second method where one exists. They take gradients of
shape functions in the frame instead of base vectors. They use the whole tensor C instead of the stored numbers, and sums over lists
instead of loops.

Elements differ only in their table of points, and laws only in their entry of `LAWS`. The arrays are described in
`skfem_stvk.kernels.element_assembly`, `laws` and `blocks`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from skfem_stvk.kernels.compiled import Ids, Reals
from skfem_stvk.kernels.compiled_cg import (
    BETA,
    CONVERGED,
    NEGATIVE,
    NORM,
    NOT_FINITE,
    REDUCTION,
    RHO,
    RHO_AT_NORM,
    UNFINISHED,
    P,
    S,
    T,
    U,
    X,
)
from skfem_stvk.kernels.corotated_law import CorotatedLaw
from skfem_stvk.kernels.discrete_gradient import DiscreteGradient
from skfem_stvk.kernels.element_assembly import MeanStress, StressOfRates
from skfem_stvk.kernels.invertible_law import InvertibleLaw
from skfem_stvk.kernels.lanes import LANES, TRANSPOSED, MeanPoints, Points
from skfem_stvk.kernels.linear_law import LinearGeneralLaw, LinearIsotropicLaw
from skfem_stvk.kernels.neo_hookean_law import NeoHookeanLaw, NeoHookeanSheet
from skfem_stvk.kernels.rows import PairSlots, RowSlots
from skfem_stvk.kernels.simplex_topology import OWN
from skfem_stvk.kernels.st_venant_kirchhoff import GeneralLaw, IsotropicLaw
from skfem_stvk.kernels.svd import LINE, SHEET
from skfem_stvk.kernels.tension_fields import TensionLaw
from skfem_stvk.kernels.volume_energies import BARRIER, COMPRESSION, QUADRATIC
from skfem_stvk.terms.laws.neo_hookean import thickening

#: Edges of a tetrahedron as pairs of its vertices, in the order of `edge_slots`.
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))

#: The order in which the components of symmetric tensors are stored.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def out_of_lanes(a: NDArray, width: int, part: slice) -> NDArray:
    """Return the values in this part of the blocks of lanes, (n, width), one row per simplex."""
    blocks = a.reshape(-1, width, LANES)[part]
    return np.moveaxis(blocks, 2, 1).reshape(-1, width)


def corners(x: Reals, part: slice, t: Ids, D: Reals) -> Reals:
    """Return the differences of `x` between the vertices of each simplex and vertex 0, (n, 4, 3), computed in double precision."""
    corners = x.reshape(-1, 3)[out_of_lanes(t, 4, part)]
    return (corners - corners[:, :1]).astype(D.dtype)


# Elements with any table of points, and any law. Einsum's indices: n elements, q points, a and b nodes; i, j, k, l axes of the
# frame; x and y components.


def isotropic(numbers: Reals) -> Reals:
    """Return C of `S = C : M`, (..., 3, 3, 3, 3), from the numbers `w lam/2` and `w mu`.

    C_ijkl = lam/2 d_ij d_kl + mu/2 (d_ik d_jl + d_il d_jk)
    """
    I = np.eye(3)
    volume, shear = np.einsum("ij,kl->ijkl", I, I), np.einsum("ik,jl->ijkl", I, I) + np.einsum("il,jk->ijkl", I, I)
    lam, mu = np.moveaxis(numbers, -1, 0)[..., None, None, None, None]
    return lam * volume.astype(numbers.dtype) + mu * (shear / 2).astype(numbers.dtype)


def general(numbers: Reals) -> Reals:
    """Return `C_ijkl`, (..., 3, 3, 3, 3), from the 21 numbers of its upper half in the order of `PAIRS`, row by row."""
    C = np.empty((*numbers.shape[:-1], 3, 3, 3, 3), numbers.dtype)
    upper = ((c, d) for c in range(6) for d in range(c, 6))
    for value, (c, d) in zip(np.moveaxis(numbers, -1, 0), upper, strict=True):
        (i, j), (k, l) = PAIRS[c], PAIRS[d]
        for a, b in ((i, j), (j, i)):
            for e, f in ((k, l), (l, k)):
                C[..., a, b, e, f] = C[..., e, f, a, b] = value
    return C


class PointLaw(NamedTuple):
    """Law at points (n, q), in frames.

    The axes of a frame at rest are the rows of `Q`, and `h` are their displacements, both (n, q, 3, 3).

    Attributes
    ----------
    count
        Number of values that the law stores in addition to `Ri`.
    energy_and_pull
        From `numbers` (n, q, count) times the weights, `Q` and `h`: the energies (n, q), and `s` (n, q, 3, 3) with the rows
        `s_j = dW/dq_j`.
    tangent
        From the same arguments, two factors of tensions by their sign, and whether elements are linear simplices: `A` (n, q, 3, 3,
        3, 3) with `A_mnxy = ds_mx/dq_ny`.
    """

    count: int
    energy_and_pull: Callable[[Reals, Reals, Reals], tuple[Reals, Reals]]
    tangent: Callable[[Reals, Reals, Reals, float, float, bool], Reals]


def strains(Q: Reals, h: Reals) -> Reals:
    """Return `M_ij = Q_i . h_j + h_i . Q_j + h_i . h_j`."""
    return symmetric(Q, h) + products(h, h)


def stvk(count: int, tensor: Callable[[Reals], Reals]) -> PointLaw:
    """Return the law `W = 1/4 S : M`, `s_j = sum_k S_jk q_k`, `A_mn = 2 sum_kl C_mknl q_k q_l' + S_mn I`, `S = C : M`.

    The tangent multiplies positive and negative eigenvalues of `S` by a factor each. For linear simplices it multiplies all
    eigenvalues by the first factor.
    """

    def stress(numbers: Reals, Q: Reals, h: Reals) -> Reals:
        return np.einsum("nqijkl,nqkl->nqij", tensor(numbers), strains(Q, h))

    def energy_and_pull(numbers: Reals, Q: Reals, h: Reals) -> tuple[Reals, Reals]:
        S = stress(numbers, Q, h)
        return (S * strains(Q, h)).sum(axis=(2, 3)) / 4, np.einsum("nqjk,nqkx->nqjx", S, Q + h)

    def tangent(numbers: Reals, Q: Reals, h: Reals, positive: float, negative: float, simplices: bool) -> Reals:
        q, S = Q + h, stress(numbers, Q, h)
        S = positive * S if simplices else scaled_by_sign(S, positive, negative)
        A = 2 * np.einsum("nqikjl,nqkx,nqly->nqijxy", tensor(numbers), q, q, optimize=True)
        return A + np.einsum("nqij,xy->nqijxy", S, np.eye(3, dtype=S.dtype))

    return PointLaw(count, energy_and_pull, tangent)


def neo_hookean(lam: Reals, mu: Reals, M: Reals, sign: Reals | float = 1.0) -> tuple[Reals, Reals]:
    """Return the second Piola-Kirchhoff stress (..., 3, 3) and the energy density (...) for `M = F'F - 1` and the sign of `J`.

        S = mu C^-1 M + lam (J - 1) J C^-1        W = mu/2 (tr M - 2 ln J) + lam/2 (J - 1)^2        C = 1 + M

    There is no cancellation at small strain. The result is not a number where `J <= 0`.
    """
    I2, I3 = (np.trace(M, axis1=-2, axis2=-1) ** 2 - (M * M).sum(axis=(-2, -1))) / 2, np.linalg.det(M)
    x = np.trace(M, axis1=-2, axis2=-1) + I2 + I3  # J^2 - 1
    with np.errstate(invalid="ignore", divide="ignore"):
        J = np.where(np.asarray(sign) < 0, np.nan, np.sqrt(np.where(x > -1, 1 + x, np.nan)))
        small = (np.abs(x) < 0.25) & (np.abs(I2 + I3) < 0.25)
        z = np.where(small, x / (2 + x), 0.0)
        excess = x * z - 2 * sum(z ** (2 * n + 1) / (2 * n + 1) for n in range(1, 10))  # x - ln(1 + x)
        shape = np.where(small, excess - I2 - I3, np.trace(M, axis1=-2, axis2=-1) - 2 * np.log(J))
    inverse = np.linalg.inv(np.where(np.isnan(J)[..., None, None], np.eye(3), np.eye(3) + M))
    e = x / (1 + J)
    S = mu[..., None, None] * (inverse @ M) + (lam * e * J)[..., None, None] * inverse
    return S, mu / 2 * shape + lam / 2 * e * e


def neo_hookean_law(sheet: bool) -> PointLaw:
    """Return the law `s_j = sum_k S_jk q_k`, `A_mn = m d_mn I + a g_m g_n' + c g_n g_m'`.

    For sheets, A contains the further term `-across g_m . g_n N N'`.
    """

    def now(numbers: Reals, Q: Reals, h: Reals) -> tuple[Reals, Reals, Reals, Reals, Reals]:
        """Return `mu`, `lam`, `M`, the sign of `J`, and the deformed frame.

        The third axis of the frame of a flat element is undeformed; for sheets it is the normal.
        """
        (mu, lam, sign), M, q = np.moveaxis(numbers, -1, 0), strains(Q, h), Q + h
        q = np.where((mu > 0)[..., None, None], q, np.eye(3, dtype=q.dtype))
        normal = np.cross(q[..., 0, :], q[..., 1, :])
        if sheet:
            area, determinant = np.linalg.norm(normal, axis=-1), np.linalg.det(M[..., :2, :2])
            q[..., 2, :] = normal / area[..., None]
            M[..., 2, 2] = thickening(lam, np.where(mu > 0, mu, 1), area, M[..., 0, 0] + M[..., 1, 1] + determinant)
            return mu, lam, M, sign * normal[..., 2], q
        q[..., 2, 2] += (q[..., 2, :] == 0).all(axis=-1)
        return mu, lam, M, sign * np.linalg.det(q), q

    def energy_and_pull(numbers: Reals, Q: Reals, h: Reals) -> tuple[Reals, Reals]:
        mu, lam, M, sign, q = now(numbers, Q, h)
        S, W = neo_hookean(lam, mu, M, sign)
        return W, np.einsum("nqjk,nqkx->nqjx", S, q)

    def tangent(numbers: Reals, Q: Reals, h: Reals, positive: float, negative: float, simplices: bool) -> Reals:
        mu, lam, M, _, q = now(numbers, Q, h)
        g, N, k = np.swapaxes(np.linalg.inv(q), -1, -2), q[..., 2, :], 3
        J = j = np.abs(np.linalg.det(q))
        if sheet:
            g[..., 2, :], k, J = 0, 2, j * np.sqrt(1 + M[..., 2, 2])
            D = np.sqrt((lam * j) ** 2 + 4 * mu * (mu + lam * j * j))
            c, a = mu * (1 + M[..., 2, 2]), 2 * mu * lam * (1 + M[..., 2, 2]) * j * (2 * J - 1) / np.where(mu > 0, D, 1)
        else:
            c, a = mu - lam * (J - 1) * J, lam * J * (2 * J - 1)
        B, twists = products(g, g), np.cross(g[..., [1, 2, 0], :], g[..., [2, 0, 1], :])
        most = np.linalg.eigvalsh(B)[..., -1] if sheet else bound(B)
        twist = np.sqrt(np.linalg.eigvalsh(products(twists, twists))[..., -1] if sheet else bound(products(twists, twists)))
        m = np.maximum(mu, np.where(c > 0, c * twist, -c * most))
        values = np.maximum(a, -(m / most + c) / k), m, np.minimum(c, m / most)
        a, m, across = (one + (1 - negative) * (other - one) for one, other in zip((a, mu, c), values, strict=True))
        I, dyads = np.eye(3, dtype=g.dtype), np.einsum("nqix,nqjy->nqijxy", g, g)
        A = np.einsum("nq,ij,xy->nqijxy", m, I, I) + a[..., None, None, None, None] * dyads
        A += c[..., None, None, None, None] * np.swapaxes(dyads, -1, -2)
        if sheet:
            A -= np.einsum("nq,nqij,nqx,nqy->nqijxy", across, B, N, N)
        return np.where((mu > 0)[..., None, None, None, None], A, 0)

    return PointLaw(3, energy_and_pull, tangent)


def bound(B: Reals) -> Reals:
    """Return an upper bound of the largest eigenvalue of matrices (..., 3, 3): `tr/3 + sqrt(2/3) |dev|`."""
    mean = np.trace(B, axis1=-2, axis2=-1) / 3
    deviators = B - mean[..., None, None] * np.eye(3)
    return mean + np.sqrt(2 / 3 * (deviators**2).sum(axis=(-2, -1)))


def relaxed(numbers: Reals, M: Reals) -> tuple[Reals, Reals, Reals]:
    """Return `W` (n, q), S and `dS/dM` (n, q, 3, 3, 3, 3) of the relaxed energy for strains `M` within sheets.

    The function writes out the energies of the three cases of principal strains, and their derivatives.
    """
    (lam, mu), (m, V) = np.moveaxis(numbers, -1, 0), np.linalg.eigh(M[..., :2, :2])
    second, first = m[..., 0], m[..., 1]
    nu = lam / np.where(lam + mu > 0, lam + mu, 1)
    young = mu * (1 + nu)
    slack, zero = first <= 0, 0 * first
    taut = ~slack & (second >= -nu * first)
    p1 = np.where(slack, 0, np.where(taut, lam * (first + second) + mu * first, young * first))
    p2 = np.where(taut, lam * (first + second) + mu * second, 0)
    T = np.stack([np.where(taut, lam + mu, np.where(slack, 0, young)), taut * lam, taut * lam, taut * (lam + mu)], axis=-1)
    apart = np.where(first > second, first - second, 1)
    shear_factor = np.where(taut, mu, (p1 - p2) / apart)
    v = np.zeros((*V.shape[:2], 2, 3), V.dtype)
    v[..., :2] = np.swapaxes(V, -1, -2)[..., ::-1, :]  # rows are the first and the second axis
    own = np.einsum("nqai,nqaj->nqaij", v, v)
    S = np.einsum("nqa,nqaij->nqij", np.stack([p1, p2], axis=-1), own)
    C = np.einsum("nqab,nqaij,nqbkl->nqijkl", T.reshape(*T.shape[:2], 2, 2), own, own)
    shear = np.einsum("nqi,nqj->nqij", v[..., 0, :], v[..., 1, :])
    shear = shear + np.swapaxes(shear, -1, -2)
    C += np.einsum("nq,nqij,nqkl->nqijkl", shear_factor / 2, shear, shear)
    return np.where(slack, zero, p1 * first + p2 * second) / 4, S, C


def tension() -> PointLaw:
    """Return the law `s_j = sum_k S_jk q_k`, `A_mn = 2 sum_kl dS_mk/dM_nl q_k q_l' + S_mn I`, with S of `relaxed`.

    No principal stress is negative.
    """

    def energy_and_pull(numbers: Reals, Q: Reals, h: Reals) -> tuple[Reals, Reals]:
        W, S, _ = relaxed(numbers, strains(Q, h))
        return W, np.einsum("nqjk,nqkx->nqjx", S, Q + h)

    def tangent(numbers: Reals, Q: Reals, h: Reals, positive: float, negative: float, simplices: bool) -> Reals:
        q, (_, S, C) = Q + h, relaxed(numbers, strains(Q, h))
        A = 2 * np.einsum("nqikjl,nqkx,nqly->nqijxy", C, q, q, optimize=True)
        return A + positive * np.einsum("nqij,xy->nqijxy", S, np.eye(3, dtype=S.dtype))

    return PointLaw(2, energy_and_pull, tangent)


def linear(count: int, tensor: Callable[[Reals], Reals]) -> PointLaw:
    """Return the law `W = 1/4 S : M`, `M_ij = Q_i . h_j + h_i . Q_j`, `s_j = sum_k S_jk Q_k`, `A_mn = 2 sum_kl C_mknl Q_k Q_l'`.

    A has no term from tensions.
    """

    def energy_and_pull(numbers: Reals, Q: Reals, h: Reals) -> tuple[Reals, Reals]:
        M = symmetric(Q, h)
        S = np.einsum("nqijkl,nqkl->nqij", tensor(numbers), M)
        return (S * M).sum(axis=(2, 3)) / 4, np.einsum("nqjk,nqkx->nqjx", S, Q)

    def tangent(numbers: Reals, Q: Reals, h: Reals, positive: float, negative: float, simplices: bool) -> Reals:
        return np.asarray(2 * np.einsum("nqikjl,nqkx,nqly->nqijxy", tensor(numbers), Q, Q, optimize=True))

    return PointLaw(count, energy_and_pull, tangent)


def rotations_and_stretches(law: Any, Q: Reals, h: Reals) -> tuple[Reals, Reals, Reals]:
    """Return `U`, `V` and `s` (n, q, 3) of `F = U diag(s) V'` in the frame; the last singular value has the sign of `det F`.

    `V` is a rotation and `U` has the orientation of `Q`. Both are in the plane or on the line of flat elements that have no third
    dimension.
    """
    kind = 3 if law.flat is None else (1, 1, 2, 2)[law.flat.kind]
    signed = law.flat is None or law.flat.kind in (LINE, SHEET)
    U, s, V = np.linalg.svd(np.swapaxes(Q + h, 2, 3))
    V = np.swapaxes(V, 2, 3)
    if signed:
        mirrored = np.sign(np.linalg.det(V[..., :kind, :kind]))
        V[..., kind - 1] *= mirrored[..., None]
        U[..., kind - 1] *= mirrored[..., None]
        hand = np.sign(np.linalg.det(U[..., :kind, :kind]) * np.linalg.det(Q[..., :kind, :kind]))
        U[..., kind - 1] *= hand[..., None]
        s[..., kind - 1] *= hand
    return U, V, s


def stretches_are_there(law: Any) -> NDArray:
    """Return whether elements have a first, second and third stretch, (3,)."""
    return np.arange(3) < (3 if law.flat is None else (1, 1, 2, 2)[law.flat.kind])


def corotated_energy(law: Any, numbers: Reals, s: Reals) -> tuple[Reals, Reals, Reals]:
    """Return `w`, `p` (n, q, 3) and `H` (n, q, 3, 3) of `w = mu sum e_i^2 + lam/2 (sum e_i)^2`, `e = s - 1`."""
    there, lam, mu = stretches_are_there(law), 2 * numbers[..., 0], numbers[..., 1]
    e = (s - 1) * there
    trace = e.sum(axis=-1)
    p = (2 * mu[..., None] * e + (lam * trace)[..., None]) * there
    H = 2 * mu[..., None, None] * np.diag(there) + lam[..., None, None] * np.outer(there, there)
    return mu * (e**2).sum(axis=-1) + lam / 2 * trace**2, p, H


def invertible_energy(law: Any, numbers: Reals, s: Reals) -> tuple[Reals, Reals, Reals]:
    """Return `w` by its definition, its derivatives by complex steps, and the derivatives of its gradient by complex steps."""
    there, lam, mu = stretches_are_there(law), 2 * numbers[..., 0], numbers[..., 1]

    def value_and_slopes(s: Reals) -> tuple[Reals, Reals]:
        c = np.where(np.real(s) > law.threshold, s, law.threshold)
        d = (s - c) * there
        E = (c**2 - 1) / 2 * there
        trace = E.sum(axis=-1)
        w1 = c * ((lam * trace)[..., None] + 2 * mu[..., None] * E)
        pairs = lam[..., None, None] * c[..., :, None] * c[..., None, :] * (1 - np.eye(3))
        k = lam + 2 * mu
        w = lam / 2 * trace**2 + mu * (E**2).sum(axis=-1) + (w1 * d).sum(axis=-1)
        w = w + np.einsum("nqij,nqi,nqj->nq", pairs, d, d) / 2 + k / 2 * (d**2).sum(axis=-1)
        above = np.real(s) > law.threshold  # above, d is zero and c moves: sum_j w_ij d_j; below, c is constant and d moves
        p = w1 + np.einsum("nqij,nqj->nqi", pairs, d) + np.where(above, 0, k[..., None] * d)
        return w, p * there

    step, H, slopes = 1e-30, [], []
    for i in range(3):
        w, p = value_and_slopes(s + 1j * step * np.eye(3)[i])
        slopes.append(w.imag / step * there[i])
        H.append(p.imag / step * there[i])
    return value_and_slopes(s)[0], np.stack(slopes, axis=-1), np.stack(H, axis=-1)


def of_stretches(law: Any, energy: Callable[[Any, Reals, Reals], tuple[Reals, Reals, Reals]]) -> PointLaw:
    """Return the law of an energy `w(s)` of principal stretches: `P = U diag(p) V'`.

    dP = U T V', T_ii = sum_j H_ij D_jj, T_ij = f_ij (D_ij + D_ji)/2 + t_ij (D_ij - D_ji)/2, D = U' dF V
    """
    there = stretches_are_there(law)

    def energy_and_pull(numbers: Reals, Q: Reals, h: Reals) -> tuple[Reals, Reals]:
        U, V, s = rotations_and_stretches(law, Q, h)
        w, p, _ = energy(law, numbers, s)
        return w, np.einsum("nqxi,nqi,nqmi->nqmx", U, p, V)

    def tangent(numbers: Reals, Q: Reals, h: Reals, positive: float, negative: float, simplices: bool) -> Reals:
        U, V, s = rotations_and_stretches(law, Q, h)
        _, p, H = energy(law, numbers, s)
        i, j = np.triu_indices(3, 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = s[..., i] - s[..., j]
            f = np.where(there[j] & (apart != 0), (p[..., i] - p[..., j]) / apart, 0)  # lanes that fill a block: equal stretches
            both, least = s[..., i] + s[..., j], 64 * np.finfo(s.dtype).eps * (1 + np.abs(s[..., :1]))
            t = np.where(both > least, (p[..., i] + p[..., j]) / both, 0)
        if (positive, negative) != (1, 1):
            H, f = scaled_by_sign(H, 1, negative), np.where(f > 0, f, negative * f)
            t = np.where(t > 0, positive * t, negative * t)
        f = np.where(there[j], f, t)
        T = np.einsum("nqik,ij,kl->nqijkl", H, np.eye(3), np.eye(3))
        for a, b, flip, twist in zip(i, j, np.moveaxis(f, -1, 0), np.moveaxis(t, -1, 0), strict=True):
            for x, y in ((a, b), (b, a)):
                T[..., x, y, x, y] += (flip + twist) / 2
                T[..., x, y, y, x] += (flip - twist) / 2
        return np.einsum("nqxi,nqmj,nqijkl,nqyk,nqol->nqmoxy", U, V, T, U, V, optimize=True)

    return PointLaw(2, energy_and_pull, tangent)


#: The tensor C of St. Venant-Kirchhoff's two laws.
TENSORS: dict[type, Callable[[Reals], Reals]] = {IsotropicLaw: isotropic, GeneralLaw: general}
#: All laws but those of principal stretches.
LAWS: dict[type, PointLaw] = {
    IsotropicLaw: stvk(2, isotropic),
    GeneralLaw: stvk(21, general),
    NeoHookeanLaw: neo_hookean_law(sheet=False),
    NeoHookeanSheet: neo_hookean_law(sheet=True),
    TensionLaw: tension(),
    LinearIsotropicLaw: linear(2, isotropic),
    LinearGeneralLaw: linear(21, general),
}


#: Energies of principal stretches.
ENERGIES: dict[type, Any] = {CorotatedLaw: corotated_energy, InvertibleLaw: invertible_energy}


def point_law(law: Any) -> PointLaw:
    """Return the readable twin of a law of the kernels."""
    kind = type(law)
    return of_stretches(law, ENERGIES[kind]) if kind in ENERGIES else LAWS[kind]


def numbers_at_points(law: Any, n: int) -> Reals:
    """Return the numbers that a law stores at points in addition to `Ri`, (n, m)."""
    width = 6 + point_law(law).count
    return out_of_lanes(law.D, width, slice(None))[:n, 6:]


def stress_by_strain(law: Any, k: int, M: Reals, W: Reals, S: Reals) -> None:
    """Write energies and stresses by the closed form of the neo-Hookean law or by the three relaxed energies.

    For neo-Hookean sheets the strain across the sheet is included.
    """
    numbers, full = numbers_at_points(law, len(W)), M.copy()
    if type(law) is TensionLaw:
        w, s, _ = (x[:, 0] for x in relaxed(numbers[:, None], full[:, None]))
    else:
        mu, lam, _ = numbers.T
        if type(law) is NeoHookeanSheet:
            x = full[:, 0, 0] + full[:, 1, 1] + np.linalg.det(full[:, :2, :2])
            full[:, 2, 2] = thickening(lam, mu, np.sqrt(1 + x), x)
        s, w = neo_hookean(lam, mu, full)
    W[:], S[:] = w, s


def response_to_stretches(law: Any, flat: Any, Q: Reals, h: Reals, W: Reals, e: Reals, p: Reals, V: Reals) -> None:
    """Write the response with stretches from NumPy's singular values."""
    there = stretches_are_there(law._replace(flat=flat))
    _, axes, s = rotations_and_stretches(law._replace(flat=flat), Q[:, None], h[:, None])
    e[:], V[:] = (s[:, 0] - 1) * there, axes[:, 0]
    w, slopes, _ = ENERGIES[type(law)](law, numbers_at_points(law, len(W))[:, None], 1 + e[:, None])
    W[:], p[:] = w[:, 0], slopes[:, 0]


class Elements(NamedTuple):
    """Data of the elements of some blocks, as the kernels read them.

    `t` (n, a) are the nodes. `B` (n, q, a, 3) are derivatives of the shape functions by the axes of the table, which add up to
    zero. `Ri` is (n, q, 3, 3). `law` is the type of the law, and `numbers` (n, q, m) are its numbers times the weights of the
    points. `g` (n, q, a, 3) are derivatives by the axes of the frame. `modes` (k, a) are hourglass modes of boxes with one point,
    and `c` (n,) their coefficients.
    """

    t: Ids
    B: Reals
    Ri: Reals
    law: type
    numbers: Reals
    g: Reals
    modes: Reals
    c: Reals

    def differences(self, x: Reals) -> Reals:
        """Return the differences of `x` between the nodes and node 0, (n, a, 3), computed in double precision."""
        values = x.reshape(-1, 3)[self.t]
        return (values - values[:, :1]).astype(self.numbers.dtype)

    def in_frame(self, x: Reals) -> Reals:
        """Return the derivatives `x_j = sum_a g_aj x_a` of a field by the axes j of the frame, (n, q, 3, 3)."""
        return np.einsum("nqaj,nax->nqjx", self.g, self.differences(x))

    def hourglass_stiffness(self, X: Reals) -> Reals:
        """Return the stiffness of hourglass modes, (n, a, b): `W_h = 1/2 sum_ab H_ab u_a . u_b`.

        H_ab = 2 c sum_k gamma_ka gamma_kb        gamma_ka = h_ka - sum_j (sum_b h_kb X_b)_j g_aj
        """
        shape = np.einsum("kb,nbx->nkx", self.modes, self.differences(X))
        gamma = self.modes - np.einsum("nkx,nax->nka", shape, self.g[:, 0])
        return 2 * np.einsum("n,nka,nkb->nab", self.c, gamma, gamma)

    @property
    def C(self) -> Reals:
        """St. Venant-Kirchhoff's C times the weights of the points, (n, q, 3, 3, 3, 3)."""
        return TENSORS[self.law](self.numbers)

    def stress(self, M: Reals) -> Reals:
        """Return St. Venant-Kirchhoff's `S = C : M`, (n, q, 3, 3)."""
        return np.einsum("nqijkl,nqkl->nqij", self.C, M)

    def pull(self, S: Reals, q: Reals) -> Reals:
        """Return the forces `sum_q sum_j g_aj s_j` on the nodes, (n, a, 3), with `s_j = sum_k S_jk q_k`."""
        return self.spread(np.einsum("nqjk,nqkx->nqjx", S, q))

    def spread(self, s: Reals) -> Reals:
        """Return the forces `sum_q sum_j g_aj s_j` on the nodes, (n, a, 3)."""
        return np.einsum("nqaj,nqjx->nax", self.g, s)


def elements_of(part: slice, t: Ids, points: Any, law: Any) -> Elements:
    """Return the elements of a part of the blocks.

    Linear simplices have one point, and their derivatives are those of the barycentric coordinates. Boxes with mean gradients have
    derivatives of their own. A block of straight elements stores numbers for one point, which are valid at all points.
    """
    count = point_law(law).count
    D, size = law.D, (6 + count) * LANES
    if points is None:
        starts = size * np.arange(len(t) // (4 * LANES) + 1)
        points = Points(np.eye(3)[None], np.ones(1), starts)
    starts, nq = points.starts, len(points.weights)
    nodes = len(t) // (LANES * (len(starts) - 1))
    nodes_of = out_of_lanes(t, nodes, part)
    own = np.diff(starts) > size  # whether each point has its own numbers
    first = starts[:-1, None] + np.where(own[:, None], size * np.arange(nq), 0)
    stored = D[first[part, :, None] + np.arange(size)].reshape(-1, nq, 6 + count, LANES)
    stored = np.moveaxis(stored, 3, 1).reshape(-1, nq, 6 + count)
    Ri = np.zeros((*stored.shape[:2], 3, 3), D.dtype)
    Ri[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]] = stored[..., :6]
    numbers = stored[..., 6:] * points.weights.astype(D.dtype)[:, None]
    modes, c = np.zeros((0, nodes), D.dtype), np.zeros(len(nodes_of), D.dtype)
    if isinstance(points, MeanPoints):
        others = np.moveaxis(points.B[part], 3, 1).reshape(-1, 1, *points.B.shape[1:3])
        modes, c = with_first(points.modes[:, : nodes - 1], 1), points.hourglass_stiffness[part].ravel()
    else:
        others = np.broadcast_to(points.B, (len(nodes_of), *points.B.shape))
    B = with_first(others[:, :, : nodes - 1].astype(D.dtype), 2)
    return Elements(nodes_of, B, Ri, type(law), numbers, np.einsum("nqai,nqij->nqaj", B, Ri), modes, c)


def with_first(x: Reals, axis: int) -> Reals:
    """Return the values of all nodes, which add up to zero, from the values of the nodes 1, 2, ..."""
    return np.concatenate([-x.sum(axis=axis, keepdims=True), x], axis=axis)


def products(x: Reals, y: Reals) -> Reals:
    """Return `x_i . y_j`, (n, q, 3, 3)."""
    return np.einsum("nqix,nqjx->nqij", x, y)


def symmetric(x: Reals, y: Reals) -> Reals:
    """Return `x_i . y_j + y_i . x_j`, (n, q, 3, 3)."""
    return products(x, y) + products(y, x)


def deformed(elements: Elements, X: Reals, u: Reals) -> tuple[Reals, Reals, Reals]:
    """Return the deformed frame `q = F Q`, the strains `M = 2 E` and St. Venant-Kirchhoff's stresses `S`, each (n, q, 3, 3)."""
    Q, h = elements.in_frame(X), elements.in_frame(u)
    M = strains(Q, h)
    return Q + h, M, elements.stress(M)


def contracted(S: Reals, M: Reals) -> float:
    """Return `sum S : M`."""
    return float((S * M).sum())


def add_to_slots(values: Reals, slots: Ids, part: slice, f: Reals) -> None:
    """Add values (n, a, 3) at the nodes to their slots."""
    np.add.at(f.reshape(-1, 3), out_of_lanes(slots, values.shape[1], part), values)


def energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals
) -> float:
    """Return `W` of all points and add `F_a = sum_j g_aj s_j`, both with the contributions of hourglass modes."""
    part = slice(begin, end)
    elements = elements_of(part, t, points, law)
    W, s = point_law(law).energy_and_pull(elements.numbers, elements.in_frame(X), elements.in_frame(u))
    W_h, F_h = hourglass_forces(elements, X, elements.differences(u))
    if len(f):
        add_to_slots(elements.spread(s) + F_h, slots, part, f)
    return float(W.sum()) + W_h


def hourglass_forces(elements: Elements, X: Reals, u: Reals) -> tuple[float, Reals]:
    """Return the energy of hourglass modes of `u` (n, a, 3), and their forces."""
    forces = np.einsum("nab,nbx->nax", elements.hourglass_stiffness(X), u)
    return float((u * forces).sum() / 2), forces


def scaled_by_sign(S: Reals, positive: float, negative: float) -> Reals:
    """Return `S` with each eigenvalue multiplied by the factor for its sign."""
    values, axes = np.linalg.eigh(S)
    values = values * np.where(values > 0, positive, negative).astype(S.dtype)
    return np.einsum("nqie,nqe,nqje->nqij", axes, values, axes)


def linearize(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    to: Any,
    points: Points | None,
    law: Any,
    X: Reals,
    u: Reals,
    positive: float,
    negative: float,
    f: Reals,
) -> tuple[float, float]:
    """Add `K_ab = sum_ij g_ai g_bj A_ij + H_ab I`, summed over points, for pairs of nodes `a < b`."""
    part = slice(begin, end)
    elements = elements_of(part, t, points, law)
    frames = elements.in_frame(X), elements.in_frame(u)
    A = point_law(law).tangent(elements.numbers, *frames, positive, negative, points is None)
    K = np.einsum("nqai,nqbj,nqijxy->nabxy", elements.g, elements.g, A, optimize=True)
    K += np.einsum("nab,xy->nabxy", positive * elements.hourglass_stiffness(X), np.eye(3, dtype=A.dtype))
    pairs = EDGES if points is None else tuple(combinations(range(K.shape[1]), 2))
    return energy_and_force(begin, end, t, slots, points, law, X, u, f), add_pairs(to, begin, end, [K[:, a, b] for a, b in pairs])


def tensions(begin: int, end: int, t: Ids, edge_slots: Ids, marks: Ids, law: Any, X: Reals, u: Reals, out: Reals) -> None:
    """Add `t_ab = -sum_ij g_ai S_ij g_bj` of each linear simplex to the slot of its edge."""
    part = slice(begin, end)
    elements = elements_of(part, t, None, law)
    S = deformed(elements, X, u)[2]
    found = -np.einsum("nqai,nqij,nqbj->nab", elements.g, S, elements.g)
    out[marks[begin] : marks[end]] = 0
    slots = out_of_lanes(edge_slots, edge_slots.shape[1] // LANES, part)
    for (a, b), slot in zip(EDGES, slots.T, strict=False):
        np.add.at(out, slot, found[:, a, b])


def along(
    begin: int, end: int, t: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals
) -> tuple[float, float, float, float, float]:
    """Return the coefficients of `W(s) = 1/4 S(s) : M(s)`, `M_ij(s) = M_ij + s (q_i . H_j + H_i . q_j) + s^2 H_i . H_j`.

    The stresses are the same quadratic of s.
    """
    elements = elements_of(slice(begin, end), t, points, law)
    (q, M, _), H = deformed(elements, X, u), elements.in_frame(v)
    strains = M, symmetric(q, H), products(H, H)
    c = [0.0] * 5
    for m, stresses in enumerate(map(elements.stress, strains)):
        for n, strain in enumerate(strains):
            c[m + n] += contracted(stresses, strain) / 4
    x, y = elements.differences(u), elements.differences(v)
    for place, (one, other) in enumerate(((x, x), (2 * x, y), (y, y))):
        c[place] += float((one * hourglass_forces(elements, X, other)[1]).sum() / 2)
    return c[0], c[1], c[2], c[3], c[4]


def forces_between(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, v: Reals, rule: Any, f: Reals
) -> float:
    """Add the forces of a rule for all points at once, and return the sum of its numbers."""
    rules = {MeanStress: _mean_force, DiscreteGradient: _discrete_mean_force, StressOfRates: _damping_force}
    part = slice(begin, end)
    return rules[type(rule)](part, elements_of(part, t, points, law), X, u, v, slots, law, rule, f)


def _mean_force(
    part: slice, elements: Any, X: Reals, u: Reals, v: Reals, slots: Ids, law: Any, rule: MeanStress, f: Reals
) -> float:
    """Add the forces of the stresses `w0 S(u) + w1 S(u + v)` along `q_i + theta H_i`; return `1/4 dS : dM`.

    dM_ij = q_i . H_j + H_i . q_j + H_i . H_j
    """
    (q, _, S), H = deformed(elements, X, u), elements.in_frame(v)
    dM = symmetric(q, H) + products(H, H)
    dS, x, y = elements.stress(dM), elements.differences(u), elements.differences(v)
    forces = elements.pull((rule.w0 + rule.w1) * S + rule.w1 * dS, q + rule.theta * H)
    add_to_slots(forces + (rule.w0 + rule.w1) * hourglass_forces(elements, X, x + rule.theta * y)[1], slots, part, f)
    return contracted(dS, dM) / 4


def _discrete_mean_force(
    part: slice, elements: Any, X: Reals, u: Reals, v: Reals, slots: Ids, law: Any, rule: DiscreteGradient, f: Reals
) -> float:
    """Add the forces of `S = (w0 + w1) (S_m + a dM) + (w1 - w0) b dM` along `q_i + theta H_i`; `S_m` is S at the mean strain.

    a = (W1 - W0 - 1/2 S_m : dM)/(1/2 dM : dM)        b = max(0, 1/4 dS : dM)/(1/2 dM : dM)
    """
    Q, h, H = elements.in_frame(X), elements.in_frame(u), elements.in_frame(v)
    there = (np.abs(Q).sum(axis=-1) > 0).astype(Q.dtype)  # (n, q, 3) the axes that exist
    hands = [np.ones(there.shape[:2], Q.dtype)] * 3
    if rule.oriented:
        last = np.eye(3, dtype=Q.dtype) * (1 - there)[..., None]
        hands = [np.where(np.linalg.det(x + last) < 0, -1, 1).astype(Q.dtype) for x in (Q, Q + h, Q + h + H)]

    def response_to_strain(M: Reals, hand: Reals) -> tuple[Reals, Reals]:
        """Return W and S for strains M.

        All laws but the relaxed one use Cholesky's factor of `1 + M` as a frame, triangular and with the orientation `hand`. The
        relaxed law depends only on strains.
        """
        if type(law) is TensionLaw:
            return relaxed(elements.numbers, M)[:2]
        deformed, resting = (np.stack([np.ones_like(x), x, np.ones_like(x)], axis=-1) for x in (hand, hands[0]))
        q = np.linalg.cholesky(np.eye(3, dtype=M.dtype) + M)
        rest, now = there[..., None] * np.eye(3, dtype=M.dtype) * resting[..., None], there[..., None] * q * deformed[..., None, :]
        W, s = LAWS[type(law)].energy_and_pull(elements.numbers, rest, now - rest)
        return W, np.einsum("nqjx,nqxk->nqjk", s * deformed[..., None, :], np.linalg.inv(q))

    M, dM = strains(Q, h), symmetric(Q + h, H) + products(H, H)
    (W0, S0), (W1, S1), (_, S) = (
        response_to_strain(M, hands[1]),
        response_to_strain(M + dM, hands[2]),
        response_to_strain(M + dM / 2, hands[1]),
    )
    change, work, more = ((x * dM).sum(axis=(2, 3)) for x in (dM / 2, S / 2, (S1 - S0) / 4))
    more = np.maximum(more, 0)
    a = ((rule.w0 + rule.w1) * (W1 - W0 - work) + (rule.w1 - rule.w0) * more) / np.where(change > 0, change, 1)
    x, y = elements.differences(u), elements.differences(v)
    forces = elements.pull((rule.w0 + rule.w1) * S + a[..., None, None] * dM, Q + h + rule.theta * H)
    add_to_slots(forces + (rule.w0 + rule.w1) * hourglass_forces(elements, X, x + rule.theta * y)[1], slots, part, f)
    return float(more.sum())


def _damping_force(
    part: slice, elements: Any, X: Reals, u: Reals, v: Reals, slots: Ids, law: Any, rule: StressOfRates, f: Reals
) -> float:
    """Add the forces of `S' = C : M'` along `q_i`, with `M'_ij = q_i . H_j + H_i . q_j`; return `1/4 S' : M'`."""
    q, H = deformed(elements, X, u)[0], elements.in_frame(v)
    rates = symmetric(q, H)
    stresses = elements.stress(rates)
    add_to_slots(elements.pull(stresses, q), slots, part, f)
    return contracted(stresses, rates) / 4


def round_off(begin: int, end: int, t: Ids, slots: Ids, points: Points | None, law: Any, X: Reals, u: Reals, f: Reals) -> None:
    """Add bounds of round-off `f_a = sum_jk |g_aj| (S_jk (|q_k| + e_k) + dS_jk |q_k|)`, and `f_0 = sum_a f_a`.

    Here `e = E + d` are the sizes of the summands of `q`.

        |g_aj| = sum_i |dN_a/dxi_i| |Ri_ij|        E_j = sum_a |g_aj| |X_a - X_0|        d_j = sum_a |g_aj| (|u_a| + |u_0|)
        dM_ij = |q_i| . d_j + d_i . |Q_j| + e_i . |h_j| + |h_i| . E_j for i <= j        S = |C| : |M|, dS = |C| : dM

    Hourglass modes add `(|h_ka| + sum_j |g_aj| |(h_k'X)_j|) s_k`.

        s_k = 2 c (sum_b |h_kb| (|u_b| + |u_0|) + sum_j |(h_k'X)_j| d_j)
    """
    part = slice(begin, end)
    elements = elements_of(part, t, points, law)
    (q, M, _), Q, h = deformed(elements, X, u), elements.in_frame(X), elements.in_frame(u)
    q, Q, h = np.abs(q), np.abs(Q), np.abs(h)
    g = np.einsum("nqai,nqij->nqaj", np.abs(elements.B[:, :, 1:]), np.abs(elements.Ri))
    ends = np.abs(u).reshape(-1, 3)[elements.t].astype(g.dtype)
    E = np.einsum("nqaj,nax->nqjx", g, np.abs(elements.differences(X))[:, 1:])
    d = np.einsum("nqaj,nax->nqjx", g, ends[:, 1:] + ends[:, :1])
    dM = products(q, d) + products(d, Q) + products(E + d, h) + products(h, E)
    dM = np.triu(dM) + np.triu(dM, 1).swapaxes(2, 3)
    C = TENSORS[type(law)](np.abs(elements.numbers))
    S, dS = (np.einsum("nqijkl,nqkl->nqij", C, x) for x in (np.abs(M), dM))
    pulled = np.einsum("nqjk,nqkx->nqjx", S, q + E + d) + np.einsum("nqjk,nqkx->nqjx", dS, q)
    forces = np.einsum("nqaj,nqjx->nax", g, pulled)
    modes, shape = np.abs(elements.modes)[:, 1:], np.abs(np.einsum("kb,nbj->nkj", elements.modes, elements.differences(X)))
    s = np.einsum("kb,nbx->nkx", modes, ends[:, 1:] + ends[:, :1]) + np.einsum("nkj,njx->nkx", shape, d[:, 0])
    s *= (2 * elements.c)[:, None, None]
    forces += np.einsum("ka,nkx->nax", modes, s) + np.einsum("naj,nkj,nkx->nax", g[:, 0], shape, s)
    add_to_slots(np.concatenate([forces.sum(axis=1, keepdims=True), forces], axis=1), slots, part, f)


def derivatives(t: Ids, points: Points | None) -> Reals:
    """Return the derivatives at the nodes 1, 2, ... of elements, (nq, n - 1, 3).

    For linear simplices these nodes are the ends of the base vectors.
    """
    return np.eye(3)[None] if points is None else points.B[:, : len(t) // LANES // (len(points.starts) - 1) - 1]


def base_vectors_at(x: Reals, part: slice, t: Ids, points: Points | None) -> Reals:
    """Return the base vectors of each element at each point as rows, (n, nq, 3, 3)."""
    B = derivatives(t, points)
    at = x.reshape(-1, 3)[out_of_lanes(t, B.shape[1] + 1, part)]
    return np.einsum("qai,nax->nqix", B, at[:, 1:] - at[:, :1])


def numbers(D: Reals, part: slice, points: Points | None, count: int) -> Reals:
    """Return the numbers of each element at each point, (n, nq, count)."""
    if points is None:
        return out_of_lanes(D, count, part)[:, None]
    sets = [D[i:j].reshape(-1, count, LANES) for i, j in zip(points.starts[part], points.starts[1:][part], strict=False)]
    everywhere = [np.broadcast_to(one, (len(points.weights), count, LANES)) for one in sets]
    return np.moveaxis(np.array(everywhere).reshape(-1, len(points.weights), count, LANES), 3, 1).reshape(
        -1, len(points.weights), count
    )


def volume_ratios(begin: int, end: int, t: Ids, points: Points | None, X: Reals, u: Reals, k: int, d: int, out: Reals) -> float:
    """Write `det(p_1 ... p_k) / det(P_1 ... P_k)`, the smallest over the points, and return the smallest of all.

    If base vectors have more than `k` components, the ratio is the root of the ratio of Gram determinants.
    """
    P, U = (base_vectors_at(x, slice(begin, end), t, points)[:, :, :k, :d] for x in (X, u))
    if k == d:
        ratios = np.linalg.det(P + U) / np.linalg.det(P)
    else:
        now, rest = (np.linalg.det(x @ np.swapaxes(x, 2, 3)) for x in (P + U, P))
        ratios = np.sqrt(np.maximum(now, 0) / rest)
    if len(out):
        out[begin * LANES : end * LANES] = ratios.min(axis=1)
    return float(ratios.min(initial=np.inf))


def smallest_stretches(begin: int, end: int, t: Ids, points: Points | None, X: Reals, u: Reals, k: int, out: Reals) -> float:
    """Write the smallest singular value of `F Q = Q + U R^-1` over the points, with `P = Q R`, and return the smallest of all.

    P and U have base vectors as columns, so that F is restricted to the element's own dimensions.
    """
    P, U = (np.swapaxes(base_vectors_at(x, slice(begin, end), t, points)[:, :, :k], 2, 3) for x in (X, u))
    Q, R = np.linalg.qr(P)
    stretches = np.linalg.svd(Q + U @ np.linalg.inv(R), compute_uv=False)[..., -1]
    if len(out):
        out[begin * LANES : end * LANES] = stretches.min(axis=1)
    return float(stretches.min(initial=np.inf))


def step_limit(begin: int, end: int, t: Ids, points: Points | None, X: Reals, u: Reals, v: Reals, k: int) -> float:
    """Return the smallest positive root of the cubics `det(p + s V)` of matrices of order `k`, from their values at four points."""
    P, U, V = (base_vectors_at(x, slice(begin, end), t, points)[:, :, :k, :k].reshape(-1, k, k) for x in (X, u, v))
    least, points_on_line = np.inf, np.array([0.0, 1.0, -1.0, 2.0])
    for rest, p, q in zip(P, P + U, V, strict=True):
        if not q.any() or np.linalg.det(p) * np.linalg.det(rest) <= 0:
            continue
        scale = np.abs(p).max() / np.abs(q).max()
        c = np.linalg.solve(np.vander(points_on_line, increasing=True), [np.linalg.det(p + s * scale * q) for s in points_on_line])
        c[np.abs(c) < 1e-13 * np.abs(c).max()] = 0
        roots = np.roots(c[::-1])
        real = roots.real[(np.abs(roots.imag) <= 1e-7 * np.abs(roots)) & (roots.real > 0)]
        least = min(least, scale * real.min(initial=np.inf))
    return least


def volume_energies(kind: int, J: Reals) -> tuple[Reals, Reals, Reals]:
    """Return `psi, psi', psi''` of `J` for a stiffness of 1."""
    if kind == QUADRATIC:
        return (J - 1) ** 2 / 2, J - 1, np.ones_like(J)
    J = np.minimum(J, 1)
    if kind == COMPRESSION:
        return (1 - J) ** 3 / 3, -((1 - J) ** 2), 2 * (1 - J)
    J = np.where(J > 0, J, 1)
    log = np.log(J)
    slope = 2 * (1 - J) * log - (J - 1) ** 2 / J
    return -((J - 1) ** 2) * log, slope, -2 * log + 4 * (1 - J) / J + ((J - 1) / J) ** 2


def volumes_of(
    part: slice, t: Ids, points: Points | None, D: Reals, X: Reals, u: Reals, k: int, kind: int
) -> tuple[Reals, Reals, Reals, tuple[Reals, Reals, Reals], float]:
    """Return deformed base vectors `p`, `dJ/dp_i`, both (n, nq, k, k), `k V0`, the energies, and the smallest `J` of the barrier.

    dJ/dp = J p^-T = cof(p)/C0
    """
    stored = numbers(D, part, points, 2)
    weights = np.ones(1) if points is None else points.weights
    p = (base_vectors_at(X, part, t, points) + base_vectors_at(u, part, t, points))[:, :, :k, :k]
    cofactors = np.empty_like(p)
    for i in range(k):
        for j in range(k):
            minor = np.delete(np.delete(p, i, axis=2), j, axis=3)
            cofactors[:, :, i, j] = (-1) ** (i + j) * np.linalg.det(minor)
    J = np.linalg.det(p) * stored[:, :, 1]
    real = stored[:, :, 0] > 0
    least = float(J[real].min(initial=1.0)) if kind == BARRIER else 1.0
    energies = volume_energies(kind, np.where(real, J, 1))
    return p, cofactors * stored[:, :, 1, None, None], stored[:, :, 0] * weights, energies, least


def penalty_energy_and_force(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, D: Reals, X: Reals, u: Reals, k: int, kind: int, f: Reals
) -> tuple[float, float]:
    """Return `W = k V0 psi(J)`; add `F_a = sum of dN_a/dxi_i f_i`, `F_0 = -sum_a F_a`, with `f_i = k V0 psi' dJ/dp_i`."""
    part = slice(begin, end)
    _, n, stiffness, (psi, slope, _), least = volumes_of(part, t, points, D, X, u, k, kind)
    if len(f):
        B = derivatives(t, points)[:, :, :k]
        forces = np.einsum("qai,nq,nqix->nax", B, stiffness * slope, n)
        to = out_of_lanes(slots, B.shape[1] + 1, part)
        np.add.at(f.reshape(-1, 3)[:, :k], to[:, 1:], forces)
        np.subtract.at(f.reshape(-1, 3)[:, :k], to[:, 0], forces.sum(axis=1))
    return float((stiffness * psi).sum()), least


def penalty_linearize(
    begin: int,
    end: int,
    t: Ids,
    slots: Ids,
    to: Any,
    points: Points | None,
    D: Reals,
    X: Reals,
    u: Reals,
    k: int,
    kind: int,
    slope_factor: float,
    f: Reals,
) -> tuple[float, float, float]:
    """Add `K_ij = k V0 (psi'' dJ/dp_i dJ/dp_j' + slope_factor psi' d2J/dp_i dp_j)`, spread from base vectors to nodes.

        K_0b = -sum_a K_ab        d2J/dp_ix dp_jy = sum_mz eps_ijm eps_xyz p_mz / C0

    In one and two dimensions, the axes across replace the missing base vectors.
    """
    part = slice(begin, end)
    p, n, stiffness, (_, slope, curvature), least = volumes_of(part, t, points, D, X, u, k, kind)
    e = np.zeros((3, 3, 3))
    e[[0, 1, 2], [1, 2, 0], [2, 0, 1]], e[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = 1, -1
    q = np.broadcast_to(np.eye(3), (*p.shape[:2], 3, 3)).copy()
    q[:, :, :k, :k] = p
    second = np.einsum("ijm,xyz,npmz->npijxy", e, e, q)[:, :, :k, :k, :k, :k]
    second = second * numbers(D, part, points, 2)[:, :, 1, None, None, None, None]
    between_vectors = np.einsum("np,npix,npjy->npijxy", stiffness * curvature, n, n)
    between_vectors += slope_factor * np.einsum("np,npijxy->npijxy", stiffness * slope, second)
    B = derivatives(t, points)[:, :, :k]
    K = np.zeros((len(p), B.shape[1] + 1, B.shape[1] + 1, 3, 3))
    K[:, 1:, 1:, :k, :k] = np.einsum("pai,pbj,npijxy->nabxy", B, B, between_vectors)
    K[:, 0, 1:] = -K[:, 1:, 1:].sum(axis=1)
    pairs = EDGES if points is None else tuple(combinations(range(K.shape[1]), 2))
    W, _ = penalty_energy_and_force(begin, end, t, slots, points, D, X, u, k, kind, f)
    return W, least, add_pairs(to, begin, end, [K[:, a, b] for a, b in pairs])


def penalty_round_off(
    begin: int, end: int, t: Ids, slots: Ids, points: Points | None, D: Reals, X: Reals, u: Reals, k: int, kind: int, f: Reals
) -> float:
    """Add `f_i = k V0 (psi'' |e| + |psi'|) |dJ/dp_i|`, with permanents in place of determinants.

    `|e|` contains `B_i = |u_i| + |u_0|` in place of `U_i`. At points, base vectors are sums. Then the change of `dJ/dp_i` by the
    rounding of these sums is the factor of `psi'`.
    """
    part, B = slice(begin, end), np.abs(derivatives(t, points))
    _, _, stiffness, (_, slope, curvature), least = volumes_of(part, t, points, D, X, u, k, kind)
    rest, now = (x.reshape(-1, 3)[out_of_lanes(t, B.shape[1] + 1, part)] for x in (X, u))
    ends, P, U = np.abs(now[:, 1:]) + np.abs(now[:, :1]), rest[:, 1:] - rest[:, :1], now[:, 1:] - now[:, :1]
    rest, now = (np.einsum("qai,nax->nqix", derivatives(t, points), x)[:, :, :k, :k].reshape(-1, k, k) for x in (P, P + U))
    of_x, E = (np.einsum("qai,nax->nqix", B, x)[:, :, :k, :k].reshape(-1, k, k) for x in (np.abs(P), ends))
    P, p = np.abs(rest), np.abs(now)
    scale = np.abs(numbers(D, part, points, 2)[:, :, 1])
    e = sum(_permanent([P[:, j] if j < i else E[:, j] if j == i else p[:, j] for j in range(k)]) for i in range(k))
    of_e, of_n = stiffness * scale**2 * curvature * np.reshape(e, scale.shape), stiffness * scale * np.abs(slope)
    minors, changed = np.ones((2, len(p), k, k))
    for i in range(k):
        others = [j for j in range(k) if j != i]
        for x in range(k):
            rows, errors = (np.delete(a, x, axis=2) for a in (p, of_x + E))
            minors[:, i, x] = _permanent([rows[:, j] for j in others])
            changed[:, i, x] = sum(_permanent([errors[:, j] if j == m else rows[:, j] for j in others]) for m in others)
    changed = minors if points is None else changed
    forces = sum(np.einsum("nq,nqix->nqix", a, b.reshape(*scale.shape, k, k)) for a, b in ((of_e, minors), (of_n, changed)))
    forces = np.einsum("qai,nqix->nax", B[:, :, :k], forces)
    to, at = f.reshape(-1, 3)[:, :k], out_of_lanes(slots, B.shape[1] + 1, part)
    np.add.at(to, at[:, 1:], forces)
    np.add.at(to, at[:, 0], forces.sum(axis=1))
    return least


def _permanent(rows: list[Reals]) -> Reals | float:
    """Return the permanents of matrices, (n,): determinants with plus in place of minus; `rows` are their rows (n, k)."""
    if not rows:
        return 1.0
    total: Reals = np.zeros(len(rows[0]))
    for x in range(len(rows)):
        total = total + rows[0][:, x] * _permanent([np.delete(row, x, axis=1) for row in rows[1:]])
    return total


def add_pairs(to: Any, begin: int, end: int, pairs: list[Reals]) -> float:
    """Add the blocks (n, 3, 3) of each of the `pairs` of elements to the slots of the pairs; return the trace.

    With `RowSlots`, the blocks are added block of lanes by block of lanes to the slots of unfinished rows. Rows that are then
    complete are written, and the trace is that of these rows. Segments and triangles have slots only for the first pairs of a
    tetrahedron.
    """
    slots = out_of_lanes(to.slots, to.slots.shape[1] // LANES, slice(begin, end)).T
    transposed, slots = (slots & TRANSPOSED) > 0, slots & ~TRANSPOSED
    values = np.stack([np.where(of[:, None, None], K.swapaxes(1, 2), K) for of, K in zip(transposed, pairs, strict=False)])
    if isinstance(to, PairSlots):
        to.blocks[9 * to.marks[begin] : 9 * to.marks[end]] = 0
        np.add.at(to.blocks.reshape(-1, 3, 3), slots, values)
        return 0.0
    trace = 0.0
    for block in range(begin, end):
        fresh = to.fresh[to.marks[block] : to.marks[block + 1]]
        to.first_eight.reshape(-1, 8)[fresh], to.ninth[fresh] = 0, 0
        lanes = slice((block - begin) * LANES, (block - begin + 1) * LANES)
        nine = values[:, lanes].reshape(-1, LANES, 9)
        np.add.at(to.first_eight.reshape(-1, 8), slots[:, lanes], nine[..., :8])
        np.add.at(to.ninth, slots[:, lanes], nine[..., 8])
        trace += finish_rows(int(to.done[block]), int(to.done[block + 1]), to)
    return trace


def finish_rows(begin: int, end: int, to: RowSlots) -> float:
    """Write transposes of lower neighbours, minus the sum of all, and upper neighbours to their columns; return the trace."""
    blocks = np.column_stack([to.first_eight.reshape(-1, 8), to.ninth]).reshape(-1, 3, 3)
    trace = 0.0
    for row in range(begin, end):
        entries = range(int(to.begin[row]), int(to.begin[row + 1]))
        K = {i: blocks[to.entries[i]].T if i < to.own[row] else blocks[to.entries[i]] for i in entries if i != to.own[row]}
        K[int(to.own[row])] = -sum(K.values(), np.zeros((3, 3)))
        trace += np.trace(K[int(to.own[row])])
        for i, block in K.items():
            for r in range(to.d):
                place = to.first[row] + r * to.strides[row] + to.columns[i]
                to.data[place : place + to.d] = block[r, : to.d] + (to.data[place : place + to.d] if to.add else 0)
    return trace


def fold_slots(begin: int, end: int, starts: Ids, sources: Ids, to: RowSlots) -> None:
    """Add each slot of other parts to its target slot."""
    for slot in range(begin, end):
        of = sources[starts[slot] : starts[slot + 1]]
        to.first_eight.reshape(-1, 8)[slot] += to.first_eight.reshape(-1, 8)[of].sum(axis=0)
        to.ninth[slot] += to.ninth[of].sum()


def gather(x: Reals, order: Ids, out: Reals) -> None:
    """Write `x` (n, d) of the mesh in the kernels' order, with three components."""
    out.reshape(-1, 3)[: len(order), : x.shape[1]] = x[order]


def take(begin: int, end: int, indices: Ids, values: Reals, out: Reals) -> None:
    """Write `out[i] = values[indices[i]]`."""
    out[begin:end] = values[indices[begin:end]]


def total(x: Reals) -> float:
    """Return `sum_i x_i`."""
    return float(x.sum())


def add_scaled(begin: int, end: int, factor: float, blocks: Reals, out: Reals) -> None:
    """Compute `out += factor blocks`."""
    out[begin:end] += factor * blocks[begin:end]


def fold(values: Reals, size: int, targets: Ids, width: int) -> None:
    """Add the slots after the first `size` to their targets."""
    slots = values.reshape(-1, width)
    np.add.at(slots[:size], targets, slots[size : size + len(targets)])


def add_scattered(x: Reals, order: Ids, out: Reals) -> None:
    """Add `x`, in the kernels' order, to `out` (n, d) of the mesh."""
    np.add.at(out, order, x.reshape(-1, 3)[: len(order), : out.shape[1]])


def fill_rows(
    begin: int,
    end: int,
    rows: Ids,
    entries: Ids,
    indices: Ids,
    strides: Ids,
    blocks: Reals,
    axes: tuple[int, ...],
    add: bool,
    data: Reals,
) -> float:
    """Write `K_ab` of the edges, `K_ba = K_ab'` and `K_aa = -sum_b K_ab` to the indices of their values; return the trace."""
    trace, edges = 0.0, blocks.reshape(-1, 3, 3)
    for vertex in range(begin, end):
        star = slice(rows[vertex], rows[vertex + 1])
        where = dict(zip(entries[star].tolist(), indices[star].tolist(), strict=True))
        here = where.pop(OWN)
        K = {place: edges[entry] if entry >= 0 else edges[-1 - entry].T for entry, place in where.items()}
        K[here] = own = -sum(K.values(), np.zeros((3, 3)))
        for place, block in K.items():
            for r in axes:
                to = slice(place + r * strides[vertex], place + r * strides[vertex] + len(axes))
                data[to] = block[r, : len(axes)] + (data[to] if add else 0)
        trace += np.trace(own)
    return trace


def reduce_negative_tensions(begin: int, end: int, tensions: Reals, less: float, blocks: Reals) -> None:
    """Compute `K_ab + less min(t_ab, 0) I`."""
    blocks.reshape(-1, 3, 3)[begin:end] += less * np.minimum(tensions[begin:end, None, None], 0) * np.eye(3)


def add_diagonal(edges: Ids, order: Ids, blocks: Reals, out: Reals) -> None:
    """Add `K_aa = -sum_b K_ab` to `out` (n, d, d) of the mesh, and `-sum_a K_ab'` at the other end."""
    d, K = out.shape[1], blocks.reshape(-1, 3, 3)[: len(edges)]
    np.subtract.at(out, order[edges[:, 0]], K[:, :d, :d])
    np.subtract.at(out, order[edges[:, 1]], np.swapaxes(K, 1, 2)[:, :d, :d])


def add_norms(edges: Ids, order: Ids, blocks: Reals, d: int, x: Reals, out: Reals) -> None:
    """Add `|K_ab| x_b` to `out` (n,) of the mesh, and `|K_ab| x_a` at the other end."""
    K = blocks.reshape(-1, 3, 3)[: len(edges), :d, :d].astype(np.float64)
    (a, b), norms = order[edges].T, np.linalg.norm(K, axis=(1, 2))
    np.add.at(out, a, norms * x[b])
    np.add.at(out, b, norms * x[a])


def multiply(begin: int, end: int, edges: Ids, slots: Ids, blocks: Reals, v: Reals, out: Reals) -> None:
    """Add `(K v)_a = sum_b K_ab (v_b - v_a)`, and `K_ab' (v_a - v_b)` at the other end."""
    (a, b), slots = edges[begin:end].T, slots[begin:end]
    K, x, to = blocks.reshape(-1, 3, 3)[begin:end], v.reshape(-1, 3), out.reshape(-1, 3)
    np.add.at(to, slots[:, 0], np.einsum("exy,ey->ex", K, x[b] - x[a]))
    np.add.at(to, slots[:, 1], np.einsum("eyx,ey->ex", K, x[a] - x[b]))


def lexicographic_order(rows: Ids, n: int) -> Ids:
    """Return the order of the columns of `rows` (m, items), first row first, (items,); the order of equal columns is unchanged."""
    return np.lexsort(rows[::-1]).astype(np.int32)


def edges_of_simplices(t: Ids, local: Ids, n: int) -> tuple[Ids, Ids]:
    """Return edges (2, ne), `a < b` in lexicographic order, and the edges of the simplices, (m, nt)."""
    ends = np.sort(t[local.T], axis=0).reshape(2, -1)  # all edges of the first local pair, then of the second, ...
    edges, number = np.unique(ends, axis=1, return_inverse=True)
    return edges.astype(np.int32), number.reshape(len(local), -1).astype(np.int32)


def numbers_by_first_use(blocks: Ids, count: int) -> tuple[Ids, Ids]:
    """Return new numbers of the ids in `blocks` (n, m) by their first use, (count,), and numbers of ids used so far, (n + 1,).

    Entry i of the second array is the number of ids that the blocks 0 ... i - 1 use.
    """
    ids, first = np.unique(blocks.ravel(), return_index=True)
    number = np.full(count, -1)
    number[ids[np.argsort(first)]] = np.arange(len(ids))
    marks = np.searchsorted(np.sort(first), blocks.shape[1] * np.arange(len(blocks) + 1))
    return number.astype(np.int32), marks.astype(np.int64)


def stars(edges: Ids, n: int) -> tuple[Ids, Ids, Ids]:
    """Return `begin`, `others` and `entries`: rows of a matrix with `e` at `(a, b)`, `-1 - e` at `(b, a)` and OWN at `(a, a)`."""
    (a, b), e, own = edges, np.arange(edges.shape[1]), np.arange(n)
    row, others = np.concatenate([a, b, own]), np.concatenate([b, a, own])
    entries = np.concatenate([e, -1 - e, np.full(n, OWN)])
    order = np.lexsort([others, row])
    begin = np.searchsorted(row[order], np.arange(n + 1))
    return begin.astype(np.int64), others[order].astype(np.int32), entries[order].astype(np.int32)


def last_uses(t: Ids, parts: Ids, n: int) -> tuple[Ids, Ids]:
    """Return the only part that has each node, or the number of parts, and the last row of `t` with the node."""
    part = np.repeat(np.arange(len(parts) - 1), np.diff(parts))
    uses = [np.flatnonzero((t == node).any(axis=1)) for node in range(n)]
    of = [set(part[rows].tolist()) for rows in uses]
    return np.array([found.pop() if len(found) == 1 else len(parts) - 1 for found in of]), np.array([rows[-1] for rows in uses])


def assign_slots(
    t2e: Ids, pairs: Ids, parts: Ids, row_of: Ids, done: Ids, begin: Ids, pair_of: Ids
) -> tuple[Ids, Ids, Ids, Ids, Ids, int]:
    """Assign a slot to each pair in each part that has the pair; no other pair ever uses the slot."""
    lasting = (row_of[pairs] >= done[-1]).any(axis=1)
    number: dict[tuple[int, int], int] = {}  # (part, pair) in the order of first use
    uses, marks = [], [0]
    for part in range(len(parts) - 1):
        for block in t2e[parts[part] : parts[part + 1]]:
            uses.append([number.setdefault((part, int(e)), len(number)) for e in block])
            marks.append(len(number))
    of = np.array([e for _, e in number])
    _, first = np.unique(of, return_index=True)
    is_first = np.isin(np.arange(len(of)), first)
    order = np.argsort(np.where(lasting[of], np.where(is_first, 0, 1), 2), kind="stable")
    slot = np.empty(len(of), np.int64)
    slot[order] = np.arange(len(of))
    extra = order[np.count_nonzero(lasting[of] & is_first) : np.count_nonzero(lasting[of])]
    slot_of = slot[first]
    return slot[np.array(uses)].astype(np.uint32), slot, np.array(marks), slot_of, slot_of[of[extra]], len(of)


def expand(begin: Ids, columns: Ids, d: int) -> tuple[Ids, Ids]:
    """Return `indptr` and `indices` of scipy's CSR format; each row of blocks becomes `d` rows with `d` columns per block."""
    blocks = np.split(d * columns[:, None] + np.arange(d), begin[1:-1])
    rows = [block.ravel() for block in blocks for _ in range(d)]
    indptr = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
    return indptr.astype(np.int32), np.concatenate(rows).astype(np.int32)


def block_indices(begin: Ids, columns: Ids, d: int, a: Ids, b: Ids) -> Ids:
    """Return the index in the CSR values of the first value of each block `(a, b)`, (n,), or -1 for a missing block."""
    row = np.repeat(np.arange(len(begin) - 1), np.diff(begin))
    first = d * d * begin[row] + d * (np.arange(len(columns)) - begin[row])
    known = dict(zip(zip(row.tolist(), columns.tolist(), strict=True), first.tolist(), strict=True))
    return np.array([known.get(pair, -1) for pair in zip(a.tolist(), b.tolist(), strict=True)], dtype=np.int64)


def pieces_of_simplices(t: Ids, n: int) -> Ids:
    m, nt = t.shape
    facets = np.concatenate([np.sort(np.delete(t, i, axis=0), axis=0) for i in range(m)], axis=1)
    ids = np.unique(facets, axis=1, return_inverse=True)[1].reshape(m, nt) + nt
    links = csr_matrix((np.ones(m * nt), (np.tile(np.arange(nt), m), ids.ravel())), shape=(ids.max() + 1,) * 2)
    return connected_components(links, directed=False)[1][:nt]


def measures(p: Reals, t: Ids) -> Reals:
    """Return `k!` times the volume, the longest edge, and `(k - 1)!` times the measure of the largest facet, (3, nt).

    The measure of a point is 1.
    """
    n = range(len(t))
    edges = [_measure(p, t[[a, b]]) for a in n for b in n if a < b]
    facets = [_measure(p, np.delete(t, a, axis=0)) for a in n]
    return np.stack([_measure(p, t), np.max(edges, axis=0), np.max(facets, axis=0)])


def frames(p: Reals, t: Ids) -> Reals:
    """Return `Ri` and `k!` times the size, (7, nt), by Householder's QR of the base vectors."""
    x = np.concatenate([p, np.zeros((3 - len(p), p.shape[1]))]).T[t.T]
    return frames_of_base_vectors(x[:, 1:] - x[:, :1])


def frames_of_base_vectors(P: Reals) -> Reals:
    """Return `Ri = R^-1` with a positive diagonal in the order 11, 12, 13, 22, 23, 33, and the determinant of `R`, (7, n)."""
    n, k, _ = P.shape
    R = np.linalg.qr(P.swapaxes(1, 2))[1]
    R *= np.sign(np.diagonal(R, axis1=1, axis2=2))[:, :, None]
    Ri = np.zeros((n, 3, 3))
    Ri[:, :k, :k] = np.linalg.inv(R)
    return np.concatenate([Ri[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].T, np.linalg.det(R)[None]])


def _metric(p: Reals, t: Ids) -> Reals:
    """Return `P_i . P_j` of the base vectors `P_i = X_i - X_0`, (nt, k, k)."""
    P = p[:, t[1:]] - p[:, t[:1]]
    return np.einsum("din,djn->nij", P, P)


def _measure(p: Reals, t: Ids) -> Reals:
    """Return `k!` times the volume, (nt,)."""
    return np.sqrt(np.linalg.det(_metric(p, t)))


def _dense(rows: Ids, columns: Ids, blocks: Reals, width: int) -> NDArray[np.float64]:
    """Return all entries of a matrix of blocks, (3 n, 3 width)."""
    matrix = np.zeros((len(rows) - 1, width, 3, 3))
    matrix[np.repeat(np.arange(len(rows) - 1), np.diff(rows)), columns] = blocks.reshape(-1, 3, 3)
    return matrix.transpose(0, 2, 1, 3).reshape(3 * len(matrix), 3 * width)


def _rows_of_part(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, keep: str) -> NDArray[np.float64]:
    """Return rows of the part, (3 (end - begin), 3 n), with the blocks that `keep` names, and zeros elsewhere.

    `keep` is "all", or "before" or "after" for the blocks before or after the diagonal within the part.
    """
    n = len(rows) - 1
    i, j = np.indices((n, n))
    selected = {"all": i == i, "before": (begin <= j) & (j < i), "after": (i < j) & (j < end)}[keep]
    return (_dense(rows, columns, blocks, n) * np.kron(selected, np.ones((3, 3))))[3 * begin : 3 * end]


def _diagonal_of(begin: int, end: int, inverse: Reals) -> NDArray[np.float64]:
    """Return the diagonal blocks of the part, (3 (end - begin),) * 2, from their inverses."""
    matrix = np.zeros((3 * (end - begin),) * 2)
    for k, block in enumerate(inverse.reshape(-1, 3, 3)[begin:end]):
        matrix[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = np.linalg.inv(block)
    return matrix


def fill_blocks(
    begin: int,
    end: int,
    rows: Ids,
    columns: Ids,
    diagonal: Ids,
    first: Ids,
    block: Ids,
    component: Ids,
    indptr: Ids,
    indices: Ids,
    values: Reals,
    scale: float,
    blocks: Reals,
    single: Reals,
) -> None:
    """Write the blocks entry by entry; components without an unknown have `1 / scale` on the diagonal."""
    n, place = len(rows) - 1, 3 * block + component
    K = np.zeros((3 * n, 3 * n))
    K[place[np.repeat(np.arange(len(block)), np.diff(indptr))], place[indices]] = values
    bare = np.setdiff1d(np.arange(3 * n), place)
    K[bare, bare] = 1 / scale
    for i in range(begin, end):
        for k in range(rows[i], rows[i + 1]):
            blocks[9 * k : 9 * k + 9] = K[3 * i : 3 * i + 3, 3 * columns[k] : 3 * columns[k] + 3].ravel()
            single[9 * k : 9 * k + 9] = scale * blocks[9 * k : 9 * k + 9]


def product(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, x: Reals, add: bool, out: Reals) -> None:
    """Compute `A x`."""
    part = slice(3 * begin, 3 * end)
    out[part] = _dense(rows, columns, blocks, len(x) // 3)[part] @ x + (out[part] if add else 0)


def sweep_forward(
    begin: int, end: int, rows: Ids, columns: Ids, diagonal: Ids, blocks: Reals, inverse: Reals, b: Reals, x: Reals
) -> None:
    """Solve `(L + D) x = b` within the part."""
    part = slice(3 * begin, 3 * end)
    lower = _rows_of_part(begin, end, rows, columns, blocks, "before")[:, part]
    x[part] = np.linalg.solve(lower + _diagonal_of(begin, end, inverse), b[part])


def residual_after_forward(
    begin: int, end: int, rows: Ids, columns: Ids, diagonal: Ids, blocks: Reals, extra: Reals, x: Reals, out: Reals
) -> None:
    """Compute `(L + D) x - A x`, where D has `extra` on its diagonal."""
    part = slice(3 * begin, 3 * end)
    own = np.repeat(extra, 3)[part] * x[part]
    for i in range(begin, end):
        own[3 * (i - begin) : 3 * (i - begin) + 3] += blocks.reshape(-1, 3, 3)[diagonal[i]] @ x[3 * i : 3 * i + 3]
    lower, all_of_it = (_rows_of_part(begin, end, rows, columns, blocks, which) for which in ("before", "all"))
    out[part] = own + (lower - all_of_it) @ x


def sweep_backward(
    begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, inverse: Reals, b: Reals, before: Reals, x: Reals
) -> None:
    """Solve `(U + D) (x_new - x) = b - A x` within the part; outside of the part, A x uses `before`."""
    part = slice(3 * begin, 3 * end)
    upper = _rows_of_part(begin, end, rows, columns, blocks, "after")[:, part]
    state = before.copy()
    state[part] = x[part]
    residual = b[part] - _rows_of_part(begin, end, rows, columns, blocks, "all") @ state
    x[part] += np.linalg.solve(upper + _diagonal_of(begin, end, inverse), residual)


def outside_norms(begin: int, end: int, rows: Ids, columns: Ids, blocks: Reals, extra: Reals) -> None:
    """Write half the sum of the Frobenius norms of the blocks outside of the part."""
    norms = np.linalg.norm(blocks.reshape(-1, 9), axis=1) * ((columns < begin) | (columns >= end))
    for i in range(begin, end):
        extra[i] = norms[rows[i] : rows[i + 1]].sum() / 2


def invert_diagonal(begin: int, end: int, diagonal: Ids, blocks: Reals, extra: Reals, out: Reals) -> int:
    """Write `L^-T |P|^-1 L^-1` of `D = L P L'`, and return the number of negative pivots.

    Pivots that are almost zero are replaced by the size of the block.
    """
    negative = 0
    for i in range(begin, end):
        L, S = np.eye(3), blocks.reshape(-1, 3, 3)[diagonal[i]].astype(np.float64) + extra[i] * np.eye(3)
        total = np.abs(np.diag(S)).sum() or 1.0
        pivots = []
        for k in range(3):
            pivots.append(S[k, k] if abs(S[k, k]) > 1e-12 * total else total)
            below = np.eye(3)
            below[k + 1 :, k] = S[k + 1 :, k] / pivots[k]
            inverse = np.linalg.inv(below)
            S, L = inverse @ S @ inverse.T, L @ below
        inverse = np.linalg.inv(L)
        out[9 * i : 9 * i + 9] = (inverse.T / np.abs(pivots) @ inverse).ravel()
        negative += sum(pivot < 0 for pivot in pivots)
    return negative


def multiply_blocks(
    begin: int,
    end: int,
    rows: Ids,
    columns: Ids,
    blocks: Reals,
    other_rows: Ids,
    other_columns: Ids,
    other: Reals,
    out_rows: Ids,
    out_columns: Ids,
    width: int,
    out: Reals,
) -> None:
    """Compute the blocks of `A B` that the structure of the result contains."""
    matrix = _dense(rows, columns, blocks, len(other_rows) - 1) @ _dense(other_rows, other_columns, other, width)
    for i in range(begin, end):
        for k in range(out_rows[i], out_rows[i + 1]):
            out[9 * k : 9 * k + 9] = matrix[3 * i : 3 * i + 3, 3 * out_columns[k] : 3 * out_columns[k] + 3].ravel()


def smooth_prolongator(
    begin: int,
    end: int,
    rows: Ids,
    own: Ids,
    count: int,
    inverse: Reals,
    omega: float,
    products: Reals,
    tentative: Reals,
    out: Reals,
) -> None:
    """Compute `T - omega D^-1 (A T)`."""
    for i in range(begin, end):
        row = slice(rows[i], rows[i + 1])
        out.reshape(-1, 3, 3)[row] = -omega * inverse.reshape(-1, 3, 3)[i] @ products.reshape(-1, 3, 3)[row]
        out.reshape(-1, 3, 3)[own[i] : own[i] + count] += tentative.reshape(-1, count, 3, 3)[i]


def transpose_blocks(begin: int, end: int, indices: Ids, blocks: Reals, out: Reals) -> None:
    """Write the transpose of each block from its index."""
    out.reshape(-1, 3, 3)[begin:end] = blocks.reshape(-1, 3, 3)[indices[begin:end]].transpose(0, 2, 1)


def orthonormalise(begin: int, end: int, starts: Ids, members: Ids, count: int, modes: Reals, coarse: Reals) -> None:
    """Compute `Q R` of each aggregate by projection, `R = Q' B`."""
    of_row, of_aggregate = modes.reshape(-1, count, 3, 3), coarse.reshape(-1, count, count, 3, 3)
    for a in range(begin, end):
        ids = members[starts[a] : starts[a + 1]]
        B = of_row[ids].transpose(0, 2, 1, 3).reshape(3 * len(ids), 3 * count)
        Q = np.zeros_like(B)
        for c in range(3 * count):
            v = B[:, c] - Q @ (Q.T @ B[:, c])
            v -= Q @ (Q.T @ v)
            if v @ v > 1e-16 * (B[:, c] @ B[:, c]):
                Q[:, c] = v / np.linalg.norm(v)
        of_row[ids] = Q.reshape(len(ids), 3, count, 3).transpose(0, 2, 1, 3)
        of_aggregate[a] = np.triu(Q.T @ B).reshape(count, 3, count, 3).transpose(0, 2, 1, 3)


def invert_dense(a: Reals) -> bool:
    """Return whether the matrix is positive definite; if so, replace it by its inverse."""
    if np.linalg.eigvalsh(a).min() <= 0:
        return False
    a[:] = np.linalg.inv(a)
    return True


def dot(begin: int, end: int, x: Reals, y: Reals) -> float:
    """Return the contribution of the part to `x'y`."""
    return float((x[begin:end] * y[begin:end]).sum())


def step(begin: int, end: int, alpha: float, p: Reals, q: Reals, x: Reals, r: Reals) -> float:
    """Update `x += alpha p` and `r -= alpha q`, and return `r'r`."""
    part = slice(begin, end)
    x[part] += alpha * p[part]
    r[part] -= alpha * q[part]
    return float((r[part] ** 2).sum())


def update_search_direction(begin: int, end: int, beta: float, z: Reals, p: Reals) -> None:
    """Compute `p = z + beta p`."""
    p[begin:end] = z[begin:end] + beta * p[begin:end]


def multiply_diagonal(begin: int, end: int, blocks: Reals, x: Reals, out: Reals) -> None:
    """Multiply by the diagonal blocks, block by block."""
    out.reshape(-1, 3)[begin:end] = np.einsum("nij,nj->ni", blocks.reshape(-1, 3, 3)[begin:end], x.reshape(-1, 3)[begin:end])


def matrix_of_edges(edges: Ids, blocks: Reals, diagonal: Reals, grounded: Ids, ground: Reals, n: int) -> Reals:
    """Return the dense matrix (3 n, 3 n) with `A_ab`, `A_ba = A_ab'`, and `A_aa`, either user-supplied or `s_a - sum_b A_ab`, with
    the ground blocks added.
    """
    A = np.zeros((n, n, 3, 3))
    shifted = len(diagonal) == 3 * n
    A[range(n), range(n)] = diagonal.reshape(n, 3, 1) * np.eye(3) if shifted else diagonal.reshape(n, 3, 3)
    for (a, b), block in zip(edges, blocks.reshape(-1, 3, 3), strict=True):
        A[a, b] += block
        A[b, a] += block.T
        A[a, a] -= shifted * block
        A[b, b] -= shifted * block.T
    for a, block in zip(grounded, ground.reshape(-1, 3, 3), strict=True):
        A[a, a] += block
    return A.swapaxes(1, 2).reshape(3 * n, 3 * n)


def filtered(
    edges: Ids, blocks: Reals, diagonal: Reals, grounded: Ids, ground: Reals, inverse: Reals, constrained: Ids, omega: float
) -> tuple[Reals, Reals, Reals]:
    """Return A, E and L without the rows and columns of constrained components; E has ones on their diagonal."""
    n = len(inverse) // 9
    A, E = matrix_of_edges(edges, blocks, diagonal, grounded, ground, n), np.zeros((3 * n, 3 * n))
    A[constrained] = 0
    A[:, constrained] = 0
    for i in range(n):
        own = 3 * i + np.arange(3)
        E[np.ix_(own, own)] = np.linalg.inv(inverse[9 * i : 9 * i + 9].reshape(3, 3) + np.diag(np.isin(own, constrained)))
    row = np.arange(3 * n) // 3
    return A, E, A * ((row[:, None] > row) & (omega > 0))


def residual(
    edges: Ids,
    blocks: Reals,
    diagonal: Reals,
    grounded: Ids,
    ground: Reals,
    constrained: Ids,
    indices: Ids,
    b: Reals,
    state: Reals,
    work: Reals,
) -> None:
    """Write `r = b - A x` to s, and `|r|` to `state`."""
    A = matrix_of_edges(edges, blocks, diagonal, grounded, ground, work.shape[1] // 3)
    A[constrained] = 0
    work[S] = -A @ work[X]
    work[S, indices] += b
    work[P] = 0
    state[:] = np.linalg.norm(work[S]), 0, 0, 0


def precondition(edges: Ids, blocks: Reals, inverse: Reals, constrained: Ids, omega: float, work: Reals) -> None:
    """Compute `t = M^-1 r` for an r stored in s."""
    _, E, L = filtered(edges, blocks, np.zeros(len(inverse) // 3), edges[:0, 0], blocks[:0], inverse, constrained, omega)
    work[T] = np.linalg.solve((E + L) @ np.linalg.solve(E, E + L.T), work[S])


def iterate(
    edges: Ids,
    blocks: Reals,
    diagonal: Reals,
    grounded: Ids,
    ground: Reals,
    inverse: Reals,
    constrained: Ids,
    omega: float,
    tolerance: float,
    max_iterations: int,
    state: Reals,
    work: Reals,
) -> tuple[int, int]:
    """Iterate `p = s + beta p`, `t = (E + L')^-1 p`, `u = E (E + L)^-1 A t`, `x += alpha t`, `s -= alpha u`.

    alpha = s'E^-1 s / t'A t
    """
    A, E, L = filtered(edges, blocks, diagonal, grounded, ground, inverse, constrained, omega)
    if state[RHO_AT_NORM] == 0 and state[NORM] > tolerance:
        work[S] = E @ np.linalg.solve(E + L, work[S])
        state[RHO_AT_NORM] = state[RHO] = work[S] @ np.linalg.solve(E, work[S])
    for done in range(max_iterations):
        norm, rho_at_norm, rho, beta = state
        if norm <= tolerance:
            return CONVERGED, done
        p = work[S] + beta * work[P]
        t = np.linalg.solve(E + L.T, p)
        if not rho > 0 or not t @ A @ t > 0:
            return NEGATIVE if np.isfinite(rho) and np.isfinite(t @ A @ t) else NOT_FINITE, done
        alpha, u = rho / (t @ A @ t), E @ np.linalg.solve(E + L, A @ t)
        work[X] += alpha * t
        work[S] -= alpha * u
        work[P], work[T], work[U] = p, t, u
        state[RHO] = work[S] @ np.linalg.solve(E, work[S])
        state[BETA] = state[RHO] / rho
        if not state[RHO] > rho_at_norm * max(tolerance / norm, REDUCTION) ** 2:
            state[NORM] = np.linalg.norm(work[S] + L @ np.linalg.solve(E, work[S]))
            state[RHO_AT_NORM] = state[RHO]
        if not np.isfinite(state[NORM]):
            return NOT_FINITE, done + 1
    return CONVERGED if state[NORM] <= tolerance else UNFINISHED, max_iterations


def shifted_diagonal(
    edges: Ids,
    blocks: Reals,
    grounded: Ids,
    ground: Reals,
    constrained: Ids,
    indices: Ids,
    shift: Reals,
    diagonal: Reals,
    out: Reals,
) -> float:
    """Write the diagonal blocks of the matrix, with the shift, and return their sum."""
    if len(shift):
        diagonal[indices] = shift
    n = len(out) // 9
    A = matrix_of_edges(edges, blocks, diagonal, grounded, ground, n)
    A[constrained] = 0
    A[:, constrained] = 0
    out[:] = A.reshape(n, 3, n, 3)[range(n), :, range(n)].ravel()
    return float(out.sum())


def fill_edges(
    rows: Ids,
    columns: Ids,
    first: Ids,
    block: Ids,
    component: Ids,
    indptr: Ids,
    indices: Ids,
    values: Reals,
    blocks: Reals,
    diagonal: Reals,
) -> None:
    """Write the blocks of the matrix above the diagonal, and on it."""
    n = len(rows) - 1
    A, place = np.zeros((3 * n, 3 * n)), 3 * block + component
    for u, to in enumerate(place):
        A[to, place[indices[indptr[u] : indptr[u + 1]]]] = values[indptr[u] : indptr[u + 1]]
    A = A.reshape(n, 3, n, 3).swapaxes(1, 2)
    blocks[:] = A[np.repeat(range(n), np.diff(rows)), columns].ravel()
    diagonal[:] = A[range(n), range(n)].ravel()


# Kernels of motion.


def momenta(p: Reals, u: Reals, v: Reals, Mv: Reals, out: Reals) -> None:
    """Write `v . M v`, `sum M v`, `sum x (x) M v`."""
    x, q = np.zeros((len(u), 3)), np.zeros((len(u), 3))
    x[:, : len(p)], q[:, : len(p)] = p.T + u, Mv
    out[:] = [(v * Mv).sum(), *q.sum(axis=0), *np.cross(x, q).sum(axis=0)]


def lumped_momenta(p: Reals, u: Reals, v: Reals, m: Reals, f: Reals, out: Reals) -> None:
    """Write `momenta` of masses `m`, and `f . u`."""
    x, w = u.reshape(-1, len(p)), v.reshape(-1, len(p))
    momenta(p, x, w, m[:, None] * w, out[:7])
    out[7] = (f * u).sum()


def kick_and_drift(a: Reals, h: float, dt: float, v: Reals, u: Reals) -> None:
    """Compute `v += h a`, `u += dt v`."""
    v += h * a
    u += dt * v


def accelerate(inverse: Reals, external: Reals, internal: Reals, h: float, a: Reals, v: Reals) -> None:
    """Compute `a = M^-1 (external - internal)`, `v += h a`."""
    a[:] = inverse * (external - internal)
    v += h * a


def push_and_drift(inverse: Reals, external: Reals, internal: Reals, h: float, v: Reals, u: Reals) -> None:
    """Compute `v += h M^-1 (external - internal)`, `u += h v`."""
    v += h * inverse * (external - internal)
    u += h * v
