"""How much simplices are compressed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..kernels import blocks as block_kernels
from ..kernels import stretches as stretch_kernels
from ..kernels.simplices import LANES
from ..kernels.threads import in_turn, run
from .arrays import OwnArrays


class Stretches(OwnArrays):
    """Smallest principal stretches: of tetrahedra in their three dimensions, of triangles in their two, of segments in their one."""

    def smallest_stretches(self, u: Array) -> NDArray[np.float64]:
        """(nt,) smallest principal stretch at `u` (nv, d), of the simplices in the order in which they came."""
        stretches, own = np.empty(len(self._elements)), np.empty(len(self._t) * LANES)
        self._smallest_stretch(u, own)
        stretches[self._elements] = own[: len(stretches)]
        return stretches

    def smallest_stretch(self, u: Array) -> float:
        """The smallest of `smallest_stretches(u)`, for one and a half times the price of F."""
        return self._smallest_stretch(u, np.empty(0))

    @in_turn
    def _smallest_stretch(self, u: Array, out: Array) -> float:
        block_kernels.gather(u, self.vertices, self._u)
        simplices = self._t.ravel(), self._X, self._u
        return min(run(stretch_kernels.smallest_stretches, self._forces.parts, *simplices, self.k, out))
