"""Names of regions, boundaries and probes with a meaning in HTML, CSV, terminals, formulas or paths: outputs show them as text."""

from __future__ import annotations

import csv
import io
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from rich.console import Console

from skfem_stvk import ElementMesh, NodalLoad, StVK, System, VelocityVerlet, simulate, solve_static, verify
from skfem_stvk.mesh import read_mesh
from skfem_stvk.referee.rendering import rendered
from skfem_stvk.results.series import read_list

from .case import Case, Verdict, Wrong, is_readable

#: Names by their description.
NAMES = {
    "plain": "plain",
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
    "bell": "a\x07b",
    "newline": "a\nb",
    "carriage return": "a\rb",
    "tab": "a\tb",
    "vertical tab": "a\x0bb",
    "line separator": "a\u2028b",
    "right to left": "\u202egnp.exe",
    "surrogate": "\ud800",
    "byte order mark": "\ufeffa",
    "not a character": "\uffff",
    "combining": "e\u0301",
    "emoji": "😀",
    "rich": "[bold red]x[/bold red]",
    "rich end": "[/]",
    "rich link": "[link=file:///etc/passwd]x[/link]",
    "formula": "$\\frac{1}{",
    "dollar": "$",
    "underscore": "_hidden",
    "quotes": "'\"`",
    "comma": 'a,b;"c"',
    "backslash": "a\\b\\",
    "parents": "../../up",
    "slash": "a/b",
    "space": " ",
    "long": "x" * 20_000,
    "long words": "word " * 2_000,
}
#: Names that a file may have.
FILES = {name: text for name, text in NAMES.items() if not set("/\0") & set(text) and len(text) < 200 and text != "\ud800"}
#: Control characters of terminals.
CONTROL = {chr(code) for code in (*range(32), 127, *range(128, 160))} - {"\n"}


def cases() -> Iterator[Case]:
    """Yield all names in all roles."""
    roles: dict[str, Callable[[str, Path], None]] = {
        "a region in the report": in_report,
        "a region in a VTU file": in_vtu,
        "a probe in a ledger": in_ledger,
        "a probe in a picture": in_picture,
        "a region in a picture": in_field,
        "an unknown place": in_message,
        "a region in a mesh file": in_mesh_file,
    }
    for role, attempt in roles.items():
        for name, text in NAMES.items():
            quick = name == "script" and attempt is in_vtu
            yield Case(f"{name} as {role}", partial(attempt, text), accept, is_printable, quick=quick)
    for name, text in FILES.items():
        yield Case(f"{name} as a series of files", partial(in_path, text), accept, is_printable)


def accept(result: None) -> None:
    """Accept every result, because `attempt` itself raises `Wrong` for faults."""


def is_printable(error: BaseException) -> bool:
    """Return whether an error is readable, has no control characters and has fewer than 5000 characters."""
    return is_readable(error) and not CONTROL & set(str(error)) and len(str(error)) < 5_000


def body(name: str) -> ElementMesh:
    """Return a few tetrahedra in two regions, one with this name."""
    mesh = skfem.MeshTet().refined(0)
    return ElementMesh(mesh.p, mesh.t, {name: np.array([0, 1]), "rest": np.arange(2, mesh.nelements)}, {}, {name: np.array([0, 1])})


def terms(name: str) -> list[StVK]:
    """Return a material for each region."""
    return [StVK(young=2.0, poisson=0.3, density=1.0, region=name), StVK(young=3.0, poisson=0.2, density=1.0, region="rest")]


class Tags(HTMLParser):
    """Parser that collects the tags and attributes of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[Any] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        if tag not in ("path", "use", "g", "defs", "style", "clippath", "rect"):  # the pictures differ from run to run
            self.found.append((tag, sorted(name for name, _ in attributes)))


def in_report(name: str, folder: Path) -> None:
    """Write the report of `verify` with the name.

    The page must have the same tags as with a plain name, the JSON file must contain the name, and the terminal must get no control
    characters.
    """
    report = verify(body(name), terms(name), quiet=True)
    report.save(folder / "report")
    page = (folder / "report" / "report.html").read_text(encoding="utf-8")
    if Tags(page).found != plain_tags(folder):
        raise Wrong(Verdict.SILENT, "the page has other tags than with a plain name")
    written = json.loads((folder / "report" / "report.json").read_text(encoding="utf-8"))
    if name not in json.dumps(written, ensure_ascii=False) and json.dumps(name)[1:-1] not in json.dumps(written):
        raise Wrong(Verdict.LOSS, "the name is not in report.json")
    stream = io.StringIO()
    Console(file=stream, width=124, force_terminal=False).print(rendered(report))
    for text in (str(report), stream.getvalue()):
        refuse_control_characters(text)


@lru_cache
def plain_tags(folder: Path) -> list[Any]:
    """Return the tags of the page with a plain name."""
    verify(body("plain"), terms("plain"), quiet=True).save(folder / "plain")
    return Tags((folder / "plain" / "report.html").read_text(encoding="utf-8")).found


def refuse_control_characters(text: str) -> None:
    """Raise `Wrong` if the text contains control characters of terminals."""
    control = sorted(CONTROL & set(text))
    if control:
        raise Wrong(Verdict.SILENT, f"control characters on the terminal: {control!r}")


def in_vtu(name: str, folder: Path) -> None:
    """Write a VTU file with the name. The file must be valid XML, and `read_mesh` must return the region."""
    mesh = body(name)
    system = System(mesh, [*terms(name), NodalLoad([7], (0.0, 0.0, 1e-3))], fixed=[(np.array([0, 1, 2, 3]), "xyz")])
    path = solve_static(system, steps=1, quiet=True).save(folder / "body.vtu")
    ET.parse(path)
    again = read_mesh(path)
    if name not in again.subdomains and name.encode("unicode_escape").decode() not in again.subdomains:
        raise Wrong(Verdict.LOSS, f"regions read = {[one[:50] for one in again.subdomains]}; expected the written name")
    if mesh.nt != again.nt:
        raise Wrong(Verdict.LOSS, f"elements read = {again.nt}; expected {mesh.nt}")


def run(name: str, **options: Any) -> Any:
    """Run a short motion with a probe of this name."""
    system = System(body("plain"), terms("plain"))
    v0 = 0.01 * np.cos(np.arange(system.ndofs))
    return simulate(system, VelocityVerlet(dt=1e-3), until=5e-3, v0=v0, probes={name: [1]}, quiet=True, **options)


def in_ledger(name: str, folder: Path) -> None:
    """Save a ledger with the name. All lines of the table must have equally many cells, and its head must contain the name."""
    done = run(name)
    path = done.ledger.save(folder / "ledger.csv")
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
    if len(lines) != 1 + done.ledger.steps or {len(line) for line in lines} != {len(done.ledger)}:
        raise Wrong(Verdict.SILENT, f"a table of {len(lines)} lines, of {sorted({len(line) for line in lines})} cells")
    if f"{name} x [m]" not in lines[0] and f"{name} x [m]".encode("unicode_escape").decode() not in lines[0]:
        raise Wrong(Verdict.LOSS, f"the head of the table does not contain the name: {lines[0]!r:.300}")
    refuse_control_characters(repr(done.ledger))


def in_picture(name: str, folder: Path) -> None:
    """Draw a ledger with the name as a label."""
    run(name).ledger.plot(folder / "ledger.png")
    picture(folder / "ledger.png")


def in_field(name: str, folder: Path) -> None:
    """Draw a body with the name as the label."""
    state = run("plain").state
    from skfem_stvk.results import plot

    plot(state, "von_mises_stress", path=folder / "body.png", label=name)
    picture(folder / "body.png")


def picture(path: Path) -> None:
    """Raise an error unless the file is a picture with at most 8000 pixels in each direction."""
    import matplotlib.image

    height, width = matplotlib.image.imread(path).shape[:2]
    if max(height, width) > 8_000:
        raise Wrong(Verdict.SILENT, f"a picture of {width} x {height} pixels")


def in_message(name: str, folder: Path) -> None:
    """Use the name for an unknown boundary. The message must be printable."""
    System(body("plain"), terms("plain"), fixed={name: "xyz"})
    if name != "plain":
        raise Wrong(Verdict.SILENT, "accepted")


def in_mesh_file(name: str, folder: Path) -> None:
    """Read a Gmsh file with the name of a group. The mesh must have the name, or the file is refused."""
    (folder / "body.msh").write_text(MSH.format(name=name), encoding="utf-8", errors="surrogatepass", newline="")
    mesh = read_mesh(folder / "body.msh")
    if next(iter(mesh.subdomains)) not in (name, name.strip(), name.replace('"', "")):  # quotes end a name in Gmsh files
        raise Wrong(Verdict.SILENT, f"read as {list(mesh.subdomains)!r:.200}")


MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 1 "{name}"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
1
1 4 2 1 1 1 2 3 4
$EndElements
"""


def in_path(name: str, folder: Path) -> None:
    """Save a series of files under the name. The series must list its files, all files must exist, and no other file is written."""
    inner = folder / "inner"
    inner.mkdir()
    run("plain", save=inner / f"{name}.pvd", every=1)
    listed = read_list(inner / f"{name}.pvd")
    if len(listed) != 6 or not all((inner / file).is_file() for _, file in listed):
        raise Wrong(Verdict.LOSS, f"the series lists {listed!r:.300}")
    if {path.name for path in folder.iterdir()} != {"inner"}:
        raise Wrong(Verdict.LOSS, "files were written elsewhere")
