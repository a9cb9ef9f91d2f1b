"""Sampled elements: a few elements with non-negative weights, whose forces in the span of some fields approximate those of all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StateError, StvkError
from ...mesh import ElementMesh
from ...system import System
from ...terms import Body
from .quartic import ProjectedTerms

#: Numbers of states for fitting the weights, and for testing them.
FITTED, UNSEEN = 24, 8
#: Number of candidate elements, drawn at random, and the fraction of the requested number that each round adds.
CANDIDATES, AT_ONCE = 2000, 0.05
#: Maximum number of rounds, and the fraction by which the error must fall in each.
MOST_ROUNDS, PROGRESS = 100, 1e-4
#: Largest displacement of these states as a fraction of the size of the body, and the maximum number of halvings where elements
#: invert.
LARGE, MOST = 0.2, 12

#: Shorthand parameters of a law, reset where it is copied, since its material is set.
NO_SHORTHAND: dict[str, Any] = {"young": None, "poisson": None, "density": None}


class Sampling(NamedTuple):
    """Sampled elements of a term, and their errors.

    Attributes
    ----------
    elements
        (n,) ids of the sampled elements.
    weights
        (n,) number of elements that each of them represents; none is negative.
    fitted, unseen
        Errors of the reduced force, relative to its size, over the states for fitting, and over others.
    """

    elements: NDArray[np.int64]
    weights: Array
    fitted: float
    unseen: float


def sampled_part(body: System, term: Any, columns: Array, count: int) -> tuple[ProjectedTerms, Sampling]:
    """Return the part of a term in W, F and K from about `count` of its elements, at a cost that does not depend on the mesh.

    Elements are chosen greedily: those whose forces are most along the residual come first. Weights are fitted by non-negative
    least squares over random states, in which softer fields have larger amounts. Source: An, Kim, James, "Optimizing cubature for
    efficient integration of subspace deformations" (2008).

    StvkError for terms without a material that has Young's modulus.
    """
    if not hasattr(getattr(term, "material", None), "young") or getattr(term, "simplices", None) is not None:
        raise StvkError(
            f"sampled: {type(term).__name__} cannot be sampled; expected laws on elements of the mesh with young and poisson, such "
            "as NeoHookean. Leave sampled out, so that its force is computed on the mesh."
        )
    rng, ids = np.random.default_rng(0), body.mesh.elements(term.region)
    chosen = rng.permutation(len(ids))[:CANDIDATES]
    apart = _SeparateElements(body, term, ids, columns)
    A, b = _equations(apart, _states(body, columns, apart, rng), chosen)
    rows = FITTED * columns.shape[1]
    own, weights = _greedy(A[:rows], b[:rows], min(count, len(chosen)))
    errors = [
        np.linalg.norm(A[part][:, own] @ weights - b[part]) / np.linalg.norm(b[part]) for part in (slice(rows), slice(rows, None))
    ]
    found = Sampling(ids[chosen[own]], weights, *map(float, errors))
    return _part(body, term, chosen[own], found, columns), found


class _SeparateElements:
    """Elements of a term, each with separate nodes, so that forces on nodes are those of elements."""

    def __init__(self, body: System, term: Any, ids: NDArray[np.int64], columns: Array) -> None:
        t = body.mesh.t[:, ids]
        apart: NDArray[np.int32] = np.arange(t.size, dtype=np.int32).reshape(t.shape, order="F")
        mesh = ElementMesh(body.mesh.p[:, t.ravel("F")], apart, element=body.mesh.element)
        self.bound = replace(term, region=None, **NO_SHORTHAND).bind(Body(mesh, [], body.rule), np.float64)
        self.t, self._d, self._columns = t, body.mesh.d, columns.reshape(body.mesh.nv, body.mesh.d, -1)

    def forces(self, z: Array, chosen: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return forces (R, n) of the `chosen` elements over the fields, and those of all (R,)."""
        on_nodes = np.zeros((self.t.size, self._d))
        self.bound.energy_and_force((np.ascontiguousarray(self._columns @ z))[self.t.ravel("F")], on_nodes)
        f: Array = on_nodes.reshape(self.t.shape[1], len(self.t), self._d)
        total = np.zeros((len(self._columns), self._d))
        np.add.at(total, self.t.T, f)
        own = np.einsum("adr,ad->r", self._columns, total)
        return np.einsum("eadr,ead->re", self._columns[self.t[:, chosen].T], f[chosen], optimize=True), own


def _states(body: System, columns: Array, apart: _SeparateElements, rng: np.random.Generator) -> Array:
    """Return amounts (states, R), larger for softer fields, and small enough for finite forces."""
    operator = body.linear_operator(np.zeros(body.ndofs))
    stiffness = np.array([column @ (operator @ column) for column in np.ascontiguousarray(columns.T)])
    states = rng.standard_normal((FITTED + UNSEEN, columns.shape[1])) / np.sqrt(stiffness)
    largest = LARGE * float(np.linalg.norm(np.ptp(body.mesh.p, axis=1)))
    states *= largest / np.abs(columns @ states.T).max(axis=0)[:, None]
    states *= np.linspace(0.2, 1.0, len(states))[rng.permutation(len(states))][:, None]
    for _ in range(MOST):
        try:
            if all(np.isfinite(apart.forces(z, np.arange(1))[1]).all() for z in states):
                return np.asarray(states)
        except StateError:  # inverted elements
            pass
        states /= 2
    raise StateError("sampled: forces are not finite even in small states; are elements of the body flat?")


def _equations(apart: _SeparateElements, states: Array, chosen: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return forces of elements as columns, and of all elements, each state relative to its total."""
    found = [apart.forces(z, chosen) for z in states]
    sizes = [np.linalg.norm(own) for _, own in found]
    A = np.concatenate([each / size for (each, _), size in zip(found, sizes, strict=True)])
    return A, np.concatenate([own / size for (_, own), size in zip(found, sizes, strict=True)])


def _greedy(A: Array, b: Array, count: int) -> tuple[NDArray[np.int64], Array]:
    """Return columns and their non-negative weights `w` with `A w` close to `b`."""
    from scipy.optimize import nnls  # large: imported only for sampling

    norms, own = np.maximum(np.linalg.norm(A, axis=0), np.finfo(float).tiny), np.empty(0, dtype=np.int64)
    r, weights = b, np.empty(0)
    for _ in range(MOST_ROUNDS):
        along = A.T @ r / norms
        along[own] = -np.inf
        best = np.argsort(-along)[: min(count - len(own), max(1, int(AT_ONCE * count)))]
        best = best[along[best] > 0]
        if not len(best):
            break
        own = np.concatenate([own, best])
        weights = nnls(A[:, own], b)[0]
        own, weights = own[weights > 0], weights[weights > 0]
        before, r = np.linalg.norm(r), b - A[:, own] @ weights
        if np.linalg.norm(r) > (1 - PROGRESS) * before:
            break
    return own, weights


def _part(body: System, term: Any, chosen: NDArray[np.int64], found: Sampling, columns: Array) -> ProjectedTerms:
    """Return W, F and K of the sampled elements, with stiffnesses times weights, on only their nodes."""
    mesh = body.mesh
    nodes, t = np.unique(mesh.t[:, found.elements], return_inverse=True)
    small = ElementMesh(mesh.p[:, nodes], t.reshape(len(mesh.t), -1).astype(np.int32), element=mesh.element)

    def of(value: Any) -> Any:
        return value if value is None or np.ndim(value) == 0 else np.asarray(value)[chosen]

    unweighted = term.material
    material = replace(
        unweighted, young=np.asarray(of(unweighted.young)) * found.weights, poisson=of(unweighted.poisson), density=None
    )
    weighted = replace(term, material=material, region=None, thickness=of(term.thickness), area=of(term.area), **NO_SHORTHAND)
    own = columns.reshape(mesh.nv, mesh.d, -1)[nodes].reshape(len(nodes) * mesh.d, -1)
    return ProjectedTerms(small, [weighted.bind(Body(small, [], body.rule), np.float64)], own)
