"""Check of round-off, and tables of errors and times.

Errors against 50-digit arithmetic are measured for small strains, large rotations and far from the origin, on a homogeneous
isotropic patch of the mesh. There are three forms: that of this package, the textbook's, and scikit-fem's. Only the form of this
package is checked.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from scipy.sparse import csr_matrix

from ...arguments import Array
from ...edges import EdgeForm
from ...mesh import ElementMesh
from ..bodies import Homogeneous, reference_on
from ..case import EPS, OURS, REFERENCE, STRETCH, Case, built, random_rotation
from ..discretisation import Discretisation, Shape, derivatives
from ..exact import ExactStVK
from ..implementations import METHODS, ContractViolation
from ..judgement import HIGHEST, LIMIT_BY_ASPECT
from ..reference import curved_elements
from ..reference.kinds import middles
from ..results import NotApplicable, Task

STRAINS = 10.0 ** -np.arange(1, 13)
OFFSETS = (0.0, 1e3, 1e6)
TEXTBOOK = "|p|^2 - |P|^2"
#: Number of points, and smallest number of elements, of the patch that is computed in 50 digits.
POINTS, FEWEST = 64, 8
LIMIT, LIMIT_ROTATED = 1e-13, 50 * EPS
REPETITIONS, SECONDS = 5, 1.0


def precision(case: Case) -> Iterator[Task]:
    """Yield the errors of this package's form without and with a rotation. The first measurement fills `case.precision`."""
    for degrees, state in ((0, "no rotation"), (170, "rotated by 170 deg")):
        yield Task("precision", case.ours, "F", state, "F", partial(_worst, case, degrees), against="50 digits")


def _worst(case: Case, degrees: int) -> dict[str, Any]:
    if degrees and case.mesh.d == 1:
        raise NotApplicable("a line cannot rotate")
    if not case.precision:
        case.precision += list(
            precision_table(case.shape, case.homogeneous, case.random("precision"), case.build)
        )  # as one list, so that an error does not leave a part of the table
    rows = [row for row in case.precision if row["form"] == OURS and row["rotation_deg"] == degrees]
    flat = min(LIMIT_BY_ASPECT * float(patch(case.shape).aspect.max()), HIGHEST)
    errors = np.array([row["error"] * (row["strain"] if degrees else 1.0) for row in rows])
    worst = rows[int(np.argmax(errors))]  # argmax selects a nan if there is one
    reason = "1e-13 allows for round-off at any strain and offset: 2 E_ij = q_i . h_j + h_i . Q_j has no cancellation"
    if degrees:
        reason = "50 eps/strain: rounding of the displacement of a rotated body limits every form"
    if flat > LIMIT:
        reason += f"; flat elements of the patch cost 20 eps x longest edge/height = {flat:.0e}"
    return {
        "measured": float(errors.max()),
        "limit": max(LIMIT_ROTATED if degrees else LIMIT, flat),
        "scale": "largest |F|" + (", times the strain" if degrees else ""),
        "reason": reason,
        "worst": {"at strain": worst["strain"], "offset [m]": worst["offset_m"]},
    }


def precision_table(
    shape: Shape, body: Homogeneous, rng: np.random.Generator, build: Callable[..., Any] = built
) -> Iterator[dict[str, Any]]:
    """Yield rows of form, rotation_deg, offset_m, strain and error on a patch of the mesh.

    The error is max |F - F_exact| / max |F_exact|.
    """
    piece, d = patch(shape), shape.mesh.d
    mesh, discretisation, sizes = piece.mesh, piece.discretisation, piece.node_size
    lowest = float(sizes.min() / piece.aspect.max())
    R = random_rotation(d, rng)
    noise = sizes * rng.standard_normal(mesh.p.shape)
    for offset in (offset for offset in OFFSETS if EPS * offset < 1e-4 * lowest):  # larger offsets flatten elements
        x = _representable(mesh.p, discretisation.kind, mesh.t, offset)
        p = x + offset
        forms = forms_on(ElementMesh(p, mesh.t, element=mesh.element), discretisation, body, build)
        exact = ExactStVK(p, mesh.t, body.lame, discretisation, np.broadcast_to(body.control(discretisation), mesh.nt))
        for degrees, Q in ((0, np.eye(d)), (170, R)):
            if degrees and d == 1:
                continue
            for strain in STRAINS.tolist():
                u = (Q @ (strain * noise) + (Q - np.eye(d)) @ x).T.ravel()
                truth = exact.internal_force(u)
                for form, force in forms.items():
                    error = relative_error(force(u), truth)
                    yield {"form": form, "rotation_deg": degrees, "offset_m": offset, "strain": strain, "error": error}


def _representable(p: Array, kind: str, t: NDArray[np.int32], offset: float) -> Array:
    """Return nearby coordinates that are not rounded when the offset is added, so that straight edges stay straight."""
    if not offset:
        return p
    grid, straight = 4 * np.spacing(offset + np.abs(p).max()), ~curved_elements(p, t, kind)
    snapped = np.round(p / grid) * grid
    for middle, (a, b) in middles(kind):
        ends = t[:, straight]
        snapped[:, ends[middle]] = (snapped[:, ends[a]] + snapped[:, ends[b]]) / 2
    return snapped


def patch(shape: Shape) -> Shape:
    """Return the elements nearest to the middle of the body, translated to the origin."""
    mesh = shape.mesh
    centres, count = mesh.p[:, mesh.t].mean(axis=1), max(FEWEST, POINTS // shape.measure.shape[1])
    near = np.sort(np.argsort(((centres.T - mesh.p.mean(axis=1)) ** 2).sum(axis=1), kind="stable")[:count])
    used, t = np.unique(mesh.t[:, near], return_inverse=True)
    p = mesh.p[:, used]
    own: NDArray[np.int32] = t.reshape(len(mesh.t), -1).astype(np.int32)
    return Shape(ElementMesh(p - p.mean(axis=1, keepdims=True), own, element=mesh.element), shape.discretisation)


def forms_on(
    mesh: ElementMesh, discretisation: Discretisation, body: Homogeneous, build: Callable[..., Any] = built
) -> dict[str, Callable[[Array], Array]]:
    """Return functions F(u) by name: this package's form, the textbook form and scikit-fem's."""
    forms: dict[str, Callable[[Array], Array]] = {OURS: build(mesh, [body.term], discretisation).internal_force}
    if mesh.element.is_linear_simplex:
        forms[TEXTBOOK] = Textbook(body.term.bind(mesh).form).internal_force
    elif not discretisation.is_one_point:
        forms[TEXTBOOK] = TextbookAtPoints(mesh, discretisation, body.lame).internal_force
    return forms | {
        REFERENCE: reference_on(mesh.p, mesh.t, body.tensor, discretisation, body.control(discretisation)).internal_force
    }


class Textbook:
    """F of the edge form with `zeta = |x_a - x_b|^2 - |X_a - X_b|^2` from positions, as in textbooks, all in one `dtype`."""

    def __init__(self, form: EdgeForm, dtype: DTypeLike = np.float64) -> None:
        ne, nv = form.edges.shape[1], form.p.shape[1]
        signs = np.tile([1, -1], ne).astype(dtype)
        self._differences = csr_matrix((signs, form.edges.T.ravel(), 2 * np.arange(ne + 1)), shape=(ne, nv))
        self._to_vertices = csr_matrix(self._differences.T)
        self._L = form.L.astype(dtype)
        self._X = form.p.T.astype(dtype)
        self._rest = self._squares(self._differences @ self._X)

    def internal_force(self, u: Array) -> Array:
        """Return the internal force (ndofs,) [N]."""
        p = self._differences @ (self._X + u.reshape(self._X.shape))
        tension = self._L @ (self._squares(p) - self._rest)
        return np.asarray(self._to_vertices @ (tension[:, None] * p)).ravel()

    @staticmethod
    def _squares(p: Array) -> Array:
        return np.asarray((p * p).sum(axis=1))


class TextbookAtPoints:
    """F of any elements from positions: `2 E_ij = x_,i . x_,j - X_,i . X_,j` in the oblique axes at each point."""

    def __init__(self, mesh: ElementMesh, discretisation: Discretisation, lame: tuple[float, float]) -> None:
        (xi, weights), (self._lam, self._mu) = discretisation.points, lame
        self._table, self._mesh = derivatives(discretisation.kind, xi).astype(float), mesh
        self._metric = self._squares(mesh.p.T)[1]
        self._inverse = np.linalg.inv(self._metric)
        self._weight = np.sqrt(np.linalg.det(self._metric)) * weights

    def internal_force(self, u: Array) -> Array:
        """Return the internal force (ndofs,) [N]."""
        base_vectors, now = self._squares(self._mesh.p.T + u.reshape(-1, self._mesh.d))
        mixed = self._inverse @ (now - self._metric)
        trace = np.trace(mixed, axis1=2, axis2=3)[..., None, None]
        stress = self._weight[..., None, None] * (self._lam / 2 * trace * self._inverse + self._mu * mixed @ self._inverse)
        force = np.zeros(self._mesh.p.T.shape)
        np.add.at(force, self._mesh.t, np.einsum("qai,tqij,tqjc->atc", self._table, stress, base_vectors, optimize=True))
        return force.ravel()

    def _squares(self, x: Array) -> tuple[Array, Array]:
        """Return the base vectors (nt, nq, k, d) for positions (nv, d), and their dot products (nt, nq, k, k)."""
        base_vectors = np.einsum("qai,atc->tqic", self._table, x[self._mesh.t])
        return base_vectors, base_vectors @ np.swapaxes(base_vectors, 2, 3)


def speed_table(case: Case) -> Iterator[dict[str, Any]]:
    """Yield rows of times and memory.

    Their keys are `player` (the name of the implementation), `quantity`, `method`, `ns_per_element` (best),
    `median_ns_per_element`, `ratio`, `peak_bytes_per_element` and `repetitions`. The ratio is the reference's best time over the
    implementation's. An implementation that lacks the method or raises has no row. The check of agreement reports it.
    """
    u = case.states[STRETCH]
    for quantity, method in METHODS.items():
        reference_best = None
        for implementation in [case.scikit_fem, *case.implementations]:
            if not implementation.has(quantity):
                continue
            call = partial(implementation.call, quantity, u)
            try:
                getattr(implementation, quantity)(u)  # raises ContractViolation if the result is invalid
                seconds, peak = _timed(call), _peak(call)
            except ContractViolation:
                continue
            best = min(seconds)
            reference_best = best if reference_best is None else reference_best
            yield {
                "player": implementation.name,
                "quantity": quantity,
                "method": method,
                "ns_per_element": 1e9 * best / case.mesh.nt,
                "median_ns_per_element": 1e9 * float(np.median(seconds)) / case.mesh.nt,
                "ratio": reference_best / best,
                "peak_bytes_per_element": peak / case.mesh.nt,
                "repetitions": len(seconds),
            }


def _timed(call: Callable[[], Any]) -> list[float]:
    """Return the seconds of each repetition, after a first call that is not counted."""
    call()
    seconds: list[float] = []
    while len(seconds) < REPETITIONS or (sum(seconds) < SECONDS / 10 and len(seconds) < 100):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
        if sum(seconds) > SECONDS and len(seconds) >= 2:
            break
    return seconds


def _peak(call: Callable[[], Any]) -> int:
    """Return the peak of the memory that NumPy and Python allocated during the call [bytes]."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def error_table(case: Case) -> dict[str, dict[str, float]]:
    """Return errors of W, F and K v against 50 digits on a patch of the body, strained by 0.1 %. Plots show speed against these."""
    piece, body, discretisation = patch(case.shape), case.homogeneous, case.discretisation
    mesh, control = piece.mesh, body.control(discretisation)
    ours = built(mesh, [body.term], discretisation)
    reference = reference_on(mesh.p, mesh.t, body.tensor, discretisation, control)
    noise = 1e-3 * piece.node_size[:, None] * case.random("speed").standard_normal((2, mesh.nv, mesh.d))
    u, v = noise.reshape(2, -1)
    exact = ExactStVK(mesh.p, mesh.t, body.lame, discretisation, np.broadcast_to(control, mesh.nt))
    (W, F), Kv = exact.energy_and_force(u), exact.product(u, v)
    errors = {
        name: {
            "W": abs(model.energy(u) - W) / W,
            "F": relative_error(model.internal_force(u), F),
            "K": relative_error(model.tangent(u) @ v, Kv),
        }
        for name, model in ((OURS, ours), (REFERENCE, reference))
    }
    textbook = forms_on(mesh, discretisation, body).get(TEXTBOOK)
    return errors if textbook is None else errors | {TEXTBOOK: {"F": relative_error(textbook(u), F)}}


def relative_error(value: Array, truth: Array) -> float:
    """Return the largest error of an entry, relative to the largest entry."""
    return float(np.abs(value - truth).max() / np.abs(truth).max())
