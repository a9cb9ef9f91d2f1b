"""Naming of a candidate's fault: hypotheses are tried, and those with a vanishing residual name the fault.

Several hypotheses may fit. For example, a missing 1/2 in E, a doubled stress and a doubled volume are equivalent on every body. At
nu = 1/3 the lambda of plane stress is half of lambda. The report prints all hypotheses that fit. If none fits, the smallest piece
of the mesh that fails is searched for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, issparse

from ..arguments import Array
from ..edges.materials import Isotropic
from ..mesh import ElementMesh
from ..terms import StVK
from .bodies import elasticity, hourglass_control, reference_on
from .case import EPS, INVERTED, STRETCH, Case
from .evidence import COARSE, VANISHES, Evidence, flat
from .fitted import suspects_of
from .hypotheses import models
from .implementations import ContractViolation, Implementation
from .results import Explanation, Naming

INVERSION, SINGLE = "not a number at inversion", "single precision"
#: Number of calls that are compared at one state, and time limit for them [s].
REPEATED, LONGEST = 25, 5.0


def name_the_fault(case: Case, terms: Sequence[StVK], make: Callable[[ElementMesh], Any] | None = None) -> Naming:
    """Return the naming of the fault of the case's candidate, which claims to be the body of these terms.

    `make`, if it is given, makes the candidate on any mesh. If no hypothesis holds, it is used to search for the smallest piece of
    the mesh that fails.
    """
    assert case.candidate is not None
    differing = _not_repeatable(case, case.candidate)
    if differing:
        return Naming(explanations=[Explanation("not repeatable", differing, np.inf)], tried=1)
    evidence = Evidence(case, case.candidate)
    one = _one_entry(evidence)
    if one is not None:
        return Naming(explanations=[one], tried=1)
    if not evidence.found:
        values = "finite values" if evidence.not_finite else "values"
        return Naming(smallest=f"The candidate returns no {values} in strained states.")
    naming = Naming(before=evidence.error(evidence.truth, np.inf), smallest=_not_finite(evidence))
    naming.explain(
        Explanation(name, words, naming.before if holds else np.inf) for holds, (name, words) in _direct_explanations(evidence)
    )
    if naming.explanations or naming.before <= VANISHES:  # if all values are right, every model that does not change them fits
        if naming.names == [INVERSION]:
            naming.smallest = ""
        elif naming.smallest and not naming.explanations:
            naming.smallest += " In the other states its values are correct to eight digits of the largest value of the body."
        elif not naming.explanations:
            naming.smallest = (
                "In strained states its values are correct to eight digits of the largest value of the body. The failure is in "
                "further digits, in a much softer part, or in another state, such as rest."
            )
        return naming
    unexplained: list[str] = []
    if not naming.explain(_hypotheses(evidence, terms), VANISHES) and len(evidence.quantities) > 1:
        unexplained = _explain_each_quantity(naming, evidence, terms)
    if not naming.explanations:
        unexplained.append(_fewest_nodes(evidence) if make is None else smallest_piece(make, case, terms))
    naming.smallest = " ".join(filter(None, (naming.smallest, *unexplained)))
    return naming


def _not_repeatable(case: Case, implementation: Implementation) -> str:
    """Return a text on the quantities that change from call to call at one state, or "" if none changes by more than VANISHES."""
    u, differing = case.states[STRETCH], []
    v = case.random("repeated").standard_normal(len(u))
    for quantity in filter(implementation.has, "WFK"):
        call = getattr(implementation, quantity)
        begin = time.perf_counter()
        values: list[Array] = []
        try:
            call(u)  # this call may return the values of the previous state, a fault with its own explanation
            while len(values) < REPEATED and (len(values) < 2 or time.perf_counter() - begin < LONGEST):
                values.append(np.ravel(call(u) @ v if quantity == "K" else call(u)))
        except ContractViolation:
            continue
        size = max(np.abs(value).max(initial=0.0) for value in values)
        off = [np.abs(value - values[0]).max(initial=0.0) > VANISHES * size for value in values]
        if any(off):
            differing.append(f"{quantity} in {sum(off)} of {len(off) - 1} calls")
    if not differing:
        return ""
    return (
        f"repeated calls at one u return different values ({', '.join(differing)}). Threads may write to the same array, or an "
        "array may be uninitialised. Correct this first: all other checks judge random values"
    )


def _one_entry(evidence: Evidence) -> Explanation | None:
    """Return the explanation that one entry of W, F or K is not finite, and all other values are right, or None."""
    error, entries, d = evidence.error(evidence.truth) if evidence.found else 0.0, set(), evidence.case.mesh.d
    for state, values in evidence.not_finite.items():
        truth = evidence.truth(evidence.case.states[state])
        for quantity, value in values.items():
            off = coo_matrix(value - truth[quantity] if issparse(value) else np.atleast_2d(value - truth[quantity]))
            missing = ~np.isfinite(off.data)
            entries |= {(quantity, *entry) for entry in zip(off.row[missing].tolist(), off.col[missing].tolist(), strict=True)}
            error = max(error, np.abs(off.data[~missing]).max(initial=0.0) / evidence.largest[quantity])
    states = list(evidence.not_finite)
    if len(entries) != 1 or error > VANISHES or (("W", 0, 0) in entries and len(states) > 1):
        return None
    ((quantity, row, column),) = entries
    where = {"F": f" at dof {column} (node {column // d}, {'xyz'[column % d]})", "K": f" in row {row}, column {column}"}
    words = f"{quantity} is not finite{where.get(quantity, '')} in {', '.join(states)}; all other values are right"
    return Explanation("one entry not a number", f"{words}. A file is damaged, or an entry is not written", error)


def _hypotheses(evidence: Evidence, terms: Sequence[StVK]) -> Iterator[Explanation]:
    """Yield all hypotheses, each with its residual error."""
    for name, words, model in models(evidence, terms):
        yield Explanation(name, words, evidence.error(model))


def _explain_each_quantity(naming: Naming, evidence: Evidence, terms: Sequence[StVK]) -> list[str]:
    """Explain each of W, F and K separately, store this as one explanation, and return sentences on the unexplained quantities."""
    correct, found, unexplained = [], {}, []
    for quantity in evidence.quantities:
        single, fit = evidence.of(quantity), Naming()
        if single.error(single.truth) <= VANISHES:
            correct.append(quantity)
        elif fit.explain(_hypotheses(single, terms), VANISHES):
            found[quantity] = fit
        else:
            unexplained.append(quantity)
        naming.tried += fit.tried
    fits = list(found.values())
    common = [name for name in fits[0].names if all(name in fit.names for fit in fits)] if fits else []
    names_of = {quantity: common or fit.names for quantity, fit in found.items()} | {quantity: ["right"] for quantity in correct}
    names = [f"{quantity}: {' or '.join(names_of[quantity])}" for quantity in evidence.quantities if quantity in names_of]
    if found:
        words = "; ".join(
            f"{quantity}: {next(one.words for one in fit.explanations if one.name in names_of[quantity])}"
            for quantity, fit in found.items()
        )
        residual = max(one.residual for fit in fits for one in fit.explanations)
        naming.explanations = [Explanation("; ".join(names), words, residual)]
        return [f"{quantity} has a further fault, which no hypothesis explains." for quantity in unexplained]
    return [f"{' and '.join(correct)} {'are' if len(correct) > 1 else 'is'} correct."] if correct else []


def _not_finite(evidence: Evidence) -> str:
    """Return a text on the states in which values are not finite."""
    by_quantity: dict[str, list[str]] = {}
    for state, values in evidence.not_finite.items():
        for quantity in (q for q, value in values.items() if not np.isfinite(flat(value)).all()):
            by_quantity.setdefault(quantity, []).append(state)
    return " ".join(
        f"{quantity} has entries that are not finite in: {', '.join(by_quantity[quantity])}." for quantity in by_quantity
    )


# explanations that need no model


def _direct_explanations(evidence: Evidence) -> Iterator[tuple[bool, tuple[str, str]]]:
    """Yield whether an explanation holds, with its name and words, for explanations that follow from the values themselves.

    These are: values that are not finite, single precision, and a K that belongs to the previous state.
    """
    error = evidence.error(evidence.truth)
    inverted = [state for state in INVERTED if state in evidence.not_finite]
    words = "values are not finite if elements are inverted, as with a logarithm or a root of J; elsewhere they are correct"
    yield bool(inverted) and len(inverted) == len(evidence.not_finite) and error <= VANISHES, (INVERSION, words)
    decimal = VANISHES < error < COARSE and _has_few_digits(evidence)
    evidence_of_rounding = "in values of nine digits at most" if decimal else "that change from state to state like rounding"
    rounded = decimal or (VANISHES < error < COARSE and _is_rounding(evidence))
    yield rounded, (SINGLE, f"errors of {error:.0e} {evidence_of_rounding}: sums, positions or output in float32")
    others = [quantity for quantity in evidence.quantities if quantity != "K"]
    if all(evidence.of(quantity).error(evidence.truth) <= VANISHES for quantity in others):
        words = "K is that of the previous call's state: the cached K is not updated"
        yield "K" in evidence.quantities and _is_stale(evidence), ("K of the state before", words)
        cached = ", ".join(quantity for quantity in evidence.quantities if _is_cached(evidence, quantity))
        words = f"{cached} is not recomputed if u has hardly changed, for example because of `numpy.allclose`, or the norm as a key"
        yield bool(cached), (f"{cached} cached while u is nearly the same", words)


def _has_few_digits(evidence: Evidence) -> bool:
    """Return whether each wrong quantity has only values that are exact in float32 or in nine decimal digits."""
    off = [quantity for quantity in evidence.quantities if evidence.of(quantity).error(evidence.truth) > VANISHES]
    values = [flat(found[quantity]) for quantity in off for found in evidence.found.values()]
    with np.errstate(over="ignore"):
        return all(
            (array.astype(np.float32) == array).all() or all(float(f"{value:.8e}") == value for value in array.tolist())
            for array in values
        )


def _is_rounding(evidence: Evidence) -> bool:
    """Return whether the errors change by their own size under a tiny change of the state, as round-off does."""
    u = evidence.case.states[STRETCH]
    try:
        first, nearby = (_differences(evidence, v) for v in (u, (1 + 1e-4) * u))
    except ContractViolation:  # precomputed values exist in no other state
        return False
    large = [quantity for quantity in evidence.quantities if first[quantity][1] > VANISHES]
    return bool(large) and all(np.max(abs(nearby[q][0] - first[q][0])) > 0.1 * np.max(abs(first[q][0])) for q in large)


def _differences(evidence: Evidence, u: Array) -> dict[str, tuple[Any, float]]:
    """Return for each quantity the difference of candidate and reference at `u`, and its relative size."""
    values, truth = evidence.values(evidence.implementation, u), evidence.truth(u)
    return {q: (values[q] - truth[q], evidence.relative_difference(values[q], truth[q])) for q in evidence.quantities}


def _is_stale(evidence: Evidence) -> bool:
    case, implementation = evidence.case, evidence.implementation
    a, b = (case.states[state] for state in (STRETCH, "35 % compression"))
    try:
        implementation.K(a)
        late = evidence.value(implementation.K(b))
    except ContractViolation:
        return False
    return (
        evidence.relative_difference(late, case.reference.K(a))
        <= VANISHES
        < evidence.relative_difference(late, case.reference.K(b))
    )


def _is_cached(evidence: Evidence, quantity: str) -> bool:
    """Return whether the candidate returns a bitwise identical W, F or K at a nearby state, that is, caches it.

    The value must be right at the first state, and the reference must return different values in the two states.
    """
    case, call, truth = evidence.case, getattr(evidence.implementation, quantity), getattr(evidence.case.reference, quantity)
    u = case.states[STRETCH]
    try:
        for nearby in case.nearby:
            call(case.states["35 % compression"])
            first, second = (evidence.value(call(v)) for v in (u, nearby))
            right = evidence.relative_difference(first, truth(u)) <= VANISHES
            changed = evidence.relative_difference(evidence.value(truth(nearby)), truth(u)) > EPS
            if right and changed and evidence.relative_difference(second, first) == 0.0:
                return True
    except ContractViolation:
        pass
    return False


# the smallest failing displacement and the smallest failing mesh


def _fewest_nodes(evidence: Evidence) -> str:
    """Return a text on the first node whose displacement alone makes the candidate fail, or on its failure at rest.

    Nodes of suspects, the elements with an error at all nodes, come first. The text is empty for precomputed values.
    """
    case, mesh, called = evidence.case, evidence.case.mesh, False
    suspects = suspects_of(evidence)[2]
    of_suspects = np.unique(mesh.t[:, suspects])
    for node in [None, *of_suspects, *np.setdiff1d(np.arange(mesh.nv), of_suspects)][:60]:
        u, around = np.zeros(mesh.p.size), suspects
        if node is not None:
            u[mesh.d * node : mesh.d * (node + 1)] = 0.2 * case.node_size[node] * np.array([1.0, 0.7, -0.4])[: mesh.d]
            around = np.flatnonzero((mesh.t == node).any(axis=0))
            around = np.intersect1d(around, suspects) if node in of_suspects else around
        try:
            values, truth = evidence.values(evidence.implementation, u), evidence.truth(u)
        except ContractViolation:
            continue
        called = True
        errors = [np.abs(flat(values[q] - truth[q])).max(initial=0.0) / evidence.largest[q] for q in evidence.quantities]
        if not max(errors) <= VANISHES:
            ids = ", ".join(map(str, around[:5])) + (", ..." if len(around) > 5 else "")
            if node is None:
                return "It fails at rest" + (f", in the elements {ids}." if ids else ".")
            return f"Moving node {node} alone, in the elements {ids}, makes it fail."
    return "Moving a single node, the nodes of suspects first, does not make it fail." if called else ""


def smallest_piece(make: Callable[[ElementMesh], Any], case: Case, terms: Sequence[StVK]) -> str:
    """Return a text on the fewest elements on which a candidate, made for this piece, still disagrees with the reference."""
    mesh = case.mesh
    if any(not isinstance(term.material, Isotropic) or np.ndim(term.material.young) for term in terms) or len(terms) > 1:
        return "The smallest failing mesh is searched only for bodies of one material."

    def fails(ids: Array) -> bool:
        used, t = np.unique(mesh.t[:, ids], return_inverse=True)
        piece = ElementMesh(mesh.p[:, used], t.reshape(len(mesh.t), -1).astype(np.int32), element=mesh.element)
        tensor = elasticity(piece, terms, case.discretisation)
        control = hourglass_control(piece, terms, case.discretisation) if case.discretisation.is_one_point else None
        truth = Implementation("reference", reference_on(piece.p, piece.t, tensor, case.discretisation, control), piece.p.size)
        try:
            implementation = Implementation("candidate", make(piece), piece.p.size)
            u = 0.1 * case.median_edge * case.random("piece").standard_normal(piece.p.size)
            for quantity in "WFK":
                if implementation.has(quantity):
                    value, truth_value = getattr(implementation, quantity)(u), getattr(truth, quantity)(u)
                    if not np.abs(flat(value - truth_value)).max(initial=0.0) <= VANISHES * np.abs(flat(truth_value)).max(
                        initial=0.0
                    ):
                        return True
        except Exception:  # the candidate cannot be made or evaluated on this piece
            return False
        return False

    pieces: list[Array] = [np.arange(mesh.nt)]
    failing = pieces[0] if fails(pieces[0]) else None
    for element in range(min(mesh.nt, 30)):
        if fails(np.array([element])):
            return f"The smallest mesh that fails is one element: {element}, nodes {mesh.t[:, element].tolist()}."
    while failing is not None and len(failing) > 2:
        halves = [failing[: len(failing) // 2], failing[len(failing) // 2 :], failing[::2], failing[1::2]]
        smaller = next((half for half in halves if fails(half)), None)
        if smaller is None:
            break
        failing = smaller
    if failing is None:
        return "A new candidate on this mesh does not fail."
    ids = ", ".join(map(str, failing[:8])) + (", ..." if len(failing) > 8 else "")
    return f"The smallest mesh found that fails has {len(failing)} elements: {ids}."
