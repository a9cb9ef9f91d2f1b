"""Models that are wrong in one way each.

A hypothesis explains the candidate if its W, F and K are the candidate's in strained states, to round-off. Factors are fitted by
least squares: of W, F and K as a whole; of lambda and mu, in each region, on six homogeneous states; of single elements, where the
error is on the nodes of a few. All else is tried as it stands, the planted faults (`faults`) among them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np
from scipy.sparse import issparse

from ..arguments import Array
from ..errors import StvkError
from ..materials import Anisotropic
from ..terms import StVK
from .bodies import elasticity, hourglass_control, reference_on
from .case import Case
from .element_model import model_of
from .evidence import Evidence, Model, Values, flat
from .faults import FAULTS
from .judgement import largest_component
from .moduli import lame_factors, number
from .players import Player

#: Names of what FAULTS have that is found by a fit here, or needs more than one state.
FITTED = (
    "lambda doubled", "lambda halved", "lambda of plane stress", "bulk modulus for lambda", "mu halved", "mu doubled",
    "lambda and mu exchanged", "lambda and mu by region", "W, F, K x 4", "F, K x 2", "W, F, K x 2", "K x -1", "F, K x -1",
    "one element x 0", "one element x 2", "K of the state before", "K kept while u is nearly the same", "single precision",
    "not a number at inversion", "a constant force", "results component by component",
)  # fmt: skip


def models(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Name, words and model of each hypothesis."""
    yield from _factors(evidence)
    yield from lame_factors(evidence, terms)
    yield from _elements(evidence, terms)
    yield from _orders_of_dofs(evidence)
    yield from _other_displacements(evidence)
    yield from _orders_of_voigt(evidence, terms)
    yield from _orders_of_nodes(evidence, terms)
    yield from _planted(evidence, terms)


READINGS = {
    4.0: "E without its 1/2 in all of them, E doubled, or moduli four times too large",
    2.0: "Young's modulus, the stress, the volume, or E in the stress alone is doubled (a missing 1/2)",
    0.5: "Young's modulus, the stress or the volume is halved",
    0.25: "moduli or E are halved twice",
    -1.0: "the sign is turned",
    6.0: "the determinant is taken for the volume of a tetrahedron, without 1/6",
    3.0: "1/2 in the place of 1/6 in the volume of a tetrahedron",
    1 / 6: "1/6 counts twice in the volume of a tetrahedron",
    **{10.0**power: "units, as of Pa, kPa, MPa and GPa, or m and mm, are mixed" for power in (-9, -6, -3, 3, 6, 9)},
}


def _factors(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """W, F and K each times a number."""
    factors = {}
    for quantity in evidence.quantities:
        pairs = [
            (values[quantity], evidence.truth(evidence.case.states[s], quantity)[quantity]) for s, values in evidence.found.items()
        ]
        above, below = (sum(float(_product(a[i], a[1])) for a in pairs) for i in (0, 1))
        factors[quantity] = above / below if below else 1.0
    off: dict[float, list[str]] = {}
    for quantity, factor in factors.items():
        if abs(factor - 1) > 1e-6:
            off.setdefault(float(f"{factor:.6g}"), []).append(quantity)
    if not off:
        return
    name = "; ".join(f"{', '.join(names)} x {factor:g}" for factor, names in off.items())
    reading = "; ".join(dict.fromkeys(_reading(factor) for factor in off))

    def model(u: Array, quantities: str) -> Values:
        return {quantity: factors[quantity] * value for quantity, value in evidence.truth(u, quantities).items()}

    words = "; ".join(
        f"your {' and '.join(names)} {'is' if len(names) == 1 else 'are'} {number(factor)} x" for factor, names in off.items()
    )
    yield name, f"{words}: {reading}", model


def _product(a: Any, b: Any) -> float:
    return float(a.multiply(b).sum()) if issparse(a) and issparse(b) else float(np.vdot(flat(a), flat(b)))


def _reading(factor: float) -> str:
    if abs(factor) < 1e-14:
        return "nothing is added up"
    near = [words for value, words in READINGS.items() if abs(factor / value - 1) < 1e-5]
    return near[0] if near else "a factor without a usual cause"


def _elements(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """A few elements times a factor each: those on whose nodes alone the force, or K, is off."""
    case = evidence.case
    if case.how.is_one_point or not set("FK") & set(evidence.quantities):
        return
    quantity = "F" if "F" in evidence.quantities else "K"
    mesh, state = case.mesh, next(iter(evidence.found), None)
    if state is None:
        return
    u = case.states[state]
    off = evidence.found[state][quantity] - evidence.truth(u)[quantity]
    rows = np.asarray(abs(off).max(axis=1).todense()).ravel() if issparse(off) else np.abs(off).reshape(mesh.p.size, -1).max(axis=1)
    bad = largest_component(rows, mesh.d) > 1e-9 * max(float(rows.max()), np.finfo(float).tiny)
    suspects = np.flatnonzero(bad[mesh.t].all(axis=0))
    if not 0 < len(suspects) <= 5 or len(suspects) == mesh.nt:
        return
    tensor = elasticity(mesh, terms, case.how)
    single = [
        Player("part", reference_on(mesh.p, mesh.t[:, [e]], tensor if len(tensor) == 1 else tensor[[e]], case.how), mesh.p.size)
        for e in suspects
    ]
    A = np.stack([evidence.column(evidence.values(one, u, quantity)[quantity]) for one in single], axis=1)
    change = np.linalg.lstsq(A, evidence.column(off), rcond=None)[0].round(9)
    there = [i for i in range(len(suspects)) if abs(change[i]) > 1e-6]
    if not there:
        return

    def model(v: Array, quantities: str) -> Values:
        values, parts = evidence.truth(v, quantities), [evidence.values(one, v, quantities) for one in single]
        return {q: value + sum(c * part[q] for c, part in zip(change, parts, strict=True)) for q, value in values.items()}

    numbers = ", ".join(f"element {suspects[i]} counts {1 + change[i] + 0.0:.3f} x" for i in there)
    name = f"one element x {1 + change[there[0]] + 0.0:.3g}" if len(there) == 1 else "some elements"
    usual = {0: ": it is left out", 2: ": it is summed twice", -1: ": its sign is turned"}
    yield name, numbers + (usual.get(round(1 + change[there[0]], 6), "") if len(there) == 1 else ""), model


def _orders_of_dofs(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Degrees of freedom component by component, in what is taken, what is returned, or both."""
    d, n = evidence.case.mesh.d, evidence.case.mesh.p.size
    if d == 1:
        return
    blocked = np.arange(n).reshape(-1, d).T.ravel()

    def model(taken: bool, returned: bool, u: Array, quantities: str) -> Values:
        values = evidence.truth(u.reshape(d, -1).T.ravel() if taken else u, quantities)
        if returned:
            turned = {"F": lambda F: F[blocked], "K": lambda K: K[blocked][:, blocked] if issparse(K) else K[blocked]}
            values = {q: turned[q](value) if q in turned else value for q, value in values.items()}
        return values

    words = "degrees of freedom are {} component by component (x of all nodes, then y, ...), not node by node"
    yield "results component by component", words.format("returned"), partial(model, False, True)
    yield "displacements component by component", words.format("read"), partial(model, True, False)
    yield "all component by component", words.format("read and returned"), partial(model, True, True)


def _read_otherwise(evidence: Evidence, read: Callable[[Array], Array], u: Array, quantities: str) -> Values:
    """The reference at what is read in the place of the displacements."""
    return evidence.truth(read(u), quantities)


def _other_displacements(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Something else taken for the displacements, and components in another order."""
    d, rest = evidence.case.mesh.d, evidence.case.mesh.p.T.ravel()
    readings: list[tuple[str, str, Callable[[Array], Array]]] = [
        ("sign of u turned", "displacements are subtracted from the positions at rest", lambda u: -u),
        ("u doubled", "displacements are added to the positions at rest twice", lambda u: 2 * u),
        ("u halved", "half of the displacements is added to the positions at rest", lambda u: u / 2),
        ("u taken for positions", "displacements are taken for positions: the positions at rest are not added", lambda u: u - rest),
    ]
    for name, words, read in readings:
        yield name, words, partial(_read_otherwise, evidence, read)

    def model(order: Array, taken: bool, u: Array, quantities: str) -> Values:
        values = evidence.truth(u[order] if taken else u, quantities)
        turned = {"F": lambda F: F[order], "K": lambda K: K[order][:, order] if issparse(K) else K[order]}
        return {q: turned[q](value) if q in turned else value for q, value in values.items()}

    dofs = np.arange(len(rest)).reshape(-1, d)
    for order in list(permutations(range(d)))[1:]:
        said = ", ".join("xyz"[i] for i in order)
        for taken, words in ((False, "returned"), (True, "read and returned")):
            name = f"components {words} in the order {said}"
            yield name, f"components of each node are {words} in this order", partial(model, dofs[:, order].ravel(), taken)


def _orders_of_voigt(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Matrices with their shears in another order, or with shear entries times a factor."""
    names = {3: "23", 4: "13", 5: "12"}
    for order in ((5, 4, 3), (4, 3, 5), (3, 5, 4), (4, 5, 3), (5, 3, 4)):
        said = ", ".join(names[i] for i in order)
        change = partial(_reordered, [0, 1, 2, *order])
        words = f"rows and columns of the elasticity matrix are read as if shears were in the order {said}, not 23, 13, 12"
        yield f"shears in the order {said}", words, partial(_remade, evidence, terms, change)
    for factor in (2.0, 4.0, 0.5, 0.25):
        words = (
            f"shear entries of the elasticity matrix count {factor:g} x: engineering shear strains and the tensor's are confused"
        )
        name = "shear stresses doubled" if factor == 2 else f"shear stresses x {factor:g}"
        if all(isinstance(term.material, Anisotropic) for term in terms):
            yield name, words, partial(_remade, evidence, terms, partial(_scaled_shear, factor))


def _reordered(order: list[int], voigt: Array) -> Array:
    return np.asarray(voigt[..., order, :][..., order])


def _scaled_shear(factor: float, voigt: Array) -> Array:
    scaled = voigt.copy()
    scaled[..., 3:, 3:] *= factor
    return scaled


def _remade(evidence: Evidence, terms: Sequence[StVK], change: Callable[[Array], Array], u: Array, quantities: str) -> Values:
    """The reference of the body with changed elasticity matrices."""
    case = evidence.case
    altered = []
    for term in terms:
        if not isinstance(term.material, Anisotropic):
            raise StvkError("Only anisotropic materials are given as matrices; got another.")
        material = Anisotropic(change(np.asarray(term.material.voigt)), frame=term.material.frame)
        altered.append(StVK(material, term.region, plane=term.plane, thickness=term.thickness, area=term.area))
    control = hourglass_control(case.mesh, altered, case.how) if case.how.is_one_point else None
    model = reference_on(case.mesh.p, case.mesh.t, elasticity(case.mesh, altered, case.how), case.how, control)
    return evidence.values(Player("altered", model, case.mesh.p.size), u, quantities)


def _orders_of_nodes(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Two nodes of every element exchanged: of elements with several points; linear simplices do not mind."""
    case = evidence.case
    if case.mesh.element.is_linear_simplex or case.how.quadrature is not None or case.mesh.k != case.mesh.d:
        return
    right, n = model_of(case.mesh, terms), len(case.mesh.t)
    for a in range(n):
        for b in range(a):
            order = np.arange(n)
            order[[a, b]] = b, a
            model = _of(replace(right, X=right.X[order], t=right.t[order]))
            words = f"nodes {b} and {a} of every element are exchanged: another program's order of nodes"
            yield "nodes in another order", words, model


def _planted(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """The planted faults that have a name, on this body."""
    case = evidence.case
    for fault in FAULTS.values():
        if fault.named and fault.named not in FITTED and not _is_of_another_body(case, fault.body):
            try:
                model = fault.make(case.mesh, terms)
            except Exception:  # it is not for such bodies
                continue
            yield fault.named, fault.description, _of(model)


def _is_of_another_body(case: Case, name: str) -> bool:
    """Whether a fault of this body has no meaning on the case's."""
    if name == "one point":
        return not case.how.is_one_point
    if name == "curved":
        return case.mesh.element.is_linear_simplex or case.how.quadrature is not None
    return case.how.quadrature is not None


def _of(model: Any) -> Model:
    """W, F and K of a model as a function."""
    methods = {"W": "energy", "F": "internal_force", "K": "tangent"}
    return lambda u, quantities: {quantity: getattr(model, methods[quantity])(u) for quantity in quantities}
