"""Round-off and speed: errors against 50-digit arithmetic, for small strains, large rotations and far from the origin, and times.

Errors are measured on a homogeneous isotropic patch of the mesh, for three forms: ours, the textbook's, and scikit-fem's. Ours is
judged.
"""

from __future__ import annotations

import time
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike
from scipy.sparse import csr_matrix

from ...arguments import Array
from ...edges import Assembly, EdgeForm
from ...errors import StvkWarning
from ...mesh import ElementMesh
from ...mesh.geometry import aspect_ratios, vertex_sizes
from ...reference import ReferenceStVK
from ...system import System
from ..bodies import Homogeneous
from ..case import EPS, OURS, REFERENCE, STRETCH, Case, random_rotation
from ..exact import ExactStVK
from ..judgement import HIGHEST
from ..players import METHODS, Foul
from ..results import NotApplicable, Task

STRAINS = 10.0 ** -np.arange(1, 13)
OFFSETS = (0.0, 1e3, 1e6)
TEXTBOOK = "|p|^2 - |P|^2"
ELEMENTS = 64
LIMIT, LIMIT_ROTATED = 1e-13, 50 * EPS
REPETITIONS, SECONDS = 5, 1.0


def precision(case: Case) -> Iterator[Task]:
    """Errors of our form without and with a rotation; the table is filled when the first is measured."""
    for degrees, state in ((0, "no rotation"), (170, "rotated by 170 deg")):
        yield Task("precision", case.ours, "F", state, "F", partial(_worst, case, degrees), against="50 digits")


def _worst(case: Case, degrees: int) -> dict[str, Any]:
    if degrees and case.mesh.d == 1:
        raise NotApplicable("a line cannot turn")
    if not case.precision:
        case.precision += list(precision_table(case.mesh, case.homogeneous, case.random("precision")))  # all of it or nothing
    rows = [row for row in case.precision if row["form"] == OURS and row["rotation_deg"] == degrees]
    flatness = float(aspect_ratios(patch(case.mesh)).max()) ** 2
    errors = np.array([row["error"] * (row["strain"] if degrees else 1.0) for row in rows])
    worst = rows[int(np.argmax(errors))]  # not a number counts as the largest
    reason = "1e-13 is for round-off, whatever the strain and the offset: zeta = (P + p) . U has no cancellation"
    if degrees:
        reason = "50 eps/strain: a rotated body's displacement leaves no more to any form"
    if 10 * EPS * flatness > LIMIT:
        reason += f"; flat elements of the patch cost 10 eps x (longest edge/height)^2 = {10 * EPS * flatness:.0e}"
    return {
        "measured": float(errors.max()),
        "limit": max(LIMIT_ROTATED if degrees else LIMIT, min(10 * EPS * flatness, HIGHEST)),
        "scale": "largest |F|" + (", times the strain" if degrees else ""),
        "reason": reason,
        "worst": {"at strain": worst["strain"], "offset [m]": worst["offset_m"]},
    }


def precision_table(mesh: ElementMesh, body: Homogeneous, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """Rows form, rotation_deg, offset_m, strain, error: max |F - F_exact| / max |F_exact| on a patch of the mesh."""
    piece = patch(mesh)
    sizes = vertex_sizes(piece)
    lowest = float(sizes.min() / aspect_ratios(piece).max())
    turn = random_rotation(mesh.d, rng)
    noise = sizes * rng.standard_normal(piece.p.shape)
    for offset in (offset for offset in OFFSETS if EPS * offset < 1e-4 * lowest):  # beyond, the offset itself flattens elements
        p = piece.p + offset
        forms, exact = forms_on(ElementMesh(p, piece.t), body), ExactStVK(p, piece.t, body.lame)
        for degrees, Q in ((0, np.eye(mesh.d)), (170, turn)):
            if degrees and mesh.d == 1:
                continue
            for strain in STRAINS.tolist():
                u = (Q @ (strain * noise) + (Q - np.eye(mesh.d)) @ piece.p).T.ravel()
                truth = exact.internal_force(u)
                for form, force in forms.items():
                    error = relative_error(force(u), truth)
                    yield {"form": form, "rotation_deg": degrees, "offset_m": offset, "strain": strain, "error": error}


def patch(mesh: ElementMesh) -> ElementMesh:
    """The elements nearest to the middle of the body, as a mesh about the origin."""
    centres = mesh.p[:, mesh.t].mean(axis=1)
    near = np.argsort(((centres.T - mesh.p.mean(axis=1)) ** 2).sum(axis=1), kind="stable")[:ELEMENTS]
    used, t = np.unique(mesh.t[:, near], return_inverse=True)
    p = mesh.p[:, used]
    return ElementMesh(p - p.mean(axis=1, keepdims=True), t.reshape(len(mesh.t), -1).astype(np.int32))


def forms_on(mesh: ElementMesh, body: Homogeneous) -> dict[str, Callable[[Array], Array]]:
    """F(u) by name: our form, the textbook form and scikit-fem's."""
    assembly = body.term.bind(mesh)
    return {
        OURS: partial(edge_force, assembly),
        TEXTBOOK: Textbook(assembly.form).internal_force,
        REFERENCE: ReferenceStVK(mesh.p, mesh.t, body.tensor).internal_force,
    }


def edge_force(assembly: Assembly, u: Array) -> Array:
    """F of our form."""
    force = np.zeros(assembly.form.p.T.shape)
    assembly.energy_and_force(u.reshape(force.shape), force)
    return force.ravel()


class Textbook:
    """F of the edge form with `zeta = |x_a - x_b|^2 - |X_a - X_b|^2` from positions, as textbooks write it, all in one `dtype`."""

    def __init__(self, form: EdgeForm, dtype: DTypeLike = np.float64) -> None:
        ne, nv = form.edges.shape[1], form.p.shape[1]
        signs = np.tile([1, -1], ne).astype(dtype)
        self._differences = csr_matrix((signs, form.edges.T.ravel(), 2 * np.arange(ne + 1)), shape=(ne, nv))
        self._to_vertices = csr_matrix(self._differences.T)
        self._L = form.L.astype(dtype)
        self._X = form.p.T.astype(dtype)
        self._rest = self._squares(self._differences @ self._X)

    def internal_force(self, u: Array) -> Array:
        """Internal force (ndofs,) [N]."""
        p = self._differences @ (self._X + u.reshape(self._X.shape))
        tension = self._L @ (self._squares(p) - self._rest)
        return np.asarray(self._to_vertices @ (tension[:, None] * p)).ravel()

    @staticmethod
    def _squares(p: Array) -> Array:
        return np.asarray((p * p).sum(axis=1))


def speed_table(case: Case) -> Iterator[dict[str, Any]]:
    """Rows player, quantity, ns_per_element (best), median_ns_per_element, ratio to the reference's best, peak_bytes_per_element.

    A player that lacks the method or raises has no row, as the check of agreement says.
    """
    u = case.states[STRETCH]
    for quantity, method in METHODS.items():
        reference_best = None
        for player in [case.scikit_fem, *case.players]:
            if not player.has(quantity):
                continue
            call = partial(player.call, quantity, u)
            try:
                getattr(player, quantity)(u)  # what it returns can be used
                seconds, peak = _timed(call), _peak(call)
            except Foul:
                continue
            best = min(seconds)
            reference_best = best if reference_best is None else reference_best
            yield {
                "player": player.name,
                "quantity": quantity,
                "method": method,
                "ns_per_element": 1e9 * best / case.mesh.nt,
                "median_ns_per_element": 1e9 * float(np.median(seconds)) / case.mesh.nt,
                "ratio": reference_best / best,
                "peak_bytes_per_element": peak / case.mesh.nt,
                "repetitions": len(seconds),
            }


def _timed(call: Callable[[], Any]) -> list[float]:
    """Seconds of each repetition, after one that is not counted."""
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
    """Most bytes that NumPy and Python held during the call beyond what they held before."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def error_table(case: Case) -> dict[str, dict[str, float]]:
    """Errors of W, F and K v against 50 digits on a patch of the body, strained by 0.1 %: what the speed is shown against."""
    piece, body = patch(case.mesh), case.homogeneous
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # the patch may be in pieces
        ours = System(piece, body.term)
    reference = ReferenceStVK(piece.p, piece.t, body.tensor)
    noise = 1e-3 * vertex_sizes(piece)[:, None] * case.random("speed").standard_normal((2, piece.nv, piece.d))
    u, v = noise.reshape(2, -1)
    exact = ExactStVK(piece.p, piece.t, body.lame)
    (W, F), Kv = exact.energy_and_force(u), exact.product(u, v)
    errors = {
        name: {
            "W": abs(model.energy(u) - W) / W,
            "F": relative_error(model.internal_force(u), F),
            "K": relative_error(model.tangent(u) @ v, Kv),
        }
        for name, model in ((OURS, ours), (REFERENCE, reference))
    }
    return errors | {TEXTBOOK: {"F": relative_error(forms_on(piece, body)[TEXTBOOK](u), F)}}


def relative_error(value: Array, truth: Array) -> float:
    """Largest error of an entry, relative to the largest entry."""
    return float(np.abs(value - truth).max() / np.abs(truth).max())
