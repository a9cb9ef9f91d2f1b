"""Manufactured solution in 3D: orders of convergence in L2 and H1 on unstructured meshes.

The solution is `skfem_stvk.referee.manufactured.Manufactured`. The displacement is prescribed on all faces but x = 1, where the
traction P e_1 acts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from skfem_stvk import BodyForce, ElementMesh, StVK, System, Traction, solve_static
from skfem_stvk.referee.manufactured import Manufactured, fitted_order, moved_box

from ..study import Study
from .meshes import Array

YOUNG, POISSON = 1.0e5, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
SOLUTION = Manufactured(LAM, MU)
#: Fields with the same constants, for other studies.
displacement, gradient, nominal_stress, body_force = (
    SOLUTION.displacement,
    SOLUTION.gradient,
    SOLUTION.nominal_stress,
    SOLUTION.body_force,
)
CELLS = (8, 12, 16, 24)
ORDERS, LIMIT = {"L2": 2.0, "H1": 1.0}, 0.1


def manufactured(quick: bool = False) -> Study:
    """Fit the orders of convergence to a manufactured solution in 3D: 2 in L2 and 1 in H1."""
    cells = CELLS[:3] if quick else CELLS
    errors = np.array([_errors(moved_box(3, n)) for n in cells])
    fitted = {norm: fitted_order(1 / np.array(cells), errors[:, i]) for i, norm in enumerate(ORDERS)}
    rows = [(f"{n}^3 x 6", *(f"{error:.3e}" for error in e)) for n, e in zip(cells, errors, strict=True)]
    return Study(
        "Manufactured solution in 3D",
        f"order 2 in L2 and 1 in H1, each +- {LIMIT:g}",
        ("tetrahedra", *(f"error in {norm}" for norm in ORDERS)),
        (*rows, ("fitted order", *(f"{order:.3f}" for order in fitted.values()))),
        tuple(f"{norm}: order {order:.3f}" for norm, order in fitted.items() if not abs(order - ORDERS[norm]) <= LIMIT),
        ("errors are relative to the norms of the solution; inner vertices are moved at random by up to a fifth of a cell",),
    )


def _errors(mesh: ElementMesh) -> tuple[float, float]:
    """Return the relative errors in L2 and in the H1 seminorm."""
    pull = Traction(lambda x: x[0] == 1, lambda x, t: nominal_stress(x, t)[:, 0])
    terms = (StVK(young=YOUNG, poisson=POISSON), BodyForce(body_force), pull)
    result = solve_static(System(mesh, terms, prescribed={_but_one_face: displacement}), steps=2, quiet=True)
    return SOLUTION.errors(mesh, result.u)


def _but_one_face(x: Array) -> Any:
    """Return whether points lie on a face of the cube other than x = 1. Edges of x = 1 belong to the other faces."""
    return ((x == 0) | (x == 1))[1:].any(axis=0) | (x[0] == 0)
