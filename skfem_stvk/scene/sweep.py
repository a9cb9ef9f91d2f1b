"""Many runs of a scene, with other values each, in processes: into a folder for each, a table and a plot."""

from __future__ import annotations

import csv
import hashlib
import os
import re
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from ..arguments import path as checked_path
from ..arguments import shown, whole
from ..errors import SceneError, StvkError
from ..kernels.threads import threads
from ..nonlinear.processes import Crashed, in_processes, is_started_for_work
from ..referee.terminal import printable
from ..results.one_writer import OneWriter
from .folder import CHECKPOINT, SUMMARY, Folder, hash_of, visible
from .outcome import BAD_INPUT, DONE, INTERRUPTED, NOT_AS_EXPECTED, NOT_CONVERGED
from .scene import Scene
from .source import Axis, SceneSource, axes_of, refuse_all
from .sweep_rows import COLUMNS, PLOT, TABLE, RunFailure, SweepRow, SweepTable, draw, in_a_line, in_short, row_of
from .syntax import Loc
from .units import implausible

#: Exit codes of runs that came to an end: they are not solved again unasked.
ENDED = (DONE, NOT_CONVERGED, NOT_AS_EXPECTED)
#: A longer name of a folder is cut.
LONGEST = 120


def sweep(
    path: str | os.PathLike[str],
    settings: Mapping[str, Iterable[Any]] | Sequence[str],
    out: str | os.PathLike[str] | None = None,
    *,
    jobs: int | None = None,
    force: bool = False,
    quiet: bool = False,
) -> list[SweepRow]:
    """Solve a scene with the product of values, several at a time, each in a process; what is done already is not done again.

    Runs that fail, or whose process crashes, do not stop the others. A run that was killed or interrupted goes on from its
    checkpoint if it has one. Programs call this under `if __name__ == "__main__":`, as processes import them anew.

    Parameters
    ----------
    path : of the scene file.
    settings : values by key, {"materials.steel.young": [1e9, 2e9]}, or texts such as "materials.steel.young=1e9,2e9".
    out : folder of table.csv, sweep.png and a folder for each run; by default beside the scene, named `SCENE-sweep`.
    jobs : runs at a time, by default one for each core; their kernels share the cores.
    force : replace runs in `out` that are of another scene, and solve those again that failed.
    quiet : print nothing.

    Returns
    -------
    list of SweepRow
        in the order of the product, the last key changing fastest.

    Raises
    ------
    SceneError
        with all that is wrong in any of the scenes, before anything runs.
    StvkError
        if the folder holds runs of another scene, or something else, or cannot be written.
    KeyboardInterrupt
        after Ctrl-C, when runs have ended after the step that they were in and the table is written; at once after a second one.
    """
    if is_started_for_work():
        raise StvkError('sweep() runs in a process that was started for it. Call it under `if __name__ == "__main__":` alone.')
    axes, runs = planned(path, settings)
    sections, beside = runs[0].scene.sections, runs[0].scene.folder_of_results
    folder = beside.with_name(f"{beside.name}-sweep") if out is None else checked_path("out", out, "the path of a folder")
    cores, each = threads(), max((run.scene.sections.threads or 1 for run in runs), default=1)
    jobs = cores if jobs is None else whole("jobs", jobs, "how many runs go on at a time, from 1", least=1)
    console = Console(highlight=False, quiet=quiet)
    _open(folder)
    with OneWriter(folder):
        how = _what_there_is(folder, runs, force)
        rows = {run.name: row_of(run.values, folder / run.name) for run in runs if how[run.name] is None}
        table = SweepTable(folder, list(runs[0].values), [run.name for run in runs], rows)
        missing = [run for run in runs if how[run.name] is not None]
        jobs = max(1, min(jobs, cores // each, len(missing)))
        each = max(each, cores // jobs)
        kept = f", {len(rows)} of them there already" if rows else ""
        how_many = f"; {jobs} at a time on {each} thread{'s' * (each > 1)} each" if missing else ""
        console.print(f"{len(runs)} runs{kept}{how_many}", soft_wrap=True)
        for text, times in Counter(text for run in missing for text in implausible(run.scene.sections)).items():
            how_many = f" (in {times} of {len(missing)} runs)" if times < len(missing) else ""
            console.print(f"[yellow]note[/] {printable(text)}{how_many}", soft_wrap=True)
        tasks = {_Task(Path(path), run.settings, folder / run.name, how[run.name] or "new"): run for run in missing}
        try:
            for task, failure in in_processes(_solve, deque(tasks), jobs, each):
                row = row_of(tasks[task].values, task.folder, _crashed(task) if isinstance(failure, Crashed) else failure)
                table.add(row)
                console.print(f"[{len(rows)}/{len(runs)}] {in_a_line(row)}", soft_wrap=True, markup=False)
        except KeyboardInterrupt:
            console.print(f"{len(rows)} of {len(runs)} runs are in {printable(str(folder / TABLE))}; the same again does the rest")
            raise
        trouble = draw(folder, axes, list(rows.values()), sections)
        if trouble:
            console.print(f"[yellow]note[/] {PLOT} is not drawn: {printable(trouble)}", soft_wrap=True)
        return [rows[run.name] for run in runs]


# which scenes a sweep is made of, and what each is called


class Planned(NamedTuple):
    """One scene of a sweep: its values, what is to be set, and the name of its folder."""

    values: dict[str, Any]
    settings: tuple[str, ...]
    name: str
    scene: Scene


def planned(
    path: str | os.PathLike[str], settings: Mapping[str, Iterable[Any]] | Sequence[str]
) -> tuple[list[Axis], list[Planned]]:
    """The axes of a sweep, and the product of their values: the last axis changes fastest; every scene is checked.

    Raises
    ------
    SceneError
        with all that is wrong in the scene, in the settings and in any of the scenes, each once; or if two are the same.
    """
    axes = axes_of(settings)
    source = SceneSource.read(checked_path("path", path, "the path of a scene file such as 'thrown.toml'"))
    combinations = list(product(*(range(len(axis.values)) for axis in axes)))
    wrong: Counter[str] = Counter()
    scenes: list[Scene] = []
    for numbers in combinations:
        try:
            scenes.append(Scene.read(path, _settings(axes, numbers)))
        except SceneError as error:
            wrong.update(_each(error, source.name))
    count = len(combinations)
    refuse_all([text + (f" (in {times} of {count} runs)" if times < count else "") for text, times in wrong.items()], source.name)
    names = _names(axes, combinations)
    first: dict[str, str] = {}
    twice = []
    for name, scene in zip(names, scenes, strict=True):
        other = first.setdefault(hash_of(scene.data), name)
        if other != name:
            twice.append(f"{other} and {name} are the same scene; give each value once")
    refuse_all(twice, source.name)
    values = [{axis.path: axis.values[k] for axis, k in zip(axes, numbers, strict=True)} for numbers in combinations]
    texts = [_settings(axes, numbers) for numbers in combinations]
    return axes, [Planned(*one) for one in zip(values, texts, names, scenes, strict=True)]


def _settings(axes: Sequence[Axis], numbers: Sequence[int]) -> tuple[str, ...]:
    return tuple(f"{axis.path}={axis.texts[k]}" for axis, k in zip(axes, numbers, strict=True))


def _each(error: SceneError, name: str) -> list[str]:
    """What an error of a scene says, complaint by complaint."""
    head, *complaints = str(error).split("\n  ")
    return complaints or [head.removeprefix(f"{name}: ")]


def _names(axes: Sequence[Axis], combinations: Sequence[Sequence[int]]) -> list[str]:
    """A name for each run that a person reads and every file system takes, of the last names of its keys and its values.

    Names that would be the same, or that are cut, end with a hash of what they are the names of.
    """
    short = [_plain(_dotted(_last(axis.loc))) for axis in axes]
    keys = [one if short.count(one) == 1 else _plain(_dotted(axis.loc)) for one, axis in zip(short, axes, strict=True)]
    whole = [
        ",".join(f"{key}={_plain(in_short(axis.values[k]))}" for key, axis, k in zip(keys, axes, numbers, strict=True))
        for numbers in combinations
    ]
    times = Counter(name.lower() for name in whole)  # some file systems do not tell capitals
    names = []
    for name, numbers in zip(whole, combinations, strict=True):
        if times[name.lower()] > 1 or len(name) > LONGEST:
            hashed = hashlib.sha256(repr(_settings(axes, numbers)).encode()).hexdigest()[:8]
            name = f"{name[: LONGEST - 9]}-{hashed}"
        names.append(name)
    return names


def _last(loc: Loc) -> Loc:
    """The last name in a place, and numbers behind it."""
    return loc[max(depth for depth, one in enumerate(loc) if isinstance(one, str)) :]


def _dotted(loc: Loc) -> str:
    return ".".join(map(str, loc))


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", text)


# what there is already


def _open(folder: Path) -> None:
    """Make the folder; refuse one that holds something else than a sweep."""
    names = visible(folder)
    if names and TABLE not in names:
        raise StvkError(
            f"--out {folder}: it holds {len(names)} files (such as {names[0]}), and no {TABLE}: it is no folder of a sweep. "
            "Name another, or empty it."
        )
    if names:
        with (folder / TABLE).open(encoding="utf-8", newline="") as file:
            head = next(csv.reader(file), [])
        if not set(COLUMNS) <= set(head):
            raise StvkError(f"--out {folder}: its {TABLE} is not one of a sweep, as its columns are {shown(head)}. Name another.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StvkError(f"--out {folder} cannot be written: {error.strerror}. Choose another folder.") from error


def _what_there_is(folder: Path, runs: Sequence[Planned], force: bool) -> dict[str, str | None]:
    """By run how it begins: "new", with "force", or with "resume"; None if it is done."""
    how: dict[str, str | None] = {}
    others, strange = [], []
    for run in runs:
        path = folder / run.name
        names = visible(path)
        if not names:
            how[run.name] = "new"
        elif SUMMARY not in names:
            strange.append(run.name)
        elif (said := Folder(path).summary()).get("scene_hash") != run.scene.hash:
            how[run.name] = "force"
            others.append(run.name)
        elif said.get("exit_code") in ENDED:
            how[run.name] = None if said["exit_code"] == DONE or not force else "force"
        else:
            resumable = run.scene.sections.analysis.type != "modes" and any((path / CHECKPOINT).glob("*.npz"))
            how[run.name] = "resume" if resumable else "force"
    if strange:
        raise StvkError(f"{folder}: {_counted(strange)} hold other files than results. Move them away, or name another --out.")
    if others and not force:
        raise StvkError(
            f"{folder}: {_counted(others)} are of another scene: was it changed since? --force replaces them, --out names another "
            "folder."
        )
    return how


def _counted(names: Sequence[str]) -> str:
    return f"{len(names)} runs ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})"


# processes


class _Task(NamedTuple):
    """What a process solves."""

    path: Path
    settings: tuple[str, ...]
    folder: Path
    how: str  # "new", "force" or "resume"


def _crashed(task: _Task) -> RunFailure:
    return RunFailure(
        "crashed",
        None,
        "its process ended at once: memory ran out, it was killed, or a library crashed. The next call takes it up; alone: "
        f"skfem-stvk solve {task.path} {' '.join(f'--set {one!r}' for one in task.settings)}",
    )


def _solve(task: _Task) -> RunFailure | None:
    """Solve one scene in a process; why there is no summary, if there is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.showwarning = _silent  # those of the package are in the summary
            scene = Scene.read(task.path, task.settings)
            scene.solve(task.folder, resume=task.how == "resume", force=task.how == "force", quiet=True)
    except (StvkError, OSError) as error:
        return RunFailure("refused", BAD_INPUT, str(error))
    except KeyboardInterrupt:
        return RunFailure("interrupted", INTERRUPTED, "interrupted before its first step")
    except Exception as error:  # one that fails does not stop the others
        return RunFailure("crashed", None, f"{type(error).__name__}: {error}")
    return None


def _silent(*warning: Any, **details: Any) -> None:
    """Show no warning."""
