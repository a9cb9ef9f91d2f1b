"""Bar at rest: bent by a load at its end, or twisted by a rotation of its end; errors against two references on fine meshes."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import StVK, StvkWarning, SupportError, System, Traction, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh

from ..statics.linear_solvers import direct, forget
from ..statics.scikit_fem_forms import I3, in_equilibrium, internal_force, tangent
from .models import LENGTH, MATERIAL, POISSON, YOUNG, Model, bar, system_of

#: Load on the end [Pa], which lowers it by about 3/8 of the length; rotation of the end.
TRACTION, ANGLE = (0.0, 0.0, -600.0), np.pi / 2
STEPS, RTOL = 10, 1e-7
#: Cells across for the references, which are quadratic tetrahedra, and for the models, which are linear ones.
FINEST, ACROSS = 3, 3
QUICK_FINEST, QUICK_ACROSS = 1, 1


class Found(NamedTuple):
    """Result of a model: displacements (nv, 3) [m], measured quantity, iterations, seconds, and status."""

    u: Array
    measured: Array
    iterations: int
    seconds: float
    said: str


class Trial(NamedTuple):
    """Trial with name, loads, prescribed displacements, and a function of (p, u, F) of the end's nodes that returns the result."""

    name: str
    loads: tuple[Any, ...]
    prescribed: dict[str, Any] | None
    measured: Callable[[Array, Array, Array], Array]


def rotated(x: Array, t: float) -> Array:
    """Return the displacements of points (3, n) by a rotation about the bar's axis."""
    y, z = x[1] - 0.5, x[2] - 0.5
    c, s = np.cos(ANGLE * t), np.sin(ANGLE * t)
    return np.stack([0 * y, (c - 1) * y - s * z, s * y + (c - 1) * z])


def end_moves(p: Array, u: Array, F: Array) -> Array:
    """Return the displacement of the end's centre, as the mean over its nodes [m]."""
    return u.mean(axis=0)


def torque(p: Array, u: Array, F: Array) -> Array:
    """Return the torque about the bar's axis [N m]."""
    y, z = ((p + u)[:, 1:] - 0.5).T
    return np.atleast_1d((y * F[:, 2] - z * F[:, 1]).sum())


BENT = Trial("bent", (Traction("tip", TRACTION),), None, end_moves)
TWISTED = Trial("twisted", (), {"tip": rotated}, torque)


def solved(trial: Trial, system: System) -> Found:
    """Solve the trial in load steps; results of failed solves are NaN."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)  # about compression, and about the Poisson's ratio of a rule
            result = solve_static(system, steps=STEPS, rtol=RTOL, quiet=True, raise_on_failure=False)
    except SupportError as error:
        return Found(np.full((system.mesh.nv, 3), np.nan), np.full(1, np.nan), 0, 0.0, str(error).split(".")[0])
    u, history = result.u.reshape(-1, 3), result.history
    measured = _measured(trial, system.mesh, u, system.internal_force(result.u).reshape(-1, 3))
    said = result.status.name.lower()
    return Found(u, measured if result.success else np.nan * measured, history.iterations, sum(result.seconds.values()), said)


def _measured(trial: Trial, mesh: ElementMesh, u: Array, F: Array) -> Array:
    end = np.unique(mesh.boundaries["tip"])
    return trial.measured(mesh.p.T[end], u[end], F[end])


def of_model(trial: Trial, model: Model, n: int) -> Found:
    """Solve the trial under a model on linear tetrahedra with `n` cells across."""
    return solved(trial, system_of(model, bar(n), trial.loads, {"wall": "xyz"}, trial.prescribed))


def true_stvk(trial: Trial, n: int) -> Found:
    """Solve the trial with St. Venant-Kirchhoff's law on quadratic tetrahedra."""
    return solved(trial, System(bar(n), [StVK(**MATERIAL), *trial.loads], {"wall": "xyz"}, trial.prescribed, degree=2))


@skfem.LinearForm
def _traction(v: Any, _: Any) -> Array:
    return np.einsum("i,i...->...", TRACTION, v)


def neo_hookean(F: Array) -> tuple[Array, Array]:
    """Return `P = mu (F - F^-T) + lam (J - 1) J F^-T` (3, 3, ...) and `dP/dF` (3, 3, 3, 3, ...)."""
    lam, mu = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
    f = np.moveaxis(F, (0, 1), (-2, -1))
    J, g = np.linalg.det(f), np.moveaxis(np.linalg.inv(f), (-1, -2), (0, 1))
    slope = lam * (J - 1) * J - mu
    A = np.einsum("iJ...,kL...->iJkL...", lam * J * (2 * J - 1) * g, g) - np.einsum("iL...,kJ...->iJkL...", slope * g, g)
    for i, j in np.ndindex(3, 3):
        A[i, j, i, j] += mu
    return mu * F + slope * g, A


@cache
def true_neo_hookean(name: str, n: int) -> Array:
    """Return the measured quantity of a neo-Hookean bar by scikit-fem on quadratic tetrahedra."""
    forget()
    trial = {trial.name: trial for trial in (BENT, TWISTED)}[name]
    ours = bar(n)
    mesh = skfem.MeshTet(ours.p, ours.t).with_boundaries({"wall": lambda x: x[0] == 0, "tip": lambda x: x[0] == LENGTH})
    element = skfem.ElementVector(skfem.ElementTetP2())
    basis = skfem.Basis(mesh, element, intorder=2)
    held, tip = basis.get_dofs("wall").all(), basis.get_dofs("tip").all()
    load = _traction.assemble(skfem.FacetBasis(mesh, element, facets="tip"))
    if trial.prescribed is not None:
        held, load = np.union1d(held, tip), 0 * load
    end, p, u = np.unique(tip // 3), basis.doflocs[:, ::3], basis.zeros()
    for t in np.linspace(0, 1, STEPS + 1)[1:]:
        du = basis.zeros()
        if trial.prescribed is not None:
            du.reshape(-1, 3)[end] = rotated(p[:, end], t).T
            du[tip] -= u[tip]
        for _ in range(50):
            P, A = neo_hookean(np.asarray(basis.interpolate(u).grad) + I3)
            residual = internal_force.assemble(basis, P=P) - t * load
            if not du.any() and in_equilibrium(residual, held, t * load):
                break
            K = tangent.assemble(basis, A=A)
            u = u + skfem.solve(*skfem.condense(K, -residual, x=du, D=held), solver=direct)
            du[:] = 0
        else:
            raise RuntimeError(f"t = {t:g}; Newton's method with scikit-fem did not converge.")
    F = internal_force.assemble(basis, P=P).reshape(-1, 3)[end]
    return trial.measured(p[:, end].T, u.reshape(-1, 3)[end], F)


def error(found: Array, truth: Array) -> float:
    """Return `|found - truth| / |truth|`."""
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))
