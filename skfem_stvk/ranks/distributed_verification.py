"""Verification of a body on ranks: `verify` on rank 0, with W, F and K of all ranks."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from ..arguments import Array
from ..errors import StateError, StvkError
from ..referee.report import Report
from ..referee.verification import verify
from ..system import System
from .divided_mesh import gathered

#: Largest number of elements that rank 0 assembles.
MOST_VERIFIED = 200_000


def verify_on_ranks(system: System, mesh: Any, material: Any, **options: Any) -> Report | None:
    """Check W, F and K of a body on ranks, gathered on rank 0, against this package and scikit-fem on one machine.

    All ranks call this function together. Example: `verify_on_ranks(System(distribute(mesh), law), mesh, law)`.

    Parameters
    ----------
    system
        The body on ranks, with elastic terms alone.
    mesh, material, options
        The whole mesh, its material and other arguments of `verify`, which rank 0 alone uses. `candidate` is the body on ranks.

    Returns
    -------
    Report or None
        The report of `verify` on rank 0, None on other ranks.

    Raises
    ------
    StvkError
        if the mesh has more than 200 000 elements, or as in `verify`.
    """
    space, count = system.space, int(system.space.comm.total(float(system.mesh.nt)))
    if count > MOST_VERIFIED:
        raise StvkError(
            f"The mesh has {count} elements; expected at most {MOST_VERIFIED}: rank 0 gathers K and assembles it again. Verify the "
            "same model on a coarser mesh."
        )
    if space.comm.leads:
        try:
            return verify(mesh, material, candidate=_OfAllRanks(system), **options)
        finally:
            space.comm.broadcast(None)
    while (request := space.comm.broadcast(None)) is not None:
        with suppress(StateError):  # which all ranks raise
            _evaluated(system, *request)
    return None


class _OfAllRanks:
    """Candidate of `verify` on rank 0; other ranks evaluate each call together with it."""

    def __init__(self, system: System) -> None:
        self._system = system

    def energy(self, u: Array) -> float:
        return float(self._of_all("energy", u))

    def internal_force(self, u: Array) -> Array:
        return np.asarray(self._of_all("internal_force", u))

    def tangent(self, u: Array) -> csr_matrix:
        return self._of_all("tangent", u)

    def _of_all(self, name: str, u: Array) -> Any:
        self._system.space.comm.broadcast((name, u))
        return _evaluated(self._system, name, u)


def _evaluated(system: System, name: str, u: Array) -> Any:
    """Return W, F or K of the whole body at `u` (ndofs,) on rank 0, in the order of the user's mesh."""
    space = system.space
    found = getattr(system, name)(u[space.numbers])
    if name == "energy":
        return found
    if name == "internal_force":
        return gathered(space, found)
    K = found.tocoo()
    parts = space.comm.collect((space.numbers[K.row], space.numbers[K.col], K.data)) or [(K.row[:0], K.col[:0], K.data[:0])]
    rows, columns, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return csr_matrix((values, (rows, columns)), shape=(space.count, space.count))
