"""Text formats that meshio reads, each checked before: a table of the formats that declare their counts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .stream import Counts, CutOff, Damaged, Source, check_last_line

#: Groups of all heads of a file so far.
Known = dict[str, str]
#: Numbers per entry: a constant, or a function of the heads so far; 0 for the width of the first entry.
Width = int | Callable[[Known], int]
#: Maximum number of lines of a head.
LONGEST_HEAD = 200


class Section(NamedTuple):
    """Section of a text file: its head, and entries of numbers.

    Attributes
    ----------
    head
        Expression for its first lines. The groups `nodes`, `cells` and `others` are numbers of entries, in this order.
    widths
        Numbers of an entry for each of these groups.
    by_first
        Numbers per cell by its first number, instead of a width; all cells may be followed by the same number of other numbers.
    repeats
        Whether the section may occur several times; the group `repeated` of another head states the number.
    """

    head: str
    widths: tuple[Width, ...] = ()
    by_first: Callable[[int], int] | None = None
    repeats: bool = False


class Text(NamedTuple):
    """Text format.

    Attributes
    ----------
    comments
        Beginnings of lines that are left out.
    needed
        First words of heads that must be there.
    sections
        All allowed sections, in any order.
    numbered
        Whether the entries of nodes and cells begin with 0, 1, ... or 1, 2, ...
    """

    comments: tuple[str, ...]
    needed: tuple[str, ...]
    sections: tuple[Section, ...]
    numbered: bool = False


def count(what: str) -> str:
    """Return an expression for a number of nodes, cells or others."""
    return rf"(?P<{what}>\d{{1,18}})"


#: Numbers per entry of SU2's elements including their type, by VTK's types.
SU2 = {3: 3, 5: 4, 9: 5, 10: 5, 12: 9, 13: 7, 14: 6}
#: The head of a polygon file whose faces have one list, and of its elements.
PLY = (
    rf"ply\nformat (?P<form>\w+) 1\.0\nelement vertex {count('nodes')}\n(?P<of_vertex>(?:property \w+ \w+\n)+)"
    rf"element face {count('cells')}\nproperty list (?P<of_face>\w+ \w+) vertex_indices\n"
    r"(?P<more>(?:property \w+ \w+\n)*)end_header"
)
TEXTS = {
    ".node": Text(
        ("#",),
        ("",),
        (
            Section(
                rf"{count('nodes')}\s+3\s+(?P<attributes>\d+)\s+(?P<markers>\d+)",
                (lambda known: 4 + int(known["attributes"]) + int(known["markers"]),),
            ),
        ),
        numbered=True,
    ),
    ".ele": Text(
        ("#",),
        ("",),
        (Section(rf"{count('cells')}\s+4\s+(?P<attributes>\d+)", (lambda known: 5 + int(known["attributes"]),)),),
        numbered=True,
    ),
    ".su2": Text(
        ("%",),
        ("NDIME", "NPOIN", "NELEM"),
        (
            Section(r"NDIME=\s*\d"),
            Section(rf"NPOIN=\s*{count('nodes')}(\s.*)?", (0,)),
            Section(rf"NELEM=\s*{count('cells')}", by_first=SU2.__getitem__),
            Section(r"NMARK=\s*(?P<repeated>\d+)"),
            Section(rf"MARKER_TAG=.*\nMARKER_ELEMS=\s*{count('cells')}", by_first=SU2.__getitem__, repeats=True),
            Section(r"(?!NDIME|NPOIN|NELEM|NMARK|MARKER_)\w+=.*"),
        ),
    ),
    ".ply": Text(
        ("comment", "obj_info"),
        ("ply",),
        (Section(PLY, (lambda known: known["of_vertex"].count("\n"),), by_first=lambda corners: 1 + corners),),
    ),
}


def counted(path: Path) -> Counts:
    """Return the number of nodes and of elements that a file of `TEXTS` declares, if its content matches them exactly."""
    text = TEXTS[path.suffix.lower()]
    known, seen, found, repeats = Known(), set[str](), {"nodes": 0, "cells": 0, "others": 0}, 0
    with Source(path, comments=text.comments) as source:
        for section, head in heads(source, text.sections):
            name = re.split("[^A-Za-z_]", head[0], maxsplit=1)[0]
            if name in seen and not section.repeats:
                raise Damaged(f"{head[0][:60]!r} was found, but {name or 'a head'} occurred before; expected it once")
            seen.add(name)
            repeats += section.repeats
            known |= head.groupdict()
            numbers = {what: int(number) for what, number in head.groupdict().items() if what in found}
            for index, (what, number) in enumerate(numbers.items()):
                found[what] += number
                if index == len(section.widths) and section.by_first:
                    check_rows(source.rows(what, number), section.by_first)
                else:
                    entries(source, what, number, section.widths[index], known, text.numbered)
        check_last_line(source.file)
    if missing := [name for name in text.needed if name not in seen]:
        raise CutOff(f"it has no {missing[0] or 'head'}")
    if (declared := int(known.get("repeated", 0))) != repeats:
        raise Damaged(f"{declared} markers are declared, {repeats} were found")
    return found["nodes"], found["cells"]


def heads(source: Source, sections: tuple[Section, ...]) -> Iterator[tuple[Section, re.Match[str]]]:
    """Yield each section with its head, which is read; its entries must be read before the next section."""
    lines: list[str] = []
    while len(lines) < LONGEST_HEAD and (line := source.line()):
        lines.append(line)
        matches = ((section, re.fullmatch(section.head, "\n".join(lines))) for section in sections)
        if found := next(((section, match) for section, match in matches if match), None):
            lines = []
            yield found
    if lines:
        raise Damaged(f"{lines[0][:60]!r} was found; expected the beginning of a section, or numbers")


def entries(source: Source, what: str, number: int, width: Width, known: Known, numbered: bool) -> None:
    """Read entries of equal width; refuse others, and refuse ids that are not consecutive if entries begin with ids."""
    columns = (width(known) if callable(width) else width) or source.columns()
    values = source.numbers(what, number, columns)
    if numbered and number:
        first = int(values[0, 0] == 1)
        if len(bad := np.flatnonzero(values[:, 0] != first + np.arange(number))):
            found = values[bad[0], 0]
            raise Damaged(f"the ids of its {what} are not {first}, {first + 1}, ...: {found:g} instead of {first + bad[0]}")


def check_rows(rows: list[list[str]], by_first: Callable[[int], int]) -> None:
    """Refuse rows that are shorter than their first number says, or with different numbers of further entries."""
    try:
        more = {len(row) - by_first(int(row[0])) for row in rows}
    except (KeyError, ValueError) as error:
        raise Damaged(f"{str(error.args[0])[:60]!r} was found; expected the type or the number of nodes of an element") from error
    if len(more) > 1 or min(more, default=0) < 0:
        raise Damaged("elements have other numbers of nodes than their type or number declares")


def tetgen(path: Path) -> Counts:
    """Return the number of nodes and of elements of TetGen's pair of files."""
    with Source(path.with_suffix(".ele"), comments=("#",)) as source:
        if source.line().split()[1:2] == ["10"]:
            raise Damaged("its elements have 10 nodes, which are not read. Write it with 4: tetgen without -o2")
    nodes, elements = map(counted, tetgen_files(path))
    return nodes[0], elements[1]


def tetgen_files(path: Path) -> list[Path]:
    """Return both files of TetGen's pair."""
    return [path.with_suffix(".node"), path.with_suffix(".ele")]
