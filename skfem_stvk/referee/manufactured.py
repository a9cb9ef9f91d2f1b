"""Manufactured solution of St. Venant-Kirchhoff elasticity, with its meshes and the errors of computed solutions.

    u_i = t A_i sin(k_i . X + c_i)         P = F S,  S = lam tr(E) I + 2 mu E,  E = (F'F - I)/2
    b_i = -P_iJ,J,   P_iJ,J = F_iM,J S_MJ + F_iM S_MJ,J
    S_MJ,J = lam E_NN,M + 2 mu E_MJ,J,     E_MJ,K = (F_iM,K F_iJ + F_iM F_iJ,K)/2

with F_iJ = delta_iJ + u_i,J and F_iJ,K = u_i,JK. In two dimensions (plane strain), only the first two components and coordinates
are used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from numpy.typing import ArrayLike

from ..arguments import Array
from ..mesh import ElementMesh

AMPLITUDE = np.array([0.08, -0.06, 0.05])
WAVES = np.array([[1.9, 1.1, -0.7], [-0.8, 2.1, 1.3], [1.2, -0.9, 2.0]])
PHASES = np.array([0.4, 1.3, -0.6])


@dataclass(frozen=True)
class Manufactured:
    """Manufactured solution for these Lame constants [Pa], as functions of points `x` (d, n) and a factor `t` of the amplitude."""

    lam: float
    mu: float

    def displacement(self, x: Array, t: float) -> Array:
        """Return `u` (d, n) at `x` (d, n)."""
        moved: Array = _amplitude(x, t) * np.sin(_phase(x))
        return moved

    def gradient(self, x: Array, t: float) -> Array:
        """Return `u_i,J` (d, d, n)."""
        return np.einsum("in,iJ->iJn", _amplitude(x, t) * np.cos(_phase(x)), _waves(x))

    def nominal_stress(self, x: Array, t: float) -> Array:
        """Return `P` (d, d, n) [Pa]."""
        F = self.gradient(x, t) + np.eye(len(x))[:, :, None]
        return np.einsum("iMn,MJn->iJn", F, self._stress(F))

    def body_force(self, x: Array, t: float) -> Array:
        """Return `b = -Div P` (d, n) [N/m^d]."""
        F = self.gradient(x, t) + np.eye(len(x))[:, :, None]
        dF = np.einsum("in,iJ,iK->iJKn", -_amplitude(x, t) * np.sin(_phase(x)), _waves(x), _waves(x))
        half = np.einsum("iMKn,iJn->MJKn", dF, F)
        dE = 0.5 * (half + half.swapaxes(0, 1))
        div_S = self.lam * np.einsum("NNMn->Mn", dE) + 2 * self.mu * np.einsum("MJJn->Mn", dE)
        return -np.einsum("iMJn,MJn->in", dF, self._stress(F)) - np.einsum("iMn,Mn->in", F, div_S)

    def _stress(self, F: Array) -> Array:
        """Return the second Piola-Kirchhoff stress (d, d, n)."""
        I = np.eye(len(F))[:, :, None]
        E = 0.5 * (np.einsum("iMn,iJn->MJn", F, F) - I)
        return self.lam * np.einsum("MMn->n", E) * I + 2 * self.mu * E

    def errors(self, mesh: Any, u: Array) -> tuple[float, float]:
        """Return the relative errors in L2 and in the H1 seminorm for nodal displacements `u` (ndofs,) at `t = 1`.

        The mesh has linear triangles or tetrahedra.
        """
        simplices, element = {2: (skfem.MeshTri, skfem.ElementTriP1), 3: (skfem.MeshTet, skfem.ElementTetP1)}[len(mesh.p)]
        basis = skfem.Basis(simplices(mesh.p, mesh.t), skfem.ElementVector(element()), intorder=4)
        x, weights = np.asarray(basis.global_coordinates()), basis.dx.ravel()
        found, points = basis.interpolate(u), x.reshape(len(mesh.p), -1)
        errors = []
        for part, exact in ((np.asarray(found), self.displacement(points, 1.0)), (found.grad, self.gradient(points, 1.0))):
            off = part.reshape(exact.shape) - exact
            errors.append(float(np.sqrt((off**2 @ weights).sum() / (exact**2 @ weights).sum())))
        return errors[0], errors[1]


def _amplitude(x: Array, t: float) -> Array:
    return t * AMPLITUDE[: len(x), None]


def _waves(x: Array) -> Array:
    return WAVES[: len(x), : len(x)]


def _phase(x: Array) -> Array:
    phase: Array = _waves(x) @ x + PHASES[: len(x), None]
    return phase


def moved_box(d: int, n: int) -> ElementMesh:
    """Return a mesh of the unit cube, square or line with `n^d` cells.

    Inner vertices are displaced by up to a fifth of a cell. Half of the elements have the opposite orientation.
    """
    lines, rng = [np.linspace(0, 1, n + 1)] * d, np.random.default_rng(1)
    mesh = skfem.MeshLine(lines[0]) if d == 1 else {2: skfem.MeshTri, 3: skfem.MeshTet}[d].init_tensor(*lines)
    inner = ((mesh.p > 0) & (mesh.p < 1)).all(axis=0)
    p, t = mesh.p + 0.2 / n * inner * rng.uniform(-1, 1, mesh.p.shape), mesh.t.copy()
    half = rng.random(t.shape[1]) < 0.5
    t[:2, half] = t[1::-1, half]
    return ElementMesh(p, t)


def fitted_order(sizes: ArrayLike, errors: ArrayLike) -> float:
    """Return the least-squares slope of `log(errors)` over `log(sizes)`, or NaN if an error is zero or not finite.

    >>> round(fitted_order([1, 1 / 2, 1 / 4], [3, 3 / 4, 3 / 16]), 12)
    2.0
    """
    x, y = np.asarray(sizes, dtype=float), np.asarray(errors, dtype=float)
    return float(np.polyfit(np.log(x), np.log(y), 1)[0]) if np.isfinite(y).all() and (y > 0).all() else np.nan
