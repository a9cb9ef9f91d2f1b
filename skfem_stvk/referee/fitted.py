"""Hypotheses with numbers that are fitted to the candidate by least squares.

The numbers are factors or constants. Factors apply to W, F and K as a whole, to single elements, or to the force on one node. Other
factors apply to the initial stress in each element. Constants are added to W or F.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, issparse, vstack
from scipy.sparse.linalg import lsqr

from ..arguments import Array
from ..errors import name_ids
from ..terms import StVK
from .bodies import elasticity, reference_on
from .element_model import model_of, of_model
from .evidence import VANISHES, Evidence, Model, Values, flat
from .implementations import Implementation
from .judgement import largest_component
from .moduli import number

READINGS = {
    4.0: "E without its 1/2 in all of them, E doubled, or moduli four times too large",
    2.0: "Young's modulus, the stress, the volume, or E in the stress alone is doubled (a missing 1/2)",
    0.5: "Young's modulus, the stress or the volume is halved",
    0.25: "moduli or E are halved twice",
    -1.0: "the sign is reversed",
    6.0: "the determinant is taken for the volume of a tetrahedron, without 1/6",
    3.0: "1/2 in the place of 1/6 in the volume of a tetrahedron",
    1 / 6: "1/6 counts twice in the volume of a tetrahedron",
    **{10.0**power: "units, as of Pa, kPa, MPa and GPa, or m and mm, are mixed" for power in (-9, -6, -3, 3, 6, 9)},
}


def factors(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Yield the hypothesis that W, F and K are each multiplied by a number."""
    fitted = {}
    for quantity in evidence.quantities:
        pairs = [
            (values[quantity], evidence.truth(evidence.case.states[s], quantity)[quantity]) for s, values in evidence.found.items()
        ]
        above, below = (sum(float(_product(a[i], a[1])) for a in pairs) for i in (0, 1))
        fitted[quantity] = above / below if below else 1.0
    off: dict[float, list[str]] = {}
    for quantity, factor in fitted.items():
        if abs(factor - 1) > 1e-6:
            off.setdefault(float(f"{factor:.6g}"), []).append(quantity)
    if not off:
        return
    name = "; ".join(f"{', '.join(names)} x {factor:g}" for factor, names in off.items())
    reading = "; ".join(dict.fromkeys(_reading(factor) for factor in off))

    def model(u: Array, quantities: str) -> Values:
        return {quantity: fitted[quantity] * value for quantity, value in evidence.truth(u, quantities).items()}

    words = "; ".join(
        f"your {' and '.join(names)} {'is' if len(names) == 1 else 'are'} {number(factor)} x" for factor, names in off.items()
    )
    yield name, f"{words}: {reading}", model


def _product(a: Any, b: Any) -> float:
    return float(a.multiply(b).sum()) if issparse(a) and issparse(b) else float(np.vdot(flat(a), flat(b)))


def _reading(factor: float) -> str:
    if abs(factor) < 1e-14:
        return "it is zero"
    near = [words for value, words in READINGS.items() if abs(factor / value - 1) < 1e-5]
    return near[0] if near else "a factor without a usual cause"


def suspects_of(evidence: Evidence) -> tuple[str, Any, NDArray[np.int64]]:
    """Return which of F and K is wrong, its error in the first strained state, and the elements with an error at all nodes."""
    wrong = [q for q in evidence.quantities if q != "W" and evidence.of(q).error(evidence.truth) > VANISHES]
    if not wrong or not evidence.found:
        return "", None, np.zeros(0, np.int64)
    quantity, mesh, state = wrong[0], evidence.case.mesh, next(iter(evidence.found))
    off = evidence.found[state][quantity] - evidence.truth(evidence.case.states[state])[quantity]
    rows = np.asarray(abs(off).max(axis=1).todense()).ravel() if issparse(off) else np.abs(off).reshape(mesh.p.size, -1).max(axis=1)
    bad = largest_component(rows, mesh.d) > 1e-9 * max(float(rows.max()), np.finfo(float).tiny)
    return quantity, off, np.flatnonzero(bad[mesh.t].all(axis=0))


def single_elements(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield the hypothesis that a few elements are each multiplied by a factor.

    The suspects are the elements with a wrong force, or K, on all their nodes. There may be at most five.
    """
    case = evidence.case
    mesh, (quantity, off, suspects) = case.mesh, suspects_of(evidence)
    if case.discretisation.is_one_point or not 0 < len(suspects) <= 5 or len(suspects) == mesh.nt:
        return
    u = case.states[next(iter(evidence.found))]
    tensor = elasticity(mesh, terms, case.discretisation)
    single = [
        Implementation(
            "part",
            reference_on(mesh.p, mesh.t[:, [e]], tensor if len(tensor) == 1 else tensor[[e]], case.discretisation),
            mesh.p.size,
        )
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
    usual = {0: ": it is left out", 2: ": it is summed twice", -1: ": its sign is reversed"}
    yield name, numbers + (usual.get(round(1 + change[there[0]], 6), "") if len(there) == 1 else ""), model


def constants(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Yield the hypotheses that the same constant is added to W, or to F, in every state."""
    mean = {q: sum(off) / len(off) for q, off in ((q, list(_off(evidence, q).values())) for q in "WF" if q in evidence.quantities)}

    def model(quantity: str, u: Array, quantities: str) -> Values:
        return {q: value + mean[q] if q == quantity else value for q, value in evidence.truth(u, quantities).items()}

    if "W" in mean:
        words = f"W has the same additional energy in every state, {mean['W']:.3g} J"
        yield "a constant energy", words, partial(model, "W")
    if "F" in mean:
        size = largest_component(mean["F"], evidence.case.mesh.d)
        nodes = ", ".join(map(str, np.flatnonzero(size > 1e-3 * size.max())[:5]))
        words = f"F has the same additional force in every state, on nodes {nodes}: a load left in"
        yield "a constant force", words, partial(model, "F")


def single_nodes(evidence: Evidence) -> Iterator[tuple[str, str, Model]]:
    """Yield the hypothesis that the force on one node is multiplied by a factor, if F is wrong only there."""
    if "F" not in evidence.quantities:
        return
    d, off = evidence.case.mesh.d, _off(evidence, "F")
    size = np.max([largest_component(one, d) for one in off.values()], axis=0)
    nodes = np.flatnonzero(size > 1e-9 * size.max())
    if len(nodes) != 1:
        return
    dofs = d * nodes[0] + np.arange(d)
    right = np.concatenate([evidence.truth(evidence.case.states[state], "F")["F"][dofs] for state in off])
    factor = 1 + float(np.concatenate([one[dofs] for one in off.values()]) @ right / (right @ right))

    def model(u: Array, quantities: str) -> Values:
        values = evidence.truth(u, quantities)
        if "F" in values:
            values["F"][dofs] *= factor
        return values

    yield f"force of one node x {factor:.3g}", f"the force on node {nodes[0]} counts {number(factor)} x", model


def initial_stresses(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[tuple[str, str, Model]]:
    """Yield the hypothesis that K lacks the initial stress of some elements, found by a sparse least-squares problem."""
    case, mesh = evidence.case, evidence.case.mesh
    others = [q for q in evidence.quantities if q != "K" and evidence.of(q).error(evidence.truth) > VANISHES]
    if (
        "K" not in evidence.quantities
        or others
        or case.discretisation.is_one_point
        or case.discretisation.quadrature is not None
        or mesh.k != mesh.d
    ):
        return
    right = model_of(mesh, terms)
    rows, columns = [], []
    for state, off in _off(evidence, "K").items():
        signs = evidence.signs(mesh.p.size).reshape(mesh.nv, -1)  # (nv, 4 d): four vectors, component by component
        parts = np.einsum("tab,btm->atm", right.initial_stress(case.states[state]), signs[mesh.t])
        rows.append(evidence.column(off))
        dofs = mesh.t[:, :, None] * signs.shape[1] + np.arange(signs.shape[1])
        elements = np.broadcast_to(np.arange(mesh.nt)[None, :, None], dofs.shape)
        columns.append(coo_matrix((parts.ravel(), (dofs.ravel(), elements.ravel())), shape=(signs.size, mesh.nt)))
    A, b = vstack(columns), np.concatenate(rows)
    whole = np.asarray(A.sum(axis=1)).ravel()
    factor = round(1 + float(whole @ b / (whole @ whole)), 9)
    if factor or not mesh.element.is_linear_simplex:  # a planted fault has no initial stress in the edges of simplices
        usual = {0.0: "no initial stress in K", -1.0: "sign of the initial stress in K"}
        words = f"the initial stress in K counts {number(factor)} x"
        yield usual.get(factor, f"initial stress in K x {factor:.3g}"), words, of_model(replace(right, initial=factor))
    counts = 1 + lsqr(A, b, atol=1e-14, btol=1e-14, iter_lim=1000)[0]
    missing = np.flatnonzero(np.abs(counts) < 1e-6)
    if 0 < len(missing) < mesh.nt and np.abs(counts - counts.round()).max() < 1e-6:
        words = f"K has no initial stress in {name_ids(missing, 'element')}"
        yield "no initial stress in some elements", words, of_model(replace(right, initial=counts.round()[:, None, None]))


def _off(evidence: Evidence, quantity: str) -> dict[str, Any]:
    """Return the difference of candidate and reference by state."""
    truth = {state: evidence.truth(evidence.case.states[state], quantity)[quantity] for state in evidence.found}
    return {state: values[quantity] - truth[state] for state, values in evidence.found.items()}
