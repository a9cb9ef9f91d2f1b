"""Orders of convergence, and Richardson extrapolation of sequences of meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from skfem_stvk.referee.manufactured import fitted_order

__all__ = ["extrapolated", "fitted_order"]


def extrapolated(values: ArrayLike) -> float:
    """Return the repeated Richardson extrapolation of `values` on meshes with `h` halved each time.

    Errors in `h^2, h^4, ...` are eliminated one by one.

    >>> extrapolated([5 + 3, 5 + 3 / 4, 5 + 3 / 16])
    5.0
    >>> round(extrapolated([5 + 3 * h**2 - 7 * h**4 for h in (1, 1 / 2, 1 / 4)]), 12)
    5.0
    """
    v, power = np.asarray(values, dtype=np.float64), 4
    while len(v) > 1:
        v, power = v[1:] + (v[1:] - v[:-1]) / (power - 1), 4 * power
    return float(v[0])
