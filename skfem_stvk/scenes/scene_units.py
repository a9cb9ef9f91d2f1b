"""Check of a scene for values that are implausible in its units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..mesh import ElementMesh
from ..units import KEYS, STIFFNESS, UNITS, size_of, too_soft, unusual, waves

#: Loads per area are at most a small multiple of the largest stiffness.
LOADS = ("traction", "pressure")
#: Number of steps above which a run is implausible.
MOST_STEPS = 1e9


def implausible(sections: BaseModel, mesh: ElementMesh | None = None) -> list[str]:
    """Return, in a sentence each, values of a scene that are implausible in its units: usually they are in other units.

    Only keys that are set are checked; zeros are always plausible. If its `mesh` is passed, the size of the mesh is checked too,
    unless a key of it was reported already.

    >>> from pydantic import Field, create_model
    >>> dense = create_model("Dense", density=(float, Field(json_schema_extra={"dimension": "density"})))
    >>> scene = create_model("Units", units=(str, "SI"), steel=(dense, ...))
    >>> print(*implausible(scene(steel=dense(density=7.85))))
    steel.density = 7.85 kg/m^3 is unusual; usual are 10 to 30000 kg/m^3: 7.85 g/cm^3 is 7850 kg/m^3. It would be usual
    with units = "cm-g-s".
    """
    units = UNITS[getattr(sections, "units", "SI")]
    values = list(_values(sections))
    found = {path: text for path, name, dimension, value in values if (text := unusual(units, path, name, dimension, value))}
    for path, material in _parts(sections, "materials"):
        if path + ".young" not in found and path + ".density" not in found and (text := waves(units, path, material)):
            found[path] = text
    stiffest = max((value * units.factor("stress") for _, name, _, value in values if KEYS.get(name) is STIFFNESS), default=0.0)
    for path, name, dimension, value in values:
        if name in LOADS and 0 < stiffest < value * units.factor(dimension):
            symbol, largest = units.symbol(dimension), stiffest / units.factor(dimension)
            found[path] = (
                f"{path} = {value:.6g} {symbol} exceeds the stiffness of the stiffest material, {largest:g} {symbol}, so no "
                "body can carry it. Check the units of both, and whether a force was entered as a force per area."
            )
    found |= _steps(sections)
    if mesh is not None and not any(path.startswith("mesh.") for path in found):
        size = float(np.ptp(mesh.bounds, axis=1).max())
        if text := unusual(units, "the size of the mesh", "size", "length", size):
            found["mesh"] = f"{text} A file in other units can be scaled: mesh.scale."
        for path, material in _parts(sections, "materials"):
            if not {path, path + ".young"} & found.keys() and (text := too_soft(units, path, material, size)):
                found[path] = text
    return list(found.values())


def _values(part: BaseModel, path: str = "") -> Iterator[tuple[str, str, str, float]]:
    """Yield path, key, dimension and size of the values that are set and have a dimension; for several numbers the largest."""
    for name, info in type(part).model_fields.items():
        if name not in part.model_fields_set:
            continue
        given, key_path = getattr(part, name), f"{path}.{name}" if path else name
        dimension = dimension_of(info)
        if dimension is not None and (size := size_of(given)):
            yield key_path, name, dimension, size
        for inner, deeper in _inner(given, key_path):
            yield from _values(deeper, inner)


def dimension_of(found: FieldInfo) -> str | None:
    """Return the dimension that a key of a scene declares; None for pure numbers and other values."""
    extra = found.json_schema_extra
    dimension = extra.get("dimension") if isinstance(extra, dict) else None
    return dimension if isinstance(dimension, str) else None


def _inner(given: Any, key_path: str) -> Iterator[tuple[str, BaseModel]]:
    """Yield the tables in a value, with their paths."""
    if isinstance(given, BaseModel):
        yield key_path, given
    elif isinstance(given, Mapping):
        for key, one in given.items():
            yield from _inner(one, f"{key_path}.{key}")
    elif isinstance(given, list | tuple):
        for number, one in enumerate(given):
            yield from _inner(one, f"{key_path}[{number}]")


def _parts(sections: BaseModel, name: str) -> list[tuple[str, BaseModel]]:
    return list(_inner(getattr(sections, name, None), name))


def _steps(sections: BaseModel) -> dict[str, str]:
    """Return the remark on a time step that does not fit the end of the motion, by its key."""
    analysis = getattr(sections, "analysis", None)
    dt, until = getattr(analysis, "dt", None), getattr(analysis, "until", None)
    if not isinstance(dt, int | float) or not isinstance(until, int | float):
        return {}
    length = until - getattr(getattr(sections, "initial", None), "t0", 0.0)
    if dt > length > 0:
        return {"analysis.dt": f"analysis.dt = {dt:g} is longer than the whole motion, {length:g}; expected a shorter step."}
    if length > MOST_STEPS * dt:
        text = f"analysis.dt = {dt:g} makes {length / dt:.3g} steps until {until:g}. Check the units of both."
        return {"analysis.dt": text}
    return {}
