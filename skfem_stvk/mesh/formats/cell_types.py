"""meshio's tables of cell types, which it keeps in private modules: taken from there in this one place."""

from __future__ import annotations

from meshio._common import num_nodes_per_cell
from meshio._mesh import topological_dimension
from meshio._vtk_common import vtk_to_meshio_type
from meshio.abaqus._abaqus import abaqus_to_meshio_type
from meshio.gmsh.common import _gmsh_to_meshio_type

#: Number of nodes of a cell by meshio's name of its type; types that are not in it have cells of several sizes.
NODES: dict[str, int] = num_nodes_per_cell
#: meshio's names by the numbers or names of the formats.
VTK: dict[int, str] = {
    kind: name for kind, name in vtk_to_meshio_type.items() if name in topological_dimension and name != "polyhedron"
}
ABAQUS: dict[str, str] = {**abaqus_to_meshio_type, "C3D4H": "tetra", "CPE3": "triangle", "CPS6": "triangle6"}
GMSH: dict[int, str] = _gmsh_to_meshio_type
