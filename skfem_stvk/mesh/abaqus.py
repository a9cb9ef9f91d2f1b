"""Sets of Abaqus input files: meshio assigns elements to the wrong ones where not every block names one, and misses nodes of sets of sets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError

Section = tuple[str, dict[str, str], list[list[str]]]


def element_sets(path: Path, cells: Sequence[Any]) -> dict[str, list[NDArray[np.int64]]]:
    """Elements of each set by name, as ids within each of the cell blocks of the file.

    Sets may be named by `*ELEMENT, ELSET=` and by `*ELSET`: of element ids, ranges (`GENERATE`) or other sets.

    Raises
    ------
    MeshError
        if a set has a member that is not there.
    """
    blocks: list[NDArray[np.int64]] = []
    sets: dict[str, NDArray[np.int64]] = {}
    for keyword, options, lines in sections(path):
        if keyword == "ELEMENT":
            numbers = np.array([word for line in lines for word in line], dtype=np.int64)
            members = numbers.reshape(-1, 1 + cells[len(blocks)].data.shape[1])[:, 0]
            blocks.append(members)
        elif keyword == "ELSET":
            members = set_members("ELSET", options, lines, sets)
        if keyword in ("ELEMENT", "ELSET"):
            add_to_set("ELSET", options, members, sets)
    return {name: [np.flatnonzero(np.isin(block, members)) for block in blocks] for name, members in sets.items()}


def node_sets(path: Path) -> dict[str, NDArray[np.int64]]:
    """Positions of the nodes of each set by name, in the order of the file.

    Sets may be named by `*NODE, NSET=` and by `*NSET`: of node ids, ranges (`GENERATE`) or other sets.

    Raises
    ------
    MeshError
        if a set has a member that is not there.
    """
    nodes = np.empty(0, dtype=np.int64)
    sets: dict[str, NDArray[np.int64]] = {}
    for keyword, options, lines in sections(path):
        if keyword == "NODE":
            members = nodes = np.array([line[0] for line in lines], dtype=np.int64)
        elif keyword == "NSET":
            members = set_members("NSET", options, lines, sets)
        if keyword in ("NODE", "NSET"):
            add_to_set("NSET", options, members, sets)
    return {name: np.flatnonzero(np.isin(nodes, members)) for name, members in sets.items()}


def set_members(
    kind: str, options: dict[str, str], lines: list[list[str]], sets: dict[str, NDArray[np.int64]]
) -> NDArray[np.int64]:
    """Ids of an `*ELSET` or `*NSET` section."""
    members: list[int] = []
    for line in lines:
        if "GENERATE" in options:
            first, last, *step = (int(word) for word in line)
            members += range(first, last + 1, *step)
            continue
        for word in line:
            if word.isdigit():
                members.append(int(word))
            elif same_name(word, sets) in sets:
                members += sets[same_name(word, sets)].tolist()
            else:
                what = "Element" if kind == "ELSET" else "Node"
                raise MeshError(
                    f"{what} set {options.get(kind)!r} names the set {word!r}, which is not defined above it. Move or add its *{kind}."
                )
    return np.array(members, dtype=np.int64)


def add_to_set(kind: str, options: dict[str, str], members: NDArray[np.int64], sets: dict[str, NDArray[np.int64]]) -> None:
    """Add the members to the set that the section names, if it does."""
    if kind in options:
        name = same_name(options[kind], sets)
        sets[name] = np.union1d(sets.get(name, []), members).astype(np.int64)


def same_name(name: str, sets: dict[str, NDArray[np.int64]]) -> str:
    """The name as it was first written: upper and lower case count as the same."""
    return next((known for known in sets if known.upper() == name.upper()), name)


def sections(path: Path) -> Iterator[Section]:
    """Keyword, options and data lines (in words) of each section of the file and of those that it includes."""
    keyword, options, lines = "", dict[str, str](), list[list[str]]()
    for line in path.read_text(errors="replace").splitlines():
        if line.startswith("**") or not line.strip():
            continue
        if not line.startswith("*"):
            lines.append([word.strip() for word in line.split(",") if word.strip()])
            continue
        yield keyword, options, lines
        head, *rest = line[1:].split(",")
        keyword, lines = head.strip().upper(), []
        options = {key.strip().upper(): value.strip() for key, _, value in (word.partition("=") for word in rest)}
        if keyword == "INCLUDE":
            included = Path(options["INPUT"])
            yield from sections(included if included.exists() else path.parent / included)
    yield keyword, options, lines


def check_one_node_section(path: Path) -> None:
    """Refuse files whose nodes stand in several sections, of which meshio would keep only the last."""
    count = sum(keyword == "NODE" for keyword, _, _ in sections(path))
    if count > 1:
        raise MeshError(
            f"{path} has {count} *NODE sections; expected one. An assembly of several parts? Export one part, or merge the parts into one."
        )
