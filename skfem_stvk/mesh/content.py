"""Content of mesh files: read by meshio or by the readers of this package, checked, and its elements, nodes and groups.

A file must hold the content that it declares. Parts that are omitted are reported.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

import meshio
import numpy as np
from numpy.typing import NDArray

from ..arguments import real_array
from ..errors import MeshError, StvkWarning, name_ids, warn
from .element import Element, named
from .facets import further_nodes, with_midpoints
from .formats import CHECKS, CONVERTED, PARTS, READERS, REFUSED, Counts, CutOff, Damaged, refused
from .formats.stream import check_unique
from .groups import (
    DIMENSION,
    cell_groups,
    count_cells,
    facet_groups,
    groups_of_kind,
    in_dimension,
    inner_nodes,
    is_of,
    line_groups,
    linear_kind,
    node_count,
    node_groups,
    nodes,
)
from .split import split_cells

#: What pip installs for a package, if it is an extra of this one.
EXTRAS = {"netCDF4": "'skfem-stvk[exodus]'"}


class Content(NamedTuple):
    """Arguments of `ElementMesh`."""

    p: NDArray[np.float64]
    t: NDArray[Any]
    subdomains: dict[str, NDArray[Any]]
    boundaries: dict[str, NDArray[Any]]
    node_sets: dict[str, NDArray[Any]]
    element: Element
    lines: dict[str, NDArray[Any]]


def content_in_memory(raw: meshio.Mesh, name: str) -> Content:
    """Return the elements of a meshio mesh, as `read_mesh` takes them from a file; messages begin with `name`."""
    try:
        check_cells(raw)
    except Damaged as error:
        raise MeshError(f"{name} is not a valid mesh: {error}.") from error
    return content_of(raw, name)


def content_of(
    raw: meshio.Mesh,
    name: str,
    degree: int | None = None,
    dimension: int | None = None,
    keep: Collection[str] = (),
    split: bool = True,
) -> Content:
    """Return the elements of a mesh as read, whose cells have been checked; messages begin with `name`.

    The other arguments are those of `read_mesh`.
    """
    inner, raw = inner_nodes(raw.cells), split_cells(raw, name, split)
    base = base_of(raw, name)
    element = element_of(raw, base, degree)
    warn_of_cells(raw, element, degree)
    try:
        sets = cell_groups(raw, base)
        t, subdomains = nodes(raw.cells, base, element), groups_of_kind(sets, raw, base)
        if "gmsh:physical" in raw.cell_data or (raw.info or {}).get("format") == "gmsh":
            t, subdomains = merge_copies(t, subdomains)
        facets, lines = facet_groups(raw, sets, base), line_groups(raw, sets, base)
        ends = [groups[key].ravel() for groups in (facets, lines) for key in keep if key in groups]
        numbers = node_numbers(t, base, element, len(raw.points), np.concatenate([t[:0].ravel(), *ends]))
        p = in_dimension(np.asarray(raw.points, dtype=np.float64).T[:, numbers.order], base.k, dimension_of(raw, dimension))
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from error
    warn_of_vertices(len(raw.points), base, numbers.order, inner)
    boundaries = {key: numbers.number[ids] for key, ids in facets_on(numbers.order, facets).items()}
    cables = {key: numbers.number[ids] for key, ids in lines.items()}
    cables = {key: retained for key, ids in cables.items() if (retained := ids[:, (ids >= 0).all(axis=0)]).size}
    if element.degree == 2:
        boundaries = with_edge_midpoints("Boundary", boundaries, named(element.facet), numbers, keep)
        cables = with_edge_midpoints("Lines", cables, element.edge, numbers, keep)
        cables = {key: ids[:, np.argsort(ids[-1])] for key, ids in cables.items()}  # in the order that `check_numbers` requires
    node_sets = {
        key: np.sort(numbers.number[ids]) for key, ids in nodes_on(numbers.order, inner, node_groups(raw, sets, base)).items()
    }
    return Content(p, numbers.number[t], subdomains, boundaries, node_sets, element, cables)


def check_cells(mesh: meshio.Mesh) -> None:
    """Refuse cells with a wrong number of nodes for their type or with unknown nodes, and repeated ids."""
    points = real_array(mesh.points)
    if points is None or points.ndim != 2:
        raise Damaged("its points are not rows of real numbers")
    if len(bad := np.flatnonzero(~np.isfinite(points).all(axis=1))):
        raise Damaged(f"it has {name_ids(bad, 'vertex')} with coordinates that are not finite")
    for block in mesh.cells:
        if not isinstance(block.data, np.ndarray) or not len(block):
            continue
        if block.data.dtype.kind not in "iu" or block.data.ndim != 2:
            raise Damaged(f"its {block.type} cells are not rows of vertex ids")
        if block.data.shape[1] != (node_count(block.type) or block.data.shape[1]):
            raise Damaged(f"its {block.type} cells have {block.data.shape[1]} nodes")
        if len(bad := np.flatnonzero(((block.data < 0) | (block.data >= len(mesh.points))).any(axis=1))):
            raise Damaged(f"it has {name_ids(bad, f'{block.type} cell')} with vertex ids outside 0 ... {len(mesh.points) - 1}")
    check_unique(getattr(mesh, "points_id", []), "node")
    check_unique(np.concatenate([[], *getattr(mesh, "cells_id", [])]), "element")


def base_of(raw: meshio.Mesh, name: str) -> Element:
    """Return the linear element that has the corners of the cells of the highest dimension, which are split to one kind."""
    filled = [block for block in raw.cells if len(block)]
    if not filled:
        raise MeshError(f"{name} holds no cells. Is it cut off, or a cloud of points?")
    k = max(block.dim for block in filled)
    kinds = {linear_kind(block.type) for block in filled if block.dim == k} - {""} if k > 0 else set()
    if len(kinds) == 1:
        return named(kinds.pop())
    expected = {1: "segments", 2: "triangles or quadrilaterals", 3: "tetrahedra or hexahedra"}.get(k, "elements")
    raise MeshError(
        f"{name} holds no {expected}; expected tetrahedra, hexahedra, triangles, quadrilaterals or segments, got "
        f"{count_cells(filled)}."
    )


def element_of(raw: meshio.Mesh, base: Element, degree: int | None) -> Element:
    """Return the quadratic element if all cells are of second order and `degree` is not 1, otherwise the linear element."""
    quadratic = base.quadratic
    if quadratic is None or degree == 1:
        return base
    ours = (quadratic.cell_type, base.cell.lagrange)[: 1 if quadratic.in_cells else 2]  # Lagrange cells then have another order
    known = all(block.type in ours and block.data.shape[1] == quadratic.n for block in raw.cells if is_of(block, base))
    return quadratic if known else base


def warn_of_cells(raw: meshio.Mesh, element: Element, degree: int | None) -> None:
    """Warn of cells that carry volume but are not of the kind, and of elements that are reduced to their corners."""
    carriers = [block for block in raw.cells if len(block) and block.dim == element.k]
    base = element.linear
    if others := [block for block in carriers if not is_of(block, base)]:
        warn(f"{count_cells(others)} are left out: only {base.name} are used. Split these cells if they belong to the body.")
    higher = [block for block in carriers if is_of(block, base) and block.data.shape[1] > element.n]
    if higher:
        more = ""
        if base.quadratic is not None and degree != 1:
            more = f" {base.quadratic.name.capitalize()} are used if all elements are quadratic: write the mesh in order 2."
        cells = count_cells(higher)
        warn(f"{cells} are of higher order: their corner vertices are used, and curved edges become straight.{more}")


class NodeNumbers(NamedTuple):
    """Order and new numbers of the nodes of a file.

    Attributes
    ----------
    order
        (nv,) nodes of the file in their new order: vertices, then edge midpoints.
    number
        New number of each node of the file, -1 for dropped nodes.
    between
        Corners between which the further nodes of elements lie, by new numbers (`facets.further_nodes`).
    """

    order: NDArray[Any]
    number: NDArray[np.int32]
    between: list[NDArray[np.int32]]


def node_numbers(t: NDArray[Any], base: Element, element: Element, count: int, ends: NDArray[Any]) -> NodeNumbers:
    """Return the numbers of the nodes of elements `t` (n, nt), and of other `ends`, among `count` in a file.

    Vertices keep their order; edge midpoints get scikit-fem's.
    """
    used = np.union1d(t[: base.n], ends)
    number = np.full(count, -1, dtype=np.int32)
    number[used] = np.arange(len(used))
    if element.degree == 1:
        return NodeNumbers(used, number, [])
    elements_midpoints = t[base.n :]
    if len(both := np.intersect1d(used, elements_midpoints)):
        raise MeshError(
            f"Nodes are both corners and edge midpoints, so faces do not match: {name_ids(both, 'node')} of the file, from 0. Do "
            "the elements have another node order, or are small elements tied to large ones? Remesh, or read the file with "
            "degree=1."
        )
    between, further = further_nodes(number[t[: base.n]], element, len(used))
    midpoints = np.empty(int(further.max()) + 1, dtype=np.int64)
    midpoints[further] = elements_midpoints
    if len(bad := np.flatnonzero((midpoints[further] != elements_midpoints).any(axis=0))):
        raise MeshError(
            f"{name_ids(bad, 'element')}: an edge has another midpoint than in the neighbouring element. Do the elements have "
            "another node order, or are parts joined only at their corners? Merge the nodes, or read the file with degree=1."
        )
    unique, counts = np.unique(midpoints, return_counts=True)
    if len(unique) < len(midpoints):
        raise MeshError(
            f"Several edges have the same midpoint: {name_ids(unique[counts > 1], 'node')} of the file, from 0. Do the elements "
            "have another node order? Write the file again, or read it with degree=1."
        )
    number[midpoints] = len(used) + np.arange(len(midpoints))
    return NodeNumbers(np.concatenate([used, midpoints]), number, between)


def with_edge_midpoints(
    what: str, groups: dict[str, NDArray[Any]], kind: Element, numbers: NodeNumbers, keep: Collection[str]
) -> dict[str, NDArray[Any]]:
    """Add the edge midpoints to facets or segments of this quadratic `kind`; leave out those on no element, with a warning.

    Raises
    ------
    MeshError
        if a group of `keep` has any on no element.
    """
    retained, n = {}, len(numbers.order) - sum(group.shape[1] for group in numbers.between)
    for name, corners in groups.items():
        whole = with_midpoints(corners, kind, numbers.between, n)
        good: NDArray[np.bool_] = np.all(whole >= 0, axis=0)
        if len(bad := np.flatnonzero(~good)):
            off = f"{what} {name!r}: {name_ids(bad, 'facet' if what == 'Boundary' else 'segment')}"
            if name in keep:
                raise MeshError(
                    f"{off} of {len(good)} are on no edge of the quadratic elements; expected all. Read the file with degree=1."
                )
            warn(f"{off} of {len(good)} are left out: their edges are on no element.")
        if good.any():
            retained[name] = whole[:, good]
    return retained


def dimension_of(raw: meshio.Mesh, dimension: int | None) -> int | None:
    """Return the requested dimension, or the one that the file states, if any."""
    stated = raw.cell_data.get(DIMENSION)
    return int(stated[0][0]) if dimension is None and stated is not None else dimension


def warn_of_vertices(count: int, base: Element, used: NDArray[Any], inner: NDArray[Any]) -> None:
    """Warn of vertices, out of `count`, that belong to no element and to no element of higher order."""
    if len(unused := np.setdiff1d(np.arange(count), np.union1d(used, inner))):
        warn(
            f"{name_ids(unused, 'vertex')}: dropped, because they are on none of the {base.name}; later vertices are renumbered. "
            "Are they centres of arcs, or nodes of omitted cells? To keep those of cables and membranes, give the names of these: "
            "read_mesh(path, keep=[names])."
        )


def merge_copies(t: NDArray[Any], subdomains: dict[str, NDArray[Any]]) -> tuple[NDArray[Any], dict[str, NDArray[Any]]]:
    """Merge elements that Gmsh 2.2 writes once for each of their groups; copies within one group are left for `check_mesh` to
    report.
    """
    order = np.lexsort(t)
    starts = np.append(True, (t[:, order[1:]] != t[:, order[:-1]]).any(axis=0))
    first = np.empty_like(order)
    first[order] = order[starts][np.cumsum(starts) - 1]
    retained, number = np.unique(first, return_inverse=True)
    merged = {name: np.unique(number[ids]).astype(np.int32) for name, ids in subdomains.items()}
    grouped = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *subdomains.values()]))
    if grouped.size < t.shape[1] or any(len(merged[name]) < len(ids) for name, ids in subdomains.items()):
        return t, subdomains
    return t[:, retained], merged


def facets_on(used: NDArray[Any], boundaries: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the facets whose vertices are all used, and warn of the others."""
    retained = {}
    for name, facets in boundaries.items():
        good = np.isin(facets, used).all(axis=0)
        if len(bad := np.flatnonzero(~good)):
            warn(f"Boundary {name!r}: {name_ids(bad, 'facet')} of {facets.shape[1]} are left out: they have dropped vertices.")
        if good.any():
            retained[name] = facets[:, good]
    return retained


def nodes_on(used: NDArray[Any], inner: NDArray[Any], sets: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the used nodes of each set without empty sets, and warn of lost nodes that are not inner nodes of elements."""
    retained = {}
    members_of_all = np.concatenate([used, inner, *sets.values()])
    kind = np.zeros(int(members_of_all.max(initial=-1)) + 1, dtype=np.int8)  # 0 for lost nodes
    kind[inner], kind[used] = 1, 2
    for name, members in sets.items():
        retained[name] = np.unique(members[kind[members] == 2])
        if len(lost := np.unique(members[kind[members] == 0])):
            warn(f"Node set {name!r}: {name_ids(lost, 'vertex')} of {len(members)} are left out, because they are on no element.")
    return {name: members for name, members in retained.items() if len(members)}


def load(path: Path) -> meshio.Mesh:
    """Return the points, cells, groups and data of a file."""
    check_file(path)
    try:
        return checked(path)
    except Damaged as error:
        raise damaged(path, str(error), isinstance(error, CutOff)) from error
    except PermissionError as error:
        raise MeshError(f"{path} cannot be read: {error.strerror}. Change its permissions, or copy it.") from error
    except ModuleNotFoundError as error:
        raise MeshError(
            f"Reading {path.suffix} files needs the package {error.name}, which is not installed: pip install "
            f"{EXTRAS.get(error.name or '', error.name)}"
        ) from error
    except MemoryError as error:
        raise MeshError(f"{path} declares more data than fit into memory. Is it damaged? Write it again.") from error
    except StvkWarning:  # a note of what is left out, which the user has made an error
        raise
    except Exception as error:
        raise damaged(path, f"its content is inconsistent ({error})", False) from error


def parts_of(path: Path) -> list[Path]:
    """Return the regular files of a mesh: a file, and the files that it includes or names, if it is not damaged."""
    try:
        parts = [path, *PARTS.get(path.suffix.lower(), lambda path: ())(path)]
    except (Damaged, OSError):
        parts = [path]
    return [part for part in parts if part.is_file()]


def checked(path: Path) -> meshio.Mesh:
    """Return the content of a file, which is checked before and after it is read."""
    ending = path.suffix.lower()
    if ending in READERS:
        mesh = READERS[ending](path)
    else:
        counts: Counts = CHECKS[ending](path) if ending in CHECKS else (None, None)
        mesh = quietly(path)
        check_counts(mesh, counts)
    check_cells(mesh)
    return mesh


def quietly(path: Path) -> meshio.Mesh:
    """Return the content that meshio reads; its printed lines become part of the error."""
    printed = StringIO()
    try:
        with redirect_stdout(printed), redirect_stderr(StringIO()), np.errstate(over="ignore"):
            return meshio.read(path)
    except SystemExit as error:  # meshio exits this way after printing the reason
        raise Damaged(" ".join(printed.getvalue().split()) or "meshio gives no reason") from error
    except KeyError as error:  # meshio raises it for unknown ids
        raise Damaged(f"it names {error.args[0]!r}, which is not defined in it") from error


def check_counts(mesh: meshio.Mesh, counts: Counts) -> None:
    """Refuse a mesh that differs from the declared counts."""
    for what, declared, read in zip(("nodes", "cells"), counts, (len(mesh.points), sum(map(len, mesh.cells))), strict=True):
        if declared is not None and declared != read:
            raise Damaged(f"{declared} {what} are declared, {read} were read")


def check_file(path: Path) -> None:
    """Refuse a file that is not regular, is empty, or has a refused or unknown format."""
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "does not exist"
            raise MeshError(f"{path} {what}; expected the path of a mesh file. Is the path relative to another folder?")
        name = refused(path)
    except OSError as error:
        raise MeshError(f"{path} cannot be read: {error.strerror}. Change its permissions or its folder's, or copy it.") from error
    if name:
        writer = " (as meshio writes .msh without file_format='gmsh')" if name == "Fluent" else ""
        raise MeshError(
            f"{path} is a {name} file{writer}; expected a format in which damage can be detected. If the file is whole, convert "
            "it: "
            f"meshio convert {quote(str(path))} {quote(f'{path.stem}.vtu')}"
        )
    if path.suffix.lower() in CONVERTED:
        what, way = CONVERTED[path.suffix.lower()]
        line = way.format(file=quote(str(path)), new=quote(path.stem))
        raise MeshError(
            f"{path} has the format {what}, which is not read; expected a mesh of a known format. This makes one: {line}"
        )
    known = sorted({*meshio.extension_to_filetypes, *READERS} - set(REFUSED))
    if path.suffix.lower() not in known:
        raise MeshError(
            f"{path} has the unknown extension {path.suffix!r}; known: {', '.join(known)}. Rename the file if it is of one of "
            "these formats, or convert it."
        )
    if path.stat().st_size == 0:
        raise MeshError(f"{path} is empty. Did the program that writes it fail, or is it still writing?")


def damaged(path: Path, reason: str, cut_off: bool) -> MeshError:
    """Return the error for a file that cannot be read; one of which something is missing may be cut off."""
    return MeshError(f"{path} could not be read: {reason.rstrip('.: ')}.{' Is it cut off? Write it again.' if cut_off else ''}")
