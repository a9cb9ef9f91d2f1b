"""Terms of a scene: laws, networks, penalties and loads, told apart by `type`. Each says how it is made; a new one is a class."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Protocol, TypeAlias

import numpy as np
from pydantic import Field

from ... import terms
from ...arguments import shown
from ...errors import MeshError
from ...materials import Material
from ...mesh import ElementMesh
from ...mesh.places import Where
from ...terms.times import Ramp, Sine, Table
from .places import PlaceOrName, Region
from .quantities import Components, Name, Part, key


class Known(Protocol):
    """What a term needs of the rest of the scene."""

    mesh: ElementMesh

    def material(self, name: str) -> Material:
        """A material by its name."""

    def place(self, where: Any) -> Where:
        """A place as `System` takes it."""

    def region(self, region: Any) -> Any:
        """A region as terms take it."""


class RampTime(Part):
    """A factor that grows from 0 to 1 at a constant rate, and stays 1."""

    type: Literal["ramp"]
    until: Annotated[float, key("When it is 1.", "time")]
    start: Annotated[float, key("Until when it is 0.", "time")] = 0.0

    def function(self, value: Any) -> Ramp:
        """The value times the factor, as a function of time."""
        return Ramp(value, until=self.until, start=self.start)


class SineTime(Part):
    """The factor `sin(2 pi frequency t + phase)`."""

    type: Literal["sine"]
    frequency: Annotated[float, key("Cycles per time.", "frequency", gt=0)]
    phase: Annotated[float, key("Angle at time 0 in radians: pi/2 makes it a cosine.")] = 0.0

    def function(self, value: Any) -> Sine:
        """The value times the factor, as a function of time."""
        return Sine(value, frequency=self.frequency, phase=self.phase)


class TableTime(Part):
    """A factor by times and values, linear between them, constant before and after."""

    type: Literal["table"]
    times: Annotated[list[float], key("Times, ascending.", "time", min_length=1)]
    factors: Annotated[list[float], key("The factor at each of these times.", min_length=1)]

    def function(self, value: Any) -> Table:
        """The value times the factor, as a function of time."""
        return Table(value, times=tuple(self.times), factors=tuple(self.factors))


#: How a load or a prescribed displacement changes with time; in statics with the load factor.
Time = Annotated[RampTime | SineTime | TableTime, Field(discriminator="type")]
TIME = "Factor of time; by default constants ramp with the load factor in statics, and are what they are in motion."


#: Elements that a term brings on the nodes of the mesh: a boundary or lines of the mesh by name, or the nodes of each element.
Simplices: TypeAlias = Name | Annotated[list[list[Annotated[int, Field(ge=0)]]], Field(min_length=1)]
OWN = (
    "Elements of its own on the nodes of the mesh: a boundary or lines by name, or the nodes of each, from 0: "
    "[[0, 5], [5, 9]] are two segments."
)


def in_columns(given: Any) -> Any:
    """The nodes of elements (n, nt), from a list of the nodes of each; names as they are."""
    if given is None or isinstance(given, str):
        return given
    if len({len(nodes) for nodes in given}) > 1:
        raise MeshError(f"simplices = {shown(given)}; expected elements with as many nodes each.")
    return np.array(given).T


class AnyLaw(Part):
    """What all laws on elements share."""

    region: Annotated[Region | None, key("Elements it is on; by default all.")] = None
    material: Annotated[Name, key("Name of its material.")]
    plane: Annotated[Literal["strain", "stress"] | None, key("Of elements in the plane; by default plane strain.")] = None
    thickness: Annotated[float | None, key("Of elements in the plane and surfaces; by default 1.", "length", gt=0)] = None
    area: Annotated[float | None, key("Cross-section of segments; by default 1.", "area", gt=0)] = None

    def given(self, known: Known) -> dict[str, Any]:
        """The arguments of the library's law."""
        own = self.model_dump(exclude={"type", "region", "material", "simplices"}, exclude_none=True)
        region = None if self.region is None else known.region(self.region)
        return {"material": known.material(self.material), "region": region} | own


class LawOnElements(AnyLaw):
    """What laws share that may bring elements of their own."""

    simplices: Annotated[Simplices | None, key(OWN)] = None

    def given(self, known: Known) -> dict[str, Any]:
        """The arguments of the library's law."""
        return super().given(known) | {"simplices": in_columns(self.simplices)}


class StVKTerm(LawOnElements):
    """St. Venant-Kirchhoff's law: energy quadratic in the Green-Lagrange strain."""

    type: Literal["stvk"]
    wrinkling: Annotated[bool, key("Whether surfaces and cables give way to compression: tension fields.")] = False

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.StVK(**self.given(known))


class NeoHookeanTerm(LawOnElements):
    """Neo-Hookean law, which does not give way when it is crushed."""

    type: Literal["neo-hookean"]

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.NeoHookean(**self.given(known))


class LinearElasticTerm(LawOnElements):
    """Linear elasticity of small strain, wrong under rotation."""

    type: Literal["linear-elastic"]

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.LinearElastic(**self.given(known))


class CorotatedTerm(LawOnElements):
    """Linear elasticity in frames that turn with the elements."""

    type: Literal["corotated"]
    rotation: Annotated[Literal["element", "vertex"], key("Where the frames are: in elements, or at nodes.")] = "element"

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.Corotated(**self.given(known))


class InvertibleStVKTerm(LawOnElements):
    """St. Venant-Kirchhoff's law, continued so that elements which are inside out come back."""

    type: Literal["invertible-stvk"]
    threshold: Annotated[float, key("Principal stretch below which it is continued.", gt=0.5773502691896258, lt=1)] = 0.6
    extend: Annotated[Literal["energy", "stress"], key("What is continued: the energy, or the stress as Irving does.")] = "energy"

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.InvertibleStVK(**self.given(known))


class SpringNetworkTerm(AnyLaw):
    """Springs along the edges of linear simplices, made from a material by a rule."""

    type: Literal["spring-network"]
    rule: Annotated[
        Literal["least-squares", "edge-diagonal", "van-gelder", "lloyd", "triangular"], key("How their stiffness is made.")
    ] = "least-squares"

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.SpringNetwork(**self.given(known))


class EdgeNetworkTerm(AnyLaw):
    """The literal sum over edges and pairs of edges of linear simplices, of St. Venant-Kirchhoff's law."""

    type: Literal["edge-network"]
    pairs: Annotated[
        Literal["all", "none", "adjacent", "opposite"], key("Pairs of edges that count: those that meet in a vertex, or do not.")
    ] = "all"

    def term(self, known: Known) -> Any:
        """The term of the library."""
        arguments = self.given(known)
        del arguments["pairs"]
        network = terms.EdgeNetwork.of(known.mesh, terms.StVK(**arguments))
        if self.pairs == "all":
            return network
        return network.diagonal() if self.pairs == "none" else network.without(OTHERS[self.pairs])


#: The pairs of edges that are left out where only one kind is kept.
OTHERS = {"adjacent": "opposite", "opposite": "adjacent"}


class VolumePenaltyTerm(Part):
    """Resistance of elements to the loss of volume."""

    type: Literal["volume-penalty"]
    region: Annotated[Region | None, key("Elements it is on; by default all.")] = None
    kind: Annotated[Literal["barrier", "compression", "quadratic"], key("Of the energy.")] = "barrier"
    stiffness: Annotated[float | None, key("Stiffness; by default the usual part of the material's.", "stress", gt=0)] = None

    def term(self, known: Known) -> Any:
        """The term of the library."""
        region = None if self.region is None else known.region(self.region)
        return terms.VolumePenalty(self.stiffness, self.kind, region)


class ElasticFoundationTerm(Part):
    """Springs between a surface of the body and the ground."""

    type: Literal["elastic-foundation"]
    on: Annotated[PlaceOrName, key("Place whose boundary facets are bedded.")]
    stiffness: Annotated[float | Components, key("Stiffness per area, of all components or of each.", "stiffness per area")]

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.ElasticFoundation(known.place(self.on), self.stiffness)


class GravityTerm(Part):
    """Weight, by the densities of the materials."""

    type: Literal["gravity"]
    g: Annotated[Components, key("Acceleration.", "acceleration")]
    time: Annotated[Time | None, key(TIME)] = None

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.Gravity(in_time(self.g, self.time))


class BodyForceTerm(Part):
    """Dead force on the volume."""

    type: Literal["body-force"]
    force: Annotated[Components, key("Force per volume at rest.", "force per volume")]
    region: Annotated[Region | None, key("Elements it acts on; by default all.")] = None
    time: Annotated[Time | None, key(TIME)] = None

    def term(self, known: Known) -> Any:
        """The term of the library."""
        region = None if self.region is None else known.region(self.region)
        return terms.BodyForce(in_time(self.force, self.time), region)


class NodalLoadTerm(Part):
    """Dead force on each node of a place."""

    type: Literal["nodal-load"]
    on: Annotated[PlaceOrName, key("Place of the nodes.")]
    force: Annotated[Components, key("Force on each node.", "force")]
    time: Annotated[Time | None, key(TIME)] = None

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.NodalLoad(known.place(self.on), in_time(self.force, self.time))


class TractionTerm(Part):
    """Dead force on the surface."""

    type: Literal["traction"]
    on: Annotated[PlaceOrName, key("Place of the boundary facets.")]
    traction: Annotated[Components, key("Force per area at rest.", "stress")]
    time: Annotated[Time | None, key(TIME)] = None

    def term(self, known: Known) -> Any:
        """The term of the library."""
        return terms.Traction(known.place(self.on), in_time(self.traction, self.time))


class PressureTerm(Part):
    """Pressure on the deformed surface, which turns with it."""

    type: Literal["pressure"]
    on: Annotated[PlaceOrName | None, key("Place of the boundary facets; of surfaces in space a subdomain, or all.")] = None
    simplices: Annotated[Simplices | None, key("A surface in space beside the mesh that it acts on: as those of its law.")] = None
    pressure: Annotated[float, key("Force per deformed area, positive inwards.", "stress")]
    time: Annotated[Time | None, key(TIME)] = None

    def term(self, known: Known) -> Any:
        """The term of the library."""
        surface = known.mesh.k < known.mesh.d and isinstance(self.on, str)  # in space, whose places are its elements
        where = None if self.on is None else known.region(self.on) if surface else known.place(self.on)
        return terms.Pressure(where, in_time(self.pressure, self.time), in_columns(self.simplices))


def in_time(value: Any, time: Any) -> Any:
    """Constants as they are, or a function of time."""
    return value if time is None else time.function(value)


Law: TypeAlias = (
    StVKTerm | NeoHookeanTerm | LinearElasticTerm | CorotatedTerm | InvertibleStVKTerm | SpringNetworkTerm | EdgeNetworkTerm
)
Load: TypeAlias = GravityTerm | BodyForceTerm | NodalLoadTerm | TractionTerm | PressureTerm
Term = Annotated[Law | VolumePenaltyTerm | ElasticFoundationTerm | Load, Field(discriminator="type")]
