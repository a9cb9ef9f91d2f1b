"""The largest eigenvalue of (K, M): by conjugate gradients, and bounded by norms of the blocks of K."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..nonlinear.problem import dot
from ..system import TangentOperator
from ..system.mass import Mass

#: The residual that is left, as a part of the eigenvalue; iterations at most.
PRECISION, MOST = 1e-3, 300
#: A direction of which less is left beside the others is rounding.
SHORT = 1e-8
#: Products with norms of blocks, each of which makes the bound smaller.
SWEEPS = 5


class Largest(NamedTuple):
    """An eigenpair of `K x = value M x`.

    Attributes
    ----------
    value : the Rayleigh quotient of x [1/s^2]: not above the largest eigenvalue.
    residual : of `M^-1/2 K M^-1/2` [1/s^2]: there is an eigenvalue within it.
    vector : x (ndofs,), of length one in M.
    products : with K, that it took.
    """

    value: float
    residual: float
    vector: Array
    products: int


def largest_eigenvalue(product: Callable[[Array], Array], mass: Mass, x: Array) -> Largest:
    """The largest eigenvalue, from `x` (ndofs,) on, by conjugate gradients that are optimal in three directions (LOBPCG, Knyazev 2001).

    Lanczos' method needs as many products and all vectors so far; this one the last three.
    """
    x = _unit(x, mass)
    Kx, products, size = product(x), 1, 0.0
    p = Kp = np.zeros_like(x)
    while True:
        value = dot(x, Kx)
        size = max(size, abs(value))
        w = mass.solve(Kx) - value * x
        residual = float(np.sqrt(max(dot(w, mass.multiply(w)), 0.0)))
        if residual <= PRECISION * size or products >= MOST:
            return Largest(value, residual, x, products)
        w = _unit(w - dot(w, mass.multiply(x)) * x, mass)
        Kw, products = product(w), products + 1
        basis, images = [x, w], [Kx, Kw]
        for other, image in zip(basis, images, strict=True):
            along = dot(other, mass.multiply(p))
            p, Kp = p - along * other, Kp - along * image
        length = np.sqrt(dot(p, mass.multiply(p)))
        if length > SHORT:
            basis.append(p / length)
            images.append(Kp / length)
        small = np.array([[dot(a, image) for image in images] for a in basis])
        first, *others = np.linalg.eigh((small + small.T) / 2)[1][:, -1]
        p, Kp = _combined(others, basis[1:]), _combined(others, images[1:])
        x, Kx = first * x + p, first * Kx + Kp


def bound_on_eigenvalues(K: TangentOperator, vertex: Array) -> float:
    """What no eigenvalue of (K, M) exceeds [1/s^2], with M lumped to the masses `vertex` (nv,).

        value <= max_a (k_a s_a + sum_b |K_ab| s_b) / (m_a s_a)        for any s > 0

    with the largest eigenvalue `k_a` of the diagonal block and the norms of the others: Gershgorin's circles of blocks, scaled. From
    `s = m^-1/2` on, each quotient is the next `s` times what is under it, so that the bound falls (Collatz, Wielandt). Vertices without
    mass are those that are held.
    """
    own = _largest_of_blocks(K.diagonal_blocks().astype(np.float64))
    inverse = np.divide(1.0, vertex, out=np.zeros(len(vertex)), where=vertex > 0)
    s, bound = np.sqrt(inverse), np.inf
    for _ in range(SWEEPS):
        sums = own * s
        K.add_norms(s, sums)
        sums *= inverse
        rows = np.divide(sums, s, out=np.zeros(len(s)), where=s > 0)
        bound, s = min(bound, float(rows.max())), sums
    return bound


def _largest_of_blocks(blocks: Array) -> Array:
    """(nv,) what no eigenvalue of the symmetric blocks (nv, d, d) exceeds, by their traces (Wolkowicz, Styan 1980); exact for d < 3; not negative."""
    d = blocks.shape[1]
    mean = np.einsum("vcc->v", blocks) / d
    spread = np.einsum("vij,vij->v", blocks, blocks) - d * mean**2
    return np.maximum(mean + np.sqrt(np.maximum(spread, 0) * (d - 1) / d), 0)


def _combined(factors: Sequence[float], vectors: Sequence[Array]) -> Array:
    return np.einsum("i,ij->j", factors, np.stack(vectors))


def _unit(x: Array, mass: Mass) -> Array:
    size = np.sqrt(dot(x, mass.multiply(x)))
    return x / size if size > 0 else x
