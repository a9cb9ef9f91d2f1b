"""Mesh of a scene: a file, or a generated mesh; and the elements on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from ...mesh import ElementMesh, read_mesh
from ...mesh.generators import bar, box, cylinder
from ...mesh.groups import in_dimension
from .quantities import Components, InputFile, Part, key

#: The key of the number of coordinates, for meshes that may be flat.
Dimension = Annotated[
    int | None,
    key(
        "Number of coordinates: 3 keeps a flat mesh in space, as a membrane; by default the fewest that the mesh needs.", ge=1, le=3
    ),
]
Cells = Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1, max_length=3)]


class AnyMesh(Part):
    """Keys of all meshes of a scene: shape functions and quadrature."""

    degree: Annotated[int | None, key("Degree of the shape functions of simplices; by default that of the mesh.", ge=1, le=2)] = (
        None
    )
    quadrature: Annotated[
        Literal["exact", "one-point"] | None,
        key("Quadrature rule: exact, or one-point for quadrilaterals and hexahedra; by default the usual rule."),
    ] = None
    hourglass: Annotated[
        float | None, key("Coefficient of the hourglass control of elements with one point; by default 0.05.", ge=0)
    ] = None


class MeshFile(AnyMesh):
    """A mesh file with its named groups."""

    file: Annotated[InputFile, key("Path of the mesh file, relative to the scene file.")]
    scale: Annotated[float, key("Factor of the coordinates, as 0.001 for a file in mm in a scene in m.", gt=0)] = 1.0
    dimension: Dimension = None
    split: Annotated[bool, key("Whether wedges, pyramids and cells next to them are split into simplices; false refuses them.")] = (
        True
    )
    straighten: Annotated[bool, key("Whether quadratic elements that fold over themselves get straight edges.")] = False

    def mesh(self, folder: Path, keep: Collection[str] = ()) -> ElementMesh:
        """Return the mesh, from a file relative to this folder, with all nodes of the groups to `keep`."""
        mesh = read_mesh(
            folder / self.file, self.degree, dimension=self.dimension, keep=keep, split=self.split, straighten=self.straighten
        )
        return mesh if self.scale == 1.0 else mesh.scaled(self.scale)


class BoxMesh(AnyMesh):
    """A box along the axes, in one, two or three dimensions; boundaries: left, right, bottom, top, front, back."""

    type: Literal["box"]
    size: Annotated[Components, key("Length along each axis.", "length")]
    cells: Annotated[Cells, key("Number of cells along each axis.")]
    element: Annotated[
        Literal["tetrahedra", "hexahedra", "triangles", "quadrilaterals", "segments"] | None,
        key("Kind of the elements; by default simplices."),
    ] = None
    origin: Annotated[Components | None, key("Corner with the least coordinates; by default the origin.", "length")] = None
    dimension: Dimension = None

    def mesh(self, folder: Path, keep: Collection[str] = ()) -> ElementMesh:
        """Return the mesh."""
        mesh = box(self.size, self.cells, element=self.element, origin=self.origin)
        return mesh if self.dimension is None else replace(mesh, p=in_dimension(mesh.p, mesh.k, self.dimension))


class CylinderMesh(AnyMesh):
    """A cylinder of tetrahedra along x; boundaries: left, right, side, and inside if it is hollow."""

    type: Literal["cylinder"]
    radius: Annotated[float, key("Outer radius.", "length", gt=0)]
    inner_radius: Annotated[float, key("Radius of the bore, 0 for none.", "length", ge=0)] = 0.0
    length: Annotated[float, key("Length along x.", "length", gt=0)]
    cells: Annotated[list[Annotated[int, Field(ge=1)]], key("Number of cells along x, and across.", min_length=2, max_length=2)]

    def mesh(self, folder: Path, keep: Collection[str] = ()) -> ElementMesh:
        """Return the mesh."""
        return cylinder(self.radius, self.length, self.cells, inner_radius=self.inner_radius)


class BarMesh(AnyMesh):
    """A bar of square cross-section along x; boundaries as those of a box."""

    type: Literal["bar"]
    length: Annotated[float, key("Length along x.", "length", gt=0)]
    width: Annotated[float, key("Width and height of the cross-section.", "length", gt=0)]
    cells: Annotated[list[Annotated[int, Field(ge=1)]], key("Number of cells along x, and across.", min_length=2, max_length=2)]
    element: Annotated[Literal["tetrahedra", "hexahedra"], key("Kind of the elements.")] = "tetrahedra"

    def mesh(self, folder: Path, keep: Collection[str] = ()) -> ElementMesh:
        """Return the mesh."""
        return bar(self.length, self.width, self.cells, element=self.element)


def _kind(given: Any) -> str:
    if isinstance(given, MeshFile) or (isinstance(given, Mapping) and "file" in given and "type" not in given):
        return "file"
    return str(given.get("type") if isinstance(given, Mapping) else getattr(given, "type", "no mesh"))


Mesh = Annotated[
    Annotated[MeshFile, Tag("file")]
    | Annotated[BoxMesh, Tag("box")]
    | Annotated[CylinderMesh, Tag("cylinder")]
    | Annotated[BarMesh, Tag("bar")],
    Discriminator(_kind),
]
