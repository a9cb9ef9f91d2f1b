"""Errors of F and K against 50 digits: what the speed is shown against."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkWarning
from ..mesh import SimplexMesh
from ..mesh.geometry import vertex_sizes
from ..peers.peer import lame
from ..referee.checks.precision import patch
from ..referee.exact import exact_energy_and_force, exact_product
from ..system import System
from .case import POISSON, YOUNG, Case
from .others import peer_on, reference_on
from .results import OURS, REFERENCE, TEXTBOOK, Benchmark, ErrorOf
from .textbook import Textbook

STRAINS = (1e-3, 1e-6)


def compare_errors(results: Benchmark, case: Case) -> None:
    """All players on 64 tetrahedra from the middle of a mesh, strained at random without rotation.

    Displacements are such that single precision holds them exactly: what is measured is the computation.
    """
    piece = patch(case.mesh)
    noise = vertex_sizes(piece)[:, None] * np.random.default_rng(2).standard_normal((2, piece.nv, 3))
    constants = lame(YOUNG, POISSON)
    models = _models(results, case, piece)
    for strain in STRAINS:
        u, v = (strain * noise).astype(np.float32).astype(float).reshape(2, -1)
        _, F = exact_energy_and_force(piece.p, piece.t, *constants, u)
        Kv = exact_product(piece.p, piece.t, *constants, u, v)
        for (player, dtype), model in models.items():
            at = u.astype(dtype)
            results.errors.append(ErrorOf(player, dtype, "F", strain, _relative(model.internal_force(at), F)))
            if hasattr(model, "tangent"):
                product = model.tangent(at) @ v.astype(dtype)
                results.errors.append(ErrorOf(player, dtype, "K", strain, _relative(product, Kv)))


def _models(results: Benchmark, case: Case, piece: SimplexMesh) -> dict[tuple[str, str], Any]:
    """Every player that was timed, by name and precision."""
    models: dict[tuple[str, str], Any] = {(REFERENCE, "float64"): reference_on(piece)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # the patch may be in pieces
        for dtype in ("float64", "float32"):
            models[OURS, dtype] = System(piece, case.term, dtype=dtype)
            models[TEXTBOOK, dtype] = Textbook(piece, case.term, dtype)
    for name in dict.fromkeys(timing.player for timing in results.timings if timing.player in results.plan.peers):
        models[name, "float64"] = peer_on(name, piece)
    return models


def _relative(value: NDArray[Any], truth: NDArray[Any]) -> float:
    return float(np.abs(value - truth).max() / np.abs(truth).max())
