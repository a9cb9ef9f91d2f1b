"""Pictures of a deformed body, by PyVista where it is installed, else by matplotlib."""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import Any

from numpy.typing import ArrayLike

from ..arguments import choice
from ..errors import StvkError
from .files import output_path
from .picture import picture_of
from .state import State

BACKENDS = ("pyvista", "matplotlib")


def plot(
    state: State,
    field: str | ArrayLike = "von_mises_stress",
    *,
    scale: float = 1.0,
    label: str | None = None,
    path: str | os.PathLike[str] | None = None,
    backend: str | None = None,
) -> Any:
    """Draw the deformed body, coloured by a field, with the outline of the body at rest.

    Parameters
    ----------
    field : name of a field with one number an element, or "displacement" or "velocity" for its length; or the numbers themselves, one an element
        or one a vertex. Numbers by element are averaged to the nodes, within each material. Grey: no value there.
    scale : factor for the displacements, 1 for the true shape.
    label : of the colour bar; by default the field's name and unit.
    path : of a .png, .pdf or .svg file to write.
    backend : "pyvista" or "matplotlib"; by default PyVista if it is installed (`pip install pyvista`).

    Returns
    -------
    matplotlib's `Figure`, which `pyplot.show()` shows, or PyVista's `Plotter`, which `.show()` shows.

    Raises
    ------
    StvkError
        for an unknown field or backend, or a path that cannot be written, before any work.
    """
    if backend is None:
        backend = "pyvista" if find_spec("pyvista") else "matplotlib"
    backend = choice("backend", backend, BACKENDS)
    target = None if path is None else output_path(path, ".png", ".pdf", ".svg")
    if backend == "matplotlib":
        from .matplotlib_plot import draw
    elif find_spec("pyvista"):
        from .pyvista_plot import draw
    else:
        raise StvkError('PyVista is not installed: pip install pyvista, or take backend="matplotlib".')
    return draw(picture_of(state, field, scale, label), target)
