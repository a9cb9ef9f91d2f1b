"""Systems of units of a scene's values, and the check for implausible values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ..arguments import choice
from ..errors import StvkError
from ..mesh import ElementMesh

#: Exponents of length, mass and time of each dimension that a key of a scene may have.
DIMENSIONS = {
    "length": (1, 0, 0),
    "area": (2, 0, 0),
    "mass": (0, 1, 0),
    "time": (0, 0, 1),
    "density": (-3, 1, 0),
    "stress": (-1, 1, -2),
    "force": (1, 1, -2),
    "energy": (2, 1, -2),
    "velocity": (1, 0, -1),
    "acceleration": (1, 0, -2),
    "force per volume": (-2, 1, -2),
    "stiffness per area": (-2, 1, -2),
    "stiffness per length": (0, 1, -2),
    "frequency": (0, 0, -1),
    "rate": (0, 0, -1),
    "angular velocity": (0, 0, -1),
}
#: Symbols of dimensions that are made of the symbols of others.
COMPOSED = {
    "area": "{length}^2",
    "density": "{mass}/{length}^3",
    "velocity": "{length}/{time}",
    "acceleration": "{length}/{time}^2",
    "force per volume": "{force}/{length}^3",
    "stiffness per area": "{force}/{length}^3",
    "stiffness per length": "{force}/{length}",
    "rate": "1/{time}",
    "angular velocity": "rad/{time}",
}


@dataclass(frozen=True)
class UnitSystem:
    """A consistent system of units: results of a computation in it are in it, too.

    Attributes
    ----------
    name
        Name of the system in scenes.
    length, mass, time
        Base units in m, kg and s.
    symbols
        Symbols of length, mass, time, force, stress, energy and frequency.

    Examples
    --------
    >>> UNITS["mm-N-MPa"].symbol("density"), UNITS["mm-N-MPa"].factor("density")
    ('t/mm^3', 1000000000000.0)
    """

    name: str
    length: float
    mass: float
    time: float
    symbols: Mapping[str, str] = field(hash=False)

    def symbol(self, dimension: str | None) -> str:
        """Return the unit of a dimension; empty for pure numbers, which have None. StvkError for an unknown dimension."""
        if dimension is None:
            return ""
        known = choice("dimension", dimension, DIMENSIONS, StvkError)
        return self.symbols[known] if known in self.symbols else COMPOSED[known].format(**self.symbols)

    def factor(self, dimension: str | None) -> float:
        """Return the unit of a dimension in SI units; 1 for pure numbers. StvkError for an unknown dimension."""
        if dimension is None:
            return 1.0
        l, m, t = DIMENSIONS[choice("dimension", dimension, DIMENSIONS, StvkError)]
        return _clean(self.length**l * self.mass**m * self.time**t)


def _clean(factor: float) -> float:
    """Return a power of ten without the rounding of its factors."""
    exponent = round(np.log10(factor))
    power = float(f"1e{exponent}")
    return power if abs(factor / power - 1) < 1e-12 else factor


def _system(name: str, base: tuple[float, float, float], symbols: str) -> UnitSystem:
    names = ("length", "mass", "time", "force", "stress", "energy", "frequency")
    return UnitSystem(name, *base, dict(zip(names, symbols.split(), strict=True)))


#: Standard weight of a pound [N].
POUND_FORCE = 0.45359237 * 9.80665
#: The systems of units by name.
UNITS = {
    system.name: system
    for system in (
        _system("SI", (1.0, 1.0, 1.0), "m kg s N Pa J Hz"),
        _system("mm-N-MPa", (1e-3, 1e3, 1.0), "mm t s N MPa mJ Hz"),
        _system("mm-kg-ms", (1e-3, 1.0, 1e-3), "mm kg ms kN GPa J kHz"),
        _system("mm-g-ms", (1e-3, 1e-3, 1e-3), "mm g ms N MPa mJ kHz"),
        _system("cm-g-s", (1e-2, 1e-3, 1.0), "cm g s dyn Ba erg Hz"),
        _system("um-kg-s", (1e-6, 1.0, 1.0), "um kg s uN MPa pJ Hz"),
        _system("in-lbf-s", (0.0254, POUND_FORCE / 0.0254, 1.0), "in slinch s lbf psi in*lbf Hz"),
    )
}


@dataclass(frozen=True)
class UsualRange:
    """Usual range of the values of a kind, from `low` to `high` in SI units, and the units that are often mistaken for theirs."""

    dimension: str
    low: float
    high: float
    mistaken: tuple[tuple[str, float], ...] = ()

    def holds(self, value: float) -> bool:
        """Return whether a value in SI units is usual."""
        return self.low <= value <= self.high


STIFFNESS = UsualRange("stress", 500.0, 2e12, (("GPa", 1e9), ("MPa", 1e6), ("Pa", 1.0)))
SIZE = UsualRange("length", 1e-7, 200.0, (("mm", 1e-3), ("um", 1e-6), ("m", 1.0)))
#: Usual values of keys: soft tissue, foam, rubber, wood, metals; from parts of a micrometre to bridges.
KEYS: dict[str, UsualRange] = {
    **dict.fromkeys(("young", "young_axial", "young_transverse", "shear", "shear_axial", "mu", "voigt"), STIFFNESS),
    **dict.fromkeys(("size", "length", "radius", "width"), SIZE),
    "density": UsualRange("density", 10.0, 3e4, (("g/cm^3", 1e3), ("kg/m^3", 1.0))),
    "g": UsualRange("acceleration", 0.1, 5e3, (("m/s^2", 1.0), ("mm/s^2", 1e-3))),
    "velocity": UsualRange("velocity", 1e-9, 2e4, (("m/s", 1.0), ("mm/s", 1e-3))),
    "thickness": UsualRange("length", 1e-9, 20.0, (("mm", 1e-3), ("um", 1e-6), ("m", 1.0))),
    "area": UsualRange("area", 1e-16, 1e3, (("mm^2", 1e-6), ("m^2", 1.0))),
    "force": UsualRange("force", 1e-12, 1e10, (("N", 1.0), ("kN", 1e3))),
    "until": UsualRange("time", 1e-10, 1e7, (("s", 1.0), ("ms", 1e-3))),
    "dt": UsualRange("time", 1e-15, 1e6, (("s", 1.0), ("ms", 1e-3))),
}
#: Loads per area are at most a small multiple of the largest stiffness.
LOADS = ("traction", "pressure")
#: Wave speeds sqrt(E/rho), from soft tissue to diamond [m/s]; and the lower limit for materials denser than stone [kg/m^3].
SLOWEST, FASTEST = 0.3, 3e4
HEAVY, SLOW_IN_HEAVY = 3e3, 50.0
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
    found = {path: text for path, name, dimension, value in values if (text := _unusual(units, path, name, dimension, value))}
    for path, material in _parts(sections, "materials"):
        if path + ".young" not in found and path + ".density" not in found and (text := _waves(units, path, material)):
            found[path] = text
    stiffest = max((value * units.factor("stress") for _, name, _, value in values if KEYS.get(name) is STIFFNESS), default=0.0)
    for path, name, dimension, value in values:
        if name in LOADS and 0 < stiffest < value * units.factor(dimension):
            symbol, largest = units.symbol(dimension), stiffest / units.factor(dimension)
            found[path] = (
                f"{path} = {_shown(value)} {symbol} exceeds the stiffness of the stiffest material, {largest:g} {symbol}, so no "
                "body can carry it. Check the units of both, and whether a force was entered as a force per area."
            )
    found |= _steps(sections)
    if mesh is not None and not any(path.startswith("mesh.") for path in found):
        size = float(np.ptp(mesh.bounds, axis=1).max())
        if text := _unusual(units, "the size of the mesh", "size", "length", size):
            found["mesh"] = f"{text} A file in other units can be scaled: mesh.scale."
    return list(found.values())


def _values(part: BaseModel, path: str = "") -> Iterator[tuple[str, str, str, float]]:
    """Yield path, key, dimension and size of the values that are set and have a dimension; for several numbers the largest."""
    for name, info in type(part).model_fields.items():
        if name not in part.model_fields_set:
            continue
        given, key_path = getattr(part, name), f"{path}.{name}" if path else name
        dimension = dimension_of(info)
        if dimension is not None and (size := _size(given)):
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


def _size(given: Any) -> float:
    """Return the absolute value of a number, or the largest of several; 0 for other values."""
    if isinstance(given, bool) or not isinstance(given, int | float | Sequence) or isinstance(given, str):
        return 0.0
    try:
        return float(np.max(np.abs(np.asarray(given, dtype=np.float64)), initial=0.0))
    except (TypeError, ValueError):  # tables, ragged rows
        return 0.0


def _unusual(units: UnitSystem, path: str, name: str, dimension: str, value: float) -> str:
    """Return the remark on a value; empty if it is usual."""
    usual = KEYS.get(name)
    if usual is None or usual.dimension != dimension or usual.holds(value * units.factor(dimension)):
        return ""
    factor, symbol = units.factor(dimension), units.symbol(dimension)
    text = f"{path} = {_shown(value)} {symbol} is unusual; usual are {usual.low / factor:g} to {usual.high / factor:g} {symbol}"
    candidates = [(unit, si) for unit, si in usual.mistaken if unit != symbol and usual.holds(value * si)]
    cause = (
        "" if not candidates else f": {_shown(value)} {candidates[0][0]} is {_shown(value * candidates[0][1] / factor)} {symbol}"
    )
    others = [one.name for one in UNITS.values() if one is not units and usual.holds(value * one.factor(dimension))]
    other = f" It would be usual with units = {_listed(others)}." if others else ""
    return f"{text}{cause}.{other}"


def _waves(units: UnitSystem, path: str, material: BaseModel) -> str:
    """Return the remark on stiffness and density that do not match; empty if they match."""
    young, density = getattr(material, "young", None), getattr(material, "density", None)
    if not _size(young) or not _size(density):
        return ""
    heavy = _size(density) * units.factor("density")
    speed = float(np.sqrt(_size(young) * units.factor("stress") / heavy))
    if SLOWEST <= speed <= FASTEST and not (heavy > HEAVY and speed < SLOW_IN_HEAVY):
        return ""
    stress, dense = units.symbol("stress"), units.symbol("density")
    return (
        f"{path}: young = {_shown(_size(young))} {stress} and density = {_shown(_size(density))} {dense} are inconsistent: the "
        f"speed of sound would be {speed:.3g} m/s. Check the units of both."
    )


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


def _shown(value: float) -> str:
    return f"{value:.6g}"


def _listed(names: Sequence[str]) -> str:
    quoted = [f'"{name}"' for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"
