"""Mesh files and mesh data for the studies: `python -m validation.meshes` writes the meshes of the package and of its scenes."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import skfem
from numpy.typing import NDArray

import skfem_stvk.mesh
from skfem_stvk import ElementMesh
from skfem_stvk.mesh import read_mesh
from skfem_stvk.mesh.geometry import Geometry

from .bench.meshes import bracket

EMBEDDED = Path(skfem_stvk.mesh.__file__).with_name("data") / "bracket.msh"
EMBEDDED_SIZE = 8e-3  # [m]
FINE_SIZE = 2.5e-3  # [m]; 26 000 tetrahedra
SCENES = Path(__file__).parents[1] / "docs" / "scenes"
#: Gmsh's dimension and meshio's cell type, by the number of nodes of an element.
CELLS = {1: (0, "vertex"), 2: (1, "line"), 3: (2, "triangle"), 4: (3, "tetra")}


def save(mesh: ElementMesh, file: Path) -> None:
    """Write the groups of linear simplices, facets, lines and nodes as physical groups of a binary Gmsh 2.2 file."""
    cells, tags, names = [], [], {}
    groups = [(name, mesh.t[:, ids]) for name, ids in mesh.subdomains.items()]
    groups += [*mesh.boundaries.items(), *mesh.lines.items()]
    groups += [(name, np.reshape(ids, (1, -1))) for name, ids in mesh.node_sets.items()]
    for tag, (name, vertices) in enumerate(groups, start=1):
        dimension, cell_type = CELLS[len(vertices)]
        cells.append((cell_type, vertices.T))
        tags.append(np.full(vertices.shape[1], tag))
        names[name] = np.array([tag, dimension])
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    points = np.pad(mesh.p.T, ((0, 0), (0, 3 - mesh.d)))
    meshio.write(file, meshio.Mesh(points, cells, cell_data=data, field_data=names), file_format="gmsh22", binary=True)


def bag() -> ElementMesh:
    """Return the ball with its skin, four ropes and their hooks, of `docs/examples/ex12_bag.py`."""
    ball = ElementMesh.of(skfem.MeshTet.init_ball(3))
    towards = np.array([[-1, -1, 1, 1], [-1, 1, -1, 1], [1.4, 1.4, 1.4, 1.4]]) * 0.6
    hooks = ball.nv + np.arange(4, dtype=np.int32)
    return ElementMesh(
        np.concatenate([0.3 * ball.p, towards], axis=1),
        ball.t,
        subdomains={"filling": np.arange(ball.nt, dtype=np.int32)},
        boundaries={"skin": ball.surface},
        node_sets={"hooks": hooks},
        lines={"ropes": np.array([np.argmax(towards.T @ ball.p, axis=1), hooks], dtype=np.int32)},
    )


def disc() -> ElementMesh:
    """Return the flat disc of `docs/how-to/membranes.md` in the plane; the scene maps it to space."""
    mesh = skfem.MeshTri.init_circle(3)
    rim = np.flatnonzero(np.hypot(*mesh.p) > 1 - 1e-9).astype(np.int32)
    return ElementMesh(mesh.p, mesh.t, {"sheet": np.arange(mesh.nelements, dtype=np.int32)}, node_sets={"rim": rim})


def signed_volumes(mesh: ElementMesh) -> NDArray[np.float64]:
    """Return the volumes [m^3], (nt,), which are negative for elements with negative orientation."""
    x = mesh.p.T[mesh.t.T]
    return np.asarray(np.linalg.det(x[:, 1:] - x[:, :1]) / 6)


def dihedral_angles(mesh: ElementMesh) -> NDArray[np.float64]:
    """Return the angles between the faces of each tetrahedron [degrees], (6, nt)."""
    g = Geometry(mesh.p, mesh.t).gradients
    g = g / np.linalg.norm(g, axis=2, keepdims=True)
    pairs = [(a, b) for a in range(4) for b in range(a)]
    return np.degrees([np.arccos(-(g[:, a] * g[:, b]).sum(axis=1)) for a, b in pairs])


def describe(mesh: ElementMesh) -> str:
    """Return counts, groups and quality in words."""
    groups = [f"{name} {len(ids)} elements" for name, ids in mesh.subdomains.items()]
    groups += [f"{name} {facets.shape[1]} facets" for name, facets in mesh.boundaries.items()]
    negative = (signed_volumes(mesh) < 0).mean()
    quality = f"{negative:.1%} with negative orientation; dihedral angles from {dihedral_angles(mesh).min():.1f} degrees"
    return f"{mesh}; {', '.join(groups)}; {quality}"


if __name__ == "__main__":
    save(bracket(EMBEDDED_SIZE), EMBEDDED)
    save(bag(), SCENES / "bag.msh")
    save(disc(), SCENES / "disc.msh")
    print(f"{EMBEDDED.name}: {describe(read_mesh(EMBEDDED))}; {EMBEDDED.stat().st_size} bytes")
