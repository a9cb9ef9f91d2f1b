"""Mesh files; a file must be regular and hold the content that it declares. Nothing is printed."""

from __future__ import annotations

import os
from collections.abc import Collection
from importlib.resources import as_file, files
from pathlib import Path

from ..arguments import path as checked_path
from ..errors import MeshError
from .diagnostics import straightened
from .mesh import ElementMesh, checked_degree

#: Suffixes of partition files, of which each rank reads its part; see `skfem_stvk.ranks`.
PARTITIONS = ".h5", ".hdf5"


def is_partition(path: str | os.PathLike[str]) -> bool:
    """Return whether a path is that of a partition file by its suffix, and not of a mesh.

    >>> is_partition("bracket.h5"), is_partition("bracket.msh")
    (True, False)
    """
    return Path(path).suffix.lower() in PARTITIONS


def read_mesh(
    path: str | Path,
    degree: int | None = None,
    *,
    dimension: int | None = None,
    keep: Collection[str] = (),
    split: bool = True,
    straighten: bool = False,
) -> ElementMesh:
    """Read the elements of a mesh file: Gmsh, VTK, VTU, Abaqus and the other formats of `docs/reference/mesh-files.md`.

    The elements of the highest dimension in the file are read: tetrahedra, triangles and segments, also of second order with curved
    edges, or hexahedra or quadrilaterals. Vertices are in the order of the file; edge midpoints follow in scikit-fem's order.
    Triangles and quadrilaterals are in 2D if all their z are equal, otherwise membranes in 3D; segments likewise in 1D, 2D or 3D.
    Elements of third order and higher, and hexahedra and quadrilaterals of second order, are reduced to their corners.

    Physical groups, element sets and the subdomains of scikit-fem's `mesh.save` become `subdomains`, or `boundaries` if they
    contain facets. Node sets and physical points (and curves between solids) become `node_sets`. Segments in a file of solids also
    become `lines`. If the elements are in no such group, arrays of integers with at most 64 values become subdomains 'NAME:VALUE'.
    Elements that Gmsh writes once for each of several groups are read once.

    Parameters
    ----------
    path
        Path of the file.
    degree
        1 reduces elements of second order to their corners, with a warning; 2 makes straight quadratic simplices of linear ones. By
        default the degree is that of the file.
    dimension
        Number of coordinates, for flat elements in a space of more dimensions: 3 makes membranes of triangles with equal z.
    keep
        Names of groups of facets or segments that terms use as their own elements, `StVK(..., simplices=NAME)`. Their nodes stay,
        even without another element.
    split
        Whether wedges, pyramids, hexahedra with a repeated vertex, and elements of another kind next to them are split into
        tetrahedra, and quadrilaterals next to triangles into triangles, with a warning. False refuses such a file.
    straighten
        Whether quadratic elements that fold over themselves get straight edges, with a warning.

    Returns
    -------
    ElementMesh
        The elements of the highest dimension, with subdomains, boundaries, node sets and lines by name.

    Raises
    ------
    MeshError
        if the file is missing, empty, damaged, or of a format that is unknown or refused; if it needs a package that is not
        installed; if it has no such elements of the dimension of its cells, or both simplices and hexahedra or quadrilaterals;
        if `dimension` is too small; if elements to `keep` are not on an edge of the quadratic elements.

    Warns
    -----
    StvkWarning
        for cells and vertices that are left out, and for elements of higher order that are reduced to their corners.

    Examples
    --------
    >>> from importlib.resources import files
    >>> sorted(read_mesh(str(files("skfem_stvk.mesh") / "data" / "bracket.msh")).subdomains)
    ['bracket', 'bushing']
    """
    from .content import content_of, load  # meshio is imported only for reading files

    file = checked_path("path", path, "the path of a mesh file", MeshError)
    degree, names = None if degree is None else checked_degree(degree), (keep,) if isinstance(keep, str) else keep
    mesh = ElementMesh.made_of(content_of(load(file), str(file), degree, dimension, names, split), str(file))
    mesh = mesh if degree is None else mesh.with_degree(degree)
    return straightened(mesh) if straighten else mesh


def embedded_mesh() -> ElementMesh:
    """Return an angle bracket [m] with a fillet, a bolt hole and a bushing of its own subdomain.

    Subdomains are 'bracket' and 'bushing'; boundaries are 'bolt' (the wall of the hole in the base) and 'bore' (inside the
    bushing). Half of the elements have negative orientation.

    Returns
    -------
    ElementMesh
        The mesh of linear tetrahedra.

    Notes
    -----
    Meshed by Gmsh. `python -m validation.meshes` makes the file.

    Examples
    --------
    >>> mesh = embedded_mesh()
    >>> mesh, sorted(mesh.boundaries), mesh.elements("bushing").size
    (ElementMesh: 2862 tetrahedra in 3D, 822 vertices, ['bolt', 'bore'], 397)
    """
    with as_file(files("skfem_stvk.mesh") / "data" / "bracket.msh") as path:
        return read_mesh(path)
