"""Materials and terms of a scene: those that the library registers, with the keys that it declares."""

from __future__ import annotations

from functools import cache
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeAlias

import numpy as np

from ... import terms
from ...arguments import shown
from ...edges import materials
from ...errors import MeshError
from ...mesh import ElementMesh
from ...mesh.locations import Where
from ...terms.laws.elastic_law import ElasticLaw
from ...terms.loads.times import Ramp, Sine, Table
from .derived import KEYS, SURFACES, Derived, derived, keys_of, one_of
from .quantities import key


class AnyModel(Derived):
    """A material of the library, whose constants are the keys."""


@cache
def material_table(model: str, library: Any) -> Any:
    """Return the table of a material."""
    return derived("model", model, library, AnyModel)


def material_tables() -> list[Any]:
    """Return the tables of all materials that are registered."""
    return [material_table(model, library) for model, library in materials.MATERIALS.items()]


class Known(Protocol):
    """Mesh, materials, places and regions of a scene, as its terms need them, and the folder of its files."""

    mesh: ElementMesh
    folder: Path

    def material(self, name: str) -> materials.Material:
        """Return a material by its name."""

    def place(self, where: Any) -> Where:
        """Return a place as `System` takes it."""

    def surface(self, where: Any) -> Where:
        """Return a place, or the name of a subdomain, which means its part of the surface."""

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
    Time = one_of((derived("type", one.__name__.lower(), one, AnyTime) for one in (Ramp, Sine, Table)), "type")
#: Key of loads that hold values.
TIME = (
    Annotated[
        Time | None,
        key("Factor of time; by default constants ramp with the load factor in statics, and are what they are in motion."),
    ],
    None,
)


def in_columns(given: Any) -> Any:
    """Return the nodes of elements (n, nt), from a list of the nodes of each; a name is returned as it is."""
    if isinstance(given, str):
        return given
    if len({len(nodes) for nodes in given}) > 1:
        raise MeshError(f"simplices = {shown(given)}; expected elements with as many nodes each.")
    return np.array(given).T


def in_time(value: Any, time: Any) -> Any:
    """Return a function of time, or without `time` the constant itself."""
    return value if time is None else time.function(value)


def in_elements(library: Any, mesh: ElementMesh) -> bool:
    """Return whether the `where` of a term means elements, which are a surface in space."""
    return mesh.k < mesh.d and getattr(library, "on_elements", False)


class AnyTerm(Derived):
    """A term of the library, whose parameters are the keys."""

    def given(self, known: Known) -> dict[str, Any]:
        """Return the arguments of the library's term."""
        on_elements = in_elements(self.library, known.mesh)
        by_name, surface = (known.region, known.region) if on_elements else (known.place, known.surface)
        looked_up = {
            "material": known.material,
            "region": known.region,
            "on": lambda where: by_name(where) if isinstance(where, str) else known.place(where),
            **dict.fromkeys(SURFACES, lambda where: surface(where) if isinstance(where, str) else known.place(where)),
            "simplices": in_columns,
            given_by(self.library): lambda value: in_time(value, getattr(self, "time", None)),
        }
        given = {}
        for one, value in (dict(self) | self._paths(known.folder)).items():
            name = NAMES.get(one, one)
            if one not in ("type", "time") and (value is not None or name in needed(self.library)):
                if isinstance(value, Derived):
                    given[name] = value.made(known.folder)
                else:
                    given[name] = looked_up[one](value) if one in looked_up and value is not None else value
        return given

    def term(self, known: Known) -> Any:
        """Return the term of the library."""
        return self.library(**self.given(known))


#: Names of parameters in the library, by the names of their keys that differ.
NAMES = {key: name for name, key in KEYS.items()}


class EdgeNetworkOfLaw(AnyTerm):
    """A network that a mesh and the law of St. Venant-Kirchhoff make."""

    def term(self, known: Known) -> Any:
        """Return the term of the library."""
        arguments = self.given(known)
        pairs = arguments.pop("pairs")
        return self.library.of(known.mesh, terms.StVK(**arguments), pairs)


def needed(library: Any) -> list[str]:
    """Return the names of the parameters without a default, of which some may be None."""
    return [name for name, one in signature(library).parameters.items() if one.default is one.empty]


def given_by(library: Any) -> str:
    """Return the name of the key that holds the values of a load; empty for other terms."""
    return getattr(library, "given_by", "")


@cache
def term_table(kind: str, library: Any) -> Any:
    """Return the table of a term."""
    if library is terms.EdgeNetwork:
        law = {name: one for name, one in keys_of(ElasticLaw).items() if name != "simplices"}
        return derived("type", kind, library, EdgeNetworkOfLaw, law | keys_of(library.of))
    return derived("type", kind, library, AnyTerm, keys_of(library) | ({"time": TIME} if given_by(library) else {}))


def term_tables() -> list[Any]:
    """Return the tables of all terms that are registered."""
    return [term_table(kind, library) for kind, library in terms.TERMS.items()]
