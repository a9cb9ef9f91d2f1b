"""Reduced St. Venant-Kirchhoff bodies: the coefficients of their energy, and the energy with all its derivatives.

`z` (R,) are the amplitudes of displacement fields, `x = (1, z)`, and n = R + 1. Each strain is a sum of products `x_a x_b`. The
energy is one homogeneous quartic. Its cubic and quadratic parts are the terms with one and two factors `x_0 = 1`:

    W = sum over a <= b <= c <= d of T_abcd x_a x_b x_c x_d        n (n + 1) (n + 2) (n + 3)/24 numbers, 46 376 at R = 30

The pair `a <= b` has the index `b (b + 1)/2 + a`. The numbers of T are stored in rows, one for each `d` and each `c <= d`. A row
contains all pairs with `b <= c`, which are the first `(c + 1) (c + 2)/2`. Therefore a whole row is multiplied by one number at a
time.

Source: Barbic, James, "Real-time subspace integration for St. Venant-Kirchhoff deformable models" (2005).
"""

from __future__ import annotations

from numpy import uint64

from .compiled import Reals, kernel


@kernel
def strain_rows(G: Reals, L: Reals, work: Reals, out: Reals) -> None:
    """Write strains of elements as sums of products `x_a x_b` to `out` (n s, pairs): `s = k (k + 1)/2` rows for each of n elements.

        M_ij = q_i . q_j - Q_i . Q_j,  q_j = sum_a G_jca x_a,  G_jc0 = Q_j at rest        in the order 11, 22, 33, 12, 13, 23
        y = L M

    `G` is (n, k, d, R + 1), `L` is (n, s, s); `work` (s, pairs) is a scratch array.
    """
    n, k, d, m = G.shape
    s, pairs = work.shape
    for e in range(n):
        for row in range(s):
            i = row if row < k else (0 if row < k + k - 1 else 1)
            j = row if row < k else (row - k + 1 if row < k + k - 1 else 2)
            for b in range(m):
                first = b * (b + 1) // 2
                for a in range(b + 1):
                    work[uint64(row), uint64(first + a)] = 0.0
                for c in range(d):
                    x, y = G[uint64(e), uint64(i), uint64(c), uint64(b)], G[uint64(e), uint64(j), uint64(c), uint64(b)]
                    for a in range(b + 1):
                        work[uint64(row), uint64(first + a)] += (
                            G[uint64(e), uint64(i), uint64(c), uint64(a)] * y + G[uint64(e), uint64(j), uint64(c), uint64(a)] * x
                        )
                work[uint64(row), uint64(first + b)] *= 0.5
            work[uint64(row), uint64(0)] = 0.0
        for row in range(s):
            to = e * s + row
            for p in range(pairs):
                out[uint64(to), uint64(p)] = L[uint64(e), uint64(row), uint64(0)] * work[uint64(0), uint64(p)]
            for other in range(1, s):
                factor = L[uint64(e), uint64(row), uint64(other)]
                if factor != 0.0:
                    for p in range(pairs):
                        out[uint64(to), uint64(p)] += factor * work[uint64(other), uint64(p)]


@kernel
def distinct_coefficients(C: Reals, T: Reals) -> None:
    """Write the coefficients T of `1/2 sum over pairs of C_PQ x_P x_Q`.

    `C` (pairs, pairs) is symmetric, and only its lower half is used. A product `x_a x_b x_c x_d` is a product of two pairs in three
    ways. Some of these are the same where indices are equal.
    """
    n, at = 0, 0
    while n * (n + 1) // 2 < C.shape[0]:
        n += 1
    for d in range(n):
        for c in range(d + 1):
            for b in range(c + 1):
                for a in range(b + 1):
                    total = C[d * (d + 1) // 2 + c, b * (b + 1) // 2 + a] * (0.5 if a == d else 1.0)
                    if b != c:
                        total += C[d * (d + 1) // 2 + b, c * (c + 1) // 2 + a] * (0.5 if a == b and c == d else 1.0)
                    if a != b and c != d:
                        total += C[d * (d + 1) // 2 + a, c * (c + 1) // 2 + b]
                    T[at] = total
                    at += 1


@kernel
def quartic(T: Reals, x: Reals, p: Reals, Y: Reals, P: Reals, G: Reals, H: Reals) -> float:
    """Return `W = 1/12 x' H x` at `x` (n,), and write `G = dW/dx = 1/3 H x` (n,) and `H_ab = d2W/dx_a dx_b` (n, n).

    A product `T_abcd x_a x_b x_c x_d` contributes to six entries of H, one for each two of its factors. For a row `t` of `c, d`,
    the sums `Y_c = sum_d x_d t` and `Y_d = sum_c x_c t` are stored. Their entries `a, b` contain one of the two factors `c, d`; the
    other is left for the derivative. `p` and `P` (pairs,) and `Y` (n, pairs) are scratch arrays.
    """
    n, pairs, at = len(x), len(p), 0
    for b in range(n):
        for a in range(b + 1):
            p[uint64(b * (b + 1) // 2 + a)] = x[uint64(a)] * x[uint64(b)]
    for c in range(n):
        for i in range((c + 1) * (c + 2) // 2):
            Y[uint64(c), uint64(i)] = 0.0
    for i in range(pairs):
        P[uint64(i)] = 0.0
    for d in range(n):
        for c in range(d + 1):
            size, xc, xd, total = (c + 1) * (c + 2) // 2, x[uint64(c)], x[uint64(d)], 0.0
            for i in range(size):
                t = T[uint64(at + i)]
                total += t * p[uint64(i)]
                Y[uint64(c), uint64(i)] += xd * t
                Y[uint64(d), uint64(i)] += xc * t
            P[uint64(d * (d + 1) // 2 + c)] += total
            at += size
    for e in range(n):
        half, own = 0.5 * x[uint64(e)], e * (e + 1) // 2
        for i in range((e + 1) * (e + 2) // 2):
            P[uint64(i)] += half * Y[uint64(e), uint64(i)]
        for b in range(e + 1):
            first, total = b * (b + 1) // 2, 0.0
            for a in range(b + 1):
                y = Y[uint64(e), uint64(first + a)]
                total += x[uint64(a)] * y
                P[uint64(own + a)] += x[uint64(b)] * y
            P[uint64(own + b)] += total
    for b in range(n):
        for a in range(b):
            H[uint64(a), uint64(b)] = H[uint64(b), uint64(a)] = P[uint64(b * (b + 1) // 2 + a)]
        H[uint64(b), uint64(b)] = 2.0 * P[uint64(b * (b + 1) // 2 + b)]
    energy = 0.0
    for a in range(n):
        total = 0.0
        for b in range(n):
            total += H[uint64(a), uint64(b)] * x[uint64(b)]
        G[uint64(a)] = total / 3.0
        energy += G[uint64(a)] * x[uint64(a)]
    return energy / 4.0
