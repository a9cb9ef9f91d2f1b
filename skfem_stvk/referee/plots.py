"""Pictures of a report. This module imports matplotlib, so it is imported only when needed."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .case import OURS, REFERENCE
from .checks.precision import TEXTBOOK

COLOURS = {OURS: "#0072B2", REFERENCE: "#D55E00", TEXTBOOK: "#009E73"}
Row = dict[str, Any]
MARKERS = {"W": "s", "F": "o", "K": "^"}


def error_against_strain(precision: Sequence[Row]) -> Figure:
    """Return the plot of the error of F against strain, without and with a large rotation, at the origin and far from it."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, 2, sharey=True))
    styles = dict(zip(sorted({row["offset_m"] for row in precision}), ("-", "--", ":"), strict=False))
    for axes, degrees in zip(panels, (0, 170), strict=True):
        for form, colour in COLOURS.items():
            for offset, style in styles.items():
                rows = [r for r in precision if (r["form"], r["rotation_deg"], r["offset_m"]) == (form, degrees, offset)]
                label = f"{form}, at {offset:g} m"
                axes.loglog([r["strain"] for r in rows], [max(r["error"], 1e-17) for r in rows], style, color=colour, label=label)
        strains = sorted({row["strain"] for row in precision})
        axes.loglog(strains, [1e-17 / strain for strain in strains], lw=0.8, color="#888888", label="strain$^{-1}$")
        axes.set(xlabel="strain", ylim=(1e-18, 100))
        axes.set_title("no rotation" if not degrees else f"rotated by {degrees} degrees", fontsize=9)
        axes.tick_params(labelsize=9)
        axes.invert_xaxis()
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("error of F, relative to 50 digits")
    if precision:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=9, frameon=False)
    return figure


def speed_against_error(speed: Sequence[Row], errors: Mapping[str, Mapping[str, float]]) -> Figure:
    """Return the plot of the time of W, F and K against their errors. Points at the lower left are better."""
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    for row in speed:
        error = errors.get(row["player"], {}).get(row["quantity"])
        if error is None:
            continue
        style = {"marker": MARKERS[row["quantity"]], "color": COLOURS[row["player"]], "ms": 8, "linestyle": ""}
        axes.loglog(row["ns_per_element"], max(error, 1e-17), label=f"{row['quantity']}, {row['player']}", **style)
    axes.set(xlabel="time [ns per element]", ylabel="error at 0.1 % strain, relative to 50 digits")
    axes.grid(alpha=0.3)
    axes.margins(0.2)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    return figure


def as_svg(figure: Figure) -> str:
    """Return the figure as SVG text."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]
