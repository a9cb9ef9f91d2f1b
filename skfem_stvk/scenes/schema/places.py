"""Mesh of a scene, from a file or generated, and its places and regions: by name, by coordinates, or by shapes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag

from ...mesh import ElementMesh, read_mesh
from ...mesh.generators import bar, box, cylinder
from ...mesh.groups import in_dimension
from ...mesh.locations import Box, NearestNode, Plane, Where
from .quantities import Components, InputFile, Name, Part, key, members


class BoxPlace(Part):
    """Nodes, or as a region elements by their centres, within a box along the axes."""

    type: Literal["box"]
    low: Annotated[Components, key("Least coordinates.", "length")]
    high: Annotated[Components, key("Largest coordinates.", "length")]

    def where(self) -> Box:
        """Return the place as `System` takes it."""
        return Box(tuple(self.low), tuple(self.high))


class PlanePlace(Part):
    """Nodes on a plane; in two dimensions on a line."""

    type: Literal["plane"]
    point: Annotated[Components, key("A point of the plane.", "length")]
    normal: Annotated[Components, key("Its normal, of any length.")]
    within: Annotated[
        float | None, key("Largest distance of nodes from the plane; by default 1e-6 of the size of the mesh.", "length", gt=0)
    ] = None

    def where(self) -> Plane:
        """Return the place as `System` takes it."""
        return Plane(tuple(self.point), tuple(self.normal), self.within)


class NodesPlace(Part):
    """Nodes by their numbers, from 0."""

    type: Literal["nodes"]
    ids: Annotated[list[Annotated[int, Field(ge=0)]], key("Numbers of nodes.", min_length=1)]

    def where(self) -> list[int]:
        """Return the place as `System` takes it."""
        return self.ids


class ElementsRegion(Part):
    """Elements by their numbers, from 0."""

    type: Literal["elements"]
    ids: Annotated[list[Annotated[int, Field(ge=0)]], key("Ids of elements.", min_length=1)]

    def where(self) -> list[int]:
        """Return the region as terms take it."""
        return self.ids


def _kind_selector(otherwise: str, words: str) -> Discriminator:
    """Return the rule that selects the kind of a value by the `type` of a table, or by its own type; `words` name all kinds."""

    def kind(given: Any) -> str:
        if isinstance(given, Mapping):
            return str(given.get("type", "a table without type"))
        if isinstance(given, Part):
            return str(given.type)  # type: ignore[attr-defined]
        if isinstance(given, list):
            return "coordinates"
        return otherwise if isinstance(given, str) else "neither"

    return Discriminator(kind, custom_error_type="place", custom_error_message=f"Input should be {words}")


Shape: TypeAlias = Annotated[BoxPlace, Tag("box")] | Annotated[PlanePlace, Tag("plane")] | Annotated[NodesPlace, Tag("nodes")]
#: Words for a shape in messages.
SHAPES = f"a table with type = one of {', '.join(tag for tags, _ in members(Shape) for tag in tags)}"
#: A value of `[places]`.
Place = Annotated[
    Annotated[Components, Tag("coordinates")] | Shape, _kind_selector("no place", f"coordinates [x, y, z], or {SHAPES}")
]


def place_or(other: Any, tag: str) -> Any:
    """Return the type of a location, or of a table of another `type`."""
    words = f"a name, coordinates [x, y, z], or {SHAPES}, {tag}"
    return Annotated[
        Annotated[Name, Tag("name")] | Annotated[Components, Tag("coordinates")] | Shape | other, _kind_selector("name", words)
    ]


#: A location: a name of the mesh or of `[places]`, coordinates of the nearest node, or a shape.
PlaceOrName = Annotated[
    Annotated[Name, Tag("name")] | Annotated[Components, Tag("coordinates")] | Shape,
    _kind_selector("name", f"a name, coordinates [x, y, z], or {SHAPES}"),
]
#: A set of elements: a subdomain of the mesh or a box of `[places]` by name, a box, or numbers.
Region = Annotated[
    Annotated[Name, Tag("name")] | Annotated[BoxPlace, Tag("box")] | Annotated[ElementsRegion, Tag("elements")],
    _kind_selector("name", "a name, or a table with type = one of box, elements"),
]

#: Elements that a term brings on the nodes of the mesh: a boundary or lines of the mesh by name, or the nodes of each element.
Simplices: TypeAlias = Name | Annotated[list[list[Annotated[int, Field(ge=0)]]], Field(min_length=1)]


def where_of(place: Any) -> Where:
    """Return a place as `System` takes it; a name is returned as it is, and the caller looks it up."""
    if isinstance(place, str):
        return place
    return NearestNode(tuple(place)) if isinstance(place, list) else place.where()


# meshes

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


def _kind_of_mesh(given: Any) -> str:
    if isinstance(given, MeshFile) or (isinstance(given, Mapping) and "file" in given and "type" not in given):
        return "file"
    return str(given.get("type") if isinstance(given, Mapping) else getattr(given, "type", "no mesh"))


Mesh = Annotated[
    Annotated[MeshFile, Tag("file")]
    | Annotated[BoxMesh, Tag("box")]
    | Annotated[CylinderMesh, Tag("cylinder")]
    | Annotated[BarMesh, Tag("bar")],
    Discriminator(_kind_of_mesh),
]
