"""Formats that say how much they hold, which meshio reads: each checked for holding as much.

Each function gives the number of nodes and of elements that a file declares; `None` for what it does not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .source import Counts, Damaged, Source, check_consecutive, check_known, check_last_line, check_unique, count_of

#: Nodes of the elements that SU2's files have, by VTK's types.
SU2 = {3: 2, 5: 3, 9: 4, 10: 4, 12: 8, 13: 6, 14: 5}
#: Nodes of the elements of AVS's files.
AVS = {"pt": 1, "line": 2, "tri": 3, "quad": 4, "tet": 4, "pyr": 5, "prism": 6, "hex": 8}
#: NumPy's types of those of polygon files.
PLY = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"}
for word, letter in (("int", "i"), ("uint", "u"), ("float", "f")):
    PLY |= {f"{word}{8 * size}": f"{letter}{size}" for size in (1, 2, 4, 8)}


def off(path: Path) -> Counts:
    """Object files of Geomview: triangles only."""
    with Source(path, comments=("#",)) as source:
        source.expect("OFF", "the beginning")
        words = source.line().split()
        nodes, faces = (count_of(word, what) for word, what in zip((*words, "", "")[:2], ("vertices", "faces"), strict=True))
        source.numbers("vertices", nodes, 3)
        if (source.numbers("faces", faces, 4, np.int64)[:, 0] != 3).any():
            raise Damaged("it has faces that are no triangles")
        source.expect_end(f"its {faces} faces")
    return nodes, faces


def tetgen(path: Path) -> Counts:
    """TetGen's pair of files, .node and .ele."""
    with Source(path.with_suffix(".node"), comments=("#",)) as source:
        nodes, dim, attributes, markers = heads(source, "nodes", 4)
        if dim != 3:
            raise Damaged(f"its nodes have {dim} coordinates; expected 3")
        ids = source.numbers("nodes", nodes, 4 + attributes + markers)[:, 0]
        source.expect_end(f"its {nodes} nodes")
    first = int(ids[0]) if nodes else 0
    if first not in (0, 1):
        raise Damaged(f"its nodes are counted from {first}; expected 0 or 1")
    check_consecutive(ids, first, "nodes")
    with Source(path.with_suffix(".ele"), comments=("#",)) as source:
        elements, corners, attributes = heads(source, "elements", 3)
        if corners != 4:
            raise Damaged(f"its elements have {corners} nodes; expected 4 (write it without -o2)")
        table = source.numbers("elements", elements, 5 + attributes)
        source.expect_end(f"its {elements} elements")
    check_consecutive(table[:, 0], first, "elements")
    return nodes, elements


def tetgen_files(path: Path) -> list[Path]:
    """Return both files of TetGen's pair."""
    return [path.with_suffix(".node"), path.with_suffix(".ele")]


def heads(source: Source, what: str, count: int) -> list[int]:
    """Counts on the first line."""
    words = source.line().split()
    if len(words) != count:
        raise Damaged(f"{len(words)} numbers stand in its first line; expected {count}: how many {what} and of what")
    return [count_of(word, what) for word in words]


def su2(path: Path) -> Counts:
    """SU2's meshes: elements, points and markers of the boundary."""
    dim, nodes, elements, markers, tags, seen = 0, 0, 0, 0, 0, set[str]()
    with Source(path, comments=("%",)) as source:
        while line := source.line():
            name, equals, value = line.partition("=")
            if not equals:
                raise Damaged(f"{line[:60]!r} stands where NAME= should")
            if name in seen and name not in ("MARKER_TAG", "MARKER_ELEMS"):
                raise Damaged(f"{name[:60]}= stands twice")
            seen.add(name)
            if name == "NDIME":
                dim = count_of(value.strip(), "dimensions")
            elif name == "NPOIN":
                nodes = count_of((value.split() or [""])[0], "points")
                same_width(source.rows("points", nodes), {dim, dim + 1, dim + 2}, "points")
            elif name in ("NELEM", "MARKER_ELEMS"):
                count = count_of(value.strip(), "elements")
                su2_elements(source.rows("elements", count))
                elements += count
            elif name == "NMARK":
                markers = count_of(value.strip(), "markers")
            elif name == "MARKER_TAG":
                tags += 1
        if tags != markers:
            raise Damaged(f"{markers} markers are declared, {tags} are there")
        source.expect_end("its markers")
    return nodes, elements


def su2_elements(rows: list[list[str]]) -> None:
    """Type, nodes, and in all rows or none a number."""
    extra = set()
    for row in rows:
        kind = count_of(row[0], "VTK's type")
        if kind not in SU2:
            raise Damaged(f"it has elements of VTK's type {kind}, which are not known here")
        extra.add(len(row) - 1 - SU2[kind])
    if len(extra) > 1 or extra - {0, 1}:
        raise Damaged("elements have not as many nodes as their type")


def same_width(rows: list[list[str]], widths: set[int], what: str) -> None:
    found = {len(row) for row in rows}
    if len(found) > 1 or found - widths:
        raise Damaged(f"its {what} have {sorted(found)} numbers; expected one of {sorted(widths)} in all rows")


def avs(path: Path) -> Counts:
    """AVS's unstructured cell data."""
    with Source(path, comments=("#",)) as source:
        nodes, elements, of_nodes, of_elements, _ = heads(source, "nodes", 5)
        ids = source.numbers("nodes", nodes, 4)[:, 0]
        check_unique(ids, "node")
        rows = source.rows("elements", elements)
        for row in rows:
            if len(row) < 3 or row[2] not in AVS or len(row) != 3 + AVS[row[2]]:
                raise Damaged(f"the element {' '.join(row)[:60]!r} has not as many nodes as its type")
        numbers = np.array([row[0] for row in rows], dtype=np.int64)
        check_unique(numbers, "element")
        if rows:
            check_known(np.array([word for row in rows for word in row[3:]], dtype=np.int64), ids, "node", "its elements")
        for values, known, what in ((of_nodes, ids, "node"), (of_elements, numbers, "element")):
            if values:
                avs_data(source, values, known, what)
        source.expect_end("its data")
    return nodes, elements


def avs_data(source: Source, values: int, known: np.ndarray, what: str) -> None:
    """Sizes of the components, their labels, and a row for each node or element."""
    sizes = [count_of(word, "components") for word in source.line().split()]
    if not sizes or sizes[0] != len(sizes) - 1 or sum(sizes[1:]) != values:
        raise Damaged(f"{values} values for each {what} are declared, the sizes of their components are {sizes}")
    source.rows("labels", sizes[0])
    ids = source.numbers(f"values of {what}s", len(known), 1 + values)[:, 0]
    check_unique(ids, what)
    check_known(ids, known, what, f"its values of {what}s")


def ugrid(path: Path) -> Counts:
    """AFLR's grids: all counts first, then nodes, faces, their tags, volumes."""
    form = path.suffixes[-2][1:] if len(path.suffixes) > 1 else "ascii"
    binary = form in ("b8l", "b8", "b4", "lb8l", "lb8", "lb4", "r8", "r4", "lr8", "lr4")
    order = "<" if form.startswith("l") else ">"
    whole = np.dtype(f"{order}i{8 if form.endswith('8l') else 4}") if binary else np.dtype(np.int64)
    real = np.dtype(f"{order}f{8 if '8' in form else 4}") if binary else np.dtype(float)
    with Source(path, binary) as source:
        records = binary and "r" in form  # FORTRAN writes the length of a record before and after it
        for _ in range(records):
            source.numbers("lengths of records", 1, 1, whole)
        nodes, triangles, quads, tets, pyramids, wedges, hexes = map(int, source.numbers("counts", 1, 7, whole)[0])
        for _ in range(2 * records):
            source.numbers("lengths of records", 1, 1, whole)
        source.numbers("nodes", nodes, 3, real)
        parts = [("triangles", triangles, 3), ("quadrilaterals", quads, 4), ("tags of faces", triangles + quads, 1)]
        parts += [("tetrahedra", tets, 4), ("pyramids", pyramids, 5), ("wedges", wedges, 6), ("hexahedra", hexes, 8)]
        for what, count, columns in parts:
            table = source.numbers(what, count, columns, whole)
            if columns > 1 and count and not 1 <= table.min() <= table.max() <= nodes:
                raise Damaged(f"its {what} name nodes from {table.min()} to {table.max()}, outside 1 ... {nodes}")
        for _ in range(records):
            source.numbers("lengths of records", 1, 1, whole)
        if binary and source.left:
            raise Damaged(f"{source.left} bytes stand after what it declares")
        if not binary:
            source.expect_end("what it declares")
    return nodes, triangles + quads + tets + pyramids + wedges + hexes


def ply(path: Path) -> tuple[int, int]:
    """Polygon files: vertices and faces."""
    with Source(path, comments=("comment", "obj_info")) as source:
        source.expect("ply", "the beginning")
        form = source.line()
        counts: dict[str, int] = {}
        properties: dict[str, list[list[str]]] = {}
        name = ""
        while (line := source.line()) and line != "end_header":
            words = line.split()
            if words[0] == "element" and len(words) == 3 and words[1] not in counts:
                name = words[1]
                counts[name], properties[name] = count_of(words[2], name), []
            elif words[0] == "property" and name and not set(words[1:-1]) - {"list", *PLY}:
                properties[name].append(words[1:])
            else:
                raise Damaged(f"{line[:60]!r} stands in its header")
        if set(counts) != {"vertex", "face"} or list(counts) != ["vertex", "face"]:
            raise Damaged(f"it holds {', '.join(counts)[:60] or 'nothing'}; expected vertices and faces")
        lists = [number for number, words in enumerate(properties["face"]) if words[0] == "list"]
        if len(lists) != 1 or properties["face"][lists[0]][-1] != "vertex_indices":
            raise Damaged("its faces have not one list, vertex_indices")
        if form == "format ascii 1.0":
            ply_text(source, counts, len(properties["vertex"]), len(properties["face"]), lists[0])
        else:
            order = {"format binary_little_endian 1.0": "<", "format binary_big_endian 1.0": ">"}.get(form)
            if order is None or len(properties["face"]) != 1:
                raise Damaged(
                    "its faces have more than vertex_indices; write it as text" if order else f"{form[:60]!r} is not known here"
                )
            vertex = sum(np.dtype(PLY[words[0]]).itemsize for words in properties["vertex"])
            ply_binary(source, counts, vertex, *(np.dtype(order + PLY[kind]) for kind in properties["face"][0][1:3]))
    return counts["vertex"], counts["face"]


def ply_text(source: Source, counts: dict[str, int], of_vertex: int, of_face: int, place: int) -> None:
    """A row for each vertex and for each face, whose list begins with its length."""
    bad = [row for row in source.rows("vertices", counts["vertex"]) if len(row) != of_vertex]
    for row in source.rows("faces", counts["face"]):
        if len(row) != of_face + count_of((*row, *" " * of_face)[place], "vertices"):
            bad.append(row)
    if bad:
        raise Damaged(f"the row {' '.join(bad[0])[:60]!r} has not as many numbers as its header says")
    source.expect("", f"its {counts['face']} faces")
    check_last_line(source.file)


def ply_binary(source: Source, counts: dict[str, int], of_vertex: int, length: np.dtype, index: np.dtype) -> None:
    """Vertices of equal size, and faces of which each says how many indices it has."""
    source.fits("vertices", counts["vertex"], of_vertex)
    source.fits("faces", counts["face"], length.itemsize)
    source.file.seek(counts["vertex"] * of_vertex, 1)
    data, place = source.file.read(), 0
    for face in range(counts["face"]):
        if place + length.itemsize > len(data):
            raise Damaged(f"{counts['face']} faces are declared, {face} are there")
        corners = int(np.frombuffer(data, length, 1, place)[0])
        if corners < 3:
            raise Damaged(f"its face {face} has {corners} vertices")
        place += length.itemsize + index.itemsize * corners
    if place != len(data):
        raise Damaged(f"its {counts['face']} faces take {place} bytes, {len(data)} are there")
