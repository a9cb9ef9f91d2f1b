"""Faulty bodies: systems with one fault in their coefficients, matrices or forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import coo_matrix, csr_matrix, diags, identity, kron, tril, triu
from scipy.spatial.transform import Rotation

from ..arguments import Array
from ..edges import Assembly
from ..edges.bound_laws import BoundStVK
from ..edges.materials import Anisotropic, FramedMaterial, Hypothesis, Isotropic
from ..edges.stiffness import GeneralStiffness
from ..edges.topology import LOCAL_EDGES
from ..errors import StvkError
from ..mesh import ElementMesh
from ..system import System
from ..terms import Body, Corotated, StVK, Term
from .bodies import with_material
from .checks.precision import Textbook

Terms = Sequence[StVK]


@dataclass(frozen=True)
class FaultyModel:
    """Model with W, F and K as arbitrary functions of u."""

    energy: Callable[[Array], float]
    internal_force: Callable[[Array], Array]
    tangent: Callable[[Array], csr_matrix]


def disturbed(
    body: System,
    energy: Callable[[Array], float] = lambda u: 0.0,
    force: Callable[[Array], Any] = lambda u: 0.0,
    tangent: Callable[[Array], Any] | None = None,
) -> FaultyModel:
    """Return the correct model with additional terms in W, F or K."""
    return FaultyModel(
        lambda u: body.energy(u) + energy(u),
        lambda u: body.internal_force(u) + np.asarray(force(u)),
        lambda u: body.tangent(u) if tangent is None else csr_matrix(body.tangent(u) + tangent(u)),
    )


def times(W: float, F: float, K: float, mesh: ElementMesh, terms: Terms) -> FaultyModel:
    body = System(mesh, terms)
    return FaultyModel(
        lambda u: W * body.energy(u), lambda u: F * body.internal_force(u), lambda u: csr_matrix(K * body.tangent(u))
    )


def with_tangent(tangent: Callable[[System, Array], Any], mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return the correct model with another K."""
    body = System(mesh, terms)
    return FaultyModel(body.energy, body.internal_force, lambda u: csr_matrix(tangent(body, u)))


@dataclass(frozen=True)
class AlteredTerm(Term):
    """Term whose edge coefficients are changed when it is bound to a mesh."""

    term: StVK
    change: Callable[[Array, ElementMesh], None]

    @property
    def region(self) -> Any:
        return self.term.region

    def bind(self, body: Body, dtype: DTypeLike = np.float64) -> Assembly:
        mesh, coefficients = body.mesh, self.term.coefficients(body.mesh).copy()
        self.change(coefficients, mesh)
        return BoundStVK(mesh.p, mesh.t[:, mesh.elements(self.term.region)], GeneralStiffness(lambda: coefficients), None, dtype)


def with_coefficients(change: Callable[[Array, ElementMesh], None], mesh: ElementMesh, terms: Terms) -> System:
    refuse_other_bodies(mesh, terms)
    return System(mesh, [AlteredTerm(term, change) for term in terms])


def refuse_other_bodies(mesh: ElementMesh, terms: Terms) -> None:
    other = [type(term.material).__name__ for term in terms if not isinstance(term.material, Isotropic)]
    if mesh.k != 3 or not mesh.element.is_linear_simplex or other:
        kinds = ", ".join(other or ["Isotropic"])
        raise StvkError(f"This fault is for isotropic tetrahedra; got {mesh.kind} of {kinds}.")


def with_lame(change: Callable[[Any, Any], tuple[Any, Any]], mesh: ElementMesh, terms: Terms) -> System:
    refuse_other_bodies(mesh, terms)
    return System(mesh, [with_lame_of(term, change) for term in terms])


def exchanged_materials(mesh: ElementMesh, terms: Terms) -> System:
    first, second = terms
    return System(mesh, [StVK(first.material, second.region), StVK(second.material, first.region)])


def frames(change: Callable[[Array], Array], mesh: ElementMesh, terms: Terms) -> System:
    """Return the body with changed material axes, for materials that have a frame."""
    altered = []
    for term in terms:
        material = term.material
        if isinstance(material, FramedMaterial) and material.frame is not None:
            material = replace(material, frame=change(np.asarray(material.frame)))
        altered.append(with_material(term, material))
    return System(mesh, altered)


def rotated_by(factor: float, full_turns: int, frame: Array) -> Array:
    """Return frames whose rotation angle about their own axis is multiplied by a factor.

    Before the multiplication, `full_turns` times 2 pi are added to the angle.
    """
    right_handed = frame * np.linalg.det(frame)[..., None, None]
    vectors = Rotation.from_matrix(right_handed.reshape(-1, 3, 3)).as_rotvec()
    angles = np.linalg.norm(vectors, axis=1, keepdims=True)
    axes = vectors / np.where(angles == 0, 1.0, angles)
    return np.asarray(Rotation.from_rotvec(factor * (angles + 2 * np.pi * full_turns) * axes).as_matrix().reshape(frame.shape))


def voigt_order(mesh: ElementMesh, terms: Terms) -> System:
    material, order = terms[0].material, [0, 1, 2, 5, 4, 3]
    assert isinstance(material, Anisotropic)
    return System(mesh, StVK(Anisotropic(np.asarray(material.voigt)[..., order, :][..., order], frame=material.frame)))


def linear(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return the model of small-strain elasticity: `W = 1/2 u' K0 u`."""
    body = System(mesh, terms)
    K0 = body.tangent(np.zeros(body.ndofs))
    return FaultyModel(lambda u: float(u @ (K0 @ u)) / 2, lambda u: np.asarray(K0 @ u), lambda u: K0)


def corotated(mesh: ElementMesh, terms: Terms) -> System:
    """Return the model `W = 1/2 E : C : E` with `E = R'F - I`, which is Biot's strain unless elements are inverted."""
    refuse_other_bodies(mesh, terms)
    return System(mesh, [Corotated(term.material, term.region) for term in terms])


def stale_rest_shape(mesh: ElementMesh, terms: Terms) -> System:
    p = mesh.p.copy()
    p[0] += 0.01 * np.sin(3 * p[0])
    return System(ElementMesh(p, mesh.t, element=mesh.element), terms)


def wrong_origin(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model with displacements partly relative to a node.

    One hundredth of the displacement of the first node of the first element is subtracted at all other nodes.
    """
    n = mesh.nv

    def moved(u: Array) -> Array:
        return u - np.tile(u.reshape(n, -1)[mesh.t[0, 0]] / 100, n) * np.repeat(np.arange(n) != mesh.t[0, 0], mesh.d)

    return displaced(moved, mesh, terms)


def displaced(read: Callable[[Array], Array], mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return the correct model at the displacements `read(u)`."""
    body = System(mesh, terms)
    return FaultyModel(lambda u: body.energy(read(u)), lambda u: body.internal_force(read(u)), lambda u: body.tangent(read(u)))


def drop_pairs(L: Array, mesh: ElementMesh) -> None:
    L *= np.eye(L.shape[1])


def opposite(m: int) -> tuple[list[int], list[int]]:
    """Return the local indices of the three pairs of edges of a tetrahedron that share no vertex."""
    edges = LOCAL_EDGES[3]
    pairs = [(i, j) for i in range(m) for j in range(i) if not set(edges[i]) & set(edges[j])]
    return [i for i, _ in pairs], [j for _, j in pairs]


def drop_opposite(L: Array, mesh: ElementMesh) -> None:
    i, j = opposite(L.shape[1])
    L[:, i, j] = L[:, j, i] = 0.0


def flip_one_opposite(L: Array, mesh: ElementMesh) -> None:
    (i, *_), (j, *_) = opposite(L.shape[1])
    L[len(L) // 2, [i, j], [j, i]] *= -1


def drop_one_adjacent(L: Array, mesh: ElementMesh) -> None:
    L[len(L) // 2, [0, 1], [1, 0]] = 0.0


def permute_negative(L: Array, mesh: ElementMesh) -> None:
    """Exchange the third and the fourth edge of elements with negative orientation."""
    base_vectors = mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]
    negative, order = np.linalg.det(np.moveaxis(base_vectors, 2, 0)) < 0, [0, 1, 3, 2, 4, 5]
    L[negative] = L[negative][:, order][:, :, order]


def geometric(mesh: ElementMesh, terms: Terms) -> Callable[[Array], csr_matrix]:
    forms = [term.bind(mesh).form for term in terms]

    def matrix(u: Array) -> csr_matrix:
        total = csr_matrix((mesh.nv, mesh.nv))
        for form in forms:
            tension, (a, b) = form.tensions(u.reshape(-1, mesh.d)), form.edges
            entries = np.concatenate([tension, tension, -tension, -tension])
            indices = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
            total = total + coo_matrix((entries, indices), shape=total.shape)
        return csr_matrix(kron(total, identity(mesh.d)))

    return matrix


def no_geometric_term(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    term = geometric(mesh, terms)
    return disturbed(System(mesh, terms), tangent=lambda u: -term(u))


def blocks_transposed(body: System, u: Array) -> csr_matrix:
    K = body.tangent(u).tobsr((body.mesh.d,) * 2)
    K.data = np.swapaxes(K.data, 1, 2).copy()
    return csr_matrix(K)


def symmetrised_wrongly(body: System, u: Array) -> csr_matrix:
    """Return the upper half of K plus its transpose, so that the diagonal is doubled."""
    upper = triu(body.tangent(u))
    return csr_matrix(upper + upper.T)


def upper_half(body: System, u: Array) -> csr_matrix:
    return csr_matrix(triu(body.tangent(u)))


def half_diagonal(body: System, u: Array) -> csr_matrix:
    """Return K with half of its diagonal."""
    K = body.tangent(u)
    return csr_matrix(tril(K, -1) + diags(K.diagonal()) / 2 + triu(K, 1))


def components_first(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model whose results have their degrees of freedom component by component."""
    body = System(mesh, terms)
    order = np.arange(body.ndofs).reshape(-1, mesh.d).T.ravel()
    return FaultyModel(body.energy, lambda u: body.internal_force(u)[order], lambda u: csr_matrix(body.tangent(u)[order][:, order]))


class StaleTangent:
    """Model that returns K of the previous state, because its cache is not updated when the state changes."""

    def __init__(self, mesh: ElementMesh, terms: Terms) -> None:
        body = System(mesh, terms)
        self.energy, self.internal_force = body.energy, body.internal_force
        self._body, self._before = body, np.zeros(body.ndofs)

    def tangent(self, u: Array) -> csr_matrix:
        """Return K at the state of the previous call."""
        before, self._before = self._before, u.copy()
        return self._body.tangent(before)


def cached(cached_methods: Sequence[str], same: Callable[[Array, Array], Any], mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model in which these methods return their last value again as long as `same(u, last u)`."""
    body = System(mesh, terms)

    def method(name: str) -> Callable[[Array], Any]:
        call: Callable[[Array], Any] = getattr(body, name)
        last: dict[str, Any] = {}

        def value(u: Array) -> Any:
            if not last or not same(u, last["u"]):
                last.update(u=u.copy(), value=call(u))
            return last["value"]

        return value if name in cached_methods else call

    return FaultyModel(method("energy"), method("internal_force"), method("tangent"))


def nan_at_inversion(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model whose values are nan if an element is inverted, as with the logarithm or the root of J."""
    body = System(mesh, terms)

    def factor(u: Array) -> float:
        return 1.0 if body.smallest_volume_ratio(u) > 0 else float("nan")

    return FaultyModel(
        lambda u: factor(u) * body.energy(u),
        lambda u: factor(u) * body.internal_force(u),
        lambda u: csr_matrix(factor(u) * body.tangent(u)),
    )


class FromPositions(Textbook):
    """Model with F from squared lengths of positions, as in textbooks. W and K are correct."""

    def __init__(self, mesh: ElementMesh, terms: Terms) -> None:
        super().__init__(terms[0].bind(mesh).form)
        body = System(mesh, terms)
        self.energy, self.tangent = body.energy, body.tangent


def units(mesh: ElementMesh, terms: Terms) -> tuple[System, float, float]:
    """Return the body, and a force and a stiffness that are small for this body, but far above round-off."""
    body = System(mesh, terms)
    stiffness = 1e-6 * float(abs(body.tangent(np.zeros(body.ndofs))).max())
    return body, stiffness * float(np.ptp(mesh.p)) / mesh.nv, stiffness


def lone_force(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    body, force, _ = units(mesh, terms)
    return disturbed(body, force=lambda u: force * unit(mesh, 0, 0))


def couple(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model with opposite forces along x at the lowest and the highest vertex.

    Their sum is zero, but they have a torque and a mean stress P_13.
    """
    body, force, _ = units(mesh, terms)
    low, high = int(np.argmin(mesh.p[2])), int(np.argmax(mesh.p[2]))
    return disturbed(body, force=lambda u: force * (unit(mesh, high, 0) - unit(mesh, low, 0)))


def skew_tangent(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    body, _, stiffness = units(mesh, terms)
    skew = coo_matrix(([stiffness, -stiffness], ([0, 1], [1, 0])), shape=(body.ndofs,) * 2)
    return disturbed(body, tangent=lambda u: skew)


def anchored(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    body, _, stiffness = units(mesh, terms)
    return disturbed(
        body,
        energy=lambda u: stiffness / 2 * float(u @ u),
        force=lambda u: stiffness * u,
        tangent=lambda u: stiffness * identity(body.ndofs),
    )


def energy_offset(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    body, force, _ = units(mesh, terms)
    return disturbed(body, energy=lambda u: force * float(np.ptp(mesh.p)))


def wrong_sign_of_one_force(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model in which the force on the vertex in the middle of the list has the wrong sign."""
    body, sign = System(mesh, terms), np.ones(mesh.p.size)
    sign[mesh.d * (mesh.nv // 2) :][: mesh.d] = -1
    return FaultyModel(body.energy, lambda u: sign * body.internal_force(u), body.tangent)


def energy_of_position(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    body, _, stiffness = units(mesh, terms)
    return disturbed(body, energy=lambda u: stiffness / 2 * float(u[0]) ** 2)


def extra_zero_mode(mesh: ElementMesh, terms: Terms) -> FaultyModel:
    """Return a model whose K at rest has one more zero mode: the softest mode that is not rigid is removed symmetrically."""
    body = System(mesh, terms)
    K0 = body.tangent(np.zeros(body.ndofs)).toarray()
    values, vectors = np.linalg.eigh(K0)
    soft = vectors[:, 6]
    out = csr_matrix(values[6] * np.outer(soft, soft))
    return disturbed(body, tangent=lambda u: -out)


def unit(mesh: ElementMesh, vertex: int, component: int) -> Array:
    unit = np.zeros(mesh.p.size)
    unit[mesh.d * vertex + component] = 1.0
    return unit


def with_lame_of(term: StVK, change: Callable[[Any, Any], tuple[Any, Any]]) -> StVK:
    assert isinstance(term.material, Isotropic)
    return with_material(term, Isotropic.from_lame(*change(*term.material.lame(Hypothesis.SOLID))))
