"""Pictures of a run. This module imports matplotlib, so import it only to draw."""

from __future__ import annotations

from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skfem_stvk.about import write_machine

from .results import CONTROL, CSR, OURS, REFERENCE, TEXTBOOK, Benchmark, Timing

#: Colours of Okabe and Ito, and markers.
STYLES = {
    OURS: ("#0072B2", "o"),
    REFERENCE: ("#D55E00", "s"),
    TEXTBOOK: ("#009E73", "^"),
    CONTROL: ("#000000", "v"),
    CSR: ("#999999", "P"),
    "MuJoCo": ("#CC79A7", "D"),
    "FElupe": ("#E69F00", "X"),
    "NGSolve": ("#56B4E9", "p"),
    "DOLFINx": ("#8A6D00", "*"),
}
OTHER = ("#444444", "h")
FLOOR = 1e-17
PANELS = (("F", 1e-3), ("F", 1e-6), ("K", 1e-3))


def speed_against_error(results: Benchmark) -> Figure:
    """Draw errors of F at two strains and of K against the time of a call, on the mesh with most timed implementations."""
    figure = Figure(figsize=(6.8, 3.8), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(PANELS), sharey=True))
    mesh = _mesh_of_most(results)
    for axes, (quantity, strain) in zip(panels, PANELS, strict=True):
        for e in results.errors:
            if (e.quantity, e.strain) == (quantity, strain) and mesh:
                time = results.best(mesh, e.implementation, quantity, dtype=e.dtype)
                if time is not None:
                    colour, marker = STYLES.get(e.implementation, OTHER)
                    style: dict[str, Any] = {"ms": 8, "mec": colour, "mfc": colour if e.dtype == "float64" else "white", "mew": 1.8}
                    label = e.implementation if e.dtype == "float64" else f"{e.implementation}, float32"
                    axes.plot([time], [max(e.error, FLOOR)], marker, label=label, **style)
        _finish(axes, "ns per tetrahedron", f"{quantity}, strain {strain:.0e}")
        if axes.has_data():
            axes.margins(0.15)
    panels[0].set_ylabel("error, relative to 50 digits")
    _name_and_sign(figure, panels, results, f"{mesh}; down and to the left is better")
    return figure


def _finish(axes: Axes, xlabel: str, title: str) -> None:
    """Add labels and a grid; set logarithmic axes if there are points."""
    axes.set(xlabel=xlabel)
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=9)
    axes.grid(alpha=0.3)
    if axes.has_data():
        axes.set(xscale="log", yscale="log")


def _name_and_sign(figure: Figure, panels: list[Axes], results: Benchmark, words: str) -> None:
    """Add one legend with the names of all panels, the machine and the date."""
    handles: dict[str, Artist] = {}
    for axes in panels:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    if handles:
        style: dict[str, Any] = {"ncols": 4, "fontsize": 9, "title": words, "title_fontsize": 9, "frameon": False}
        figure.legend(handles.values(), handles.keys(), loc="outside upper center", **style)
    write_machine(figure, results.header)


def _mesh_of_most(results: Benchmark) -> str:
    """Return the box with the most timed implementations; among equals, the largest box."""
    boxes = {mesh: facts["nt"] for mesh, facts in results.meshes.items() if mesh.startswith("box")}
    implementations = {mesh: len({t.implementation for t in results.timings if t.mesh == mesh}) for mesh in boxes}
    return max(boxes, key=lambda mesh: (implementations[mesh], boxes[mesh]), default="")


def time_against_size(results: Benchmark) -> Figure:
    """Draw the times of F and K per tetrahedron: boxes as lines, parts as open markers."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, 2, sharey=True))
    for axes, quantity, title in zip(panels, ("F", "K"), ("internal force F", "tangent stiffness K"), strict=True):
        for implementation, style in STYLES.items():
            shown = "K v" if implementation == CSR else quantity
            for dtype in ("float64", "float32") if implementation == OURS else ("float64",):
                timings = [
                    t
                    for t in results.timings
                    if (t.implementation, t.quantity, t.threads, t.dtype) == (implementation, shown, 1, dtype)
                ]
                _line(axes, timings, style, implementation if dtype == "float64" else f"{implementation}, float32")
        _finish(axes, "tetrahedra", title)
    panels[0].set_ylabel("ns per tetrahedron, one thread")
    parts = any(name.startswith("part") for name in results.meshes)
    _name_and_sign(figure, panels, results, "filled: boxes; open: a part meshed by Gmsh" if parts else "")
    return figure


def _line(axes: Axes, timings: list[Timing], style: tuple[str, str], label: str) -> None:
    """Draw the times of one implementation in one precision.

    Single precision is a dashed line without parts.
    """
    boxes, parts = ([t for t in timings if t.mesh.startswith(kind)] for kind in ("box", "part"))
    single = "float32" in {t.dtype for t in timings}
    colour, marker = style
    if boxes:
        line = "--" if single else "-"
        axes.plot([t.nt for t in boxes], [t.best for t in boxes], line, marker=marker, ms=4.5, color=colour, label=label)
    if parts and not single:
        label = "" if boxes else label
        axes.plot([t.nt for t in parts], [t.best for t in parts], marker, ms=8, mfc="none", color=colour, label=label)
