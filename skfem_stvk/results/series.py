"""A series of results in time: one VTU a step, and a PVD that ParaView opens."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np

from ..arguments import flag, number
from ..errors import StvkError
from .files import output_path, replacing
from .state import State
from .table import find_all
from .vtu import DEFAULT, write_vtu


class Series:
    """Results of one run: `NAME_0000.vtu`, `NAME_0001.vtu`, ... beside `NAME.pvd`, which after each step lists all of them.

    A run that is killed leaves a series that opens, with all steps but the one it was writing.

    Parameters
    ----------
    path : of the .pvd file, in a folder that exists.
    fields : names of what each step holds, see `write_vtu`.
    resume : go on with the series that is there, if any: its steps before the first one that is added are kept. By default the
        first step replaces an older series. The .vtu files of steps that are not kept are removed, if the older .pvd lists them under
        this series' name; other files stay.
    until : of a series that is resumed, steps after this one are not kept either.

    Raises
    ------
    StvkError
        for an unknown field, a path that cannot be written, or a series to resume that cannot be read, before any work.
    """

    def __init__(
        self, path: str | os.PathLike[str], fields: Sequence[str] = DEFAULT, resume: bool = False, until: float = np.inf
    ) -> None:
        self.fields = tuple(field.name for field in find_all(fields))
        self.path, self.resume = output_path(path, ".pvd"), flag("resume", resume)
        self._until = np.inf if isinstance(until, float) and until == np.inf else number("until", until, "a time, or infinity")
        self.steps: list[tuple[float, Path]] = []
        self._begun = False
        if resume:
            self._read()

    def add(self, state: State, t: float) -> Path:
        """Write the next step, at the load factor or time `t` (by which ParaView orders them), and list it.

        Raises
        ------
        StvkError
            if `t` is not finite.
        """
        t = number("t", t, "a finite load factor or time")
        if not self._begun:
            self._begin(t)
        last = int(self.steps[-1][1].stem.rpartition("_")[2]) if self.steps else -1
        file = self.path.with_name(f"{self.path.stem}_{last + 1:04d}.vtu")
        write_vtu(file, state, self.fields)
        self.steps.append((float(t), file))
        self._write()
        return file

    def cut(self, t: float) -> None:
        """Remove the steps from `t` on; of a series that is resumed, once one was added."""
        if not isinstance(t, float) or np.isnan(t):
            t = number("t", t, "a time")
        if self._begun:
            self._keep(self.steps, [step for step in self.steps if step[0] < t])

    def _begin(self, t: float) -> None:
        """Leave out what an older run wrote, from `t` on or altogether: first in the list, so that it never names what is not there."""
        former = []
        with nullcontext() if self.resume else suppress(StvkError):
            former = self._read()
        self._keep(former, [step for step in former if self.resume and step[0] < t and step[0] <= self._until])
        self._begun = True

    def _keep(self, former: list[tuple[float, Path]], kept: list[tuple[float, Path]]) -> None:
        """The first ones of those that there were."""
        self.steps = kept
        if kept:
            self._write()
        else:
            self.path.unlink(missing_ok=True)
        for _, file in former[len(kept) :]:
            file.unlink(missing_ok=True)

    def _read(self) -> list[tuple[float, Path]]:
        """Times and files that the .pvd lists and that this series may have written; none if there is no .pvd."""
        if not self.path.exists():
            return []
        ours = re.compile(re.escape(self.path.stem) + r"_\d{4,}\.vtu")
        try:
            listed = read_list(self.path)
        except (ET.ParseError, KeyError, ValueError) as error:
            raise StvkError(f"{self.path} is no series that can be resumed ({error}). Start a new one without resume.") from error
        return sorted((t, self.path.with_name(name)) for t, name in listed if ours.fullmatch(name))

    def _write(self) -> None:
        root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
        collection = ET.SubElement(root, "Collection")
        for t, file in self.steps:
            ET.SubElement(collection, "DataSet", timestep=repr(t), group="", part="0", file=file.name)
        ET.indent(root)
        with replacing(self.path) as part:
            ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def read_list(path: Path) -> list[tuple[float, str]]:
    """Times and files that a .pvd lists; raises ParseError, KeyError or ValueError if it is none."""
    if path.exists() and not path.is_file():
        raise ValueError("it is no regular file")
    return [(float(item.attrib["timestep"]), item.attrib["file"]) for item in ET.parse(path).iter("DataSet")]
