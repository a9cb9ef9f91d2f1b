"""Figure with the paths of the studies: computed states and reference curves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..statics.study import Study

#: Okabe and Ito's colours.
FOUND, CRITICAL = "#0072B2", "#D55E00"
#: Lines of the reference curves: style, colour, width.
TRUTH = (("-", "#AAAAAA", 3.5), ("--", "#333333", 1.2))


@dataclass(frozen=True)
class Curve:
    """Line or set of points `(x, y)`, with a name for the legend."""

    x: ArrayLike
    y: ArrayLike
    name: str


@dataclass(frozen=True)
class Panel:
    """Diagram of a path: reference curves as lines, computed states as markers, critical points as crosses."""

    title: str
    axes: tuple[str, str]
    truth: tuple[Curve, ...]
    found: tuple[Curve, ...]
    critical: Curve


@dataclass(frozen=True)
class DrawnStudy(Study):
    """Study with a function that creates its panel of the picture."""

    panel: Callable[[], Panel] | None = None


def draw(panels: Sequence[Panel], path: Path) -> Path:
    """Draw all panels, two in a row, and return the path of the picture."""
    rows = -(-len(panels) // 2)
    figure = Figure(figsize=(9, 3.6 * rows), layout="constrained")
    for axes, panel in zip(figure.subplots(rows, 2, squeeze=False).flat, panels, strict=False):
        _fill(axes, panel)
    for axes in figure.axes[len(panels) :]:
        axes.set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def _fill(axes: Axes, panel: Panel) -> None:
    for curve, (style, colour, width) in zip(panel.truth, TRUTH, strict=False):
        axes.plot(np.asarray(curve.x), np.asarray(curve.y), style, color=colour, lw=width, label=curve.name)
    for curve, style, size in zip(panel.found, (".", "+"), (6, 7), strict=False):
        axes.plot(np.asarray(curve.x), np.asarray(curve.y), style, color=FOUND, ms=size, label=curve.name)
    axes.plot(
        np.asarray(panel.critical.x), np.asarray(panel.critical.y), "x", color=CRITICAL, ms=8, mew=2, label=panel.critical.name
    )
    axes.axhline(0, color="black", lw=0.5)
    axes.set(title=panel.title, xlabel=panel.axes[0], ylabel=panel.axes[1])
    axes.grid(True, alpha=0.3)
    axes.legend(fontsize=7)
