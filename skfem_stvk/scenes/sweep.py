"""Many runs of a scene with different values, in processes; the results are a folder for each run, a table and a plot."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel

from ..arguments import path as checked_path
from ..arguments import shown, whole
from ..errors import AnalysisError, SceneError, StvkError, log
from ..kernels.threads import threads
from ..results.complete_files import OneWriter, content_of, replacing
from ..solvers.newton.processes import Crashed, in_processes, is_worker_process
from ..terminal import BAD_INPUT, DONE, INTERRUPTED, NOT_AS_EXPECTED, NOT_PASSED, console, printable
from ..units import UNITS
from .build import contacts_of, expectations
from .folder import CHECKPOINT, SUMMARY, Folder, hash_of, make, names_with, visible
from .scene import Scene
from .scene_outcome import as_printed
from .scene_report import DOTS_PER_INCH, RESULTS
from .schema import SceneTables
from .schema.quantities import dimension_of
from .source import Axis, SceneSource, axes_of, refuse_all
from .syntax import Loc

TABLE, PLOT = "table.csv", "sweep.png"
#: Columns between the values and the results.
COLUMNS = ("status", "exit_code", "seconds", "folder", "message")
#: Exit codes of runs that reached their end: they are solved again only with `force`.
ENDED = (DONE, NOT_PASSED, NOT_AS_EXPECTED)
#: Maximum number of runs of one sweep: each has a folder and a line of the table.
MOST_RUNS = 10_000
#: Maximum length of the name of a folder; longer names are cut.
LONGEST = 120
#: Maximum number of results in a plot, and of lines for each.
MOST_PANELS, MOST_LINES = 6, 10
#: Ratio of the largest to the smallest value from which the abscissa is logarithmic.
LOGARITHMIC = 30
#: Fractions of the largest component below which two values are equal, and below which a component is zero.
SAME, ZERO = 1e-9, 1e-6
#: Bytes of the largest table that is read.
LARGEST_TABLE = 100_000_000
#: Results about the course of a run, not its outcome.
COUNTED = ("steps", "load", "time", "modes.rigid", "modes.unstable")


@dataclass(frozen=True)
class SweepRow:
    """Outcome of one run of a sweep.

    Attributes
    ----------
    values
        Values of the swept keys.
    status, message
        Status of the run in a word, and the error; the message of a run that is done is empty.
    exit_code
        Exit code of `skfem-stvk solve`; None if its process crashed.
    seconds
        Duration of the run.
    folder
        Folder of its results.
    results
        Results by dotted name, such as `energy.strain`.
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
        """Whether the run converged, and all expectations hold."""
        return self.exit_code == DONE


def sweep(
    path: str | os.PathLike[str],
    settings: Mapping[str, Iterable[Any]] | Sequence[str],
    out: str | os.PathLike[str] | None = None,
    *,
    jobs: int | None = None,
    force: bool = False,
    quiet: bool = False,
) -> list[SweepRow]:
    """Solve a scene with the product of values, several runs at a time, each in a process; runs that are done are not repeated.

    Runs that fail, or whose process crashes, do not stop the others. A run that was killed or interrupted continues from its
    checkpoint if it has one. Programs call this under `if __name__ == "__main__":`, because each process imports them again.

    Parameters
    ----------
    path
        Path of the scene file.
    settings
        Values by key, {"materials.steel.young": [1e9, 2e9]}, or texts such as "materials.steel.young=1e9,2e9".
    out
        Folder of table.csv, sweep.png and a folder for each run; by default next to the scene, named `SCENE-sweep`.
    jobs
        Number of runs at a time, by default one for each core; their kernels share the cores.
    force
        Replace runs in `out` that belong to another scene, and solve failed runs again.
    quiet
        Print nothing.

    Returns
    -------
    list of SweepRow
        Rows in the order of the product; the last key changes fastest.

    Raises
    ------
    SceneError
        with all faults in any of the scenes, before anything runs.
    StvkError
        if the folder holds runs of another scene, or other files, or is not writable.
    KeyboardInterrupt
        after Ctrl-C, when runs have ended after their current step and the table is written; at once after a second one.
    """
    if is_worker_process():
        raise StvkError('sweep() was called in a worker process of a sweep. Call it only under `if __name__ == "__main__":`.')
    axes, runs = planned(path, settings)
    sections, default_folder = runs[0].scene.sections, runs[0].scene.folder_of_results
    folder = (
        default_folder.with_name(f"{default_folder.name}-sweep")
        if out is None
        else checked_path("out", out, "the path of a folder")
    )
    cores, threads_per_run = threads(), max((run.scene.sections.threads or 1 for run in runs), default=1)
    jobs = cores if jobs is None else whole("jobs", jobs, "a number of simultaneous runs, from 1", least=1)
    terminal = console(quiet=quiet)

    def tell(line: str, mark: str = "") -> None:
        terminal.print(mark + printable(line), soft_wrap=True)
        log(line)

    _open(folder)
    with OneWriter(folder):
        start = _start_of_each(folder, runs, force)
        rows = {run.name: _row(run, folder) for run in runs if start[run.name] is None}
        table = _Table(folder, runs, rows)
        missing = [run for run in runs if start[run.name] is not None]
        jobs = max(1, min(jobs, cores // threads_per_run, len(missing)))
        threads_per_run = max(threads_per_run, cores // jobs)
        finished = f", {len(rows)} of them already done" if rows else ""
        suffix = f"; {jobs} at a time on {threads_per_run} thread{'s' * (threads_per_run > 1)} each" if missing else ""
        tell(f"{len(runs)} runs{finished}{suffix}")
        for text, count in Counter(text for run in missing for text in run.scene.sections.implausible()).items():
            suffix = f" (in {count} of {len(missing)} runs)" if count < len(missing) else ""
            tell(f"{text}{suffix}", "[yellow]note[/] ")
        tasks = {_Task(Path(path), run.settings, folder / run.name, start[run.name] or "new"): run for run in missing}
        try:
            for task, failure in in_processes(_solve, deque(tasks), jobs, threads_per_run):
                row = _row(tasks[task], folder, _crashed(task) if isinstance(failure, Crashed) else failure)
                table.add(row)
                tell(f"[{len(rows)}/{len(runs)}] {in_a_line(row)}")
        except KeyboardInterrupt:
            tell(f"{len(rows)} of {len(runs)} runs are in {folder / TABLE}; run the same command again for the rest")
            raise
        plot_error = _plot(folder, axes, list(rows.values()), sections)
        if plot_error:
            tell(f"{PLOT} is not drawn: {plot_error}", "[yellow]note[/] ")
        return [rows[run.name] for run in runs]


# the scenes of a sweep and their names


class PlannedRun(NamedTuple):
    """One scene of a sweep: its values, its settings, and the name of its folder."""

    values: dict[str, Any]
    settings: tuple[str, ...]
    name: str
    scene: Scene


def planned(
    path: str | os.PathLike[str], settings: Mapping[str, Iterable[Any]] | Sequence[str]
) -> tuple[list[Axis], list[PlannedRun]]:
    """Return the axes of a sweep, and the product of their values, the last axis fastest. Every scene is checked.

    Raises
    ------
    SceneError
        with all faults in the scene, in the settings and in any of the scenes, each once; or if two scenes are equal.
    """
    axes = axes_of(settings)
    if (count := prod(len(axis.values) for axis in axes)) > MOST_RUNS:
        raise SceneError(f"The sweep has {count} runs; expected at most {MOST_RUNS}. Give fewer values, or make several sweeps.")
    source = SceneSource.read(checked_path("path", path, "the path of a scene file such as 'thrown.toml'"))
    combinations = list(product(*(range(len(axis.values)) for axis in axes)))
    wrong: Counter[str] = Counter()
    scenes: list[Scene] = []
    for numbers in combinations:
        try:
            scenes.append(Scene.read(path, _settings(axes, numbers)))
        except SceneError as error:
            wrong.update(_messages(error, source.name))
    refuse_all([text + (f" (in {times} of {count} runs)" if times < count else "") for text, times in wrong.items()], source.name)
    names = _names(axes, combinations)
    first: dict[str, int] = {}
    twice = []
    for number, (name, scene) in enumerate(zip(names, scenes, strict=True)):
        other = first.setdefault(hash_of(scene.data), number)
        if other != number:
            twice.append(f"runs {other} ({names[other]}) and {number} ({name}) are the same scene; give each value once")
    refuse_all(twice, source.name)
    values = [{axis.path: axis.values[k] for axis, k in zip(axes, numbers, strict=True)} for numbers in combinations]
    texts = [_settings(axes, numbers) for numbers in combinations]
    return axes, [PlannedRun(*one) for one in zip(values, texts, names, scenes, strict=True)]


def _settings(axes: Sequence[Axis], numbers: Sequence[int]) -> tuple[str, ...]:
    return tuple(f"{axis.path}={axis.texts[k]}" for axis, k in zip(axes, numbers, strict=True))


def _messages(error: SceneError, name: str) -> list[str]:
    """Return the complaints of a scene's error."""
    head, *complaints = str(error).split("\n  ")
    return complaints or [head.removeprefix(f"{name}: ")]


def _names(axes: Sequence[Axis], combinations: Sequence[Sequence[int]]) -> list[str]:
    """Return a name for each run that file systems accept, made from the last names of its keys and its values.

    Names that would be equal, or that are cut, end with a hash of their values.
    """
    short_keys = [_plain(_dotted(_last(axis.loc))) for axis in axes]
    keys = [one if short_keys.count(one) == 1 else _plain(_dotted(axis.loc)) for one, axis in zip(short_keys, axes, strict=True)]
    names_in_full = [
        ",".join(f"{key}={_plain(value_in_name(axis.values[k]))}" for key, axis, k in zip(keys, axes, numbers, strict=True))
        for numbers in combinations
    ]
    times = Counter(name.lower() for name in names_in_full)  # some file systems ignore case
    names = []
    for name, numbers in zip(names_in_full, combinations, strict=True):
        if times[name.lower()] > 1 or len(name) > LONGEST:
            hashed = hashlib.sha256(repr(_settings(axes, numbers)).encode()).hexdigest()[:8]
            name = f"{name[: LONGEST - 9]}-{hashed}"
        names.append(name)
    return names


def _last(loc: Loc) -> Loc:
    """Return the last name in a key path, with the indices after it."""
    return loc[max(depth for depth, one in enumerate(loc) if isinstance(one, str)) :]


def _dotted(loc: Loc) -> str:
    return ".".join(map(str, loc))


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", text)


def value_in_name(value: Any) -> str:
    """Return a value in few characters: numbers as a person writes them, lists without brackets.

    >>> value_in_name(1e9), value_in_name(0.25), value_in_name([0.0, 0.0, -9.81]), value_in_name(True)
    ('1e9', '0.25', '0_0_-9.81', 'true')
    """
    if isinstance(value, Mapping):
        return "_".join(f"{name}_{value_in_name(one)}" for name, one in value.items())
    if isinstance(value, list | tuple):
        return "_".join(map(value_in_name, value))
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, float):
        return str(value)
    text = f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return re.sub(r"e\+?(-?)0*", r"e\1", text)


# earlier results


def _open(folder: Path) -> None:
    """Make the folder; refuse one that holds anything other than a sweep."""
    if names_with(folder, TABLE, "a sweep"):
        try:
            lines = content_of(folder / TABLE, LARGEST_TABLE).decode(errors="replace").splitlines()
            head = next(csv.reader(lines), [])
        except (OSError, csv.Error) as error:
            raise StvkError(f"--out {folder}: its {TABLE} cannot be read ({error}). Choose another folder.") from error
        if not set(COLUMNS) <= set(head):
            raise StvkError(
                f"--out {folder}: its {TABLE} is not the table of a sweep: its columns are {shown(head)}. Choose another folder."
            )
    make(folder)


def _start_of_each(folder: Path, runs: Sequence[PlannedRun], force: bool) -> dict[str, str | None]:
    """Return by run how it starts: "new", with "force", or with "resume"; None if it is done."""
    start: dict[str, str | None] = {}
    other_scene, foreign = [], []
    for run in runs:
        path = folder / run.name
        names = visible(path)
        if not names:
            start[run.name] = "new"
        elif SUMMARY not in names:
            foreign.append(run.name)
        elif (summary := Folder(path).summary()).get("scene_hash") != run.scene.hash:
            start[run.name] = "force"
            other_scene.append(run.name)
        elif summary.get("exit_code") in ENDED:
            start[run.name] = None if summary["exit_code"] == DONE or not force else "force"
        else:
            resumable = run.scene.sections.analysis.type != "modes" and any((path / CHECKPOINT).glob("*.npz"))
            start[run.name] = "resume" if resumable else "force"
    if foreign:
        raise StvkError(f"{folder}: {_counted(foreign)} have files other than results. Move them away, or choose another --out.")
    if other_scene and not force:
        raise StvkError(
            f"{folder}: {_counted(other_scene)} belong to another scene, or the scene has changed. --force replaces them, --out "
            "selects another folder."
        )
    return start


def _counted(names: Sequence[str]) -> str:
    return f"{len(names)} runs ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"


# rows of runs


class _Failure(NamedTuple):
    """Reason why a run has no summary."""

    status: str
    exit_code: int | None
    message: str


def _row(run: PlannedRun, folder: Path, error: _Failure | None = None) -> SweepRow:
    """Return the row of a run from its folder, or with its error."""
    path = folder / run.name
    if error is not None:
        return SweepRow(run.values, path, error.status, error.exit_code, message=error.message)
    summary = Folder(path).summary()
    code, message = summary.get("exit_code"), str(summary.get("message", ""))
    if code == NOT_AS_EXPECTED:
        failed = [one for one in summary["expectations"] if not one.passed]
        message = "; ".join(f"{one.name} = {as_printed(one.got)}, expected {one.expected:.9g}" for one in failed)
    results = {name: value for name, value in summary.get("results", {}).items() if value is not None}
    return SweepRow(run.values, path, summary["status"], code, summary.get("seconds"), "" if code == DONE else message, results)


def in_a_line(row: SweepRow) -> str:
    """Return the folder, the status, the duration and the error of a run."""
    took = "" if row.seconds is None else f" in {row.seconds:.3g} s"
    return f"{row.folder.name}: {row.status}{took}" + (f": {row.message}" if row.message else "")


class _Table:
    """Table on disk: rows of runs that ended, in the order of the product."""

    def __init__(self, folder: Path, runs: Sequence[PlannedRun], rows: dict[str, SweepRow]) -> None:
        self._path, self._order, self._rows = folder / TABLE, [run.name for run in runs], rows
        self._keys = list(runs[0].values)
        self.write()

    def add(self, row: SweepRow) -> None:
        """Add a row, and write the table again."""
        self._rows[row.folder.name] = row
        self.write()

    def write(self) -> None:
        """Write all rows so far."""
        rows = [self._rows[name] for name in self._order if name in self._rows]
        results = list(dict.fromkeys(name for row in rows for name in row.results))
        with replacing(self._path) as part, part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([*self._keys, *COLUMNS, *results])
            for row in rows:
                status = row.status, row.exit_code, row.seconds, row.folder.name, row.message
                values = (one if isinstance(one, str | int | float) else json.dumps(one) for one in row.values.values())
                writer.writerow([*values, *status, *(row.results.get(name) for name in results)])


# the plot


def _plot(folder: Path, axes: Sequence[Axis], rows: Sequence[SweepRow], sections: SceneTables) -> str:
    """Draw results of a sweep (rows with values, results and an exit code) against its first number; return the error message, if
    any.

    If no number was swept, or fewer than two runs have results, there is no plot, and an old one is removed.
    """
    (folder / PLOT).unlink(missing_ok=True)
    rows = [row for row in rows if row.exit_code in (DONE, NOT_AS_EXPECTED)]
    axis = next((one for one in axes if one.of_numbers), None)
    names = list(_results_to_plot(rows, sections))[:MOST_PANELS]
    if axis is None or not names or len({row.values[axis.path] for row in rows}) < 2:
        return ""
    try:
        figure = _figure(axis, [one for one in axes if one is not axis], rows, names, sections)
        with replacing(folder / PLOT) as part:
            figure.savefig(part, format="png", dpi=DOTS_PER_INCH, bbox_inches="tight")
    except Exception as error:  # matplotlib fails in many ways, and the table matters more
        return str(error)
    return ""


def _results_to_plot(rows: Sequence[SweepRow], sections: SceneTables) -> Iterator[str]:
    """Yield names of results: expected ones, then probes, reactions, frequencies and critical points, else all that differ."""
    found = list(dict.fromkeys(name for row in rows for name in row.results))
    expected = [name for name in (".".join(loc) for loc in expectations(sections.expect)) if name in found]
    yield from expected
    others = [name for name in found if name not in expected and name not in COUNTED and _differs(name, rows)]
    followed = (*sections.output.probes, *sections.output.reactions, *contacts_of(sections).values(), "frequency", "critical")
    followed_results = [name for name in others if name.startswith(tuple(f"{one}." for one in followed))]
    yield from followed_results or ([] if expected else others)


def _differs(name: str, rows: Sequence[SweepRow]) -> bool:
    """Return whether a result differs between runs by more than the rounding of a zero relative to its other components."""
    values = [row.results[name] for row in rows if name in row.results]
    family = name.partition(".")[0] + "."
    largest = max(abs(value) for row in rows for other, value in row.results.items() if other.startswith(family) or other == name)
    return max(values) - min(values) > SAME * largest and max(map(abs, values)) > ZERO * largest


def _figure(axis: Axis, others: Sequence[Axis], rows: Sequence[SweepRow], names: Sequence[str], sections: SceneTables) -> Any:
    """Draw a panel for each result, with a line for each combination of the other values."""
    from ..results.matplotlib_plot import new_figure  # matplotlib is imported only when something is drawn

    lines: dict[str, list[SweepRow]] = {}
    for row in sorted(rows, key=lambda row: [one.values.index(row.values[one.path]) for one in others]):  # legend: order of values
        label = ", ".join(f"{one.loc[-1]} = {value_in_name(row.values[one.path])}" for one in others if len(one.values) > 1)
        lines.setdefault(label, []).append(row)
    output, columns = sections.output, min(len(names), 2)
    forces = (*output.reactions, *contacts_of(sections).values())
    dimensions = RESULTS | dict.fromkeys(output.probes, "length") | dict.fromkeys(forces, "force")
    rows_of_panels = -(-len(names) // columns)
    figure = new_figure((1.5 + 4.0 * columns, 0.6 + 2.6 * rows_of_panels), interactive=False)
    panels = list(figure.subplots(rows_of_panels, columns, squeeze=False).flat)
    for panel, name in zip(panels, names, strict=False):
        for label, rows_of_line in list(lines.items())[:MOST_LINES]:
            points = sorted((row for row in rows_of_line if name in row.results), key=lambda row: row.values[axis.path])
            panel.plot([row.values[axis.path] for row in points], [row.results[name] for row in points], ".-", lw=1.2, label=label)
        panel.spines[["top", "right"]].set_visible(False)
        panel.set_ylabel(_with_unit(name, dimensions.get(name.partition(".")[0]), sections))
        panel.set_xlabel(_with_unit(axis.path, _dimension(sections, axis.loc), sections))
        if min(axis.values) > 0 and max(axis.values) >= LOGARITHMIC * min(axis.values):
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


def _dimension(sections: SceneTables, loc: Loc) -> str | None:
    """Return the dimension of a key; None if it has none."""
    at: Any = sections
    dimension = None
    for one in loc:
        if isinstance(at, BaseModel):
            dimension = dimension_of(type(at).model_fields[str(one)])
            at = getattr(at, str(one))
        else:
            at = at[one]
    return dimension


# processes


class _Task(NamedTuple):
    """Work of one process."""

    path: Path
    settings: tuple[str, ...]
    folder: Path
    start: str  # "new", "force" or "resume"


def _crashed(task: _Task) -> _Failure:
    return _Failure(
        "crashed",
        None,
        "its process ended abnormally: memory ran out, it was killed, or a library crashed. The next call repeats it; alone: "
        f"skfem-stvk solve {task.path} {' '.join(f'--set {one!r}' for one in task.settings)}",
    )


def _solve(task: _Task) -> _Failure | None:
    """Solve one scene in a process; return why there is no summary, or None."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.showwarning = _silent  # the summary contains the package's warnings
            scene = Scene.read(task.path, task.settings)
            scene.solve(task.folder, resume=task.start == "resume", force=task.start == "force", quiet=True)
    except (StvkError, OSError) as error:
        return _failed(error) if isinstance(error, AnalysisError) else _Failure("refused", BAD_INPUT, str(error))
    except KeyboardInterrupt:
        return _Failure("interrupted", INTERRUPTED, "interrupted before its first step")
    except Exception as error:  # one failure does not stop the others
        return _failed(error)
    return None


def _failed(error: Exception) -> _Failure:
    return _Failure("crashed", None, f"{type(error).__name__}: {error}")


def _silent(*warning: Any, **details: Any) -> None:
    """Show no warning."""
