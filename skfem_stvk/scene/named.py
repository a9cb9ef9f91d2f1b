"""Scenes of systems that a program built, and the parts of these that scenes cannot express."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from ..arguments import real_array, shown
from ..errors import StvkError, name_ids
from ..mesh import ElementMesh
from ..mesh.locations import Box, DofsView, NearestNode, Plane, describe, vertices_at
from ..system import System
from ..system.supports import fixed_dofs
from ..terms import EdgeNetwork, Ramp, Sine, Table
from .schema.derived import KEYS, PARTS, SURFACES
from .schema.quantities import bare, literals, members
from .schema.terms import given_by, in_elements, material_tables, term_tables

#: Shapes of constants that are not scalars.
SHAPES = {"frame": (3, 3), "voigt": (6, 6)}
#: Name of the mesh file, in the folder of the scene.
MESH = "mesh.vtu"


class NotExpressible(StvkError):
    """Error for an object that a program can build and a scene cannot name."""


@dataclass(frozen=True, eq=False)
class NamedSystem:
    """A system as a scene.

    Attributes
    ----------
    data
        The tables of the scene, whose mesh is in a file.
    mesh
        Mesh that the file must hold: the system's mesh, with sets of nodes and elements for places and regions without a name.
    left_out
        The parts that a scene cannot name, in words.
    """

    data: dict[str, Any]
    mesh: ElementMesh
    left_out: tuple[str, ...]

    @classmethod
    def of(cls, system: System, analysis: Any) -> NamedSystem:
        """Make the data of `Scene.of`, whose docstring lists what is accepted and what is refused."""
        if not isinstance(system, System):
            raise StvkError(f"system = {shown(system)}; expected a System.")
        if not isinstance(analysis, BaseModel | Mapping):
            expected = 'a table such as {"type": "static", "steps": 10}, or an analysis of skfem_stvk.scene.schema.analyses'
            raise StvkError(f"analysis = {shown(analysis)}; expected {expected}.")
        made, names = system.made_of, SceneNames(system.mesh)
        data: dict[str, Any] = {"units": system.units.name, "mesh": {"file": MESH}}
        data["mesh"] |= {name: made[name] for name in ("quadrature", "hourglass") if made[name] is not None}
        given = made["terms"] if isinstance(made["terms"], list | tuple) else [made["terms"]]
        lower_terms = [id(term) for body in system.body.beside for term in body.terms]
        named = []
        for number, (user_term, bound) in enumerate(zip(given, system.terms, strict=True)):
            term = user_term if id(bound) in lower_terms else bound  # terms with simplices have regions on lower-dimensional meshes
            with names.leaving_out(f"terms[{number}], {type(term).__name__}"):
                named.append(names.term(term))
        if not any("material" in term for term in named):
            raise StvkError(f"No law of this system can be expressed in a scene: {'; '.join(names.left_out)}.")
        fixed, prescribed = names.fixed(made["fixed"]), names.prescribed(made["prescribed"])
        if np.dtype(made["dtype"]) != np.float64:
            names.left_out.append(f"dtype = {np.dtype(made['dtype']).name}: scenes compute in double precision")
        if len(system.removed):
            names.left_out.append(f"{name_ids(system.removed, 'element')}: removed from the system; the scene has the whole body")
        tables = {"places": names.places, "materials": names.materials, "terms": named, "fixed": fixed, "prescribed": prescribed}
        data |= {name: table for name, table in tables.items() if table}
        data["analysis"] = deepcopy(dict(analysis)) if isinstance(analysis, Mapping) else analysis.model_dump(exclude_none=True)
        return cls(data, names.marked(), tuple(names.left_out))


class SceneNames:
    """Names and tables of terms, materials, places and supports on a mesh; NotExpressible if a scene cannot express them."""

    def __init__(self, mesh: ElementMesh) -> None:
        self.mesh = mesh
        self.materials: dict[str, dict[str, Any]] = {}
        self.places: dict[str, Any] = {}
        self.left_out: list[str] = []
        self._node_sets: dict[str, NDArray[Any]] = {}
        self._subdomains: dict[str, NDArray[Any]] = {}
        self._boundaries: dict[str, NDArray[Any]] = {}
        self._lines: dict[str, NDArray[Any]] = {}

    @contextmanager
    def leaving_out(self, what: str) -> Iterator[None]:
        """Skip what a scene cannot express, and report it."""
        try:
            yield
        except NotExpressible as error:
            self.left_out.append(f"{what}: {error}")

    def marked(self) -> ElementMesh:
        """Return the mesh with the sets of nodes and elements that were named."""
        kinds = ("node_sets", "subdomains", "boundaries", "lines")
        named = {kind: getattr(self, f"_{kind}") for kind in kinds}
        new: dict[str, Any] = {kind: {**getattr(self.mesh, kind), **groups} for kind, groups in named.items() if groups}
        return replace(self.mesh, **new) if new else self.mesh

    def term(self, term: Any) -> dict[str, Any]:
        """Return the table of a term."""
        model = _model(term_tables(), term, "term")
        if hasattr(term, "laws"):
            return self._network(term, model)
        return self._table(model, term)

    def _table(self, model: Any, given: Any) -> dict[str, Any]:
        """Return the table of an object of the library, with its type if there are several."""
        table: dict[str, Any] = {"type": _kind(model, "type")} if "type" in model.model_fields else {}
        for one in (one for one in fields(given) if one.init):
            name, value = KEYS.get(one.name, one.name), getattr(given, one.name)
            if value is not None and value is not False:
                table |= self._entry(model, name, value)
        return table

    def _entry(self, model: Any, name: str, value: Any) -> dict[str, Any]:
        """Return the key of a term with its value, and the keys that belong to it."""
        if name not in model.model_fields:
            raise NotExpressible(f"{name} has no key in a scene")
        if name == "material":
            return {name: self.material(value)}
        if name == "region":
            return {name: self.region(value)}
        if name == "simplices":
            return {name: self.simplices(value)}
        if name == "file" and not isinstance(value, str):
            raise NotExpressible("a RigidMesh in memory has no file; write one, and make RigidMesh(path) from it")
        if name in PARTS and type(value) in [table.library for table in PARTS[name]]:
            return {name: self._table(_model(PARTS[name], value, name), value)}
        if name == "on" or name in SURFACES:
            if name in SURFACES and isinstance(value, str) and value in self.mesh.subdomains:
                return {name: value}
            return {name: self._marked_elements(value) if in_elements(model.library, self.mesh) else self.place(value)}
        if name == given_by(model.library):
            value, time = in_time(value, name, *self._shapes(model, name))
            return {name: value} if time is None else {name: value, "time": time}
        if isinstance(value, str | bool):
            return {name: value}
        return {name: plain(value, name, *self._shapes(model, name))}

    def _shapes(self, model: Any, name: str) -> list[tuple[int, ...]]:
        """Return the shapes that the value of a key may have."""
        kinds = [bare(kind)[0] for _, kind in members(model.model_fields[name].annotation)]
        return [(self.mesh.d,) if get_origin(kind) is list else () for kind in kinds]

    def _network(self, network: Any, model: Any) -> dict[str, Any]:
        """Return the table of a network of edges of one law, with all its pairs of edges or with one kind of them."""
        if len(network.laws) != 1:
            raise NotExpressible(f"it is made of {len(network.laws)} laws, not of one")
        (law,) = network.laws
        for pairs in literals(model.model_fields["pairs"].annotation):
            other = EdgeNetwork.of(self.mesh, law, pairs)
            if np.array_equal(other.edges, network.edges) and not (other.L != network.L).nnz:
                return self.term(law) | {"type": _kind(model, "type"), "pairs": pairs}
        raise NotExpressible("its coefficients are not those of its law")

    def material(self, material: Any) -> str:
        """Return the name of a material, the same for the same constants."""
        model = _model(material_tables(), material, "material")
        table = {"model": _kind(model, "model")}
        for one in fields(material):
            value = getattr(material, one.name)
            if value is not None:
                shape = (3,) if isinstance(value, tuple) else SHAPES.get(one.name, ())
                table[one.name] = plain(value, one.name, shape)
        return self._named(table["model"], table, self.materials)

    def region(self, region: Any) -> Any:
        """Return a region as a scene has it: a name, a box, or elements in the order in which they are listed."""
        if isinstance(region, Box):
            return shape_of(region)
        ids = self.mesh.elements(region)
        if (np.diff(ids) < 0).any():
            return {"type": "elements", "ids": ids.tolist()}
        return self._marked_elements(region)

    def simplices(self, given: Any) -> Any:
        """Return the name of a boundary or lines for the elements of a term, made if there is none; else the nodes of each."""
        if isinstance(given, str):
            return checked_name(given)
        t = np.asarray(given)
        groups = {self.mesh.element.edge.n: self._lines} | {self.mesh.facet.n: self._boundaries}
        return self._named("simplices", t, groups[len(t)]) if len(t) in groups else t.T.tolist()

    def _marked_elements(self, region: Any) -> str:
        """Return the name of a subdomain, which is made if there is none."""
        if isinstance(region, str):
            return checked_name(region)
        return self._named("region", self.mesh.elements(region), self._subdomains)

    def place(self, where: Any) -> Any:
        """Return a place as a scene has it: a name, coordinates or a shape; others get a name for their nodes."""
        shape = shape_of(where)
        return self._shape_or_name(where) if shape is None else shape

    def _shape_or_name(self, where: Any) -> str:
        """Return the name of a place, which is made if there is none."""
        if isinstance(where, str):
            return checked_name(where)
        shape = shape_of(where)
        if shape is not None:
            return self._named("place", shape, self.places)
        return self._named("nodes", np.sort(vertices_at(self.mesh, where)), self._node_sets)

    def _another_name(self, where: Any) -> str:
        """Return a new name for the nodes of a place."""
        name = self._free("nodes")
        self._node_sets[name] = np.sort(vertices_at(self.mesh, where))
        return name

    def fixed(self, given: Any) -> dict[str, str]:
        """Return the components that do not move, by the name of their place."""
        table: dict[str, str] = {}
        for where, components in [(None, given)] if isinstance(given, DofsView) else _pairs(given):
            parts = [(where, components)]
            if isinstance(components, DofsView):
                parts = self._by_components(fixed_dofs(self.mesh, components))
            for place, those in parts:
                with self.leaving_out(f"fixed on {describe(place)}"):
                    name = self._shape_or_name(place)
                    table[name] = "".join(sorted({*table.get(name, ""), *those}))
        return table

    def _by_components(self, dofs: NDArray[Any]) -> list[tuple[Any, str]]:
        """Return nodes with the same components among these degrees of freedom, and these components."""
        d = self.mesh.d
        has = np.zeros((self.mesh.nv, d), dtype=bool)
        has[dofs // d, dofs % d] = True
        kinds, which = np.unique(has, axis=0, return_inverse=True)
        components = ["".join(np.array(list("xyz"[:d]))[kind]) for kind in kinds]
        return [(np.flatnonzero(which.ravel() == number), name) for number, name in enumerate(components) if name]

    def prescribed(self, given: Any) -> dict[str, dict[str, Any]]:
        """Return displacements by the name of their place. Displacements with another function of time get a separate place."""
        table: dict[str, dict[str, Any]] = {}
        for where, motions in _pairs(given):
            what, entries = f"prescribed on {describe(where)}", list[dict[str, Any]]()
            for components, value in motions.items() if isinstance(motions, Mapping) else [("xyz"[: self.mesh.d], motions)]:
                with self.leaving_out(f"{what}, component {components}"):
                    entries += _displacement(components, value, isinstance(motions, Mapping))
            for entry in _joined(entries):
                with self.leaving_out(what):
                    name = self._shape_or_name(where)
                    table[self._another_name(where) if name in table else name] = entry
        return table

    def _named(self, kind: str, given: Any, among: dict[str, Any]) -> str:
        """Return the name of an equal entry, or a new name."""
        for name, other in among.items():
            if np.array_equal(given, other) if isinstance(given, np.ndarray) else given == other:
                return name
        name = self._free(kind)
        among[name] = given
        return name

    def _free(self, kind: str) -> str:
        mesh = self.mesh
        kinds = (mesh.boundaries, mesh.lines, mesh.node_sets, mesh.subdomains, self.places, self.materials)
        own_groups = (self._node_sets, self._subdomains, self._boundaries, self._lines)
        taken = {name for names in (*kinds, *own_groups) for name in names}
        return next(name for number in count(1) if (name := f"{kind}-{number}") not in taken)


def _model(tables: Sequence[Any], given: Any, what: str) -> Any:
    """Return the table for an object of the library; NotExpressible for an object of another class."""
    model = next((one for one in tables if one.library is type(given)), None)
    if model is None:
        raise NotExpressible(f"{type(given).__name__} is a {what} that scenes cannot express")
    return model


def _kind(model: type[BaseModel], key: str) -> str:
    return str(get_args(model.model_fields[key].annotation)[0])


def checked_name(name: str) -> str:
    """Return a name as scenes and mesh files have it; NotExpressible for one that they cannot hold."""
    if not name.isprintable() or name != name.strip() or not 1 <= len(name) <= 100:
        raise NotExpressible(f"the name {shown(name)} is not of 1 to 100 characters that can be printed, without blanks around")
    return name


def shape_of(where: Any) -> Any:
    """Return a place by its shape as a scene has it; None for others."""
    if isinstance(where, NearestNode):
        return list(where.point)
    if isinstance(where, Box):
        return {"type": "box", "low": list(where.low), "high": list(where.high)}
    if isinstance(where, Plane):
        within = {} if where.within is None else {"within": where.within}
        return {"type": "plane", "point": list(where.point), "normal": list(where.normal)} | within
    return None


def in_time(value: Any, name: str, *shapes: tuple[int, ...]) -> tuple[Any, dict[str, Any] | None]:
    """Return constants of these shapes, and the function of time that multiplies them. Raise NotExpressible for other functions."""
    time: dict[str, Any] | None = None
    if type(value) in (Ramp, Sine, Table):
        others = {one.name: getattr(value, one.name) for one in fields(value) if one.name != "value"}
        plainly = {key: list(one) if isinstance(one, tuple) else one for key, one in others.items()}
        time = {"type": type(value).__name__.lower(), **plainly}
        value = value.value
    elif callable(value):
        raise NotExpressible(f"{name} is a function other than Ramp, Sine or Table")
    return plain(value, name, *shapes), time


def plain(value: Any, name: str, *shapes: tuple[int, ...]) -> Any:
    """Return a number, or numbers of one of the `shapes` in lists. Raise NotExpressible for one for each element or node."""
    if callable(value):
        raise NotExpressible(f"{name} is a function")
    given = real_array(value)
    if given is None or given.shape not in (shapes or ((),)):
        raise NotExpressible(f"{name} has one value for each element or node")
    return given.tolist()


def _pairs(given: Any) -> list[tuple[Any, Any]]:
    return list(given.items()) if isinstance(given, Mapping) else list(given or [])


def _displacement(components: str, value: Any, alike: bool) -> list[dict[str, Any]]:
    """Return displacements by component, with their function of time: `alike`, or one after another."""
    constants, time = in_time(value, "it", () if alike else (len(components),))
    each = [constants] * len(components) if alike else constants
    return [{letter: one} | ({} if time is None else {"time": time}) for letter, one in zip(components, each, strict=True)]


def _joined(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one table for all displacements with the same function of time."""
    joined: list[dict[str, Any]] = []
    for entry in entries:
        same = [one for one in joined if one.get("time") == entry.get("time")]
        if same:
            same[0].update(entry)
        else:
            joined.append(dict(entry))
    return joined
