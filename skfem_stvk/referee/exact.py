"""What W, F and K are held against: 50 decimal digits, and scikit-fem's assembly where it loses none.

In the simplex's own oblique axes `D_i = X_i - X_0` (current: `d_i`), with the dual vectors `g_i . D_j = delta_ij`:

    e_ij = 1/2 (d_i . d_j - D_i . D_j),  c_ijmn = C : g_i (x) g_j (x) g_m (x) g_n,  s_ij = c_ijmn e_mn,  V = sqrt(det D_i . D_j)/k!
    W = sum V/2 s : e,   F_i = V sum_j s_ij d_j,   K_ij = V (s_ij I + sum_mn c_imjn d_m (x) d_n),   and minus the sums for vertex 0

Isotropic materials have `c_ijmn = lam G_ij G_mn + mu (G_im G_jn + G_in G_jm)` with `G` the inverse of `D_i . D_j`. `K v` is the
derivative of F along v.

Python's decimal numbers are exact on every platform (a `longdouble` is a mere double on some), and fast enough for a patch.
"""

from __future__ import annotations

from decimal import Context, Decimal, localcontext
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ..arguments import Array
from ..mesh import ElementMesh
from ..mesh.geometry import aspect_ratios
from ..reference import ReferenceStVK

Exact = NDArray[Any]
DIGITS = 50
CONTEXT = Context(prec=DIGITS)
#: Longest edge over smallest height beyond which round-off may cost more than 1e-12.
FLAT = 20.0
#: Largest number of such elements that are computed in 50 digits.
MOST = 200


class ExactStVK:
    """W, F and K of simplices in 50 decimal digits, each rounded to double once.

    Parameters
    ----------
    p : (d, nv) coordinates, taken as exact.
    t : (k + 1, nt) vertices.
    tensor : (nt, k, k, k, k) or (1, k, k, k, k) elasticity tensors in the simplices' own axes times their section, as `reference`
        takes them; or the Lame pair within the simplices' dimensions.
    """

    def __init__(self, p: Array, t: NDArray[np.int32], tensor: Array | tuple[float, float]) -> None:
        self.d, self.t, self.ndofs = len(p), t, p.size
        with localcontext(CONTEXT):
            self._rest = self._spokes(_decimal(p))
            metric = np.einsum("ixn,jxn->ijn", self._rest, self._rest)
            inverse, determinant = _inverse(metric)
            self._metric, self._volume = metric, _root(determinant) / factorial(len(metric))
            self._moduli = _isotropic(inverse, *tensor) if isinstance(tensor, tuple) else _general(self._rest, tensor)

    def energy_and_force(self, u: Array) -> tuple[float, Array]:
        """W and F (ndofs,) at `u` (ndofs,), whose entries are taken as exact."""
        with localcontext(CONTEXT):
            d, e, s = self._state(u)
            return float(self._energy(e, s)), self._to_vertices(self._volume * np.einsum("ijn,jxn->ixn", s, d))

    def energy(self, u: Array) -> float:
        """Strain energy [J]."""
        return self.energy_and_force(u)[0]

    def internal_force(self, u: Array) -> Array:
        """Internal force (ndofs,) [N]."""
        return self.energy_and_force(u)[1]

    def tangent(self, u: Array) -> csr_matrix:
        """Tangent stiffness [N/m]."""
        with localcontext(CONTEXT):
            d, _, s = self._state(u)
            k, _, n = d.shape
            half = np.einsum("imjpn,mxn->ixjpn", self._moduli, d)
            K = np.zeros((k + 1, self.d, k + 1, self.d, n), dtype=object)
            K[1:, :, 1:] = np.einsum("ixjpn,pyn->ixjyn", half, d)
            for x in range(self.d):
                K[1:, x, 1:, x] += s
            K[0] = -K[1:].sum(axis=0)
            K[:, :, 0] = -K[:, :, 1:].sum(axis=2)
            values = (self._volume * K).astype(float)
        dofs = self.d * self.t[:, None] + np.arange(self.d)[:, None]  # (k + 1, d, nt)
        rows, columns = np.broadcast_to(dofs[:, :, None, None], values.shape), np.broadcast_to(dofs, values.shape)
        return csr_matrix(coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(self.ndofs,) * 2))

    def product(self, u: Array, v: Array) -> Array:
        """`K(u) v` (ndofs,) [N]."""
        with localcontext(CONTEXT):
            d, _, s = self._state(u)
            dd = self._spokes(_decimal(v.reshape(-1, self.d).T))
            ds = np.einsum("ijmpn,mxn,pxn->ijn", self._moduli, d, dd)
            return self._to_vertices(self._volume * (np.einsum("ijn,jxn->ixn", ds, d) + np.einsum("ijn,jxn->ixn", s, dd)))

    def _state(self, u: Array) -> tuple[Exact, Exact, Exact]:
        """Current spokes (k, d, nt), strains and stresses (k, k, nt) in the oblique axes."""
        d = self._rest + self._spokes(_decimal(u.reshape(-1, self.d).T))
        e = (np.einsum("ixn,jxn->ijn", d, d) - self._metric) / 2
        return d, e, np.einsum("ijmpn,mpn->ijn", self._moduli, e)

    def _energy(self, e: Exact, s: Exact) -> Any:
        return (self._volume * (s * e).sum(axis=(0, 1))).sum() / 2

    def _spokes(self, x: Exact) -> Exact:
        """(k, d, nt) differences of a field (d, nv) to the first vertex."""
        return np.stack([x[:, ends] - x[:, self.t[0]] for ends in self.t[1:]])

    def _to_vertices(self, f: Exact) -> Array:
        """(ndofs,) sum of forces (k, d, nt) on all vertices but the first, and of their opposites on the first."""
        F = np.full((self.ndofs // self.d, self.d), Decimal(0), dtype=object)
        for ends, force in zip(self.t, [-f.sum(axis=0), *f], strict=True):
            np.add.at(F, ends, force.T)
        return F.astype(float).ravel()


class Truth:
    """W, F and K of a body with elasticity tensors as `ReferenceStVK` takes them.

    Attributes
    ----------
    exact : elements that are computed in 50 digits: the flattest `MOST` of those with an aspect ratio beyond `FLAT`.
    """

    def __init__(self, mesh: ElementMesh, tensor: Array) -> None:
        aspect = aspect_ratios(mesh)
        flattest = np.argsort(-aspect, kind="stable")[:MOST]
        self.exact = flattest[aspect[flattest] > FLAT]
        others = np.setdiff1d(np.arange(mesh.nt), self.exact)
        each = np.broadcast_to(tensor, (mesh.nt, *tensor.shape[1:]))
        self._models: list[ReferenceStVK | ExactStVK] = []
        if len(others):
            self._models.append(ReferenceStVK(mesh.p, mesh.t[:, others], tensor if len(tensor) == 1 else each[others]))
        if len(self.exact):
            self._models.append(ExactStVK(mesh.p, mesh.t[:, self.exact], each[self.exact]))

    def described(self) -> str:
        """How it is computed, for the head of a report."""
        count = len(self.exact)
        flattest = f"the {count} flattest elements" if count > 1 else "the flattest element"
        return f"scikit-fem; {flattest} in 50 digits" if count else "scikit-fem"

    def energy(self, u: Array) -> float:
        """Strain energy [J]."""
        return sum(model.energy(u) for model in self._models)

    def internal_force(self, u: Array) -> Array:
        """Internal force (ndofs,) [N]."""
        return np.sum([model.internal_force(u) for model in self._models], axis=0)

    def tangent(self, u: Array) -> csr_matrix:
        """Tangent stiffness [N/m]."""
        K, *more = (model.tangent(u) for model in self._models)
        return csr_matrix(sum(more, K))


def _decimal(array: Array) -> Exact:
    return np.array([Decimal(value) for value in array.ravel().tolist()], dtype=object).reshape(array.shape)


def _isotropic(inverse: Exact, lam: float, mu: float) -> Exact:
    """(k, k, k, k, nt) from the inverse metric."""
    mixed = np.einsum("imn,jpn->ijmpn", inverse, inverse)
    return Decimal(lam) * np.einsum("ijn,mpn->ijmpn", inverse, inverse) + Decimal(mu) * (mixed + np.swapaxes(mixed, 2, 3))


def _general(rest: Exact, tensor: Array) -> Exact:
    """(k, k, k, k, nt) from the tensors (n, k, k, k, k) in the simplices' own orthonormal axes."""
    own = rest if rest.shape[0] == rest.shape[1] else _in_own_axes(rest)
    dual, _ = _inverse(own)  # (component, spoke, nt)
    c = np.broadcast_to(np.moveaxis(_decimal(tensor), 0, -1), (*4 * (len(own),), own.shape[-1]))
    for _ in range(4):  # one axis after the other goes to the end of the four
        c = np.einsum("ajmpn,ain->jmpin", c, dual)
    return c


def _in_own_axes(rest: Exact) -> Exact:
    """(k, k, nt) components of the spokes (k, d, nt) in axes by Gram-Schmidt, as `reference.simplex_axes`."""
    axes: list[Exact] = []
    for spoke in rest:
        vector = spoke
        for axis in axes:
            vector = vector - (vector * axis).sum(axis=0) * axis
        axes.append(vector / _root((vector * vector).sum(axis=0)))
    return np.einsum("ixn,jxn->ijn", rest, np.stack(axes))


def _root(values: Exact) -> Exact:
    return np.array([value.sqrt() for value in values], dtype=object)


def _inverse(M: Exact) -> tuple[Exact, Exact]:
    """Inverses and determinants of matrices (n, n, ...) of size 1, 2 or 3, by cofactors."""
    n = len(M)
    if n == 1:
        return 1 / M, M[0, 0]

    def cofactor(i: int, j: int) -> Any:
        r, c = ([m for m in range(n) if m != left_out] for left_out in (i, j))
        minor = M[r[0], c[0]] if n == 2 else M[r[0], c[0]] * M[r[1], c[1]] - M[r[0], c[1]] * M[r[1], c[0]]
        return minor if (i + j) % 2 == 0 else -minor

    determinant = sum(M[0, j] * cofactor(0, j) for j in range(n))
    return np.stack([np.stack([cofactor(j, i) / determinant for j in range(n)]) for i in range(n)]), determinant
