"""The folder of results of a scene: its contents, and the scene that they belong to."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from ..about import machine, versions
from ..errors import AnalysisError, SceneError, StvkError
from ..results.complete_files import content_of, replacing, try_to_write
from ..terminal import BAD_INPUT
from .scene_outcome import ComparedResult, SceneOutcome
from .scene_report import plot_files
from .schema import SceneTables
from .schema.analyses import ModesAnalysis
from .schema.sections import Output
from .source import SceneSource

#: Status of a run that was refused before it began; nothing is lost if its folder is used again.
REFUSED = "refused"
#: Status of a run that an error ended after it had written results.
FAILED = "failed"
SUMMARY, RESOLVED, CHECKPOINT = "summary.json", "resolved.toml", "checkpoint"
#: Bytes of the largest summary that is read.
LARGEST = 100_000_000


class Summary(BaseModel):
    """Entries of a summary that later commands read."""

    status: str
    scene_hash: str | None = None
    exit_code: int | None = None
    message: str = ""
    seconds: float | None = None
    results: dict[str, float | None] = {}
    expectations: list[ComparedResult] = []


class PreviousRun(NamedTuple):
    """Contents of a folder before a run writes into it."""

    content: dict[str, bytes]  # the summary and the resolved scene of a run with results
    files: dict[str, tuple[int, int]]  # inode and time of the last change of every other file
    written: list[str]  # pictures, states and the report of the run that --force replaces


@dataclass(frozen=True)
class Folder:
    """Folder of results; `resume`: whether to continue from its checkpoint, `force`: whether to replace other results."""

    path: Path
    resume: bool = False
    force: bool = False

    def open(self, sections: SceneTables) -> None:
        """Make the folder, or refuse one with results of another run, before any expensive work.

        Raises
        ------
        StvkError
            as `refuse_other`; if the folder is not writable.
        """
        self.refuse_other(sections)
        make(self.path)

    def refuse_other(self, sections: SceneTables) -> None:
        """Refuse a folder with results of another run.

        Raises
        ------
        StvkError
            if it holds results and neither `resume` nor `force` is set; if there is nothing to resume; if it holds files other
            than results.
        """
        path, names = self.path, names_with(self.path, SUMMARY, "results")
        if self.resume:
            self._refuse_resume(sections, names)
        elif names and not self.force and self.summary()["status"] != REFUSED:
            raise StvkError(
                f"{path} holds the results of a run that {self.summary()['status']}. --force replaces them, --resume continues "
                "from its checkpoint, and --out selects another folder."
            )

    def _refuse_resume(self, sections: SceneTables, names: list[str]) -> None:
        if isinstance(sections.analysis, ModesAnalysis):
            raise StvkError("--resume: modes have no checkpoint. Leave --resume out; --force replaces results.")
        checkpoints = list((self.path / CHECKPOINT).glob("*.npz")) if CHECKPOINT in names else []
        if not checkpoints:
            why = (
                "the folder does not exist."
                if not names
                else "it has no checkpoint, for example because of output.checkpoint = false."
            )
            raise StvkError(f"--resume: nothing to resume in {self.path}: {why} Start without --resume.")

    def output_arguments(self, sections: SceneTables) -> dict[str, Any]:
        """Return the arguments of `simulate` and `solve_static` for files in the folder."""
        output = sections.output
        found: dict[str, Any] = {"resume": self.resume, "overwrite": self.force}
        if output.checkpoint or self.resume:
            found["checkpoint"] = self.path / CHECKPOINT
        if output.file is not None and output.file.endswith(".pvd"):
            found |= {"save": self.path / output.file, "fields": output.fields}
        return found

    def summary(self) -> dict[str, Any]:
        """Return the summary of the run that wrote the folder; a damaged summary has a status that says so."""
        try:
            content = json.loads(content_of(self.path / SUMMARY, LARGEST))
            return dict(Summary.model_validate(content))
        except (OSError, ValueError, RecursionError):
            return {"status": "has no readable summary"}

    def previous_run(self) -> PreviousRun:
        """Return what the folder holds before a run."""
        existing = [name for name in (SUMMARY, RESOLVED) if (self.path / name).is_file()]
        has_results = SUMMARY in existing and self.summary()["status"] != REFUSED
        small = [name for name in existing if (self.path / name).stat().st_size <= LARGEST]
        content = {name: (self.path / name).read_bytes() for name in small} if has_results else {}
        return PreviousRun(content, self._files(), _written_names(self.path) if self.force else [])

    def _files(self) -> dict[str, tuple[int, int]]:
        """Return inode and time of the last change of all files except the summary and the resolved scene."""
        names = (str(path.relative_to(self.path)) for path in self.path.rglob("[!.]*") if path.is_file())
        stats = {name: (self.path / name).stat() for name in names if name not in (SUMMARY, RESOLVED)}
        return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in stats.items()}

    def begun(self, known: str) -> None:
        """Record that a run began; a killed run leaves this status."""
        self._write_summary({"status": "was killed or is running", "scene_hash": known, "begun": _now()})

    def failed(self, known: str, error: BaseException, previous_run: PreviousRun) -> None:
        """Restore the former summary and scene if no result has changed; otherwise write why the run was refused, or failed."""
        unchanged = self._files() == previous_run.files
        if previous_run.content and unchanged:
            for name, content in previous_run.content.items():
                with replacing(self.path / name) as part:
                    part.write_bytes(content)
        elif isinstance(error, StvkError) and not isinstance(error, AnalysisError):
            status = REFUSED if unchanged else FAILED
            self._write_summary(
                {"status": status, "exit_code": BAD_INPUT, "message": str(error), "scene_hash": known, "ended": _now()}
            )

    def ended(self, known: str, outcome: SceneOutcome, previous_run: PreviousRun) -> None:
        """Write the summary of a run, and remove the files of the replaced run that this run has not replaced."""
        now = self._files()
        for name in previous_run.written:
            if now.get(name) == previous_run.files.get(name):
                (self.path / name).unlink(missing_ok=True)
        self._write_summary(
            {
                "status": outcome.status,
                "exit_code": outcome.exit_code,
                "message": outcome.message,
                "results": {name: _number(value) for name, value in outcome.values.items()},
                "expectations": [one._asdict() | {"got": _number(one.got)} for one in outcome.judged],
                "warnings": list(outcome.warnings),
                "seconds": outcome.seconds,
                "ended": _now(),
                "scene_hash": known,
                "units": outcome.built.sections.units,
                "versions": versions(),
                "machine": machine(),
                "ranks": outcome.ranks,
            }
        )

    def _write_summary(self, content: dict[str, Any]) -> None:
        with replacing(self.path / SUMMARY) as part:
            part.write_text(json.dumps(content, indent=1, default=str) + "\n", encoding="utf-8")


def visible(folder: Path) -> list[str]:
    """Return the names in a folder, none if it is missing. Hidden files are skipped: they belong to a killed write, or to the
    system.
    """
    if folder.exists() and not folder.is_dir():
        raise StvkError(f"--out {folder}: it is a file; expected a folder, which is made if it is missing.")
    return sorted(one.name for one in folder.iterdir() if not one.name.startswith(".")) if folder.exists() else []


def names_with(folder: Path, wanted: str, what: str) -> list[str]:
    """Return the names in a folder. Raise StvkError if it holds files, but not the one that every folder of this kind has."""
    names = visible(folder)
    if names and wanted not in names:
        raise StvkError(
            f"--out {folder}: it has {len(names)} files (such as {names[0]}) but no {wanted}, so it is not a folder of {what}. "
            "Choose another folder, or empty it."
        )
    return names


def make(folder: Path) -> None:
    """Make a folder, and try whether files can be written there. Raise StvkError if they cannot."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try_to_write(folder)
    except OSError as error:
        raise StvkError(f"--out {folder} cannot be written: {error.strerror}. Choose another folder.") from error


def _written_names(path: Path) -> list[str]:
    """Return the names of the pictures, states and the report that the scene in a folder of results has written there."""
    try:
        output = Output.model_validate(SceneSource.read(path / RESOLVED).data.get("output", {}))
    except (SceneError, ValidationError):
        return []
    names = {"report.html", output.animation, *(f"{name}.png" for name in plot_files(output.plots).values())}
    series = rf"|{re.escape(Path(output.file).stem)}(_\d{{4,}}(_r\d{{4,}})?)?\.(pvd|p?vtu|csv)" if output.file else ""
    pattern = re.compile(rf"picture(-\d+)?\.png{series}")
    return [name for name in visible(path) if name in names or pattern.fullmatch(name)]


def hash_of(data: Mapping[str, Any], files: Iterable[Path] = ()) -> str:
    """Return the hash of a scene with the contents of its files, whatever the order of its keys, its comments and its title."""
    hashed = {name: value for name, value in data.items() if name != "title"}
    digest = hashlib.sha256(json.dumps(hashed, sort_keys=True).encode())
    for file in files:
        digest.update(_digest(file))
    return digest.hexdigest()[:16]


def _digest(path: Path) -> bytes:
    """Return the hash of a file, which may be larger than the memory."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(1 << 24):
            digest.update(chunk)
    return digest.digest()


def _number(value: float | None) -> float | None:
    """Return a result as JSON has it; None for a result that does not exist."""
    return None if value is None or isnan(value) else value


def _now() -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S")
