"""A manufactured solution: orders of convergence in L2 and H1 on unstructured meshes, here in 3D.

    u_i = t A_i sin(k_i . X + c_i)         P = F S,  S = lam tr(E) I + 2 mu E,  E = (F'F - I)/2
    b_i = -P_iJ,J,   P_iJ,J = F_iM,J S_MJ + F_iM S_MJ,J
    S_MJ,J = lam E_NN,M + 2 mu E_MJ,J,     E_MJ,K = (F_iM,K F_iJ + F_iM F_iJ,K)/2

with F_iJ = delta_iJ + u_i,J and F_iJ,K = u_i,JK. The displacement is prescribed on all faces but x = 1, where the traction P e_1
acts. In two dimensions, in plane strain, the first two components and coordinates are taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import skfem

from skfem_stvk import BodyForce, ElementMesh, StVK, System, Traction, solve_static

from .meshes import Array, moved_box
from .orders import fitted_order
from .study import Study

YOUNG, POISSON = 1.0e5, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
AMPLITUDE = np.array([0.08, -0.06, 0.05])
WAVES = np.array([[1.9, 1.1, -0.7], [-0.8, 2.1, 1.3], [1.2, -0.9, 2.0]])
PHASES = np.array([0.4, 1.3, -0.6])
CELLS = (8, 12, 16, 24)
ORDERS, LIMIT = {"L2": 2.0, "H1": 1.0}, 0.1


def manufactured(quick: bool = False) -> Study:
    """a manufactured solution in 3D converges with order 2 in L2 and 1 in H1"""
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
        ("relative to the solution's own norms; inner vertices are moved at random by up to a fifth of a cell",),
    )


def displacement(x: Array, t: float) -> Array:
    """`u` (d, n) at `x` (d, n)."""
    moved: Array = _amplitude(x, t) * np.sin(_phase(x))
    return moved


def gradient(x: Array, t: float) -> Array:
    """`u_i,J` (d, d, n)."""
    return np.einsum("in,iJ->iJn", _amplitude(x, t) * np.cos(_phase(x)), _waves(x))


def nominal_stress(x: Array, t: float) -> Array:
    """`P` (d, d, n) [Pa]."""
    F = gradient(x, t) + np.eye(len(x))[:, :, None]
    return np.einsum("iMn,MJn->iJn", F, _stress(F))


def body_force(x: Array, t: float) -> Array:
    """`b = -Div P` (d, n) [N/m^d]."""
    F = gradient(x, t) + np.eye(len(x))[:, :, None]
    dF = np.einsum("in,iJ,iK->iJKn", -_amplitude(x, t) * np.sin(_phase(x)), _waves(x), _waves(x))
    half = np.einsum("iMKn,iJn->MJKn", dF, F)
    dE = 0.5 * (half + half.swapaxes(0, 1))
    div_S = LAM * np.einsum("NNMn->Mn", dE) + 2 * MU * np.einsum("MJJn->Mn", dE)
    return -np.einsum("iMJn,MJn->in", dF, _stress(F)) - np.einsum("iMn,Mn->in", F, div_S)


def _amplitude(x: Array, t: float) -> Array:
    return t * AMPLITUDE[: len(x), None]


def _waves(x: Array) -> Array:
    return WAVES[: len(x), : len(x)]


def _phase(x: Array) -> Array:
    phase: Array = _waves(x) @ x + PHASES[: len(x), None]
    return phase


def _stress(F: Array) -> Array:
    """Second Piola-Kirchhoff stress (d, d, n)."""
    I = np.eye(len(F))[:, :, None]
    E = 0.5 * (np.einsum("iMn,iJn->MJn", F, F) - I)
    return LAM * np.einsum("MMn->n", E) * I + 2 * MU * E


def _errors(mesh: ElementMesh) -> tuple[float, float]:
    """Relative errors in L2 and in the H1 seminorm."""
    pull = Traction(lambda x: x[0] == 1, lambda x, t: nominal_stress(x, t)[:, 0])
    terms = (StVK(young=YOUNG, poisson=POISSON), BodyForce(body_force), pull)
    result = solve_static(System(mesh, terms, prescribed={_but_one_face: displacement}), steps=2, quiet=True)
    basis = skfem.Basis(skfem.MeshTet(mesh.p, mesh.t), skfem.ElementVector(skfem.ElementTetP1()), intorder=4)
    x, weights = np.asarray(basis.global_coordinates()), basis.dx.ravel()
    found, points = basis.interpolate(result.u), x.reshape(3, -1)
    errors = []
    for part, exact in ((np.asarray(found), displacement(points, 1.0)), (found.grad, gradient(points, 1.0))):
        off = part.reshape(exact.shape) - exact
        errors.append(float(np.sqrt((off**2 @ weights).sum() / (exact**2 @ weights).sum())))
    return errors[0], errors[1]


def _but_one_face(x: Array) -> Any:
    """Whether points lie on a face of the cube other than x = 1; its edges belong to the others."""
    return ((x == 0) | (x == 1))[1:].any(axis=0) | (x[0] == 0)
