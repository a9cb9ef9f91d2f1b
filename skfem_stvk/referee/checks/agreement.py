"""W, F and K against scikit-fem's standard assembly (and a candidate's against ours too), state by state."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, issparse

from ..case import Case
from ..places import worst_places
from ..players import Player
from ..tasks import NotApplicable, Task

REASON = (
    "round-off of two orders of summation: 1e-15 is usual. Above 1e-12 only on meshes whose shape costs more: 10 eps x (longest "
    "edge/height)^2, or 20 eps x body size/shortest edge"
)


def agreement(case: Case) -> Iterator[Task]:
    """Every player against every reference that it must agree with, in every state."""
    pairs = [(case.ours, case.reference)]
    if case.candidate is not None:
        pairs += [(case.candidate, case.reference), (case.candidate, case.ours)]
    for state in case.states:
        for quantity in "WFK":
            for player, reference in pairs:
                measure = partial(_difference, case, player, reference, quantity, state)
                yield Task("agreement", player, quantity, state, quantity, measure, against=reference.name)


def _difference(case: Case, player: Player, reference: Player, quantity: str, state: str) -> dict[str, Any]:
    if not case.is_stvk(player):
        raise NotApplicable("the candidate does not claim to be St. Venant-Kirchhoff")
    truth, value = case.value(reference, quantity, state), case.value(player, quantity, state)
    if quantity == "K":
        return _matrix_difference(case, value, truth)
    limit = case.limit()
    error = np.atleast_1d(np.abs(np.subtract(value, truth)))
    scale, words = case.scale(quantity, float(np.max(np.abs(truth))), case.reference)
    worst = worst_places(case.mesh, error, limit * scale) if quantity == "F" else {}
    return _judgement(error.max() / scale, limit, scale, words, worst)


def _matrix_difference(case: Case, K: Any, truth: csr_matrix) -> dict[str, Any]:
    limit = case.limit()
    if issparse(K):
        difference = abs(K - truth).tocoo()
        scale, words = case.scale("K", float(abs(truth).max()), case.reference)
        rows = difference.max(axis=1).toarray().ravel()
    else:  # a LinearOperator: every entry of a row counts in its products with random signs
        signs = case.random("agreement").choice([-1.0, 1.0], size=(K.shape[1], 4))
        rows = np.max([np.abs(K @ v - truth @ v) for v in signs.T], axis=0)
        scale, words = float(abs(truth).sum(axis=1).max()), "largest row sum of |K_ref|, products with random signs"
    worst = worst_places(case.mesh, rows, limit * scale)
    if issparse(K) and difference.nnz:
        entry = int(np.argmax(np.where(np.isfinite(difference.data), difference.data, np.inf)))
        worst["entry"] = [int(difference.row[entry]), int(difference.col[entry])]
    return _judgement(rows.max() / scale, limit, scale, words, worst)


def _judgement(measured: float, limit: float, scale: float, words: str, worst: dict[str, Any]) -> dict[str, Any]:
    return {"measured": measured, "limit": limit, "scale": f"{scale:.3e} ({words})", "reason": REASON, "worst": worst}
