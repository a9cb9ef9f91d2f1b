"""Systems of units are consistent, and stiffnesses in other units are detected."""

import re
from pathlib import Path

import numpy as np
import pytest

from skfem_stvk import StvkError
from skfem_stvk.scenes.scene import Scene
from skfem_stvk.scenes.schema import scene_tables
from skfem_stvk.units import DIMENSIONS, UNITS, implausible_moduli


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
    "soft tissue": 3e3,
    "foam": 5e4,
    "rubber": 1e6,
    "steel": 210e9,
    "silicon": 169e9,
    "lead": 16e9,
    "flexible flag": 1.4e6,
    "wood": 1e10,
}


@pytest.mark.parametrize("units", UNITS.values(), ids=UNITS)
@pytest.mark.parametrize("name", MANY)
def test_real_materials_are_plausible_in_every_system(name, units):
    young = MANY[name] / units.factor("stress")
    assert implausible_moduli({name: young}, units, 0.3 / units.factor("length")) == []
    assert implausible_moduli({name: 1e9 * young}, units) and implausible_moduli({name: 1e-9 * young}, units)


@pytest.mark.parametrize(
    ("units", "size", "young", "message"),
    [
        (
            "SI",
            0.0,
            210.0,
            "E = 210 Pa is unusual; usual are 500 to 2e+12 Pa. It would be usual with units = "
            '"mm-N-MPa", "mm-kg-ms", "mm-g-ms", "um-kg-s", "in-lbf-s".',
        ),
        (
            "mm-N-MPa",
            300.0,
            210e9,
            "E = 2.1e+11 MPa is unusual for a body of 300 mm; usual are 0.0015 to 2e+06 MPa. It would be usual with units = "
            '"SI", "cm-g-s".',
        ),
        ("SI", 100.0, 2.1e5, "E = 210000 Pa is unusual for a body of 100 m; usual are 500000 to 2e+12 Pa."),
        ("SI", 0.0, (2e11, 1e13), "E = 1e+13 Pa is unusual; usual are 500 to 2e+12 Pa."),
        ("um-kg-s", 0.0, 1e-40, "E = 1e-40 MPa is unusual; usual are 0.0005 to 2e+06 MPa."),
    ],
)
def test_a_modulus_in_other_units_is_asked_about(units, size, young, message):
    (text,) = implausible_moduli({"E": young, "none": None, "usual": 1e9 / UNITS[units].factor("stress")}, UNITS[units], size)
    assert text.startswith(message)


def keys_with_dimensions(schema):
    """Yield the keys with dimensions in all tables of a JSON Schema, and their dimensions."""
    for table in (schema, *schema.get("$defs", {}).values()):
        for name, key in table.get("properties", {}).items():
            if key.get("dimension"):
                yield name, key["dimension"]


def test_all_dimensions_of_the_schema_have_symbols():
    found = set(keys_with_dimensions(scene_tables().model_json_schema()))
    assert {dimension for _, dimension in found} <= set(DIMENSIONS) and len(found) > 30


def test_a_scene_asks_with_the_key_of_the_material_and_the_size_of_its_mesh():
    scene = Scene.of_data(
        {
            "mesh": {"type": "box", "size": [0.3, 0.02, 0.02], "cells": [6, 1, 1]},
            "materials": {"steel": {"model": "isotropic", "young": 210e9, "poisson": 0.3, "density": 7850.0}},
            "terms": [{"type": "stvk", "material": "steel"}, {"type": "gravity", "g": [0.0, 0.0, -9.81]}],
            "fixed": {"left": "xyz"},
            "analysis": {"type": "dynamic", "dt": 1e-4, "until": 0.01},
        }
    )
    assert scene.implausible() == []
    sections = scene_tables().model_validate(scene.source.changed(["materials.steel.young=1000.0"]).data)
    assert sections.implausible() == []
    (text,) = sections.implausible(0.3)
    assert text.startswith("materials.steel.young = 1000 Pa is unusual for a body of 0.3 m; usual are 1500 to")


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
