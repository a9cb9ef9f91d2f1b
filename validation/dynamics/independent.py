"""Short motions by scikit-fem's assembly and SciPy's DOP853 with tight tolerances, which share no code with this package.

Edges, masses and integrators are independent. Unstructured bodies, clamped at one side, start under gravity with an initial spin,
with lumped and consistent masses. Results of integrators are extrapolated from two steps with their declared order, so that the
remaining error is of higher order.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skfem
from scipy.integrate import solve_ivp
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import splu
from skfem.helpers import dot

from skfem_stvk import ElementMesh, Gravity, StVK, System
from skfem_stvk.arguments import Array
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor
from skfem_stvk.solvers.dynamics import EnergyMomentum, GeneralizedAlpha, Integrator, Newmark, VelocityVerlet, simulate

from ..statics.meshes import moved_box
from ..study import Study

YOUNG, POISSON, DENSITY = 1e5, 0.3, 1000.0
UNTIL, STEPS, QUICK_STEPS = 0.05, 800, 400
LIMIT, TIGHT = 1e-5, 1e-11
SIDES = (0.4, 0.1, 0.15)


class Case(NamedTuple):
    """Dimension, cells along each side, and kind of mass."""

    d: int
    n: int
    mass: str

    @property
    def mesh(self) -> ElementMesh:
        """Block with inner vertices moved, and half of the simplices with negative orientation."""
        unit = moved_box(self.d, self.n)
        return ElementMesh(unit.p * np.array(SIDES[: self.d])[:, None], unit.t)

    @property
    def gravity(self) -> Array:
        return np.array([0.0, -2.0, 5.0][: self.d])

    def first_velocities(self, mesh: ElementMesh) -> Array:
        """Return initial velocities (nv, d), which are zero at the clamp."""
        x = mesh.p[0] / SIDES[0]
        return (x * np.array([0.3, 1.0, -0.7][: self.d])[:, None]).T


CASES = (Case(2, 4, "lumped"), Case(2, 4, "consistent"), Case(3, 2, "lumped"), Case(3, 2, "consistent"))


def independent(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Compare motions with scikit-fem's assembly integrated by SciPy."""
    rows, failures, steps = [], [], QUICK_STEPS if quick else STEPS
    for case in CASES[2:] if quick else CASES:
        expected = reference(case)
        for kind in (*((VelocityVerlet,) if case.mass == "lumped" else ()), Newmark, GeneralizedAlpha, EnergyMomentum):
            error = _error(case, kind, steps, expected)
            rows.append((f"{case.d}D, {case.mass} mass", kind.__name__, str(steps), f"{error:.1e}"))
            if not error <= LIMIT:
                failures.append(f"{case.d}D, {case.mass} mass, {kind.__name__}: off by {error:.1e}")
    return (
        Study(
            "Motion by scikit-fem and SciPy",
            f"displacements and velocities after {UNTIL:g} s agree to {LIMIT:g}",
            ("body", "integrator", "steps", "off by"),
            tuple(rows),
            tuple(failures),
            (
                f"DOP853 with rtol = {TIGHT:g}; integrators extrapolated from {steps} and {2 * steps} steps; the larger of both "
                "errors, in Euclidean norms",
            ),
        ),
    )


def reference(case: Case) -> tuple[Array, Array]:
    """Return displacements and velocities (ndofs,) at the end."""
    mesh = case.mesh
    body = ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(YOUNG, POISSON, case.d, condensed=False))
    M = _mass(body, case.mass)
    weight = M @ np.tile(case.gravity, mesh.nv)
    free = np.flatnonzero(np.repeat(mesh.p[0] > 0, case.d))
    factors, n = splu(M[np.ix_(free, free)].tocsc()), mesh.p.size

    def slope(_: float, y: Array) -> Array:
        u = np.zeros(n)
        u[free] = y[: len(free)]
        return np.concatenate([y[len(free) :], factors.solve((weight - body.internal_force(u))[free])])

    begin = np.concatenate([np.zeros(len(free)), case.first_velocities(mesh).ravel()[free]])
    end = solve_ivp(slope, (0, UNTIL), begin, method="DOP853", rtol=TIGHT, atol=TIGHT * 1e-2).y[:, -1]
    u, v = np.zeros(n), np.zeros(n)
    u[free], v[free] = np.split(end, 2)
    return u, v


@skfem.BilinearForm
def _inertia(u: Any, v: Any, _: Any) -> Array:
    product: Array = DENSITY * dot(u, v)
    return product


def _mass(body: ReferenceStVK, kind: str) -> csr_matrix:
    """Return the consistent mass matrix, integrated exactly, or its row sums."""
    M = _inertia.assemble(skfem.Basis(body.basis.mesh, body.basis.elem, intorder=2))
    return M if kind == "consistent" else csr_matrix(diags(np.asarray(M.sum(axis=1)).ravel()))


def _error(
    case: Case, kind: type[VelocityVerlet | Newmark | GeneralizedAlpha | EnergyMomentum], steps: int, expected: tuple[Array, Array]
) -> float:
    """Return the larger of the errors of displacements and velocities."""
    integrators = [kind(dt=UNTIL / n) for n in (steps, 2 * steps)]
    (coarse, fine), power = (_end(case, one) for one in integrators), 2 ** integrators[0].order
    found = [(power * b - a) / (power - 1) for a, b in zip(coarse, fine, strict=True)]
    return max(float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in zip(found, expected, strict=True))


def _end(case: Case, integrator: Integrator) -> tuple[Array, Array]:
    """Return displacements and velocities (ndofs,) at the end with this package."""
    mesh = case.mesh
    terms: list[StVK | Gravity] = [StVK(young=YOUNG, poisson=POISSON, density=DENSITY), Gravity(tuple(case.gravity))]
    system = System(mesh, terms, fixed={lambda x: x[0] == 0: "xyz"[: case.d]})
    run = simulate(system, integrator, until=UNTIL, v0=case.first_velocities(mesh).ravel(), mass=case.mass, quiet=True)
    return run.u, run.v
