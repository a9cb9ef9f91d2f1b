"""Mesh files that are truncated, changed, or not files: `read_mesh` returns the mesh that was written, or refuses the file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from skfem_stvk import ElementMesh, StVK, System
from skfem_stvk.mesh import read_mesh

from . import tiny_files
from .case import Case, Verdict, Wrong
from .mesh_formats import FORMATS, REAL, written

Change = Callable[[bytes], bytes]

#: Replacements of a number of entries, of an id at its definition, of a reference to a node, and of a coordinate.
COUNTS = ("+1", "-1", "0", "-7", "1000000000", "1000000000000000", "99999999999999999999", "4294967304", "x", "")
IDS = ("0", "-3", "1", "4294967299", "1000000000", "9223372036854775807", "18446744073709551619", "nan", "3.5", "x")
REFERENCES = ("-5", "-2", "900", "4294967297", "4294967300", "9223372036854775808", "1e9", "nan", "2.5", "x")
COORDINATES = ("nan", "inf", "-inf", "1e999", "x", "1..0", "")


def cases() -> Iterator[Case]:
    """Yield all mesh files."""
    yield from cuts()
    yield from numbers()
    yield from rows()
    yield from tiny_files.cases()


def cuts() -> Iterator[Case]:
    """Yield files truncated at every twentieth of their length, and by a few bytes."""
    for name in FORMATS:
        for percent in range(5, 100, 5):
            yield mutated(f"{name}: cut at {percent} %", name, partial(cut, part=percent / 100), quick=percent == 85)
        for few in (2, 3, 4, 9):
            yield mutated(f"{name}: {few} bytes cut off", name, partial(shorter, few=few))


def numbers() -> Iterator[Case]:
    """Yield files in which a number of entries, an id, a reference or a coordinate is replaced."""
    for name, form in FORMATS.items():
        kinds: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
            "count": (form.counts, COUNTS),
            "id": (form.ids, IDS),
            "reference": (form.references, REFERENCES),
        }
        if (form.counts or form.ids) and form.suffix != ".ele":
            kinds["coordinate"] = (
                ((rf"[\s\"]({REAL})[\s<,\"]+-?[\dy]",), COORDINATES) if "binary" not in name and "base64" not in name else ((), ())
            )
        for kind, (patterns, values) in kinds.items():
            for number, pattern in enumerate(patterns):
                for value in values:
                    change = partial(replaced, pattern=pattern, value=value)
                    yield mutated(f"{name}: {kind} {number} is {value or 'nothing'}", name, change, quick=value == "-1")


def rows() -> Iterator[Case]:
    """Yield files with a duplicate row of an element, with a missing row that the header counts, or with a duplicate section."""
    for name, form in FORMATS.items():
        if form.element:
            yield mutated(f"{name}: an element twice", name, partial(repeated, row=form.element, times=2))
            if form.counted:
                yield mutated(f"{name}: an element missing", name, partial(repeated, row=form.element, times=0), quick=True)
    for section in (b"$Nodes", b"$Elements"):
        for name in ("msh 2.2", "msh 4.1", "msh 2.2 binary", "msh 4.1 binary"):
            yield mutated(f"{name}: a second {section.decode()}", name, partial(second, section=section))


def cut(content: bytes, part: float) -> bytes:
    """Return the first part of a file."""
    return content[: int(part * len(content))]


def shorter(content: bytes, few: int) -> bytes:
    """Return a file without its last bytes."""
    return content[:-few]


def replaced(content: bytes, pattern: str, value: str) -> bytes:
    """Return a file in which the number matched by `pattern` is replaced, or changed by one."""
    found = re.search(pattern.encode(), content)
    if found is None:
        raise LookupError(f"The file contains no match of {pattern!r}.")
    new = value
    if value in ("+1", "-1") and found[1].isalnum():
        new = str(int(found[1]) + int(value))
    return content[: found.start(1)] + new.encode() + content[found.end(1) :]


def repeated(content: bytes, row: str, times: int) -> bytes:
    """Return a file in which the row matched by `row` is repeated `times` times; 0 removes it."""
    found = re.search(row.encode(), content)
    if found is None:
        raise LookupError(f"The file contains no match of {row!r}.")
    return content[: found.start()] + times * found[0] + content[found.end() :]


def second(content: bytes, section: bytes) -> bytes:
    """Return a Gmsh file with a duplicate section."""
    end = section.replace(b"$", b"$End")
    body = content[content.index(section) : content.index(end)] + end + b"\n"
    return content + body


def mutated(name: str, file: str, change: Change, quick: bool = False) -> Case:
    """Return the case of a changed file: `read_mesh` must refuse it, or return the mesh before the change."""

    def attempt(folder: Path) -> ElementMesh:
        whole = written(file)
        path = folder / f"body{whole.suffix}"
        for suffix, content in whole.companions.items():
            path.with_suffix(suffix).write_bytes(content)
        path.write_bytes(change(whole.content))
        mesh = read_mesh(path)
        if not np.array_equal(mesh.t, whole.mesh.t):
            System(mesh, StVK(young=1.0, poisson=0.3))  # refuses duplicate elements and elements without volume
        return mesh

    return Case(name, attempt, partial(same_mesh, file=file), quick=quick)


def same_mesh(mesh: ElementMesh, file: str) -> None:
    """Raise `Wrong` unless vertices, elements and names equal those that were written."""
    whole = written(file).mesh
    if not (mesh.nt == whole.nt and np.array_equal(mesh.t, whole.t) and np.array_equal(mesh.p, whole.p)):
        raise Wrong(
            Verdict.SILENT,
            f"read {mesh.nt} elements on {mesh.nv} vertices; expected {whole.nt} on {whole.nv}, with the same ids and coordinates",
        )
    if {name: list(ids) for name, ids in mesh.subdomains.items()} != {name: list(ids) for name, ids in whole.subdomains.items()}:
        raise Wrong(
            Verdict.SILENT,
            f"read the subdomains {list(mesh.subdomains)}; expected {list(whole.subdomains)} with the same elements",
        )
