"""W and F of St. Venant-Kirchhoff simplices in extended precision by the textbook formulas, independent of the package.

`P` (d, k) has the base vectors from the first vertex to the others as columns, `U` has their displacements, and `p = P + U`:

    E = 1/2 (P'U + U'P + U'U)        S = lam tr(G E) G + 2 mu G E G,  G = (P'P)^-1        V = sqrt(det P'P) / k!
    W = sum of V/2 S : E             f_i = V sum_j S_ij p_j on vertex i, minus their sum on the first vertex

The components are covariant, so that the formulas also hold for k < d. Numbers of 80 bits do not overflow at scales of 1e150, and
their round-off is small compared with the tolerances of the judges.
"""

from __future__ import annotations

from math import factorial

import numpy as np
from numpy.typing import ArrayLike

from skfem_stvk import ElementMesh
from skfem_stvk.arguments import Array


class ExtendedStVK:
    """Simplices with one isotropic material.

    Parameters
    ----------
    young, poisson, section, density
        Constants of the material. `section` is the area of segments, the thickness of triangles, and 1 for tetrahedra.
    condensed
        Whether triangles in the plane have plane stress. Triangles in space always have plane stress.
    """

    def __init__(
        self, mesh: ElementMesh, young: float, poisson: float, section: float = 1.0, density: float = 1.0, condensed: bool = False
    ) -> None:
        self.mesh, x = mesh, long(mesh.p.T)[mesh.t.T]
        self.P = x[:, 1:] - x[:, :1]
        metric = self.P @ np.swapaxes(self.P, 1, 2)
        adjugate, determinant = inverse(metric)
        self.G, volume = adjugate / determinant[:, None, None], np.sqrt(determinant) / factorial(mesh.k) * long(section)
        E, nu = long(young), long(poisson)
        mu = E / 2 / (1 + nu) if mesh.k > 1 else E / 2
        lam = long(0.0) if mesh.k == 1 else 2 * mu * nu / (1 - (1 if condensed or mesh.k < mesh.d else 2) * nu)
        self.V, self.lam, self.mu = volume, lam, mu
        shares = np.repeat(long(density) * volume / (mesh.k + 1), mesh.k + 1)
        self.mass: Array = np.zeros(mesh.nv, dtype=np.longdouble)
        np.add.at(self.mass, mesh.t.T.ravel(), shares)

    def energy(self, u: ArrayLike) -> np.longdouble:
        """Return the strain energy `W(u)` [J]."""
        _, E, S = self._state(u)
        return np.longdouble((self.V * (S * E).sum(axis=(1, 2))).sum() / 2)

    def force(self, u: ArrayLike) -> Array:
        """Return the internal force `F(u)` (nv, d) [N]."""
        return self._summed(self._element_forces(u))

    def magnitude(self, u: ArrayLike) -> Array:
        """Return the sum of the absolute values of the terms of `F(u)` (nv, d) [N]."""
        return self._summed(np.abs(self._element_forces(u)))

    def volume_ratios(self, u: ArrayLike) -> Array:
        """Return the determinants of the deformation gradient (nt,), for k = d."""
        p, _, _ = self._state(u)
        return inverse(p)[1] / inverse(self.P)[1]

    def _state(self, u: ArrayLike) -> tuple[Array, Array, Array]:
        at = long(u).reshape(-1, self.mesh.d)[self.mesh.t.T]
        U = at[:, 1:] - at[:, :1]
        mixed = self.P @ np.swapaxes(U, 1, 2)
        E = (mixed + np.swapaxes(mixed, 1, 2) + U @ np.swapaxes(U, 1, 2)) / 2
        mixed = self.G @ E
        trace = np.trace(mixed, axis1=1, axis2=2)[:, None, None]
        return self.P + U, E, self.lam * trace * self.G + 2 * self.mu * mixed @ self.G

    def _element_forces(self, u: ArrayLike) -> Array:
        """Return the forces of each element on its vertices (nt, k + 1, d)."""
        p, _, S = self._state(u)
        f = self.V[:, None, None] * (S @ p)
        return np.concatenate([-f.sum(axis=1, keepdims=True), f], axis=1)

    def _summed(self, forces: Array) -> Array:
        total = np.zeros((self.mesh.nv, self.mesh.d), dtype=np.longdouble)
        np.add.at(total, self.mesh.t.T.ravel(), forces.reshape(-1, self.mesh.d))
        return total


def long(values: ArrayLike) -> Array:
    """Return the values as numbers of 80 bits."""
    return np.asarray(values, dtype=np.longdouble)


def inverse(A: Array) -> tuple[Array, Array]:
    """Return adjugates (n, k, k) and determinants (n,) of matrices with at most three rows.

    NumPy's `linalg` does not support this precision.
    """
    k = A.shape[1]
    if k == 1:
        return np.ones_like(A), A[:, 0, 0]
    if k == 2:
        (a, b), (c, d) = np.moveaxis(A, 0, 2)
        return np.moveaxis(np.array([[d, -b], [-c, a]]), 2, 0), a * d - b * c
    rows = [np.cross(A[:, (i + 1) % 3], A[:, (i + 2) % 3]) for i in range(3)]
    return np.stack(rows, axis=2), (A[:, 0] * rows[0]).sum(axis=1)
