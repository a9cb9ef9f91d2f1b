"""Round-off: the error of F against 50-digit arithmetic, for small strains, large rotations and meshes far from the origin."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mesh import SimplexMesh
from ...reference import ReferenceStVK
from ...system import System
from ..bodies import Homogeneous
from ..case import EPS, OURS, REFERENCE, Case
from ..exact import exact_energy_and_force
from ..states import random_rotation
from ..tasks import Task

Array = NDArray[np.float64]
Force = Callable[[Array], Array]

STRAINS = 10.0 ** -np.arange(1, 13)
OFFSETS = (0.0, 1e3, 1e6)
TEXTBOOK = "|p|^2 - |P|^2"
ELEMENTS = 64


def precision(case: Case, table: list[dict[str, Any]]) -> Iterator[Task]:
    """What our form must keep; the other two are measured, not judged."""

    def worst(turned: bool) -> dict[str, Any]:
        errors = [(row["error"] * (row["strain"] if turned else 1.0), row) for row in table if row["form"] == OURS]
        measured, row = max((error for error in errors if bool(error[1]["rotation_deg"]) == turned), key=lambda error: error[0])
        return {
            "measured": measured,
            "limit": case.limit(50 * EPS if turned else 1e-13),
            "scale": "largest |F|" + (", times the strain" if turned else ""),
            "reason": "a rotated body's displacement leaves eps/strain to every form"
            if turned
            else "zeta = (P + p) . U has no cancellation: round-off whatever the strain and the offset; flat elements cost more",
            "worst": {"at strain": row["strain"], "offset [m]": row["offset_m"]},
        }

    states = [(False, "no rotation"), (True, "rotated by 170 deg")]
    for turned, state in states[: 1 if case.mesh.d == 1 else 2]:  # a line cannot turn
        yield Task("precision", case.ours, "F", state, "F", partial(worst, turned), against="50 digits")


def precision_table(mesh: SimplexMesh, body: Homogeneous, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Rows form, rotation_deg, offset_m, strain, error: max |F - F_exact| / max |F_exact| on a patch of the mesh."""
    centred, t = patch(mesh)
    size = np.linalg.norm(centred[:, t[0]] - centred[:, t[1]], axis=0).min()
    turn = random_rotation(mesh.d, rng)
    noise = rng.standard_normal(centred.shape)
    for offset in (offset for offset in OFFSETS if EPS * offset < 1e-4 * size):
        p = centred + offset
        forms = forms_on(p, t, body)
        for degrees, Q in ((0, np.eye(mesh.d)), (170, turn)):
            if degrees and mesh.d == 1:
                continue
            for strain in STRAINS.tolist():
                strained = strain * size * noise
                u = (Q @ strained + (Q - np.eye(mesh.d)) @ centred).T.ravel()
                _, truth = exact_energy_and_force(p, t, *body.lame, u)
                for form, force in forms.items():
                    error = float(np.abs(force(u) - truth).max() / np.abs(truth).max())
                    yield {"form": form, "rotation_deg": degrees, "offset_m": offset, "strain": strain, "error": error}


def patch(mesh: SimplexMesh) -> tuple[Array, NDArray[np.int32]]:
    """Coordinates about their mean and vertices of the elements nearest to the middle of the body."""
    centres = mesh.p[:, mesh.t].mean(axis=1)
    near = np.argsort(((centres.T - mesh.p.mean(axis=1)) ** 2).sum(axis=1), kind="stable")[:ELEMENTS]
    used, t = np.unique(mesh.t[:, near], return_inverse=True)
    p = mesh.p[:, used]
    return p - p.mean(axis=1, keepdims=True), t.reshape(len(mesh.t), -1).astype(np.int32)


def forms_on(p: Array, t: NDArray[np.int32], body: Homogeneous) -> dict[str, Force]:
    """F(u) by name: our form, the textbook form and scikit-fem's."""
    mesh = SimplexMesh(p, t)
    return {
        OURS: System(mesh, body.term).internal_force,
        TEXTBOOK: partial(textbook_force, mesh, body),
        REFERENCE: ReferenceStVK(p, mesh.t, body.tensor).internal_force,
    }


def textbook_force(mesh: SimplexMesh, body: Homogeneous, u: Array) -> Array:
    """F with `zeta = |x_a - x_b|^2 - |X_a - X_b|^2` from positions `x = X + u`, as textbooks write it."""
    form = body.term.bind(mesh)
    x = mesh.p.T + u.reshape(-1, mesh.d)
    p = x[form.edges[0]] - x[form.edges[1]]
    tension = form.L @ ((p**2).sum(axis=1) - (form.P**2).sum(axis=1))
    force = np.zeros_like(x)
    np.add.at(force, form.edges[0], tension[:, None] * p)
    np.subtract.at(force, form.edges[1], tension[:, None] * p)
    return force.ravel()
