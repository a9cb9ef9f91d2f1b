"""Options of the documentation site: `python -m sphinx -W --keep-going -b html docs build/site`; it needs no network."""

import inspect
import re
import sys
from importlib.metadata import distribution
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

if sys.version_info < (3, 11):
    raise SystemExit(f"The documentation needs Python 3.11 or later, because Sphinx 9 does; this is {sys.version.split()[0]}.")

sys.path.insert(0, str(Path(__file__).parent))  # films.py

project, author = "skfem-stvk", "the skfem-stvk developers"
copyright = f"{author}, BSD-3-Clause"
version = release = version_of("skfem-stvk")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
templates_path = ["_templates"]
exclude_patterns = ["examples", "programs", "scenes", "gallery/sg_execution_times.rst"]
default_role = "code"  # `u` in a docstring is code

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 4

autosummary_generate = True
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88
numpydoc_show_class_members = False  # the template of classes lists them

# Of this wheel one file, with all fonts: others of MathJax load parts from the network.
_mathjax = next(file for file in distribution("sphinx-mathjax-offline").files or () if file.name == "tex-svg-full.js")
mathjax_path = _mathjax.name
html_static_path = [str(_mathjax.locate()), "_static"]
html_css_files = ["site.css"]

copybutton_prompt_text, copybutton_prompt_is_regexp = r">>> |\.\.\. |\$ ", True

sphinx_gallery_conf = {
    "examples_dirs": ["examples"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"/ex\d\d_",
    "image_scrapers": ("films.pictures_and_films",),
    "within_subsection_order": "FileNameSortKey",
    "backreferences_dir": "gallery/backreferences",
    "doc_module": ("skfem_stvk",),
    "reference_url": {"skfem_stvk": None},
    "show_memory": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,  # that page loads scripts from the network
    "download_all_examples": False,
}

html_theme = "pydata_sphinx_theme"
html_title = "skfem-stvk"
html_context = {"default_mode": "auto"}
html_show_search_summary = False  # browsers refuse to fetch summaries for file://
html_show_sourcelink = html_copy_source = False
html_theme_options = {"navigation_with_keys": False, "navbar_align": "left", "header_links_before_dropdown": 7}


def _as_written(app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, returns: str | None) -> Any:
    """Return the signature with annotations as the source has them; evaluated, `ArrayLike` is a union of forty words."""
    if what not in ("class", "function", "method") or signature is None:
        return None
    found = inspect.signature(obj)
    parameters = [one for one in found.parameters.values() if one.name not in ("self", "cls")]
    plain = [one.replace(default=one.empty if one.default is one.empty else _Shown(one.default)) for one in parameters]
    text = re.sub(r"(: |-> )'([^']*)'", r"\1\2", str(found.replace(parameters=plain)))
    arguments, arrow, result = text.partition(" -> ")
    return arguments, result if arrow and what != "class" else None


class _Shown:
    """Default of a parameter, printed as an expression."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __repr__(self) -> str:
        text = self.value.__name__ if isinstance(self.value, type) else repr(self.value)
        return "..." if text.startswith("<") else text


def _to_the_gallery(app: Any, name: str, text: list[str]) -> None:
    """Let links to programs of the gallery lead to their pages; in the repository they open the programs."""
    text[0] = re.sub(r"\]\([./]*examples/(ex\d\d_\w+)\.py\)", r"](/gallery/\1.rst)", text[0])


def setup(app: Any) -> None:
    """Connect to the events of Sphinx."""
    app.connect("source-read", _to_the_gallery)
    app.connect("autodoc-process-signature", _as_written)
