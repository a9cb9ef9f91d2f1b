"""Many runs of a scene with different values, in processes; the results are a folder for each run, a table and a plot."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ..arguments import path as checked_path
from ..arguments import whole
from ..errors import AnalysisError, SceneError, StvkError
from ..kernels.threads import threads
from ..results.complete_files import OneWriter, content_of, replacing
from ..solvers.newton.processes import Crashed, in_processes, is_worker_process
from ..terminal import BAD_INPUT, DONE, INTERRUPTED, NOT_AS_EXPECTED, NOT_PASSED, say
from .build import contacts_of
from .folder import CHECKPOINT, Folder, make, names_with, visible
from .scene import Scene
from .scene_outcome import as_printed
from .scene_report import DOTS_PER_INCH
from .schema import SceneTables
from .source import Axis, axes_of, refuse_all

Settings: TypeAlias = Mapping[str, Iterable[Any]] | Sequence[str]
TABLE, PLOT = "table.csv", "sweep.png"
#: Columns between the values and the results.
COLUMNS = ("status", "exit_code", "seconds", "folder", "message")
#: Exit codes of runs that reached their end: they are solved again only with `force`.
ENDED = (DONE, NOT_PASSED, NOT_AS_EXPECTED)
#: Maximum number of runs of one sweep, of characters in the name of a folder, of results in a plot, and of bytes of a table.
MOST_RUNS, LONGEST, MOST_PANELS, LARGEST_TABLE = 10_000, 120, 6, 100_000_000
#: Message of a run whose process crashed, before its settings.
CRASHED = "its process ended abnormally: memory ran out, or it was killed. The next call repeats it; alone: skfem-stvk solve"
#: Results about the course of a run, not its outcome.
COUNTED = ("steps", "load", "time", "modes.rigid", "modes.unstable")


@dataclass(frozen=True)
class SweepRow:
    """Outcome of one run of a sweep.

    Attributes
    ----------
    values
        Values of the swept keys.
    folder
        Folder of its results.
    status, message
        Status of the run in a word, and the error; the message of a run that is done is empty.
    exit_code
        Exit code of `skfem-stvk solve`; None if its process crashed.
    seconds
        Duration of the run.
    results
        Results by dotted name, such as `energy.strain`.
    """

    values: dict[str, Any]
    folder: Path
    status: str
    exit_code: int | None = None
    message: str = ""
    seconds: float | None = None
    results: dict[str, float] = field(default_factory=dict)

    @property
    def done(self) -> bool:
        """Whether the run converged, and all expectations hold."""
        return self.exit_code == DONE


def sweep(
    path: str | os.PathLike[str],
    settings: Settings,
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
    beside = runs[0].scene.folder_of_results
    folder = beside.with_name(f"{beside.name}-sweep") if out is None else checked_path("out", out, "the path of a folder")
    cores, threads_per_run = threads(), max((run.scene.sections.threads or 1 for run in runs), default=1)
    jobs = cores if jobs is None else whole("jobs", jobs, "a number of simultaneous runs, from 1", least=1)
    if names_with(folder, TABLE, "a sweep"):
        head = content_of(folder / TABLE, LARGEST_TABLE).decode(errors="replace").partition("\n")[0]
        if not set(COLUMNS) <= set(head.rstrip().split(",")):
            raise StvkError(f"--out {folder}: its {TABLE} is not the table of a sweep. Choose another folder.")
    make(folder)
    with OneWriter(folder):
        start = {run.name: _start(run, folder, force) for run in runs}
        rows = {run.name: _row(run, folder / run.name) for run in runs if start[run.name] is None}
        missing = {(path, run.settings, folder / run.name, how): run for run in runs if (how := start[run.name])}
        jobs = max(1, min(jobs, cores // threads_per_run, len(missing)))
        say(f"{len(runs)} runs, {len(rows)} of them already done; {jobs} at a time", quiet)
        for text, count in Counter(text for run in missing.values() for text in run.scene.sections.implausible()).items():
            say(f"note {text} (in {count} of {len(missing)} runs)", quiet)
        _write_table(folder, runs, rows)
        try:
            for task, failure in in_processes(_solve, deque(missing), jobs, max(threads_per_run, cores // jobs)):
                run, crash = missing[task], ("crashed", None, f"{CRASHED} {path} {' '.join(f'--set {one!r}' for one in task[1])}")
                result = crash if isinstance(failure, Crashed) else failure
                rows[run.name] = SweepRow(run.values, task[2], *result) if result else _row(run, task[2])
                _write_table(folder, runs, rows)
                say(f"[{len(rows)}/{len(runs)}] {in_a_line(rows[run.name])}", quiet)
        except KeyboardInterrupt:
            say(f"{len(rows)} of {len(runs)} runs are in {folder / TABLE}; run the same command again for the rest", quiet)
            raise
        _plot(folder, axes, list(rows.values()), runs[0].scene.sections)
        return [rows[run.name] for run in runs]


class PlannedRun(NamedTuple):
    """One scene of a sweep: its values, its settings, and the name of its folder."""

    values: dict[str, Any]
    settings: tuple[str, ...]
    name: str
    scene: Scene


def planned(path: str | os.PathLike[str], settings: Settings) -> tuple[list[Axis], list[PlannedRun]]:
    """Return the axes of a sweep, and the product of their values, the last axis fastest. Every scene is checked.

    Raises SceneError with all faults in the scene, in the settings and in any of the scenes, each once; or if two runs are equal.
    """
    axes = axes_of(settings)
    if (count := prod(len(axis.values) for axis in axes)) > MOST_RUNS:
        raise SceneError(f"The sweep has {count} runs; expected at most {MOST_RUNS}. Give fewer values, or make several sweeps.")
    runs: list[PlannedRun] = []
    wrong: Counter[str] = Counter()
    for numbers in product(*(range(len(axis.values)) for axis in axes)):
        texts = tuple(f"{axis.path}={axis.texts[k]}" for axis, k in zip(axes, numbers, strict=True))
        values = {axis.path: axis.values[k] for axis, k in zip(axes, numbers, strict=True)}
        parts = (f"{axis.path.rpartition('.')[2]}={value_in_name(values[axis.path])}" for axis in axes)
        name = ",".join(re.sub(r"[^A-Za-z0-9_.+=-]+", "_", part) for part in parts)
        try:
            runs.append(PlannedRun(values, texts, name, Scene.read(path, texts)))
        except SceneError as error:
            head, *complaints = str(error).split("\n  ")
            wrong.update(complaints or [head.removeprefix(f"{Path(path).name}: ")])
    refuse_all(
        [text + (f" (in {times} of {count} runs)" if times < count else "") for text, times in wrong.items()], Path(path).name
    )
    times, first = Counter(run.name.lower() for run in runs), dict[str, PlannedRun]()  # some file systems ignore case
    for number, run in enumerate(runs):
        if (other := first.setdefault(run.scene.hash, run)) is not run:
            raise SceneError(f"The runs {other.settings} and {run.settings} are the same scene; give each value once.")
        if times[run.name.lower()] > 1 or len(run.name) > LONGEST:
            hashed = hashlib.sha256(repr(run.settings).encode()).hexdigest()[:8]
            runs[number] = run._replace(name=f"{run.name[: LONGEST - 9]}-{hashed}")
    return axes, runs


def value_in_name(value: Any) -> str:
    """Return a value in few characters: numbers as a person writes them, lists without brackets.

    >>> value_in_name(1e9), value_in_name(0.25), value_in_name([0.0, 0.0, -9.81]), value_in_name(True)
    ('1e9', '0.25', '0_0_-9.81', 'true')
    """
    if isinstance(value, Mapping):
        return "_".join(f"{name}_{value_in_name(one)}" for name, one in value.items())
    if isinstance(value, list | tuple):
        return "_".join(map(value_in_name, value))
    if not isinstance(value, float):
        return str(value).lower() if isinstance(value, bool) else str(value)
    text = f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return re.sub(r"e\+?(-?)0*", r"e\1", text)


def _start(run: PlannedRun, folder: Path, force: bool) -> str | None:
    """Return how a run starts: "new", with "force", or with "resume"; None if it is done. Refuse to replace other files."""
    path = folder / run.name
    summary = Folder(path).summary()
    if summary.get("scene_hash") != run.scene.hash:
        if visible(path) and not force:
            raise StvkError(
                f"{path} has other files, or results of another scene. --force replaces them, --out selects another folder."
            )
        return "force" if force else "new"
    if summary.get("exit_code") in ENDED:
        return None if summary["exit_code"] == DONE or not force else "force"
    resumable = run.scene.sections.analysis.type != "modes" and any((path / CHECKPOINT).glob("*.npz"))
    return "resume" if resumable else "force"


def _row(run: PlannedRun, path: Path) -> SweepRow:
    """Return the row of a run from its folder."""
    summary = Folder(path).summary()
    code, message = summary.get("exit_code"), str(summary.get("message", ""))
    if code == NOT_AS_EXPECTED:
        failed = [one for one in summary["expectations"] if not one.passed]
        message = "; ".join(f"{one.name} = {as_printed(one.got)}, expected {one.expected:.9g}" for one in failed)
    results = {name: value for name, value in summary.get("results", {}).items() if value is not None}
    return SweepRow(run.values, path, summary["status"], code, "" if code == DONE else message, summary.get("seconds"), results)


def in_a_line(row: SweepRow) -> str:
    """Return the folder, the status, the duration and the error of a run."""
    took = "" if row.seconds is None else f" in {row.seconds:.3g} s"
    return f"{row.folder.name}: {row.status}{took}" + (f": {row.message}" if row.message else "")


def _write_table(folder: Path, runs: Sequence[PlannedRun], rows: Mapping[str, SweepRow]) -> None:
    """Write the table of the runs that ended, in the order of the product."""
    ended = [rows[run.name] for run in runs if run.name in rows]
    results = list(dict.fromkeys(name for row in ended for name in row.results))
    with replacing(folder / TABLE) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*runs[0].values, *COLUMNS, *results])
        for row in ended:
            values = (one if isinstance(one, str | int | float) else json.dumps(one) for one in row.values.values())
            status = row.status, row.exit_code, row.seconds, row.folder.name, row.message
            writer.writerow([*values, *status, *(row.results.get(name) for name in results)])


def _plot(folder: Path, axes: Sequence[Axis], rows: Sequence[SweepRow], sections: SceneTables) -> None:
    """Draw results that differ against the first swept number, with a line for each combination of the other values.

    Expected results, probes, reactions, contacts, frequencies and critical points come first.
    """
    (folder / PLOT).unlink(missing_ok=True)
    rows = [row for row in rows if row.exit_code in (DONE, NOT_AS_EXPECTED)]
    axis, output = next((one for one in axes if one.of_numbers), None), sections.output
    first = *sections.expect, *output.probes, *output.reactions, *contacts_of(sections).values(), "frequency", "critical"
    found = dict.fromkeys(name for row in rows for name in row.results if name not in COUNTED and _differs(name, rows))
    names = sorted(found, key=lambda name: not name.startswith(tuple(f"{one}." for one in first)))[:MOST_PANELS]
    if axis is None or not names:
        return
    from ..results.matplotlib_plot import new_figure  # matplotlib is imported only when something is drawn

    lines: dict[str, list[SweepRow]] = {}
    for row in sorted(rows, key=lambda row: [one.values.index(row.values[one.path]) for one in axes]):
        others = (one for one in axes if one is not axis and len(one.values) > 1)
        lines.setdefault(", ".join(f"{one.loc[-1]} = {value_in_name(row.values[one.path])}" for one in others), []).append(row)
    figure = new_figure((7.0, 0.6 + 2.6 * len(names)), interactive=False)
    for panel, name in zip(figure.subplots(len(names), squeeze=False).flat, names, strict=True):
        for label, of_line in lines.items():
            points = sorted((row.values[axis.path], row.results[name]) for row in of_line if name in row.results)
            panel.plot(*zip(*points, strict=True), ".-", label=label)
        panel.set(xlabel=axis.path, ylabel=name)
    if len(lines) > 1:
        panel.legend()
    with replacing(folder / PLOT) as part:
        figure.savefig(part, format="png", dpi=DOTS_PER_INCH)


def _differs(name: str, rows: Sequence[SweepRow]) -> bool:
    """Return whether a result differs between runs by more than the rounding of the largest result of the same kind."""
    values, family = [row.results[name] for row in rows if name in row.results], name.partition(".")[0]
    largest = max(abs(value) for row in rows for other, value in row.results.items() if other.partition(".")[0] == family)
    return max(values) - min(values) > 1e-9 * largest


def _solve(task: tuple[Any, Sequence[str], Path, str]) -> tuple[str, int | None, str] | None:
    """Solve one scene in a process; return status, exit code and message if there is no summary, or None."""
    path, settings, folder, start = task
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.showwarning = lambda *given, **more: None  # the summary contains the package's warnings
            scene = Scene.read(path, settings)
            scene.solve(folder, resume=start == "resume", force=start == "force", quiet=True)
    except KeyboardInterrupt:
        return "interrupted", INTERRUPTED, "interrupted before its first step"
    except Exception as error:  # one failure does not stop the others
        if isinstance(error, StvkError | OSError) and not isinstance(error, AnalysisError):
            return "refused", BAD_INPUT, str(error)
        return "crashed", None, f"{type(error).__name__}: {error}"
    return None
