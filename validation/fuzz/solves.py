"""Random static solves and motions: each reported success is right, and each failure has an explanation."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from skfem_stvk import (
    BackwardEuler,
    ElementMesh,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Run,
    StaticResult,
    StvkError,
    StvkWarning,
    System,
    VelocityVerlet,
    critical_step,
    simulate,
    solve_static,
)
from skfem_stvk.arguments import Array
from skfem_stvk.errors import AnalysisError
from skfem_stvk.solvers.dynamics.integrators.integrator import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM

from .bodies import Recipe, edge_length, made, recipes, states
from .contacts import approach, check_refusal

STRAINS = (1e-9, 1e-6, 1e-3, 0.03, 0.3, 3.0)
SOLVERS = ("auto", "auto", "superlu", "amg-cg", "block-jacobi-cg", "ssor-cg")
IMPLICIT = (LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)
INTEGRATORS = (ForwardEuler, VelocityVerlet, *IMPLICIT)
#: Number of steps of a motion, and time steps in critical steps. Explicit integrators blow up at the last two, and must report it.
STEPS, LENGTHS = 6, (0.1, 0.8, 10.0, 1e3)
#: Largest residual relative to loads and reactions of an equilibrium that converged to 1e-8.
LEFT = 1e-7
#: For these laws, `EnergyMomentum` conserves energy only to the order of the step, because their force is taken at its middle.
AT_THE_MIDDLE = ("invertible", "with a penalty")


def crosses(mesh: ElementMesh, u: Array) -> bool:
    """Return whether an edge of the surface crosses a triangle of the surface without a common node; brute force."""
    x = (mesh.p + u.reshape(-1, 3).T).T
    triangles = (mesh.surface if mesh.k == 3 else mesh.t).T
    edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0)
    low, high = (np.stack([f(x[sides], axis=1) for f in (np.min, np.max)]) for sides in (edges, triangles))
    e, f = np.nonzero((low[0][:, None] <= high[1]).all(axis=2) & (low[1][:, None] >= high[0]).all(axis=2))
    apart = (edges[e][:, :, None] != triangles[f][:, None]).all(axis=(1, 2))
    (p, q), (a, b, c) = np.moveaxis(x[edges[e[apart]]], 1, 0), np.moveaxis(x[triangles[f[apart]]], 1, 0)

    def side(i: Array, j: Array, k: Array, m: Array) -> Array:
        return np.sign(np.einsum("nd,nd->n", np.cross(j - i, k - i), m - i))

    through = side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)
    return bool(((side(a, b, c, p) * side(a, b, c, q) < 0) & (through[0] == through[1]) & (through[1] == through[2])).any())


@dataclass(frozen=True)
class Solve:
    """Body whose loads strain it by about `strain`, with the parameters of its static solve."""

    recipe: Recipe
    strain: float
    method: str
    solver: str
    steps: int


@dataclass(frozen=True)
class Motion:
    """Body with initial strains, and with velocities that strain it by about `strain` in a critical step."""

    recipe: Recipe
    strain: float
    integrator: type[Any]
    length: float


@st.composite
def solves(draw: st.DrawFn, drawn: Any = None) -> Solve:
    """Draw bodies with a load, by default without contact, that are usually constrained at half of their nodes."""
    recipe = draw(recipes(largest=3) if drawn is None else drawn)
    as_drawn = draw(st.sampled_from((False,) * 9 + (True,)))
    return Solve(
        recipe if as_drawn else replace(recipe, held="half", loads=recipe.loads or ("nodal",)),
        strain=draw(st.sampled_from(STRAINS)),
        method=draw(st.sampled_from(("load-steps", "load-steps", "arc-length"))),
        solver=draw(st.sampled_from(SOLVERS)),
        steps=draw(st.integers(1, 5)),
    )


@st.composite
def motions(draw: st.DrawFn, drawn: Any = None) -> Motion:
    """Draw bodies that are free or constrained, with or without loads, by default without contact."""
    return Motion(
        draw(recipes(largest=3) if drawn is None else drawn),
        strain=draw(st.sampled_from(STRAINS)),
        integrator=draw(st.sampled_from(INTEGRATORS)),
        length=draw(st.sampled_from(LENGTHS)),
    )


def check_solve(drawn: Solve) -> bool:
    """Check that a static solve gives a stable equilibrium without inverted elements, or an error that explains the failure."""
    try:
        system = made(drawn.recipe, drawn.strain)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)
            warnings.simplefilter("error", RuntimeWarning)  # NumPy: an overflow must raise an error of this package
            result = solve_static(
                system, drawn.steps, method=drawn.method, solver=drawn.solver, stability=True, quiet=True, raise_on_failure=False
            )
    except AnalysisError:
        raise
    except StvkError as error:
        check_refusal(drawn.recipe.touch, error)
        return False
    assert np.isfinite(result.u).all(), "displacements are not finite"
    if not result.success:
        assert len(result.message) > 20, f"message = {result.message!r}; expected an explanation"
        return False
    _check_equilibrium(drawn.recipe, result.system, result)
    return True


def _check_equilibrium(recipe: Recipe, system: System, result: StaticResult) -> None:
    u, free = result.u, system.free_dofs(system.supports.fixed)
    assert result.t == 1.0, f"t = {result.t:g}; expected 1"
    assert not u[free.fixed].any(), "constrained degrees of freedom have moved"
    assert recipe.law == "linear" or not len(system.inside_out(u)), "elements are inverted"
    _check_apart(recipe, system, u)
    left, loads = system.residual(u, result.t), system.external_force(u, result.t)
    forces = float(np.linalg.norm(loads) + np.linalg.norm(left[free.fixed]))
    off = float(np.linalg.norm(left[free.free]))
    rounding = 10 * float(np.finfo(float).eps * np.linalg.norm(system.round_off(u)))
    assert off <= LEFT * forces + rounding, f"not in equilibrium: {off:g} N of {forces:g} N"
    K = system.jacobian(u, result.t)[free.free][:, free.free].toarray()
    scale = 1 / np.sqrt(np.abs(np.diag(K)) + np.finfo(float).tiny)
    lowest = float(np.linalg.eigvalsh(scale[:, None] * (K + K.T) / 2 * scale)[0])
    assert lowest >= -1e-8, f"unstable: the lowest eigenvalue of K is {lowest:g}"


def check_motion(drawn: Motion) -> bool:
    """Check that a motion conserves the quantities that its integrator declares, or ends with an error that explains why."""
    recipe = drawn.recipe
    try:
        system = made(recipe, drawn.strain)
        critical = critical_step(system).step
        dt = drawn.length * critical
        free = system.free_dofs(system.supports.fixed)
        u, v = states(recipe, system)[1], np.random.default_rng([recipe.seed, 4]).standard_normal(system.ndofs)
        if recipe.touch is not None:
            v += 5 * approach(recipe.touch, system.mesh).ravel()
        v *= drawn.strain * edge_length(system) / critical
        u[free.fixed] = v[free.fixed] = 0.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)
            warnings.simplefilter("error", RuntimeWarning)
            integrator = drawn.integrator(dt=dt)
            run = simulate(system, integrator, until=STEPS * dt, u0=u, v0=v, quiet=True, raise_on_failure=False)
    except AnalysisError:
        raise
    except StvkError as error:
        check_refusal(drawn.recipe.touch, error)
        return False
    assert np.isfinite(run.u).all() and np.isfinite(run.v).all(), "the last state is not finite"
    assert all(np.isfinite(column).all() for column in run.ledger.values()), "the ledger is not finite"
    assert not run.u[free.fixed].any() and not run.v[free.fixed].any(), "constrained degrees of freedom have moved"
    if not run.success:
        assert len(run.message) > 20, f"message = {run.message!r}; expected an explanation"
        return False
    assert run.ledger.steps > STEPS and abs(run.t - STEPS * dt) <= 1e-9 * run.t, f"t = {run.t:g} s; expected {STEPS * dt:g} s"
    _check_apart(recipe, run.system, run.u)
    _check_conservation(drawn, system, run, (u, v), dt)
    return True


def _check_apart(recipe: Recipe, system: System, u: Array) -> None:
    """Check that surfaces that repel each other do not intersect."""
    if recipe.touch is not None and system.contacts[0].is_barrier:
        mesh = system.mesh
        assert system.contacts[0].evaluated(u.reshape(-1, mesh.d))[1].min() > 0, "a gap is not positive"
        triangles = mesh.d == 3 and len(mesh.surface if mesh.k == 3 else mesh.t) == 3
        assert not triangles or not crosses(mesh, u), "surfaces cross"


def _check_conservation(drawn: Motion, system: System, run: Run, begin: tuple[Array, Array], dt: float) -> None:
    """Check the conserved quantities of the integrator to the tolerance of a step's solve: momenta of free bodies, and energy."""
    ledger, recipe, d, integrator = run.ledger, drawn.recipe, system.mesh.d, drawn.integrator(dt=dt)
    conserved, rtol = integrator.conserves, max(1e-12, getattr(integrator, "rtol", 0.0))
    touch = recipe.touch
    if recipe.held == "nothing" and not recipe.loads and not (touch is not None and touch.is_rigid):
        u0, v0 = begin
        last = [system.internal_force(u0), system.internal_force(run.u)]
        if drawn.integrator is LinearBackwardEuler:  # the tolerance of its linear solve includes the change of forces in a step
            last.append(system.product(u0, dt * v0))
        forces = max(float(np.abs(force).sum()) for force in last)
        scale = dt * forces + np.sqrt(2 * system.mass().total * ledger["kinetic_energy"].max())
        arm = max(float(np.abs(system.mesh.p.T + u.reshape(-1, d)).max()) for u in (u0, run.u))
        assert LINEAR_MOMENTUM in conserved
        momenta = {"linear_momentum": ("xyz"[:d], scale)}
        if (
            ANGULAR_MOMENTUM in conserved and touch is None and recipe.law != "linear" and d > 1
        ):  # linear elasticity has strains from rotations
            momenta["angular_momentum"] = "xyz" if d == 3 else "z", arm * scale
        for name, (axes, size) in momenta.items():
            moved = np.array([ledger[f"{name}_{axis}"] for axis in axes])
            lost = float(np.abs(moved - moved[:, :1]).max())
            assert lost <= 10 * STEPS * rtol * size, f"{name.replace('_', ' ')} of {lost:g} is lost, in {size:g}"
    if ENERGY in conserved and recipe.law not in AT_THE_MIDDLE:
        energy = ledger["kinetic_energy"] + np.abs(ledger["strain_energy"])
        off = float(np.abs(ledger["closure_error"]).max())
        size = float(
            sum(np.abs(ledger.get(name, np.zeros(1))).max() for name in ("potential_energy", "external_work")) + energy.max()
        )
        assert off <= 1e-8 * size, f"energy of {off:g} is lost, in {size:g}"
