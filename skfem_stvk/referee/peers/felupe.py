"""FElupe, which assembles with NumPy contractions over all elements."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array
from . import lame, require


class FElupe:
    """Peer that uses a `SolidBody` of `RegionTetra` with one quadrature point and one thread. See `Peer`.

    Elements with ten nodes use `RegionQuadraticTetra` with four points. FElupe needs tetrahedra of positive orientation, so two
    vertices of the others are exchanged. The law is written in closed form, as FElupe's own compressible laws are. The general
    class for the same law, `MaterialStrain`, takes about 1.5 times as long.
    """

    name = "FElupe"

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None:
        felupe = require("FElupe")
        self.version: str = felupe.__version__
        edges = p[:, t[1:4]] - p[:, t[:1]]
        cells, quadratic = t.T.copy(), len(t) == 10
        turned = np.linalg.det(np.moveaxis(edges, 2, 0)) < 0
        order = [1, 0, 2, 3, 4, 6, 5, 8, 7, 9] if quadratic else [1, 0, 2, 3]
        cells[turned] = cells[turned][:, order]
        kind, region_of = ("tetra10", felupe.RegionQuadraticTetra) if quadratic else ("tetra", felupe.RegionTetra)
        region = region_of(felupe.Mesh(np.ascontiguousarray(p.T, dtype=float), cells, kind))
        self._field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        self._umat = _law(felupe, *lame(young, poisson))
        self._solid = felupe.SolidBody(self._umat, self._field)
        self._volumes = region.dV
        self.tangent(np.zeros(p.size))  # FElupe creates and caches its pattern of K

    def energy(self, u: Array) -> float:
        density = self._umat.function(self._at(u).extract(out=self._solid.results.kinematics))[0]
        return float(np.vdot(density, self._volumes))

    def internal_force(self, u: Array) -> Array:
        force: Array = self._solid.assemble.vector(self._at(u), parallel=False).toarray().ravel()
        return force

    def tangent(self, u: Array) -> csr_matrix:
        return self._solid.assemble.matrix(self._at(u), parallel=False)

    def _at(self, u: Array) -> Any:
        self._field[0].values[:] = u.reshape(-1, 3)
        return self._field


def _law(felupe: Any, lam: float, mu: float) -> Any:
    """Return St. Venant-Kirchhoff's law for FElupe.

    `P = F S` and `A_iJkL = lambda F_iJ F_kL + mu (F_iL F_kJ + (F F')_ik delta_JL) + delta_ik S_JL`.
    """

    class Law(felupe.ConstitutiveMaterial):
        def __init__(self) -> None:
            self.x = [np.eye(3), np.zeros(0)]

        def function(self, x: list[Array]) -> list[Array]:
            E = self._strain(x[0])
            return [0.5 * lam * np.einsum("ii...->...", E) ** 2 + mu * np.einsum("ij...,ij...->...", E, E)]

        def _gradient(self, x: list[Array]) -> list[Array]:
            return [np.einsum("iM...,MJ...->iJ...", x[0], self._stress(x[0])), x[-1]]

        def _hessian(self, x: list[Array]) -> list[Array]:
            F = x[0]
            S = self._stress(F)
            b = mu * np.einsum("iM...,kM...->ik...", F, F)
            A = np.einsum("iJ...,kL...->iJkL...", lam * F, F)
            A += np.einsum("iL...,kJ...->iJkL...", mu * F, F)
            for i in range(3):
                A[:, i, :, i] += b
                A[i, :, i] += S
            return [A]

        def _stress(self, F: Array) -> Array:
            E = self._strain(F)
            S = 2 * mu * E
            trace = lam * np.einsum("ii...->...", E)
            for i in range(3):
                S[i, i] += trace
            return S

        @staticmethod
        def _strain(F: Array) -> Array:
            E: Array = np.einsum("kI...,kJ...->IJ...", F, F)
            for i in range(3):
                E[i, i] -= 1
            E *= 0.5
            return E

    return Law()
