"""Formats in XML, which meshio reads: DOLFIN's meshes (.xml), and XDMF (.xdmf) with the files that it names."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from math import prod
from pathlib import Path

import numpy as np

from .source import Damaged, check_consecutive, count_of, regular
from .uncounted import Counts


def root_of(path: Path) -> ET.Element:
    """The outermost element."""
    try:
        return ET.parse(path).getroot()
    except ET.ParseError as error:
        raise Damaged(f"its XML ends or breaks at {error}") from error


def dolfin(path: Path) -> Counts:
    """Vertices and cells with their numbers; arrays stand beside, in files of the same name and an underscore."""
    root = root_of(path)
    sizes = []
    for name in ("vertices", "cells"):
        found = list(root.iter(name))
        if len(found) != 1:
            raise Damaged(f"it has {len(found)} lists of {name}; expected one")
        size = count_of(found[0].get("size", ""), name)
        if size != len(found[0]):
            raise Damaged(f"{size} {name} are declared, {len(found[0])} are there")
        check_consecutive(np.sort([count_of(item.get("index", ""), name) for item in found[0]]), 0, name)
        sizes.append(size)
    for beside in path.resolve().parent.iterdir():
        if re.match(rf"{re.escape(path.stem)}_([^.]+)\.xml", beside.name):
            regular(beside)
            for item in root_of(beside):
                check_consecutive(
                    np.sort([count_of(one.get("index", ""), "values") for one in item]), 0, f"values in {beside.name}"
                )
                if len(item) != count_of(item.get("size", ""), "values"):
                    raise Damaged(f"{item.get('size')} values are declared in {beside.name}, {len(item)} are there")
    return sizes[0], sizes[1]


def xdmf(path: Path) -> Counts:
    """Every array in a regular file that is large enough, or in the text itself; the number of elements where it is given."""
    root = root_of(path)
    for item in root.iter("DataItem"):
        text, form = (item.text or "").strip(), item.get("Format", "XML")
        dims = [count_of(word, "numbers") for word in item.get("Dimensions", "").split()]
        size = len(text)
        if form in ("HDF", "Binary"):
            beside = path.resolve().parent / text.rpartition(":")[0] if form == "HDF" else Path(text)
            regular(beside)
            size = beside.stat().st_size * (1000 if form == "HDF" else 1)  # HDF5 may be packed
        if prod(dims) > size + 1:
            raise Damaged(f"{prod(dims)} numbers are declared, more than {size} bytes can hold")
    counts = [topology.get("NumberOfElements") or topology.get("Dimensions") for topology in root.iter("Topology")]
    return None, sum(count_of(count, "elements") for count in counts if count) if counts and all(counts) else None
