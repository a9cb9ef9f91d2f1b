"""XML formats: VTK's unstructured grids (.vtu), read here, and XDMF's (.xdmf), which meshio reads.

VTK's arrays are text, base64 or raw, compressed or not, in one piece or several. XDMF's arrays are in files that it names.
"""

from __future__ import annotations

import base64
import binascii
import lzma
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Callable
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ...arguments import Array
from ...errors import name_ids
from ..groups import NODE_SET
from .stream import Counts, Damaged, Source, count_of, regular
from .vtk import mesh_of

TYPES = {f"{name}{8 * size}": f"{kind}{size}" for name, kind in (("Int", "i"), ("UInt", "u")) for size in (1, 2, 4, 8)}
TYPES |= {"Float32": "f4", "Float64": "f8"}
UNPACK: dict[str, Callable[[], Any]] = {"vtkZLibDataCompressor": zlib.decompressobj, "vtkLZMADataCompressor": lzma.LZMADecompressor}
#: Maximum ratio of an unpacked array to the size of the file; ids and coordinates compress to a tenth at best.
MOST = 100


def read(path: Path) -> meshio.Mesh:
    """Read all pieces with their cell data of numbers, and the node sets that `write_mesh` writes."""
    with Source(path) as source:
        if not source.file.read(1000).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
            raise Damaged("it does not begin with '<', as XML does")
    return Document(path.read_bytes()).mesh()


class Document:
    """XML of a file, and the bytes that are appended to it after an underscore, raw or in base64."""

    def __init__(self, content: bytes) -> None:
        self.size = len(content)
        head, mark, rest = content.partition(b"<AppendedData")
        tail, _, data = rest.partition(b"_")
        data, close, end = data.rpartition(b"</AppendedData>")
        if mark and not close:
            raise Damaged("<AppendedData> not closed by </AppendedData>")
        self.raw = b"raw" in tail
        self.appended = data if self.raw else data.strip()
        try:
            self.root = ET.fromstring(head + end if mark else content)
        except ET.ParseError as error:
            raise Damaged(f"its XML ends or breaks at {error}") from error
        if self.root.tag != "VTKFile" or self.root.get("type") != "UnstructuredGrid":
            raise Damaged(
                f"it is a {self.root.tag[:40]} of type {self.root.get('type', 'none')[:40]}; expected a VTKFile of an "
                "UnstructuredGrid"
            )
        self.packed = self.root.get("compressor", "")
        if self.packed and self.packed not in UNPACK:
            raise Damaged(f"it is packed by {self.packed[:40]}; write it with zlib, or without compression")
        self.order = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self.header = np.dtype(self.order + TYPES.get(self.root.get("header_type", "UInt32"), "u4"))

    def mesh(self) -> meshio.Mesh:
        pieces = [self.piece(piece) for piece in self.root.iterfind("UnstructuredGrid/Piece")]
        if not pieces:
            raise Damaged("it holds no <Piece>")
        starts = np.cumsum([0] + [len(points) for points, *_ in pieces])
        points = np.concatenate([points for points, *_ in pieces])
        connectivity, ends, used = [], [], 0
        for start, (points_of_piece, nodes, ends_of_piece, *_) in zip(starts, pieces, strict=False):
            if len(bad := np.flatnonzero((nodes < 0) | (nodes >= len(points_of_piece)))):
                cells = np.unique(np.searchsorted(ends_of_piece, bad, side="right"))
                raise Damaged(f"it has {name_ids(cells, 'cell')} with vertex ids outside 0 ... {len(points_of_piece) - 1}")
            connectivity.append(nodes + start)
            ends.append(ends_of_piece + used)
            used += len(nodes)
        cell_data, marked = together([data for *_, data, _ in pieces]), together([sets for *_, sets in pieces])
        types = np.concatenate([types for _, _, _, types, *_ in pieces])
        mesh = mesh_of(points, np.concatenate(connectivity), np.concatenate(ends), types, cell_data)
        mesh.point_sets = {name: np.flatnonzero(values) for name, values in marked.items()}
        return mesh

    def piece(self, piece: ET.Element) -> tuple[Array, Array, Array, Array, dict[str, Array], dict[str, Array]]:
        """Return points, connectivity, ends and types of cells, arrays of numbers by name, and node sets as masks."""
        nv, nt = (count_of(piece.get(f"NumberOf{what.title()}", "").strip(), what) for what in ("points", "cells"))
        points = [self.array(item, nv) for item in piece.iterfind("Points/DataArray")]
        cells = {item.get("Name"): self.array(item)[:, 0].astype(np.int64) for item in piece.iterfind("Cells/DataArray")}
        if len(points) != 1 or not {"connectivity", "offsets", "types"} <= set(cells):
            raise Damaged("the points, connectivity, offsets or types of a <Piece> are missing")
        ends, types = cells["offsets"], cells["types"]
        if len(ends) != nt or len(types) != nt:
            raise Damaged(f"{nt} cells are declared, {len(ends)} were found with {len(types)} types")
        data = {}
        for item in piece.iterfind("CellData/DataArray"):
            if item.get("type") in TYPES:
                values = self.array(item, nt)
                data[item.get("Name", "")] = values[:, 0] if values.shape[1] == 1 else values
        marked: dict[str, Array] = {}
        for item in piece.iterfind("PointData/DataArray"):
            if (name := item.get("Name", "")).startswith(NODE_SET) and item.get("type") in TYPES:
                marked[name.removeprefix(NODE_SET)] = self.array(item, nv)[:, 0] != 0
        return points[0], cells["connectivity"], ends, types, data, marked

    def array(self, item: ET.Element, rows: int | None = None) -> Array:
        """Return numbers (rows, components)."""
        name = item.get("Name", item.get("type", ""))[:60]
        kind = item.get("type", "")
        columns = count_of(item.get("NumberOfComponents") or "1", "components")
        if kind not in TYPES or not columns:
            raise Damaged(f"its array {name!r} is of the type {kind[:40]!r}, which is not supported")
        dtype = np.dtype(self.order + TYPES[kind])
        if item.get("format", "ascii") == "ascii":
            values = numbers(item.text or "", dtype, name)
        else:
            values = np.frombuffer(self.content(item, name), dtype)
        if values.size % columns or (rows is not None and values.size != rows * columns):
            raise Damaged(
                f"its array {name!r} has {values.size} numbers{f'; {rows * columns} are declared' if rows is not None else ''}"
            )
        return values.reshape(-1, columns).astype(dtype.newbyteorder("="))

    def content(self, item: ET.Element, name: str) -> bytes:
        """Return the bytes of an array in base64 or appended, unpacked."""
        coded, data = True, (item.text or "").strip().encode()
        if item.get("format") == "appended":
            coded, data = not self.raw, self.appended[count_of(item.get("offset", "").strip(), "bytes before an array") :]
        try:
            return self.unpacked(data, coded)
        except (binascii.Error, zlib.error, lzma.LZMAError, ValueError, IndexError) as error:
            raise Damaged(f"its array {name!r} is not complete ({error})") from error

    def unpacked(self, data: bytes, coded: bool) -> bytes:
        """Return the bytes after the header, which for packed data counts the blocks and gives all their sizes."""
        width = self.header.itemsize
        first = int(np.frombuffer(decoded(data, 0, width, coded)[0], self.header)[0])
        if not self.packed:
            together, _ = decoded(data, 0, width + first, coded)
            if coded and data[: len(base64.b64encode(b"0" * width))].endswith(b"="):  # the header is a separate base64 text
                return decoded(data, len(base64.b64encode(b"0" * width)), first, coded)[0]
            return together[width:]
        if first == 0:
            return b""
        if first > self.size:
            raise ValueError(f"{first} blocks are declared")
        header, after = decoded(data, 0, (3 + first) * width, coded)
        sizes = np.frombuffer(header, self.header).astype(np.int64)
        packed, _ = decoded(data, after, int(sizes[3:].sum()), coded)
        bounds = np.concatenate([[0], np.cumsum(sizes[3:])])
        if not 0 <= sizes[1] <= (MOST * self.size + 1_000_000) // first:
            raise ValueError(f"{first} blocks of {sizes[1]} bytes are declared")
        blocks = [UNPACK[self.packed]().decompress(packed[a:b], int(sizes[1]) + 1) for a, b in pairwise(bounds)]
        whole = sizes[1] * first if sizes[2] == 0 else sizes[1] * (first - 1) + sizes[2]
        if sum(map(len, blocks)) != whole:
            raise ValueError(f"{whole} bytes are declared, {sum(map(len, blocks))} were found")
        return b"".join(blocks)


def together(pieces: list[dict[str, Array]]) -> dict[str, Array]:
    """Return the arrays that all pieces have, concatenated."""
    names = set.intersection(*(set(data) for data in pieces))
    return {name: np.concatenate([data[name] for data in pieces]) for name in pieces[0] if name in names}


def decoded(data: bytes, start: int, count: int, coded: bool) -> tuple[bytes, int]:
    """Return `count` bytes from a position in raw bytes or base64, and the position after them."""
    if count < 0 or count > len(data):
        raise ValueError(f"{count} bytes are declared, {len(data) - start} were found")
    end = start + (-(-count // 3) * 4 if coded else count)
    found = base64.b64decode(data[start:end]) if coded else data[start:end]
    if len(found) < count:
        raise ValueError(f"{count} bytes are declared, {len(found)} were found")
    return found[:count], end


def numbers(text: str, dtype: np.dtype, name: str) -> Array:
    """Return numbers from text."""
    words = text.split()
    try:
        return np.array(words, dtype="U").astype(dtype) if words else np.empty(0, dtype)
    except (ValueError, OverflowError) as error:
        raise Damaged(f"its array {name!r} contains text that is not a number ({error})") from error


def root_of(path: Path) -> ET.Element:
    """Return the outermost element."""
    try:
        return ET.parse(path).getroot()
    except ET.ParseError as error:
        raise Damaged(f"its XML ends or breaks at {error}") from error


def xdmf(path: Path) -> Counts:
    """Check that every array has a regular file or a text of enough size; return the number of elements if it is stated."""
    root = root_of(path)
    for item in root.iter("DataItem"):
        text, form = (item.text or "").strip(), item.get("Format", "XML")
        dims = [count_of(word, "numbers") for word in item.get("Dimensions", "").split()]
        size = len(text)
        if (file := _outside(path, item)) is not None:
            regular(file)
            size = file.stat().st_size * (1000 if form == "HDF" else 1)  # HDF5 may be packed
        if prod(dims) > size + 1:
            raise Damaged(f"{prod(dims)} numbers are declared, more than {size} bytes can hold")
    counts = [topology.get("NumberOfElements") or topology.get("Dimensions") for topology in root.iter("Topology")]
    return None, sum(count_of(count, "elements") for count in counts if count) if counts and all(counts) else None


def xdmf_data(path: Path) -> list[Path]:
    """Return the files with arrays that a file names, each once."""
    files = [_outside(path, item) for item in root_of(path).iter("DataItem")]
    return list(dict.fromkeys(file for file in files if file is not None))


def _outside(path: Path, item: ET.Element) -> Path | None:
    """Return the file that holds an array; None if the array is in the text itself."""
    text = (item.text or "").strip()
    if item.get("Format") == "HDF":
        return path.resolve().parent / text.rpartition(":")[0]
    return Path(text) if item.get("Format") == "Binary" else None
