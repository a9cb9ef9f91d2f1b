"""Recovery of models from initial states with inverted, flat or exactly mirrored elements."""

from __future__ import annotations

import warnings
from collections import Counter
from typing import NamedTuple

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StvkError, StvkWarning, System, VolumePenalty, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.errors import AnalysisError
from skfem_stvk.solvers.statics import StaticResult

from .models import MODELS, TRUE, Model, system_of

#: Cells of the box in each direction. A body is back at rest if its displacements are below `BACK` times its size.
CELLS, QUICK_CELLS, BACK = 4, 2, 1e-5
KINDS = ("StVK", "StVK + compression", "StVK + quadratic", "corotated by element", "invertible StVK", "neo-Hookean")
#: Models with which no element may stay inverted.
COME_BACK = ("corotated by element", "invertible StVK")
#: Number of random starts per law and element, and cells of their box in each direction.
SEEDS, QUICK_SEEDS, FEW_CELLS = 20, 3, 2
#: Outcomes of a solve from a random start.
ENDS = BACK_AT_REST, FOLDED, INVERTED, SADDLE, NOT_SOLVED = "back", "folded, stable", "inverted, stable", "saddle", "not solved"


class Recovery(NamedTuple):
    """Outcome of a solve: back at rest, or folded in another stable equilibrium; number of inverted elements; a note."""

    back: bool
    folded: bool
    inverted: int
    said: str

    def __str__(self) -> str:
        if self.back:
            return f"back, {self.said}"
        if self.folded:
            return f"folded, {self.said}"
        return f"{self.inverted} inside out, {self.said}" if self.inverted else self.said


def models() -> list[Model]:
    """Return the tested models; StVK has each kind of volume term with a finite energy of inverted elements."""
    usual = {model.name: model for model in (*MODELS, *map(_with_volume, ("compression", "quadratic")))}
    return [usual[name] for name in KINDS]


def _with_volume(kind: str) -> Model:
    return Model(f"StVK + {kind}", "StVK", lambda mesh: [*TRUE.terms(mesh), VolumePenalty(kind=kind)])


def box(n: int) -> ElementMesh:
    """Return the unit cube of `6 n^3` tetrahedra, with the boundary "wall"."""
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return ElementMesh.of(mesh.with_boundaries({"wall": lambda x: x[0] == 0}))


def starts(mesh: ElementMesh) -> dict[str, Array]:
    """Return displacements (nv, 3) by name: nodes at random positions, in one plane, or mirrored at the wall.

    Nodes of the wall are not displaced.
    """
    x, free = mesh.p.T, mesh.p[0] > 0
    rng = np.random.default_rng(1)
    found: dict[str, Array] = {
        "anywhere": rng.uniform(-0.5, 1.5, x.shape) - x,
        "flat": np.stack([0 * x[:, 0], 0 * x[:, 0], 0.5 - x[:, 2]], axis=1),
        "mirrored": np.stack([-2 * x[:, 0], 0 * x[:, 0], 0 * x[:, 0]], axis=1) + 1e-3 * rng.standard_normal(x.shape),
    }
    return {name: np.where(free[:, None], u, 0.0) for name, u in found.items()}


def exact_starts(mesh: ElementMesh) -> dict[str, Array]:
    """Return displacements (nv, 3) in which stretches of whole elements cancel: mirrored, on a line, at a point."""
    x, free = mesh.p.T, mesh.p[0] > 0
    found = {
        "exactly mirrored": -2 * x * [1, 0, 0],
        "on a line": (0.5 - x) * [0, 1, 1],
        "at a point": 0.5 - x,
    }
    return {name: np.where(free[:, None], u, 0.0) for name, u in found.items()}


def random_starts(model: Model, degree: int, seeds: int, linear_first: bool) -> Counter[str]:
    """Return the outcomes of static solves from random starts.

    With `linear_first`, linear elements on the corners are solved first.
    """
    mesh, ends = box(FEW_CELLS), Counter[str]()
    for seed in range(seeds):
        system = System(mesh, model.terms(mesh), {"wall": "xyz"}, degree=degree)
        x, free = system.mesh.p.T, system.mesh.p[0] > 0
        u0 = np.where(free[:, None], np.random.default_rng(seed).uniform(-0.5, 1.5, x.shape) - x, 0.0)
        if linear_first:
            linear = _solved(System(mesh, model.terms(mesh), {"wall": "xyz"}), u0[: mesh.nv])
            u0 = linear.u.reshape(-1, 3)[system.mesh.ends()].mean(axis=1)
        ends[_end(system, _solved(system, u0))] += 1
    return ends


def _solved(system: System, u0: Array) -> StaticResult:
    """Return the result of one static solve from `u0` (nv, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return solve_static(system, steps=1, u0=u0.ravel(), quiet=True, raise_on_failure=False)


def _end(system: System, found: StaticResult) -> str:
    """Return the outcome of a solve.

    The state is an equilibrium if forces at free nodes vanish, and it is stable if K is positive definite.
    """
    if np.abs(found.u).max() < BACK:
        return BACK_AT_REST
    free = system.free_dofs(system.supports.held)
    force, scale = system.internal_force(found.u), np.abs(system.tangent(0 * found.u)).max()
    if np.abs(force[free.free]).max() > BACK * scale:
        return NOT_SOLVED
    if np.linalg.eigvalsh(free.matrix(system.tangent(found.u)).toarray())[0] <= 0:
        return SADDLE
    return INVERTED if len(system.inside_out(found.u)) else FOLDED


def at_rest(model: Model, mesh: ElementMesh, u0: Array) -> Recovery:
    """Return the outcome of a static solve without loads."""
    system = system_of(model, mesh, (), {"wall": "xyz"})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)
            found = solve_static(system, steps=1, u0=u0.ravel(), quiet=True, raise_on_failure=False)
    except AnalysisError:
        raise
    except StvkError as error:
        return Recovery(False, False, 0, "refused" if "inverted or flat" in str(error) else type(error).__name__)
    inverted = len(system.inside_out(found.u))
    back = bool(np.abs(found.u).max() < BACK)
    return Recovery(back, found.success and not back, inverted, f"{found.history.iterations} it.")
