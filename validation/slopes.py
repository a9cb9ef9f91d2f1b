"""Reference slopes of pictures with two logarithmic axes."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def draw_slope(axes: Any, x: ArrayLike, y: ArrayLike, exponent: Fraction | int, name: str = "time", below: float = 0.5) -> None:
    """Draw a dotted line `name^exponent` below the points (x, y), from the first to the last of them, and label it.

    `below` is the factor from the first point to the line, which is above the points if it is larger than 1.
    """
    known = np.isfinite(np.asarray(x, dtype=float) * np.asarray(y, dtype=float))
    if known.sum() < 2:
        return
    times, errors = np.asarray(x, dtype=float)[known], np.asarray(y, dtype=float)[known]
    first, last = times.min(), times.max()
    start = below * errors[times.argmin()]
    end = start * (last / first) ** float(exponent)
    axes.plot([first, last], [start, end], ":", color="#444444", lw=1.2)
    position, va, ha = ((last, end), "top", "center") if below < 1 else ((first, start), "bottom", "left")
    axes.annotate(f"{name}$^{{{exponent}}}$", position, va=va, ha=ha, fontsize=9)
