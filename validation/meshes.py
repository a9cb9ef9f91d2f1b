"""Meshes of a real part, made by Gmsh: `python -m validation.meshes` writes the one that comes with the package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

import skfem_stvk.mesh
from skfem_stvk import SimplexMesh
from skfem_stvk.mesh import read_mesh
from skfem_stvk.mesh.geometry import Geometry

EMBEDDED = Path(skfem_stvk.mesh.__file__).with_name("data") / "bracket.msh"
EMBEDDED_SIZE = 8e-3  # [m]
FINE_SIZE = 2.5e-3  # [m]; 26 000 tetrahedra

# The part [m]: the base lies along x, the other arm stands along z, both are WIDTH wide along y.
LENGTH, HEIGHT, WIDTH, THICKNESS, FILLET = 0.1, 0.08, 0.04, 0.012, 0.01
BOLT = (0.07, 0.0055)  # x and radius of the hole in the base
BUSHING = (0.055, 0.008, 0.012)  # z, inner and outer radius of the ring in the standing arm


def bracket(size: float) -> SimplexMesh:
    """An angle bracket with a fillet, a bolt hole and a bushing, in tetrahedra of edges of about `size` [m].

    Subdomains 'bracket' and 'bushing', which share their vertices; boundaries 'bolt' and 'bore'. Gmsh makes positive
    elements only: half of them, picked at random but always the same, are turned round.
    """
    with gmsh_session() as gmsh, TemporaryDirectory() as folder:
        draw(gmsh)
        for option, value in {
            "MeshSizeMin": size / 2,
            "MeshSizeMax": size,
            "MeshSizeFromCurvature": 12,
            "OptimizeNetgen": 1,
        }.items():
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.model.mesh.generate(3)
        file = Path(folder) / "bracket.msh"
        gmsh.write(str(file))
        mesh = read_mesh(file)
    t = mesh.t.copy()
    turned = np.random.default_rng(0).permutation(mesh.nt)[: mesh.nt // 2]
    t[:2, turned] = t[1::-1, turned]
    return SimplexMesh(mesh.p, t, mesh.subdomains, mesh.boundaries)


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """Gmsh, silent, on one thread and writing MSH 2.2; errors say how to install what it lacks."""
    try:
        import gmsh
    except ImportError as error:
        raise ImportError("This mesh is made by Gmsh, which is not installed: pip install gmsh") from error
    except OSError as error:
        raise OSError(
            f"Gmsh lacks a library: {error}. On Debian: apt install libglu1-mesa libxft2 libxcursor1 libxinerama1"
        ) from error
    gmsh.initialize(interruptible=False)
    try:
        for option, value in {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.MshFileVersion": 2.2, "Mesh.Binary": 1}.items():
            gmsh.option.setNumber(option, value)
        yield gmsh
    finally:
        gmsh.finalize()


def draw(gmsh: Any) -> None:
    """The solid bracket and its bushing, and their physical groups."""
    occ, groups = gmsh.model.occ, gmsh.model
    x, (z, inner, outer) = BOLT[0], BUSHING
    across = (-THICKNESS, z, 3 * THICKNESS)
    solid = occ.extrude([(2, profile(occ))], 0, WIDTH, 0)[1]
    bolt = occ.addCylinder(x, WIDTH / 2, -THICKNESS, 0, 0, 3 * THICKNESS, BOLT[1])
    hole = occ.addCylinder(across[0], WIDTH / 2, z, across[2], 0, 0, outer)
    occ.cut([solid], [(3, bolt), (3, hole)])
    ring = occ.addCylinder(0, WIDTH / 2, z, THICKNESS, 0, 0, outer)
    bore = occ.addCylinder(0, WIDTH / 2, z, THICKNESS, 0, 0, inner)
    occ.cut([(3, ring)], [(3, bore)])
    occ.fragment([solid], [(3, ring)])
    occ.synchronize()
    groups.addPhysicalGroup(3, [solid[1]], name="bracket")
    groups.addPhysicalGroup(3, [ring], name="bushing")
    groups.addPhysicalGroup(2, walls(gmsh, (x, WIDTH / 2, THICKNESS / 2), (BOLT[1], BOLT[1], THICKNESS / 2)), name="bolt")
    groups.addPhysicalGroup(2, walls(gmsh, (THICKNESS / 2, WIDTH / 2, z), (THICKNESS / 2, inner, inner)), name="bore")


def profile(occ: Any) -> int:
    """The face of the angle in the plane y = 0, with its fillet in the inner corner."""
    a, b = THICKNESS, THICKNESS + FILLET
    outline = [(0, 0), (LENGTH, 0), (LENGTH, a), (b, a), (a, b), (a, HEIGHT), (0, HEIGHT)]
    points = [occ.addPoint(x, 0, z) for x, z in outline]
    centre = occ.addPoint(b, 0, b)
    curves = []
    for start, end in zip(points, points[1:] + points[:1], strict=True):
        curves.append(occ.addCircleArc(start, centre, end) if start == points[3] else occ.addLine(start, end))
    return occ.addPlaneSurface([occ.addCurveLoop(curves)])


def walls(gmsh: Any, centre: tuple[float, ...], half: tuple[float, ...]) -> list[int]:
    """Tags of the faces that lie in the box around `centre`."""
    low, high = np.subtract(centre, half) - 1e-5, np.add(centre, half) + 1e-5
    return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, dim=2)]


def save(mesh: SimplexMesh, file: Path) -> None:
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


def signed_volumes(mesh: SimplexMesh) -> NDArray[np.float64]:
    """(nt,) volumes [m^3], negative where an element is turned round."""
    x = mesh.p.T[mesh.t.T]
    return np.asarray(np.linalg.det(x[:, 1:] - x[:, :1]) / 6)


def dihedral_angles(mesh: SimplexMesh) -> NDArray[np.float64]:
    """(6, nt) angles between the faces of each tetrahedron [degrees]."""
    g = Geometry(mesh.p, mesh.t).gradients
    g = g / np.linalg.norm(g, axis=2, keepdims=True)
    pairs = [(a, b) for a in range(4) for b in range(a)]
    return np.degrees([np.arccos(-(g[:, a] * g[:, b]).sum(axis=1)) for a, b in pairs])


def describe(mesh: SimplexMesh) -> str:
    """Counts, groups and quality in words."""
    groups = [f"{name} {len(ids)} elements" for name, ids in mesh.subdomains.items()]
    groups += [f"{name} {facets.shape[1]} facets" for name, facets in mesh.boundaries.items()]
    turned = (signed_volumes(mesh) < 0).mean()
    return f"{mesh}; {', '.join(groups)}; {turned:.1%} turned round; dihedral angles from {dihedral_angles(mesh).min():.1f} degrees"


if __name__ == "__main__":
    save(bracket(EMBEDDED_SIZE), EMBEDDED)
    print(f"{EMBEDDED.name}: {describe(read_mesh(EMBEDDED))}; {EMBEDDED.stat().st_size} bytes")
