"""Pictures and films of a deformed body, drawn by matplotlib; and PyVista scenes that can be rotated."""

from __future__ import annotations

import os
import shutil
import sys
from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import arguments
from ..arguments import choice, text
from ..errors import StvkError, name_known
from ..mesh.facets import Cells
from ..mesh.groups import from_cells
from ..system import System
from ..terms.loads.rigid_shapes import RigidShape
from .complete_files import output_path, replacing
from .fields import State, checked_state, masked, whole_state
from .picture import Film, Picture, View, VisibleBody, VisibleMesh, checked_label, checked_scale, corner_values, joined, picture_of
from .series import listed_states
from .shapes import surface_of, surroundings
from .table import FIELDS, NODAL
from .vtu import read_vtu

if TYPE_CHECKING:
    import meshio

#: Elements up to which notebooks show a picture of a result: those of tetrahedra in a block take 0.2 s.
MOST_ELEMENTS = 10_000
BACKENDS = ("matplotlib", "pyvista")
States = Sequence[tuple[float, State]]


def plot(
    state: State,
    field: str | ArrayLike = "von_mises_stress",
    *,
    scale: float = 1.0,
    label: str | None = None,
    length_unit: str | None = None,
    path: str | os.PathLike[str] | None = None,
    backend: str | None = None,
) -> Any:
    """Draw the deformed body, coloured by a field, with the outline of the body at rest and the rigid shapes near it, in grey.

    Parameters
    ----------
    field
        Name of a field with one number per element, or of values at nodes: "displacement", "velocity", and with contacts
        "contact_force", "contact_pressure" and "gap"; of vectors the length. Or the numbers themselves, one per element or one per
        node. Numbers by element are averaged to the nodes, within each material. Grey means no value.
    scale
        Factor for the displacements, 1 for the true shape; others are drawn without rigid shapes.
    label
        Label of the colour bar; by default the field's name and unit.
    length_unit
        Unit of coordinates, on the axes of bodies in a plane; by default that of the system of units.
    path
        Path of a .png, .pdf or .svg file to write.
    backend
        Package that draws, "matplotlib", or "pyvista" for a scene that the mouse rotates and that PyVista exports (`pip install
        'skfem-stvk[plot]'`).

    Returns
    -------
    matplotlib.figure.Figure or pyvista.Plotter
        Matplotlib's `Figure`, which `pyplot.show()` shows; or PyVista's `Plotter`, which `.show()` shows and `.export_gltf(...)`
        exports.

    Raises
    ------
    StvkError
        for an unknown field or backend, or a path that cannot be written, before any work.
    """
    length_unit = None if length_unit is None else text("length_unit", length_unit)
    backend = "matplotlib" if backend is None else choice("backend", backend, BACKENDS)
    target = None if path is None else output_path(path, ".png", ".pdf", ".svg")
    if backend == "pyvista" and not find_spec("pyvista"):
        raise StvkError("PyVista is not installed: pip install 'skfem-stvk[plot]', or take backend=\"matplotlib\".")
    picture = picture_of(state, field, scale, label)
    picture = picture if length_unit is None else replace(picture, length_unit=length_unit)
    if backend == "matplotlib" or target is not None:
        from .matplotlib_plot import draw

        figure = draw(picture, target)
    if backend == "matplotlib":
        return figure
    return _scene(picture)


def thumbnail(system: System, state: Callable[[], State]) -> str:
    """Return the HTML of a small picture of displacements; empty where it would take longer than 0.3 s, or ranks share the body.

    Large meshes take longer, and so does the import of matplotlib.
    """
    if "matplotlib" not in sys.modules or system.mesh.nt > MOST_ELEMENTS or system.space.comm.divided:
        return ""
    from .matplotlib_plot import png

    return f'<img src="data:image/png;base64,{b64encode(png(picture_of(state(), "displacement", 1.0, None))).decode()}">'


def animate(
    series: str | os.PathLike[str] | States,
    path: str | os.PathLike[str],
    field: str = "displacement",
    *,
    scale: float = 1.0,
    label: str | None = None,
    length_unit: str | None = None,
    fps: float = 20.0,
    shapes: Callable[[float], Sequence[RigidShape]] | None = None,
) -> Path:
    """Write a film of the deformed body, coloured by a field, with the rigid shapes near it; axes and colours stay the same.

    Parameters
    ----------
    series
        A .pvd file with the .vtu files it lists, as `Series` writes them; or pairs of times and states.
    path
        Path of a .gif file, or of an .mp4 file, which requires ffmpeg.
    field
        Name of a field, as in `plot`. From a .pvd, a field in its files, averaged to the nodes there.
    scale
        Factor for the displacements, 1 for the true shape; others are drawn without rigid shapes.
    label
        Label of the colour bar; by default the field's name and unit.
    length_unit
        Unit of coordinates, on the axes of bodies in a plane; by default that of the system of units.
    fps
        Frames per second. A .gif counts in hundredths of a second.
    shapes
        Function of the time that returns the rigid shapes, for a .pvd file; `run.animate` passes those of the contacts.

    Raises
    ------
    StvkError
        for a series that cannot be read, has no states or has several meshes, for an unknown field, for a path that cannot be
        written, or without ffmpeg: before any work.
    """
    path = output_path(path, ".gif", ".mp4")
    scale, label = checked_scale(scale), checked_label(label)
    length_unit = None if length_unit is None else text("length_unit", length_unit)
    fps = arguments.number("fps", fps, "frames per second, up to 100", 0.0, np.nextafter(100.0, 101.0))
    if path.suffix.lower() == ".mp4" and not _ffmpeg():
        raise StvkError(
            "ffmpeg, which writes .mp4 files, is not installed: apt install ffmpeg, brew install ffmpeg or conda install ffmpeg. "
            "Or write a .gif file."
        )
    if isinstance(series, str | os.PathLike):
        film = _of_files(series, field, scale, label, shapes)
    else:
        film = _of_states(series, field, scale, label)
    from .matplotlib_plot import write_film

    with replacing(path) as part:
        write_film(film if length_unit is None else replace(film, length_unit=length_unit), part, path.suffix.lower(), fps)
    return path


def _ffmpeg() -> bool:
    from matplotlib import rcParams

    return shutil.which(rcParams["animation.ffmpeg_path"]) is not None


def _of_states(states: States, field: str, scale: float, label: str | None) -> Film:
    expected = "the path of a .pvd file, or pairs of times and states, such as (0.5, fields.at(u))"
    if not isinstance(states, Sequence) or not all(isinstance(pair, tuple | list) and len(pair) == 2 for pair in states):
        raise StvkError(f"series = {arguments.shown(states)}; expected {expected}.")
    if not states:
        raise StvkError(f"The series has no states; expected {expected}.")
    pairs = [(arguments.number("series: a time", t), whole_state(checked_state(state))) for t, state in states]
    mesh = pairs[0][1].fields.mesh
    for number, (_, state) in enumerate(pairs):
        other = state.fields.mesh
        if other is not mesh and not (np.array_equal(other.p, mesh.p) and np.array_equal(other.t, mesh.t)):
            raise StvkError(f"series: state {number} belongs to another mesh than state 0; expected states of one mesh.")
    bodies: dict[bytes, VisibleBody] = {}
    _, named, unit = corner_values(pairs[0][1], field)

    def picture(number: int) -> Picture:
        state = pairs[number][1]
        removed = b"".join(one.fields.removed.tobytes() for one in (state, *state.beside))
        if removed not in bodies:
            bodies[removed] = VisibleBody(state)
        return bodies[removed].picture(state, field, label or named, scale)

    return Film([t for t, _ in pairs], picture, "" if label else unit, pairs[0][1].fields.units.of("m"))


def _of_files(
    series: str | os.PathLike[str],
    field: str,
    scale: float,
    label: str | None,
    shapes: Callable[[float], Sequence[RigidShape]] | None = None,
) -> Film:
    listed = listed_states(arguments.path("series", series, "the path of a .pvd file"))
    files = [file for _, file in listed]
    first = read_vtu(files[0])
    _, named, unit = _described(first, field, files[0])
    cache: dict[tuple[tuple[str, bytes], ...], list[tuple[NDArray[Any], VisibleMesh]]] = {}

    def visible_parts(mesh: meshio.Mesh, file: Path) -> list[tuple[NDArray[Any], VisibleMesh]]:
        """Return nodes of the elements in a file, and their visible part; these change once elements are removed."""
        if not np.array_equal(mesh.points, first.points):
            raise StvkError(f"{file} belongs to another mesh than {files[0].name}: its nodes differ. Expected states of one mesh.")
        key = tuple((block.type, block.data.tobytes()) for block in mesh.cells)
        try:
            if key not in cache:
                parts = [from_cells(block.type, block.data) for block in mesh.cells]
                if not parts:
                    raise KeyError("none")
                cache[key] = [(t, VisibleMesh(Cells(np.ascontiguousarray(mesh.points.T), t, element))) for t, element in parts]
            return cache[key]
        except KeyError as error:
            raise StvkError(
                f"{file} has no cells that can be drawn ({error}). Check that the .pvd file lists the right path."
            ) from error

    def picture(number: int) -> Picture:
        read, file = read_vtu(files[number]), files[number]
        name = _described(read, field, file)[0]
        data = read.point_data
        values = data[name] if data[name].ndim == 1 else np.linalg.norm(data[name], axis=1)
        missing = data.get(f"{name}_missing", np.zeros(len(values))).astype(bool)
        u, parts = _described(read, "displacement", file)[0], visible_parts(read, file)
        body = joined([part.picture(data[u], masked(values, missing)[t], label or named, scale) for t, part in parts])
        return body if shapes is None or scale != 1 else replace(body, shapes=tuple(shapes(listed[number][0])))

    return Film([t for t, _ in listed], picture, "" if label else unit)


def _described(mesh: meshio.Mesh, field: str, file: Path) -> tuple[str, str, str]:
    """Return a field's name in the file, its name in words and its unit."""
    scalars = [name for name, values in mesh.point_data.items() if values.ndim == 1 and not name.endswith("_missing")]
    nodal = [name for name in NODAL if name in mesh.point_data]
    if field in nodal:
        return field, field.replace("_", " "), NODAL[field]
    for name in (field, f"{field}_stress"):
        if name in scalars:
            units = {one.name: (one.words, one.unit.replace("-", "")) for one in FIELDS}
            return name, *units.get(name, (name.replace("_", " "), ""))
    raise StvkError(f"{file.name} has no field {field!r}; {name_known(field, dict.fromkeys([*nodal, *scalars]))}")


def _scene(picture: Picture) -> Any:
    """Return PyVista's plotter, which shows the scene and exports it."""
    from .matplotlib_plot import COLOURS, EDGE, MISSING, REST, SHAPE

    pyvista: Any = import_module("pyvista")
    plotter = pyvista.Plotter(off_screen=_no_display(), window_size=(1400, 900))
    plotter.background_color = "white"
    m, n = picture.cells.shape
    cells = np.column_stack([np.full(n, m), np.arange(m * n).reshape(n, m)]).ravel()
    lines = np.column_stack([np.full(picture.lines.shape[1], 2), picture.lines.T]).ravel()
    body = pyvista.PolyData(picture.moved[picture.cells.T].reshape(-1, 3), **{"lines" if m == 2 else "faces": cells})
    body[picture.label] = np.ma.filled(np.ma.MaskedArray(picture.values, dtype=float).T, np.nan).ravel()
    bar = {"title": picture.label + "\n", "color": "black", "vertical": True, "height": 0.6, "position_x": 0.85, "position_y": 0.2}
    bar |= {"title_font_size": 22, "label_font_size": 20, "fmt": "%.3g", "n_labels": 5}
    appearance = {"cmap": COLOURS, "nan_color": MISSING, "clim": picture.limits, "scalar_bar_args": bar}
    if m == 2:
        plotter.add_mesh(body.copy(), color=EDGE, line_width=10)
    plotter.add_mesh(body, line_width=8, lighting=m == picture.d == 3, ambient=0.6, diffuse=0.45, **appearance)
    plotter.add_mesh(pyvista.PolyData(picture.rest, lines=lines), color=REST, line_width=1)
    if m == 3:
        plotter.add_mesh(pyvista.PolyData(picture.moved, lines=lines), color=EDGE, line_width=1.5)
    around = surroundings(View.of([picture]).box)
    for surface in (surface_of(shape, around) for shape in picture.shapes):
        n, corners = surface.shape[:2]
        numbers = np.column_stack([np.full(n, corners), np.arange(n * corners).reshape(n, corners)]).ravel()
        drawn = pyvista.PolyData(surface.reshape(-1, 3), **{"lines" if corners == 2 else "faces": numbers})
        plotter.add_mesh(drawn, color=SHAPE[:3], opacity=SHAPE[3] if corners == 3 else 1.0, line_width=2)
    if picture.scale != 1:
        plotter.add_text(f"displacements × {picture.scale:g}", position="lower_left", font_size=10, color=REST)
    if picture.d == 3:
        plotter.view_vector((0.6, -0.7, 0.42), viewup=(0, 0, 1))
        plotter.enable_anti_aliasing("ssaa")
    else:
        plotter.view_xy()
    plotter.enable_parallel_projection()
    return plotter


def _no_display() -> bool:
    """Return whether a window would end the process, as VTK does on a Linux machine without a screen."""
    return sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
