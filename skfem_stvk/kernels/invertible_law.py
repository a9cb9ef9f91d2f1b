"""St. Venant-Kirchhoff energy of principal stretches, extended below a threshold stretch."""

from __future__ import annotations

from typing import Any, NamedTuple

from .compiled import Reals, by_type, inlined
from .laws import FORMULAS
from .principal import lame, of_stretches, stretch_response
from .svd import present, small


class InvertibleLaw(NamedTuple):
    """Invertible law: `Ri`, then `w lam/2` and `w mu`; St. Venant-Kirchhoff energy, extended below the stretch `threshold`.

    With `c_i = max(s_i, threshold)`, `d = s - c`, `E_i = (c_i^2 - 1)/2` and `w_i, w_ij` the derivatives of `w0(c) = lam/2 (sum
    E_i)^2 + mu sum E_i^2`:

        w = w0(c) + sum w_i d_i + sum_i<j w_ij d_i d_j + (lam + 2 mu)/2 sum d_i^2
    """

    D: Reals
    flat: Any
    threshold: float


of_stretches(InvertibleLaw)


@inlined
def _clipped(s, e, a, there):
    """Return `c`, `d` and `E` of a stretch, which are zero if it is lacking, and whether it is above the threshold `a`."""
    one = a / a
    free = s > a
    c, x = (s if free else a), (e if free else a - one)
    return there * c, there * (s - c), there * (x + x * x / (one + one)), free


@inlined
def _flip(c, b, s, t, free, T, lam, mu, one, tiny):
    """Return `(p_i - p_j)/(s_i - s_j)` for `c_i, c_j` and `s_i >= s_j`.

    This is a weighted mean of its values above and below the threshold.
    """
    apart = s - t
    share = (c - b) / (apart if apart > tiny else one)
    share = one if free else share
    return share * (T + mu * (c * c + c * b + b * b - one)) + (one - share) * (lam + mu + mu - lam * b * b)


@by_type(stretch_response, InvertibleLaw, FORMULAS)
def _invertible(law, at, weight, s, e):
    (lam, mu), (x, y, z), D = lame(law, at, weight), present(law.flat, law.D), law.D
    one, half, a, tiny = D.dtype.type(1), D.dtype.type(0.5), D.dtype.type(law.threshold), small(D)
    k, two = lam + mu + mu, mu + mu
    c1, d1, E1, free1 = _clipped(s[0], e[0], a, x)
    c2, d2, E2, free2 = _clipped(s[1], e[1], a, y)
    c3, d3, E3, free3 = _clipped(s[2], e[2], a, z)
    g1, g2, g3 = c1 * d1, c2 * d2, c3 * d3
    trace, G = E1 + E2 + E3, g1 + g2 + g3
    bend = lam * trace
    w = half * (bend * trace + k * (d1 * d1 + d2 * d2 + d3 * d3)) + mu * (E1 * E1 + E2 * E2 + E3 * E3)
    w += bend * G + two * (E1 * g1 + E2 * g2 + E3 * g3) + lam * (g1 * g2 + g1 * g3 + g2 * g3)
    T = lam * (trace + G)
    p1 = c1 * (T - lam * g1 + two * E1) + k * d1
    p2 = c2 * (T - lam * g2 + two * E2) + k * d2
    p3 = c3 * (T - lam * g3 + two * E3) + k * d3
    H11 = T + two * E1 + k * c1 * c1 if free1 else k
    H22 = T + two * E2 + k * c2 * c2 if free2 else k
    H33 = T + two * E3 + k * c3 * c3 if free3 else k
    flips = (
        _flip(c1, c2, s[0], s[1], free2, T, lam, mu, one, tiny),
        _flip(c1, c3, s[0], s[2], free3, T, lam, mu, one, tiny),
        _flip(c2, c3, s[1], s[2], free3, T, lam, mu, one, tiny),
    )
    return w, (p1, p2, p3), (H11, y * H22, z * H33, lam * c1 * c2, lam * c1 * c3, lam * c2 * c3), flips
