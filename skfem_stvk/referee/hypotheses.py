"""Hypotheses on a candidate's fault: models with one fault each.

A hypothesis explains the candidate if its W, F and K equal those of the candidate in strained states, to round-off. Factors of
lambda and mu (`moduli`) and other numbers (`fitted`) are fitted first. All other models, such as the planted faults (`faults`), are
tried without a fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations

import numpy as np
from scipy.sparse import issparse

from ..arguments import Array
from ..edges.materials import Anisotropic
from ..errors import StvkError
from ..terms import StVK
from .bodies import elasticity, hourglass_control, reference_on, with_material
from .case import Case
from .element_model import model_of, of_model
from .evidence import Evidence, Model, Values
from .faults import FAULTS
from .fitted import constants, factors, initial_stresses, single_elements, single_nodes
from .implementations import Implementation
from .moduli import lame_factors
from .reference.kinds import middles

#: Names of those planted faults that are identified by a fit or need more than one state. `_planted` skips them.
FITTED = (
    "lambda doubled", "lambda halved", "lambda of plane stress", "bulk modulus for lambda", "mu halved", "mu doubled",
    "lambda and mu exchanged", "lambda and mu by region", "W, F, K x 4", "F, K x 2", "W, F, K x 2", "K x -1", "F, K x -1",
    "one element x 0", "one element x 2", "K of the state before", "K cached while u is nearly the same",
    "F, K cached while u is nearly the same", "single precision",
    "not a number at inversion", "a constant force", "a constant energy", "force of one node x -1",
    "results component by component", "no initial stress in some elements", "nodes in another order",
    "shears in the order 12, 13, 23", "sign of the initial stress in K", "mesh in mm", "u in mm", "one entry not a number",
)  # fmt: skip


def models(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield name, words and model of each hypothesis."""
    yield from factors(evidence)
    yield from constants(evidence)
    yield from lame_factors(evidence, terms)
    yield from single_elements(evidence, terms)
    yield from single_nodes(evidence)
    yield from initial_stresses(evidence, terms)
    yield from _orders_of_dofs(evidence)
    yield from _other_displacements(evidence)
    yield from _orders_of_voigt(evidence, terms)
    yield from _orders_of_nodes(evidence, terms)
    yield from _planted(evidence, terms)


def _renumbered(evidence: Evidence, read: Array, returned: Array, u: Array, quantities: str) -> Values:
    """Return the values of a reference that reads `u[read]` and returns its values in the order `returned`."""
    values = evidence.truth(u[read], quantities)
    reorder = {"F": lambda F: F[returned], "K": lambda K: K[returned][:, returned] if issparse(K) else K[returned]}
    return {q: reorder[q](value) if q in reorder else value for q, value in values.items()}


def _orders_of_dofs(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Yield hypotheses with degrees of freedom component by component in the argument, the result, or both."""
    d, identity = evidence.case.mesh.d, np.arange(evidence.case.mesh.p.size)
    if d == 1:
        return
    component_order, returned = identity.reshape(d, -1).T.ravel(), identity.reshape(-1, d).T.ravel()
    words = "degrees of freedom are {} component by component (x of all nodes, then y, ...), not node by node"
    for name, what, orders in (
        ("results component by component", "returned", (identity, returned)),
        ("displacements component by component", "read", (component_order, identity)),
        ("all component by component", "read and returned", (component_order, returned)),
    ):
        yield name, words.format(what), partial(_renumbered, evidence, *orders)


def _read_otherwise(evidence: Evidence, read: Callable[[Array], Array], u: Array, quantities: str) -> Values:
    """Return the values of the reference at `read(u)` instead of `u`."""
    return evidence.truth(read(u), quantities)


def _on_scaled_mesh(evidence: Evidence, factor: float, u: Array, quantities: str) -> Values:
    """Return the values of the reference on a mesh that is `factor` times as large.

    The strain is that of `u / factor`. W grows with the volume (area, length) of the elements, and F and K are its derivatives.
    """
    k, values = evidence.case.mesh.k, evidence.truth(u / factor, quantities)
    return {quantity: value * factor ** (k - "WFK".index(quantity)) for quantity, value in values.items()}


def _other_displacements(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Yield hypotheses with misread displacements, and with components in another order."""
    d, rest = evidence.case.mesh.d, evidence.case.mesh.p.T.ravel()
    readings: list[tuple[str, str, Callable[[Array], Array]]] = [
        ("sign of u reversed", "displacements are subtracted from the positions at rest", lambda u: -u),
        ("u doubled", "displacements are added to the positions at rest twice", lambda u: 2 * u),
        ("u halved", "half of the displacements is added to the positions at rest", lambda u: u / 2),
        ("u in mm", "displacements are multiplied by 1000, as from m to mm, but not the positions at rest", lambda u: 1e3 * u),
        ("u in m", "displacements are divided by 1000, as from mm to m, but not the positions at rest", lambda u: u / 1e3),
        ("u taken for positions", "displacements are taken for positions: the positions at rest are not added", lambda u: u - rest),
    ]
    for name, words, read in readings:
        yield name, words, partial(_read_otherwise, evidence, read)

    for name, words, factor in (
        ("mesh in mm", "multiplied by 1000, as from m to mm", 1e3),
        ("mesh in m", "divided by 1000, as from mm to m", 1e-3),
    ):
        yield name, f"positions at rest are {words}, but not the displacements", partial(_on_scaled_mesh, evidence, factor)

    identity = np.arange(len(rest))
    for order in list(permutations(range(d)))[1:]:
        letters, order_of_dofs = ", ".join("xyz"[i] for i in order), identity.reshape(-1, d)[:, order].ravel()
        for read_order, words in ((identity, "returned"), (order_of_dofs, "read and returned")):
            name = f"components {words} in the order {letters}"
            yield (
                name,
                f"components of each node are {words} in this order",
                partial(_renumbered, evidence, read_order, order_of_dofs),
            )


def _orders_of_voigt(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield hypotheses with elasticity matrices whose shears are in another order or multiplied by a factor."""
    names = {3: "23", 4: "13", 5: "12"}
    for order in ((5, 4, 3), (4, 3, 5), (3, 5, 4), (4, 5, 3), (5, 3, 4)):
        shears = ", ".join(names[i] for i in order)
        change = partial(_reordered, [0, 1, 2, *order])
        words = f"rows and columns of the elasticity matrix are read as if shears were in the order {shears}, not 23, 13, 12"
        yield f"shears in the order {shears}", words, partial(_with_elasticity_matrices, evidence, terms, change)
    for factor in (2.0, 4.0, 0.5, 0.25):
        words = (
            f"shear entries of the elasticity matrix count {factor:g} x: engineering shear strains and the tensor's are confused"
        )
        name = "shear stresses doubled" if factor == 2 else f"shear stresses x {factor:g}"
        if all(isinstance(term.material, Anisotropic) for term in terms):
            yield name, words, partial(_with_elasticity_matrices, evidence, terms, partial(_scaled_shear, factor))


def _reordered(order: list[int], voigt: Array) -> Array:
    return np.asarray(voigt[..., order, :][..., order])


def _scaled_shear(factor: float, voigt: Array) -> Array:
    scaled = voigt.copy()
    scaled[..., 3:, 3:] *= factor
    return scaled


def _with_elasticity_matrices(
    evidence: Evidence, terms: Sequence[StVK], change: Callable[[Array], Array], u: Array, quantities: str
) -> Values:
    """Return the values of the reference for a body with changed elasticity matrices.

    Raise StvkError if a material is not anisotropic.
    """
    case = evidence.case
    altered = []
    for term in terms:
        if not isinstance(term.material, Anisotropic):
            raise StvkError(f"material = {type(term.material).__name__}; expected Anisotropic, which has an elasticity matrix.")
        material = Anisotropic(change(np.asarray(term.material.voigt)), frame=term.material.frame)
        altered.append(with_material(term, material))
    control = hourglass_control(case.mesh, altered, case.discretisation) if case.discretisation.is_one_point else None
    reference = reference_on(
        case.mesh.p, case.mesh.t, elasticity(case.mesh, altered, case.discretisation), case.discretisation, control
    )
    return evidence.values(Implementation("altered", reference, case.mesh.p.size), u, quantities)


def _orders_of_nodes(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield hypotheses with two nodes of every element exchanged, or three mid-edge nodes permuted in a cycle.

    Linear simplices are skipped, because these permutations do not change them.
    """
    case = evidence.case
    if case.mesh.element.is_linear_simplex or case.discretisation.quadrature is not None or case.mesh.k != case.mesh.d:
        return
    correct, n = model_of(case.mesh, terms), len(case.mesh.t)
    centres = [middle for middle, _ in middles(case.mesh.element.name)]
    cycles = [cycle for cycle in permutations(centres, 3) if cycle[0] == min(cycle)] if len(centres) <= 6 else []
    for cycle in [*combinations(range(n), 2), *cycles]:
        order = np.arange(n)
        order[list(cycle)] = np.roll(cycle, 1)
        model = of_model(replace(correct, X=correct.X[order], t=correct.t[order]))
        exchanged = " and ".join(map(str, cycle)) + " of every element are exchanged"
        words = exchanged if len(cycle) == 2 else f"{', '.join(map(str, cycle))} of every element are permuted in a cycle"
        yield "nodes in another order", f"nodes {words}: another program's order of nodes", model


def _planted(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield the planted faults that have a name and apply to this body, except those in FITTED."""
    case = evidence.case
    for fault in FAULTS.values():
        if fault.named and fault.named not in FITTED and not _is_of_another_body(case, fault.body):
            try:
                model = fault.make(case.mesh, terms)
            except Exception:  # the fault does not apply to such bodies
                continue
            yield fault.named, fault.description, of_model(model)


def _is_of_another_body(case: Case, name: str) -> bool:
    """Return whether a fault that is defined for the body `name` does not apply to the body of the case."""
    if name == "one point":
        return not case.discretisation.is_one_point
    if name == "curved":
        return case.mesh.element.is_linear_simplex or case.discretisation.quadrature is not None
    return case.discretisation.quadrature is not None
