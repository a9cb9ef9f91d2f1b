"""What came of the runs of a sweep: a row for each, the table of all, and a plot of their results."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from ..results.files import replacing
from .build import expectations
from .folder import Folder
from .outcome import DONE, NOT_AS_EXPECTED
from .report import DOTS_PER_INCH, RESULTS
from .schema import SceneTables
from .source import Axis
from .syntax import Loc
from .units import UNITS

TABLE, PLOT = "table.csv", "sweep.png"
#: Columns between the values and the results.
COLUMNS = ("status", "exit_code", "seconds", "folder", "message")
#: Results, and lines of each, that a plot holds at most.
MOST_PANELS, MOST_LINES = 6, 10
#: From this quotient of the largest value and the smallest on the abscissa is logarithmic.
WIDE = 30
#: Parts of the largest component below which values are the same, and below which a component is zero.
SAME, ZERO = 1e-9, 1e-6
#: Results that say how a run went rather than what came of it.
COUNTED = ("steps", "load", "time", "modes.rigid", "modes.unstable")


@dataclass(frozen=True)
class SweepRow:
    """What came of one run of a sweep.

    Attributes
    ----------
    values : of the keys that were swept.
    status, message : how it came out, in a word, and what failed; the message of a run that is done is empty.
    exit_code : as of `skfem-stvk solve`; None if its process crashed.
    seconds : that it took.
    folder : where its results are.
    results : by dotted name, such as `energy.strain`.
    """

    values: dict[str, Any]
    folder: Path
    status: str
    exit_code: int | None = None
    seconds: float | None = None
    message: str = ""
    results: dict[str, float] = field(default_factory=dict)

    @property
    def done(self) -> bool:
        """Whether it converged, and all is as expected."""
        return self.exit_code == DONE


def in_short(value: Any) -> str:
    """A value in few characters: numbers as a person writes them, lists without brackets.

    >>> in_short(1e9), in_short(0.25), in_short([0.0, 0.0, -9.81]), in_short(True)
    ('1e9', '0.25', '0_0_-9.81', 'true')
    """
    if isinstance(value, Mapping):
        return "_".join(f"{name}_{in_short(one)}" for name, one in value.items())
    if isinstance(value, list | tuple):
        return "_".join(map(in_short, value))
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, float):
        return str(value)
    text = f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return re.sub(r"e\+?(-?)0*", r"e\1", text)


class RunFailure(NamedTuple):
    """Why there is no summary of a run."""

    status: str
    exit_code: int | None
    message: str


def row_of(values: dict[str, Any], path: Path, error: RunFailure | None = None) -> SweepRow:
    """What the folder of a run says of it, or what went wrong."""
    if error is not None:
        return SweepRow(values, path, error.status, error.exit_code, message=error.message)
    said = Folder(path).summary()
    code, message = said.get("exit_code"), str(said.get("message", ""))
    if code == NOT_AS_EXPECTED:
        failed = [one for one in said["expectations"] if not one["passed"]]
        message = "; ".join(f"{one['name']} = {one['got']:.9g}, expected {one['expected']:.9g}" for one in failed)
    results = {name: float(value) for name, value in said.get("results", {}).items()}
    return SweepRow(values, path, said["status"], code, said.get("seconds"), "" if code == DONE else message, results)


def in_a_line(row: SweepRow) -> str:
    took = "" if row.seconds is None else f" in {row.seconds:.3g} s"
    return f"{row.folder.name}: {row.status}{took}" + (f": {row.message}" if row.message else "")


class SweepTable:
    """The table on the disk: rows of runs that ended, in the order of the product."""

    def __init__(self, folder: Path, keys: Sequence[str], names: Sequence[str], rows: dict[str, SweepRow]) -> None:
        self._path, self._keys, self._order, self._rows = folder / TABLE, keys, names, rows
        self.write()

    def add(self, row: SweepRow) -> None:
        """Take a row in, and write the table anew."""
        self._rows[row.folder.name] = row
        self.write()

    def write(self) -> None:
        """Write all rows there are."""
        rows = [self._rows[name] for name in self._order if name in self._rows]
        results = list(dict.fromkeys(name for row in rows for name in row.results))
        with replacing(self._path) as part, part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([*self._keys, *COLUMNS, *results])
            for row in rows:
                said = row.status, row.exit_code, row.seconds, row.folder.name, row.message
                values = (one if isinstance(one, str | int | float) else json.dumps(one) for one in row.values.values())
                writer.writerow([*values, *said, *(row.results.get(name) for name in results)])


def draw(folder: Path, axes: Sequence[Axis], rows: Sequence[SweepRow], sections: SceneTables) -> str:
    """Draw results of a sweep (rows with values, results and an exit code) against its first number; why not, if that fails.

    If no number was swept, or there are not two runs with results, there is no plot, and an old one is removed.
    """
    (folder / PLOT).unlink(missing_ok=True)
    rows = [row for row in rows if row.exit_code in (DONE, NOT_AS_EXPECTED)]
    axis = next((one for one in axes if one.of_numbers), None)
    names = list(_worth_drawing(rows, sections))[:MOST_PANELS]
    if axis is None or not names or len({row.values[axis.path] for row in rows}) < 2:
        return ""
    try:
        figure = _drawn(axis, [one for one in axes if one is not axis], rows, names, sections)
        with replacing(folder / PLOT) as part:
            figure.savefig(part, format="png", dpi=DOTS_PER_INCH, bbox_inches="tight")
    except Exception as error:  # matplotlib fails in many ways, and the table matters more
        return str(error)
    return ""


def _worth_drawing(rows: Sequence[SweepRow], sections: SceneTables) -> Iterator[str]:
    """Names of results: what is expected, then probes, reactions, frequencies and critical points, else all that differ."""
    found = list(dict.fromkeys(name for row in rows for name in row.results))
    expected = [name for name in (".".join(loc) for loc in expectations(sections.expect)) if name in found]
    yield from expected
    others = [name for name in found if name not in expected and name not in COUNTED and _differs(name, rows)]
    followed = (*sections.output.probes, *sections.output.reactions, "frequency", "critical")
    asked = [name for name in others if name.startswith(tuple(f"{one}." for one in followed))]
    yield from asked or ([] if expected else others)


def _differs(name: str, rows: Sequence[SweepRow]) -> bool:
    """Whether a result differs from run to run, and is not only the rounding of one that is zero beside its other components."""
    values = [row.results[name] for row in rows if name in row.results]
    family = name.partition(".")[0] + "."
    largest = max(abs(value) for row in rows for other, value in row.results.items() if other.startswith(family) or other == name)
    return max(values) - min(values) > SAME * largest and max(map(abs, values)) > ZERO * largest


def _drawn(axis: Axis, others: Sequence[Axis], rows: Sequence[SweepRow], names: Sequence[str], sections: SceneTables) -> Any:
    """A panel for each result; a line in it for each combination of the other values."""
    from ..results.matplotlib_plot import new_figure  # matplotlib is imported only when something is drawn

    lines: dict[str, list[SweepRow]] = {}
    for row in sorted(rows, key=lambda row: row.values[axis.path]):
        label = ", ".join(f"{one.loc[-1]} = {in_short(row.values[one.path])}" for one in others if len(one.values) > 1)
        lines.setdefault(label, []).append(row)
    columns = min(len(names), 2)
    high = -(-len(names) // columns)
    figure = new_figure((1.5 + 4.0 * columns, 0.6 + 2.6 * high), interactive=False)
    panels = list(figure.subplots(high, columns, squeeze=False).flat)
    for panel, name in zip(panels, names, strict=False):
        for label, of_it in list(lines.items())[:MOST_LINES]:
            held = [row for row in of_it if name in row.results]
            panel.plot([row.values[axis.path] for row in held], [row.results[name] for row in held], ".-", lw=1.2, label=label)
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_ylabel(_with_unit(name, _dimension_of_result(sections, name), sections))
        panel.set_xlabel(_with_unit(axis.path, _dimension(sections, axis.loc), sections))
        if min(axis.values) > 0 and max(axis.values) >= WIDE * min(axis.values):
            panel.set_xscale("log")
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    if len(lines) > 1:
        shown, hidden = panels[0].get_legend_handles_labels(), len(lines) - MOST_LINES
        title = f"{hidden} more are in the table" if hidden > 0 else None
        figure.legend(*shown, title=title, fontsize=9, title_fontsize=9, frameon=False, loc="outside right center")
    return figure


def _with_unit(name: str, dimension: str | None, sections: SceneTables) -> str:
    return f"{name} [{UNITS[sections.units].symbol(dimension)}]" if dimension else name


def _dimension_of_result(sections: SceneTables, name: str) -> str | None:
    first = name.partition(".")[0]
    if first in sections.output.probes:
        return "length"
    return "force" if first in sections.output.reactions else RESULTS.get(first)


def _dimension(sections: SceneTables, loc: Loc) -> str | None:
    """The dimension of a key; None if it has none."""
    at: Any = sections
    dimension = None
    for one in loc:
        if isinstance(at, BaseModel):
            extra = type(at).model_fields[str(one)].json_schema_extra
            dimension = extra.get("dimension") if isinstance(extra, dict) else None
            at = getattr(at, str(one))
        else:
            at = at[one]
    return dimension if isinstance(dimension, str) else None
