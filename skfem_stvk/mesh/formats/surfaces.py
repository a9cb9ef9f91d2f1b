"""Surfaces of triangles and quadrilaterals as text: object files (.off) and Wavefront (.obj), the usual format of colliders."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

from .stream import Damaged, Source, check_last_line, count_of


def off(path: Path) -> meshio.Mesh:
    """Read vertices and faces; numbers after the corners of a face are its colour."""
    with Source(path, comments=("#",)) as source:
        head = source.line().split()
        if head[:1] != ["OFF"]:
            raise Damaged(f"{' '.join(head)[:60]!r} was found; expected OFF")
        head = head[1:] or source.line().split()
        nodes, faces = (count_of(head[i] if len(head) == 3 else "", what) for i, what in enumerate(("vertices", "faces")))
        points = source.numbers("vertices", nodes, 3)
        rows = source.rows("faces", faces)
        if source.line():
            raise Damaged(f"{faces} faces are declared, more were found")
        check_last_line(source.file)
    corners = [corners_of(row[1:], count_of(row[0], "corners")) for row in rows]
    return faces_of(points, corners)


def obj(path: Path) -> meshio.Mesh:
    """Read vertices (v) and faces (f), with a set for each object (o) and group (g). Corners count from 1, or back from -1."""
    points, corners, names, places = list[list[str]](), list[list[int]](), list[str](), dict[str, list[int]]()
    with Source(path, comments=("#",)) as source:
        while line := source.line():
            while line.endswith("\\"):
                line = line[:-1] + " " + source.line()
            word, *rest = line.split()
            if word == "v":
                if len(rest) < 3:
                    raise Damaged(f"{line[:60]!r} was found; expected three coordinates of a vertex")
                points.append(rest[:3])
            elif word == "f":
                ids = [index.partition("/")[0] for index in rest]
                back = [str(len(points) + 1 + int(i)) if i[:1] == "-" and i[1:].isdigit() else i for i in ids]
                corners.append(corners_of([str(int(i) - 1) if i.isdigit() else i for i in back], len(back)))
                for name in names:
                    places.setdefault(name, []).append(len(corners) - 1)
            elif word in ("o", "g"):
                names = [" ".join(rest)] if word == "o" else rest
            elif word in ("curv", "curv2", "surf", "bmat", "p", "l"):
                raise Damaged(
                    f"it has {word!r} elements, which are not read: curves, free-form surfaces, points or lines. Write triangles"
                )
    try:
        table = np.array(points, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise Damaged("its vertices contain other text than numbers") from error
    return faces_of(table, corners, places)


def corners_of(words: list[str], count: int) -> list[int]:
    """Return the corners of a face from its first words."""
    if len(words) < count or not all(word.isdigit() for word in words[:count]):
        raise Damaged(f"{' '.join(words)[:60]!r} was found; expected the {count} corners of a face")
    return [int(word) for word in words[:count]]


def faces_of(points: NDArray[np.float64], corners: list[list[int]], places: dict[str, list[int]] | None = None) -> meshio.Mesh:
    """Return the faces, with sets of them by name: quadrilaterals if all are, otherwise triangles, of which a polygon is a fan."""
    if bad := [i for i, face in enumerate(corners) if len(face) < 3]:
        raise Damaged(f"its face {bad[0]} has {len(corners[bad[0]])} corners; expected at least 3")
    if all(len(face) == 4 for face in corners):
        numbers, kind, rows = np.arange(len(corners)), "quad", corners
    else:
        fans = [(i, [face[0], face[j], face[j + 1]]) for i, face in enumerate(corners) for j in range(1, len(face) - 1)]
        numbers, kind, rows = np.array([i for i, _ in fans]), "triangle", [triangle for _, triangle in fans]
    sets = {name: [np.flatnonzero(np.isin(numbers, ids))] for name, ids in (places or {}).items()}
    return meshio.Mesh(points, [(kind, np.array(rows, dtype=np.int64))] if rows else [], cell_sets=sets if rows else {})
