"""Checks of a mesh, made before any work is done on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import MeshError, name_ids, warn
from ..kernels.geometry import measures
from ..kernels.topology import lexicographic_order
from .mesh import ElementMesh

#: Of edges in powers of ten: squares of volumes are numbers in double precision then.
LARGEST_EXPONENT = 50


def check_mesh(mesh: ElementMesh) -> None:
    """Refuse a mesh that cannot carry an elastic body, and warn of one that is probably not what was meant.

    Negative orientation is normal (half of the elements of `MeshTet.init_tensor`) and accepted.

    Raises
    ------
    MeshError
        with the ids of: vertices that are not finite; elements that repeat a vertex, have no volume or stand twice; vertices
        on no element.

    Warns
    -----
    StvkWarning
        of vertices in the same place, and of parts that are not connected.
    """
    if len(bad := np.flatnonzero(~np.isfinite(mesh.p).all(axis=0))):
        raise MeshError(f"{name_ids(bad, 'vertex')}: coordinates that are not finite. Was the mesh exported or scaled wrongly?")
    ordered = np.sort(mesh.t, axis=0)
    if len(bad := np.flatnonzero((ordered[1:] == ordered[:-1]).any(axis=0))):
        raise MeshError(
            f"{name_ids(bad, 'element')}: the same vertex twice, so no volume. Collapsed cells of a converter? Remove them."
        )
    if len(bad := flat_elements(mesh)):
        raise MeshError(
            f"{name_ids(bad, 'element')}: no volume, all vertices lie in one {('point', 'line', 'plane')[mesh.k - 1]} to within "
            "rounding. Remesh or remove these slivers."
        )
    check_range(mesh)
    order = lexicographic_order(ordered, mesh.nv)
    if len(same := np.flatnonzero((ordered[:, order[1:]] == ordered[:, order[:-1]]).all(axis=0))):
        bad = np.sort(order[same + 1])
        raise MeshError(
            f"{name_ids(bad, 'element')}: the same vertices as an earlier element, so the stiffness would count twice. Two "
            "overlapping physical groups, or a part exported twice? Remove the copies."
        )
    if len(unused := np.flatnonzero(np.bincount(mesh.t.ravel(), minlength=mesh.nv) == 0)):
        raise MeshError(
            f"{name_ids(unused, 'vertex')}: on no element, so K would have zero rows. Remove them: mesh.remove_unused_nodes() in "
            "scikit-fem; `skfem-stvk verify FILE` and `read_mesh` drop them."
        )
    warn_of_coincident_vertices(mesh)
    warn_of_parts(mesh)


def flat_elements(mesh: ElementMesh) -> NDArray[np.int64]:
    """Elements whose smallest height is zero to within rounding: of the coordinates, and 1e-12 of the longest edge."""
    p = mesh.p / scale_of(mesh.p)  # so that volumes neither overflow nor vanish
    parallelepiped, longest, largest_facet = measures(p, mesh.t)
    rounding = np.finfo(float).eps * np.abs(p).max(axis=0)[mesh.t].max(axis=0)
    nothing = 1e-12 * longest + 4 * rounding
    flat = parallelepiped <= nothing * largest_facet
    if mesh.k == 3:
        flat |= largest_facet <= nothing * longest  # all vertices in a line: the volume is noise of noise
    return np.flatnonzero(flat)


def scale_of(p: NDArray[np.float64]) -> float:
    """The power of two next to the largest coordinate: to divide by it costs no digit."""
    largest = float(np.abs(p).max())
    return 2.0 ** np.clip(np.floor(np.log2(largest)), -1021, 1022) if largest > 0 else 1.0


def check_range(mesh: ElementMesh) -> None:
    """Refuse lengths that energies and stiffnesses, made of squares of volumes, cannot be computed from in double precision."""
    scale = scale_of(mesh.p)
    longest = measures(mesh.p / scale, mesh.t)[1]
    low, high = (float(np.log10(length) + np.log10(scale)) for length in (longest.min(), longest.max()))
    if low < -LARGEST_EXPONENT or high > LARGEST_EXPONENT:
        raise MeshError(
            f"The elements are from 1e{low:.0f} to 1e{high:.0f} long, so energies and stiffnesses, which are made of squares of "
            f"volumes, are beyond the range of double precision; expected lengths from 1e-{LARGEST_EXPONENT} to "
            f"1e{LARGEST_EXPONENT}. Choose another unit of length."
        )


def warn_of_flat_elements(mesh: ElementMesh) -> None:
    """Warn of elements that are too flat for single precision, where errors are 1e-7 x (longest edge/smallest height)^2."""
    parallelepiped, longest, largest_facet = measures(mesh.p, mesh.t)
    aspect = longest * largest_facet / parallelepiped
    flat = np.flatnonzero(aspect > 50)
    if mesh.k > 1 and len(flat):
        warn(
            f"{name_ids(flat, 'element')}: flatter than 1:50, the flattest 1:{aspect.max():.0f}. In float32, forces across them "
            f"are off by as much as {min(1.0, 6e-8 * float(aspect.max()) ** 2):.0e} of the largest. Use float64, or remesh."
        )


def warn_of_coincident_vertices(mesh: ElementMesh) -> None:
    """Warn of vertices closer than 1e-6 of the elements' longest edge, in the median: seams that do not hold together."""
    near = 1e-6 * float(np.median(measures(mesh.p, mesh.t)[1]))
    size = np.ptp(mesh.p, axis=1).max()
    # far from zero, on which scipy's tree never ends where a library has made the process flush denormal numbers
    away = 1 + (mesh.p - mesh.p.min(axis=1, keepdims=True)) / size
    if len(pairs := cKDTree(away.T).query_pairs(near / size, output_type="ndarray")):
        warn(
            f"{name_ids(np.unique(pairs[:, 1]), 'vertex')}: in the same place as another one, so parts that touch there are not "
            "connected. Merge them if they should be, e.g. mesh.remove_duplicate_nodes() in scikit-fem."
        )


def parts(mesh: ElementMesh) -> NDArray[np.int32]:
    """(nv,) number of the connected part that each vertex belongs to; parts that share one vertex are connected."""
    links = coo_matrix((np.ones(mesh.t[1:].size), (np.tile(mesh.t[0], mesh.k), mesh.t[1:].ravel())), shape=(mesh.nv, mesh.nv))
    return connected_components(links, directed=False)[1]


def warn_of_parts(mesh: ElementMesh) -> None:
    sizes = np.sort(np.bincount(parts(mesh)))[::-1]
    if len(sizes) > 1:
        shown = ", ".join(str(size) for size in sizes[:5]) + (", ..." if len(sizes) > 5 else "")
        warn(
            f"The mesh is in {len(sizes)} parts that are not connected ({shown} vertices): each needs its own supports. If they "
            "should hold together, merge the vertices of their common faces."
        )
