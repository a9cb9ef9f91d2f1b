"""What a peer is."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array


class Peer(Protocol):
    """An isotropic St. Venant-Kirchhoff body of tetrahedra in another code.

    Parameters
    ----------
    p : (3, nv) coordinates [m].
    t : (4, nt) vertices of the tetrahedra, of either orientation.
    young, poisson : constants of the material [Pa, -], the same everywhere.

    A peer has those of `energy(u) -> float` [J], `internal_force(u) -> (3 nv,)` = dW/du [N] and `tangent(u) -> csr_matrix` [N/m] that
    its code can compute, for `u` (3 nv,) [m] with the degree of freedom `3 * vertex + component`. All that does not depend on `u` is
    done when the peer is made, so that the time of a call is the other code's own.

    Attributes
    ----------
    name, version : of the code.

    Raises
    ------
    StvkError
        if the code is not installed or too old, with the line that installs it.
    """

    name: str
    version: str

    def __init__(self, p: Array, t: NDArray[np.int32], young: float, poisson: float) -> None: ...


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Lame's constants `lambda = E nu / ((1 + nu) (1 - 2 nu))` and `mu = E / (2 (1 + nu))` [Pa].

    >>> lame(2.5, 0.25)
    (1.0, 1.0)
    """
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))
