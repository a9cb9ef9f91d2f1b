"""What the studies ask of meshes: `python -m validation.meshes` writes the one that comes with the package."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from numpy.typing import NDArray

import skfem_stvk.mesh
from skfem_stvk import ElementMesh
from skfem_stvk.bench.meshes import bracket
from skfem_stvk.mesh import read_mesh
from skfem_stvk.mesh.geometry import Geometry

EMBEDDED = Path(skfem_stvk.mesh.__file__).with_name("data") / "bracket.msh"
EMBEDDED_SIZE = 8e-3  # [m]
FINE_SIZE = 2.5e-3  # [m]; 26 000 tetrahedra


def save(mesh: ElementMesh, file: Path) -> None:
    """Write the groups of tetrahedra and of facets as physical groups of a binary Gmsh 2.2 file."""
    cells, tags, names = [], [], {}
    groups = [(3, "tetra", name, mesh.t[:, ids]) for name, ids in mesh.subdomains.items()]
    groups += [(2, "triangle", name, facets) for name, facets in mesh.boundaries.items()]
    for tag, (dimension, cell_type, name, vertices) in enumerate(groups, start=1):
        cells.append((cell_type, vertices.T))
        tags.append(np.full(vertices.shape[1], tag))
        names[name] = np.array([tag, dimension])
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    meshio.write(file, meshio.Mesh(mesh.p.T, cells, cell_data=data, field_data=names), file_format="gmsh22", binary=True)


def signed_volumes(mesh: ElementMesh) -> NDArray[np.float64]:
    """(nt,) volumes [m^3], negative where an element is turned round."""
    x = mesh.p.T[mesh.t.T]
    return np.asarray(np.linalg.det(x[:, 1:] - x[:, :1]) / 6)


def dihedral_angles(mesh: ElementMesh) -> NDArray[np.float64]:
    """(6, nt) angles between the faces of each tetrahedron [degrees]."""
    g = Geometry(mesh.p, mesh.t).gradients
    g = g / np.linalg.norm(g, axis=2, keepdims=True)
    pairs = [(a, b) for a in range(4) for b in range(a)]
    return np.degrees([np.arccos(-(g[:, a] * g[:, b]).sum(axis=1)) for a, b in pairs])


def describe(mesh: ElementMesh) -> str:
    """Counts, groups and quality in words."""
    groups = [f"{name} {len(ids)} elements" for name, ids in mesh.subdomains.items()]
    groups += [f"{name} {facets.shape[1]} facets" for name, facets in mesh.boundaries.items()]
    turned = (signed_volumes(mesh) < 0).mean()
    return f"{mesh}; {', '.join(groups)}; {turned:.1%} turned round; dihedral angles from {dihedral_angles(mesh).min():.1f} degrees"


if __name__ == "__main__":
    save(bracket(EMBEDDED_SIZE), EMBEDDED)
    print(f"{EMBEDDED.name}: {describe(read_mesh(EMBEDDED))}; {EMBEDDED.stat().st_size} bytes")
