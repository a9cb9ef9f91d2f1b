"""How the volumes of simplices change, with their sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..kernels import blocks as block_kernels
from ..kernels import volumes as volume_kernels
from ..kernels.simplices import LANES
from ..kernels.threads import in_turn, run
from .arrays import OwnArrays


class Volumes(OwnArrays):
    """Ratios of volumes now to those at rest: below zero where a simplex is inside out, whichever way round its vertices are numbered.

    Of triangles in space, and of segments in more than one dimension, the ratios of areas and lengths, which have no sign.
    """

    @in_turn
    def volume_ratios(self, u: Array) -> NDArray[np.float64]:
        """(nt,) ratios at `u` (nv, d), of the simplices in the order in which they came."""
        block_kernels.gather(u, self.vertices, self._u)
        return self._volume_ratios()

    @in_turn
    def smallest_volume_ratio(self, u: Array) -> float:
        """The smallest of `volume_ratios(u)`, for half the price of F."""
        block_kernels.gather(u, self.vertices, self._u)
        return self._smallest_volume_ratio(np.empty(0))

    def _volume_ratios(self) -> NDArray[np.float64]:
        """At the displacements that were gathered last."""
        ratios, own = np.empty(len(self._elements)), np.empty(len(self._t) * LANES)
        self._smallest_volume_ratio(own)
        ratios[self._elements] = own[: len(ratios)]
        return ratios

    def _smallest_volume_ratio(self, out: Array) -> float:
        simplices = self._t.ravel(), self._X, self._u
        return min(run(volume_kernels.volume_ratios, self._forces.parts, *simplices, self.k, self.d, out))

    @in_turn
    def step_limit(self, u: Array, v: Array) -> float:
        """The smallest `s > 0` at which a simplex that is right side out at `u` has no volume left at `u + s v`, both (nv, d); or infinity."""
        if self.k < self.d:
            return np.inf
        block_kernels.gather(u, self.vertices, self._u)
        V = self._gathered("direction", v, np.float64)
        return min(run(volume_kernels.step_limit, self._forces.parts, self._t.ravel(), self._X, self._u, V, self.k))
