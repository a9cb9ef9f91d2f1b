"""Mesh files, each a regular file that holds what it declares; nothing is printed."""

from __future__ import annotations

from collections.abc import Collection
from importlib.resources import as_file, files
from pathlib import Path

from ..arguments import path as checked_path
from ..errors import MeshError
from .mesh import ElementMesh, checked_degree


def read_mesh(
    path: str | Path, degree: int | None = None, *, dimension: int | None = None, keep: Collection[str] = ()
) -> ElementMesh:
    """Read the elements of a mesh file: Gmsh, VTK, VTU, Abaqus and the other formats of `docs/meshes.md`.

    Taken are the elements of the highest dimension in the file: tetrahedra, triangles and segments, of second order too, with their
    curved edges, or hexahedra or quadrilaterals. Vertices are in the order of the file; the middles of edges follow in scikit-fem's
    order. Triangles and quadrilaterals are in 2D if all their z are equal, otherwise membranes in 3D; segments likewise in 1D, 2D
    or 3D. Elements of third order and higher, and hexahedra and quadrilaterals of second order, are taken by their corners.

    Physical groups, element sets and the subdomains of scikit-fem's `mesh.save` become `subdomains`, or `boundaries`
    where they hold facets. Node sets and physical points (and curves between solids) become
    `node_sets`. Segments of a file of solids become `lines` as well. If the elements are in no such group, arrays of integers with
    at most 64 values become subdomains 'NAME:VALUE'. Elements that Gmsh writes once for each of several groups are taken once.

    Parameters
    ----------
    degree : 1 takes elements of second order by their corners, with a warning that says so; 2 makes straight quadratic simplices
        of linear ones. By default each file is what it is.
    dimension : number of coordinates, if elements that are flat are to be in a space of more: 3 makes membranes of triangles
        whose z are all equal.
    keep : names of groups of facets or segments that terms bring as elements of their own, `StVK(..., simplices=NAME)`. Their
        nodes stay, though no other element has them.

    Raises
    ------
    MeshError
        if the file is missing, empty, damaged, or of a format that is unknown or refused; if it needs a package that is not
        installed, has no such elements of the dimension of its cells, or both simplices and hexahedra or quadrilaterals; if
        `dimension` is too small; if elements to `keep` are on no edge of quadratic ones.

    Warns
    -----
    StvkWarning
        of cells and vertices that are left out, and of elements of higher order that are taken by their corners.

    >>> from importlib.resources import files
    >>> sorted(read_mesh(str(files("skfem_stvk.mesh") / "data" / "bracket.msh")).subdomains)
    ['bracket', 'bushing']
    """
    from .content import content_of  # meshio is imported only when a file is read
    from .files import load

    file = checked_path("path", path, "the path of a mesh file", MeshError)
    degree, names = None if degree is None else checked_degree(degree), (keep,) if isinstance(keep, str) else keep
    mesh = ElementMesh.made_of(content_of(load(file), str(file), degree, dimension, names), str(file))
    return mesh if degree is None else mesh.with_degree(degree)


def embedded_mesh() -> ElementMesh:
    """Return an angle bracket [m] with a fillet, a bolt hole and a bushing of its own subdomain, meshed by Gmsh.

    Subdomains 'bracket' and 'bushing'; boundaries 'bolt' (the wall of the hole in the base) and 'bore' (inside the
    bushing). Half of the elements are turned round. Made by `python -m validation.meshes`.
    """
    with as_file(files("skfem_stvk.mesh") / "data" / "bracket.msh") as path:
        return read_mesh(path)
