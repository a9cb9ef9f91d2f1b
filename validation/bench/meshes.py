"""Meshes for the timing of W, F and K, structured or of a real part, and the displacements of the timed calls."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray

from skfem_stvk.arguments import Array
from skfem_stvk.errors import StvkError
from skfem_stvk.mesh import ElementMesh, read_mesh
from skfem_stvk.terms import StVK

YOUNG, POISSON = 1e5, 0.3  # [Pa, -]; lambda = 1.5 mu
EDGE_OF_PART = {5_000: 5.8e-3, 40_000: 2.15e-3, 250_000: 1.1e-3}  # [m] edges that give about as many tetrahedra

# The part [m]: the base is along x, the upright arm is along z, and both are WIDTH wide along y.
LENGTH, HEIGHT, WIDTH, THICKNESS, FILLET = 0.1, 0.08, 0.04, 0.012, 0.01
BOLT = (0.07, 0.0055)  # x and radius of the hole in the base
BUSHING = (0.055, 0.008, 0.012)  # z, inner and outer radius of the ring in the upright arm


@dataclass
class Specimen:
    """Mesh of about `size` tetrahedra, half of them with negative orientation; `kind` is 'box' or 'part'."""

    kind: str
    size: int

    @property
    def name(self) -> str:
        """Name with the size in short form.

        >>> Specimen("box", 40_000).name, Specimen("part", 2_000_000).name, Specimen("box", 300).name
        ('box 40 k', 'part 2 M', 'box 300')
        """
        for unit, letter in ((1_000_000, "M"), (1_000, "k")):
            if self.size >= unit:
                return f"{self.kind} {self.size / unit:g} {letter}"
        return f"{self.kind} {self.size}"

    @cached_property
    def mesh(self) -> ElementMesh:
        """Mesh of the specimen, created on first use. A part raises StvkError if Gmsh is missing or the size is unknown."""
        return box(self.size) if self.kind == "box" else part(self.size)

    @cached_property
    def u(self) -> Array:
        """Smooth displacements (ndofs,) [m] with strains of about 0.6."""
        p = self.mesh.p
        size = np.ptp(p, axis=1).max()
        waves = np.sin(2 * np.pi * p[[1, 2, 0]] / size)
        return (0.1 * size * waves * np.array([[1.0], [0.7], [0.5]])).ravel("F")

    @cached_property
    def v(self) -> Array:
        """Random vector (ndofs,) for the product K v."""
        return np.random.default_rng(1).standard_normal(self.mesh.p.size)

    @property
    def term(self) -> StVK:
        """Material term, the same in all elements."""
        return StVK(young=YOUNG, poisson=POISSON)


def box(size: int) -> ElementMesh:
    """Return a grid with six tetrahedra per cell, in scikit-fem's order, with about `size` tetrahedra.

    >>> [box(size).nt for size in (5_000, 40_000)]
    [4860, 38988]
    """
    n = max(round((size / 6) ** (1 / 3)), 1)
    sides = n, n, max(round(size / (6 * n * n)), 1)
    mesh = skfem.MeshTet.init_tensor(*(np.linspace(0, side / n, side + 1) for side in sides))
    return ElementMesh(mesh.p, _with_half_reversed(mesh.t.astype(np.int32)))


def part(size: int) -> ElementMesh:
    """Return an angle bracket with about `size` tetrahedra, meshed by Gmsh."""
    if size not in EDGE_OF_PART:
        raise StvkError(f"size = {size}; expected one of the sizes of parts: {', '.join(map(str, EDGE_OF_PART))}.")
    return bracket(EDGE_OF_PART[size])


def bracket(size: float) -> ElementMesh:
    """Return an angle bracket with a fillet, a bolt hole and a bushing, in tetrahedra with edges of about `size` [m].

    Subdomains 'bracket' and 'bushing' share their vertices; boundaries are 'bolt' and 'bore'. Gmsh creates elements with positive
    orientation. The orientation of half of them is reversed, in a random order with a fixed seed.
    """
    with gmsh_session() as gmsh, TemporaryDirectory() as folder:
        draw(gmsh)
        options = {"MeshSizeMin": size / 2, "MeshSizeMax": size, "MeshSizeFromCurvature": 12, "OptimizeNetgen": 1}
        for option, value in options.items():
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.model.mesh.generate(3)
        file = Path(folder) / "bracket.msh"
        gmsh.write(str(file))
        mesh = read_mesh(file)
    return ElementMesh(mesh.p, _with_half_reversed(mesh.t.copy()), mesh.subdomains, mesh.boundaries)


def _with_half_reversed(t: NDArray[np.int32]) -> NDArray[np.int32]:
    """Exchange two vertices of half of the tetrahedra, chosen at random, in the array `t` (4, nt), and return it."""
    half = np.random.default_rng(0).permutation(t.shape[1])[: t.shape[1] // 2]
    t[:2, half] = t[1::-1, half]
    return t


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """Yield Gmsh without output, on one thread and writing MSH 2.2. Errors give the command that installs a missing package."""
    try:
        import gmsh
    except ImportError as error:
        raise StvkError("Gmsh creates this mesh, and Gmsh is not installed: pip install gmsh") from error
    except OSError as error:
        missing = "apt install libglu1-mesa libxft2 libxcursor1 libxinerama1"
        raise StvkError(f"A library of Gmsh is missing: {error}. On Debian: {missing}") from error
    gmsh.initialize(interruptible=False)
    try:
        for option, value in {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.MshFileVersion": 2.2, "Mesh.Binary": 1}.items():
            gmsh.option.setNumber(option, value)
        yield gmsh
    finally:
        gmsh.finalize()


def draw(gmsh: Any) -> None:
    """Draw the solid bracket and its bushing, and name their physical groups."""
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
    """Draw the profile of the angle in the plane y = 0, with the fillet in its inner corner, and return its tag."""
    a, b = THICKNESS, THICKNESS + FILLET
    outline = [(0, 0), (LENGTH, 0), (LENGTH, a), (b, a), (a, b), (a, HEIGHT), (0, HEIGHT)]
    points = [occ.addPoint(x, 0, z) for x, z in outline]
    centre = occ.addPoint(b, 0, b)
    sides = zip(points, points[1:] + points[:1], strict=True)
    curves = [occ.addCircleArc(start, centre, end) if start == points[3] else occ.addLine(start, end) for start, end in sides]
    return occ.addPlaneSurface([occ.addCurveLoop(curves)])


def walls(gmsh: Any, centre: tuple[float, ...], half: tuple[float, ...]) -> list[int]:
    """Return the tags of the faces that lie in the box around `centre`."""
    low, high = np.subtract(centre, half) - 1e-5, np.add(centre, half) + 1e-5
    return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, dim=2)]
