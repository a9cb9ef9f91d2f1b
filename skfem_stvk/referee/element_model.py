"""Element model in plain NumPy with arbitrary tables and moduli, which faults and hypotheses modify."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from ..arguments import Array
from ..mesh import ElementMesh
from ..terms import StVK
from .bodies import elasticity
from .discretisation import Discretisation, derivatives


def unchanged(F: Array) -> Array:
    """Return ones (nt, nq), so that every point has its own measure."""
    return np.ones(F.shape[:2])


def green_lagrange(D: Array) -> Array:
    """Return `E = (F'F - I)/2` for displacement gradients `D = F - I` (..., d, d)."""
    return np.asarray((D + np.swapaxes(D, -1, -2) + np.swapaxes(D, -1, -2) @ D) / 2)


def second_piola(F: Array, S: Array) -> Array:
    """Return `S`."""
    return S


@dataclass(frozen=True)
class ElementModel:
    """W, F and K of elements of the same dimension as the space.

    Attributes
    ----------
    p
        (d, nv) coordinates of the nodes that have displacements.
    X
        (n, nt, d) rest positions of the nodes of each element.
    t
        (n, nt) nodes of the elements.
    table
        (nq, n, d) derivatives of the shape functions.
    weights
        (nq,) weights of the points.
    tensor
        (1 or nt, d, d, d, d) elasticity tensors C of `S = C : E`.
    counted
        Function that returns factors (nt, nq) of the points for deformation gradients (nt, nq, d, d).
    initial
        Factor of the initial-stress part of K, a number or (nt, 1, 1).
    initial_from
        Function that returns the stress in the initial-stress part of K from `F` and `S`.
    strain
        Function that returns the strain for displacement gradients.
    stress
        Function that returns the first Piola-Kirchhoff stress `P` of the internal force from `F` and `S`.
    derived
        Whether K is the derivative of the internal force. If not, it is K of St. Venant-Kirchhoff, from `F` and `S`.
    """

    p: Array
    X: Array
    t: NDArray[np.int32]
    table: Array
    weights: Array
    tensor: Array
    counted: Callable[[Array], Array] = unchanged
    initial: float | Array = 1.0
    initial_from: Callable[[Array, Array], Array] = second_piola
    strain: Callable[[Array], Array] = green_lagrange
    stress: Callable[[Array, Array], Array] = np.matmul
    derived: bool = False

    def energy(self, u: Array) -> float:
        """Return the strain energy [J]."""
        _, measure, D = self._state(u)
        E, S = self._strain_and_stress(D)
        return float((measure * (E * S).sum(axis=(2, 3))).sum() / 2)

    def internal_force(self, u: Array) -> Array:
        """Return the internal force (ndofs,) [N]."""
        gradients, measure, D = self._state(u)
        force = np.zeros(self.p.T.shape)
        np.add.at(force, self.t, np.einsum("tq,tqiJ,tqaJ->ati", measure, self._P(D), gradients, optimize=True))
        return force.ravel()

    def tangent(self, u: Array) -> csr_matrix:
        """Return the tangent stiffness [N/m]."""
        g, measure, D = self._state(u)
        if self.derived:
            K = np.einsum("tq,tqiJkL,tqaJ,tqbL->taibk", measure, self._derivative(D), g, g, optimize=True)
        else:
            F, tensor = np.eye(len(self.p)) + D, np.broadcast_to(self.tensor, (self.t.shape[1], *self.tensor.shape[1:]))
            K = np.einsum("tq,tqiM,tMJNL,tqkN,tqaJ,tqbL->taibk", measure, F, tensor, F, g, g, optimize=True)
            initial = self.initial * self.initial_stress(u)
            for i in range(len(self.p)):
                K[:, :, i, :, i] += initial
        d = len(self.p)
        dofs = d * self.t.T[:, :, None] + np.arange(d)
        rows, columns = np.broadcast_to(dofs[:, :, :, None, None], K.shape), np.broadcast_to(dofs[:, None, None], K.shape)
        return csr_matrix(coo_matrix((K.ravel(), (rows.ravel(), columns.ravel())), shape=(self.p.size,) * 2))

    def initial_stress(self, u: Array) -> Array:
        """Return the initial-stress stiffness (nt, n, n) between the nodes of each element [N/m], equal for all components."""
        g, measure, D = self._state(u)
        stress = self.initial_from(np.eye(len(self.p)) + D, self._strain_and_stress(D)[1])
        return np.asarray(np.einsum("tq,tqJL,tqaJ,tqbL->tab", measure, stress, g, g, optimize=True))

    def displacement_gradient(self, u: Array) -> Array:
        """Return `F - I` at each point (nt, nq, d, d)."""
        return self._state(u)[2]

    def _state(self, u: Array) -> tuple[Array, Array, Array]:
        """Return gradients (nt, nq, n, d), measures (nt, nq), and displacement gradients (nt, nq, d, d)."""
        base_vectors = np.einsum("qai,atc->tqci", self.table, self.X)
        gradients = np.einsum("qai,tqic->tqac", self.table, np.linalg.inv(base_vectors))
        D = np.einsum("ati,tqaJ->tqiJ", u.reshape(self.p.T.shape)[self.t], gradients)
        return gradients, np.abs(np.linalg.det(base_vectors)) * self.weights * self.counted(np.eye(len(self.p)) + D), D

    def _strain_and_stress(self, D: Any) -> tuple[Any, Any]:
        """Return `E` and `S` (nt, nq, d, d)."""
        E, tensor = self.strain(D), np.broadcast_to(self.tensor, (self.t.shape[1], *self.tensor.shape[1:]))
        return E, np.einsum("tIJKL,tqKL->tqIJ", tensor, E, optimize=True)

    def _P(self, D: Any) -> Any:
        return self.stress(np.eye(len(self.p)) + D, self._strain_and_stress(D)[1])

    def _derivative(self, D: Array) -> Array:
        """Return `dP_iJ/dF_kL` (nt, nq, d, d, d, d), by a complex step, which has no truncation error."""
        d, step = len(self.p), 1e-30
        A = np.zeros((*D.shape, d, d))
        for k, L in product(range(d), repeat=2):
            moved = D.astype(complex)
            moved[..., k, L] += 1j * step
            A[..., k, L] = self._P(moved).imag / step
        return A


def model_of(mesh: ElementMesh, terms: Sequence[StVK]) -> ElementModel:
    """Return the correct model of a body, by the usual rule. The elements must have the dimension of the space."""
    discretisation = Discretisation(mesh.element.name)
    points, weights = discretisation.points
    table = derivatives(discretisation.kind, points).astype(float)
    return ElementModel(mesh.p, mesh.p.T[mesh.t], mesh.t, table, weights, elasticity(mesh, terms, discretisation))


def of_model(model: Any) -> Callable[[Array, str], dict[str, Any]]:
    """Return a function of the displacements and the requested quantities that returns those of W, F and K."""
    methods = {"W": "energy", "F": "internal_force", "K": "tangent"}
    return lambda u, quantities: {quantity: getattr(model, methods[quantity])(u) for quantity in quantities}


# Strains and stresses that are mistaken for those of St. Venant-Kirchhoff. Strains take displacement gradients `D = F - I`
# (..., d, d), stresses take `F` and `S = C : E`. All accept complex numbers, because `_derivative` uses a complex step.
# `C = F'F`, `b = F F'`.


def biot(D: Array) -> Array:
    """Return `U - I` with the stretch `U`, the positive root of `C`."""
    return np.asarray(_stretch(np.eye(D.shape[-1]) + D) - np.eye(D.shape[-1]))


def small_strain(D: Array) -> Array:
    """Return `(D + D')/2` for the displacement gradient `D`."""
    return np.asarray((D + np.swapaxes(D, -1, -2)) / 2)


def almansi(D: Array) -> Array:
    """Return `(I - b^-1)/2`, the strain of Euler and Almansi."""
    return _almansi(np.swapaxes(D, -1, -2))


def pulled_back_almansi(D: Array) -> Array:
    """Return `(I - C^-1)/2`. Its principal values are those of `almansi`."""
    return _almansi(D)


def of_left_stretch(D: Array) -> Array:
    """Return `(b - I)/2`."""
    return np.asarray((D + np.swapaxes(D, -1, -2) + D @ np.swapaxes(D, -1, -2)) / 2)


def stress_times_gradient(F: Array, S: Array) -> Array:
    """Return `P = S F`."""
    return np.asarray(S @ F)


def transposed_gradient_times_stress(F: Array, S: Array) -> Array:
    """Return `P = F' S`."""
    return np.asarray(np.swapaxes(F, -1, -2) @ S)


def cauchy(F: Array, S: Array) -> Array:
    """Return `F S F'/J`, the Cauchy stress."""
    return np.asarray(F @ S @ np.swapaxes(F, -1, -2) / np.linalg.det(F)[..., None, None])


def derivative_of_biot(F: Array, S: Array) -> Array:
    """Return `P = dW/dF = 2 F X` for `W = 1/2 E : C : E` with Biot's strain, where `U X + X U = S`."""
    d, U, one = F.shape[-1], _stretch(F), np.eye(F.shape[-1])
    both = np.einsum("...ik,jl->...ijkl", U, one) + np.einsum("ik,...lj->...ijkl", one, U)
    X = np.linalg.solve(both.reshape(*F.shape[:-2], d * d, d * d), S.reshape(*S.shape[:-2], d * d, 1))
    return np.asarray(2 * F @ X.reshape(S.shape))


def derivative_of_almansi(F: Array, S: Array) -> Array:
    """Return `P = dW/dF = F C^-1 S C^-1` for `W = 1/2 E : C : E` with `pulled_back_almansi`."""
    inverse = np.linalg.inv(np.swapaxes(F, -1, -2) @ F)
    return np.asarray(F @ inverse @ S @ inverse)


def _almansi(D: Array) -> Array:
    F = np.eye(D.shape[-1]) + D
    return np.asarray((np.eye(D.shape[-1]) - np.linalg.inv(np.swapaxes(F, -1, -2) @ F)) / 2)


def _stretch(F: Array) -> Array:
    """Return the positive root `U` of `C`, from the polar decomposition `F = R U` by Newton's iteration for R."""
    R = F
    for _ in range(100):  # each step halves the error of large stretches until R is near, then squares it
        before, R = R, (R + np.swapaxes(np.linalg.inv(R), -1, -2)) / 2
        if np.abs(R - before).max(initial=0.0) <= 1e-14:
            break
    U = np.swapaxes(R, -1, -2) @ F
    return np.asarray((U + np.swapaxes(U, -1, -2)) / 2)
