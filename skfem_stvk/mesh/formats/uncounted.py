"""Formats whose entries stand line by line, uncounted, which meshio reads: each counted and looked through here.

Where the last line is complete and everything that is named is there, entries that are missing altogether cannot be noticed.
Each function gives the number of nodes and of elements; `None` for what it does not count.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from .source import Counts, Damaged, Source, check_consecutive, check_known, check_last_line, check_unique, count_of

#: meshio makes arrays as long as the largest id of an element of FLAC3D's: refused above this plus the size of the file.
LARGEST_ID = 10_000_000
#: Nodes of FLAC3D's elements.
FLAC3D = {"T3": 3, "Q4": 4, "T4": 4, "P5": 5, "W6": 6, "B7": 7, "B8": 8}
#: Geometries in the names of Kratos' elements, without which meshio guesses.
KRATOS = re.compile(
    r"Point[23]D|Line[23]D[23]|Triangle[23]D[36]|Quadrilateral[23]D[489]|Tetrahedra3D(4|10)|Hexahedra3D(8|20|27)|Prism3D6"
)
#: Cards of Nastran's elements as meshio knows them, and how those begin that it leaves out in silence.
NASTRAN = (
    "CELAS1 CBEAM CBUSH CBUSH1D CROD CGAP CBAR CTRIAR CTRIA3 CTRAX6 CTRIAX6 CTRIA6 CQUADR CSHEAR CQUAD4 CQUAD8 CQUAD9 CTETRA "
    "CPYRAM CPYRA CPENTA CHEXA"
)
ELEMENTS = ("CTET", "CHEX", "CPEN", "CPYR", "CTRI", "CTRA", "CQUAD", "CBAR", "CBEAM", "CROD", "CSHEAR", "CELAS1", "CBUSH", "CGAP")


def lines_of(path: Path, *comments: str) -> list[str]:
    """All lines of a file of text that say something, of which the last one is complete."""
    with Source(path, comments=comments) as source:
        check_last_line(source.file)
        source.file.seek(0)
        return list(iter(source.line, ""))


def nastran(path: Path) -> Counts:
    """Bulk data of Nastran's, from BEGIN BULK to ENDDATA. Points in coordinate systems of their own are refused."""
    lines_of(path)  # the last one is complete
    every = path.read_text(errors="replace").splitlines()
    lines = [line for line in every if line.strip() and not line.startswith(("$", "//", "#"))]
    starts = [number for number, line in enumerate(lines) if line.startswith("BEGIN BULK")]
    ends = [number for number, line in enumerate(lines) if line.startswith("ENDDATA")]
    if not starts or not ends or ends[0] < starts[0]:
        raise Damaged("BEGIN BULK or ENDDATA is missing")
    cards = [re.split("[ ,\t]", line[:8], maxsplit=1)[0] for line in lines[starts[0] + 1 : ends[0]] if line[0] not in "+* "]
    known = set(NASTRAN.split())
    if bad := [card for card in cards if not re.fullmatch(r"[A-Z][A-Z0-9]*\*?", card)]:
        raise Damaged(f"{', '.join(bad[:3])[:60]!r} stand where names of cards in capital letters should")
    if lost := [card for card in cards if card.startswith(ELEMENTS) and card not in known]:
        raise Damaged(
            f"{len(lost)} elements {', '.join(sorted(set(lost)))[:60]} are not known here (written in the small field format they "
            "are)"
        )
    if any(card.startswith("CORD") for card in cards):
        raise Damaged("it has coordinate systems of its own (CORD...); write all coordinates in the basic one")
    return sum(card in ("GRID", "GRID*") for card in cards), sum(card in known for card in cards)


def stl(path: Path) -> Counts:
    """Triangles of stereolithography, as text, or binary with their number."""
    size = path.stat().st_size
    with Source(path, binary=True) as source:
        source.file.seek(min(80, size))
        count = int(np.frombuffer(source.file.read(4), "<u4")[0]) if size >= 84 else -1
        if size == 84 + 50 * count:
            return None, count
        source.file.seek(0)
        if not source.line().startswith("solid"):
            raise Damaged(f"it is binary and declares {count} triangles, which take {84 + 50 * count} bytes; {size} are there")
    words = [line.split() for line in lines_of(path)]
    shape = ["facet", "outer", "vertex", "vertex", "vertex", "endloop", "endfacet"]
    faces = (len(words) - 2) // 7
    odd = any(len(row) != 4 for row in words if row[0] == "vertex")
    if odd or [row[0] for row in words] != ["solid", *faces * shape, "endsolid"]:
        raise Damaged("its lines are not facets of three vertices each between one solid and one endsolid")
    return None, faces


def obj(path: Path) -> Counts:
    """Wavefront's objects: vertices and faces by lines."""
    rows = [line.split() for line in lines_of(path, "#")]
    vertices, faces = ([row for row in rows if row[0] == kind] for kind in "vf")
    if len({len(row) for row in vertices}) > 1:
        raise Damaged("its vertices have not all as many numbers")
    most = len(vertices)
    bad = [row for row in faces if len(row) < 4 or any(count_of(word.split("/")[0], "vertices") > most for word in row[1:])]
    if bad:
        raise Damaged(f"the face {' '.join(bad[0])[:60]!r} has less than three vertices, or names one that is not there")
    return len(vertices), len(faces)


def wkt(path: Path) -> Counts:
    """Well-known text: TIN (((x y z, ...)), ...), each triangle in two brackets."""
    body = re.fullmatch(r"\s*TIN\s*\((.*)\)\s*", path.read_text(errors="replace"), re.DOTALL)
    if body is None:
        raise Damaged("it is not TIN (...)")
    triangle = re.compile(r"\(\s*\(([^()]*)\)\s*\)")
    if triangle.sub("", body[1]).replace(",", "").strip():
        raise Damaged("something else than triangles in two brackets stands in its TIN")
    found = triangle.findall(body[1])
    number = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
    for text in found:
        points = [point.split() for point in text.split(",")]
        numeric = all(len(point) == 3 and all(map(number.fullmatch, point)) for point in points)
        if not numeric or len(points) != 4 or points[0] != points[3]:
            raise Damaged(f"{text[:60]!r} are not three points without exponents and the first one again")
    return None, len(found)


def flac3d(path: Path) -> Counts:
    """FLAC3D's grids, as text or binary: points, zones and faces with their ids, and groups of ids."""
    with path.open("rb") as file:
        entries = flac3d_binary(path) if b"\0" in file.read(8) else [line.split() for line in lines_of(path, "*")]
    points = np.array([count_of(row[1], "point") for row in entries if row[0] == "G"], dtype=np.int64)
    check_unique(points, "point")
    count = 0
    for flag in "ZF":
        rows = [row for row in entries if row[0] == flag]
        if bad := [row for row in rows if len(row) < 3 or row[1] not in FLAC3D or len(row) != 3 + FLAC3D[row[1]]]:
            raise Damaged(f"the element {' '.join(bad[0])[:60]!r} has not as many nodes as its type")
        ids = np.array([count_of(row[2], "element") for row in rows], dtype=np.int64)
        check_unique(ids, "element")
        if len(ids) and ids.max() > LARGEST_ID + path.stat().st_size:
            raise Damaged(f"it has an element with the id {ids.max()}; expected at most {LARGEST_ID + path.stat().st_size}")
        check_known(np.array([int(word) for row in rows for word in row[3:]], dtype=np.int64), points, "point", "its elements")
        kind = ""
        for row in entries:
            kind = row[0] if not row[0].isdigit() else kind
            if kind == f"{flag}GROUP" and row[0].isdigit():
                check_known(np.array([count_of(word, "element") for word in row]), ids, "element", "its groups")
        count += len(rows)
    return len(points), count


def flac3d_binary(path: Path) -> list[list[str]]:
    """The entries of a binary file, as they would stand in one of text."""
    entries: list[list[str]] = []
    names = {4: "T4", 5: "P5", 6: "W6", 7: "B7", 8: "B8"}
    with Source(path, binary=True) as source:

        def whole(what: str, count: int = 1) -> list[int]:
            return [int(value) for value in source.numbers(what, 1, count, "<u4")[0]]

        whole("heads", 2)
        table = source.numbers("points", whole("numbers of points")[0], 1, [("id", "<u4"), ("x", "<f8", 3)])["id"].ravel()
        entries += [["G", str(number)] for number in table.tolist()]
        for flag in "ZF":
            for _ in range(whole("numbers of elements")[0]):
                number, corners = whole("heads of elements", 2)
                name = (names if flag == "Z" else {3: "T3", 4: "Q4"}).get(corners, "?")
                entries.append([flag, name, str(number), *map(str, whole("nodes", corners))])
            for _ in range(whole("numbers of groups")[0]):
                for _ in ("name", "slot"):
                    length = int(source.numbers("lengths of names", 1, 1, "<u2")[0, 0])
                    source.numbers("letters", length, 1, "u1")
                entries.append([f"{flag}GROUP"])
                entries.append(list(map(str, whole("members of groups", whole("members")[0]))) or [""])
        if source.left:
            raise Damaged(f"{source.left} bytes stand after its last group")
    return entries


def permas(path: Path) -> Counts:
    """Permas' data: one section of coordinates, and elements by lines, which go on where they end with an exclamation mark."""
    rows, kind, nodes = lines_of(path), "", list[int]()
    elements, sections, going_on = 0, 0, False
    for line in rows:
        if line.startswith("!"):
            continue
        if line.startswith("$"):
            kind = line.strip("$ ").upper()
            sections += kind.startswith("COOR")
        elif kind.startswith("COOR"):
            nodes.append(count_of(line.split()[0], "node"))
        elif kind.startswith("ELEMENT"):
            elements += not going_on
            going_on = line.endswith("!")
    if sections != 1:
        raise Damaged(f"it has {sections} sections $COOR; expected one")
    if any(line.startswith("$ENTER") for line in rows) and rows[-1].strip() != "$FIN":
        raise Damaged("it has no $FIN")
    check_unique(np.array(nodes), "node")
    return len(nodes), elements


def mdpa(path: Path) -> Counts:
    """Kratos' model parts: blocks between Begin and End."""
    nodes: list[int] = []
    elements: dict[str, list[int]] = {"Elements": [], "Conditions": []}
    name = ""
    for line in lines_of(path, "//"):
        words = line.split()
        if words[0] == "Begin" and words[1:2] and words[1] in ("Nodes", *elements):
            if name:
                raise Damaged(f"Begin {name} not closed by End {name}")
            name = words[1]
            if name in elements and not KRATOS.search(line):
                raise Damaged(f"{line[:60]!r} does not name a geometry, such as Tetrahedra3D4")
        elif words[0] == "End":
            name = ""
        elif name == "Nodes":
            nodes.append(count_of(words[0], "node"))
        elif name:
            elements[name].append(count_of(words[0], "element"))
    if name:
        raise Damaged(f"Begin {name} not closed by End {name}")
    check_consecutive(np.array(nodes), 1, "nodes")
    for what, ids in elements.items():
        check_unique(np.array(ids), what[:-1].lower())
    return len(nodes), sum(map(len, elements.values()))


def netgen(path: Path) -> Counts:
    """Netgen's volumes: sections that declare their number of entries, up to endmesh."""
    counts = {"points": 0, "pointelements": 0, "edgesegments": 0, "surfaceelements": 0, "volumeelements": 0}
    seen = set()
    with Source(path, comments=("#",)) as source:
        source.expect("mesh3d", "the beginning")
        two_lines = False
        while (line := source.line()) != "endmesh":
            if not line:
                raise Damaged("it has no endmesh")
            if line.split() == ["surf1", "surf2", "p1", "p2"]:
                two_lines = True
                continue
            if line in seen or not line[0].isalpha():
                raise Damaged(f"{line[:60]!r} stands twice, or where a section should begin")
            seen.add(line)
            count = count_of(source.line(), line)
            if line in ("dimension", "geomtype"):
                continue
            name = next((name for name in counts if line.startswith(name)), "")
            if line == "identificationtypes":
                source.rows(line, min(count, 1))
                continue
            rows = source.rows(line, count * (2 if two_lines and name.endswith(("elements", "segments")) else 1))
            if name:
                counts[name] += count
            if line == "volumeelements" and any(len(row) != 2 + count_of(row[1], "nodes") for row in rows):
                raise Damaged("it has volume elements with not as many nodes as they say")
    nodes = counts.pop("points")
    return nodes, sum(counts.values())


def tecplot(path: Path) -> Counts:
    """One zone of Tecplot's, of finite elements, as text."""
    lines = lines_of(path, "#")
    text = " ".join(line for line in lines if not re.match(r"[-+.\d]", line)).upper()
    zones = re.findall(r"\bZONE\b", text)
    nodes, elements = (re.findall(rf"\b(?:{names})\s*=\s*(\d+)", text) for names in ("N|NODES", "E|ELEMENTS"))
    if len(zones) != 1 or len(nodes) != 1 or len(elements) != 1:
        raise Damaged(
            f"it has {len(zones)} zones with {len(nodes)} numbers of nodes and {len(elements)} of elements; expected one of each"
        )
    rows = [line for line in lines if re.match(r"[-+.\d]", line)]
    last = rows[len(rows) - count_of(elements[0], "elements") :]
    if len(last) != int(elements[0]) or len({len(row.split()) for row in last}) > 1 or any("." in row for row in last):
        raise Damaged(f"{elements[0]} elements are declared, which its last {len(last)} lines are not")
    names = re.findall(r'"[^"]*"|[^\s,"=]+', text.partition("VARIABLES")[2].partition("ZONE")[0])
    ranges = re.findall(r"\[(\d+)(?:-(\d+))?\]\s*=\s*CELLCENTERED", text)
    of_elements = sum(int(end or start) - int(start) + 1 for start, end in ranges)
    declared = (len(names) - of_elements) * count_of(nodes[0], "nodes") + of_elements * int(elements[0])
    before = sum(len(row.split()) for row in rows[: len(rows) - len(last)])
    if before != declared:
        raise Damaged(f"{declared} numbers are declared for {len(names)} variables at its {nodes[0]} nodes, {before} are there")
    return int(nodes[0]), int(elements[0])
