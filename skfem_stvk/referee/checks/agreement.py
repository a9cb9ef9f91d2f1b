"""Checks that W, F and K agree with scikit-fem's standard assembly, and that F is the derivative of W and K that of F.

Along a line `u + s v` the energy of St. Venant-Kirchhoff is exactly a quartic in `s`, and the force a cubic. Hence the five-point
stencil

    f'(0) = [ f(-2) - 8 f(-1) + 8 f(1) - f(2) ] / 12

has no truncation error, and there is no step size to choose. Other laws get a Taylor test with a fitted order.

A reduced body is compared with its full body in the span of its fields, `u = columns z`, where z holds all amounts, including those
of lifts. W is compared with `W(u)`, `dW/dz` with `columns' F(u)`, and `d2W/dz2` with `columns' K(u) columns`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from scipy.sparse import csr_matrix, issparse

from ...arguments import Array
from ...system import System
from ..case import EPS, STRETCH, Case
from ..implementations import Implementation
from ..judgement import LIMIT, by_entry, by_node, largest_component, largest_rows, of_whole_body
from ..manufactured import fitted_order
from ..results import CannotDecide, NotApplicable, Task

AGREEMENT = "1e-12 allows for round-off of another order of summation; 1e-15 is usual"
DERIVATIVES = "1e-12 allows for round-off: the five-point stencil is exact for this law; 1e-15 is usual"
STENCIL = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))
ORDER, DIRECTIONS = 1.9, 2
MEMORY = "1e-12 allows for sums in another order; a value that is cached for a nearby u differs by 1e-11 or more"
REDUCED, FULL = "the reduced body", "the body"
#: Largest displacements of the states of reduced bodies, relative to the size of the body.
STATES = {"at rest, nearly": 1e-4, "small": 0.02, "large": 0.3}


def agreement(case: Case) -> Iterator[Task]:
    """Yield the comparisons of each implementation with each reference that it must agree with, in every state."""
    pairs = [(case.ours, case.reference)]
    if case.candidate is not None:
        pairs += [(case.candidate, case.reference), (case.candidate, case.ours)]
    for state in case.states:
        for quantity in "WFK":
            for implementation, reference in pairs:
                measure = partial(_difference, case, implementation, reference, quantity, state)
                yield Task("agreement", implementation, quantity, state, quantity, measure, against=reference.name)


def _difference(case: Case, implementation: Implementation, reference: Implementation, quantity: str, state: str) -> dict[str, Any]:
    if not case.is_stvk(implementation):
        raise NotApplicable("the candidate does not claim to be St. Venant-Kirchhoff")
    truth, value = case.value(reference, quantity, state), case.value(implementation, quantity, state)
    u = case.states[state]
    if quantity == "W":
        floor = case.energy_floor(reference)
        words = "W_ref" if truth >= floor else "K at rest x edge squared, median"
        return of_whole_body(abs(value - truth), max(truth, floor), case.limits.of_body(u), words, AGREEMENT)
    if quantity == "F":
        words, scale = "largest |F_ref| around, or K at rest x edge", case.force_scale(reference, truth)
        return by_node(case.mesh, value - truth, scale, case.limits.of_nodes(u), words, AGREEMENT)
    return _matrix_difference(case, value, truth, u)


def _matrix_difference(case: Case, K: Any, truth: csr_matrix, u: Array) -> dict[str, Any]:
    if issparse(K):
        rows = np.maximum(largest_rows(truth, case.mesh.d), case.stiffness(case.reference))
        return by_entry(
            case.mesh, K - truth, rows, case.limits.of_pairs(u), "largest |K_ref| of the rows, now or at rest", AGREEMENT
        )
    signs = case.random("agreement").choice([-1.0, 1.0], size=(K.shape[1], 4))  # every entry of a row contributes to its products
    error = np.max([np.abs(K @ v - truth @ v) for v in signs.T], axis=0)
    sums = largest_component(np.asarray(abs(truth).sum(axis=1)).ravel(), case.mesh.d)
    limit = case.limits.of_nodes(u)
    return by_node(case.mesh, error, sums, limit, "products with random signs over the row sum of |K_ref|", AGREEMENT)


def derivatives(case: Case) -> Iterator[Task]:
    """Yield the tests of `dW/du = F` and `dF/du = K` for every implementation in every state."""
    for implementation in case.implementations:
        test = _stencil if case.is_stvk(implementation) else _taylor
        for state in case.states:
            for quantity, needs in (("F", "WF"), ("K", "FK")):
                yield Task(
                    "derivatives", implementation, quantity, state, needs, partial(test, case, implementation, quantity, state)
                )


def memory(case: Case) -> Iterator[Task]:
    """Yield the tests that W, F and K at u do not depend on earlier calls, for example at two states nearly equal to u."""
    for implementation in case.implementations:
        for quantity in "WFK":
            yield Task("memory", implementation, quantity, STRETCH, quantity, partial(_remembered, case, implementation, quantity))


def _remembered(case: Case, implementation: Implementation, quantity: str) -> dict[str, Any]:
    u, far_state, call, d = case.states[STRETCH], case.states["35 % compression"], getattr(implementation, quantity), case.mesh.d
    v = case.random("memory").standard_normal(len(u))

    def value(u: Array) -> Array:
        return np.atleast_1d(call(u) @ v if quantity == "K" else call(u))

    def changed(nearby: Array) -> dict[str, Any]:
        value(far_state)  # any cached value now belongs to a distant state
        from_start = value(nearby)
        value(far_state)
        value(u)
        change = value(nearby) - from_start
        if quantity == "W":
            return of_whole_body(
                float(np.abs(change[0])), float(np.abs(from_start[0])) or 1.0, case.limits.of_body(u), "|W|", MEMORY
            )
        scale = case.limits.around(largest_component(from_start, d))
        scale = np.maximum(scale, case.stiffness(implementation) * (largest_component(v, d) if quantity == "K" else case.node_size))
        return by_node(
            case.mesh, change, scale, case.limits.of_nodes(u), "largest |K v| or |F| around, or K at rest x |v| or edge", MEMORY
        )

    return max(map(changed, case.nearby[: 1 if quantity == "W" else 2]), key=badness)  # W does not see one node above round-off


class Line(NamedTuple):
    """Function along `u + s v`, with its claimed derivative at `s = 0`."""

    u: Array
    v: Array
    function: Callable[[float], Array]
    claimed: Array


def _lines(case: Case, implementation: Implementation, quantity: str, state: str) -> Iterator[Line]:
    """Yield W or F along random lines scaled to the state."""
    u, rng = case.states[state], case.random(f"derivatives {state}")
    primitive, derivative = (implementation.W, implementation.F) if quantity == "F" else (implementation.F, implementation.K)
    for _ in range(DIRECTIONS):
        v = case.direction(u, rng)
        yield Line(u, v, partial(_at, primitive, u, v), np.atleast_1d(derivative(u) @ v))


def _at(function: Callable[[Array], Any], u: Array, v: Array, s: float) -> Array:
    return np.atleast_1d(function(u + s * v))


def _stencil(case: Case, implementation: Implementation, quantity: str, state: str) -> dict[str, Any]:
    return max(
        (_along(case, implementation, quantity, line) for line in _lines(case, implementation, quantity, state)), key=badness
    )


def _along(case: Case, implementation: Implementation, quantity: str, line: Line) -> dict[str, Any]:
    u, change = line.u, case.amplitude(line.u)
    terms = np.array([weight * line.function(s) for s, weight in STENCIL])
    error, words = np.abs(terms.sum(axis=0) - line.claimed), "largest term of the stencil"
    d = case.mesh.d
    if quantity == "F":
        return of_whole_body(float(error[0]), float(np.abs(terms).max()), case.limits.of_body(u, change=change), words, DERIVATIVES)
    scale = case.limits.around(largest_component(np.abs(terms).max(axis=0), d))
    return by_node(case.mesh, error, scale, case.limits.of_nodes(u, change), f"{words} around", DERIVATIVES)


def _taylor(case: Case, implementation: Implementation, quantity: str, state: str) -> dict[str, Any]:
    case.refuse_undefined(implementation, state)
    return max((taylor_order(line.function, line.claimed) for line in _lines(case, implementation, quantity, state)), key=badness)


def taylor_order(function: Callable[[float], Array], claimed: Array) -> dict[str, Any]:
    """Return the measurement of a Taylor test: `|f(s) - f(0) - s f'(0)|` must fall with order 2.

    The measured value is 2 minus the fitted order. Raise CannotDecide if round-off hides the derivative.
    """
    start, steps = function(0.0), 0.5 ** np.arange(2, 16)
    remainders = np.array([np.abs(function(s) - start - s * claimed).max() for s in steps])
    round_off = 1e3 * EPS * max(float(np.abs(start).max()), float(np.abs(claimed).max()))
    usable = np.flatnonzero(~(remainders <= round_off))
    if len(usable) >= 3:
        half = usable[len(usable) // 2 if len(usable) >= 6 else 0 :]  # the smaller steps, where the leading term dominates
        order = fitted_order(steps[half], remainders[half])
        words = f"fitted to {len(usable)} of {len(steps)} steps, above round-off"
    elif round_off < 1e-6 * steps[0] * float(np.abs(claimed).max()):
        order, words = 2.0, "linear along the line: no remainder above round-off"
    else:
        raise CannotDecide(
            "round-off hides the derivative along the line: the values are too large for their changes, or never change"
        )
    return {
        "measured": 2 - order,
        "limit": 2 - ORDER,
        "scale": f"order {order:.2f}, {words}",
        "reason": "Taylor test: the remainder of a right derivative falls with order 2, that of a wrong one with 1; "
        f"at least {ORDER} is required",
    }


def badness(measurement: dict[str, Any]) -> float:
    """Return the measured value over its limit, or infinity if the value is not finite."""
    return float(measurement["measured"]) / measurement["limit"] if np.isfinite(measurement["measured"]) else np.inf


@runtime_checkable
class OfFewUnknowns(Protocol):
    """Reduced body with displacements `columns z`.

    The first `size` entries of z are unknown. Their fields are orthonormal with respect to the lumped `masses` (ndofs,).
    """

    @property
    def body(self) -> System: ...
    @property
    def columns(self) -> Array: ...
    @property
    def masses(self) -> Array: ...
    @property
    def size(self) -> int: ...
    @property
    def quartic(self) -> bool: ...
    def response(self, z: Array) -> tuple[float, Array, Array]: ...


def checks_of_reduced(reduced: OfFewUnknowns, rng: np.random.Generator) -> Iterator[Task]:
    """Yield the tasks of a reduced body."""
    implementation = Implementation(REDUCED, reduced, reduced.size)
    yield Task("orthonormality", implementation, "V' M V", "", "", partial(_orthonormal, reduced), against="the identity")
    size = float(np.linalg.norm(np.ptp(reduced.body.mesh.p, axis=1)))
    for state, amount in STATES.items():
        z, v = (_amounts(reduced, amount * size, rng) for _ in range(2))
        for number, quantity in enumerate("WFK"):
            yield Task(
                "agreement", implementation, quantity, state, "", partial(_projected_difference, reduced, z, number), against=FULL
            )
        for number, quantity in enumerate("FK"):
            test = partial(_reduced_stencil if reduced.quartic else _reduced_taylor, reduced, z, v, number)
            yield Task("derivatives", implementation, quantity, state, "", test)
        yield Task("symmetry", implementation, "K", state, "", partial(_symmetry, reduced, z))


def _amounts(reduced: OfFewUnknowns, largest: float, rng: np.random.Generator) -> Array:
    """Return random amounts with a prescribed largest displacement. Softer fields get larger amounts."""
    K = reduced.response(np.zeros(reduced.columns.shape[1]))[2]
    z = rng.standard_normal(len(K)) / np.sqrt(np.maximum(np.diagonal(K), np.finfo(float).tiny))
    return np.asarray(z * largest / np.abs(reduced.columns @ z).max())


def _orthonormal(reduced: OfFewUnknowns) -> dict[str, Any]:
    V = reduced.columns[:, : reduced.size]
    error = np.abs(V.T @ (reduced.masses[:, None] * V) - np.eye(reduced.size)).max()
    return {"measured": float(error), "limit": LIMIT, "scale": "1", "reason": "1e-12 allows for round-off of a sum over all nodes"}


def _projected_difference(reduced: OfFewUnknowns, z: Array, number: int) -> dict[str, Any]:
    """Compare W, F or K with that of the full body."""
    V, u = reduced.columns, reduced.columns @ z
    full: Callable[[], Any] = (
        lambda: reduced.body.energy(u),
        lambda: V.T @ reduced.body.internal_force(u),
        lambda: V.T @ (reduced.body.tangent(u) @ V),
    )[number]
    truth = np.asarray(full())
    return _relative(np.asarray(reduced.response(z)[number]) - truth, truth, "largest entry of the body's", AGREEMENT)


def _reduced_along(reduced: OfFewUnknowns, z: Array, v: Array, number: int, s: float) -> Array:
    return np.atleast_1d(np.array(reduced.response(z + s * v)[number]))


def _reduced_stencil(reduced: OfFewUnknowns, z: Array, v: Array, number: int) -> dict[str, Any]:
    """Compare the exact derivative of W or F along a line with F or K."""
    claimed = np.atleast_1d(reduced.response(z)[number + 1] @ v)
    terms = np.array([weight * _reduced_along(reduced, z, v, number, s) for s, weight in STENCIL])
    return _relative(terms.sum(axis=0) - claimed, terms, "largest term of the stencil", DERIVATIVES)


def _reduced_taylor(reduced: OfFewUnknowns, z: Array, v: Array, number: int) -> dict[str, Any]:
    return taylor_order(
        partial(_reduced_along, reduced, z, 0.1 * v, number), 0.1 * np.atleast_1d(reduced.response(z)[number + 1] @ v)
    )


def _symmetry(reduced: OfFewUnknowns, z: Array) -> dict[str, Any]:
    K = np.asarray(reduced.response(z)[2])
    return _relative(K - K.T, K, "largest entry of K", "1e-12 allows for round-off")


def _relative(error: Array, truth: Array, words: str, reason: str) -> dict[str, Any]:
    return of_whole_body(float(np.abs(error).max()), float(np.abs(truth).max()), LIMIT, words, reason)
