"""Pictures of reduced bodies next to full bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.results.matplotlib_plot import new_figure

COLOURS = "#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7"
MARKS = "os^D"


def states_and_errors(
    mesh: ElementMesh, states: Mapping[str, Array], errors: tuple[Sequence[int], Mapping[str, Sequence[float]]], path: Path
) -> Path:
    """Draw the deformed bodies side by side, and the errors against size; return the path of the picture."""
    figure = new_figure((6, 4.6), interactive=False)
    lowest, highest = (
        np.stack([edge(mesh.p + u.reshape(-1, mesh.d).T, axis=1) for u in states.values()]) for edge in (np.min, np.max)
    )
    box = np.stack([lowest.min(axis=0), highest.max(axis=0)])
    rows = (len(states) + 2) // 2
    for i, (name, u) in enumerate(states.items()):
        axes = figure.add_subplot(rows, 2, i + 1, projection="3d", proj_type="ortho")
        x = mesh.p + u.reshape(-1, mesh.d).T
        axes.plot_trisurf(*x, triangles=mesh.surface.T, color=COLOURS[i] if i else "#999999", lw=0.1, edgecolor="#333333")
        axes.set_title(name, fontsize=9)
        axes.set(xlim=box[:, 0], ylim=box[:, 1], zlim=box[:, 2])
        axes.set_box_aspect(np.ptp(box, axis=0), zoom=1.2)
        axes.set_axis_off()
        axes.view_init(20, -55)
    axes = figure.add_subplot(rows, 2, len(states) + 1)
    sizes, found = errors
    for (name, several), colour, mark in zip(found.items(), COLOURS[1:], MARKS, strict=False):
        axes.semilogy(sizes, several, marker=mark, ms=4, lw=1, color=colour, label=name)
    axes.set_xlabel("number of unknowns r", size=9)
    axes.set_ylabel("error of u", size=9)
    axes.tick_params(labelsize=9)
    figure.legend(fontsize=9, frameon=False, ncols=4, loc="outside lower center")
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=150)
    return path
