"""Pictures of a report, and the HTML page that shows them. This module imports matplotlib, so it is imported only when needed."""

from __future__ import annotations

import io
from importlib.resources import files

from jinja2 import Environment
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .case import OURS, REFERENCE
from .checks.precision import TEXTBOOK
from .judgement import location_in_words
from .results import Findings

COLOURS = {OURS: "#0072B2", REFERENCE: "#D55E00", TEXTBOOK: "#009E73"}
MARKERS = {"W": "s", "F": "o", "K": "^"}


def error_against_strain(report: Findings) -> Figure:
    """Return the plot of the error of F against strain, without and with a large rotation, at the origin and far from it."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, 2, sharey=True))
    styles = dict(zip(sorted({row["offset_m"] for row in report.precision}), ("-", "--", ":"), strict=False))
    for axes, degrees in zip(panels, (0, 170), strict=True):
        for form, colour in COLOURS.items():
            for offset, style in styles.items():
                rows = [r for r in report.precision if (r["form"], r["rotation_deg"], r["offset_m"]) == (form, degrees, offset)]
                label = f"{form}, at {offset:g} m"
                axes.loglog([r["strain"] for r in rows], [max(r["error"], 1e-17) for r in rows], style, color=colour, label=label)
        axes.set(xlabel="strain", title="no rotation" if not degrees else f"rotated by {degrees} degrees", ylim=(1e-17, 100))
        axes.invert_xaxis()
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("error of F, relative to 50 digits")
    if report.precision:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center", fontsize=8)
    return figure


def speed_against_error(report: Findings) -> Figure:
    """Return the plot of the time of W, F and K against their errors. Points at the lower left are better."""
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    for row in report.speed:
        error = report.errors.get(row["player"], {}).get(row["quantity"])
        if error is None:
            continue
        style = {"marker": MARKERS[row["quantity"]], "color": COLOURS[row["player"]], "ms": 8, "linestyle": ""}
        axes.loglog(row["ns_per_element"], max(error, 1e-17), label=f"{row['quantity']}, {row['player']}", **style)
    axes.set(xlabel="time [ns per element]", ylabel="error at 0.1 % strain, relative to 50 digits")
    axes.grid(alpha=0.3)
    axes.margins(0.2)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    return figure


def as_svg(figure: Figure) -> str:
    """Return the figure as SVG text."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def page(report: Findings) -> str:
    """Return the report as the text of a self-contained HTML file, including the pictures."""
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["in_words"] = location_in_words
    template = environment.from_string(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    measured = "lines" not in report.header
    pictures = [as_svg(error_against_strain(report)), as_svg(speed_against_error(report))] if measured else []
    return template.render(report=report, header=report.header, pictures=pictures)
