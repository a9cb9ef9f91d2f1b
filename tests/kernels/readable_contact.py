"""Readable twins of the kernels of contact: all points at once, as the formulas stand in `skfem_stvk.kernels.contact_penalty`."""

from itertools import pairwise

import numpy as np

from skfem_stvk.kernels.contact_penalty import BOX, CYLINDER, DIRECTION, PLANE, RADIUS, SIGN

#: Gauss points and weights on (0, 1), for integrals over one branch of the penalty.
S, DS = (0.5 * (np.polynomial.legendre.leggauss(6)[0] + 1), 0.5 * np.polynomial.legendre.leggauss(6)[1])


def in_space(x):
    """Return vectors (..., d) with three components."""
    return np.concatenate([x, np.zeros((*x.shape[:-1], 3 - x.shape[-1]))], axis=-1)


def points(surface, shape, shift, u):
    """Return the points (n, nq, 3) relative to the shape."""
    at_nodes = in_space(surface.X + u)[surface.t]
    return np.einsum("qa,nac->nqc", surface.N, at_nodes) - shape.numbers[:3] - shift


def displacements(surface, shift, u):
    """Return the displacements of the points (n, nq, 3) relative to that of the shape."""
    return np.einsum("qa,nac->nqc", surface.N, in_space(u)[surface.t]) - shift


def gaps_and_normals(shape, x):
    """Return gaps (...) and normals (..., 3) of points (..., 3)."""
    kind, numbers = shape
    along = numbers[DIRECTION : DIRECTION + 3]
    if kind == PLANE:
        return x @ along, np.broadcast_to(along, x.shape)
    if kind == BOX:
        q = np.abs(x) - along + numbers[RADIUS]
        outside = np.maximum(q, 0)
        length = np.linalg.norm(outside, axis=-1, keepdims=True)
        nearest = np.arange(3) == q.argmax(axis=-1)[..., None]
        normals = np.copysign(1, x) * np.where(length > 0, outside / np.where(length > 0, length, 1), nearest)
        return length[..., 0] + np.minimum(q.max(axis=-1), 0) - numbers[RADIUS], normals
    arms = x - (x @ along)[..., None] * along if kind == CYLINDER else x
    lengths = np.linalg.norm(arms, axis=-1)
    return numbers[SIGN] * (lengths - numbers[RADIUS]), numbers[SIGN] * arms / lengths[..., None]


def penalty(p, e):
    """Return `psi, psi', psi''` for k = 1 at depths `p`, 0 where they are negative."""
    p = np.maximum(p, 0)
    if not e:
        return p**2 / 2, p, np.where(p > 0, 1.0, 0.0)
    low = p < e
    return (
        np.where(low, p**3 / (6 * e), p**2 / 2 - e * p / 2 + e**2 / 6),
        np.where(low, p**2 / (2 * e), p - e / 2),
        np.minimum(p / e, 1),
    )


def spread(surface, per_point, f):
    """Compute `f_a += sum N_a per_point` for vectors (n, nq, 3)."""
    np.add.at(f, surface.t, np.einsum("qa,nqc->nac", surface.N, per_point)[..., : f.shape[1]])


def dense(surface, per_point, d):
    """Return the matrix (nodes d, nodes d) of `N_a N_b per_point`, for matrices (n, nq, 3, 3)."""
    n = len(surface.X)
    K = np.zeros((n, n, d, d))
    each = np.einsum("qa,qb,nqij->nabij", surface.N, surface.N, per_point)[..., :d, :d]
    for t, own in zip(surface.t, each, strict=True):
        np.add.at(K, np.ix_(t, t), own)
    return K.swapaxes(1, 2).reshape(n * d, n * d)


def energy_and_force(surface, weights, shape, shift, e, u, f):
    g, n = gaps_and_normals(shape, points(surface, shape, shift, u))
    psi, slope, _ = penalty(-g, e)
    spread(surface, -(weights * slope)[..., None] * n, f)
    return float((weights * psi).sum())


def stiffness(surface, weights, shape, shift, e, u, kept, everywhere):
    """Return the matrix of `add_blocks`; the curvature is a difference of normals."""
    x, h = points(surface, shape, shift, u), 1e-6
    g, n = gaps_and_normals(shape, x)
    _, slope, second = penalty(-g, e)
    if everywhere:
        slope, second = 0 * slope, np.ones_like(second)
    ends = [[gaps_and_normals(shape, x + s * h * axis)[1] for axis in np.eye(3)] for s in (1, -1)]
    curvature = np.stack([(a - b) / (2 * h) for a, b in zip(*ends, strict=True)], axis=-1)
    blocks = second[..., None, None] * n[..., None] * n[..., None, :] - (kept * slope)[..., None, None] * curvature
    return dense(surface, weights[..., None, None] * blocks, u.shape[1])


def between(surface, shape, shifts, states, e):
    """Return gaps at both ends, and at Gauss points on each branch of psi between them: `s`, weights and depths (m, n, nq)."""
    g0, g1 = (gaps_and_normals(shape, points(surface, shape, shift, u))[0] for shift, u in zip(shifts, states, strict=True))
    change = np.where(g1 == g0, 1e-300, g1 - g0)
    cuts = np.sort(np.clip([0 * g0, -g0 / change, (-e - g0) / change, 0 * g0 + 1], 0, 1), axis=0)
    s = np.concatenate([a + (b - a) * S[:, None, None] for a, b in pairwise(cuts)])
    weights = np.concatenate([(b - a) * DS[:, None, None] for a, b in pairwise(cuts)])
    return g0, g1, s, weights, -(g0 + s * (g1 - g0))


def mean_normals(shape, shifts, states, surface, g0, g1):
    """Return normals (n, nq, 3) with `n . (x1 - x0) = g1 - g0`."""
    x0, x1 = (points(surface, shape, shift, u) for shift, u in zip(shifts, states, strict=True))
    middle = gaps_and_normals(shape, (x0 + x1) / 2)[1]
    if shape.kind == PLANE:
        return middle
    if shape.kind == BOX:
        change = x1 - x0
        missing = (g1 - g0 - (middle * change).sum(-1)) / (change**2).sum(-1)
        return middle + missing[..., None] * change
    along = shape.numbers[DIRECTION : DIRECTION + 3]
    arms = [x - (x @ along)[..., None] * along if shape.kind == CYLINDER else x for x in (x0, x1)]
    lengths = sum(np.linalg.norm(arm, axis=-1, keepdims=True) for arm in arms)
    return shape.numbers[SIGN] * sum(arms) / lengths


def mean_force(surface, weights, shape, shift0, shift1, e, u0, u1, factor, f):
    g0, g1, _, ds, depths = between(surface, shape, (shift0, shift1), (u0, u1), e)
    slopes = (ds * penalty(depths, e)[1]).sum(axis=0)
    n = mean_normals(shape, (shift0, shift1), (u0, u1), surface, g0, g1)
    spread(surface, -(factor * weights * slopes)[..., None] * n, f)


def mean_stiffness(surface, weights, shape, shift0, shift1, e, u0, u1):
    g0, g1, s, ds, depths = between(surface, shape, (shift0, shift1), (u0, u1), e)
    second = 2 * (ds * s * penalty(depths, e)[2]).sum(axis=0)
    n = mean_normals(shape, (shift0, shift1), (u0, u1), surface, g0, g1)
    return dense(surface, (weights * second)[..., None, None] * n[..., None] * n[..., None, :], u0.shape[1])


def remember(surface, weights, shape, shift, e, u, coefficient):
    """Return what the kernel writes to `past` (n, nq, 7)."""
    g, n = gaps_and_normals(shape, points(surface, shape, shift, u))
    return np.concatenate([displacements(surface, shift, u), (coefficient * weights * penalty(-g, e)[1])[..., None], n], axis=-1)


def friction(surface, shift, past, width, u, f):
    """Add the force against the slip to `f`; return the work against it and the forces per slip (n, nq)."""
    d = displacements(surface, shift, u) - past[..., :3]
    d = d - (d * past[..., 4:]).sum(-1, keepdims=True) * past[..., 4:]
    y = np.linalg.norm(d, axis=-1)
    r = np.minimum(y / width, 1)
    per_slip = past[..., 3] * np.where(y > 0, r * (2 - r) / np.where(y > 0, y, 1), 2 / width)
    spread(surface, per_slip[..., None] * d, f)
    return float((per_slip * y**2).sum()), per_slip
