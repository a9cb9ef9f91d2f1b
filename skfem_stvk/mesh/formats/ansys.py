"""Fluent's .msh files as meshio writes and reads them, where cells stand by their vertices: whether they hold what they declare."""

from __future__ import annotations

import re
from pathlib import Path

from .source import Damaged, Source

#: Nodes of the cells by their types.
CELLS = {1: 3, 2: 4, 3: 4, 4: 8, 5: 5, 6: 6}
#: A section: 10 for points, 12 for cells, after 20 or 30 if its numbers are binary in 32 or 64 bits; its zone, first and last number in
#: hexadecimals, type of the zone, and dimension or type of the cells.
SECTION = re.compile(r"\((20|30|)(10|12) \((\w+) (\w+) (\w+) (\w+)(?: (\w+))?\)(\()?\)?\)?")


def check(path: Path) -> tuple[int, int]:
    """Number of points and cells."""
    declared, found = {"10": 0, "12": 0}, {"10": 0, "12": 0}
    with Source(path) as source:
        while line := source.line():
            section = SECTION.fullmatch(line)
            if section is None:
                if not re.fullmatch(r"\([012] .*\)", line):
                    raise Damaged(
                        f"{line[:60]!r} stands where points or cells should; Fluent's own files hold faces, not cells: convert them"
                    )
                continue
            binary, kind, _, *ends, _, shape, opens = section.groups()
            first, last = (int(number, 16) for number in ends)
            if not opens:
                declared[kind] = last
                continue
            columns = int(shape or "0", 16) if kind == "10" else CELLS.get(int(shape or "0", 16), 0)
            if not columns:
                raise Damaged(f"{line[:60]!r} is of a type that is not known here")
            entries(source, last - first + 1, columns, binary, kind)
            found[kind] += last - first + 1
    for what, kind in (("points", "10"), ("cells", "12")):
        if declared[kind] != found[kind]:
            raise Damaged(f"{declared[kind]} {what} are declared, {found[kind]} are there")
    return found["10"], found["12"]


def entries(source: Source, count: int, columns: int, binary: str, kind: str) -> None:
    """The numbers of a section and its end."""
    what = "points" if kind == "10" else "cells"
    source.binary = bool(binary)
    if binary:
        size = {"20": 4, "30": 8}[binary]
        source.numbers(what, count, columns, f"{'f' if kind == '10' else 'i'}{size}")
        source.expect(f")End of Binary Section {binary}{kind})", f"its {count} {what}")
        return
    if any(len(row) != columns or "))" in row for row in source.rows(what, count)):
        raise Damaged(f"its {what} have not {columns} numbers in each row")
    source.expect("))", f"its {count} {what}")
