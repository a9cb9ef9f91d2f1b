"""Which models come back to rest from starts in which their elements are tangled, flat or mirrored."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StvkError, StvkWarning, VolumePenalty, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.errors import AnalysisError

from .models import MODELS, TRUE, Model, system_of

#: Cells of the box in each direction; a body is back if it is nearer to rest than this part of its size.
CELLS, QUICK_CELLS, BACK = 4, 2, 1e-5
KINDS = ("StVK", "StVK + compression", "StVK + quadratic", "corotated by element", "invertible StVK", "neo-Hookean")
#: Those that must come back from every start.
COME_BACK = ("StVK + quadratic", "invertible StVK")


class Recovery(NamedTuple):
    """How a solve from a start came out: whether the body is back at rest, elements inside out in the end, and what was said."""

    back: bool
    turned: int
    said: str

    def __str__(self) -> str:
        if self.back:
            return f"back, {self.said}"
        return f"{self.turned} inside out, {self.said}" if self.turned else self.said


def models() -> list[Model]:
    """Those that are tried: of StVK with each kind of volume term that has an energy inside out."""
    usual = {model.name: model for model in (*MODELS, *map(_with_volume, ("compression", "quadratic")))}
    return [usual[name] for name in KINDS]


def _with_volume(kind: str) -> Model:
    return Model(f"StVK + {kind}", "StVK", lambda mesh: [*TRUE.terms(mesh), VolumePenalty(kind=kind)])


def box(n: int) -> ElementMesh:
    """The unit cube of `6 n^3` tetrahedra, with the boundary "wall"."""
    mesh = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    return ElementMesh.of(mesh.with_boundaries({"wall": lambda x: x[0] == 0}))


def starts(mesh: ElementMesh) -> dict[str, Array]:
    """Displacements (nv, 3) by name: all nodes anywhere, all in one plane, or behind the wall; the wall is where it belongs."""
    x, free = mesh.p.T, mesh.p[0] > 0
    rng = np.random.default_rng(1)
    found: dict[str, Array] = {
        "anywhere": rng.uniform(-0.5, 1.5, x.shape) - x,
        "flat": np.stack([0 * x[:, 0], 0 * x[:, 0], 0.5 - x[:, 2]], axis=1),
        "mirrored": np.stack([-2 * x[:, 0], 0 * x[:, 0], 0 * x[:, 0]], axis=1) + 1e-3 * rng.standard_normal(x.shape),
    }
    return {name: np.where(free[:, None], u, 0.0) for name, u in found.items()}


def at_rest(model: Model, mesh: ElementMesh, u0: Array) -> Recovery:
    """By a static solve without loads."""
    system = system_of(model, mesh, (), {"wall": "xyz"})
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)
            found = solve_static(system, steps=1, u0=u0.ravel(), quiet=True, raise_on_failure=False)
    except AnalysisError:
        raise
    except StvkError as error:
        return Recovery(False, 0, "refused" if "inside out" in str(error) else type(error).__name__)
    turned = len(system.inside_out(found.u))
    return Recovery(np.abs(found.u).max() < BACK, turned, f"{found.history.iterations} it.")
