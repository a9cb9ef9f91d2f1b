"""Pictures and films by matplotlib. This module imports matplotlib, so it is imported only when a picture is drawn."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from ..arguments import Array
from ..elements import linear_simplex
from .picture import Film, Picture, View, subdivided

MISSING, REST, EDGE = "#c8c8c8", "#909090", "#202020"
#: Yellow to red without the palest tenth, which is invisible on white paper.
COLOURS = LinearSegmentedColormap.from_list("stvk", colormaps["YlOrRd"](np.linspace(0.12, 1, 256))).with_extremes(bad=MISSING)
PIECES = 30_000  # number of pieces of triangles, so that colours are smooth
VIEW = (24.0, -50.0)  # elevation and azimuth [degrees]
LIGHT = np.array([0.35, -0.55, 0.76])
#: Size of films, in inches and dots per inch: an even number of pixels, as .mp4 requires.
SIZE, DPI = (7.0, 4.5), 120


def draw(picture: Picture, path: Path | None) -> Figure:
    """Return the figure; it is written to `path` if there is one, else pyplot can show it."""
    figure = new_figure(SIZE, interactive=path is None)
    PictureAxes(figure, picture, View.of([picture])).show(picture)
    if path is not None:
        figure.savefig(path, dpi=200, bbox_inches="tight")
    return figure


def new_figure(size: tuple[float, float], interactive: bool) -> Figure:
    """Return a figure of this size [inch]; pyplot can show an interactive one."""
    if not interactive:
        return Figure(figsize=size, layout="constrained")
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained")


class PictureAxes:
    """Axes and a colour bar on an empty figure, with one view for all pictures of a body, which are shown one after the other."""

    def __init__(self, figure: Figure, picture: Picture, view: View) -> None:
        self._colours = ScalarMappable(Normalize(*view.limits), COLOURS)
        self._axes: Any = (_axes_in_space if picture.d == 3 else _axes_in_plane)(figure, view.box, picture)
        self._draw = _draw_in_space if picture.d == 3 else _draw_in_plane
        self._shown: list[Any] = []
        bar = figure.colorbar(self._colours, ax=figure.axes, label=picture.label, shrink=0.7, aspect=24, pad=0.03)
        bar.outline.set_visible(False)
        if picture.scale != 1:
            figure.text(0.01, 0.01, f"displacements × {picture.scale:g}", fontsize=8, color=REST)

    def show(self, picture: Picture) -> None:
        """Show this picture instead of the previous one."""
        for artist in self._shown:
            artist.remove()
        self._shown = self._draw(self._axes, picture, self._colours)


def _axes_in_plane(figure: Figure, box: Array, picture: Picture) -> Any:
    axes: Any = figure.add_subplot()
    axes.update_datalim(box[:, :2])
    axes.autoscale_view()
    axes.autoscale(False)
    axes.set_aspect("equal")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set(xlabel=f"x [{picture.length_unit}]", ylabel=f"y [{picture.length_unit}]")
    if picture.d == 1:
        axes.set_ylim(np.array([-0.1, 0.06]) * np.ptp(picture.rest[:, 0]))
        axes.yaxis.set_visible(False)
        axes.spines["left"].set_visible(False)
    return axes


def _draw_in_plane(axes: Any, picture: Picture, colours: ScalarMappable) -> list[Any]:
    """Draw a picture in the plane; return the added artists."""
    rest, moved = picture.rest[:, :2].copy(), picture.moved[:, :2]
    points: Any  # an array, which it takes and is faster with than with the list that its types ask for
    points, values = _pieces(moved[picture.cells], picture.values)
    rgba = colours.to_rgba(values)
    marks = []
    if picture.d == 1:
        rest[:, 1] -= 0.04 * np.ptp(picture.rest[:, 0])  # next to the deformed body, which would hide it
        marks = axes.plot(*rest.T, "|", color=REST, ms=6)
    shown: list[Any] = [LineCollection(rest[picture.lines.T], colors=REST, linewidths=0.8, zorder=1)]
    if len(picture.cells) == 2:
        shown.append(LineCollection(list(points), colors=EDGE, linewidths=5, capstyle="round"))
        shown.append(LineCollection(list(points), colors=rgba, linewidths=4, capstyle="round"))
    else:
        shown.append(PolyCollection(points, facecolors=rgba, edgecolors=rgba, linewidths=0.3, rasterized=True))
        shown.append(LineCollection(moved[picture.lines.T], colors=EDGE, linewidths=0.8))
    for collection in shown:
        axes.add_collection(collection, autolim=False)
    return marks + shown


def _axes_in_space(figure: Figure, box: Array, picture: Picture) -> Any:
    axes: Any = figure.add_subplot(projection="3d", proj_type="ortho")
    axes.view_init(*VIEW)
    axes.set_axis_off()
    axes.auto_scale_xyz(*box.T)
    axes.autoscale(False)
    size = np.maximum(np.ptp(box, axis=0), 1e-3 * np.ptp(box, axis=0).max())
    axes.set_box_aspect(size, zoom=_zoom(size))
    return axes


def _zoom(size: Array) -> float:
    """Return the zoom at which a box of this size (3,) fills the axes, which matplotlib keeps square, in one direction.

    matplotlib's zoom of 1 leaves room for a box of any shape and view.
    """
    elevation, azimuth = np.radians(VIEW)
    across = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.array([np.sin(elevation) * np.cos(azimuth), np.sin(elevation) * np.sin(azimuth), np.cos(elevation)])
    seen = np.abs([across, up]) @ size
    return float(np.linalg.norm(size) / seen.max())


def _draw_in_space(axes: Any, picture: Picture, colours: ScalarMappable) -> list[Any]:
    """Draw a picture in space; return the added artists."""
    art: Any = import_module("mpl_toolkits.mplot3d.art3d")
    points, values = _pieces(picture.moved[picture.cells], picture.values)
    rgba = colours.to_rgba(values)
    if points.shape[1] == 2:
        shown = [
            art.Line3DCollection(picture.rest[picture.lines.T], colors=REST, linewidths=0.8),
            art.Line3DCollection(points, colors=EDGE, linewidths=4, capstyle="round"),
            art.Line3DCollection(points, colors=rgba, linewidths=3, capstyle="round"),
        ]
    else:
        shapes, shades = _sorted_together(points, rgba, picture)
        shown = [art.Poly3DCollection(shapes, facecolors=shades, edgecolors=shades, linewidths=0.6, rasterized=True)]
    for collection in shown:
        axes.add_collection3d(collection)
        collection.set_clip_on(False)
    return shown


def _sorted_together(triangles: Array, rgba: Array, picture: Picture) -> tuple[Array, Array]:
    """Return triangles and outlines with their colours, lines as flat triangles: matplotlib sorts by depth within one list only."""
    rgba[:, :3] *= _brightness(triangles)[:, None]
    rest, moved = (_pieces(x[picture.lines], np.zeros(picture.lines.shape))[0][:, [0, 1, 1]] for x in (picture.rest, picture.moved))
    elevation, azimuth = np.radians(VIEW)
    viewer = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    moved = moved + viewer * np.linalg.norm(triangles[:, 1] - triangles[:, 0], axis=1).max()  # in front of the triangles it borders
    colours = np.concatenate([rgba, np.repeat([to_rgba(REST), to_rgba(EDGE)], [len(rest), len(moved)], axis=0)])
    return np.concatenate([triangles, rest, moved]), colours


def _brightness(triangles: Array) -> Array:
    """Return the fraction (n,) of light that each triangle (n, 3, 3) reflects."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    cosine: Array = np.abs(normals @ LIGHT) / np.where(length > 0, length, 1.0)
    return np.minimum(0.8 + 0.2 * cosine, 1.0)  # rounding may exceed 1


def _pieces(points: Array, values: Array) -> tuple[Array, Array]:
    """Return cells (m, n, d) with values (m, n) at their corners, cut into equal pieces (pieces, m, d), with one value each."""
    m, n, d = points.shape
    cuts = int(np.clip((PIECES / n) ** (1 / (m - 1)), 1, 8))
    face = linear_simplex(m - 1)
    grid, cells = subdivided(face, cuts)
    lattice = face.values(grid)[cells.T]  # (pieces, m, m)
    cut = np.einsum("pcm,mnd->npcd", lattice, points).reshape(-1, m, d)
    missing: NDArray[np.bool_] = np.asarray(np.ma.getmaskarray(values).any(axis=0))
    mean = np.einsum("pm,mn->np", lattice.mean(axis=1), np.ma.filled(values, 0.0))
    return cut, np.ma.MaskedArray(mean, np.repeat(missing[:, None], len(lattice), axis=1)).ravel()


def write_film(film: Film, path: Path, suffix: str, fps: float) -> None:
    """Write a film as a .gif or an .mp4 file, by the `suffix`, for any ending of the path."""
    figure = new_figure(SIZE, interactive=False)
    figure.set_dpi(DPI)
    canvas, shown = FigureCanvasAgg(figure), _shown(figure, film)
    if suffix == ".gif":
        images = (_image(canvas, _palette(in_space=picture.d == 3)) for picture in shown)
        options = {"save_all": True, "append_images": images, "duration": round(1000 / fps), "loop": 0}
        next(images).save(path, format="GIF", **options)
        return
    writer = FFMpegWriter(fps=fps, extra_args=["-f", "mp4", "-pix_fmt", "yuv420p"])  # type: ignore[arg-type]
    with writer.saving(figure, str(path), DPI):
        for _ in shown:
            writer.grab_frame()


def _shown(figure: Figure, film: Film) -> Iterator[Picture]:
    """Yield the pictures one after the other, shown on a figure with the layout of the first."""
    view, pictures = film.view_and_pictures()
    title = figure.suptitle(" ", fontsize=11, color=EDGE)
    picture_axes = None
    for words, picture in pictures:
        title.set_text(words)
        if picture_axes is None:
            picture_axes = PictureAxes(figure, picture, view)
            picture_axes.show(picture)
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        else:
            picture_axes.show(picture)
        yield picture


def _image(canvas: FigureCanvasAgg, palette: Image.Image) -> Image.Image:
    canvas.draw()
    image = Image.frombuffer("RGBA", canvas.get_width_height(), bytes(canvas.buffer_rgba()))
    return image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)


def _palette(in_space: bool) -> Image.Image:
    """Return the 256 colours of all frames: those of the bar, in space in several brightnesses, and greys."""
    lights = np.linspace(0.8, 1.0, 5) if in_space else np.ones(1)
    greys = np.linspace(0.0, 1.0, 36)
    shades = COLOURS(np.linspace(0, 1, (256 - len(greys)) // len(lights)))[:, :3]
    colours = np.concatenate([(lights[:, None, None] * shades).reshape(-1, 3), np.repeat(greys[:, None], 3, axis=1)])
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.round(255 * colours).astype(np.uint8).tobytes())
    return palette
