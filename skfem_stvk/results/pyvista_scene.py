"""Scenes of PyVista, an optional package, imported only when one is asked for."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

import numpy as np

from .matplotlib_plot import COLOURS, EDGE, MISSING, REST
from .picture import Picture

pyvista: Any = import_module("pyvista")


def scene(picture: Picture) -> Any:
    """The plotter, which shows the scene and exports it."""
    plotter = pyvista.Plotter(off_screen=_no_display(), window_size=(1400, 900))
    plotter.background_color = "white"
    m, n = picture.cells.shape
    cells = np.column_stack([np.full(n, m), np.arange(m * n).reshape(n, m)]).ravel()
    body = pyvista.PolyData(picture.moved[picture.cells.T].reshape(-1, 3), **{"lines" if m == 2 else "faces": cells})
    body[picture.label] = np.ma.filled(np.ma.MaskedArray(picture.values, dtype=float).T, np.nan).ravel()
    bar = {"title": picture.label + "\n", "color": "black", "vertical": True, "height": 0.6, "position_x": 0.85, "position_y": 0.2}
    bar |= {"title_font_size": 22, "label_font_size": 20, "fmt": "%.3g", "n_labels": 5}
    look = {"cmap": COLOURS, "nan_color": MISSING, "clim": picture.limits, "scalar_bar_args": bar}
    if m == 2:
        plotter.add_mesh(body.copy(), color=EDGE, line_width=10)
    plotter.add_mesh(body, line_width=8, lighting=m == picture.d == 3, ambient=0.6, diffuse=0.45, **look)
    plotter.add_mesh(_lines(picture.rest, picture), color=REST, line_width=1)
    if m == 3:
        plotter.add_mesh(_lines(picture.moved, picture), color=EDGE, line_width=1.5)
    if picture.scale != 1:
        plotter.add_text(f"displacements × {picture.scale:g}", position="lower_left", font_size=10, color=REST)
    _look(plotter, picture)
    return plotter


def _lines(points: Any, picture: Picture) -> Any:
    n = picture.lines.shape[1]
    return pyvista.PolyData(points, lines=np.column_stack([np.full(n, 2), picture.lines.T]).ravel())


def _look(plotter: Any, picture: Picture) -> None:
    if picture.d == 3:
        plotter.view_vector((0.6, -0.7, 0.42), viewup=(0, 0, 1))
        plotter.enable_anti_aliasing("ssaa")
    else:
        plotter.view_xy()
    plotter.enable_parallel_projection()


def _no_display() -> bool:
    """Whether a window would end the process, which VTK does on a Linux machine without a screen."""
    return sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
