"""Ledger: one column for each quantity, one row for each step; a mapping that can be written as a table and drawn as a picture."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array, real_array, shown, whole
from ...errors import StvkError, name_known
from ...results.complete_files import output_path, replacing
from ...units import UNITS, UnitSystem

FIRST_ROWS = 1024
ROWS_AT_ONCE = 10_000
#: Okabe and Ito's colours, which colour-blind readers can distinguish.
ENERGIES = {
    "kinetic_energy": "#D55E00",
    "strain_energy": "#E69F00",
    "potential_energy": "#0072B2",
    "external_work": "#009E73",
    "dissipated_work": "#CC79A7",
    "removed_energy": "#56B4E9",
    "total_energy": "#000000",
}
AXES = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
MOMENTA = {"linear_momentum": "kg m/s", "angular_momentum": "kg m^2/s"}
#: Largest number of points in a line: two for each pixel column that it crosses.
MOST_POINTS = 4000
Lines = list[tuple[str, str, str]]


class NoColumn(StvkError, KeyError):
    """Error for a column name that a ledger does not have."""

    __str__ = Exception.__str__


class Ledger(Mapping[str, Array]):
    """Mapping with one array per name and one value per step.

    Parameters
    ----------
    names
        Names of the columns, in order; the first is "time".
    rows
        (n, columns) initial rows.

    Attributes
    ----------
    names
        Names of the columns, a tuple.

    Raises
    ------
    StvkError
        if a name occurs twice, or the number of columns of `rows` is not the number of names.

    Examples
    --------
    >>> ledger = Ledger(["time", "kinetic_energy"])
    >>> ledger.append([0.0, 2.5])
    >>> ledger.append([0.1, 2.0])
    >>> ledger["kinetic_energy"], ledger.steps
    (array([2.5, 2. ]), 2)
    >>> ledger["kinetic"]
    Traceback (most recent call last):
    skfem_stvk.solvers.runs.ledger.NoColumn: The ledger has no column 'kinetic'; known: 'kinetic_energy', 'time'. Did you mean ...?
    """

    #: System of units of all values.
    units: UnitSystem = UNITS["SI"]

    def __init__(self, names: Sequence[str], rows: ArrayLike | None = None) -> None:
        if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
            raise StvkError(f"names = {shown(names)}; expected a list of names, 'time' first.")
        self.names = tuple(names)
        self._column = {name: number for number, name in enumerate(self.names)}
        if len(self._column) < len(self.names) or self.names[:1] != ("time",):
            raise StvkError(f"names = {shown(names)}; expected different names, 'time' first.")
        initial = np.empty((0, len(self.names))) if rows is None else real_array(rows)
        if initial is None or initial.ndim != 2 or initial.shape[1] != len(self.names):
            what = f"have shape {initial.shape}" if initial is not None else f"= {shown(rows)}"
            raise StvkError(f"rows {what}; expected (n, {len(self.names)}) numbers, one column for each name.")
        self.steps = len(initial)
        self._block = np.empty((max(FIRST_ROWS, self.steps), len(self.names)))
        self._block[: self.steps] = initial

    def append(self, values: Any) -> None:
        """Append a row: one number for each column, in their order.

        Raises
        ------
        StvkError
            if there are more numbers than columns, or fewer.
        """
        row = real_array(values)
        if row is None or row.shape != (len(self.names),):
            what = f"has {len(row)} values" if row is not None and row.ndim == 1 else f"= {shown(values)}"
            raise StvkError(f"values {what}; expected {len(self.names)} numbers, one for each of {', '.join(self.names)}.")
        if self.steps == len(self._block):
            self._block = np.concatenate([self._block, np.empty_like(self._block)])
        self._block[self.steps] = row
        self.steps += 1

    def replace_last(self, name: str, value: float) -> None:
        """Replace the number in a column of the last row."""
        self._block[self.steps - 1, self._column[name]] = value

    def truncate(self, steps: int) -> None:
        """Delete all but the first `steps` rows."""
        self.steps = whole("steps", steps, f"0 ... {self.steps}", 0, self.steps)

    def rows(self, first: int = 0) -> Array:
        """Return the rows (n, columns) from number `first` on, as a read-only view of the present rows."""
        view = self._block[whole("first", first, "the number of a row, from 0") : self.steps]
        view.flags.writeable = False
        return view

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write all rows to a .csv file with all digits: a line of names with units, `time [s]`, then one line per step.

        Raises
        ------
        StvkError
            if the file cannot be written.
        """
        path = output_path(path, ".csv")
        with replacing(path) as part, part.open("wb") as file:
            file.write(_lines([[f"{name} [{self.units.of(unit)}]" if (unit := unit_of(name)) else name for name in self.names]]))
            for first in range(0, self.steps, ROWS_AT_ONCE):
                file.write(_lines(self.rows(first)[:ROWS_AT_ONCE].tolist()))
        return path

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the energies, the closure error and the momenta over time.

        Return matplotlib's `Figure`, and write it to `path` if that is not None.

        Raises
        ------
        StvkError
            if there are fewer than two steps, or the path does not end in .png, .pdf or .svg or cannot be written.
        """
        if self.steps < 2:
            raise StvkError(f"The ledger has {self.steps} steps; expected at least 2 for a picture.")
        target = None if path is None else output_path(path, ".png", ".pdf", ".svg")
        return _draw(self, target)

    def __getitem__(self, name: str) -> Array:
        if not isinstance(name, str) or name not in self._column:
            known = name_known(name if isinstance(name, str) else "", self.names)
            raise NoColumn(f"The ledger has no column {shown(name)}; {known}")
        return self.rows()[:, self._column[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        times = f", t = {self['time'][0]:g} ... {self['time'][-1]:g}" if self.steps else ""
        return f"Ledger of {self.steps} steps{times}: {', '.join(self.names)}"


class LedgerFile:
    """Table of a ledger on disk, a .csv file that grows with the ledger by whole lines.

    The first `write` replaces an existing file. This also holds when a run is resumed, because its ledger contains all valid rows.
    """

    def __init__(self, path: str | os.PathLike[str], ledger: Ledger) -> None:
        self.path, self.ledger = output_path(path, ".csv"), ledger
        self._written = -1, -1  # rows and bytes, set in one assignment, so that an interrupt cannot separate them

    def write(self) -> None:
        """Append the new rows. If that fails, the file is restored, so it never contains a part of them."""
        rows, size = self._written
        as_it_was = self.path.is_file() and self.path.stat().st_size == size
        if as_it_was and rows <= self.ledger.steps:
            self._append(_lines(self.ledger.rows(rows).tolist()), size)
        else:
            self.ledger.save(self.path)
        self._written = self.ledger.steps, self.path.stat().st_size

    def _append(self, lines: bytes, size: int) -> None:
        try:
            with self.path.open("ab") as file:
                file.write(lines)
        except BaseException:
            with suppress(OSError):
                os.truncate(self.path, size)
            raise


def unit_of(name: str) -> str:
    """Return the unit of a column in SI; empty for a number.

    >>> unit_of("strain_energy StVK 0"), unit_of("angular_momentum_z"), unit_of("tip x"), unit_of("contact floor z")
    ('J', 'kg m^2/s', 'm', 'N')
    """
    if name in ENERGIES or name in ("closure_error", "friction_work") or name.startswith("strain_energy "):
        return "J"
    if name[-2:] in (" x", " y", " z"):
        return "N" if name[:-2].startswith(("reaction ", "contact ")) else "m"
    return "s" if name == "time" else MOMENTA.get(name[:-2], "")


def _lines(rows: Iterable[Iterable[Any]]) -> bytes:
    """Return the rows as lines of a table."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


class Panel(NamedTuple):
    """Panel with lines over time: the columns with their labels and colours, and the relative height of the panel."""

    label: str
    lines: Lines
    height: float


def _draw(ledger: Ledger, path: Path | None) -> Any:
    """Draw all panels; write them to `path` if it is not None."""
    units = ledger.units
    panels = [*energy_panels(ledger, units.of("J")), *_other_panels(ledger)]
    figure = draw(ledger, panels, f"time [{units.of('s')}]", interactive=path is None)
    if path is not None:
        figure.savefig(path, dpi=160)
    return figure


def draw(ledger: Mapping[str, Array], panels: Sequence[Panel], xlabel: str = "time [s]", *, interactive: bool = False) -> Any:
    """Draw the panels that have lines. `interactive`: use a figure that pyplot can show."""
    from ...results.matplotlib_plot import new_figure  # matplotlib is imported only when a picture is requested

    panels = [panel for panel in panels if panel.lines]
    figure = new_figure((7.5, 1.2 * sum(panel.height for panel in panels) + 0.8), interactive=interactive)
    heights = [panel.height for panel in panels]
    rows: list[Any] = list(figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
    for axes, panel in zip(rows, panels, strict=True):
        _fill(axes, panel, ledger)
    rows[-1].set_xlabel(xlabel)
    figure.align_ylabels()
    return figure


def energy_panels(ledger: Mapping[str, Array], unit: str = "J") -> list[Panel]:
    """Return the panels of energies that are not zero throughout, and of the closure error. Energies that do not exist show "-"."""
    energies = [
        (name, name.replace("_", " ") + ": -" * bool(np.isnan(ledger[name]).all()), colour)
        for name, colour in ENERGIES.items()
        if name in ledger and ledger[name].any()
    ]
    closure = [(name, "", "#000000") for name in ledger if name == "closure_error"]
    return [Panel(f"energy [{unit}]", energies, 2.6), Panel(f"closure\nerror [{unit}]", closure, 1.0)]


def _other_panels(ledger: Ledger) -> list[Panel]:
    """Return the panels of momenta, displacements of probes, and reactions."""
    panels, units = [], ledger.units
    for quantity, unit in MOMENTA.items():
        label = quantity.replace("_", "\n") + f" [{units.of(unit).replace('^2', '²')}]"
        panels.append(Panel(label, _along_axes(ledger, f"{quantity}_"), 1.2))
    probes = dict.fromkeys(name[:-2] for name in ledger if name[-2:] in (" x", " y", " z"))
    for probe in probes:
        unit = unit_of(f"{probe} x")
        label = f"{probe} [{units.of(unit)}]" if unit == "N" else f"displacement\nof {probe} [{units.of(unit)}]"
        panels.append(Panel(label, _along_axes(ledger, f"{probe} "), 1.2))
    return panels


def _along_axes(ledger: Mapping[str, Array], prefix: str) -> Lines:
    return [(prefix + axis, axis, colour) for axis, colour in AXES.items() if prefix + axis in ledger]


def _fill(axes: Any, panel: Panel, ledger: Mapping[str, Array]) -> None:
    for name, words, colour in panel.lines:
        total = name == "total_energy"
        axes.plot(*thinned(ledger["time"], ledger[name]), color=colour, lw=1.6 if total else 1.0, label=words)
    axes.set_ylabel(panel.label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.axhline(0, color="#c8c8c8", lw=0.6, zorder=0)
    if any(words for _, words, _ in panel.lines):
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """Return fewer points that draw the same line: the smallest and the largest value of each short interval."""
    if len(t) <= MOST_POINTS:
        return t, values
    edges = np.linspace(0, len(t), MOST_POINTS // 2 + 1).astype(np.int64)
    least, largest = (find.reduceat(values, edges[:-1]) for find in (np.minimum, np.maximum))
    return np.repeat(t[edges[:-1]], 2), np.column_stack([least, largest]).ravel()
