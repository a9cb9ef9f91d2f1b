"""W, F and K against scikit-fem's standard assembly (and a candidate's against ours too), state by state."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, issparse

from ..case import Case
from ..judgement import as_a_whole, by_entry, by_vertex, largest_component, largest_rows
from ..players import Player
from ..tasks import NotApplicable, Task

REASON = "1e-12 is for round-off of two orders of summation, 1e-15 is usual"


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
    u = case.states[state]
    if quantity == "W":
        floor = case.energy_floor(reference)
        words = "W_ref" if truth >= floor else "K at rest x edge squared, median"
        return as_a_whole(abs(value - truth), max(truth, floor), case.lost_energy(reference, u), words, REASON)
    if quantity == "F":
        words = "largest |F_ref| around, or K at rest x edge"
        return by_vertex(case.mesh, value - truth, case.force_scale(reference, truth), case.lost_force(reference, u), words, REASON)
    return _matrix_difference(case, value, truth, case.lost_stiffness(reference, u))


def _matrix_difference(case: Case, K: Any, truth: csr_matrix, lost: csr_matrix) -> dict[str, Any]:
    if issparse(K):
        rows = np.maximum(largest_rows(truth, case.mesh.d), case.stiffness(case.reference))
        return by_entry(case.mesh, K - truth, rows, lost, "largest |K_ref| of the rows, now or at rest", REASON)
    signs = case.random("agreement").choice([-1.0, 1.0], size=(K.shape[1], 4))  # every entry of a row counts in its products
    error = np.max([np.abs(K @ v - truth @ v) for v in signs.T], axis=0)
    sums = largest_component(np.asarray(abs(truth).sum(axis=1)).ravel(), case.mesh.d)
    loss = case.mesh.d * np.asarray(lost.sum(axis=1)).ravel()
    return by_vertex(case.mesh, error, sums, loss, "products with random signs over the row sum of |K_ref|", REASON)
