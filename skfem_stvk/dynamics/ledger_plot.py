"""A ledger's picture. Matplotlib is imported here, so this module is imported only when a picture is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ..arguments import Array
from ..results.matplotlib_plot import new_figure
from .ledger import Ledger

#: Okabe and Ito's colours, which colour-blind readers can tell apart.
ENERGIES = {
    "kinetic_energy": "#D55E00",
    "strain_energy": "#E69F00",
    "potential_energy": "#0072B2",
    "external_work": "#009E73",
    "dissipated_work": "#CC79A7",
    "total_energy": "#000000",
}
AXES = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
MOMENTA = {"linear_momentum": "linear\nmomentum [kg m/s]", "angular_momentum": "angular\nmomentum [kg m²/s]"}
#: A line has no more points than that: two for each of the pixels it goes through.
MOST_POINTS = 4000
Lines = list[tuple[str, str, str]]


class Panel(NamedTuple):
    """Lines over time: the columns with their words and colours, and the panel's height over that of the least."""

    label: str
    lines: Lines
    height: float


def draw(ledger: Ledger, path: Path | None) -> Figure:
    """The figure; written to `path` if there is one, else known to pyplot, which can show it."""
    panels = [panel for panel in _panels(ledger) if panel.lines]
    figure = new_figure((7.5, 1.2 * sum(panel.height for panel in panels) + 0.8), interactive=path is None)
    heights = [panel.height for panel in panels]
    rows: list[Any] = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
    for axes, panel in zip(rows, panels, strict=True):
        _fill(axes, panel, ledger)
    rows[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    if path is not None:
        figure.savefig(path, dpi=160)
    return figure


def _panels(ledger: Ledger) -> list[Panel]:
    """What there is to draw: energies that are not zero throughout, the closure error, momenta, displacements of probes, and reactions."""
    energies = [
        (name, name.replace("_", " "), colour) for name, colour in ENERGIES.items() if name in ledger and ledger[name].any()
    ]
    panels = [
        Panel("energy [J]", energies, 2.6),
        Panel("closure\nerror [J]", [(name, "", "#000000") for name in ledger if name == "closure_error"], 1.0),
    ]
    for quantity, label in MOMENTA.items():
        panels.append(Panel(label, _along_axes(ledger, f"{quantity}_"), 1.2))
    probes = dict.fromkeys(name[:-2] for name in ledger if name[-2:] in (" x", " y", " z"))
    for probe in probes:
        label = f"{probe} [N]" if probe.startswith("reaction ") else f"displacement\nof {probe} [m]"
        panels.append(Panel(label, _along_axes(ledger, f"{probe} "), 1.2))
    return panels


def _along_axes(ledger: Ledger, prefix: str) -> Lines:
    return [(prefix + axis, axis, colour) for axis, colour in AXES.items() if prefix + axis in ledger]


def _fill(axes: Any, panel: Panel, ledger: Ledger) -> None:
    for name, words, colour in panel.lines:
        total = name == "total_energy"
        axes.plot(*_thinned(ledger["time"], ledger[name]), color=colour, lw=1.6 if total else 1.0, label=words)
    axes.set_ylabel(panel.label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.axhline(0, color="#c8c8c8", lw=0.6, zorder=0)
    if any(words for _, words, _ in panel.lines):
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """Points that draw the same line: of each of many short stretches the least and the largest value."""
    if len(t) <= MOST_POINTS:
        return t, values
    edges = np.linspace(0, len(t), MOST_POINTS // 2 + 1).astype(np.int64)
    least, largest = (find.reduceat(values, edges[:-1]) for find in (np.minimum, np.maximum))
    return np.repeat(t[edges[:-1]], 2), np.column_stack([least, largest]).ravel()
