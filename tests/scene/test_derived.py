"""Keys of scenes are those that parameters of the library declare, with their types, defaults, limits and units."""

from dataclasses import dataclass
from typing import Annotated, Any

import pytest
from pydantic import ValidationError

from skfem_stvk.arguments import Quantity
from skfem_stvk.mesh import box
from skfem_stvk.scene import Scene
from skfem_stvk.scene.build import Names
from skfem_stvk.scene.schema.derived import derived
from skfem_stvk.scene.schema.materials import MODELS
from skfem_stvk.scene.schema.terms import TERMS, AnyTerm
from skfem_stvk.scene.templates import rows_of
from skfem_stvk.scene.units import DIMENSIONS


@dataclass(frozen=True)
class Glue:
    """A toy term."""

    where: Annotated[Any, Quantity(None, "Place that is glued.")]
    stiffness: Annotated[float, Quantity("stiffness per area", "Stiffness of the glue.", gt=0)]
    kind: Annotated[str, Quantity(None, "Of the glue.", values=("wet", "dry"))] = "dry"
    pulls: Annotated[tuple[float, float, float] | None, Quantity("stress", "Strengths.", ge=0)] = None
    ages: Annotated[bool, Quantity(None, "Whether it gets weaker.")] = False
    inner: float = 1.0


GLUE = derived("GlueTerm", AnyTerm, Glue, "Glue between a surface and the ground.", ("type", "glue"))


def test_a_table_has_a_key_for_each_parameter_that_is_declared():
    rows = {row.name: row for row in rows_of(GLUE)}
    assert list(rows) == ["type", "on", "stiffness", "kind", "pulls", "ages"]
    assert (rows["stiffness"].type, rows["stiffness"].dimension) == ("number > 0", "stiffness per area")
    assert (rows["kind"].type, rows["kind"].default) == ('"wet" or "dry"', "dry")
    assert (rows["pulls"].type, rows["pulls"].default) == ("list of numbers", None)
    assert (rows["ages"].type, rows["on"].sentence) == ("true or false", "Place that is glued.")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"stiffness": 0.0}, "greater than 0"),
        ({"stiffness": "1"}, "valid number"),
        ({"kind": "old"}, "'wet' or 'dry'"),
        ({"ages": 1}, "valid boolean"),
        ({"pulls": [1.0, 2.0]}, "at least 3 items"),
        ({"pulls": [1.0, 2.0, -1.0]}, "greater than or equal to 0"),
        ({"inner": 2.0}, "not permitted"),
        ({"on": 3}, "a name, coordinates"),
    ],
)
def test_values_that_are_not_declared_are_refused(changed, said):
    good = {"type": "glue", "on": "left", "stiffness": 2.0}
    assert GLUE.model_validate(good).stiffness == 2.0
    with pytest.raises(ValidationError, match=said):
        GLUE.model_validate(good | changed)


def test_the_object_of_the_library_has_the_values_of_the_keys():
    made = GLUE.model_validate({"type": "glue", "on": "left", "stiffness": 2.0, "kind": "wet"})
    data = {
        "mesh": {"type": "box", "size": [1.0, 1.0, 1.0], "cells": [1, 1, 1]},
        "materials": {"steel": {"model": "isotropic", "young": 1.0, "poisson": 0.3}},
        "terms": [{"type": "stvk", "material": "steel"}],
        "analysis": {"type": "static"},
    }
    names = Names(Scene.of_data(data).sections, box((1.0, 1.0, 1.0), (1, 1, 1)))
    assert made.term(names) == Glue("left", 2.0, "wet")


def test_every_declared_dimension_is_one_of_units():
    dimensions = {row.dimension for table in (*TERMS, *MODELS.values()) for row in rows_of(table)}
    assert {"stress", "density", "acceleration"} <= dimensions <= {None, *DIMENSIONS}
