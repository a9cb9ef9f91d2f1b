"""Planted faults: models that are wrong in one way each, and the checks that must say so.

A check that cannot fail is worth nothing. Each fault here has been met in the field or is easily made; the tests hold the referee
to the table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import coo_matrix, csr_matrix, identity, kron

from ..arguments import Array
from ..edges import Assembly
from ..edges.stiffness import GeneralStiffness
from ..edges.topology import LOCAL_EDGES
from ..errors import StvkError
from ..materials import Hypothesis, Isotropic
from ..mesh import ElementMesh
from ..system import System
from ..terms import Body, StVK


@dataclass(frozen=True)
class Fault:
    """A way to be wrong.

    Attributes
    ----------
    description : what is wrong, and where it was met.
    make : a faulty candidate for a mesh of tetrahedra and an isotropic term.
    caught_by : the checks, with the quantity, that must fail on a homogeneous body with `lambda != mu`, `nu != 0`.
    """

    description: str
    make: Callable[[ElementMesh, StVK], Any]
    caught_by: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class _Altered:
    """A term whose coefficients are changed on the way to the mesh."""

    term: StVK
    change: Callable[[Array], None]

    def bind(self, body: Body, dtype: DTypeLike = np.float64) -> Assembly:
        mesh, coefficients = body.mesh, self.term.coefficients(body.mesh).copy()
        self.change(coefficients)
        return Assembly(mesh.p, mesh.t[:, mesh.elements(self.term.region)], GeneralStiffness(lambda: coefficients), None, dtype)


@dataclass(frozen=True)
class _Model:
    """W, F and K as functions of u."""

    energy: Callable[[Array], float]
    internal_force: Callable[[Array], Array]
    tangent: Callable[[Array], csr_matrix]


def _disturbed(
    body: System,
    energy: Callable[[Array], float] = lambda u: 0.0,
    force: Callable[[Array], Any] = lambda u: 0.0,
    tangent: Callable[[Array], Any] | None = None,
) -> _Model:
    """A right model with something added to W, F or K."""
    return _Model(
        lambda u: body.energy(u) + energy(u),
        lambda u: body.internal_force(u) + np.asarray(force(u)),
        lambda u: body.tangent(u) if tangent is None else csr_matrix(body.tangent(u) + tangent(u)),
    )


def _linear(mesh: ElementMesh, term: StVK) -> _Model:
    """Small-strain elasticity: `W = 1/2 u' K0 u`."""
    body = System(mesh, term)
    K0 = body.tangent(np.zeros(body.ndofs))
    return _Model(lambda u: float(u @ (K0 @ u)) / 2, lambda u: np.asarray(K0 @ u), lambda u: K0)


def _transposed(mesh: ElementMesh, term: StVK) -> _Model:
    """Components one after another instead of vertex by vertex."""
    body = System(mesh, term)
    order = np.arange(body.ndofs).reshape(-1, mesh.d).T.ravel()
    return _Model(body.energy, lambda u: body.internal_force(u)[order], lambda u: csr_matrix(body.tangent(u)[order][:, order]))


def _with_lame(lam_factor: float, mu_factor: float, mesh: ElementMesh, term: StVK) -> System:
    _refuse_other_bodies(mesh, term)
    assert isinstance(term.material, Isotropic)
    lam, mu = term.material.lame(Hypothesis.SOLID)
    return System(mesh, StVK(Isotropic.from_lame(lam_factor * lam, mu_factor * mu), term.region))


def _altered(change: Callable[[Array], None], mesh: ElementMesh, term: StVK) -> System:
    _refuse_other_bodies(mesh, term)
    return System(mesh, _Altered(term, change))


def _refuse_other_bodies(mesh: ElementMesh, term: StVK) -> None:
    if mesh.k != 3 or not isinstance(term.material, Isotropic):
        raise StvkError(f"This fault is for isotropic tetrahedra; got {mesh.kind} of {type(term.material).__name__}.")


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


def _no_geometric_term(mesh: ElementMesh, term: StVK) -> _Model:
    form = term.bind(mesh).form

    def geometric(u: Array) -> csr_matrix:
        tension, (a, b) = form.tensions(u.reshape(-1, mesh.d)), form.edges
        entries = np.concatenate([tension, tension, -tension, -tension])
        laplacian = coo_matrix((entries, (np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a]))), shape=(mesh.nv, mesh.nv))
        return csr_matrix(kron(laplacian, identity(mesh.d)))

    return _disturbed(System(mesh, term), tangent=lambda u: -geometric(u))


def _wrong_sign_of_K(mesh: ElementMesh, term: StVK) -> _Model:
    body = System(mesh, term)
    return _disturbed(body, tangent=lambda u: -2 * body.tangent(u))


def _units(mesh: ElementMesh, term: StVK) -> tuple[System, float, float]:
    """The body, a force and a stiffness that are small on it, but far beyond round-off."""
    body = System(mesh, term)
    stiffness = 1e-6 * float(abs(body.tangent(np.zeros(body.ndofs))).max())
    return body, stiffness * float(np.ptp(mesh.p)) / mesh.nv, stiffness


def _lone_force(mesh: ElementMesh, term: StVK) -> _Model:
    body, force, _ = _units(mesh, term)
    return _disturbed(body, force=lambda u: force * _unit(mesh, 0, 0))


def _couple(mesh: ElementMesh, term: StVK) -> _Model:
    """Opposite forces along x at the lowest and the highest vertex: no sum, but a torque, and a mean stress P_13."""
    body, force, _ = _units(mesh, term)
    low, high = int(np.argmin(mesh.p[2])), int(np.argmax(mesh.p[2]))
    return _disturbed(body, force=lambda u: force * (_unit(mesh, high, 0) - _unit(mesh, low, 0)))


def _skew_tangent(mesh: ElementMesh, term: StVK) -> _Model:
    body, _, stiffness = _units(mesh, term)
    skew = coo_matrix(([stiffness, -stiffness], ([0, 1], [1, 0])), shape=(body.ndofs,) * 2)
    return _disturbed(body, tangent=lambda u: skew)


def _anchored(mesh: ElementMesh, term: StVK) -> _Model:
    body, _, stiffness = _units(mesh, term)
    return _disturbed(
        body,
        energy=lambda u: stiffness / 2 * float(u @ u),
        force=lambda u: stiffness * u,
        tangent=lambda u: stiffness * identity(body.ndofs),
    )


def _energy_of_a_place(mesh: ElementMesh, term: StVK) -> _Model:
    body, _, stiffness = _units(mesh, term)
    return _disturbed(body, energy=lambda u: stiffness / 2 * float(u[0]) ** 2)


def _unit(mesh: ElementMesh, vertex: int, component: int) -> Array:
    unit = np.zeros(mesh.p.size)
    unit[mesh.d * vertex + component] = 1.0
    return unit


def checks(**quantities: str) -> frozenset[tuple[str, str]]:
    """The pairs of `checks(agreement="W,F", closed_forms="P")`: pairs of a check and a quantity."""
    return frozenset((check.replace("_", " "), quantity) for check, text in quantities.items() for quantity in text.split(","))


_LAW = checks(agreement="W,F,K", closed_forms="W,P")
_ELEMENT = _LAW | checks(patch_test="F")

#: Names and faults; the name is what a table shows.
FAULTS: dict[str, Fault] = {
    "twice lambda": Fault(
        "lambda doubled, as MuJoCo 3.3 to 3.17 did in 3D; invisible at nu = 0", partial(_with_lame, 2.0, 1.0), _LAW
    ),
    "half mu": Fault("engineering shear strain taken for the tensor's", partial(_with_lame, 1.0, 0.5), _LAW),
    "no pairs": Fault("the spring network: the diagonal of L alone", partial(_altered, _drop_pairs), _ELEMENT),
    "no opposite pairs": Fault("pairs of edges that do not meet are forgotten", partial(_altered, _drop_opposite), _ELEMENT),
    "one wrong sign": Fault("one opposite pair of one tetrahedron", partial(_altered, _flip_one_opposite), _ELEMENT),
    "no geometric term": Fault(
        "K without the edge tensions (initial stress)", _no_geometric_term, checks(agreement="K", derivatives="K")
    ),
    "linear strain": Fault(
        "small-strain elasticity",
        _linear,
        _LAW | checks(invariance="W,F,K", balance="sum of torques"),
    ),
    "wrong sign of K": Fault(
        "the derivative of the external instead of the internal force",
        _wrong_sign_of_K,
        checks(agreement="K", derivatives="K", no_further_zero_mode="K"),
    ),
    "components first": Fault(
        "degrees of freedom component by component",
        _transposed,
        checks(agreement="F,K", derivatives="F", rigid_modes="K", patch_test="F"),
    ),
    "lone force": Fault(
        "a constant force on one vertex: a boundary term left in",
        _lone_force,
        checks(agreement="F", derivatives="F", invariance="F", balance="sum of forces"),
    ),
    "couple": Fault(
        "two opposite forces that do not pull along their line",
        _couple,
        checks(agreement="F", derivatives="F", invariance="F", balance="sum of torques", closed_forms="P"),
    ),
    "skew K": Fault(
        "one entry of K that its mirror does not have", _skew_tangent, checks(agreement="K", symmetry="K", derivatives="K")
    ),
    "anchored": Fault(
        "a weak spring from every vertex to its rest position; W, F and K fit each other",
        _anchored,
        checks(agreement="W,F,K", invariance="W,F", rigid_modes="K", balance="sum of forces,sum of torques"),
    ),
    "energy of a place": Fault(
        "an energy that knows where the body is", _energy_of_a_place, checks(agreement="W", derivatives="F", invariance="W")
    ),
}
