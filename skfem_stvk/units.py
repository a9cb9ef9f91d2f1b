"""Systems of units, and the check for values that are implausible in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .arguments import choice
from .errors import StvkError

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
#: Pattern of a symbol of SI with its power.
SYMBOL = r"(?:kg|m|s|N|Pa|J)(?:\^\d)?"


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

    def of(self, unit: str) -> str:
        """Return a unit of SI as it is in this system.

        >>> UNITS["mm-N-MPa"].of("kg m/s"), UNITS["SI"].of("N m")
        ('t mm/s', 'N m')
        """
        dimensions = {symbol: dimension for dimension, symbol in UNITS["SI"].symbols.items()}
        return re.sub("|".join(sorted(dimensions, key=len, reverse=True)), lambda one: self.symbols[dimensions[one[0]]], unit)

    def text(self, sentence: str) -> str:
        """Return a sentence whose units, after numbers or in brackets, are those of this system; numbers stay.

        >>> UNITS["mm-kg-ms"].text("t = 3 s: a step of 1e-05 s is below 2 steps, 0.1 m in 5 parts; density=... [kg/m^3]")
        't = 3 ms: a step of 1e-05 ms is below 2 steps, 0.1 mm in 5 parts; density=... [kg/mm^3]'
        """
        return re.sub(rf"(?<=\d )(?:s|m|N|Pa|J)(?![\w/^])|\[{SYMBOL}(?:[ /]{SYMBOL})*\]", lambda one: self.of(one[0]), sentence)

    @contextmanager
    def of_errors(self) -> Iterator[None]:
        """Give the messages of errors of the package that are raised within the units of this system."""
        try:
            yield
        except StvkError as error:
            error.args = (self.text(str(error)), *error.args[1:])
            raise

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
#: Wave speeds sqrt(E/rho), from soft tissue to diamond [m/s]; and the lower limit for materials denser than stone [kg/m^3].
SLOWEST, FASTEST = 0.3, 3e4
HEAVY, SLOW_IN_HEAVY = 3e3, 50.0
#: Weight per volume of a light solid, that of wood [N/m^3].
LIGHTEST = 5e3


def questions(units: UnitSystem, size: float, materials: Iterable[tuple[str, Any]]) -> dict[str, str]:
    """Return the values of a body that are implausible in these units, in a sentence each, by their name.

    Parameters
    ----------
    units
        System of units of all values.
    size
        Largest extent of the body.
    materials
        Materials by name, with `young` and `density`, if they have them.

    Examples
    --------
    >>> from skfem_stvk import Isotropic
    >>> steel = Isotropic(young=2.1e5, poisson=0.3)
    >>> print(questions(UNITS["SI"], 100.0, [("steel", steel)])["steel"])
    steel: young = 210000 Pa is too soft for a body of 100 m, which would collapse under its own weight. Millimetres and MPa?
    Then units = "mm-N-MPa".
    """
    found = {"size": text} if (text := unusual(units, "the size of the mesh", "size", "length", size)) else {}
    for path, material in materials:
        for name in ("young", "density"):
            value = size_of(getattr(material, name, None))
            if value and (text := unusual(units, f"{path}.{name}", name, KEYS[name].dimension, value)):
                found[f"{path}.{name}"] = text
        text = waves(units, path, material) or too_soft(units, path, material, size)
        if text and f"{path}.young" not in found and f"{path}.density" not in found:
            found[path] = text
    return found


def too_soft(units: UnitSystem, path: str, material: Any, size: float) -> str:
    """Return the remark on a stiffness that is below the pressure of the body's own weight, if other units would explain it."""
    young, mm = size_of(getattr(material, "young", None)), UNITS["mm-N-MPa"]
    if not young or units is not UNITS["SI"] or young > LIGHTEST * size:
        return ""
    if not STIFFNESS.holds(young * mm.factor("stress")) or young * mm.factor("stress") < LIGHTEST * size * mm.length:
        return ""
    return (
        f"{path}: young = {_shown(young)} Pa is too soft for a body of {_shown(size)} m, which would collapse under its own "
        f'weight. Millimetres and MPa? Then units = "{mm.name}".'
    )


def remarks(body: Any) -> str:
    """Return lines with the values of a `System` that are implausible in its units, for the header of a run; empty if none."""
    return "" if body.remarked else "".join(f"\nnote: {text}" for text in body.implausible())


def unusual(units: UnitSystem, path: str, name: str, dimension: str, value: float) -> str:
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


def waves(units: UnitSystem, path: str, material: Any) -> str:
    """Return the remark on stiffness and density that do not match; empty if they match."""
    young, density = getattr(material, "young", None), getattr(material, "density", None)
    if not size_of(young) or not size_of(density):
        return ""
    heavy = size_of(density) * units.factor("density")
    speed = float(np.sqrt(size_of(young) * units.factor("stress") / heavy))
    if SLOWEST <= speed <= FASTEST and not (heavy > HEAVY and speed < SLOW_IN_HEAVY):
        return ""
    stress, dense = units.symbol("stress"), units.symbol("density")
    return (
        f"{path}: young = {_shown(size_of(young))} {stress} and density = {_shown(size_of(density))} {dense} are inconsistent: the "
        f"speed of sound would be {speed:.3g} m/s. Check the units of both."
    )


def size_of(given: Any) -> float:
    """Return the absolute value of a number, or the largest of several; 0 for other values."""
    if isinstance(given, bool) or not isinstance(given, int | float | Sequence | np.ndarray) or isinstance(given, str):
        return 0.0
    try:
        return float(np.max(np.abs(np.asarray(given, dtype=np.float64)), initial=0.0))
    except (TypeError, ValueError):  # tables, ragged rows
        return 0.0


def _shown(value: float) -> str:
    return f"{value:.6g}"


def _listed(names: Sequence[str]) -> str:
    quoted = [f'"{name}"' for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"
