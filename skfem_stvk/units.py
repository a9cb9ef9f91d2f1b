"""Systems of units: names and factors, and the question whether stiffnesses are in other ones."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
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


#: Usual Young's moduli, from soft tissue to diamond [Pa], and the weight per volume of a light solid, that of wood [N/m^3].
SOFTEST, STIFFEST, LIGHTEST = 500.0, 2e12, 5e3


def implausible_moduli(moduli: Mapping[str, Any], units: UnitSystem, size: float = 0.0) -> list[str]:
    """Return, in a sentence each, the Young's moduli, by name, that are implausible in these units.

    A body of the largest extent `size` is expected to carry its own weight.

    Examples
    --------
    >>> print(*implausible_moduli({"steel: young": 2.1e5}, UNITS["SI"], size=100.0))
    steel: young = 210000 Pa is unusual for a body of 100 m; usual are 500000 to 2e+12 Pa. It would be usual with
    units = "mm-N-MPa", "mm-g-ms", "cm-g-s", "um-kg-s", "in-lbf-s".
    """

    def usual(units: UnitSystem) -> tuple[float, float]:
        stress = units.factor("stress")
        return max(SOFTEST, LIGHTEST * size * units.factor("length")) / stress, STIFFEST / stress

    (low, high), symbol, found = usual(units), units.symbol("stress"), []
    body = f" for a body of {size:.6g} {units.symbol('length')}" if size else ""
    for name, young in moduli.items():
        E = 0.0 if young is None else float(np.max(np.abs(young), initial=0.0))
        if E == 0 or low <= E <= high:
            continue
        others = ", ".join(f'"{one.name}"' for one in UNITS.values() if usual(one)[0] <= E <= usual(one)[1])
        other = f" It would be usual with units = {others}." if others else ""
        found.append(f"{name} = {E:.6g} {symbol} is unusual{body}; usual are {low:g} to {high:g} {symbol}.{other}")
    return found


def remarks(body: Any) -> str:
    """Return the lines of `System.implausible` for the header of a run; empty if there are none."""
    return "".join(f"\nnote: {text}" for text in body.implausible())
