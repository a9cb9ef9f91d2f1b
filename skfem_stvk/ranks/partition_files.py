"""Partition files: a mesh divided into parts, of which each rank reads its own (HDF5)."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..arguments import path as checked_path
from ..arguments import whole
from ..errors import MeshError, StvkError
from ..mesh import ElementMesh, MeshLike
from ..mesh.diagnostics import check_mesh
from ..mesh.element import named
from ..mesh.read import PARTITIONS
from ..npz import Within
from ..results.complete_files import output_path, replacing
from ..solvers.runs.archive import STRICT, digest_of, validated
from .partition import INSTALL, Ids, PartContent, divide, join

#: Name of the format, and its version, which changes with the content of the files.
FORMAT, VERSION = "skfem-stvk partition", 2
PARTS = 64
#: Memory for reading and dividing a mesh [bytes], measured on 0.1 to 4 million elements: of the imports, for each corner of
#: simplices and of other elements, and for each of their further nodes.
IMPORTS, CORNER, OTHER_CORNER, FURTHER = 2e8, 110, 155, 30
Positive: TypeAlias = Annotated[int, Within(1)]
#: Fields of a part with arrays by name, and its other arrays.
NAMED = ("subdomains", "boundaries", "node_sets", "lines", "boundary_numbers", "line_numbers")
ARRAYS = ("p", "t", "node_numbers", "element_numbers", "surface", "shared", "vertices")


@dataclass(frozen=True)
class PartitionHeader:
    """Entries that all parts of a file have in common: names by kind, numbers of the whole mesh, and its bounds."""

    __pydantic_config__: ClassVar[dict[str, Any]] = STRICT

    element: str
    parts: Positive
    nodes: Positive
    elements: Positive
    bounds: list[list[float]]
    names: dict[Literal[NAMED], list[str]]  # type: ignore[valid-type]


@dataclass(frozen=True)
class PartSizes:
    """Sizes of the parts of a divided mesh.

    Attributes
    ----------
    elements, nodes, shared
        (n,) numbers of elements, of nodes, and of nodes that other parts have, too.
    """

    elements: Ids
    nodes: Ids
    shared: Ids


def write_partition(mesh: MeshLike, path: str | os.PathLike[str], parts: int = PARTS) -> PartSizes:
    """Divide a mesh, and write its parts to a file from which `distribute` reads those of each rank.

    Parts are made and written one after another. The file is complete or absent. It serves up to as many ranks as it has parts;
    fewer ranks get several neighbouring parts each. Ranks have equal shares if their number divides that of the parts.

    Parameters
    ----------
    mesh
        Mesh as for `System`, of the degree of the analysis.
    path
        Path of the file (.h5).
    parts
        Number of parts.

    Raises
    ------
    MeshError
        if the mesh cannot carry an elastic body, or has fewer elements than parts; if h5py or pymetis are missing.
    StvkError
        if the file cannot be written.

    Warns
    -----
    StvkWarning
        for vertices at the same point, and for parts of the body that are not connected.
    """
    file = output_path(path, *PARTITIONS)
    h5py, body = _h5py(), ElementMesh.of(mesh)
    whole("parts", parts, f"a number of parts from 1 to the {body.nt} elements", 1, body.nt, MeshError)
    check_mesh(body, lines_and_facets(body))
    sizes, names = [], {}
    with replacing(file) as under_way, h5py.File(under_way, "w") as out:
        for number, part in enumerate(divide(body, parts)):
            names = {kind: list(getattr(part, kind)) for kind in NAMED}
            _write(out.create_group(f"parts/{number}"), part)
            sizes.append((part.t.shape[1], part.p.shape[1], len(np.unique(part.shared[0]))))
        header = {"element": body.element.name, "parts": parts, "nodes": body.nv, "elements": body.nt, "names": names}
        out["header"] = text = json.dumps(header | {"bounds": body.bounds.tolist()})
        out.attrs.update({"format": FORMAT, "version": VERSION, "digest": digest_of(text, {})})
    return PartSizes(*np.array(sizes).T)


def needed_bytes(mesh: ElementMesh) -> float:
    """Return an estimate of the memory that reading and dividing a mesh takes [bytes]."""
    element = mesh.element
    corner = CORNER if element.is_simplex else OTHER_CORNER
    return IMPORTS + mesh.nt * (corner * element.corners + FURTHER * (element.n - element.corners))


def lines_and_facets(mesh: ElementMesh) -> list[ElementMesh]:
    """Return the meshes of named lines and facets with nodes that are on no other element: cables and membranes of a solid."""
    used = np.zeros(mesh.nv, dtype=bool)
    used[mesh.t] = True
    if used.all():
        return []
    found = [(np.asarray(ids), mesh.element.edge) for ids in mesh.lines.values()]
    found += [(np.asarray(ids), mesh.facet) for ids in mesh.boundaries.values()]
    return [mesh.beside(ids, element) for ids, element in found if not used[ids].all()]


def read_part(path: str | os.PathLike[str], rank: int, ranks: int) -> PartContent:
    """Return the part of a rank, joined from its parts in a partition file; nothing else is read.

    Parameters
    ----------
    path
        Path of a file of `write_partition`.
    rank, ranks
        Number of the rank, and number of ranks.

    Raises
    ------
    MeshError
        if the file is missing, damaged, or of another format or version; if it has fewer parts than there are ranks.
    """
    file = checked_path("path", path, "the path of a partition file", MeshError)
    with _opened(file) as source:
        text = source["header"].asstr()[()]
        if source.attrs["digest"] != digest_of(text, {}):
            raise ValueError("its header was changed after it was written")
        header = validated(PartitionHeader, json.loads(text))
        if ranks > (parts := header.parts):
            raise MeshError(
                f"{file} has {parts} part{'s' * (parts > 1)}; expected at least one for each of the {ranks} ranks. Divide the mesh "
                f"again: skfem-stvk partition MESH {file} --parts {max(PARTS, 4 * ranks)}."
            )
        rank_of = np.arange(parts) * ranks // parts
        own = np.flatnonzero(rank_of == rank)
        return join([_read(source[f"parts/{number}"], header) for number in own], own.tolist(), rank_of)


def _write(group: Any, part: PartContent) -> None:
    """Write the arrays of a part, and their digest."""
    arrays = {name: np.asarray(getattr(part, name)) for name in ARRAYS}
    arrays |= {f"{kind}/{number}": ids for kind in NAMED for number, ids in enumerate(getattr(part, kind).values())}
    for name, array in arrays.items():
        group[name] = array
    group.attrs["digest"] = digest_of(group.name, arrays)


def _read(group: Any, header: PartitionHeader) -> PartContent:
    """Return a part. Raise ValueError if its arrays were changed, or have ids of nodes, elements or parts that do not exist."""
    named_arrays = {f"{kind}/{number}": (kind, name) for kind in NAMED for number, name in enumerate(header.names[kind])}
    arrays: dict[str, NDArray[Any]] = {name: group[name][()] for name in (*ARRAYS, *named_arrays)}
    if group.attrs["digest"] != digest_of(group.name, arrays):
        raise ValueError(f"{group.name} was changed after it was written")
    content: dict[str, Any] = {kind: {} for kind in NAMED} | {name: arrays[name] for name in ARRAYS}
    for key, (kind, name) in named_arrays.items():
        content[kind][name] = arrays[key]
    content |= {"element": named(header.element), "bounds": np.array(header.bounds), "vertices": int(arrays["vertices"])}
    part = PartContent(**content)
    _check_ids(part, header)
    return part


def _check_ids(part: PartContent, header: PartitionHeader) -> None:
    """Raise ValueError for ids of nodes, elements or parts that do not exist."""
    (_, nv), (_, nt) = part.p.shape, part.t.shape
    of_nodes = part.t, part.surface, part.shared[0], *part.boundaries.values(), *part.node_sets.values(), *part.lines.values()
    counts = [(ids, nv) for ids in of_nodes] + [(ids, nt) for ids in part.subdomains.values()]
    counts += [(part.node_numbers, header.nodes), (part.element_numbers, header.elements), (part.shared[1], header.parts)]
    for ids, count in counts:
        if ids.size and not 0 <= ids.min() <= ids.max() < count:
            raise ValueError(f"it has the id {ids.max() if ids.max() >= count else ids.min()}; expected ids below {count}")


@contextmanager
def _opened(file: Path) -> Iterator[Any]:
    """Yield the content of a partition file; raise MeshError for any other file."""
    h5py, other = _h5py(), f"expected a file of `skfem-stvk partition MESH {file.stem}.h5`"
    if not file.is_file():
        raise MeshError(f"{file} {'is not a regular file' if file.exists() else 'does not exist'}; {other}.")
    try:
        with h5py.File(file, "r", locking=False) as source:
            if source.attrs.get("format") != FORMAT:
                raise MeshError(f"{file} is another HDF5 file; {other}. Meshes are read by read_mesh: distribute(read_mesh(path)).")
            if (version := source.attrs["version"]) != VERSION:
                raise MeshError(f"{file} has version {version} of the format; expected {VERSION}. Divide the mesh again.")
            yield source
    except StvkError:
        raise
    except PermissionError as error:
        raise MeshError(f"{file} cannot be read: {error.strerror}. Change its permissions, or copy it.") from error
    except Exception as error:  # h5py raises many kinds of errors for damaged files
        if not h5py.is_hdf5(file):
            hint = " Is it a mesh? distribute(read_mesh(path)) divides it."
            raise MeshError(f"{file} is not an HDF5 file; {other}.{hint}") from error
        raise MeshError(f"{file} is damaged: {error}. Was it copied completely? Copy or write it again.") from error


def _h5py() -> Any:
    """Return the package h5py."""
    try:
        import h5py
    except ImportError as error:
        raise MeshError(f"Partition files are HDF5, and h5py is missing ({error}). {INSTALL}") from error
    return h5py
