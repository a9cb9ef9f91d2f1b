"""A series of results in time: one VTU per step, and a PVD that ParaView opens."""

from __future__ import annotations

import json
import os
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np

from ..arguments import flag, number
from ..errors import StvkError, warn
from ..space import ONE_PROCESS, Space
from ..system.signature import Fingerprint, Signature
from .complete_files import OneWriter, cannot_write, in_all_parts, of_leader, output_path, replacing
from .fields import State, checked_state
from .table import find_all
from .vtu import DEFAULT, remove_state, write_vtu

#: The attribute of a .pvd's collection that holds the signature of the problem whose states it lists.
PROBLEM = "skfem_stvk_problem"


class Series(OneWriter):
    """Results of one run: `NAME_0000.vtu`, `NAME_0001.vtu`, ... next to `NAME.pvd`, which lists all of them after each step.

    A killed run leaves a readable series, with all steps except the unfinished one. No other process can write the series within a
    `with` block; without one, while a step is added.

    Parameters
    ----------
    path
        Path of the .pvd file, in a folder that exists.
    fields
        Names of the fields of each step, see `write_vtu`; None for the usual ones.
    resume
        Continue an existing series: its steps before the first new step are retained. By default the first step replaces an older
        series. The .vtu files of discarded steps are removed, if the older .pvd lists them under this series' name; other files
        stay.
    until
        Last step of a resumed series; steps after this one are discarded too.
    problem
        The problem of the states. The .pvd holds its signature, and the series of another problem is neither resumed nor replaced.
    overwrite
        Replace even the series of another problem.
    space
        Space of the displacements of a body that is divided into parts, `system.space`: each part writes files of its own, and the
        .pvd lists a .pvtu file for each step.

    Raises
    ------
    StvkError
        for an unknown field, a path that cannot be written, or a series to resume that cannot be read, before any work; if
        another process is writing the series, or it belongs to another problem.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        fields: Sequence[str] | None = None,
        resume: bool = False,
        until: float = np.inf,
        *,
        problem: Fingerprint | None = None,
        overwrite: bool = False,
        space: Space | None = None,
    ) -> None:
        super().__init__(output_path(path, ".pvd"), ONE_PROCESS if space is None else space.comm)
        self.fields = tuple(field.name for field in find_all(DEFAULT if fields is None else fields))
        self.resume = flag("resume", resume)
        self._until = np.inf if isinstance(until, float) and until == np.inf else number("until", until, "a time, or infinity")
        self.steps: list[tuple[float, Path]] = []
        self._problem, self._overwrite = problem, overwrite
        self._begun = False
        if resume:
            of_leader(self.comm, self._read)

    def opened(self) -> None:
        self._refuse_other()
        if self.resume and not self.steps:
            self.steps = of_leader(self.comm, self._retained_steps)

    def add(self, state: State, t: float) -> Path:
        """Write the next step, at the load factor or time `t` (by which ParaView orders them), and list it.

        If adding is interrupted, the step is either complete and listed, or absent and can be added again.

        Raises
        ------
        StvkError
            if `t` is not finite, or another process is writing the series.
        WriteError
            if the disk is full, for example.
        """
        t = number("t", t, "a finite load factor or time")
        if checked_state(state).fields.mesh.space.comm.divided != self.comm.divided:
            raise StvkError(
                "The state belongs to a part of a body, but the series does not; expected Series(..., space=system.space)."
            )
        with nullcontext() if self.held else self:
            return self._add(state, float(t))

    def _add(self, state: State, t: float) -> Path:
        if not self._begun:
            self._begin(t)
        last = int(self.steps[-1][1].stem.rpartition("_")[2]) if self.steps else -1
        file = self.path.with_name(f"{self.path.stem}_{last + 1:04d}.{'pvtu' if self.comm.divided else 'vtu'}")
        write_vtu(file, state, self.fields)
        steps = [*self.steps, (t, file)]
        of_leader(self.comm, lambda: self._write(steps))
        self.steps = steps
        return file

    def cut(self, t: float) -> None:
        """Remove the steps from `t` on; for a resumed series, only after a step was added."""
        if not isinstance(t, float) or np.isnan(t):
            t = number("t", t, "a time")
        if self._begun:
            self._retain(self.steps, [step for step in self.steps if step[0] < t])

    def _begin(self, t: float) -> None:
        """Remove the steps of an older run, from `t` on or all; first from the list, so that it never names a missing file."""
        assert self._problem is None or self._problem.signature  # all parts compute it
        self._retain(of_leader(self.comm, self._previous_steps), [step for step in self.steps if step[0] < t])
        self._begun = True

    def _previous_steps(self) -> list[tuple[float, Path]]:
        """Return the steps of an older run; none if they are to be replaced and cannot be read."""
        try:
            return self._read()
        except StvkError:
            if self.resume:
                raise
            return []

    def _retained_steps(self) -> list[tuple[float, Path]]:
        """Return the steps of a resumed series whose files exist."""
        listed = [step for step in self._read() if step[0] <= self._until]
        existing = [step for step in listed if step[1].is_file()]
        if len(existing) < len(listed):
            missing = next(file.name for _, file in listed if not file.is_file())
            warn(f"{self.path} lists {len(listed) - len(existing)} missing files, the first of them {missing}. They are left out.")
        return existing

    def _retain(self, previous: list[tuple[float, Path]], retained: list[tuple[float, Path]]) -> None:
        """Retain these steps of the former ones, and remove the others."""
        with in_all_parts(self.comm):
            if self.comm.leads:
                if retained:
                    self._write(retained)
                else:
                    self.path.unlink(missing_ok=True)
                self.steps = retained
                for _, file in previous:
                    if file not in {file for _, file in retained}:
                        remove_state(file)
        self.steps = retained

    def _read(self) -> list[tuple[float, Path]]:
        """Return times and files that the .pvd lists and that this series may have written; none if there is no .pvd."""
        if not self.path.exists():
            return []
        own_files = re.compile(re.escape(self.path.stem) + r"_\d{4,}\.p?vtu")
        try:
            listed = read_list(self.path)
        except (ET.ParseError, KeyError, ValueError, OSError) as error:
            raise StvkError(f"{self.path} cannot be resumed as a series ({error}). Start a new one without resume.") from error
        return sorted((t, self.path.with_name(name)) for t, name in listed if own_files.fullmatch(name))

    def _refuse_other(self) -> None:
        """Refuse the series of another problem."""
        if self._problem is None or (self._overwrite and not self.resume):
            return
        written = of_leader(self.comm, self._written_problem)
        if written is None:
            return
        if differences := self._problem.differences(written):
            raise StvkError(
                f"{self.path} is the series of another problem: {differences}. Choose another path, or replace it with "
                "overwrite=True."
            )

    def _written_problem(self) -> Signature | None:
        """Return the signature of the problem of an existing series; None if there is no series."""
        if not self.path.exists():
            return None
        from pydantic import TypeAdapter  # imported only if a file exists

        try:
            collection = ET.parse(self.path).find("Collection")
            written = None if collection is None else collection.get(PROBLEM)
            return TypeAdapter(Signature).validate_json(written or "")
        except (ET.ParseError, ValueError, OSError) as error:
            raise StvkError(
                f"{self.path} exists, but does not name its problem: another program or release wrote it, or result.save(...). "
                "Choose another path, or replace it with overwrite=True."
            ) from error

    def _write(self, steps: list[tuple[float, Path]], target: Path | None = None) -> None:
        """Write the list, to its own path or another one."""
        root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
        collection = ET.SubElement(root, "Collection")
        if self._problem is not None:
            collection.set(PROBLEM, json.dumps(vars(self._problem.signature)))
        for t, file in steps:
            ET.SubElement(collection, "DataSet", timestep=repr(t), group="", part="0", file=file.name)
        ET.indent(root)
        with replacing(target or self.path) as part:
            ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def save_series(path: str | os.PathLike[str], fields: Sequence[str], states: Iterable[tuple[float, State]]) -> Path:
    """Write states as a series, with the times by which ParaView orders them; an older series stays until all are written."""
    with Series(path, fields) as series:
        aside = series.path.with_name(f".{series.path.stem}.part")
        try:
            if aside.is_symlink():
                aside.unlink()
            aside.mkdir(exist_ok=True)
            written = [(float(t), write_vtu(aside / f"{n:04d}.vtu", state, fields)) for n, (t, state) in enumerate(states)]
            steps = [(t, series.path.with_name(f"{series.path.stem}_{file.name}")) for t, file in written]
            series._write(steps, aside / series.path.name)
            series._begin(-np.inf)  # after this line files are only renamed
            for (_, file), (_, target) in zip(written, steps, strict=True):
                file.replace(target)
            (aside / series.path.name).replace(series.path)
        except OSError as error:
            raise cannot_write(series.path, error) from error
        finally:
            with suppress(OSError):
                shutil.rmtree(aside)
    return series.path


def listed_states(path: Path) -> list[tuple[float, Path]]:
    """Return times and files of the states that a .pvd lists, in its order; raise StvkError if it is invalid or lists none."""
    try:
        listed = [(t, path.with_name(name)) for t, name in read_list(path)]
    except (OSError, ET.ParseError, KeyError, ValueError) as error:
        raise StvkError(f"{path} is not a series of results ({error}); expected a .pvd file, as save=... writes it.") from error
    if not listed:
        raise StvkError(f"{path} lists no states: the run may have stopped before its first one.")
    return listed


def read_list(path: Path) -> list[tuple[float, str]]:
    """Return finite times and files that a .pvd lists; raise ParseError, KeyError or ValueError if it is invalid."""
    if path.exists() and not path.is_file():
        raise ValueError("it is not a regular file")
    listed = [(float(item.attrib["timestep"]), item.attrib["file"]) for item in ET.parse(path).iter("DataSet")]
    if strange := [f"{t} of {file}" for t, file in listed if not np.isfinite(t)]:
        raise ValueError(f"{len(strange)} times are not finite, the first of them {strange[0][:80]}")
    return listed
