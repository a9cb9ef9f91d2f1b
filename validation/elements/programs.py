"""Trials by this package with each family of elements, and by scikit-fem's assembly of linear and quadratic tetrahedra."""

from __future__ import annotations

import warnings
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import StVK, System, Traction, solve_static
from skfem_stvk.arguments import Array

from ..statics.linear_solvers import direct, forget
from ..statics.scikit_fem_forms import ELEMENTS, I3, in_equilibrium, internal_force, stress_and_moduli, tangent
from .families import BOXES, ONE_POINT, P1, P2, Family
from .trials import MODULUS, Trial

RTOL = 1e-8
STEPS = 10
#: Hourglass coefficient over `1 - 2 nu`, which relates it to the shear modulus. The usual coefficient locks for nu near 1/2.
HOURGLASS = 0.2


class Solved(NamedTuple):
    """Result of a program on a mesh: unknowns, result, Newton iterations, wall time [s], load factors, and status.

    The result is NaN if a solve failed: coarse meshes of nearly incompressible material buckle.
    """

    ndofs: int
    result: Array
    iterations: int
    seconds: float
    factors: Array
    said: str = "converged"


OURS: dict[str, Family] = {"P1": P1, "P2": P2, "hexahedra": BOXES, "hexahedra, 1 point": ONE_POINT}
THEIRS = {"scikit-fem P1": "P1", "scikit-fem P2": "P2"}


def ours(trial: Trial, family: Family, n: int) -> Solved:
    """Solve with the automatic load steps and linear solver, and measure the time from the mesh on."""
    mesh = trial.mesh(n, family.boxes)
    begin = perf_counter()
    loads = [] if trial.traction is None else [Traction("tip", trial.traction)]
    prescribed = None if trial.moved is None else {"tip": trial.moved}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about locking of linear elements, and about compression
        material = StVK(young=MODULUS, poisson=trial.poisson)
        degree = None if family.boxes else family.degree
        more = {"hourglass": HOURGLASS * (1 - 2 * trial.poisson)} if family is ONE_POINT else {}
        system = System(mesh, [material, *loads], {"wall": "xyz"}, prescribed, degree=degree, **family.options | more)
        result = solve_static(system, steps=STEPS, rtol=RTOL, quiet=True, raise_on_failure=False)
    seconds = perf_counter() - begin
    p = system.mesh.p.T
    end = np.flatnonzero(p[:, 0] == trial.length)
    u, F = (x.reshape(-1, 3)[end] for x in (result.u, system.internal_force(result.u)))
    found = trial.measured(p[end], u, F) if result.success else np.full(1, np.nan)
    history = result.history
    return Solved(system.ndofs, found, history.iterations, seconds, np.asarray(history.t), result.status.name.lower())


def theirs(trial: Trial, element: str, n: int, factors: Array) -> Solved:
    """Solve by Newton's method as a competent user of scikit-fem writes it, in given load steps, with PARDISO."""
    forget()
    mesh, nu = trial.mesh(n), trial.poisson
    begin = perf_counter()
    lam, mu = MODULUS * nu / ((1 + nu) * (1 - 2 * nu)), MODULUS / (2 * (1 + nu))
    elements = skfem.ElementVector(ELEMENTS[element]())
    basis = skfem.Basis(mesh, elements, intorder={"P1": 1, "P2": 2}[element])
    load, held, tip = basis.zeros(), basis.get_dofs("wall").all(), basis.get_dofs("tip").all()
    if trial.traction is not None:
        load = traction.assemble(skfem.FacetBasis(mesh, elements, facets="tip"), of=np.array(trial.traction)[:, None, None])
    else:
        held = np.union1d(held, tip)
    u, iterations, p = basis.zeros(), 0, basis.doflocs[:, ::3]
    end = np.unique(tip // 3)
    for t in factors:
        du = basis.zeros()
        if trial.moved is not None:
            du.reshape(-1, 3)[end] = trial.moved(p[:, end], t).T
            du[tip] -= u[tip]
        while True:
            P, A = stress_and_moduli(basis.interpolate(u).grad + I3, lam, mu)
            residual = internal_force.assemble(basis, P=P) - t * load
            if not du.any() and in_equilibrium(residual, held, t * load):
                break
            K = tangent.assemble(basis, A=A)
            u = u + skfem.solve(*skfem.condense(K, -residual, x=du, D=held), solver=direct)
            du[:] = 0
            iterations += 1
    F = internal_force.assemble(basis, P=P).reshape(-1, 3)[end]
    seconds = perf_counter() - begin
    return Solved(len(u), trial.measured(p[:, end].T, u.reshape(-1, 3)[end], F), iterations, seconds, factors)


@skfem.LinearForm
def traction(v: Any, w: Any) -> Array:
    return np.einsum("i...,i...->...", w.of, v)
