"""Pictures of the gallery's programs: one panel for the thumbnail, all figures, then films (`FuncAnimation`) as .gif files."""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation
from sphinx.errors import ExtensionError
from sphinx_gallery.scrapers import figure_rst, matplotlib_scraper

LARGEST = 800_000  # bytes


def pictures_and_films(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Return the reST of all pictures and films of a program, as sphinx-gallery asks its scrapers for it.

    Raises
    ------
    ExtensionError
        if a film is larger than 800 kB.
    """
    if not plt.get_fignums():
        return ""
    films = [one for one in block_vars["example_globals"].values() if isinstance(one, FuncAnimation)]
    for film in films:
        plt.close(film._fig)  # no picture of its first moment
    figure = plt.figure(1)
    figure.canvas.draw()
    panel = figure.axes[0].get_tightbbox().transformed(figure.dpi_scale_trans.inverted())
    figure.savefig(next(block_vars["image_path_iterator"]), bbox_inches=panel.padded(0.05))  # number 1 is the thumbnail
    pages = [matplotlib_scraper(block, block_vars, gallery_conf)]
    for film in films:
        path = Path(next(block_vars["image_path_iterator"])).with_suffix(".gif")
        film.save(path, writer="pillow", dpi=100)
        if path.stat().st_size > LARGEST:
            raise ExtensionError(
                f"{path} has {path.stat().st_size} bytes, more than {LARGEST}. Draw fewer frames or a smaller figure."
            )
        pages.append(figure_rst([path], gallery_conf["src_dir"], "film"))
    return "\n".join(pages)
