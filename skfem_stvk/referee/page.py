"""The report as one HTML file that needs no other."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment

from .places import in_words
from .plots import as_svg, error_against_strain, speed_against_error
from .report import Report


def page(report: Report) -> str:
    """HTML with the plots inside."""
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["in_words"] = in_words
    template = environment.from_string(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    pictures = [as_svg(error_against_strain(report)), as_svg(speed_against_error(report))]
    return template.render(report=report, header=report.header, pictures=pictures)
