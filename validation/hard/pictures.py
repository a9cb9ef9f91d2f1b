"""Small multiples of deformed bodies, coloured by the volume ratio."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure

from skfem_stvk.results.picture import visible_faces

from .case import Array
from .judge import volume_ratios
from .table import Row

START = "start"
#: Pictures: names of cases, and the method whose last state is drawn, or `START` for the initial state.
SHOWN = (
    ("twist a bar of 10 x 1 x 1 by 360°", "default"),
    ("shear by 200 % between plates", "default"),
    ("bend a bar with slivers of 1°", "default"),
    ("crush a thin sheet on a soft bed by 15 %, pushed", "default"),
    ("compress a held block by 20 % in one step", "plain Newton"),
    ("compress a held block by 20 % in one step", "default"),
    ("compress a held block by 60 %, nu = 0.3", "default"),
    ("compress a held block by 60 %, nu = 0.3", "default + volume"),
    ("shear a stiff core in a soft cube, 1 : 1e8", "default"),
    ("shear a mesh graded 1 : 1e4", "default"),
    ("start from random positions", START),
    ("start from random positions", "default + volume"),
)
COLUMNS, VIEW = 3, (22.0, -58.0)
INVERTED, EDGE = "#000000", "#606060"
#: Orange to violet without the darkest tenths, so that black stays the colour of inverted elements, in grey too.
COLOURS = LinearSegmentedColormap.from_list("ratios", colormaps["PuOr"](np.linspace(0.15, 0.85, 256))).with_extremes(under=INVERTED)
RATIOS = TwoSlopeNorm(1.0, 0.0, 1.6)
LIGHT = np.array([0.35, -0.55, 0.76])


def picture(rows: Sequence[Row], folder: Path, name: str = "hard-cases", shown: Sequence[tuple[str, str]] = SHOWN) -> Path:
    """Write NAME.png with the pictures of `shown` that are in the table."""
    by_name = {row.case.name: row for row in rows}
    found = [(by_name[case], method) for case, method in shown if case in by_name]
    lines = max(1, -(-len(found) // COLUMNS))
    figure = Figure(figsize=(2 * COLUMNS, 2.1 * lines + 0.8), layout="constrained")
    for index, (row, method) in enumerate(found):
        axes: Any = figure.add_subplot(lines, COLUMNS, index + 1, projection="3d", proj_type="ortho")
        _draw(axes, row, method)
    if found:
        bar = figure.colorbar(
            ScalarMappable(RATIOS, COLOURS), ax=figure.axes, location="bottom", shrink=0.7, aspect=40, extend="min"
        )
        bar.set_label("volume ratio; black: inverted", size=9)
        bar.ax.tick_params(labelsize=9)
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=125)
    return path


def _draw(axes: Any, row: Row, method: str) -> None:
    """Draw the surface with the outlines of its triangles."""
    mesh, art = row.system.mesh, import_module("mpl_toolkits.mplot3d.art3d")
    u, caption = _state(row, method)
    x = mesh.p.T + u.reshape(mesh.p.T.shape)
    (corners, elements), _ = visible_faces(mesh)
    triangles = x[mesh.t[corners, elements]].swapaxes(0, 1)
    colours = COLOURS(RATIOS(volume_ratios(row.system, u)[elements]))
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normals, axis=1)
    colours[:, :3] *= (0.75 + 0.25 * np.abs(normals @ LIGHT) / np.where(size > 0, size, 1.0))[:, None]
    axes.add_collection3d(art.Poly3DCollection(triangles, facecolors=colours, edgecolors=EDGE, linewidths=0.2))
    axes.auto_scale_xyz(*x.T)
    axes.set_box_aspect(np.maximum(np.ptp(x, axis=0), 1e-3), zoom=1.15)
    axes.view_init(*VIEW)
    axes.set_axis_off()
    lines = [line for text in (row.case.name, caption) for line in wrap(text.replace(" %", "\N{NO-BREAK SPACE}%"), 26)]
    axes.set_title("\n".join(lines), fontsize=9)


def _state(row: Row, method: str) -> tuple[Array, str]:
    """Return displacements (ndofs,) and their caption."""
    if method == START:
        u0 = row.case.body().u0
        return (np.zeros(row.system.ndofs) if u0 is None else u0), "the start"
    run = next(run for run in row.runs if run.method == method)
    return run.u, f"{method}: {run.verdict}"
