"""Pictures and films by matplotlib. This module imports matplotlib, so it is imported only when a picture is drawn."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, TriMesh
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgba
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from PIL import Image

from ..arguments import Array
from ..mesh.element import linear_simplex
from .picture import SCREEN, Film, Picture, View, subdivided
from .shapes import surface_of, surroundings

MISSING, REST, EDGE = "#c8c8c8", "#909090", "#000000"
#: `cividis` without its darkest part, which hides outlines and the shades of faces.
COLOURS = LinearSegmentedColormap.from_list("stvk", colormaps["cividis"](np.linspace(0.18, 1, 256))).with_extremes(bad=MISSING)
PIECES = 5000  # most pieces of faces, which are small enough to be sorted by depth
SHAPE = (*to_rgba(REST)[:3], 0.35)  # colour of rigid shapes
LIGHT = np.array([-0.09, 0.43, 0.90])  # direction to the light, as `SCREEN` has its axes
LINE = 1 / 800  # width of outlines of bodies in space, as a part of the picture
#: Size of films, in inches and dots per inch: an even number of pixels, as .mp4 requires.
SIZE, DPI = (7.0, 4.5), 120


def draw(picture: Picture, path: Path | None) -> Figure:
    """Return the figure; it is written to `path` if there is one, else pyplot can show it."""
    figure = new_figure(SIZE, interactive=path is None)
    PictureAxes(figure, picture, View.of([picture])).show(picture)
    if path is not None:
        figure.savefig(path, dpi=200, bbox_inches="tight")
    return figure


def png(picture: Picture) -> bytes:
    """Return a small picture as a PNG file."""
    figure, file = new_figure((4.2, 2.7), interactive=False), io.BytesIO()
    PictureAxes(figure, picture, View.of([picture])).show(picture)
    figure.savefig(file, format="png", dpi=90)
    return file.getvalue()


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
        self._axes: Any = figure.add_subplot(aspect="equal")
        self._around = surroundings(view.box)
        if picture.d == 3:
            _prepare_in_space(self._axes, view.screen)
        else:
            _prepare_in_plane(self._axes, view.frame, picture)
        self.artists: list[Any] = []  # of the picture that is shown
        bar = figure.colorbar(self._colours, ax=figure.axes, label=picture.label, shrink=0.7, aspect=24, pad=0.03)
        bar.outline.set_visible(False)
        if picture.scale != 1:
            figure.text(0.01, 0.01, f"displacements × {picture.scale:g}", fontsize=8, color=REST)

    def show(self, picture: Picture) -> None:
        """Show this picture instead of the previous one."""
        for artist in self.artists:
            artist.remove()
        in_space = picture.d == 3 and len(picture.cells) == 3
        shapes = [surface_of(shape, self._around) for shape in picture.shapes]
        if picture.d == 3:
            shapes = [cells @ SCREEN.T for cells in shapes]
        draw = _draw_faces_in_space if in_space else _draw_flat
        self.artists = draw(self._axes, picture.on_screen(), self._colours, shapes)


def _prepare_in_plane(axes: Any, box: Array, picture: Picture) -> None:
    axes.update_datalim(box[:, :2])
    axes.autoscale_view()
    axes.autoscale(False)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set(xlabel=f"x [{picture.length_unit}]", ylabel=f"y [{picture.length_unit}]")
    if picture.d == 1:
        axes.set_ylim(np.array([-0.1, 0.06]) * np.ptp(picture.rest[:, 0]))
        axes.yaxis.set_visible(False)
        axes.spines["left"].set_visible(False)


def _prepare_in_space(axes: Any, screen: Array) -> None:
    """Set limits that a body with these bounds (2, 3) on the screen fills, with room for its lines."""
    axes.set_axis_off()
    middle, half = screen.mean(axis=0), np.ptp(screen, axis=0) / 2
    half = np.maximum(1.02 * half, 0.05 * half.max())
    axes.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))


def _draw_flat(axes: Any, picture: Picture, colours: ScalarMappable, shapes: list[Array]) -> list[Any]:
    """Draw lines, or a body in a plane, with rigid shapes behind; return the added artists."""
    rest, moved = picture.rest[:, :2].copy(), picture.moved[:, :2]
    points: Any  # an array, which it takes and is faster with than with the list that its types ask for
    points, values = _pieces(moved[picture.cells], picture.values)
    marks = []
    if picture.d == 1:
        rest[:, 1] -= 0.04 * np.ptp(picture.rest[:, 0])  # next to the deformed body, which would hide it
        marks = axes.plot(*rest.T, "|", color=REST, ms=6)
    shown: list[Any] = [LineCollection(rest[picture.lines.T], colors=REST, linewidths=0.8, zorder=1)]
    if len(picture.cells) == 2:
        shown.append(LineCollection(points, colors=EDGE, linewidths=5, capstyle="round"))
        shown.append(LineCollection(points, colors=colours.to_rgba(values.mean(axis=1)), linewidths=4, capstyle="round"))
    else:
        shown.append(_smooth(points, colours.to_rgba(values)))
        shown.append(LineCollection(moved[picture.lines.T], colors=EDGE, linewidths=0.8))
    for cells in shapes:
        if cells.shape[1] == 2:
            points = cells[..., :2]
            shown.append(LineCollection(points, colors=SHAPE[:3], linewidths=1.5, zorder=1))
        else:
            shown.append(_smooth(cells[..., :2], np.broadcast_to(SHAPE, (len(cells), 3, 4))))
            shown[-1].set_zorder(0)
    for collection in shown:
        axes.add_collection(collection, autolim=False)
    return marks + shown


def _draw_faces_in_space(axes: Any, picture: Picture, colours: ScalarMappable, shapes: list[Array]) -> list[Any]:
    """Draw faces, outlines and rigid shapes on the screen from the farthest to the nearest; return the added artists."""
    points, values = _pieces(picture.moved[picture.cells], picture.values)
    rgba = colours.to_rgba(values)
    rgba[..., :3] *= _brightness(points)[:, None, None]
    triangles, shades, depth = [points[..., :2]], [rgba], [points[..., 2].mean(axis=1)]
    width = LINE * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    nearer = np.linalg.norm(points[:, 1] - points[:, 0], axis=1).max() * 2 / 3  # than the faces that a line bounds
    for x, colour, shift in ((picture.rest, REST, -nearer), (picture.moved, EDGE, nearer)):
        ends, _ = _pieces(x[picture.lines], np.zeros(picture.lines.shape))
        triangles.append(_ribbons(ends[..., :2], width))
        shades.append(np.broadcast_to(to_rgba(colour), (len(triangles[-1]), 3, 4)))
        depth.append(np.tile(ends[..., 2].mean(axis=1) + shift, 2))
    for cells in shapes:
        to_viewer = np.sign(np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0])[:, 2])
        triangles.append(cells[..., :2])
        shade = np.tile(to_rgba(SHAPE), (len(cells), 3, 1))
        shade[..., :3] *= _brightness(cells)[:, None, None]
        shades.append(shade)
        depth.append(cells[..., 2].mean(axis=1) - nearer * to_viewer)  # the body is on the side of the normal
    order = np.argsort(np.concatenate(depth), kind="stable")
    faces = _smooth(np.concatenate(triangles)[order], np.concatenate(shades)[order])
    axes.add_collection(faces, autolim=False)
    return [faces]


def _smooth(triangles: Array, rgba: Array) -> Any:
    """Return an artist of triangles (n, 3, 2) with colours (n, 3, 4) at their corners, drawn in this order."""
    x, y = triangles.reshape(-1, 2).T
    mesh: Any = TriMesh(Triangulation(x, y, np.arange(len(x)).reshape(-1, 3)), rasterized=True)
    mesh.set_facecolor(rgba.reshape(-1, 4))
    return mesh


def _ribbons(ends: Array, width: float) -> Array:
    """Return two triangles (2 n, 3, 2) for each segment (n, 2, 2)."""
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    across = width / 2 * np.column_stack([-along[:, 1], along[:, 0]]) / np.where(length > 0, length, 1.0)
    a, b, c, d = ends[:, 0] - across, ends[:, 0] + across, ends[:, 1] - across, ends[:, 1] + across
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])


def _brightness(triangles: Array) -> Array:
    """Return the fraction (n,) of light that each triangle (n, 3, 3) reflects."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    cosine: Array = np.abs(normals @ LIGHT) / np.where(length > 0, length, 1.0)
    return np.minimum(0.8 + 0.2 * cosine, 1.0)  # rounding may exceed 1


def _pieces(points: Array, values: Array) -> tuple[Array, Array]:
    """Return cells (m, n, d) with values (m, n) at their corners, cut into equal pieces (pieces, m, d) with values (pieces, m)."""
    m, n, d = points.shape
    cuts = int(np.clip((PIECES / n) ** (1 / (m - 1)), 1, 8))
    face = linear_simplex(m - 1)
    grid, cells = subdivided(face, cuts)
    lattice = face.values(grid)[cells.T]  # (pieces, m, m)
    cut = np.einsum("pcm,mnd->npcd", lattice, points).reshape(-1, m, d)
    found = np.einsum("pcm,mn->npc", lattice, np.ma.filled(values, 0.0))
    missing = np.asarray(np.ma.getmaskarray(values).any(axis=0))[:, None, None]
    return cut, np.ma.MaskedArray(found, np.broadcast_to(missing, found.shape)).reshape(-1, m)


def write_film(film: Film, path: Path, suffix: str, fps: float) -> None:
    """Write a film as a .gif or an .mp4 file, by the `suffix`, for any ending of the path."""
    figure = new_figure(SIZE, interactive=False)
    figure.set_dpi(DPI)
    canvas, shown = FigureCanvasAgg(figure), _shown(figure, film)
    if suffix == ".gif":
        images = _images(canvas, shown)
        options = {"save_all": True, "append_images": images, "duration": round(1000 / fps), "loop": 0}
        next(images).save(path, format="GIF", **options)
        return
    writer = FFMpegWriter(fps=fps, extra_args=["-f", "mp4", "-pix_fmt", "yuv420p"])  # type: ignore[arg-type]
    with writer.saving(figure, str(path), DPI):
        for _ in shown:
            writer.grab_frame()


def _shown(figure: Figure, film: Film) -> Iterator[tuple[Picture, list[Any]]]:
    """Yield the pictures one after the other, shown on a figure with the layout of the first, and the artists that change."""
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
        yield picture, [title, *picture_axes.artists]


def _images(canvas: FigureCanvasAgg, shown: Iterator[tuple[Picture, list[Any]]]) -> Iterator[Image.Image]:
    """Yield an image of each picture. Axes and the colour bar are drawn once, because their text takes half of the time."""
    background: Any = None
    for picture, artists in shown:
        if background is None:
            palette = _palette(in_space=picture.d == 3)
            for artist in artists:
                artist.set_visible(False)
            canvas.draw()
            background = canvas.copy_from_bbox(canvas.figure.bbox)
            for artist in artists:
                artist.set_visible(True)
        canvas.restore_region(background)
        for artist in sorted(artists, key=lambda artist: artist.get_zorder()):
            artist.draw(canvas.get_renderer())
        image = Image.frombuffer("RGBA", canvas.get_width_height(), bytes(canvas.buffer_rgba()))
        yield image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)


def _palette(in_space: bool) -> Image.Image:
    """Return the 256 colours of all frames: those of the bar, in space in several brightnesses, and greys."""
    lights = np.linspace(0.8, 1.0, 5) if in_space else np.ones(1)
    greys = np.linspace(0.0, 1.0, 36)
    shades = COLOURS(np.linspace(0, 1, (256 - len(greys)) // len(lights)))[:, :3]
    colours = np.concatenate([(lights[:, None, None] * shades).reshape(-1, 3), np.repeat(greys[:, None], 3, axis=1)])
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.round(255 * colours).astype(np.uint8).tobytes())
    return palette
