"""Round-off: the error of F against 50-digit arithmetic, for small strains, large rotations and meshes far from the origin.

Measured on a homogeneous isotropic patch of the mesh, for three forms: ours, the textbook's, and scikit-fem's. Ours is judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ...arguments import Array
from ...edges import Assembly, EdgeForm
from ...mesh import SimplexMesh
from ...mesh.geometry import aspect_ratios, vertex_sizes
from ...reference import ReferenceStVK
from ..bodies import Homogeneous
from ..case import EPS, OURS, REFERENCE, Case
from ..exact import ExactStVK
from ..judgement import HIGHEST
from ..states import random_rotation
from ..tasks import NotApplicable, Task

Force = Callable[[Array], Array]

STRAINS = 10.0 ** -np.arange(1, 13)
OFFSETS = (0.0, 1e3, 1e6)
TEXTBOOK = "|p|^2 - |P|^2"
ELEMENTS = 64
LIMIT, LIMIT_ROTATED = 1e-13, 50 * EPS


def precision(case: Case, body: Homogeneous, table: list[dict[str, Any]]) -> Iterator[Task]:
    """What our form must keep; the table is filled on the way."""
    for degrees, state in ((0, "no rotation"), (170, "rotated by 170 deg")):
        yield Task("precision", case.ours, "F", state, "F", partial(_worst, case, body, table, degrees), against="50 digits")


def _worst(case: Case, body: Homogeneous, table: list[dict[str, Any]], degrees: int) -> dict[str, Any]:
    if degrees and case.mesh.d == 1:
        raise NotApplicable("a line cannot turn")
    if not table:
        table += list(precision_table(case.mesh, body, case.random("precision")))  # all of it or nothing
    rows = [row for row in table if row["form"] == OURS and row["rotation_deg"] == degrees]
    flatness = float(aspect_ratios(patch(case.mesh)).max()) ** 2
    errors = np.array([row["error"] * (row["strain"] if degrees else 1.0) for row in rows])
    worst = rows[int(np.argmax(errors))]  # not a number counts as the largest
    return {
        "measured": float(errors.max()),
        "limit": max(LIMIT_ROTATED if degrees else LIMIT, min(10 * EPS * flatness, HIGHEST)),
        "scale": "largest |F|" + (", times the strain" if degrees else ""),
        "reason": (
            "50 eps/strain: a rotated body's displacement leaves no more to any form"
            if degrees
            else "1e-13 is for round-off, whatever the strain and the offset: zeta = (P + p) . U has no cancellation"
        )
        + (
            ""
            if 10 * EPS * flatness <= LIMIT
            else f"; flat elements of the patch cost 10 eps x (longest edge/height)^2 = {10 * EPS * flatness:.0e}"
        ),
        "worst": {"at strain": worst["strain"], "offset [m]": worst["offset_m"]},
    }


def precision_table(mesh: SimplexMesh, body: Homogeneous, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Rows form, rotation_deg, offset_m, strain, error: max |F - F_exact| / max |F_exact| on a patch of the mesh."""
    piece = patch(mesh)
    sizes = vertex_sizes(piece)
    lowest = float(sizes.min() / aspect_ratios(piece).max())
    turn = random_rotation(mesh.d, rng)
    noise = sizes * rng.standard_normal(piece.p.shape)
    for offset in (offset for offset in OFFSETS if EPS * offset < 1e-4 * lowest):  # beyond, the offset itself flattens elements
        p = piece.p + offset
        forms, exact = forms_on(SimplexMesh(p, piece.t), body), ExactStVK(p, piece.t, body.lame)
        for degrees, Q in ((0, np.eye(mesh.d)), (170, turn)):
            if degrees and mesh.d == 1:
                continue
            for strain in STRAINS.tolist():
                u = (Q @ (strain * noise) + (Q - np.eye(mesh.d)) @ piece.p).T.ravel()
                truth = exact.internal_force(u)
                for form, force in forms.items():
                    error = float(np.abs(force(u) - truth).max() / np.abs(truth).max())
                    yield {"form": form, "rotation_deg": degrees, "offset_m": offset, "strain": strain, "error": error}


def patch(mesh: SimplexMesh) -> SimplexMesh:
    """The elements nearest to the middle of the body, as a mesh about the origin."""
    centres = mesh.p[:, mesh.t].mean(axis=1)
    near = np.argsort(((centres.T - mesh.p.mean(axis=1)) ** 2).sum(axis=1), kind="stable")[:ELEMENTS]
    used, t = np.unique(mesh.t[:, near], return_inverse=True)
    p = mesh.p[:, used]
    return SimplexMesh(p - p.mean(axis=1, keepdims=True), t.reshape(len(mesh.t), -1).astype(np.int32))


def forms_on(mesh: SimplexMesh, body: Homogeneous) -> dict[str, Force]:
    """F(u) by name: our form, the textbook form and scikit-fem's."""
    assembly = body.term.bind(mesh)
    return {
        OURS: partial(edge_force, assembly),
        TEXTBOOK: partial(textbook_force, assembly.form, mesh.p.T),
        REFERENCE: ReferenceStVK(mesh.p, mesh.t, body.tensor).internal_force,
    }


def edge_force(assembly: Assembly, u: Array) -> Array:
    """F of our form."""
    force = np.zeros(assembly.form.p.T.shape)
    assembly.energy(u.reshape(force.shape), force)
    return force.ravel()


def textbook_force(form: EdgeForm, X: Array, u: Array) -> Array:
    """F with `zeta = |x_a - x_b|^2 - |X_a - X_b|^2` from positions `x = X + u`, as textbooks write it."""
    x = X + u.reshape(X.shape)
    p = x[form.edges[0]] - x[form.edges[1]]
    tension = form.L @ ((p**2).sum(axis=1) - (form.P**2).sum(axis=1))
    force = np.zeros_like(x)
    np.add.at(force, form.edges[0], tension[:, None] * p)
    np.subtract.at(force, form.edges[1], tension[:, None] * p)
    return force.ravel()
