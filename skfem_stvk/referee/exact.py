"""Reference values of W, F and K in 50 decimal digits, and by scikit-fem's assembly where it is accurate.

At each quadrature point the base vectors `D_i = sum_a dN_a/dxi_i X_a` are oblique axes, with the dual vectors
`g_i . D_j = delta_ij`. The deformed base vectors are `d_i`. For a linear simplex `D_i = X_i - X_0`.

    e_ij = 1/2 (d_i . d_j - D_i . D_j),  c_ijmn = C : g_i (x) g_j (x) g_m (x) g_n,  s_ij = c_ijmn e_mn
    V = weight sqrt(det D_i . D_j)
    W = sum V/2 s : e,   F_i = V sum_j s_ij d_j,   K_ij = V (s_ij I + sum_mn c_imjn d_m (x) d_n)
    F_a = sum_i dN_a/dxi_i F_i,   K_ab = sum_ij dN_a/dxi_i dN_b/dxi_j K_ij

For isotropic materials `c_ijmn = lam G_ij G_mn + mu (G_im G_jn + G_in G_jm)`, where `G` is the inverse of `D_i . D_j`. `K v` is the
derivative of F along v. Points and weights are the reference's doubles, taken as exact. The weight 1/k! of linear simplices is
computed in decimal numbers instead.

Python's decimal numbers have the same precision on every platform, while `longdouble` is a double on some. They are fast enough for
a patch.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal, localcontext
from functools import cached_property
from itertools import product
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_matrix, csr_matrix

from ..arguments import Array
from .bodies import reference_on
from .discretisation import Discretisation, Exact, Shape, derivatives
from .reference import KINDS, curved_elements
from .reference.kinds import middles
from .reference.one_point import hourglass_shapes

DIGITS = 50
CONTEXT = Context(prec=DIGITS)
#: Longest edge over smallest height beyond which round-off may cost more than 1e-12.
FLAT = 20.0
#: Largest number of points of such elements that are computed in 50 digits.
MOST_FLAT = 200


class ExactStVK:
    """W, F and K of elements in 50 decimal digits, each rounded to double once.

    Parameters
    ----------
    p
        (d, nv) coordinates, taken as exact.
    t
        (n, nt) nodes of the elements.
    tensor
        (nt, k, k, k, k) or (1, k, k, k, k) elasticity tensors in the elements' own axes times their section, or (nt, nq, k, k, k,
        k) at each point, as in `reference`. Alternatively, the Lame pair within the elements' dimensions, as numbers or decimal
        numbers (nt,).
    discretisation
        Kind of element and rule. The default is linear simplices with the number of nodes in `t`.
    control
        Result of `bodies.hourglass_control`, needed for mean gradients.
    """

    def __init__(
        self,
        p: Array,
        t: NDArray[np.int32],
        tensor: Array | tuple[float, float] | tuple[Exact, Exact],
        discretisation: Discretisation | None = None,
        control: Array | None = None,
    ) -> None:
        self.d, self.t, self.ndofs = len(p), t, p.size
        discretisation = Discretisation.of_simplices(len(t)) if discretisation is None else discretisation
        xi, weights = discretisation.points
        with localcontext(CONTEXT):
            self._tables, X = derivatives(discretisation.kind, xi), _straightened(p, t, discretisation.kind)
            self._rest = self._base_vectors(X)
            metric = np.einsum("ix...,jx...->ij...", self._rest, self._rest)
            inverse, determinant = _inverse(metric)
            exactly = (
                np.array([1 / Decimal(factorial(len(xi)))]) if KINDS[discretisation.kind].is_linear_simplex else _decimal(weights)
            )
            self._metric, self._volume = metric, _root(determinant) * exactly[:, None]
            self._control: tuple[Exact, Exact] | None = None
            if discretisation.is_one_point:
                assert control is not None
                self._take_means(X, KINDS[discretisation.kind].nodes, _decimal(control))
                inverse = np.broadcast_to(self._metric, (self.d, self.d, 1, t.shape[1]))
            self._moduli = _isotropic(inverse, *tensor) if isinstance(tensor, tuple) else _general(self._rest, tensor)

    def _take_means(self, X: Exact, nodes: Array, control: Exact) -> None:
        """Replace the gradients by mean gradients in the global axes, for nodes `X` (d, n, nt), and set gamma and its stiffness."""
        dual, _ = _inverse(self._rest)  # (component, base vector, nq, nt)
        volume = self._volume.sum(axis=0)
        mean = self._to_nodes(np.swapaxes(dual * self._volume, 0, 1)) / volume  # (n, d, nt)
        shapes = hourglass_shapes(nodes).astype(int)
        along = np.einsum("ka,xan->kxn", shapes, X - X[:, :1])
        gamma = shapes[:, :, None] - np.einsum("kxn,axn->kan", along, mean)
        self._control = gamma, control / 8 * volume * (mean * mean).sum(axis=(0, 1))
        self._tables, self._volume = mean[None], volume[None]
        identity = np.array([[Decimal(int(i == j)) for i in range(self.d)] for j in range(self.d)], dtype=object)
        self._rest = self._metric = np.repeat(identity[:, :, None, None], len(volume), axis=3)

    def energy_and_force(self, u: Array) -> tuple[float, Array]:
        """Return W and F (ndofs,) at `u` (ndofs,). The entries of `u` are taken as exact."""
        with localcontext(CONTEXT):
            x = self._at_nodes(u)
            d, e, s = self._state(x)
            energy = (self._volume * (s * e).sum(axis=(0, 1))).sum() / 2
            F = self._to_nodes(self._volume * np.einsum("ij...,jx...->ix...", s, d))
            if self._control is not None:
                hourglass = self._hourglass_force(x)
                energy, F = energy + (np.swapaxes(x, 0, 1) * hourglass).sum() / 2, F + hourglass
            return float(energy), self._summed(F)

    def energy(self, u: Array) -> float:
        """Return the strain energy [J]."""
        return self.energy_and_force(u)[0]

    def internal_force(self, u: Array) -> Array:
        """Return the internal force (ndofs,) [N]."""
        return self.energy_and_force(u)[1]

    def tangent(self, u: Array) -> csr_matrix:
        """Return the tangent stiffness [N/m]."""
        return of_blocks(self.pairs, self.blocks(u), self.ndofs)

    @cached_property
    def pairs(self) -> NDArray[np.int64]:
        """Pairs of nodes that share an element, including each node with itself, in lexicographic order, (2, m).

        Each pair has one block of K.
        """
        return self._pairs[0]

    @cached_property
    def _pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """`pairs`, and the index of the pair of each two nodes of the elements, (n, n, nt)."""
        own = np.broadcast_arrays(self.t[:, None].astype(np.int64), self.t[None].astype(np.int64))
        pairs, of = np.unique(np.stack([one.ravel() for one in own]), axis=1, return_inverse=True)
        return pairs, of.reshape(own[0].shape)

    def blocks(self, u: Array) -> Array:
        """Return the blocks of K that belong to `pairs` [N/m], (m, d, d)."""
        with localcontext(CONTEXT):
            d, _, s = self._state(self._at_nodes(u))
            K = np.einsum("ixjp...,py...->ixjy...", np.einsum("imjp...,mx...->ixjp...", self._moduli, d), d)
            for x in range(self.d):
                K[:, x, :, x] += s
            K = np.moveaxis(self._volume * K, 2, 0)  # (base vector, base vector, component, component, nq, nt)
            columns = (_times(self._tables[:, b], K) for b in range(len(self.t)))
            values = np.stack([self._to_nodes(column) for column in columns], axis=2)  # (n, d, n, d, nt)
            if self._control is not None:
                gamma, stiffness = self._control
                for x in range(self.d):
                    values[:, x, :, x] += np.einsum("n,kan,kbn->abn", stiffness, gamma, gamma)
            pairs, of = self._pairs
            total = np.full((pairs.shape[1], self.d, self.d), Decimal(0), dtype=object)
            np.add.at(total, of, values.transpose(0, 2, 4, 1, 3))
            return np.asarray(total.astype(float))

    def edge_form(self, local_edges: Sequence[tuple[int, int]]) -> Exact:
        """Return the coefficients `L` (m, m, nt) of `W = 1/4 sum L_ij zeta_i zeta_j` of linear simplices, for m `local_edges`.

        `2 e_ii` is the zeta of the edge (0, i). `4 e_ij` is the sum of the zeta of (0, i) and (0, j) minus that of (i, j). Unlike
        all other results, the coefficients are returned in decimal numbers.
        """
        k, m = len(self._rest), len(local_edges)
        number = {frozenset(edge): a for a, edge in enumerate(local_edges)}
        with localcontext(CONTEXT):
            B = np.full((k, k, m), Decimal(0), dtype=object)  # e_ij = sum_a B_ija zeta_a
            for i, j in product(range(k), repeat=2):
                if i == j:
                    B[i, i, number[frozenset((0, i + 1))]] = Decimal("0.5")
                else:
                    for edge, factor in (((0, i + 1), "0.25"), ((0, j + 1), "0.25"), ((i + 1, j + 1), "-0.25")):
                        B[i, j, number[frozenset(edge)]] = Decimal(factor)
            half = np.einsum("ijpqn,pqb->ijbn", self._moduli[..., 0, :], B)
            return np.asarray(2 * self._volume * np.einsum("ija,ijbn->abn", B, half))

    def inverse_triangles(self) -> tuple[Array, Array]:
        """Return the inverses (nt, nq, k, k) of the upper triangles R with `dX/dxi = axes R` [1/m], and the measures (nt, nq).

        The axes are those of Gram and Schmidt, as in `reference.element_axes`, also for elements with k = d.
        """
        with localcontext(CONTEXT):
            inverse, _ = _inverse(_in_own_axes(self._rest))
            return np.asarray(inverse.transpose(3, 2, 1, 0).astype(float)), np.asarray(self._volume.T.astype(float))

    def product(self, u: Array, v: Array) -> Array:
        """Return `K(u) v` (ndofs,) [N]."""
        with localcontext(CONTEXT):
            y = self._at_nodes(v)
            (d, _, s), dd = self._state(self._at_nodes(u)), self._base_vectors(y)
            ds = np.einsum("ijmp...,mx...,px...->ij...", self._moduli, d, dd)
            f = self._to_nodes(self._volume * (np.einsum("ij...,jx...->ix...", ds, d) + np.einsum("ij...,jx...->ix...", s, dd)))
            return self._summed(f if self._control is None else f + self._hourglass_force(y))

    def _at_nodes(self, u: Array) -> Exact:
        """Return the values (d, n, nt) of a vector (ndofs,) at the nodes of the elements."""
        return _decimal(u.reshape(-1, self.d).T)[:, self.t]

    def _state(self, x: Exact) -> tuple[Exact, Exact, Exact]:
        """Return deformed base vectors (k, d, nq, nt), and strains and stresses (k, k, nq, nt) in the oblique axes.

        The displacements have the shape (d, n, nt).
        """
        d = self._rest + self._base_vectors(x)
        e = (np.einsum("ix...,jx...->ij...", d, d) - self._metric) / 2
        return d, e, np.einsum("ijmp...,mp...->ij...", self._moduli, e)

    def _hourglass_force(self, x: Exact) -> Exact:
        """Return the forces (n, d, nt) of the hourglass control at displacements (d, n, nt)."""
        assert self._control is not None
        gamma, stiffness = self._control
        return np.asarray(stiffness * np.einsum("kan,kxn->axn", gamma, np.einsum("kan,xan->kxn", gamma, x)))

    def _base_vectors(self, x: Exact) -> Exact:
        """Return the derivatives (k, d, nq, nt) along the reference coordinates, for a field at the nodes (d, n, nt)."""
        return np.stack([_times(table, np.swapaxes(x, 0, 1)[:, :, None]) for table in np.moveaxis(self._tables, 2, 0)])

    def _to_nodes(self, f: Exact) -> Exact:
        """Return the nodal forces (n, ..., nt) for forces on the base vectors (k, ..., nq, nt)."""
        return np.stack([_times(table, f).sum(axis=-2) for table in np.moveaxis(self._tables, 1, 0)])

    def _summed(self, f: Exact) -> Array:
        """Return the sums (ndofs,) of forces on the nodes of the elements (n, d, nt)."""
        F = np.full((self.ndofs // self.d, self.d), Decimal(0), dtype=object)
        np.add.at(F, self.t, np.swapaxes(f, 1, 2))
        return F.astype(float).ravel()


def of_blocks(pairs: NDArray[np.int64], blocks: Array, ndofs: int) -> csr_matrix:
    """Return the matrix (ndofs, ndofs) from blocks (m, d, d) for pairs (2, m) of nodes in lexicographic order."""
    first, second = pairs
    starts = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=ndofs // blocks.shape[1]))])
    return csr_matrix(bsr_matrix((blocks, second, starts), shape=(ndofs, ndofs)).tocsr())


def _times(table: Exact, values: Exact) -> Exact:
    """Return the sum over `a` of `table[:, a]` (nq,) or (nq, nt) times `values[a]` (..., nq, nt).

    Columns of zeros are skipped, because a table may consist mostly of zeros.
    """
    columns = [column if column.ndim == 2 else column[:, None] for column in np.moveaxis(table, 1, 0)]
    return np.asarray(sum(column * values[a] for a, column in enumerate(columns) if column.any()))


class Truth:
    """W, F and K of a body, by the reference and, for flat elements, in 50 digits. Elasticity tensors are as in the reference.

    Attributes
    ----------
    exact
        Ids of the elements that are computed in 50 digits: those with an aspect ratio beyond `FLAT`, at most the flattest ones with
        `MOST_FLAT` points in total.
    """

    def __init__(self, shape: Shape, tensor: Array, control: Array | None = None) -> None:
        mesh, discretisation = shape.mesh, shape.discretisation
        flattest = np.argsort(-shape.aspect, kind="stable")[: MOST_FLAT // shape.measure.shape[1]]
        self.exact = flattest[shape.aspect[flattest] > FLAT]
        others = np.setdiff1d(np.arange(mesh.nt), self.exact)
        self._models: list[Any] = []
        for make, elements in ((reference_on, others), (ExactStVK, self.exact)):
            if len(elements):
                own = tensor if len(tensor) == 1 else tensor[elements]
                self._models.append(
                    make(mesh.p, mesh.t[:, elements], own, discretisation, None if control is None else control[elements])
                )

    def described(self) -> str:
        """Return a description of the computation, for the head of a report."""
        count = len(self.exact)
        flattest = f"the {count} flattest elements" if count > 1 else "the flattest element"
        return f"scikit-fem; {flattest} in 50 digits" if count else "scikit-fem"

    def energy(self, u: Array) -> float:
        """Return the strain energy [J]."""
        return sum(model.energy(u) for model in self._models)

    def internal_force(self, u: Array) -> Array:
        """Return the internal force (ndofs,) [N]."""
        return np.sum([model.internal_force(u) for model in self._models], axis=0)

    def tangent(self, u: Array) -> csr_matrix:
        """Return the tangent stiffness [N/m]."""
        K, *more = (model.tangent(u) for model in self._models)
        return csr_matrix(sum(more, K))


def _straightened(p: Array, t: NDArray[np.int32], kind: str) -> Exact:
    """Return the coordinates of the nodes (d, n, nt). Mid-edge nodes of straight edges are moved to the exact midpoint."""
    X = _decimal(p)[:, t]
    straight = ~curved_elements(p, t, kind)
    for middle, (a, b) in middles(kind):
        X[:, middle, straight] = (X[:, a, straight] + X[:, b, straight]) / 2
    return X


def _decimal(array: Array) -> Exact:
    return np.array([Decimal(value) for value in array.ravel().tolist()], dtype=object).reshape(array.shape)


def _isotropic(inverse: Exact, lam: float | Exact, mu: float | Exact) -> Exact:
    """Return the isotropic moduli (k, k, k, k, nq, nt) from the inverse metric."""
    first, second = (value if isinstance(value, np.ndarray) else Decimal(value) for value in (lam, mu))
    mixed = np.einsum("im...,jp...->ijmp...", inverse, inverse)
    return np.asarray(first * np.einsum("ij...,mp...->ijmp...", inverse, inverse) + second * (mixed + np.swapaxes(mixed, 2, 3)))


def _general(rest: Exact, tensor: Array) -> Exact:
    """Return the moduli (k, k, k, k, nq, nt) in the oblique axes.

    They are computed from tensors (n, k, k, k, k) or (n, nq, k, k, k, k) in the elements' own orthonormal axes.
    """
    own = rest if rest.shape[0] == rest.shape[1] else _in_own_axes(rest)
    dual, _ = _inverse(own)  # (component, base vector, nq, nt)
    each = tensor if tensor.ndim == 6 else tensor[:, None]
    c = np.broadcast_to(np.moveaxis(_decimal(each), (0, 1), (-1, -2)), (*4 * (len(own),), *own.shape[2:]))
    for _ in range(4):  # transform the first of the four axes, and move it to the end
        c = np.einsum("ajmp...,ai...->jmpi...", c, dual)
    return c


def _in_own_axes(rest: Exact) -> Exact:
    """Return components (k, k, nq, nt) of base vectors (k, d, nq, nt) in axes by Gram-Schmidt, as `reference.element_axes`."""
    axes: list[Exact] = []
    for base_vector in rest:
        vector = base_vector
        for axis in axes:
            vector = vector - (vector * axis).sum(axis=0) * axis
        axes.append(vector / _root((vector * vector).sum(axis=0)))
    return np.einsum("ix...,jx...->ij...", rest, np.stack(axes))


def _root(values: Exact) -> Exact:
    return np.array([value.sqrt() for value in values.ravel()], dtype=object).reshape(values.shape)


def _inverse(M: Exact) -> tuple[Exact, Exact]:
    """Return inverses and determinants of matrices (n, n, ...) of size 1, 2 or 3, by cofactors."""
    n = len(M)
    if n == 1:
        return 1 / M, M[0, 0]

    def cofactor(i: int, j: int) -> Any:
        r, c = ([m for m in range(n) if m != left_out] for left_out in (i, j))
        minor = M[r[0], c[0]] if n == 2 else M[r[0], c[0]] * M[r[1], c[1]] - M[r[0], c[1]] * M[r[1], c[0]]
        return minor if (i + j) % 2 == 0 else -minor

    determinant = sum(M[0, j] * cofactor(0, j) for j in range(n))
    return np.stack([np.stack([cofactor(j, i) / determinant for j in range(n)]) for i in range(n)]), determinant
