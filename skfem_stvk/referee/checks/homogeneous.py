"""Closed forms of homogeneous states, and the patch test.

With `e = (s^2 - 1)/2`, Lame constants `lam`, `mu` within the element's dimensions, nominal stress `P` (force per rest area):

    uniaxial strain     P_11 = (lam + 2 mu)/2 s (s^2 - 1), P_22 = lam e      W/V = (lam + 2 mu)/2 e^2
    uniaxial stress     P_11 = E/2 s (s^2 - 1),  t^2 = 1 - nu (s^2 - 1)      W/V = E/2 e^2
    equibiaxial         P_11 = P_22 = E/(2 (1 - nu)) s (s^2 - 1)             W/V = E/(1 - nu) e^2
    hydrostatic         P_ii = 3 K/2 s (s^2 - 1)                             W/V = 9 K/2 e^2
    simple shear g      P_12 = mu g + (lam/2 + mu) g^3, P_21 = mu g, P_11 = (lam/2 + mu) g^2, P_22 = (lam + 2 mu)/2 g^2,
                        P_33 = lam/2 g^2                                     W/V = mu g^2/2 + (lam/8 + mu/4) g^4

The patch test applies to every law: a homogeneous body under an affine motion has the same stress everywhere.

In two dimensions `E` and `nu` are the two-dimensional constants: `nu = lam/(lam + 2 mu)`, `E = 2 mu (1 + nu)`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...arguments import Array
from ..bodies import reference_on
from ..case import REFERENCE, Case
from ..discretisation import boundary_nodes
from ..implementations import Implementation
from ..judgement import LIMIT_BY_ASPECT, by_node, of_whole_body
from ..results import NotApplicable, Task

STRETCH, SHEAR = 1.15, 0.4
#: Deformation gradient of an affine state without symmetry: stretch, shear and rotation combined.
AFFINE = np.array([[1.2, 0.3, -0.1], [-0.2, 0.9, 0.25], [0.15, -0.1, 1.1]])


def uniaxial_strain(k: int, lam: float, mu: float) -> tuple[Array, Array, float]:
    F, P, s, e = _at(k)
    P[range(k), range(k)] = lam * e
    F[0, 0], P[0, 0] = s, (lam + 2 * mu) * s * e
    return F, P, (lam + 2 * mu) / 2 * e**2


def uniaxial_stress(k: int, lam: float, mu: float) -> tuple[Array, Array, float]:
    F, P, s, e = _at(k)
    E, nu = _young_and_poisson(k, lam, mu)
    F[range(1, k), range(1, k)] = np.sqrt(1 - 2 * nu * e)
    F[0, 0], P[0, 0] = s, E * s * e
    return F, P, E / 2 * e**2


def equibiaxial(k: int, lam: float, mu: float) -> tuple[Array, Array, float]:
    F, P, s, e = _at(k)
    E, nu = _young_and_poisson(k, lam, mu)
    F[range(2), range(2)], P[range(2), range(2)] = s, E / (1 - nu) * s * e
    if k == 3:
        F[2, 2] = np.sqrt(1 - 4 * nu / (1 - nu) * e)
    return F, P, E / (1 - nu) * e**2


def hydrostatic(k: int, lam: float, mu: float) -> tuple[Array, Array, float]:
    F, P, s, e = _at(k)
    bulk = lam + 2 * mu / 3
    F[range(3), range(3)], P[range(3), range(3)] = s, 3 * bulk * s * e
    return F, P, 9 / 2 * bulk * e**2


def simple_shear(k: int, lam: float, mu: float) -> tuple[Array, Array, float]:
    F, P, _, _ = _at(k)
    g = SHEAR
    F[0, 1] = g
    P[0, 1], P[1, 0] = mu * g + (lam / 2 + mu) * g**3, mu * g
    P[range(k), range(k)] = lam / 2 * g**2
    P[0, 0], P[1, 1] = (lam / 2 + mu) * g**2, (lam + 2 * mu) / 2 * g**2
    return F, P, mu * g**2 / 2 + (lam / 8 + mu / 4) * g**4


ClosedForm = Callable[[int, float, float], tuple[Array, Array, float]]
#: Functions that return deformation gradient, nominal stress and energy density, and the dimensions where each state is distinct.
CLOSED_FORMS: dict[str, tuple[ClosedForm, tuple[int, ...]]] = {
    "uniaxial strain": (uniaxial_strain, (2, 3)),
    "uniaxial stress": (uniaxial_stress, (1, 2, 3)),
    "equibiaxial": (equibiaxial, (2, 3)),
    "hydrostatic": (hydrostatic, (3,)),
    "simple shear": (simple_shear, (2, 3)),
}


def _at(k: int) -> tuple[Array, Array, float, float]:
    return np.eye(k), np.zeros((k, k)), STRETCH, (STRETCH**2 - 1) / 2


def _young_and_poisson(k: int, lam: float, mu: float) -> tuple[float, float]:
    """Return `E` and `nu` of an isotropic law in `k` dimensions. In one dimension `lam` is `E`."""
    if k == 1:
        return lam + 2 * mu, 0.0
    nu = lam / (2 * (lam + mu)) if k == 3 else lam / (lam + 2 * mu)
    return 2 * mu * (1 + nu), nu


def homogeneous_states(case: Case) -> Iterator[Task]:
    """Yield the closed forms and the patch test on the homogeneous copy. A candidate is tested only if the body is its own copy."""
    copy = _of_the_copy(case)
    for implementation in copy.implementations:
        for name in CLOSED_FORMS:
            for quantity, needs in (("W", "W"), ("P", "F")):
                measure = partial(_closed_form, copy, implementation, quantity, name)
                yield Task("closed forms", implementation, quantity, name, needs, measure)
        yield Task("patch test", implementation, "F", "affine", "F", partial(_patch_test, copy, implementation))


def _of_the_copy(case: Case) -> Case:
    """Return the case of the homogeneous copy, which is `case` itself if the body is its own copy."""
    body = case.homogeneous
    if body.same:
        return case
    mesh, discretisation, ndofs = case.mesh, case.discretisation, case.ours.ndofs
    ours = Implementation("homogeneous copy", case.build(mesh, [body.term], discretisation), ndofs)
    reference = Implementation(
        REFERENCE, reference_on(mesh.p, mesh.t, body.tensor, discretisation, body.control(discretisation)), ndofs
    )
    return replace(case, ours=ours, reference=reference)


def _refuse(case: Case, implementation: Implementation) -> None:
    if case.mesh.k < case.mesh.d:
        raise NotApplicable("on membranes and cables in space an affine motion is no homogeneous state")
    if implementation is case.candidate and not case.homogeneous.same:
        raise NotApplicable("closed forms are for homogeneous isotropic bodies; the candidate's is not")


def _closed_form(case: Case, implementation: Implementation, quantity: str, name: str) -> dict[str, Any]:
    _refuse(case, implementation)
    if not case.is_stvk(implementation):
        raise NotApplicable("the candidate does not claim to be St. Venant-Kirchhoff")
    form, dimensions = CLOSED_FORMS[name]
    k = case.mesh.k
    if k not in dimensions:
        raise NotApplicable(f"in {k}D this state is the same as another one")
    F, P, density = form(k, *case.homogeneous.lame)
    X = case.centred
    u = (X @ (F - np.eye(k)).T).ravel()
    volume, (lam, mu) = float(case.shape.volume.sum()), case.homogeneous.lame
    E = (F.T @ F - np.eye(k)) / 2
    strain = float(np.abs(E).max())
    reason = "1e-12 allows for round-off of a sum over all nodes: every mesh represents the closed form exactly"
    if quantity == "W":
        stress, parts = lam * np.trace(E) * np.eye(k) + 2 * mu * E, abs(lam) / 2 * np.trace(E) ** 2 + mu * (E * E).sum()
        lost = float(np.linalg.norm(stress)) * strain / (2 * density)  # dW = S : dE, where W = S : E/2
        limit = max(case.limits.of_body(u, max(1.0, lost)), LIMIT_BY_ASPECT * parts / density)  # parts cancel if lambda < 0
        return of_whole_body(abs(implementation.W(u) / volume - density), density, limit, "energy density", reason)
    mean = implementation.F(u).reshape(-1, k).T @ X / volume  # first moment of the nodal forces: sum f_a (x) X_a = integral of P
    largest = float(np.abs(P).max())
    limit = case.limits.of_body(u, max(1.0, (lam + 2 * mu) * strain / largest))  # lam tr E and 2 mu E may nearly cancel
    return of_whole_body(float(np.abs(mean - P).max()), largest, limit, "largest entry of the nominal stress", reason)


def _patch_test(case: Case, implementation: Implementation) -> dict[str, Any]:
    _refuse(case, implementation)
    if not case.is_stvk(implementation) and not case.candidate_is_homogeneous:
        raise NotApplicable("the candidate does not claim to be a homogeneous body")
    k = case.mesh.k
    inner = np.setdiff1d(np.arange(case.mesh.nv), boundary_nodes(case.mesh))
    if not len(inner):
        raise NotApplicable("the mesh has no inner nodes")
    if case.discretisation.kind == "quadratic tetrahedra" and case.discretisation.quadrature is None:
        inner = np.setdiff1d(inner, case.mesh.t[:, case.shape.curved])
        if not len(inner):
            raise NotApplicable(
                "four points do not integrate the gradients of shape functions on curved tetrahedra exactly, and all inner nodes "
                "belong to such; quadrature='exact' does"
            )
    F = AFFINE[:k, :k]
    u = (case.centred @ (F - np.eye(k)).T).ravel()
    forces, error = implementation.F(u).reshape(-1, k), np.zeros_like(case.centred)
    error[inner] = np.abs(forces[inner])
    reason = "1e-12 allows for round-off: under constant stress no force is left on inner nodes"
    facets = np.tile(case.shape.volume * case.shape.steepest, len(case.mesh.t))  # the largest of each element
    scale = _stress(case, implementation, F, forces) * np.bincount(case.mesh.t.ravel(), weights=facets, minlength=case.mesh.nv)
    words = f"stress on the facets around, {len(inner)} inner nodes"
    return by_node(case.mesh, error.ravel(), scale, case.limits.of_nodes(u), words, reason)


def _stress(case: Case, implementation: Implementation, F: Array, forces: Array) -> float:
    """Return the largest nominal stress under an affine motion. For another law, use the mean stress from nodal forces (nv, k)."""
    if not case.is_stvk(implementation):
        return float(np.abs(forces.T @ case.centred).max() / case.shape.volume.sum())
    (lam, mu), E = case.homogeneous.lame, (F.T @ F - np.eye(len(F))) / 2
    return float(np.abs(F @ (lam * np.trace(E) * np.eye(len(F)) + 2 * mu * E)).max())
