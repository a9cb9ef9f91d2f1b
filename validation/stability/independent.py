"""Limit loads by displacement control on scikit-fem's elements, independent of the edge form and of the arc-length method."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.sparse import bmat, bsr_matrix, coo_matrix, csr_matrix
from scipy.sparse.linalg import splu

from skfem_stvk.arguments import Array

from .not_found import NotFoundError

#: Function of a basis and a discrete field that returns the gradient (3, 3, nt, nq).
Gradient = Callable[[Any, Any], Array]

I3 = np.eye(3)
#: Relative tolerance and largest number of iterations of Newton's method. The scale is the internal force with reactions.
RTOL, MOST = 1e-9, 30


def cartesian(basis: skfem.Basis, v: Any) -> Array:
    """Return the gradient of a displacement in the plane or in space, padded to (3, 3, nt, nq)."""
    grad = np.asarray(v.grad)
    across = 3 - len(grad)
    return np.pad(grad, ((0, across), (0, across), (0, 0), (0, 0)))


def axisymmetric(basis: skfem.Basis, v: Any) -> Array:
    """Return the gradient in the coordinates (r, z, theta) of a displacement in the half plane r > 0."""
    gradient = cartesian(basis, v)
    gradient[2, 2] = np.asarray(v)[0] / np.asarray(basis.global_coordinates())[0]
    return gradient


class Point(NamedTuple):
    """Equilibrium: controlled displacement `w` [m], load factor `t`, displacements `u`, and derivatives of `t` and `u` by `w`."""

    w: float
    t: float
    u: Array
    slope: float
    rate: Array


@dataclass(frozen=True)
class Body:
    """Elastic body under a dead load with one load factor.

    Parameters
    ----------
    basis
        Basis of vector elements.
    lam, mu
        Lame constants [Pa].
    load
        (N,) nodal forces at the load factor 1 [N].
    free
        Unconstrained degrees of freedom.
    control
        Degree of freedom with prescribed displacement.
    gradient
        `cartesian` or `axisymmetric`.
    """

    basis: skfem.Basis
    lam: float
    mu: float
    load: Array
    free: NDArray[np.int64]
    control: int
    gradient: Gradient = cartesian

    def force_and_tangent(self, u: Array) -> tuple[Array, csr_matrix]:
        """Return the internal force (N,) [N] and the tangent (N, N) [N/m].

        They are the integrals of `P : grad v` and `grad du : dP/dF : grad v`.
        """
        F = (self._gradients @ u).reshape(-1, 3, 3) + I3
        S = self._stress((F.swapaxes(1, 2) @ F - I3) / 2)
        dF = np.eye(9).reshape(9, 1, 3, 3)
        dE = F.swapaxes(1, 2) @ dF
        dP = dF @ S + F @ self._stress((dE + dE.swapaxes(2, 3)) / 2)
        moduli = self._weights[:, None, None] * dP.reshape(9, -1, 9).transpose(1, 0, 2)
        blocks = np.arange(len(F) + 1)
        force = self._gradients.T @ (self._weights[:, None, None] * (F @ S)).ravel()
        return force, csr_matrix(self._gradients.T @ bsr_matrix((moduli, blocks[:-1], blocks)) @ self._gradients)

    def _stress(self, E: Array) -> Array:
        """Return the second Piola-Kirchhoff stress [Pa]."""
        return self.lam * np.trace(E, axis1=-2, axis2=-1)[..., None, None] * I3 + 2 * self.mu * E

    @cached_property
    def _weights(self) -> Array:
        """Volumes of the quadrature points (n,)."""
        weights = np.asarray(self.basis.dx)
        if self.gradient is axisymmetric:
            weights = weights * 2 * np.pi * np.asarray(self.basis.global_coordinates())[0]
        return weights.ravel()

    @cached_property
    def _gradients(self) -> csr_matrix:
        """Matrix (9 n, N) from displacements to gradients at the quadrature points."""
        points = np.arange(self.basis.dx.size).reshape(self.basis.dx.shape)
        rows, columns, values = [], [], []
        for i, (v,) in enumerate(self.basis.basis):
            gradient = self.gradient(self.basis, v)
            rows.append(9 * points + np.arange(9).reshape(3, 3, 1, 1))
            columns.append(np.broadcast_to(self.basis.element_dofs[i][:, None], gradient.shape))
            values.append(gradient)
        entries = (np.ravel(part) for part in (values, rows, columns))
        data, row, column = entries
        return coo_matrix((data, (row, column)), shape=(9 * points.size, self.basis.N)).tocsr()


def path(body: Body, displacements: Array) -> Iterator[Point]:
    """Yield the equilibria at these displacements of the controlled degree of freedom, starting from rest."""
    point = Point(0.0, 0.0, body.basis.zeros(), 0.0, body.basis.zeros())
    for w in displacements:
        point = equilibrium(body, point, float(w))
        yield point


def limit_point(body: Body, displacements: Array) -> Point:
    """Return the first state on the path at which the derivative of the load factor vanishes.

    Raises
    ------
    NotFoundError
        if there is no limit point between these displacements.
    """
    for before, after in pairwise(path(body, displacements)):
        if before.slope * after.slope <= 0:
            return _between(body, before, after)
    raise NotFoundError("There is no limit point on the path by displacement control.")


def _between(body: Body, before: Point, after: Point) -> Point:
    def slope(w: float) -> float:
        return equilibrium(body, before, w).slope

    return equilibrium(body, before, brentq(slope, before.w, after.w, xtol=1e-13, rtol=1e-12))


def equilibrium(body: Body, start: Point, w: float) -> Point:
    """Return the equilibrium with the controlled displacement `w`, by Newton's method for displacements and load factor."""
    u, t = start.u + (w - start.w) * start.rate, start.t + (w - start.w) * start.slope
    free, load = body.free, body.load[body.free]
    column = csr_matrix(load[:, None])
    row = csr_matrix((free == body.control).astype(float)[None])
    last = np.append(np.zeros(len(free)), 1.0)
    for _ in range(MOST):
        force, K = body.force_and_tangent(u)
        residual = np.append(force[free] - t * load, u[body.control] - w)
        bordered = splu(bmat([[K[free][:, free], -column], [row, None]], format="csc"))
        if np.linalg.norm(residual[:-1]) <= RTOL * np.linalg.norm(force) and abs(residual[-1]) <= RTOL * abs(w):
            rate = np.zeros_like(u)
            solution = bordered.solve(last)
            rate[free] = solution[:-1]
            return Point(w, t, u, float(solution[-1]), rate)
        step = bordered.solve(-residual)
        u[free] += step[:-1]
        t += step[-1]
    raise NotFoundError(f"Displacement control found no equilibrium at w = {w:g}.")
