"""Input files (.inp) of Abaqus, CalculiX and PrePoMax: parts, instances, elements, sets, surfaces, and the files they include.

A keyword that says where matter is, or what a place is called, is read or refused by name. Other keywords are for a solver.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import meshio
import numpy as np
from numpy.typing import NDArray

from ...errors import name_ids, warn
from ..groups import node_count
from .sides import FACETS, NO_IDS, CellsOfFile, Ids, Sides, joined, mesh_of, parts_of
from .stream import CutOff, Damaged, Included, Source, check_known, check_unique, real

Points = NDArray[np.float64]
#: Types of elements by the type of their cells in meshio's terms. Letters may follow, such as H, I, M, R, T of the same element.
TYPES = {
    "line": r"T[23]D2|RB?[23]D2|B[23][13]|PIPE[23]1",
    "line3": r"T[23]D3|B[23]2|PIPE[23]2",
    "triangle": r"(CP[ES]|CPEG|M3D|SFM3D|R3D|D?S|STRI|DC2D)3",
    "triangle6": r"(CP[ES]|CPEG|M3D|SFM3D|D?S|DC2D)6|STRI65",
    "quad": r"(CP[ES]|CPEG|M3D|SFM3D|R3D|D?S|DC2D)4|S4R5",
    "quad8": r"(CP[ES]|CPEG|M3D|SFM3D|D?S|DC2D)8|S8R5",
    "quad9": r"M3D9|S9R5",
    "tetra": r"D?C3D4",
    "tetra10": r"D?C3D10",
    "hexahedron": r"D?C3D8|SC8",
    "hexahedron20": r"D?C3D20",
    "hexahedron27": r"C3D27",
    "wedge": r"D?C3D6|SC6",
    "wedge15": r"D?C3D15",
    "pyramid": r"C3D5",
}
KINDS = {kind: re.compile(rf"({pattern})[A-UW-Z]*") for kind, pattern in TYPES.items()}
#: Types of elements that have no volume, such as masses, springs and connectors, or that only a user knows.
WITHOUT_VOLUME = re.compile(r"MASS|ROTARYI|HEATCAP|SPRING\w|DASHPOT\w|GAP\w*|CONN[23]D2|DCOUP[23]D|JOINTC|ITS\w+|U\d+|VU\d+|D")
#: Nodes of the faces of a cell, from 1, in the order of their numbers; those of a surface element are its edges.
FACES = {
    "triangle": ((1, 2), (2, 3), (3, 1)),
    "quad": ((1, 2), (2, 3), (3, 4), (4, 1)),
    "tetra": ((1, 2, 3), (1, 4, 2), (2, 4, 3), (3, 4, 1)),
    "pyramid": ((1, 2, 3, 4), (1, 5, 2), (2, 5, 3), (3, 5, 4), (4, 5, 1)),
    "wedge": ((1, 2, 3), (4, 6, 5), (1, 4, 5, 2), (2, 5, 6, 3), (3, 6, 4, 1)),
    "hexahedron": ((1, 2, 3, 4), (5, 8, 7, 6), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 8, 4), (4, 8, 5, 1)),
}
AXISYMMETRIC = re.compile(r"[DMRAF]*(CG?AX|AX|SAX|MAX|GAX)")
#: Keywords with geometry or names that are refused: generators of nodes and elements, and meshes from elsewhere.
REFUSED = {
    **dict.fromkeys(("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"), "it makes nodes or elements from others"),
    **dict.fromkeys(("IMPORT", "IMPORT NSET", "IMPORT ELSET", "SYMMETRIC MODEL GENERATION"), "its mesh is in another file"),
    "SUBSTRUCTURE GENERATE": "its mesh is in another file",
}
#: Keywords with geometry or names that are read.
HANDLED = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "SYSTEM", "INCLUDE", "PART", "END PART", "INSTANCE", "END INSTANCE")
#: What a set consists of, by its keyword.
WHAT = {"NSET": "node", "ELSET": "element"}
NONE, LARGEST_ID = np.empty(0), 10**15
#: Lines of a section that are converted to numbers at once.
CHUNK = 1 << 16
NAMES_FILE = re.compile(rb"[ \t]*\*[^*].*\bINPUT[ \t]*=", re.IGNORECASE)
COMMA = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')


class Set(NamedTuple):
    """Section `*NSET`, `*ELSET` or `*SURFACE`: its keyword, name, options, and its ids as arrays, words, or lines of words."""

    keyword: str
    name: str
    options: dict[str, str]
    items: list[Any]


@dataclass
class PartOfDeck:
    """Sections with nodes, elements and sets of a part, or of the assembly, which has those of a file without parts."""

    nodes: list[tuple[Ids, Points]] = field(default_factory=list)
    elements: list[tuple[str, Ids, Ids]] = field(default_factory=list)
    sets: list[Set] = field(default_factory=list)


def read(path: Path) -> meshio.Mesh:
    """Read nodes and elements, sets as `point_sets` and `cell_sets`, and surfaces as sets of facets or of nodes.

    A set of an instance has the name INSTANCE.SET, and also SET if no other set has that name.
    """
    parts, assembly, body, frame = dict[str, PartOfDeck](), PartOfDeck(), BodyOfDeck(), Frame(NONE)
    part, name, motion = assembly, "", NONE
    for keyword, options, lines in Files(path).sections():
        if keyword == "PART":
            part = parts[options.get("NAME", "").upper()] = PartOfDeck()
        elif keyword == "INSTANCE":
            name, motion, base = options.get("NAME", ""), numbers_in(lines), parts.get(options.get("PART", "").upper())
            if not name or base is None:
                raise Damaged(f"*INSTANCE, NAME={name[:60]}, PART={options.get('PART', '')[:60]}: no such *PART is above it")
            part = PartOfDeck([*base.nodes], [*base.elements], [*base.sets])
        elif keyword == "SYSTEM":
            frame = Frame(numbers_in(lines))
        elif keyword in ("END PART", "END INSTANCE"):
            if keyword == "END INSTANCE":
                body.place(part, name, motion)
            part, frame = assembly, Frame(NONE)
        else:
            add(part, keyword, options, lines, frame)
    if parts and not body.instances:
        raise Damaged("it has a *PART but no *INSTANCE; expected an *ASSEMBLY with instances of its parts")
    body.place(assembly, "", NONE)
    return body.mesh()


def add(part: PartOfDeck, keyword: str, options: dict[str, str], lines: Iterator[str], frame: Frame) -> None:
    """Add the content of a section to a part; refuse a keyword with geometry that is not read."""
    if keyword in REFUSED:
        raise Damaged(
            f"it has the keyword *{keyword}, which is not read: {REFUSED[keyword]}. Write all nodes and elements to the file, as "
            "Abaqus/CAE and other preprocessors do"
        )
    if keyword in ("NODE", "ELEMENT"):
        ids = nodes_of(part, options, lines, frame) if keyword == "NODE" else elements_of(part, options, lines)
        named = "NSET" if keyword == "NODE" else "ELSET"
        if named in options:
            part.sets.append(Set(named, options[named], {}, [ids]))
    elif keyword in ("NSET", "ELSET"):
        items = [split(line) for line in lines] if "GENERATE" in options else words_of(lines)
        part.sets.append(Set(keyword, options.get(keyword, ""), options, items))
    elif keyword == "SURFACE":
        part.sets.append(Set(keyword, options.get("NAME", ""), options, [split(line) for line in lines]))


def nodes_of(part: PartOfDeck, options: dict[str, str], lines: Iterator[str], frame: Frame) -> Ids:
    """Add nodes to a part, and return their ids. Omitted coordinates are 0; further numbers are a normal."""
    system, tables = options.get("SYSTEM", "R").upper(), [np.empty((0, 4))]
    if system not in ("R", "C"):
        raise Damaged(f"it has *NODE, SYSTEM={system[:20]}; expected R or C. Write the nodes in Cartesian coordinates")
    while chunk := list(islice(lines, CHUNK)):
        rows, counts = np.zeros((len(chunk), 4)), {line.count(",") for line in chunk}
        values = numbers(chunk, np.float64) if len(counts) == 1 else None
        if values is not None:
            found = values.reshape(len(chunk), -1)[:, :4]
            rows[:, : found.shape[1]] = found
        else:
            for row, line in zip(rows, chunk, strict=True):
                words = split(line)[:4]
                row[: len(words)] = [real(word) for word in words]
        tables.append(rows)
    table = np.concatenate(tables)
    is_id = (table[:, 0] == np.floor(table[:, 0])) & (table[:, 0] >= 0) & (table[:, 0] <= LARGEST_ID)
    if not is_id.all():
        raise Damaged(f"{table[~is_id, 0][0]:g} was found; expected the id of a node")
    ids = table[:, 0].astype(np.int64)
    part.nodes.append((ids, frame.apply(table[:, 1:], system == "C")))
    return ids


def elements_of(part: PartOfDeck, options: dict[str, str], lines: Iterator[str]) -> Ids:
    """Add elements to a part, and return their ids. Each begins on a line of its own, and may go on over the next lines."""
    type = options.get("TYPE", "none").upper()
    kind = next((kind for kind, pattern in KINDS.items() if pattern.fullmatch(type)), "")
    if kind:
        n = node_count(kind) or 0
        tables, whole = [np.empty((0, 1 + n), dtype=np.int64)], records(lines, 1 + n)
        while chunk := list(islice(whole, CHUNK)):
            if bad := [record.partition(",")[0].strip()[:20] for record in chunk if record.count(",") != n]:
                raise Damaged(f"{name_ids(bad, 'element')}: not the {n} nodes of the type {type[:40]}")
            tables.append(ids_of(chunk).reshape(-1, 1 + n))
        table = np.concatenate(tables)
    elif WITHOUT_VOLUME.fullmatch(type):
        words = [line.partition(",")[0] for line in lines]
        table = ids_of([word for word in words if word.strip().isdigit()])[:, None]
    elif AXISYMMETRIC.match(type):
        raise Damaged(f"its elements {type[:40]} are axisymmetric, which are not read. Revolve the section, and mesh the solid")
    else:
        raise Damaged(f"its elements have the type {type[:40]}, which is not read. Write the mesh without them")
    part.elements.append((type, table[:, 0], table[:, 1:]))
    return table[:, 0]


def records(lines: Iterable[str], width: int) -> Iterator[str]:
    """Yield lines that are joined until they have at least `width` numbers."""
    record, count = "", 0
    for line in lines:
        record, count = f"{record},{line}" if record else line, count + line.count(",") + 1
        if count >= width:
            yield record
            record, count = "", 0
    if record:
        yield record


class Frame:
    """Coordinate system of nodes: its origin, a point of its x axis, and one of its x-y plane; without numbers the global one."""

    def __init__(self, data: Points) -> None:
        if data.size not in (0, 3, 9):
            raise Damaged(f"*SYSTEM has {data.size} numbers; expected 3 of the origin, or 9 of three points")
        self.is_global, self.origin, self.axes = not data.size, np.append(data, np.zeros(3))[:3], np.eye(3)
        if data.size == 9:
            x, y = data[3:6] - data[:3], data[6:] - data[:3]
            z = np.cross(x, y)
            self.axes = np.stack([x, np.cross(z, x), z])
            if not (sizes := np.linalg.norm(self.axes, axis=1)).all():
                raise Damaged(
                    "the three points of *SYSTEM are on a line; expected the origin, and points of the x axis and the plane"
                )
            self.axes /= sizes[:, None]

    def apply(self, points: Points, cylindrical: bool) -> Points:
        """Return the global coordinates of points (n, 3): x, y, z in this system, or radius, angle in degrees, z."""
        if cylindrical:
            r, angle = points[:, 0], np.deg2rad(points[:, 1])
            points = np.stack([r * np.cos(angle), r * np.sin(angle), points[:, 2]], axis=1)
        return points if self.is_global else points @ self.axes + self.origin


def moved(points: Points, motion: Points) -> Points:
    """Return the points of an instance: translated by three numbers, then rotated about an axis by an angle in degrees."""
    if motion.size not in (0, 3, 10):
        raise Damaged(
            f"*INSTANCE has {motion.size} numbers; expected 3 of a translation, then 7 of a rotation: two points, an angle"
        )
    if motion.size:
        points = points + motion[:3]
    if motion.size == 10:
        a, axis = motion[3:6], motion[6:9] - motion[3:6]
        if not axis.any():
            raise Damaged("*INSTANCE has a rotation about two points that are the same; expected two points of the axis")
        e, angle, x = axis / np.linalg.norm(axis), np.deg2rad(motion[9]), points - a
        along = np.outer(x @ e, e)
        points = a + along + np.cos(angle) * (x - along) + np.sin(angle) * np.cross(e, x)
    return points


@dataclass
class Scope:
    """Ids and sets of an instance, or of the assembly. Indices count through the nodes and elements of the whole body.

    Attributes
    ----------
    ids
        Ids of the nodes (NSET) and elements (ELSET), in the order of the file.
    first
        Index of the first node, and of the first element.
    sets
        Written name, and indices or facets, by keyword and name in capital letters.
    """

    ids: dict[str, Ids]
    first: dict[str, int]
    sets: dict[tuple[str, str], tuple[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.orders = {keyword: np.argsort(ids, kind="stable") for keyword, ids in self.ids.items()}
        self.sorted = {keyword: ids[self.orders[keyword]] for keyword, ids in self.ids.items()}

    def indices(self, keyword: str, ids: Ids, of: str) -> Ids:
        """Return the indices of nodes or elements; `Damaged` if any is unknown."""
        check_known(ids, self.sorted[keyword], WHAT[keyword], of)
        return self.first[keyword] + self.orders[keyword][np.searchsorted(self.sorted[keyword], ids)]

    def between(self, keyword: str, words: list[str], of: str) -> Ids:
        """Return the indices of the known ids from a first one to a last one, in steps; warn of ids that are unknown."""
        step = ids_of([*words, "1"][:3]) if len(words) in (2, 3) else np.array([0, -1, 0])
        if step[1] < step[0] or step[2] < 1:
            raise Damaged(f"GENERATE has {', '.join(words)[:60]!r}; expected the first {WHAT[keyword]}, the last one, and a step")
        known = self.sorted[keyword][slice(*np.searchsorted(self.sorted[keyword], [step[0], step[1] + 1]))]
        known = known[(known - step[0]) % step[2] == 0]
        if missing := int((step[1] - step[0]) // step[2] + 1 - len(known)):
            if not len(known):
                raise Damaged(f"{of}: GENERATE has {', '.join(words)[:60]!r}, and none of these ids is defined")
            warn(f"{of}: GENERATE has {missing} ids from {step[0]} to {step[1]} that are not defined; they are left out.")
        return self.indices(keyword, known, of)


class BodyOfDeck:
    """Body of all instances: its points, its blocks of elements with the index of the first, and the scopes of its sets."""

    def __init__(self) -> None:
        self.points: list[Points] = []
        self.blocks: list[CellsOfFile] = []
        self.types: dict[int, str] = {}  # of the elements of a block, by the first
        self.counts = {"NSET": 0, "ELSET": 0}
        self.instances: dict[str, Scope] = {}
        self.named: list[tuple[str, Scope]] = []
        self.left_out: Counter[str] = Counter()

    def place(self, part: PartOfDeck, name: str, motion: Points) -> None:
        """Add the nodes and elements of a part, and find the members of its sets."""
        ids = [np.concatenate([NO_IDS, *(row[i] for row in rows)]) for rows, i in ((part.nodes, 0), (part.elements, 1))]
        for numbers_of, what in zip(ids, WHAT.values(), strict=True):
            check_unique(numbers_of, what)
        scope = Scope(dict(zip(WHAT, ids, strict=True)), dict(self.counts))
        self.points.append(moved(np.concatenate([np.empty((0, 3)), *(points for _, points in part.nodes)]), motion))
        for type, elements, nodes in part.elements:
            if nodes.shape[1]:
                self.types[self.counts["ELSET"]] = type
                self.blocks.append(CellsOfFile(kind_of(type), self.counts["ELSET"], scope.indices("NSET", nodes, "its elements")))
            else:
                self.left_out[type] += len(elements)
            self.counts["ELSET"] += len(elements)
        self.counts["NSET"] += len(ids[0])
        self.named.append((name, scope))
        if name:
            self.instances[name.upper()] = scope
        for one in part.sets:
            keyword = "NSET" if one.keyword == "SURFACE" and one.options.get("TYPE", "").upper() == "NODE" else one.keyword
            found: Any = self.facets(scope, one) if keyword == "SURFACE" else self.members(scope, keyword, one)
            written, before = scope.sets.get((keyword, one.name.upper()), (one.name, None))
            if before is not None:
                found = joined([before, found]) if keyword == "SURFACE" else np.union1d(before, found)
            scope.sets[keyword, one.name.upper()] = ("" if is_helper(one) else written), found

    def members(self, scope: Scope, keyword: str, one: Set) -> Ids:
        """Return the indices of a set of nodes or elements."""
        of = f"{WHAT[keyword].capitalize()} set {one.name[:60]!r}"
        if instance := one.options.get("INSTANCE"):
            if instance.upper() not in self.instances:
                raise Damaged(f"{of} is of the instance {instance[:60]!r}, which is not defined above it")
            scope = self.instances[instance.upper()]
        if keyword == "NSET" and "ELSET" in one.options:
            elements = self.found(scope, "ELSET", one.options["ELSET"], of)
            return np.unique(
                np.concatenate([NO_IDS, *(block.cells[rows].ravel() for block, rows in parts_of(self.blocks, elements))])
            )
        parts = [NO_IDS]
        for item in one.items:
            if isinstance(item, np.ndarray):
                parts.append(scope.indices(keyword, item, of))
            elif isinstance(item, str):
                parts.append(self.found(scope, keyword, item, of))
            else:
                words = [word for word in item if word]
                generate = "GENERATE" in one.options
                parts.append(scope.between(keyword, words, of) if generate else self.found(scope, keyword, item[0], of))
        return np.unique(np.concatenate(parts))

    def found(self, scope: Scope, keyword: str, word: str, of: str) -> Ids:
        """Return the indices of a node, element or set by id or name, also of an instance: INSTANCE.ID, INSTANCE.SET."""
        if word.isdigit():
            return scope.indices(keyword, ids_of([word]), of)
        if (keyword, word.upper()) in scope.sets:
            return np.asarray(scope.sets[keyword, word.upper()][1])
        for name, instance in self.instances.items():
            if word.upper().startswith(f"{name}."):
                return self.found(instance, keyword, word[len(name) + 1 :], of)
        raise Damaged(f"{of} names the set {word[:60]!r}, which is not defined above it. Move or add its *{keyword}")

    def facets(self, scope: Scope, one: Set) -> Sides:
        """Return the facets of a surface by their type, and as 'elements' the shells of which it has a side."""
        of, type = f"Surface {one.name[:60]!r}", one.options.get("TYPE", "ELEMENT").upper()
        if "COMBINE" in one.options and one.options["COMBINE"].upper() == "UNION":
            return joined([scope.sets["SURFACE", word.upper()][1] for words in one.items for word in words if word])
        if "COMBINE" in one.options or "CROP" in one.options:
            raise Damaged(f"{of} has COMBINE or CROP, which is not read. Write its elements and faces")
        if type != "ELEMENT":
            warn(f"{of} is left out: it has the type {type[:40]}, which is no facets of elements.")
            return {}
        parts = []
        for words in one.items:
            word, face = [*words, ""][:2]
            every = scope.first["ELSET"] + np.arange(len(scope.ids["ELSET"]))
            elements = self.found(scope, "ELSET", word, of) if word else every
            parts += [self.sides(block, rows, face.upper(), of) for block, rows in parts_of(self.blocks, elements)]
        return joined(parts)

    def sides(self, block: CellsOfFile, rows: Ids, face: str, of: str) -> Sides:
        """Return the sides of some elements of a block that have a label; without a label, those on the surface of the body."""
        faces, type = FACES.get(block.family, ()), self.types[block.first]
        is_shell = block.family in ("triangle", "quad") and not type.startswith(("CP", "DC2D"))
        if is_shell and face in ("", "SPOS", "SNEG", "POS", "NEG", "S1", "S2"):  # in CalculiX, S3 is the first edge of a shell
            return {"elements": block.first + rows}
        labels = {
            f"{letter}{i + add}": i
            for letter, add in ((("E", 1), ("S", 3)) if is_shell else (("S", 1),))
            for i in range(len(faces))
        }
        if face and face not in labels:
            raise Damaged(
                f"{of} has the face {face[:20]!r} of {type[:40]}; expected one of {', '.join(labels) or 'another element'}"
            )
        found = joined([block.sides(rows, corners) for corners in ([faces[labels[face]]] if face else faces)])
        return found if face else {kind: nodes[self.on_surface(nodes)] for kind, nodes in found.items()}

    def on_surface(self, facets: Ids) -> NDArray[np.bool_]:
        """Return which facets (n, m) belong to one element alone."""
        every = [block.sides(np.arange(len(block.cells)), ids) for block in self.blocks for ids in FACES.get(block.family, ())]
        kind = FACETS[facets.shape[1]]
        both = np.sort(np.concatenate([facets, *(found[kind] for found in every if kind in found)]), axis=1)
        _, number, counts = np.unique(both, axis=0, return_inverse=True, return_counts=True)
        return np.asarray(counts[np.ravel(number)[: len(facets)]] == 2)  # itself, and once more among the others

    def mesh(self) -> meshio.Mesh:
        """Return points, cells, and sets by name."""
        points = np.concatenate(self.points)
        if self.left_out:
            types = " and ".join(f"{count} {type}" for type, count in self.left_out.items())
            warn(f"{types} elements are left out: they have no volume.")
        sets = [(name, *key, *value) for name, scope in self.named for key, value in scope.sets.items() if value[0]]
        plain = Counter((keyword, capital) for _, keyword, capital, _, _ in sets)
        node_sets, places = dict[str, Ids](), dict[str, Sides]()
        for instance, keyword, capital, name, value in sets:
            for key in [name] * (not instance or plain[keyword, capital] == 1) + [f"{instance}.{name}"] * bool(instance):
                if keyword == "NSET":
                    node_sets[key] = value
                else:
                    places[key] = joined([places.get(key, {}), value if keyword == "SURFACE" else {"elements": value}])
        return mesh_of(points, [with_middle_last(block, points) for block in self.blocks], node_sets, places)


def kind_of(type: str) -> str:
    """Return the type of cells in meshio's terms of a type of elements that is read."""
    return next(kind for kind, pattern in KINDS.items() if pattern.fullmatch(type))


def is_helper(one: Set) -> bool:
    """Return whether a preprocessor made a set for its own use, such as those of the faces of a surface: _Surf-1_S3."""
    return "INTERNAL" in one.options or (one.keyword != "SURFACE" and bool(re.fullmatch(r"_.*_(S\d|SPOS|SNEG|E\d)", one.name)))


def with_middle_last(block: CellsOfFile, points: Points) -> CellsOfFile:
    """Return segments of second order (n, 3) with the middle last; some programs write it between the ends.

    The middle is the node that is nearest to the midpoint of the other two.
    """
    if block.kind != "line3":
        return block
    x = points[block.cells]
    off = np.stack([np.linalg.norm(x[:, i] - (x[:, i - 1] + x[:, i - 2]) / 2, axis=1) for i in range(3)])
    orders = np.array([[1, 2, 0], [0, 2, 1], [0, 1, 2]])
    return block._replace(cells=np.take_along_axis(block.cells, orders[off.argmin(axis=0)], axis=1))


def words_of(lines: Iterator[str]) -> list[Any]:
    """Return the ids of a set as arrays, and its other words, which are names."""
    found: list[Any] = []
    while chunk := list(islice(lines, CHUNK)):
        if (ids := numbers(chunk, np.int64)) is not None:
            found.append(ids)
        else:
            words = [word for line in chunk for word in split(line) if word]
            found += [word for word in words if not word.lstrip("+-").isdigit()]
            found.append(ids_of([word for word in words if word.lstrip("+-").isdigit()]))
    return found


def numbers(lines: list[str], dtype: Any) -> NDArray[Any] | None:
    """Return all numbers of lines, separated by commas; None if a word is blank or no number."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy warns where a text has something else than numbers
        try:
            values = np.fromstring(",".join(lines), dtype, sep=",")
        except (DeprecationWarning, ValueError):
            return None
    return values if len(values) == sum(line.count(",") + 1 for line in lines) else None


def numbers_in(lines: Iterator[str]) -> Points:
    """Return the numbers of a short section."""
    return np.array([real(word) for line in lines for word in split(line) if word])


def ids_of(words: list[str]) -> Ids:
    """Return the ids in words or lines; `Damaged` if there is something else."""
    if not words:
        return NO_IDS
    found = numbers(words, np.int64)
    if found is None or (found < 0).any() or (found > LARGEST_ID).any():
        bad = next((word for line in words for word in line.split(",") if not word.strip().isdigit()), ", ".join(words))
        raise Damaged(f"{bad.strip()[:60]!r} was found; expected ids")
    return found


def split(line: str) -> list[str]:
    """Return the words between commas, without blanks and quotes around them.

    >>> split('*NSET, NSET="left, low"')
    ['*NSET', 'NSET="left, low"']
    """
    words = COMMA.split(line) if '"' in line else line.split(",")
    return [word.strip().strip('"') if word.strip()[:1] == '"' else word.strip() for word in words]


class Files:
    """File with the files that it includes."""

    def __init__(self, path: Path) -> None:
        self.path, self.included = path, Included(path)

    def sections(self) -> Iterator[tuple[str, dict[str, str], Iterator[str]]]:
        """Yield keyword, options and lines of data of each section, also of included files; lines may be left."""
        lines = self.lines(self.path, 0)
        head = next((line for line in lines if line.startswith("*")), "")
        while head:
            following: list[str] = []
            data = until_keyword(lines, following)
            keyword, options = head_of(head)
            if not keyword[:1].isalpha():
                raise Damaged(f"{head[:60]!r} was found; expected a keyword")
            other = options.get("INPUT", "")
            yield keyword, options, self.lines(self.included.path(other), 1) if other else data
            for _ in data:
                pass
            head = following[0] if following else ""

    def lines(self, path: Path, depth: int) -> Iterator[str]:
        """Yield the lines without comments, with keyword lines whole; `*INCLUDE` yields the lines of the included file."""
        self.included.enter(path, depth)
        head = ""
        with Source(path) as source:
            for raw in iter(source.raw_line, b""):
                line = decoded(raw).strip()
                if raw[-1:] not in (b"\n", b"\r", b"\x1a", b"\0") and line[:1] not in ("", "*"):
                    raise CutOff(
                        "its last line has no end, so it may be cut within a number (end it with a newline if it is complete)"
                    )
                if not line or line.startswith("**") or line == "*":
                    continue
                if head or line[0] == "*":
                    head += line
                    if head[-1] == ",":  # goes on in the next line
                        continue
                    line, head = head, ""
                    if head_of(line)[0] == "INCLUDE":
                        yield from self.lines(self.included.path(head_of(line)[1].get("INPUT", "")), depth + 1)
                        continue
                    yield line
                else:
                    yield line.rstrip(", \t")
        if head:
            raise Damaged(f"{head[:60]!r} ends with a comma; expected further options")

    def every(self, path: Path, depth: int = 0) -> Iterator[Path]:
        """Yield the files that a file includes, and the files that these include."""
        self.included.enter(path, depth)
        with Source(path) as source:
            lines = [raw for raw in iter(source.raw_line, b"") if NAMES_FILE.match(raw)]
        for line in lines:
            if name := head_of(decoded(line).strip())[1].get("INPUT"):
                found = self.included.path(name)
                yield found
                yield from self.every(found, depth + 1)


def until_keyword(lines: Iterator[str], following: list[str]) -> Iterator[str]:
    """Yield lines until the next keyword, which is added to `following`."""
    for line in lines:
        if line.startswith("*"):
            following.append(line)
            return
        yield line


def included(path: Path) -> Iterator[Path]:
    """Yield the files that a file includes or names as its data, also within others."""
    return Files(path).every(path)


def decoded(raw: bytes) -> str:
    """Return a line of text in UTF-8, or else in Latin-1."""
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def head_of(line: str) -> tuple[str, dict[str, str]]:
    """Return the keyword in upper case, and the options.

    >>> head_of('*Element, type=C3D4, ELSET="Steel, hard"')
    ('ELEMENT', {'TYPE': 'C3D4', 'ELSET': 'Steel, hard'})
    """
    head, *rest = split(line[1:])
    pairs = (word.partition("=") for word in rest)
    return " ".join(head.upper().split()), {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
