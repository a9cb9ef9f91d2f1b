"""Checks of a mesh, before any other work."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, Remark, name_ids, warn
from ..kernels.simplex_geometry import measures
from .facets import Cells, MeshArrays, grouped, linked
from .geometry import aspect_ratios, edge_differences
from .mesh import ElementMesh
from .points import base_vectors_at, extremes, rule_of, signed

#: Limits of edges, as powers of ten: squares of volumes are then in the range of double precision.
LARGEST_EXPONENT = 50
#: Tolerance of projections of points of size one.
ROUND_OFF = 1e-14
#: Number of elements that are checked together, at all of their points: some 40 of 9 numbers each fit into the cache.
CHUNK = 512


def check_mesh(mesh: ElementMesh, others: Sequence[ElementMesh] = (), in_parts: bool = False) -> None:
    """Refuse a mesh that cannot carry an elastic body, and warn of a mesh that is probably not intended.

    The `others` are meshes on the same nodes, such as cables. Each of them is checked as well, and its nodes count as nodes on an
    element. `in_parts` says that parts that are not connected are intended.

    Negative orientation is normal (half of the elements of `MeshTet.init_tensor`) and accepted. `mesh_quality` reports all faults.
    A mesh that was checked as a whole is not checked again in parts.

    Raises
    ------
    MeshError
        with the ids of: vertices that are not finite; elements that repeat a vertex, have no volume, are duplicates, or, for
        curved elements and boxes, fold over themselves; vertices on no element.

    Warns
    -----
    StvkWarning
        for vertices at the same point, and for parts that are not connected.
    """
    for one in others if mesh.checked else (mesh, *others):
        for fault in faults(one, (*others, mesh)):
            if one is not mesh and fault.name not in ("collapsed", "flat", "folded", "duplicates"):
                continue  # this is a fault of nodes, reported once
            if in_parts and fault.name == "parts":
                continue
            text = f"The {one.element.name}: {fault.text}" if others else fault.text
            if fault.refused:
                raise MeshError(text)
            warn(text)


def faults(mesh: ElementMesh, together: Sequence[ElementMesh] = ()) -> Iterator[Remark]:
    """Yield all faults of a mesh, refused ones first; each search starts on request.

    Meshes `together` with it on the same nodes also determine which nodes are on elements, and which parts are connected.
    """
    together = together or (mesh,)
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(mesh.p).all(axis=0))
    if len(bad := np.flatnonzero(~finite)):
        text = f"{name_ids(bad, mesh.word)}: coordinates that are not finite. Was the mesh exported or scaled wrongly?"
        yield Remark("not finite", bad, text)
    ordered = np.sort(mesh.t, axis=0)
    collapsed = (ordered[1:] == ordered[:-1]).any(axis=0)
    if len(bad := np.flatnonzero(collapsed)):
        text = f"{name_ids(bad, 'element')}: the same {mesh.word} twice, so no volume. Collapsed cells of a converter? Remove them."
        yield Remark("collapsed", bad, text)
    sound, retained = sound_elements(mesh, finite, collapsed)
    if len(retained):
        yield from _faults_of_shapes(sound, retained)
        yield from _faults_of_range(sound)
    ordered = ordered if mesh.element.degree == 1 else np.sort(mesh.corners, axis=0)
    order, new = grouped(ordered, mesh.nv)
    if len(bad := np.sort(order[~new])):
        text = (
            f"{name_ids(bad, 'element')}: the same vertices as an earlier element, so the stiffness would count twice. Two "
            "overlapping physical groups, or a part exported twice? Remove the copies."
        )
        yield Remark("duplicates", bad, text)
    if len(unused := np.flatnonzero(~_on_elements(together))):
        text = (
            f"{name_ids(unused, mesh.word)}: on no element, so K would have zero rows. Remove them: mesh.remove_unused_nodes() in "
            "scikit-fem; `skfem-stvk verify FILE` and `read_mesh` drop them."
        )
        yield Remark("unused", unused, text)
    if len(retained):
        yield from _coincident_vertices(mesh, sound, finite)
    yield from _parts_apart(mesh, together)


def sound_elements(
    mesh: ElementMesh, finite: NDArray[np.bool_], collapsed: NDArray[np.bool_]
) -> tuple[MeshArrays, NDArray[np.int64]]:
    """Return the elements, and their ids, without `collapsed` (nt,) corners and with all nodes `finite` (nv,)."""
    if finite.all() and not collapsed.any():
        return mesh, np.arange(mesh.nt)
    retained = np.flatnonzero(finite[mesh.t].all(axis=0) & ~collapsed)
    somewhere = mesh.p[:, [np.argmax(finite)]] if finite.any() else np.zeros((mesh.d, 1))
    return Cells(np.where(finite, mesh.p, somewhere), np.ascontiguousarray(mesh.t[:, retained]), mesh.element), retained


def _faults_of_shapes(mesh: MeshArrays, ids: NDArray[np.int64]) -> Iterator[Remark]:
    """Yield faults for simplices without volume, and for elements whose Jacobian vanishes or changes its sign."""
    if mesh.element.is_linear_simplex:
        if len(bad := ids[flat_elements(mesh)]):
            text = (
                f"{name_ids(bad, 'element')}: no volume, all vertices lie in one {('point', 'line', 'plane')[mesh.k - 1]} to "
                "within rounding. Remesh or remove these slivers."
            )
            yield Remark("flat", bad, text)
    elif len(bad := ids[folded_elements(mesh)]):
        quadratic = mesh.element.degree == 2
        order = "edge midpoints" if quadratic else "vertices"
        otherwise = "an edge that is curved too far" if quadratic else "a corner that is pushed in or flat"
        advice = (
            "straighten them alone: read_mesh(path, straighten=True), or all: degree=1, mesh.with_degree(1)"
            if quadratic
            else "remesh"
        )
        text = (
            f"{name_ids(bad, 'element')}: the Jacobian vanishes or changes its sign among their points and nodes, so they fold "
            f"over themselves. Are their {order} in another order ({element_order(mesh)} is expected), or is there {otherwise}? "
            f"Look at them, or {advice}."
        )
        yield Remark("folded", bad, text)


def straightened(mesh: ElementMesh) -> ElementMesh:
    """Return the mesh with straight edges in the quadratic elements that fold over themselves, and warn of these."""
    p, every = mesh.p.copy(), np.empty(0, dtype=np.int64)
    while (bad := np.setdiff1d(folded_elements(Cells(p, mesh.t, mesh.element)), every)).size:  # neighbours may fold then
        for i, corners in enumerate(mesh.element.means):
            p[:, mesh.t[mesh.element.corners + i, bad]] = p[:, mesh.t[list(corners)][:, bad]].mean(axis=1)
        every = np.union1d(every, bad)
    if not every.size:
        return mesh
    warn(f"{name_ids(every, 'element')}: straightened, because they fold over themselves with curved edges.")
    return replace(mesh, p=p)


def element_order(mesh: MeshArrays) -> str:
    """Return the local order of nodes in words."""
    edges = ", ".join(f"{a}{b}" for a, b in mesh.element.edges)
    if mesh.element.degree == 1:
        return f"scikit-fem's {mesh.element.cell.reference.__name__}, with edges {edges},"
    others = ", of faces and of the cell" * (mesh.element.means != mesh.element.edges)
    return f"corners, then the midpoints of {edges}{others},"


def flat_elements(mesh: MeshArrays) -> NDArray[np.int64]:
    """Return linear simplices whose smallest height is below rounding of the coordinates, or 1e-12 of the longest edge."""
    p = mesh.p / scale_of(mesh.p)  # so that volumes neither overflow nor underflow
    parallelepiped, longest, largest_facet = measures(p, mesh.t)
    rounding = np.finfo(float).eps * np.abs(p).max(axis=0)[mesh.t].max(axis=0)
    tolerance = 1e-12 * longest + 4 * rounding
    flat = parallelepiped <= tolerance * largest_facet
    if mesh.k == 3:
        flat |= largest_facet <= tolerance * longest  # for collinear vertices the volume is only rounding
    return np.flatnonzero(flat)


def folded_elements(mesh: MeshArrays) -> NDArray[np.int64]:
    """Return elements whose Jacobian vanishes or changes its sign among its points (usual and exact rules) and nodes.

    In a space of more dimensions, the sign is negative where the element is rotated by more than a right angle from its base
    vectors at the centre. Zero is a height as in `flat_elements`. The height is at least `|J| / |P|^(k - 1)`, so it is computed
    only where this bound is small.
    """
    p, element = mesh.p / scale_of(mesh.p), mesh.element
    rules = [rule_of(element, kind).points for kind in ("one-point", "usual", "exact")]
    xi = np.concatenate([*rules, element.nodes])
    bad = []
    for begin in range(0, mesh.nt, CHUNK):
        t = mesh.t[:, begin : begin + CHUNK]
        rounding = np.finfo(float).eps * np.abs(p[:, t]).max(axis=(0, 1))[:, None]
        base_vectors = base_vectors_at(p, t, element, xi)
        jacobian = signed(base_vectors, base_vectors[:, :1])
        size = np.sqrt((base_vectors * base_vectors).sum(axis=(2, 3)))
        doubtful = ~(np.abs(jacobian) > (1e-12 * 2 * size + 4 * rounding) * size ** (mesh.k - 1)).all(axis=1)
        folded = np.sign(jacobian.min(axis=1)) * np.sign(jacobian.max(axis=1)) <= 0
        if doubtful.any():
            longest, steepest = extremes(base_vectors[doubtful], element.is_simplex)
            folded[doubtful] |= ~(steepest * (1e-12 * longest + 4 * rounding[doubtful]) < 1).all(axis=1)
        bad.append(begin + np.flatnonzero(folded))
    return np.concatenate(bad)


def scale_of(p: NDArray[np.float64]) -> float:
    """Return the power of two next to the largest coordinate; division by it has no rounding error."""
    largest = float(np.abs(p).max())
    return 2.0 ** np.clip(np.floor(np.log2(largest)), -1021, 1022) if largest > 0 else 1.0


def _faults_of_range(mesh: MeshArrays) -> Iterator[Remark]:
    """Yield faults for elements of a size at which squares of volumes leave the range of double precision."""
    scale = scale_of(mesh.p)
    longest = longest_edges(mesh, mesh.p / scale)
    longest = longest[longest > 0]
    if not len(longest):
        return
    low, high = (float(np.log10(length) + np.log10(scale)) for length in (longest.min(), longest.max()))
    if low < -LARGEST_EXPONENT or high > LARGEST_EXPONENT:
        text = (
            f"The elements are from 1e{low:.0f} to 1e{high:.0f} long, so energies and stiffnesses, which are made of squares of "
            f"volumes, are beyond the range of double precision; expected lengths from 1e-{LARGEST_EXPONENT} to "
            f"1e{LARGEST_EXPONENT}. Choose another unit of length."
        )
        yield Remark("range", np.empty(0, dtype=np.int64), text)


def longest_edges(mesh: MeshArrays, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the longest edge of each element, from corner to corner, (nt,)."""
    if mesh.element.is_simplex:
        return measures(p, mesh.corners)[1]
    return np.asarray(np.linalg.norm(edge_differences(mesh, p), axis=0).max(axis=0))


def warn_of_flat_elements(mesh: ElementMesh) -> None:
    """Warn of elements that are too flat for single precision, where errors are up to 6e-7 x longest edge/smallest height."""
    aspect = aspect_ratios(mesh)
    if len(flat := np.flatnonzero(aspect > 1000)):
        warn(
            f"{name_ids(flat, 'element')}: flatter than 1:1000, the flattest 1:{aspect.max():.0f}. In float32, forces across them "
            f"are off by as much as {min(1.0, 6e-7 * float(aspect.max())):.0e} of the largest. Use float64, or remesh."
        )


def _coincident_vertices(mesh: ElementMesh, sound: MeshArrays, finite: NDArray[np.bool_]) -> Iterator[Remark]:
    """Yield a fault for nodes closer than 1e-6 of the median longest edge: unconnected seams."""
    near = 1e-6 * float(np.median(longest_edges(sound, sound.p)))
    nodes = np.flatnonzero(finite)
    p = mesh.p if len(nodes) == mesh.nv else mesh.p[:, nodes]
    size = np.ptp(p, axis=1).max()
    if not size > 0:
        return
    # shifted away from zero, where scipy's tree never ends if a library made the process flush denormal numbers
    away = 1 + (p - p.min(axis=1, keepdims=True)) / size
    close = _close_along_a_line(away, near / size)
    if not len(close):
        return
    from scipy.spatial import cKDTree  # slow to import, and few meshes need it

    if len(pairs := cKDTree(away[:, close].T).query_pairs(near / size, output_type="ndarray")):
        bad = np.unique(nodes[close[pairs[:, 1]]])
        text = (
            f"{name_ids(bad, mesh.word)}: at the same point as another {mesh.word}, so parts that touch there are not "
            "connected. Merge them if they should be, e.g. mesh.remove_duplicate_nodes() in scikit-fem."
        )
        yield Remark("coincident", bad, text, refused=False)


def _close_along_a_line(x: NDArray[np.float64], near: float) -> NDArray[np.intp]:
    """Return ids of points (d, n) of size one that include all with others within `near`: by projections on one line."""
    along = np.array([0.7236067977, 0.5877852523, 0.3616170474])[: len(x)] @ x  # a line with which no mesh is aligned
    order = np.argsort(along)
    meets = np.diff(along[order]) <= near + ROUND_OFF
    return np.sort(order[np.append(meets, False) | np.append(False, meets)])


def parts(meshes: Sequence[ElementMesh]) -> NDArray[np.int32]:
    """Return the number of the connected part of each node (nv,) of meshes on the same nodes; one shared node connects parts."""
    a = np.concatenate([np.tile(mesh.t[0], len(mesh.t) - 1) for mesh in meshes])
    b = np.concatenate([mesh.t[1:].ravel() for mesh in meshes])
    return linked(a, b, meshes[0].nv)


def _on_elements(meshes: Sequence[ElementMesh]) -> NDArray[np.bool_]:
    """Return whether each node of meshes on the same nodes is on an element, (nv,)."""
    used = np.zeros(meshes[0].nv, dtype=bool)
    for mesh in meshes:
        used[mesh.t.ravel()] = True
    return used


def sizes_of_parts(meshes: Sequence[ElementMesh]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the number of the connected part of each node (nv,) of meshes on the same nodes, and the nodes of each part (n,).

    A node on no element is a separate part, which counts 0 nodes.
    """
    part = parts(meshes)
    used = _on_elements(meshes)
    return part, np.bincount(part[used], minlength=int(part.max()) + 1).astype(np.int64)


def _parts_apart(mesh: ElementMesh, together: Sequence[ElementMesh]) -> Iterator[Remark]:
    """Yield a fault if parts are not connected, with the nodes of all but the largest."""
    part, count = sizes_of_parts(together)
    sizes = np.sort(count[count > 0])[::-1]
    if len(sizes) > 1:
        shown = ", ".join(str(size) for size in sizes[:5]) + (", ..." if len(sizes) > 5 else "")
        text = (
            f"The mesh is in {len(sizes)} parts that are not connected ({shown} {mesh.words}): each needs its own supports. If "
            "they should hold together, merge the vertices of their common faces."
        )
        yield Remark("parts", np.flatnonzero((part != count.argmax()) & (count[part] > 0)), text, refused=False)
