"""Places and regions of a scene: by name, by coordinates, or in the shapes that are named here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag

from ...mesh.locations import Box, NearestNode, Plane, Where
from .quantities import Components, Name, Part, key, members


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
