"""Films by matplotlib. It is imported here, so this module is imported only when a film is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from .matplotlib_plot import COLOURS, EDGE, Stage, new_figure

if TYPE_CHECKING:
    from .animation import Film
    from .picture import Picture

SIZE, DPI = (7.0, 4.5), 120  # an even number of pixels, as .mp4 has it


def write(film: Film, path: Path, suffix: str, fps: float) -> None:
    """Write a film as a .gif or an .mp4 file, by the suffix, whatever the path ends in."""
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
    """One picture after the other, on a figure that stays as it is laid out for the first."""
    view, pictures = film.developed()
    title = figure.suptitle(" ", fontsize=11, color=EDGE)
    stage = None
    for words, picture in pictures:
        title.set_text(words)
        if stage is None:
            stage = Stage(figure, picture, view)
            stage.show(picture)
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        else:
            stage.show(picture)
        yield picture


def _image(canvas: FigureCanvasAgg, palette: Image.Image) -> Image.Image:
    canvas.draw()
    image = Image.frombuffer("RGBA", canvas.get_width_height(), bytes(canvas.buffer_rgba()))
    return image.convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)


def _palette(in_space: bool) -> Image.Image:
    """The 256 colours of all frames: those of the bar, in space in several lights, and greys."""
    lights = np.linspace(0.8, 1.0, 5) if in_space else np.ones(1)
    greys = np.linspace(0.0, 1.0, 36)
    shades = COLOURS(np.linspace(0, 1, (256 - len(greys)) // len(lights)))[:, :3]
    colours = np.concatenate([(lights[:, None, None] * shades).reshape(-1, 3), np.repeat(greys[:, None], 3, axis=1)])
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.round(255 * colours).astype(np.uint8).tobytes())
    return palette
