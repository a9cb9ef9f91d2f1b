"""Faulty elements: W, F and K by the plain formulas, with one fault in the tables, moduli, measures or strains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..arguments import Array
from ..mesh import ElementMesh
from ..terms import StVK
from .bodies import elasticity, hourglass_control
from .discretisation import Discretisation, derivatives
from .element_model import ElementModel, model_of
from .faulty_systems import FaultyModel
from .reference import ReferenceOnePoint
from .reference.kinds import KINDS, middles

Terms = Sequence[StVK]


def altered(change: Callable[[ElementModel], dict[str, Any]], mesh: ElementMesh, terms: Terms) -> ElementModel:
    correct = model_of(mesh, terms)
    return replace(correct, **change(correct))


def with_shear(model: ElementModel, factor: float) -> dict[str, Any]:
    """Return the change that multiplies shear moduli such as `C_1212` by a factor, but not `C_1122` and `C_1111`."""
    tensor = model.tensor.copy()
    for i in range(3):
        for j in range(3):
            if i != j:
                tensor[:, i, j, i, j] *= factor
                tensor[:, i, j, j, i] *= factor
    return {"tensor": tensor}


def unsymmetric_moduli(model: ElementModel) -> dict[str, Any]:
    tensor = model.tensor.copy()
    tensor[:, 0, 0, 1, 1] *= 1.01
    return {"tensor": tensor}


def shifted_materials(model: ElementModel) -> dict[str, Any]:
    return {"tensor": np.roll(model.tensor, 1, axis=0)}


def deformed_volume(model: ElementModel) -> dict[str, Any]:
    return {"counted": lambda F: np.abs(np.linalg.det(F))}


def signed_volume(model: ElementModel) -> dict[str, Any]:
    base_vectors = np.einsum("qai,atc->tqci", model.table, model.X)
    return {"counted": lambda F: np.sign(np.linalg.det(base_vectors))}


def inverted_skipped(model: ElementModel) -> dict[str, Any]:
    return {"counted": lambda F: (np.linalg.det(F) > 0).astype(float)}


def counted(element: int, model: ElementModel, times: float) -> dict[str, Any]:
    factors = np.ones((model.t.shape[1], 1))
    factors[element] = times
    return {"counted": lambda F: np.broadcast_to(factors, F.shape[:2])}


def middle_element(change: Callable[[int, ElementModel], dict[str, Any]], mesh: ElementMesh, terms: Terms) -> ElementModel:
    """Return a model in which only the element in the middle of the list is changed."""
    return altered(partial(change, mesh.nt // 2), mesh, terms)


def strained(
    strain: Callable[[Array], Array], stress: Callable[[Array, Array], Array], derived: bool, mesh: ElementMesh, terms: Terms
) -> ElementModel:
    """Return a model with another strain in `S = C : E`, or another first Piola-Kirchhoff stress from `S`."""
    return replace(model_of(mesh, terms), strain=strain, stress=stress, derived=derived)


def initial_stress_in_part(model: ElementModel) -> dict[str, Any]:
    """Return the change that leaves out the initial stress in K of every third element."""
    return {"initial": np.where(np.arange(model.t.shape[1]) % 3 == 0, 0.0, 1.0)[:, None, None]}


def without_lambda_in_tangent(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model without lambda in the part of K that is not the initial stress."""
    right, one = model_of(mesh, terms), np.eye(mesh.d)
    lam = right.tensor[..., 0, 0, 1, 1][..., None, None, None, None] * np.einsum("ij,kl->ijkl", one, one)
    left_out = replace(right, tensor=lam, initial=0.0)
    return FaultyModel(right.energy, right.internal_force, lambda u: right.tangent(u) - left_out.tangent(u))


def point_dropped(model: ElementModel) -> dict[str, Any]:
    return {"table": model.table[:-1], "weights": model.weights[:-1]}


def wrong_weight(model: ElementModel) -> dict[str, Any]:
    return {"weights": model.weights * np.where(np.arange(len(model.weights)) == 0, 1 + 1e-6, 1)}


def last_two_exchanged(model: ElementModel) -> dict[str, Any]:
    order = [*range(len(model.t) - 2), len(model.t) - 1, len(model.t) - 2]
    return {"X": model.X[order], "t": model.t[order]}


def midside_nodes_in_a_cycle(model: ElementModel) -> dict[str, Any]:
    order = [*range(len(model.t) - 3), len(model.t) - 2, len(model.t) - 1, len(model.t) - 3]
    return {"X": model.X[order], "t": model.t[order]}


def straightened(mesh: ElementMesh, terms: Terms) -> ElementModel:
    correct = model_of(mesh, terms)
    X = correct.X.copy()
    for middle, (a, b) in middles(mesh.element.name):
        X[middle] = (X[a] + X[b]) / 2
    return replace(correct, X=X)


def without_control(mesh: ElementMesh, terms: Terms) -> ReferenceOnePoint:
    discretisation = Discretisation(mesh.element.name, "one-point", 0.0)
    return ReferenceOnePoint(
        mesh.p, mesh.t, elasticity(mesh, terms, discretisation), hourglass_control(mesh, terms, discretisation)
    )


def one_point(mesh: ElementMesh, terms: Terms) -> ElementModel:
    """Return a model whose integrals use the centroid as the only point."""
    of, correct = KINDS[mesh.element.name], model_of(mesh, terms)
    centroid = np.mean(of.nodes[: of.corners], axis=0, dtype=float)[:, None]
    return replace(
        correct, table=derivatives(mesh.element.name, centroid).astype(float), weights=correct.weights.sum(keepdims=True)
    )


def gradients_at_the_centre(mesh: ElementMesh, terms: Terms) -> ElementModel:
    table = derivatives(mesh.element.name, np.full((mesh.k, 1), 0.5)).astype(float)
    return replace(model_of(mesh, terms), table=table, weights=np.ones(1))
