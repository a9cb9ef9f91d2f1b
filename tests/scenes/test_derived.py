"""Scene keys follow the declared parameters of the library, with their types, defaults, limits and units."""

import re
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
import pytest
from pydantic import BaseModel, ValidationError

from skfem_stvk import (
    Corotated,
    Friction,
    InvertibleStVK,
    LinearElastic,
    MeshContact,
    NeoHookean,
    RigidBox,
    RigidContact,
    RigidCylinder,
    RigidPlane,
    RigidSphere,
    Sine,
    SpringNetwork,
    StVK,
    VolumePenalty,
)
from skfem_stvk.arguments import Quantity
from skfem_stvk.edges.materials import Anisotropic, Isotropic, Orthotropic, TransverselyIsotropic
from skfem_stvk.errors import StvkError
from skfem_stvk.mesh import box
from skfem_stvk.scenes.build import Names
from skfem_stvk.scenes.scene import Scene
from skfem_stvk.scenes.schema import scene_tables
from skfem_stvk.scenes.schema.derived import PARTS, derived
from skfem_stvk.scenes.schema.quantities import bare, input_files, is_input_file, members
from skfem_stvk.scenes.schema.terms import AnyTerm, Time, material_tables, term_tables
from skfem_stvk.scenes.templates import rows_of
from skfem_stvk.solvers.dynamics.integrators import INTEGRATORS, GeneralizedAlpha, Newmark
from skfem_stvk.units import DIMENSIONS


@dataclass(frozen=True)
class Glue:
    """Toy term."""

    where: Annotated[Any, Quantity(None, "Place that is glued.")]
    stiffness: Annotated[float, Quantity("stiffness per area", "Stiffness of the glue.", gt=0)]
    kind: Annotated[str, Quantity(None, "Of the glue.", values=("wet", "dry"))] = "dry"
    pulls: Annotated[tuple[float, float, float] | None, Quantity("stress", "Strengths.", ge=0)] = None
    ages: Annotated[bool, Quantity(None, "Whether it gets weaker.")] = False
    layers: Annotated[int, Quantity(None, "Number of layers.", ge=1)] = 1
    name: Annotated[str, Quantity(None, "Name of the glue.")] = "glue"
    range: Annotated[tuple[float, float], Quantity("length", "Least and largest distance.")] = (0.0, 1.0)
    inner: float = 1.0


BLOCK = {
    "mesh": {"type": "box", "size": [1.0, 1.0, 1.0], "cells": [1, 1, 1]},
    "materials": {"steel": {"model": "isotropic", "young": 1.0, "poisson": 0.3}},
    "terms": [{"type": "stvk", "material": "steel"}],
    "analysis": {"type": "static"},
}
GLUE = derived("type", "glue", Glue, AnyTerm)


def test_a_table_has_a_key_for_each_declared_parameter():
    rows = {row.name: row for row in rows_of(GLUE)}
    assert list(rows) == ["type", "on", "stiffness", "kind", "pulls", "ages", "layers", "name", "range"]
    assert (rows["stiffness"].type, rows["stiffness"].dimension) == ("number > 0", "stiffness per area")
    assert (rows["kind"].type, rows["kind"].default) == ('"wet" or "dry"', "dry")
    assert (rows["pulls"].type, rows["pulls"].default) == ("list of numbers", None)
    assert (rows["layers"].type, rows["name"].type, rows["range"].type) == ("whole number >= 1", "text", "list of numbers")
    assert (rows["ages"].type, rows["on"].sentence) == ("true or false", "Place that is glued.")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"stiffness": 0.0}, "greater than 0"),
        ({"stiffness": "1"}, "valid number"),
        ({"kind": "old"}, "'wet' or 'dry'"),
        ({"ages": 1}, "valid boolean"),
        ({"pulls": [1.0, 2.0]}, "at least 3 items"),
        ({"pulls": [1.0, 2.0, -1.0]}, "greater than or equal to 0"),
        ({"layers": 1.0}, "valid integer"),
        ({"layers": 0}, "greater than or equal to 1"),
        ({"name": 1.0}, "valid string"),
        ({"range": [0.0, 1.0, 2.0]}, "at most 2 items"),
        ({"inner": 2.0}, "not permitted"),
        ({"on": 3}, "a name, coordinates"),
    ],
)
def test_values_outside_the_declaration_are_refused(changed, message):
    good = {"type": "glue", "on": "left", "stiffness": 2.0}
    assert GLUE.model_validate(good | {"pulls": None}).stiffness == 2.0
    with pytest.raises(ValidationError, match=message):
        GLUE.model_validate(good | changed)


def test_the_object_of_the_library_has_the_values_of_the_keys():
    made = GLUE.model_validate({"type": "glue", "on": "left", "stiffness": 2.0, "kind": "wet"})
    names = Names(Scene.of_data(BLOCK).sections, box((1.0, 1.0, 1.0), (1, 1, 1)))
    assert made.term(names) == Glue("left", 2.0, "wet")


@dataclass(frozen=True)
class Painted:
    """Toy term that reads a file."""

    file: Annotated[Any, Quantity(None, "File of the paint.")]


def test_a_file_of_a_term_is_relative_to_the_scene(tmp_path):
    table = derived("type", "painted", Painted, AnyTerm).model_validate({"type": "painted", "file": "paint.csv"})
    solid = box((1.0, 1.0, 1.0), (1, 1, 1))
    assert list(input_files({"terms": [table]})) == [(("terms", 0, "file"), "paint.csv")]
    assert table.term(Names(Scene.of_data(BLOCK).sections, solid, tmp_path)) == Painted(tmp_path / "paint.csv")


def tables_of(annotation):
    """Yield all tables within a type."""
    for _, member in members(annotation):
        kind, _ = bare(member)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield kind
            for field in kind.model_fields.values():
                yield from tables_of(field.annotation)
        else:
            for entry in get_args(kind):
                yield from tables_of(entry)


def test_every_key_with_the_path_of_a_file_is_checked_hashed_and_written_or_is_an_output():
    """A path that `input_files` does not find would be missing in the hash, in the checks and in the resolved scene."""
    paths = {
        (table, name): is_input_file(field)
        for table in tables_of(scene_tables())
        for name, field in table.model_fields.items()
        if str in [bare(kind)[0] for _, kind in members(field.annotation)]
        and re.search(r"\b(files?|folders?|paths?)\b", f"{name} {field.description}", re.IGNORECASE)
    }
    read, written = ({(table.__name__, name) for (table, name), one in paths.items() if one is kind} for kind in (True, False))
    assert read == {("MeshFile", "file"), ("RigidMeshDerived", "file"), ("Initial", "file")}
    assert written == {("Output", "file"), ("Output", "animation")}


def test_every_declared_dimension_is_one_of_units():
    parts = [table for tables in PARTS.values() for table in tables]
    dimensions = {row.dimension for table in (*term_tables(), *material_tables(), *parts) for row in rows_of(table)}
    assert {"stress", "density", "acceleration"} <= dimensions <= {None, *DIMENSIONS}


#: Good arguments of a law on elements.
ON_ELEMENTS = {"young": 1.0, "poisson": 0.3, "plane": "strain", "thickness": 1.0, "area": 1.0}
#: Good arguments of all classes and functions that declare limits or texts.
GOOD = {
    **dict.fromkeys((StVK, NeoHookean, LinearElastic), ON_ELEMENTS),
    SpringNetwork: ON_ELEMENTS | {"rule": "lloyd"},
    Newmark: {"dt": 1e-3, "beta": 0.25, "gamma": 0.5},
    GeneralizedAlpha: {"dt": 1e-3, "rho": 0.8},
    Isotropic: {"young": 1.0, "poisson": 0.3, "density": 1.0},
    Isotropic.from_lame: {"lam": 1.0, "mu": 0.7, "density": 1.0},
    Orthotropic: {"young": (2.0, 1.0, 1.5), "poisson": (0.2, 0.1, 0.3), "shear": (0.5, 0.6, 0.7), "density": 1.0},
    TransverselyIsotropic: {
        "young_axial": 2.0,
        "young_transverse": 1.0,
        "poisson_axial": 0.1,
        "poisson_transverse": 0.2,
        "shear_axial": 0.5,
        "density": 1.0,
    },
    Anisotropic: {"voigt": np.eye(6), "density": 1.0},
    Corotated: ON_ELEMENTS | {"rotation": "vertex"},
    InvertibleStVK: ON_ELEMENTS | {"threshold": 0.7, "extend": "stress"},
    VolumePenalty: {"stiffness": 1.0, "kind": "quadratic"},
    RigidContact: {"shape": RigidPlane((0, 0, 0), (0, 0, 1)), "stiffness": 1.0, "onset": 0.1},
    MeshContact: {"first": None, "distance": 0.01, "stiffness": 1.0},
    RigidSphere: {"centre": (0, 0, 0), "radius": 1.0},
    RigidCylinder: {"point": (0, 0, 0), "axis": (0, 0, 1), "radius": 1.0},
    RigidBox: {"low": (0, 0, 0), "high": (1, 1, 1), "radius": 0.1},
    Friction: {"coefficient": 0.3, "slip_speed": 1e-3, "slip_length": 1e-3},
    Sine: {"value": 1.0, "frequency": 2.0, "phase": 0.1},
}


def declared(made):
    """Yield the parameters of a class or function with their declarations."""
    for name, hint in get_type_hints(made, include_extras=True).items():
        for one in getattr(hint, "__metadata__", ()):
            if isinstance(one, Quantity):
                yield name, one


def is_limited(quantity):
    return bool(quantity.values) or any(limit is not None for limit in (quantity.gt, quantity.ge, quantity.lt, quantity.le))


def wrong_arguments():
    """Yield a wrong argument for each declared limit and for each declared list of texts."""
    for made, good in GOOD.items():
        for name, quantity in declared(made):
            beyond = [
                quantity.ge - 0.1 if quantity.ge is not None else None,
                quantity.le + 0.1 if quantity.le is not None else None,
            ]
            for limit in (one for one in (quantity.gt, quantity.lt, *beyond) if one is not None):
                yield made, name, (*good[name][:2], limit) if isinstance(good[name], tuple) else limit
            if quantity.values:
                yield made, name, "other"


def test_good_arguments_cover_all_declared_limits():
    made = {table.library for table in (*term_tables(), *material_tables(), *get_args(get_args(Time)[0]))} | {*INTEGRATORS.values()}
    made |= {table.library for tables in PARTS.values() for table in tables}
    limited = {one for one in made if any(is_limited(found) for _, found in declared(one))}
    assert limited == GOOD.keys(), "GOOD in tests/scenes/test_derived.py has one row for each class with limits"
    assert len(list(wrong_arguments())) >= 20


@pytest.mark.parametrize(("made", "name", "value"), list(wrong_arguments()), ids=str)
def test_the_library_refuses_values_outside_its_declarations(made, name, value):
    """The error names the parameter, in the same way as a scene names the key."""
    made(**GOOD[made])
    with pytest.raises(StvkError, match=rf"\b{name}"):
        made(**GOOD[made] | {name: value})
