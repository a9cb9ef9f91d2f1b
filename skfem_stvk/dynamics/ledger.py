"""The books of a motion: where its energy is and where it went, and its momenta, one row a step."""

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

from ..arguments import Array, real_array, shown, whole
from ..errors import StvkError, name_known
from ..results.files import output_path, replacing
from ..system import System

FIRST_ROWS = 1024
ROWS_AT_ONCE = 10_000
#: The column of the number of elements that are inside out.
INSIDE_OUT = "inside_out"


class NoColumn(StvkError, KeyError):
    """A ledger has no column of this name."""

    __str__ = Exception.__str__


class Balance(NamedTuple):
    """What adds up [J].

        total_energy = kinetic + strain + potential
        closure_error = total_energy - total_energy at the first step - external work + dissipated work

    The closure error is energy that came from nowhere, or went: that of the time integrator, and round-off.
    """

    total_energy: float
    closure_error: float

    @classmethod
    def of(
        cls, kinetic: float, strain: float, potential: float, external: float, dissipated: float, first: float | None
    ) -> Balance:
        """Of energies now, works since the first step, and the total energy at that: None if it is this one."""
        total = kinetic + strain + potential
        return cls(total, 0.0 if first is None else total - first - external + dissipated)


def column_names(system: System, probes: Iterable[str] = (), reactions: Iterable[str] = ()) -> tuple[str, ...]:
    """The columns of a motion's ledger, in their order.

    ===================================  ====================================================================================
    `time`                               [s]
    `kinetic_energy`                     `1/2 v . M v` [J]
    `strain_energy`                      `W(u)` [J]; if there are several elastic terms, then `strain_energy StVK 0` and so on
                                         too, named as in `System.energies`
    `potential_energy`                   of the loads that have a potential [J]
    `external_work`                      done since the first step by those that have none, by prescribed motion and by what
                                         changes with time [J]
    `dissipated_work`                    lost to damping since the first step [J]
    `total_energy`, `closure_error`      see `Balance` [J]
    `inside_out`                         number of elements that were inside out or flat when that was looked at last: after
                                         every step of implicit integrators, every 20 of explicit ones, and at both ends
    `linear_momentum_x`, ...             [kg m/s]
    `angular_momentum_x`, ...            about the origin [kg m^2/s]; in the plane `_z` alone
    `A x`, `A y`, ...                    displacements of the probe `A` [m]
    `reaction B x`, ...                  force of supports and foundations at `B` at this moment, see `Run.reaction` [N]
    ===================================  ====================================================================================
    """
    axes = "xyz"[: system.mesh.d]
    terms = system.elastic_names
    return (
        "time",
        "kinetic_energy",
        "strain_energy",
        *(f"strain_energy {name}" for name in terms if len(terms) > 1),
        "potential_energy",
        "external_work",
        "dissipated_work",
        *Balance._fields,
        INSIDE_OUT,
        *(f"linear_momentum_{axis}" for axis in axes),
        *(f"angular_momentum_{axis}" for axis in {"xy": "z", "xyz": axes}.get(axes, "")),
        *(f"{probe} {axis}" for probe in probes for axis in axes),
        *(f"reaction {place} {axis}" for place in reactions for axis in axes),
    )


class Ledger(Mapping[str, Array]):
    """One array a name, one value a step.

    Parameters
    ----------
    names : of the columns, in order; the first is "time".
    rows : (n, columns) to begin with.

    Attributes
    ----------
    names : tuple of them.

    Raises
    ------
    StvkError
        if a name comes twice, or rows have another number of columns.

    >>> ledger = Ledger(["time", "kinetic_energy"])
    >>> ledger.append([0.0, 2.5])
    >>> ledger.append([0.1, 2.0])
    >>> ledger["kinetic_energy"], ledger.steps
    (array([2.5, 2. ]), 2)
    >>> ledger["kinetic"]
    Traceback (most recent call last):
    skfem_stvk.dynamics.ledger.NoColumn: The ledger has no column 'kinetic'; known: 'kinetic_energy', 'time'. Did you mean ...?
    """

    def __init__(self, names: Sequence[str], rows: ArrayLike | None = None) -> None:
        if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
            raise StvkError(f"names = {shown(names)}; expected a list of names, 'time' first.")
        self.names = tuple(names)
        self._column = {name: number for number, name in enumerate(self.names)}
        if len(self._column) < len(self.names) or self.names[:1] != ("time",):
            raise StvkError(f"names = {shown(names)}; expected different ones, 'time' first.")
        given = np.empty((0, len(self.names))) if rows is None else real_array(rows)
        if given is None or given.ndim != 2 or given.shape[1] != len(self.names):
            what = f"have shape {given.shape}" if given is not None else f"= {shown(rows)}"
            raise StvkError(f"rows {what}; expected (n, {len(self.names)}) numbers, one column for each name.")
        self.steps = len(given)
        self._block = np.empty((max(FIRST_ROWS, self.steps), len(self.names)))
        self._block[: self.steps] = given

    def append(self, values: Any) -> None:
        """Enter a step: one number for each column, in their order.

        Raises
        ------
        StvkError
            if there are more or less.
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
        """Put another number into a column of the last row."""
        self._block[self.steps - 1, self._column[name]] = value

    def truncate(self, steps: int) -> None:
        """Strike out all but the first `steps` rows."""
        self.steps = whole("steps", steps, f"0 ... {self.steps}", 0, self.steps)

    def rows(self, first: int = 0) -> Array:
        """(n, columns) rows from number `first` on, which cannot be written to; a view of what is there now."""
        view = self._block[whole("first", first, "the number of a row, from 0") : self.steps]
        view.flags.writeable = False
        return view

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write all as a table, a .csv file: a line of names, then a line a step, with all digits.

        Raises
        ------
        StvkError
            if it cannot be written.
        """
        path = output_path(path, ".csv")
        with replacing(path) as part, part.open("wb") as file:
            file.write(_lines([self.names]))
            for first in range(0, self.steps, ROWS_AT_ONCE):
                file.write(_lines(self.rows(first)[:ROWS_AT_ONCE].tolist()))
        return path

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the energies, the closure error and the momenta over time: matplotlib's `Figure`, written to `path` if there is one.

        Raises
        ------
        StvkError
            if there are less than two steps, or the path does not end in .png, .pdf or .svg or cannot be written.
        """
        if self.steps < 2:
            raise StvkError(f"There are lines to draw from two steps on; the ledger has {self.steps}.")
        target = None if path is None else output_path(path, ".png", ".pdf", ".svg")
        from .ledger_plot import draw

        return draw(self, target)

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
    """A ledger's table on disk, a .csv file that grows with it, by whole lines.

    The first `write` replaces what is there, also that of a run which is resumed: its ledger knows all rows that count.

    Parameters
    ----------
    path : of the .csv file, in a folder that exists.

    Raises
    ------
    StvkError
        if it cannot be written, before any work.
    """

    def __init__(self, path: str | os.PathLike[str], ledger: Ledger) -> None:
        self.path, self.ledger = output_path(path, ".csv"), ledger
        self._written = -1, -1  # rows and bytes, both at once: whatever interrupts it, they are of the same file

    def write(self) -> None:
        """Add the rows that are new.

        Raises
        ------
        OSError
            if the disk is full, for example; the lines that were there are still there, and no part of a line.
        """
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


def _lines(rows: Iterable[Iterable[Any]]) -> bytes:
    """Rows as lines of a table."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
