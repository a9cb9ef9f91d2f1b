"""Systems of units are consistent, and values in other units are detected."""

import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel, Field

from skfem_stvk import StvkError
from skfem_stvk.mesh import box
from skfem_stvk.scenes import Scene
from skfem_stvk.scenes.scene_units import LOADS, implausible
from skfem_stvk.scenes.schema import scene_tables
from skfem_stvk.units import DIMENSIONS, KEYS, UNITS


def of(dimension):
    return Field(default=None, json_schema_extra={"dimension": dimension})


class Steel(BaseModel):
    young: float | None = of("stress")
    density: float | None = of("density")
    voigt: list[list[float]] | None = of("stress")


class Load(BaseModel):
    traction: list[float] | None = of("stress")
    g: list[float] | None = of("acceleration")
    velocity: list[float] | None = of("velocity")


class Motion(BaseModel):
    dt: float | None = of("time")
    until: float = of("time")


class Bar(BaseModel):
    length: float | None = of("length")
    at: list[float] | None = of("length")


class Toy(BaseModel):
    units: str = "SI"
    mesh: Bar | None = None
    materials: dict[str, Steel] = {}
    terms: list[Load] = []
    analysis: Motion | None = None


@pytest.mark.parametrize("name", UNITS)
def test_a_system_is_consistent(name):
    """Force is mass times acceleration, stress is force per area, energy is force times length, and symbols have these factors."""
    units = UNITS[name]
    f = units.factor
    assert np.isclose(f("force"), f("mass") * f("acceleration"), rtol=1e-14)
    assert np.isclose(f("stress"), f("force") / f("area"), rtol=1e-14) and np.isclose(f("energy"), f("force") * f("length"))
    assert np.isclose(f("density") * f("velocity") ** 2, f("stress"), rtol=1e-14)
    known = {"m": 1, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "in": 0.0254, "kg": 1, "t": 1e3, "g": 1e-3, "s": 1, "ms": 1e-3}
    known |= {"N": 1, "kN": 1e3, "uN": 1e-6, "dyn": 1e-5, "lbf": 4.4482216152605, "Pa": 1, "MPa": 1e6, "GPa": 1e9, "Ba": 0.1}
    known |= {"psi": 6894.757293168361, "J": 1, "mJ": 1e-3, "erg": 1e-7, "pJ": 1e-12, "Hz": 1, "kHz": 1e3}
    known |= {"in*lbf": 0.11298482902761668, "slinch": 4.4482216152605 / 0.0254}
    for dimension, symbol in units.symbols.items():
        assert np.isclose(f(dimension), known[symbol], rtol=1e-12), dimension


def test_symbols_are_the_customary_symbols():
    assert [UNITS["SI"].symbol(one) for one in ("density", "stiffness per area", "rate", None)] == ["kg/m^3", "N/m^3", "1/s", ""]
    assert UNITS["mm-kg-ms"].symbol("velocity") == "mm/ms" and UNITS["cm-g-s"].symbol("density") == "g/cm^3"
    assert all(units.symbol(one) and units.factor(one) > 0 for units in UNITS.values() for one in DIMENSIONS)
    with pytest.raises(StvkError, match=r"dimension = 'stres'; known: .* Did you mean 'stress'\?"):
        UNITS["SI"].symbol("stres")


MANY = {
    "soft tissue": (3e3, 1050.0),
    "foam": (5e4, 30.0),
    "rubber": (1e6, 1100.0),
    "steel": (210e9, 7850.0),
    "silicon": (169e9, 2330.0),
    "lead": (16e9, 11340.0),
    "flexible flag": (1.4e6, 1e3),
    "wood": (1e10, 500.0),
}


@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("name", MANY)
def test_real_materials_are_plausible_in_every_system(name, units):
    young, density = MANY[name]
    f = UNITS[units].factor
    steel = Steel(young=young / f("stress"), density=density / f("density"))
    loads = [Load(g=[0, 0, -9.81 / f("acceleration")], traction=[0, 0, young / 100 / f("stress")])]
    motion = Motion(dt=1e-4 / f("time"), until=0.5 / f("time"))
    scene = Toy(units=units, mesh=Bar(length=0.3 / f("length")), materials={name: steel}, terms=loads, analysis=motion)
    assert implausible(scene, box((0.3 / f("length"), 1e-2 / f("length")), 2)) == []


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (
            Toy(materials={"steel": Steel(density=7.85)}),
            "materials.steel.density = 7.85 kg/m^3 is unusual; usual are 10 to 30000 kg/m^3: 7.85 g/cm^3 is 7850 kg/m^3. "
            'It would be usual with units = "cm-g-s".',
        ),
        (
            Toy(materials={"steel": Steel(young=210)}),
            "materials.steel.young = 210 Pa is unusual; usual are 500 to 2e+12 Pa: 210 GPa is 2.1e+11 Pa. It would be usual "
            'with units = "mm-N-MPa", "mm-kg-ms", "mm-g-ms", "um-kg-s" or "in-lbf-s".',
        ),
        (
            Toy(units="mm-N-MPa", materials={"steel": Steel(young=210e9)}),
            "materials.steel.young = 2.1e+11 MPa is unusual; usual are 0.0005 to 2e+06 MPa: 2.1e+11 Pa is 210000 MPa. It "
            'would be usual with units = "SI" or "cm-g-s".',
        ),
        (
            Toy(units="mm-N-MPa", materials={"steel": Steel(density=7850)}),
            "materials.steel.density = 7850 t/mm^3 is unusual; usual are 1e-11 to 3e-08 t/mm^3: 7850 kg/m^3 is 7.85e-09 "
            't/mm^3. It would be usual with units = "SI".',
        ),
        (
            Toy(mesh=Bar(length=300)),
            "mesh.length = 300 m is unusual; usual are 1e-07 to 200 m: 300 mm is 0.3 m. It would be usual with units = ",
        ),
        (
            Toy(terms=[Load(), Load(g=[0, 0, -9810])]),
            "terms[1].g = 9810 m/s^2 is unusual; usual are 0.1 to 5000 m/s^2: 9810 mm/s^2 is 9.81 m/s^2.",
        ),
        (
            Toy(units="mm-N-MPa", terms=[Load(g=[0, 0, -9.81])]),
            "terms[0].g = 9.81 mm/s^2 is unusual; usual are 100 to 5e+06 mm/s^2: 9.81 m/s^2 is 9810 mm/s^2.",
        ),
        (
            Toy(materials={"steel": Steel(young=2.1e5, density=7850)}),
            "materials.steel: young = 210000 Pa and density = 7850 kg/m^3 are inconsistent: the speed of sound would be 5.17 m/s.",
        ),
        (
            Toy(materials={"rubber": Steel(young=1e6)}, terms=[Load(traction=[0, 0, -2e6])]),
            "terms[0].traction = 2e+06 Pa exceeds the stiffness of the stiffest material, 1e+06 Pa, so no body can carry it.",
        ),
        (
            Toy(analysis=Motion(dt=0.1, until=0.05)),
            "analysis.dt = 0.1 is longer than the whole motion, 0.05; expected a shorter step.",
        ),
        (Toy(analysis=Motion(dt=1e-12, until=1.0)), "analysis.dt = 1e-12 makes 1e+12 steps until 1."),
        (Toy(materials={"ply": Steel(voigt=[[210.0, 1.0], [1.0, 80.0]])}), "materials.ply.voigt = 210 Pa is unusual"),
    ],
)
def test_values_in_other_units_are_reported_with_the_likely_cause(scene, message):
    (text,) = implausible(scene)
    assert text.startswith(message)


def test_an_implausible_size_of_the_mesh_is_reported():
    (text,) = implausible(Toy(), box((300.0, 20.0), 2))
    assert text.startswith("the size of the mesh = 300 m is unusual") and text.endswith("can be scaled: mesh.scale.")
    assert implausible(Toy(units="mm-N-MPa"), box((300.0, 20.0), 2)) == []


def keys_with_dimensions(schema):
    """Yield the keys with dimensions in all tables of a JSON Schema, and their dimensions."""
    for table in (schema, *schema.get("$defs", {}).values()):
        for name, key in table.get("properties", {}).items():
            if key.get("dimension"):
                yield name, key["dimension"]


def test_the_checked_keys_and_dimensions_exist_in_the_schema():
    """All keys of the plausibility checks exist in the schema, and all dimensions of the schema have symbols."""
    found = set(keys_with_dimensions(scene_tables().model_json_schema()))
    assert {dimension for _, dimension in found} <= set(DIMENSIONS) and len(found) > 30
    assert {(name, usual.dimension) for name, usual in KEYS.items()} <= found
    assert {(name, "stress") for name in LOADS} <= found


BAR = {
    "mesh": {"type": "box", "size": [0.3, 0.02, 0.02], "cells": [6, 1, 1]},
    "materials": {"steel": {"model": "isotropic", "young": 210e9, "poisson": 0.3, "density": 7850.0}},
    "terms": [{"type": "stvk", "material": "steel"}, {"type": "gravity", "g": [0.0, 0.0, -9.81]}],
    "fixed": {"left": "xyz"},
    "analysis": {"type": "dynamic", "dt": 1e-4, "until": 0.01},
}


@pytest.mark.parametrize(
    ("change", "beginning"),
    [
        (["materials.steel.density=7.85"], "materials.steel.density = 7.85 kg/m^3 is unusual"),
        (["materials.steel.young=210.0"], "materials.steel.young = 210 Pa is unusual"),
        (["mesh.size=[300.0, 20.0, 20.0]"], "mesh.size = 300 m is unusual"),
        (["terms[1].g=[0.0, 0.0, -9810.0]"], "terms[1].g = 9810 m/s^2 is unusual"),
        (["analysis.until=1e9"], "analysis.until = 1e+09 s is unusual"),
        (["analysis.dt=0.1"], "analysis.dt = 0.1 is longer than the whole motion"),
        (
            ["units=mm-N-MPa", "materials.steel.young=210e3", "materials.steel.density=7.85e-9"],
            "terms[1].g = 9.81 mm/s^2 is unusual",
        ),
    ],
)
def test_a_value_in_other_units_is_reported_once(change, beginning):
    scene = Scene.of_data(BAR)
    assert scene.implausible() == []
    texts = implausible(scene_tables().model_validate(scene.source.changed(change).data), scene.built.mesh)
    assert [text for text in texts if text.startswith(beginning)] and len({text.split(" = ")[0] for text in texts}) == len(texts)


def test_the_documentation_lists_every_system_with_correct_values_of_steel_and_gravity():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "units.md").read_text(encoding="utf-8")
    rows = [re.split(r" *\| *", line)[1:-1] for line in page.splitlines() if re.match(r"\| `[\w-]+` \| ", line) and ";" in line][1:]
    assert [row[0].strip("`") for row in rows] == list(UNITS)
    for name, base, derived, values in rows:
        units = UNITS[name.strip("`")]
        assert base.split(", ") == [units.symbol(one) for one in ("length", "mass", "time")]
        assert derived.split(", ") == [units.symbol(one) for one in ("force", "stress", "energy")]
        young, density, g = (float(one) for one in re.split("[,;] ", values))
        for value, dimension, si in ((young, "stress", 210e9), (density, "density", 7850), (g, "acceleration", 9.81)):
            assert np.isclose(value * units.factor(dimension), si, rtol=2e-3), (name, dimension)


def test_zeros_and_coordinates_are_always_plausible():
    scene = Toy(mesh=Bar(length=1.0, at=[1e9, 0.0]), terms=[Load(g=[0, 0, 0], velocity=[0, 0, 0])])
    assert implausible(scene) == []
