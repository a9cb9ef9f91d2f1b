"""Planted faults: models that are wrong in one way each, and the checks that must say so.

A check that cannot fail is worth nothing. Each fault here has been met in the field or is easily made; the tests hold the referee
to the table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, identity, kron

from ..edges import EdgeForm
from ..edges.topology import LOCAL_EDGES
from ..materials import Hypothesis, Isotropic
from ..mesh import SimplexMesh
from ..system import System
from ..terms import StVK

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fault:
    """A way to be wrong.

    Attributes
    ----------
    description : what is wrong, and where it was met.
    make : a faulty candidate for a mesh and a material.
    caught_by : the checks that must fail, of a homogeneous solid with `lambda != mu`, `nu != 0`.
    """

    description: str
    make: Callable[[SimplexMesh, StVK], Any]
    caught_by: frozenset[str]


@dataclass(frozen=True)
class _Altered:
    """A term whose coefficients are changed on the way to the mesh."""

    term: StVK
    change: Callable[[Array], None]

    def bind(self, mesh: SimplexMesh) -> EdgeForm:
        coefficients = self.term.coefficients(mesh).copy()
        self.change(coefficients)
        return EdgeForm(mesh.p, mesh.t[:, mesh.elements(self.term.region)], coefficients)


class _OtherTangent:
    """Right W and F, another K."""

    def __init__(self, body: System, tangent: Callable[[Array], Any]) -> None:
        self.energy, self.internal_force, self.tangent = body.energy, body.internal_force, tangent


class _Linear:
    """Small-strain elasticity: `W = 1/2 u' K0 u`."""

    def __init__(self, body: System) -> None:
        self._K0 = body.tangent(np.zeros(body.ndofs))

    def energy(self, u: Array) -> float:
        return float(u @ (self._K0 @ u)) / 2

    def internal_force(self, u: Array) -> Array:
        return np.asarray(self._K0 @ u)

    def tangent(self, u: Array) -> csr_matrix:
        return self._K0


class _Transposed:
    """Components one after another instead of vertex by vertex."""

    def __init__(self, body: System) -> None:
        self._body = body
        self._order = np.arange(body.ndofs).reshape(-1, body.mesh.d).T.ravel()

    def energy(self, u: Array) -> float:
        return self._body.energy(u)

    def internal_force(self, u: Array) -> Array:
        return self._body.internal_force(u)[self._order]

    def tangent(self, u: Array) -> csr_matrix:
        return csr_matrix(self._body.tangent(u)[self._order][:, self._order])


def _with_lame(lam_factor: float, mu_factor: float) -> Callable[[SimplexMesh, StVK], System]:
    def make(mesh: SimplexMesh, term: StVK) -> System:
        assert isinstance(term.material, Isotropic)
        lam, mu = term.material.lame(Hypothesis.SOLID)
        return System(mesh, StVK(Isotropic.from_lame(lam_factor * lam, mu_factor * mu), term.region))

    return make


def _altered(change: Callable[[Array], None]) -> Callable[[SimplexMesh, StVK], System]:
    return lambda mesh, term: System(mesh, _Altered(term, change))


def _drop_pairs(L: Array) -> None:
    L *= np.eye(L.shape[1])


def _drop_opposite(L: Array) -> None:
    i, j = _opposite(L.shape[1])
    L[:, i, j] = L[:, j, i] = 0.0


def _flip_one_opposite(L: Array) -> None:
    (i, *_), (j, *_) = _opposite(L.shape[1])
    L[len(L) // 2, [i, j], [j, i]] *= -1


def _opposite(m: int) -> tuple[list[int], list[int]]:
    """Local numbers of the three pairs of edges of a tetrahedron that do not meet."""
    edges = LOCAL_EDGES[3]
    pairs = [(i, j) for i in range(m) for j in range(i) if not set(edges[i]) & set(edges[j])]
    return [i for i, _ in pairs], [j for _, j in pairs]


def _no_geometric_term(mesh: SimplexMesh, term: StVK) -> _OtherTangent:
    body, form = System(mesh, term), term.bind(mesh)

    def tangent(u: Array) -> csr_matrix:
        tension, _ = form.tension(u.reshape(-1, mesh.d))
        a, b = form.edges
        entries = np.concatenate([tension, tension, -tension, -tension])
        laplacian = coo_matrix((entries, (np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a]))), shape=(mesh.nv, mesh.nv))
        return csr_matrix(body.tangent(u) - kron(laplacian, identity(mesh.d)))

    return _OtherTangent(body, tangent)


def _scaled_tangent(mesh: SimplexMesh, term: StVK) -> _OtherTangent:
    body = System(mesh, term)
    return _OtherTangent(body, lambda u: -body.tangent(u))


_VALUE = frozenset({"agreement", "closed forms"})
_TANGENT = frozenset({"agreement", "derivatives"})

#: Names and faults; the name is what a table shows.
FAULTS: dict[str, Fault] = {
    "twice lambda": Fault("lambda doubled, as MuJoCo 3.3 to 3.17 did in 3D; invisible at nu = 0", _with_lame(2.0, 1.0), _VALUE),
    "half mu": Fault("engineering shear strain taken for the tensor's", _with_lame(1.0, 0.5), _VALUE),
    "no pairs": Fault("the spring network: the diagonal of L alone", _altered(_drop_pairs), _VALUE | {"patch test"}),
    "no opposite pairs": Fault("pairs of edges that do not meet are forgotten", _altered(_drop_opposite), _VALUE | {"patch test"}),
    "one wrong sign": Fault("one opposite pair of one tetrahedron", _altered(_flip_one_opposite), _VALUE | {"patch test"}),
    "no geometric term": Fault("K without the edge tensions (initial stress)", _no_geometric_term, _TANGENT),
    "linear strain": Fault("small-strain elasticity", lambda mesh, term: _Linear(System(mesh, term)), _VALUE | {"invariance"}),
    "wrong sign of K": Fault("the derivative of the external instead of the internal force", _scaled_tangent, _TANGENT),
    "components first": Fault("degrees of freedom component by component", lambda m, t: _Transposed(System(m, t)), _VALUE),
}
