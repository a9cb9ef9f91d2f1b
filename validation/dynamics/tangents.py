"""Tangents of energy-momentum: the exact, unsymmetric tangent against the symmetric tangent of the package.

With `t = L (zeta_0 + zeta_1)/2` and G(u) (ne, ndofs) the matrix of `p_i(u) . (v_a - v_b)`, the force of the step is `f = G(u_mid)'
t`, so that

    df/du_1 = G(u_mid)' L G(u_1) + 1/2 sum t_i (e_a - e_b)(e_a - e_b)'
    symmetric = G(u_mid)' L G(u_mid) + 1/2 sum t_i(u_0) (e_a - e_b)(e_a - e_b)'

This file assembles the exact tangent from sparse matrices, only to count iterations. The package does not contain it. If an
iteration does not halve the residual, the package also omits the tensions.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, diags, kron
from scipy.sparse.linalg import splu

from skfem_stvk import System
from skfem_stvk.edges import ALL, NONE, EdgeForm
from skfem_stvk.solvers.dynamics import EnergyMomentum, simulate
from skfem_stvk.solvers.dynamics.critical_step import critical_step
from skfem_stvk.solvers.dynamics.forces import add_mean_force

from ..statics.study import Study
from .scenes import Array, cantilever

#: Time steps in critical steps, and the number of steps.
TIMES, STEPS = (1, 10, 30, 100), 30
RTOL, MOST = 1e-10, 60
#: Solvers of the package that are timed; the second is its default. The exact tangent needs the first.
SOLVERS = ("superlu", "ssor-cg")
#: The claim of less time holds up to this number of critical steps; above it, the symmetric tangent converges slowly.
USUAL = 30
#: Largest ratio of iterations with the symmetric tangent to iterations with the exact one.
MORE = 2.5


class EnergyMomentumSteps:
    """Steps of energy-momentum by Newton's method with either tangent, for one elastic term and dead loads."""

    def __init__(self, system: System, symmetric: bool) -> None:
        self._system, self._symmetric = system, symmetric
        (term,) = system.elastic_terms
        self._form: EdgeForm = term.bind(system.mesh).form
        self._free = np.setdiff1d(np.arange(system.ndofs), system.supports.held)
        edges, ne = self._form.edges, self._form.edges.shape[1]
        rows = np.tile(np.arange(ne), 2)
        self._incidence = csr_matrix((np.repeat([1.0, -1.0], ne), (rows, edges.ravel())), shape=(ne, system.mesh.nv))
        self._mass = np.repeat(system.mass().vertex, system.mesh.d)
        self._load = system.external_force(np.zeros(system.ndofs))
        self.iterations = 0

    def step(self, u0: Array, v0: Array, h: float) -> tuple[Array, Array]:
        """Return displacements and velocities after a step.

        Raises
        ------
        RuntimeError
            if Newton's method does not converge.
        """
        w = np.zeros_like(u0)
        w[self._free] = h * v0[self._free]
        for _ in range(MOST):
            force = np.zeros_like(u0)
            add_mean_force(self._system, u0, u0 + w, force)
            parts = 2 / h**2 * self._mass * w, -2 / h * self._mass * v0, force, -self._load
            residual = np.sum(parts, axis=0)[self._free]
            if np.linalg.norm(residual) <= RTOL * sum(np.linalg.norm(part[self._free]) for part in parts):
                return u0 + w, 2 * w / h - v0
            K = diags(2 / h**2 * self._mass) + self.tangent(u0, u0 + w)
            w[self._free] -= splu(K.tocsr()[np.ix_(self._free, self._free)].tocsc()).solve(residual)
            self.iterations += 1
        raise RuntimeError(f"Newton's method did not converge in {MOST} iterations.")

    def tangent(self, u0: Array, u1: Array) -> csr_matrix:
        """Return the tangent of the force of the step [N/m], (ndofs, ndofs)."""
        form, d = self._form, self._system.mesh.d
        x0, x1 = u0.reshape(-1, d), u1.reshape(-1, d)
        middle = (x0 + x1) / 2
        if self._symmetric:
            with_tensions, without = (self._system.jacobian(u0, kept=kept) for kept in (ALL, NONE))
            return csr_matrix((self._system.jacobian(middle.ravel(), kept=NONE) + with_tensions - without) / 2)
        t = form.L @ (form.squared_elongations(x0) + form.squared_elongations(x1)) / 2
        laplacian = self._incidence.T @ diags(t) @ self._incidence
        return csr_matrix(self._vectors(middle).T @ form.L @ self._vectors(x1) + kron(laplacian, np.eye(d)) / 2)

    def _vectors(self, x: Array) -> csr_matrix:
        """Return G, (ne, ndofs)."""
        p, d = self._form.P + self._form.differences(x), self._system.mesh.d
        by_component = kron(self._incidence, np.ones((1, d))).tocsr()
        return csr_matrix(by_component.multiply(np.tile(p, (1, self._system.mesh.nv))))


class Finding(NamedTuple):
    """Time step in critical steps, and the cost with each tangent.

    Iterations per step with the exact tangent, with the symmetric tangent, and in the package; times of the package by solver [ms
    per step].
    """

    times: float
    dt: float
    exact: float
    symmetric: float
    package: float
    milliseconds: dict[str, float]

    @property
    def with_exact(self) -> float:
        """Estimated time of a step with the exact tangent [ms], if an iteration took as long as with the symmetric one."""
        return self.exact / self.package * self.milliseconds[SOLVERS[0]]


def tangents(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Compare iterations and times of energy-momentum with the symmetric tangent and with the exact, unsymmetric one."""
    system = cantilever(2 if quick else 4)
    critical = critical_step(system).step
    found = [_finding(system, times, times * critical) for times in (TIMES[:3:2] if quick else TIMES)]
    rows = [
        (
            f"{one.times:g}",
            f"{1e3 * one.dt:.3g}",
            f"{one.exact:.2f}",
            f"{one.symmetric:.2f}",
            f"{one.package:.2f}",
            f"{one.with_exact:.1f}",
            *(f"{one.milliseconds[solver]:.1f}" for solver in SOLVERS),
        )
        for one in found
    ]
    iterations = f"the symmetric tangent takes at most {MORE:g} times the iterations of the exact one"
    times = f"; up to {USUAL} critical steps, conjugate gradients take less time than the exact tangent, which needs LU"
    failures = [
        f"{one.times:g} times the critical step: {one.package:.2f} iterations, with the exact tangent {one.exact:.2f}"
        for one in found
        if not one.package <= MORE * one.exact
    ]
    failures += [
        f"{one.times:g} times the critical step: {one.milliseconds[SOLVERS[1]]:.1f} ms per step, with the exact tangent "
        f"{one.with_exact:.1f} ms"
        for one in found
        if not quick and one.times <= USUAL and not one.milliseconds[SOLVERS[1]] <= one.with_exact
    ]
    return (
        Study(
            "Tangents of energy and momentum",
            iterations + ("" if quick else times),
            (
                "dt/critical",
                "dt in ms",
                "iterations: exact",
                "symmetric",
                "package",
                "ms per step: exact, LU",
                "package, LU",
                "package, CG",
            ),
            tuple(rows),
            tuple(failures),
            (
                f"{system!r}, released under its weight, {STEPS} steps, rtol = {RTOL:g}",
                "time of the exact tangent: its iterations times the package's time per iteration with LU, as if an "
                "unsymmetric matrix cost no more; CG cannot solve with it",
            ),
        ),
    )


def _finding(system: System, times: float, dt: float) -> Finding:
    exact, symmetric = (_iterations(system, dt, symmetric) for symmetric in (False, True))
    milliseconds, package = {}, 0.0
    for solver in SOLVERS:
        integrator = EnergyMomentum(dt=dt, rtol=RTOL, solver=solver)
        begin = perf_counter()
        run = simulate(system, integrator, until=STEPS * dt, quiet=True)
        milliseconds[solver] = 1e3 * (perf_counter() - begin) / STEPS
        package = run.iterations / STEPS if solver == "superlu" else package
    return Finding(times, dt, exact, symmetric, package, milliseconds)


def _iterations(system: System, dt: float, symmetric: bool) -> float:
    """Return Newton's iterations per step; NaN if it fails (the package would use a line search or a smaller step)."""
    exact, u, v = EnergyMomentumSteps(system, symmetric), np.zeros(system.ndofs), np.zeros(system.ndofs)
    try:
        for _ in range(STEPS):
            u, v = exact.step(u, v, dt)
    except RuntimeError:
        return float("nan")
    return exact.iterations / STEPS
