"""Names of regions, probes and locations with a meaning in HTML, CSV, terminals, formulas or paths: outputs show them as text."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from functools import cache, partial
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import skfem

from skfem_stvk import ElementMesh, StVK, System, VelocityVerlet, read_mesh, simulate, solve_static, verify

from .case import CONTROL, Case, Verdict, Wrong, is_readable
from .tiny_files import MSH

#: Names by their description.
NAMES = {
    "script": "<script>alert(1)</script>",
    "end of an attribute": "\"><img src=x onerror='alert(1)'>",
    "entities": "&lt;b&gt;&amp;&#x41;",
    "comment": "<!-- ]]> -->",
    "template": "{{ 7 * 7 }}{% for x in y %}",
    "percent": "%s%n%d{0}",
    "colour": "\x1b[31mred\x1b[0m",
    "title of the terminal": "\x1b]0;gone\x07",
    "C1": "\x9b31m",
    "NUL": "a\0b",
    "newline": "a\nb",
    "carriage return": "a\rb",
    "tab": "a\tb",
    "line separator": "a\u2028b",
    "right to left": "\u202egnp.exe",
    "surrogate": "\ud800",
    "byte order mark": "\ufeffa",
    "not a character": "\uffff",
    "emoji": "😀",
    "rich": "[bold red]x[/bold red]",
    "rich end": "[/]",
    "formula": "$\\frac{1}{",
    "underscore": "_hidden",
    "quotes": "'\"`",
    "comma": 'a,b;"c"',
    "parents": "../../up",
    "space": " ",
    "long": "x" * 20_000,
}
#: Names for the report, which takes some seconds.
PAGES = ("script", "end of an attribute", "entities", "template", "colour", "NUL", "surrogate", "rich", "formula", "long")


def cases() -> Iterator[Case]:
    """Yield all names in all roles."""
    roles: dict[str, Callable[[str, Path], None]] = {
        "a region in the report": in_report,
        "a region in a VTU file": in_vtu,
        "a probe in a ledger": in_ledger,
        "an unknown place": in_message,
        "a region in a mesh file": in_mesh_file,
    }
    for role, attempt in roles.items():
        for name, text in NAMES.items():
            quick = name == "script" and attempt is in_vtu
            if attempt is not in_report or name in PAGES:
                yield Case(f"{name} as {role}", partial(attempt, text), lambda result: None, is_printable, 300.0, quick=quick)


def is_printable(error: BaseException) -> bool:
    """Return whether an error is readable, has no control characters and has fewer than 5000 characters."""
    return is_readable(error) and not CONTROL & set(str(error)) and len(str(error)) < 5_000


def body(name: str) -> ElementMesh:
    """Return a few tetrahedra in two regions, one with this name."""
    mesh = skfem.MeshTet()
    return ElementMesh(mesh.p, mesh.t, {name: np.array([0, 1]), "rest": np.arange(2, mesh.nelements)})


def terms(name: str) -> list[StVK]:
    """Return a material for each region."""
    return [StVK(young=2.0, poisson=0.3, density=1.0, region=name), StVK(young=3.0, poisson=0.2, density=1.0, region="rest")]


class Tags(HTMLParser):
    """Parser that collects the tags and attributes of a page, without pictures, which differ from run to run."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[Any] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag not in ("path", "use", "g", "defs", "style", "clippath", "rect"):
            self.found.append((tag, sorted(name for name, _ in attributes)))


def in_report(name: str, folder: Path) -> None:
    """Write the report of `verify`. The page must have the same tags as with a plain name, and no control characters in text."""
    report = verify(body(name), terms(name), quiet=True)
    report.save(folder / "report")
    if Tags((folder / "report" / "report.html").read_text(encoding="utf-8")).found != plain_tags():
        raise Wrong(Verdict.SILENT, "the page has other tags than with a plain name")
    written = json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))
    if name not in json.dumps(written, ensure_ascii=False) and json.dumps(name)[1:-1] not in json.dumps(written):
        raise Wrong(Verdict.LOSS, "the name is not in report.json")
    if CONTROL & set(str(report)):
        raise Wrong(Verdict.SILENT, "control characters on the terminal")


@cache
def plain_tags() -> list[Any]:
    """Return the tags of the page with a plain name."""
    with TemporaryDirectory() as folder:
        verify(body("plain"), terms("plain"), quiet=True).save(folder)
        return Tags((Path(folder) / "report.html").read_text(encoding="utf-8")).found


def in_vtu(name: str, folder: Path) -> None:
    """Write a VTU file with the name. The file must be valid XML, and `read_mesh` must return the region."""
    result = solve_static(System(body(name), terms(name), fixed=[(np.arange(4), "xyz")]), quiet=True)
    path = result.save(folder / "body.vtu")
    ET.parse(path)
    if not {name, name.encode("unicode_escape").decode()} & read_mesh(path).subdomains.keys():
        raise Wrong(Verdict.LOSS, f"regions read = {[one[:50] for one in read_mesh(path).subdomains]}; expected the written name")


def in_ledger(name: str, folder: Path) -> None:
    """Save a ledger with the name. All lines of the table must have equally many cells, and its head must contain the name."""
    system = System(body("plain"), terms("plain"))
    v0 = 0.01 * np.cos(np.arange(system.ndofs))
    run = simulate(system, VelocityVerlet(dt=1e-3), until=5e-3, v0=v0, probes={name: [1]}, quiet=True)
    with run.ledger.save(folder / "ledger.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
    if len(lines) != 1 + run.ledger.steps or {len(line) for line in lines} != {len(run.ledger)}:
        raise Wrong(Verdict.SILENT, f"a table of {len(lines)} lines, of {sorted({len(line) for line in lines})} cells")
    if not {f"{name} x [m]", f"{name} x [m]".encode("unicode_escape").decode()} & set(lines[0]):
        raise Wrong(Verdict.LOSS, f"the head of the table does not contain the name: {lines[0]!r:.300}")
    if CONTROL & set(repr(run.ledger)):
        raise Wrong(Verdict.SILENT, "control characters on the terminal")


def in_message(name: str, folder: Path) -> None:
    """Use the name for an unknown boundary. The message must be printable."""
    System(body("plain"), terms("plain"), fixed={name: "xyz"})
    raise Wrong(Verdict.SILENT, "accepted")


def in_mesh_file(name: str, folder: Path) -> None:
    """Read a Gmsh file with the name of a group. The mesh must have the name, or the file is refused."""
    names = f'$EndMeshFormat\n$PhysicalNames\n1\n3 1 "{name}"\n$EndPhysicalNames\n'
    text = MSH.format(last=4).replace("$EndMeshFormat\n", names)
    (folder / "body.msh").write_text(text, encoding="utf-8", errors="surrogatepass", newline="")
    mesh = read_mesh(folder / "body.msh")
    if next(iter(mesh.subdomains)) not in (name, name.strip(), name.replace('"', "")):  # quotes end a name in Gmsh files
        raise Wrong(Verdict.SILENT, f"read as {list(mesh.subdomains)!r:.200}")
