"""Planted faults: models that are wrong in one way each, each on a body that shows it.

A check that cannot fail is worth nothing. Each fault here has been met in the field or is easily made. `self_test` holds all checks
against all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np
import skfem
from numpy.typing import DTypeLike
from scipy.sparse import coo_matrix, csr_matrix, diags, identity, kron, tril, triu

from ..arguments import Array
from ..edges import TENSILE, Assembly
from ..edges.stiffness import GeneralStiffness
from ..edges.topology import LOCAL_EDGES
from ..elements import ELEMENTS
from ..errors import StvkError
from ..materials import Anisotropic, Hypothesis, Isotropic
from ..mesh import ElementMesh
from ..reference import ReferenceOnePoint
from ..reference.kinds import middles
from ..system import System
from ..terms import Body, StVK
from .bodies import elasticity, hourglass_control
from .checks.precision import Textbook
from .discretisation import Discretisation, derivatives
from .element_model import ElementModel, model_of

Terms = Sequence[StVK]


@dataclass(frozen=True)
class Fault:
    """A way to be wrong.

    Attributes
    ----------
    description : what is wrong, and where it was met.
    make : a faulty model of a mesh and terms like those of its body.
    body : the name of the body that shows it, of `bodies()`.
    named : the hypothesis by which a report names it; empty where its cause has no name.
    """

    description: str
    make: Callable[[ElementMesh, Terms], Any]
    body: str = "isotropic"
    named: str = ""


@dataclass(frozen=True)
class FaultBody:
    """A small body: mesh, terms, and options of its elements."""

    mesh: ElementMesh
    terms: list[StVK]
    options: dict[str, Any] = field(default_factory=dict)


@cache
def bodies() -> dict[str, FaultBody]:
    """The bodies of the self-test: unequal edges, both orientations, lambda != mu, nu != 0."""
    rng = np.random.default_rng(12)
    box = _shaken(skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 3)] * 3), rng)
    half = rng.random(box.t.shape[1]) < 0.5
    box.t[:2, half] = box.t[1::-1, half]
    tets, left = ElementMesh(box.p, box.t), np.arange(box.t.shape[1] // 2)
    right = np.setdiff1d(np.arange(tets.nt), left)
    root, frames = rng.standard_normal((6, 6)), np.linalg.qr(rng.standard_normal((tets.nt, 3, 3)))[0]
    quadratic = tets.with_degree(2)
    p = quadratic.p.copy()
    p[:, tets.nv :] += 0.02 * rng.uniform(-1, 1, (3, quadratic.nv - tets.nv))
    hexes = _shaken(skfem.MeshHex.init_tensor(*[np.linspace(0, 1, 3)] * 3), rng)
    isotropic = [StVK(young=2.0, poisson=0.3)]
    return {
        "isotropic": FaultBody(tets, isotropic),
        "two materials": FaultBody(tets, [StVK(young=2.0, poisson=0.45, region=left), StVK(young=1.0, poisson=0.2, region=right)]),
        "a material each": FaultBody(tets, [StVK(young=rng.uniform(1, 3, tets.nt), poisson=rng.uniform(0.1, 0.45, tets.nt))]),
        "frames": FaultBody(tets, [StVK(Anisotropic(root @ root.T + 3 * np.eye(6), frame=frames))]),
        "curved": FaultBody(ElementMesh(p, quadratic.t, element=quadratic.element), isotropic),
        "one point": FaultBody(
            ElementMesh(hexes.p, hexes.t, element=ELEMENTS["hexahedra"]), isotropic, {"quadrature": "one-point"}
        ),
    }


def _shaken(mesh: Any, rng: np.random.Generator) -> Any:
    """The mesh with its nodes moved by up to a tenth of their distance, and with arrays of its own."""
    return type(mesh)(mesh.p + 0.05 * rng.uniform(-1, 1, mesh.p.shape), mesh.t.copy())


# models


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


def _times(W: float, F: float, K: float, mesh: ElementMesh, terms: Terms) -> _Model:
    body = System(mesh, terms)
    return _Model(lambda u: W * body.energy(u), lambda u: F * body.internal_force(u), lambda u: csr_matrix(K * body.tangent(u)))


def _with_tangent(of: Callable[[System, Array], Any], mesh: ElementMesh, terms: Terms) -> _Model:
    """A right model but for its K."""
    body = System(mesh, terms)
    return _Model(body.energy, body.internal_force, lambda u: csr_matrix(of(body, u)))


def _altered(change: Callable[[ElementModel], dict[str, Any]], mesh: ElementMesh, terms: Terms) -> ElementModel:
    right = model_of(mesh, terms)
    return replace(right, **change(right))


@dataclass(frozen=True)
class _AlteredTerm:
    """A term whose coefficients are changed on the way to the mesh."""

    term: StVK
    change: Callable[[Array, ElementMesh], None]

    def bind(self, body: Body, dtype: DTypeLike = np.float64) -> Assembly:
        mesh, coefficients = body.mesh, self.term.coefficients(body.mesh).copy()
        self.change(coefficients, mesh)
        return Assembly(mesh.p, mesh.t[:, mesh.elements(self.term.region)], GeneralStiffness(lambda: coefficients), None, dtype)


def _with_coefficients(change: Callable[[Array, ElementMesh], None], mesh: ElementMesh, terms: Terms) -> System:
    _refuse_other_bodies(mesh, terms)
    return System(mesh, [_AlteredTerm(term, change) for term in terms])


def _refuse_other_bodies(mesh: ElementMesh, terms: Terms) -> None:
    other = [type(term.material).__name__ for term in terms if not isinstance(term.material, Isotropic)]
    if mesh.k != 3 or not mesh.element.is_linear_simplex or other:
        kinds = ", ".join(other or ["Isotropic"])
        raise StvkError(f"This fault is for isotropic tetrahedra; got {mesh.kind} of {kinds}.")


# moduli


def _with_lame(change: Callable[[float, float], tuple[float, float]], mesh: ElementMesh, terms: Terms) -> System:
    _refuse_other_bodies(mesh, terms)
    altered = []
    for term in terms:
        assert isinstance(term.material, Isotropic)
        lam, mu = (float(value) for value in term.material.lame(Hypothesis.SOLID))
        altered.append(StVK(Isotropic.from_lame(*change(lam, mu)), term.region))
    return System(mesh, altered)


def _with_shear(model: ElementModel, factor: float) -> dict[str, Any]:
    """Shear stresses times a factor: `C_1212` is, `C_1122` and `C_1111` are not."""
    tensor = model.tensor.copy()
    for i in range(3):
        for j in range(3):
            if i != j:
                tensor[:, i, j, i, j] *= factor
                tensor[:, i, j, j, i] *= factor
    return {"tensor": tensor}


def _unsymmetric_moduli(model: ElementModel) -> dict[str, Any]:
    tensor = model.tensor.copy()
    tensor[:, 0, 0, 1, 1] *= 1.01
    return {"tensor": tensor}


def _shifted_materials(model: ElementModel) -> dict[str, Any]:
    return {"tensor": np.roll(model.tensor, 1, axis=0)}


def _exchanged_materials(mesh: ElementMesh, terms: Terms) -> System:
    first, second = terms
    return System(mesh, [StVK(first.material, second.region), StVK(second.material, first.region)])


def _frames(change: Callable[[Array], Array], mesh: ElementMesh, terms: Terms) -> System:
    material = terms[0].material
    assert isinstance(material, Anisotropic) and material.frame is not None
    return System(mesh, StVK(Anisotropic(material.voigt, frame=change(np.asarray(material.frame)))))


def _voigt_order(mesh: ElementMesh, terms: Terms) -> System:
    material, order = terms[0].material, [0, 1, 2, 5, 4, 3]
    assert isinstance(material, Anisotropic)
    return System(mesh, StVK(Anisotropic(np.asarray(material.voigt)[..., order, :][..., order], frame=material.frame)))


# strain, volume and points


def _linear(mesh: ElementMesh, terms: Terms) -> _Model:
    """Small-strain elasticity: `W = 1/2 u' K0 u`."""
    body = System(mesh, terms)
    K0 = body.tangent(np.zeros(body.ndofs))
    return _Model(lambda u: float(u @ (K0 @ u)) / 2, lambda u: np.asarray(K0 @ u), lambda u: K0)


def _deformed_volume(model: ElementModel) -> dict[str, Any]:
    return {"counted": lambda F: np.abs(np.linalg.det(F))}


def _signed_volume(model: ElementModel) -> dict[str, Any]:
    spokes = np.einsum("qai,atc->tqci", model.table, model.X)
    return {"counted": lambda F: np.sign(np.linalg.det(spokes))}


def _inverted_skipped(model: ElementModel) -> dict[str, Any]:
    return {"counted": lambda F: (np.linalg.det(F) > 0).astype(float)}


def _counted(element: int, model: ElementModel, times: float) -> dict[str, Any]:
    factors = np.ones((model.t.shape[1], 1))
    factors[element] = times
    return {"counted": lambda F: np.broadcast_to(factors, F.shape[:2])}


def _point_dropped(model: ElementModel) -> dict[str, Any]:
    return {"table": model.table[:-1], "weights": model.weights[:-1]}


def _wrong_weight(model: ElementModel) -> dict[str, Any]:
    return {"weights": model.weights * np.where(np.arange(len(model.weights)) == 0, 1 + 1e-6, 1)}


def _last_two_exchanged(model: ElementModel) -> dict[str, Any]:
    order = [*range(len(model.t) - 2), len(model.t) - 1, len(model.t) - 2]
    return {"X": model.X[order], "t": model.t[order]}


def _straightened(mesh: ElementMesh, terms: Terms) -> ElementModel:
    right = model_of(mesh, terms)
    X = right.X.copy()
    for middle, (a, b) in middles(mesh.element.name):
        X[middle] = (X[a] + X[b]) / 2
    return replace(right, X=X)


def _without_control(mesh: ElementMesh, terms: Terms) -> ReferenceOnePoint:
    how = Discretisation(mesh.element.name, "one-point", 0.0)
    return ReferenceOnePoint(mesh.p, mesh.t, elasticity(mesh, terms, how), hourglass_control(mesh, terms, how))


def _gradients_at_the_centre(mesh: ElementMesh, terms: Terms) -> ElementModel:
    table = derivatives(mesh.element.name, np.full((mesh.k, 1), 0.5)).astype(float)
    return replace(model_of(mesh, terms), table=table, weights=np.ones(1))


def _stale_rest_shape(mesh: ElementMesh, terms: Terms) -> System:
    p = mesh.p.copy()
    p[0] += 0.01 * np.sin(3 * p[0])
    return System(ElementMesh(p, mesh.t, element=mesh.element), terms)


def _wrong_origin(mesh: ElementMesh, terms: Terms) -> _Model:
    """Spokes of the deformed body from where the first vertex of each element *was*."""
    body, n = System(mesh, terms), mesh.nv

    def moved(u: Array) -> Array:
        return u - np.tile(u.reshape(n, -1)[mesh.t[0, 0]] / 100, n) * np.repeat(np.arange(n) != mesh.t[0, 0], mesh.d)

    return _Model(lambda u: body.energy(moved(u)), lambda u: body.internal_force(moved(u)), lambda u: body.tangent(moved(u)))


# edges and their pairs


def _drop_pairs(L: Array, mesh: ElementMesh) -> None:
    L *= np.eye(L.shape[1])


def _opposite(m: int) -> tuple[list[int], list[int]]:
    """Local numbers of the three pairs of edges of a tetrahedron that do not meet."""
    edges = LOCAL_EDGES[3]
    pairs = [(i, j) for i in range(m) for j in range(i) if not set(edges[i]) & set(edges[j])]
    return [i for i, _ in pairs], [j for _, j in pairs]


def _drop_opposite(L: Array, mesh: ElementMesh) -> None:
    i, j = _opposite(L.shape[1])
    L[:, i, j] = L[:, j, i] = 0.0


def _flip_one_opposite(L: Array, mesh: ElementMesh) -> None:
    (i, *_), (j, *_) = _opposite(L.shape[1])
    L[len(L) // 2, [i, j], [j, i]] *= -1


def _drop_one_adjacent(L: Array, mesh: ElementMesh) -> None:
    L[len(L) // 2, [0, 1], [1, 0]] = 0.0


def _permute_negative(L: Array, mesh: ElementMesh) -> None:
    """The third and the fourth edge exchanged where an element is turned round."""
    spokes = mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]]
    negative, order = np.linalg.det(np.moveaxis(spokes, 2, 0)) < 0, [0, 1, 3, 2, 4, 5]
    L[negative] = L[negative][:, order][:, :, order]


def _geometric(mesh: ElementMesh, terms: Terms) -> Callable[[Array], csr_matrix]:
    forms = [term.bind(mesh).form for term in terms]

    def matrix(u: Array) -> csr_matrix:
        total = csr_matrix((mesh.nv, mesh.nv))
        for form in forms:
            tension, (a, b) = form.tensions(u.reshape(-1, mesh.d)), form.edges
            entries = np.concatenate([tension, tension, -tension, -tension])
            places = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])
            total = total + coo_matrix((entries, places), shape=total.shape)
        return csr_matrix(kron(total, identity(mesh.d)))

    return matrix


def _no_geometric_term(mesh: ElementMesh, terms: Terms) -> _Model:
    geometric = _geometric(mesh, terms)
    return _disturbed(System(mesh, terms), tangent=lambda u: -geometric(u))


# matrices and degrees of freedom


def _blocks_transposed(body: System, u: Array) -> csr_matrix:
    K = body.tangent(u).tobsr((body.mesh.d,) * 2)
    K.data = np.swapaxes(K.data, 1, 2).copy()
    return csr_matrix(K)


def _symmetrised_wrongly(body: System, u: Array) -> csr_matrix:
    """The upper half mirrored with its diagonal, which then counts twice."""
    upper = triu(body.tangent(u))
    return csr_matrix(upper + upper.T)


def _upper_alone(body: System, u: Array) -> csr_matrix:
    return csr_matrix(triu(body.tangent(u)))


def _of_one_sided_rows(body: System, u: Array) -> csr_matrix:
    """The lower half is half of what it should be, and added to its transpose without the diagonal's share."""
    K = body.tangent(u)
    return csr_matrix(tril(K, -1) + diags(K.diagonal()) / 2 + triu(K, 1))


def _components_first(mesh: ElementMesh, terms: Terms) -> _Model:
    """Degrees of freedom component by component in what is returned."""
    body = System(mesh, terms)
    order = np.arange(body.ndofs).reshape(-1, mesh.d).T.ravel()
    return _Model(body.energy, lambda u: body.internal_force(u)[order], lambda u: csr_matrix(body.tangent(u)[order][:, order]))


class _StaleTangent:
    """K of the state before: what is kept is not made anew when the state changes."""

    def __init__(self, mesh: ElementMesh, terms: Terms) -> None:
        body = System(mesh, terms)
        self.energy, self.internal_force = body.energy, body.internal_force
        self._body, self._before = body, np.zeros(body.ndofs)

    def tangent(self, u: Array) -> csr_matrix:
        """K where it was asked for last."""
        before, self._before = self._before, u.copy()
        return self._body.tangent(before)


class _KeptTangent:
    """K that is kept as long as the displacements are nearly the same."""

    def __init__(self, mesh: ElementMesh, terms: Terms) -> None:
        body = System(mesh, terms)
        self.energy, self.internal_force = body.energy, body.internal_force
        self._body, self._at, self._kept = body, np.zeros(body.ndofs), body.tangent(np.zeros(body.ndofs))

    def tangent(self, u: Array) -> csr_matrix:
        """K where it was computed last, or here."""
        if not np.allclose(u, self._at):
            self._at, self._kept = u.copy(), self._body.tangent(u)
        return self._kept


def _blind_to_inversion(mesh: ElementMesh, terms: Terms) -> _Model:
    """Not a number as soon as an element is inside out, as by the logarithm or the root of J."""
    body = System(mesh, terms)

    def factor(u: Array) -> float:
        return 1.0 if body.smallest_volume_ratio(u) > 0 else float("nan")

    return _Model(
        lambda u: factor(u) * body.energy(u),
        lambda u: factor(u) * body.internal_force(u),
        lambda u: csr_matrix(factor(u) * body.tangent(u)),
    )


class _FromPositions(Textbook):
    """F of squared lengths of positions, as textbooks write it; W and K are right."""

    def __init__(self, mesh: ElementMesh, terms: Terms) -> None:
        super().__init__(terms[0].bind(mesh).form)
        body = System(mesh, terms)
        self.energy, self.tangent = body.energy, body.tangent


# forces that do not belong


def _units(mesh: ElementMesh, terms: Terms) -> tuple[System, float, float]:
    """The body, a force and a stiffness that are small on it, but far beyond round-off."""
    body = System(mesh, terms)
    stiffness = 1e-6 * float(abs(body.tangent(np.zeros(body.ndofs))).max())
    return body, stiffness * float(np.ptp(mesh.p)) / mesh.nv, stiffness


def _lone_force(mesh: ElementMesh, terms: Terms) -> _Model:
    body, force, _ = _units(mesh, terms)
    return _disturbed(body, force=lambda u: force * _unit(mesh, 0, 0))


def _couple(mesh: ElementMesh, terms: Terms) -> _Model:
    """Opposite forces along x at the lowest and the highest vertex: no sum, but a torque, and a mean stress P_13."""
    body, force, _ = _units(mesh, terms)
    low, high = int(np.argmin(mesh.p[2])), int(np.argmax(mesh.p[2]))
    return _disturbed(body, force=lambda u: force * (_unit(mesh, high, 0) - _unit(mesh, low, 0)))


def _skew_tangent(mesh: ElementMesh, terms: Terms) -> _Model:
    body, _, stiffness = _units(mesh, terms)
    skew = coo_matrix(([stiffness, -stiffness], ([0, 1], [1, 0])), shape=(body.ndofs,) * 2)
    return _disturbed(body, tangent=lambda u: skew)


def _anchored(mesh: ElementMesh, terms: Terms) -> _Model:
    body, _, stiffness = _units(mesh, terms)
    return _disturbed(
        body,
        energy=lambda u: stiffness / 2 * float(u @ u),
        force=lambda u: stiffness * u,
        tangent=lambda u: stiffness * identity(body.ndofs),
    )


def _energy_of_a_place(mesh: ElementMesh, terms: Terms) -> _Model:
    body, _, stiffness = _units(mesh, terms)
    return _disturbed(body, energy=lambda u: stiffness / 2 * float(u[0]) ** 2)


def _soft_mode(mesh: ElementMesh, terms: Terms) -> _Model:
    """K at rest resists one more motion by nothing: its softest mode that is not rigid is taken out, symmetrically."""
    body = System(mesh, terms)
    K0 = body.tangent(np.zeros(body.ndofs)).toarray()
    values, vectors = np.linalg.eigh(K0)
    soft = vectors[:, 6]
    out = csr_matrix(values[6] * np.outer(soft, soft))
    return _disturbed(body, tangent=lambda u: -out)


def _unit(mesh: ElementMesh, vertex: int, component: int) -> Array:
    unit = np.zeros(mesh.p.size)
    unit[mesh.d * vertex + component] = 1.0
    return unit


def _middle(change: Callable[[int, ElementModel], dict[str, Any]], mesh: ElementMesh, terms: Terms) -> ElementModel:
    """A change of the element in the middle of the list."""
    return _altered(partial(change, mesh.nt // 2), mesh, terms)


#: Names and faults; the name is what a table shows.
FAULTS: dict[str, Fault] = {
    "twice lambda": Fault(
        "lambda doubled, as MuJoCo 3.3 to 3.17 did in 3D; invisible at nu = 0",
        partial(_with_lame, lambda lam, mu: (2 * lam, mu)),
        named="lambda doubled",
    ),
    "half lambda": Fault("lambda halved", partial(_with_lame, lambda lam, mu: (lam / 2, mu)), named="lambda halved"),
    "plane-stress lambda": Fault(
        "2 lam mu/(lam + 2 mu), which is for plane stress, in 3D",
        partial(_with_lame, lambda lam, mu: (2 * lam * mu / (lam + 2 * mu), mu)),
        named="lambda of plane stress",
    ),
    "bulk modulus for lambda": Fault(
        "lam + 2/3 mu taken for lambda",
        partial(_with_lame, lambda lam, mu: (lam + 2 * mu / 3, mu)),
        named="bulk modulus for lambda",
    ),
    "half mu": Fault(
        "engineering shear strain taken for the tensor's", partial(_with_lame, lambda lam, mu: (lam, mu / 2)), named="mu halved"
    ),
    "twice mu": Fault("2 G taken for mu", partial(_with_lame, lambda lam, mu: (lam, 2 * mu)), named="mu doubled"),
    "lambda and mu exchanged": Fault(
        "the two constants in each other's place", partial(_with_lame, lambda lam, mu: (mu, lam)), named="lambda and mu exchanged"
    ),
    "engineering shear doubled": Fault(
        "shear strains doubled, and the tensor's modulus with them",
        partial(_altered, partial(_with_shear, factor=2.0)),
        named="shear stresses doubled",
    ),
    "no half in E": Fault("E = F'F - I in energy, force and tangent", partial(_times, 4, 4, 4), named="W, F, K x 4"),
    "doubled stress": Fault("S = 2 C : E in force and tangent alone", partial(_times, 1, 2, 2), named="F, K x 2"),
    "doubled volume": Fault("|det| over 3 in the place of 6, in all three", partial(_times, 2, 2, 2), named="W, F, K x 2"),
    "deformed volume": Fault(
        "integrals over the deformed body", partial(_altered, _deformed_volume), named="volume of the deformed body"
    ),
    "signed volume": Fault(
        "elements that are turned round count negatively", partial(_altered, _signed_volume), named="signed volumes"
    ),
    "linear strain": Fault("small-strain elasticity", _linear, named="linear strain"),
    "one tet skipped": Fault("an element is left out", partial(_middle, partial(_counted, times=0.0)), named="one element x 0"),
    "one tet twice": Fault("an element is summed twice", partial(_middle, partial(_counted, times=2.0)), named="one element x 2"),
    "no pairs": Fault(
        "the spring network: the diagonal of L alone", partial(_with_coefficients, _drop_pairs), named="edges without pairs"
    ),
    "no opposite pairs": Fault(
        "pairs of edges that do not meet are forgotten", partial(_with_coefficients, _drop_opposite), named="no opposite pairs"
    ),
    "one wrong sign": Fault("one opposite pair of one tetrahedron", partial(_with_coefficients, _flip_one_opposite)),
    "one pair dropped": Fault("one pair of edges of one tetrahedron", partial(_with_coefficients, _drop_one_adjacent)),
    "edges permuted": Fault(
        "the third and fourth edge exchanged in elements that are turned round",
        partial(_with_coefficients, _permute_negative),
        named="edges permuted where turned round",
    ),
    "no geometric term": Fault("K without the edge tensions (initial stress)", _no_geometric_term, named="no initial stress in K"),
    "geometric term clamped": Fault(
        "K with tensile edge tensions alone, without a word",
        partial(_with_tangent, lambda body, u: body.jacobian(u, kept=TENSILE)),
        named="tensile edge tensions alone in K",
    ),
    "blocks transposed": Fault(
        "each block of K transposed", partial(_with_tangent, _blocks_transposed), named="blocks of K transposed"
    ),
    "K symmetrised wrongly": Fault(
        "the upper half mirrored with its diagonal", partial(_with_tangent, _symmetrised_wrongly), named="diagonal of K doubled"
    ),
    "upper half of K": Fault("only the upper half is stored", partial(_with_tangent, _upper_alone), named="upper half of K alone"),
    "half a diagonal": Fault(
        "the diagonal shared between two halves", partial(_with_tangent, _of_one_sided_rows), named="diagonal of K halved"
    ),
    "wrong sign of K": Fault(
        "the derivative of the external instead of the internal force", partial(_times, 1, 1, -1), named="K x -1"
    ),
    "wrong sign of F": Fault("the force on the surroundings", partial(_times, 1, -1, -1), named="F, K x -1"),
    "components first": Fault(
        "degrees of freedom component by component", _components_first, named="results component by component"
    ),
    "stale K": Fault("K of the state before", _StaleTangent, named="K of the state before"),
    "K kept nearby": Fault("K is kept while u is nearly the same", _KeptTangent, named="K kept while u is nearly the same"),
    "stale rest shape": Fault("the mesh as it was before it was moved", _stale_rest_shape),
    "single precision": Fault(
        "sums in float32", lambda mesh, terms: System(mesh, terms, dtype=np.float32), named="single precision"
    ),
    "textbook cancellation": Fault("F from squared lengths of positions", _FromPositions),
    "wrong origin": Fault("displacements relative to a node, in part", _wrong_origin),
    "NaN at inversion": Fault(
        "not a number where an element is inside out", _blind_to_inversion, named="not a number at inversion"
    ),
    "inverted tets skipped": Fault(
        "an element that is inside out costs nothing, and pulls no more", partial(_altered, _inverted_skipped)
    ),
    "unsymmetric moduli": Fault(
        "C_1122 of the table is off by a hundredth, C_2211 is right", partial(_altered, _unsymmetric_moduli)
    ),
    "lone force": Fault("a constant force on one vertex: a boundary term left in", _lone_force, named="a constant force"),
    "couple": Fault("two opposite forces that do not pull along their line", _couple, named="a constant force"),
    "skew K": Fault("one entry of K that its mirror does not have", _skew_tangent),
    "anchored": Fault("a weak spring from every vertex to its rest position; W, F and K fit each other", _anchored),
    "energy of a place": Fault("an energy that knows where the body is", _energy_of_a_place),
    "a mode for nothing": Fault("one mode too many costs nothing at rest", _soft_mode),
    "materials shifted": Fault(
        "each element has its neighbour's material",
        partial(_altered, _shifted_materials),
        "a material each",
        "materials of the next element",
    ),
    "materials exchanged": Fault(
        "two regions have each other's material", _exchanged_materials, "two materials", "lambda and mu by region"
    ),
    "twice lambda in a region": Fault(
        "lambda doubled in one of two regions",
        lambda mesh, terms: System(mesh, [_with_lame_of(terms[0], 2.0), terms[1]]),
        "two materials",
        "lambda doubled",
    ),
    "frames transposed": Fault(
        "the rows of a frame are taken for material axes",
        partial(_frames, lambda frame: np.swapaxes(frame, -1, -2)),
        "frames",
        "frames transposed",
    ),
    "frames ignored": Fault(
        "material axes are taken for the global ones",
        partial(_frames, lambda frame: np.broadcast_to(np.eye(3), frame.shape)),
        "frames",
        "frames ignored",
    ),
    "Voigt order": Fault(
        "the matrix has its shears in the order 12, 13, 23", _voigt_order, "frames", "shears in the order 12, 13, 23"
    ),
    "one point dropped": Fault(
        "the last quadrature point is left out", partial(_altered, _point_dropped), "curved", "one point left out"
    ),
    "a wrong weight": Fault("the first weight is off by a millionth", partial(_altered, _wrong_weight), "curved"),
    "middles exchanged": Fault(
        "the last two middles are exchanged, as between the orders of Gmsh and VTK",
        partial(_altered, _last_two_exchanged),
        "curved",
        "nodes in another order",
    ),
    "curved taken as straight": Fault(
        "gradients and weights are those of elements with straight edges", _straightened, "curved", "curved edges taken as straight"
    ),
    "no hourglass control": Fault(
        "modes that the mean gradients do not see cost nothing", _without_control, "one point", "no hourglass control"
    ),
    "gradients at the centre": Fault(
        "gradients and volume of the centre instead of their means", _gradients_at_the_centre, "one point"
    ),
}


def _with_lame_of(term: StVK, factor: float) -> StVK:
    assert isinstance(term.material, Isotropic)
    lam, mu = term.material.lame(Hypothesis.SOLID)
    return StVK(Isotropic.from_lame(factor * lam, mu), term.region)
