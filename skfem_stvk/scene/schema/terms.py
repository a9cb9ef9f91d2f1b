"""Terms of a scene: laws, networks, penalties and loads, told apart by `type`, with the keys that the library declares."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, TypeAlias

import numpy as np
from pydantic import Field

from ... import terms
from ...arguments import shown
from ...errors import MeshError
from ...materials import Material
from ...mesh import ElementMesh
from ...mesh.places import Where
from ...terms.spring_network import RULES
from ...terms.times import Ramp, Sine, Table
from .derived import KEYS, Derived, derived, one_of
from .places import PlaceOrName, Region
from .quantities import Components, Name, key


class Known(Protocol):
    """Mesh, materials, places and regions of a scene, as its terms need them."""

    mesh: ElementMesh

    def material(self, name: str) -> Material:
        """Return a material by its name."""

    def place(self, where: Any) -> Where:
        """Return a place as `System` takes it."""

    def region(self, region: Any) -> Any:
        """Return a region as terms take it."""


class AnyTime(Derived):
    """A factor that depends on time."""

    def function(self, value: Any) -> Any:
        """Return the value times the factor, as a function of time."""
        options = {name: tuple(one) if isinstance(one, list) else one for name, one in self if name != "type"}
        return self.library(value, **options)


if TYPE_CHECKING:
    Time: TypeAlias = AnyTime
else:
    #: How a load or a prescribed displacement changes with time; in statics with the load factor.
    Time = one_of(
        (
            derived(f"{library.__name__}Time", AnyTime, library, sentence, ("type", library.__name__.lower()))
            for library, sentence in (
                (Ramp, "A factor that grows from 0 to 1 at a constant rate, and stays 1."),
                (Sine, "The factor `sin(2 pi frequency t + phase)`."),
                (Table, "A factor by times and values, linear between them, constant before and after."),
            )
        ),
        "type",
    )
TIME = "Factor of time; by default constants ramp with the load factor in statics, and are what they are in motion."


#: Elements that a term brings on the nodes of the mesh: a boundary or lines of the mesh by name, or the nodes of each element.
Simplices: TypeAlias = Name | Annotated[list[list[Annotated[int, Field(ge=0)]]], Field(min_length=1)]
OWN = (
    "Elements of its own on the nodes of the mesh: a boundary or lines by name, or the nodes of each, from 0: "
    "[[0, 5], [5, 9]] are two segments."
)


def in_columns(given: Any) -> Any:
    """Return the nodes of elements (n, nt), from a list of the nodes of each; a name is returned as it is."""
    if given is None or isinstance(given, str):
        return given
    if len({len(nodes) for nodes in given}) > 1:
        raise MeshError(f"simplices = {shown(given)}; expected elements with as many nodes each.")
    return np.array(given).T


class AnyTerm(Derived):
    """A term of the library, whose parameters are the keys."""

    def given(self, known: Known) -> dict[str, Any]:
        """Return the arguments of the library's term."""
        given = {name: one for name, one in self if name not in ("type", "time") and one is not None}
        for name, found in (("material", known.material), ("region", known.region), ("on", self.located(known))):
            if name in given:
                given[name] = found(given[name])
        if "simplices" in given:
            given["simplices"] = in_columns(given["simplices"])
        for name in LOADS & given.keys():
            given[name] = in_time(given[name], getattr(self, "time", None))
        return {NAMES.get(name, name): one for name, one in given.items()}

    def located(self, known: Known) -> Callable[[Any], Any]:
        """Return the function that looks up the value of `on`."""
        return known.place

    def term(self, known: Known) -> Any:
        """Return the term of the library."""
        return self.library(**self.given(known))


#: Names of parameters in the library, by the names of their keys that differ.
NAMES = {key: name for name, key in KEYS.items()}


class AnyLaw(AnyTerm):
    """Keys of all laws on elements."""

    region: Annotated[Region | None, key("Elements it is on; by default all.")] = None
    material: Annotated[Name, key("Name of its material.")]
    plane: Annotated[Literal["strain", "stress"] | None, key("Of elements in the plane; by default plane strain.")] = None
    thickness: Annotated[float | None, key("Of elements in the plane and surfaces; by default 1.", "length", gt=0)] = None
    area: Annotated[float | None, key("Cross-section of segments; by default 1.", "area", gt=0)] = None


class LawOnElements(AnyLaw):
    """Keys of laws that may bring elements of their own."""

    simplices: Annotated[Simplices | None, key(OWN)] = None


class SpringNetworkTerm(AnyLaw):
    """Springs along the edges of linear simplices, made from a material by a rule."""

    library: ClassVar[Any] = terms.SpringNetwork
    type: Literal["spring-network"]
    rule: Annotated[Literal[tuple(RULES)], key("How their stiffness is made.")] = "least-squares"  # type: ignore[valid-type]


class EdgeNetworkTerm(AnyLaw):
    """The literal sum over edges and pairs of edges of linear simplices, of St. Venant-Kirchhoff's law."""

    library: ClassVar[Any] = terms.EdgeNetwork
    type: Literal["edge-network"]
    pairs: Annotated[
        Literal["all", "none", "adjacent", "opposite"], key("Pairs of edges that count: those that meet in a vertex, or do not.")
    ] = "all"

    def term(self, known: Known) -> Any:
        """Return the term of the library."""
        arguments = self.given(known)
        del arguments["pairs"]
        network = terms.EdgeNetwork.of(known.mesh, terms.StVK(**arguments))
        if self.pairs == "all":
            return network
        return network.diagonal() if self.pairs == "none" else network.without(OTHERS[self.pairs])


#: The pairs of edges that are left out where only one kind is kept.
OTHERS = {"adjacent": "opposite", "opposite": "adjacent"}


class PressureTerm(AnyTerm):
    """Pressure on the deformed surface, which turns with it."""

    library: ClassVar[Any] = terms.Pressure
    type: Literal["pressure"]
    on: Annotated[PlaceOrName | None, key("Place of the boundary facets; of surfaces in space a subdomain, or all.")] = None
    simplices: Annotated[Simplices | None, key("A surface in space beside the mesh that it acts on: as those of its law.")] = None
    pressure: Annotated[float, key("Force per deformed area, positive inwards.", "stress")]
    time: Annotated[Time | None, key(TIME)] = None

    def given(self, known: Known) -> dict[str, Any]:
        """Return the arguments of the library's term."""
        return {"where": None} | super().given(known)

    def located(self, known: Known) -> Callable[[Any], Any]:
        """Return the function that looks up the value of `on`; names on a surface in space are those of its elements."""
        return known.region if known.mesh.k < known.mesh.d and isinstance(self.on, str) else known.place


def in_time(value: Any, time: Any) -> Any:
    """Return a function of time, or without `time` the constant itself."""
    return value if time is None else time.function(value)


#: Keys whose values may be functions of time.
LOADS = {"g", "force", "traction", "pressure"}
_IN_TIME = {"time": (Annotated[Time | None, key(TIME)], None)}
_STIFFNESS = {
    "stiffness": (
        Annotated[float | Components, key("Stiffness per area, of all components or of each.", "stiffness per area")],
        ...,
    )
}


def _table(kind: str, library: Any, sentence: str, base: Any = LawOnElements, **more: tuple[Any, Any]) -> Any:
    return derived(f"{library.__name__}Term", base, library, sentence, ("type", kind), **more)


#: Tables of terms; a new law, penalty or load is a row.
TERMS = (
    _table("stvk", terms.StVK, "St. Venant-Kirchhoff's law: energy quadratic in the Green-Lagrange strain."),
    _table("neo-hookean", terms.NeoHookean, "Neo-Hookean law, which does not give way when it is crushed."),
    _table("linear-elastic", terms.LinearElastic, "Linear elasticity of small strain, wrong under rotation."),
    _table("corotated", terms.Corotated, "Linear elasticity in frames that turn with the elements."),
    _table(
        "invertible-stvk",
        terms.InvertibleStVK,
        "St. Venant-Kirchhoff's law, continued so that elements which are inside out come back.",
    ),
    SpringNetworkTerm,
    EdgeNetworkTerm,
    _table("volume-penalty", terms.VolumePenalty, "Resistance of elements to the loss of volume.", AnyTerm),
    _table(
        "elastic-foundation",
        terms.ElasticFoundation,
        "Springs between a surface of the body and the ground.",
        AnyTerm,
        **_STIFFNESS,
    ),
    _table("gravity", terms.Gravity, "Weight, by the densities of the materials.", AnyTerm, **_IN_TIME),
    _table("body-force", terms.BodyForce, "Dead force on the volume.", AnyTerm, **_IN_TIME),
    _table("nodal-load", terms.NodalLoad, "Dead force on each node of a place.", AnyTerm, **_IN_TIME),
    _table("traction", terms.Traction, "Dead force on the surface.", AnyTerm, **_IN_TIME),
    PressureTerm,
)
if TYPE_CHECKING:
    Term: TypeAlias = Any
else:
    Term = one_of(TERMS, "type")
