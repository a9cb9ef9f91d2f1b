"""Pictures of a run. This module imports matplotlib, so import it only to draw."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from .results import CONTROL, CSR, OURS, REFERENCE, TEXTBOOK, Benchmark, Timing

COLOURS = {  # Okabe and Ito's palette, suitable for colour-blind readers
    OURS: "#0072B2",
    REFERENCE: "#D55E00",
    TEXTBOOK: "#009E73",
    CONTROL: "#000000",
    CSR: "#999999",
    "MuJoCo": "#CC79A7",
    "FElupe": "#E69F00",
    "NGSolve": "#56B4E9",
    "DOLFINx": "#8A6D00",
}
FLOOR = 1e-17
OFFSETS = (7, -7, 17, -17, 27, -27)  # vertical offsets of the names from their points [points]
Point = tuple[float, float, str, str]  # time, error, implementation, type
PANELS = (("F", 1e-3), ("F", 1e-6), ("K", 1e-3))


def speed_against_error(results: Benchmark) -> Figure:
    """Draw errors of F at two strains and of K against the time of a call, on the mesh with most timed implementations."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(PANELS), sharey=True))
    mesh, shown = _mesh_of_most(results), []
    for axes, (quantity, strain) in zip(panels, PANELS, strict=True):
        points: list[Point] = []
        for e in results.errors:
            if (e.quantity, e.strain) == (quantity, strain) and mesh:
                time = results.best(mesh, e.implementation, quantity, dtype=e.dtype)
                if time is not None:
                    points.append((time, max(e.error, FLOOR), e.implementation, e.dtype))
        _scatter(axes, points)
        _finish(axes, "ns per tetrahedron", f"{quantity}, strain {strain:.0e}")
        shown.append(points)
    panels[0].set_ylabel("error, relative to 50 digits")
    figure.suptitle(f"{mesh}: filled in double precision, open in single; down and to the left is better", fontsize=10)
    for axes in panels:
        if axes.has_data():
            axes.margins(0.22)
    figure.draw_without_rendering()  # sets the positions of the points
    for axes, points in zip(panels, shown, strict=True):
        _name(axes, points)
    return figure


def _scatter(axes: Axes, points: list[Point]) -> None:
    for time, error, implementation, dtype in points:
        colour, double = COLOURS.get(implementation, "#444444"), dtype == "float64"
        marker, fill = ("o", colour) if double else ("s", "white")
        axes.plot([time], [error], marker, ms=8, mec=colour, mfc=fill, mew=1.8)


def _finish(axes: Axes, xlabel: str, title: str) -> None:
    """Add labels and a grid; set logarithmic axes if there are points."""
    axes.set(xlabel=xlabel, title=title)
    axes.grid(alpha=0.3)
    if axes.has_data():
        axes.set(xscale="log", yscale="log")


def _name(axes: Axes, points: list[Point]) -> None:
    """Write the names of the implementations above or below their points, at the nearest free position."""
    positions = axes.transData.transform(np.array([point[:2] for point in points]).reshape(len(points), 2))
    taken = [Bbox.from_extents(x - 5, y - 5, x + 5, y + 5) for x, y in positions]
    for time, error, implementation, _ in sorted(points):
        for away in OFFSETS:
            name = axes.annotate(implementation, (time, error), (0, away), textcoords="offset points", ha="center", fontsize=8)
            name.set(va="bottom" if away > 0 else "top", color=COLOURS.get(implementation, "#444444"))
            extent = name.get_window_extent().padded(2, 0)
            if away == OFFSETS[-1] or not any(extent.overlaps(other) for other in taken):
                taken.append(extent)
                break
            name.remove()


def _mesh_of_most(results: Benchmark) -> str:
    """Return the box with the most timed implementations; among equals, the largest box."""
    boxes = {mesh: facts["nt"] for mesh, facts in results.meshes.items() if mesh.startswith("box")}
    implementations = {mesh: len({t.implementation for t in results.timings if t.mesh == mesh}) for mesh in boxes}
    return max(boxes, key=lambda mesh: (implementations[mesh], boxes[mesh]), default="")


def time_against_size(results: Benchmark) -> Figure:
    """Draw the times of F and K per tetrahedron: boxes as lines, parts as open markers."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, 2, sharey=True))
    for axes, quantity, title in zip(panels, ("F", "K"), ("internal force F", "tangent stiffness K"), strict=True):
        for implementation, colour in COLOURS.items():
            shown = "K v" if implementation == CSR else quantity
            for dtype in ("float64", "float32") if implementation == OURS else ("float64",):
                timings = [
                    t
                    for t in results.timings
                    if (t.implementation, t.quantity, t.threads, t.dtype) == (implementation, shown, 1, dtype)
                ]
                _line(axes, timings, colour, implementation if dtype == "float64" else f"{implementation}, float32")
        _finish(axes, "tetrahedra", title)
    panels[0].set_ylabel("ns per tetrahedron, one thread")
    if any(name.startswith("part") for name in results.meshes):
        figure.suptitle("lines: boxes; diamonds: a part meshed by Gmsh", fontsize=10)
    handles = dict(zip(*reversed(panels[1].get_legend_handles_labels()), strict=True))
    handles |= dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside right center", fontsize=8)
    return figure


def _line(axes: Axes, timings: list[Timing], colour: str, label: str) -> None:
    """Draw the times of one implementation in one precision.

    Single precision is a dashed line without parts.
    """
    boxes, parts = ([t for t in timings if t.mesh.startswith(kind)] for kind in ("box", "part"))
    single = "float32" in {t.dtype for t in timings}
    if boxes:
        style = "--" if single else "-"
        axes.plot([t.nt for t in boxes], [t.best for t in boxes], style, marker="o", ms=4, color=colour, label=label)
    if parts and not single:
        label = "" if boxes else label
        axes.plot([t.nt for t in parts], [t.best for t in parts], "D", ms=6, mfc="none", color=colour, label=label)
