"""A motion on disk: one file from which a later run goes on, bit for bit."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkError
from ..results.files import output_path, replacing
from ..system import System
from ..system.signature import Signature, changed, signature, sums
from ..terms.load import Moment
from .ledger import Ledger

Array = NDArray[Any]

FORMAT, VERSION = "motion of skfem-stvk", 3
#: Where in the time of a run its loads and prescribed displacements are looked at.
FRACTIONS = (0.0, 0.31, 0.77, 1.0)
#: Time from one checkpoint to the next: at least that [s], and so long that writing takes no larger share of it.
EVERY, SHARE = 5.0, 0.05


class Saved(NamedTuple):
    """What a checkpoint holds: whatever JSON can write, arrays by name, and the ledger so far."""

    about: dict[str, Any]
    arrays: dict[str, Array]
    ledger: Ledger


class Checkpoint:
    """A .npz file that is replaced as a motion goes on: a run that is killed finds the last one whole.

    Parameters
    ----------
    path : of the file, in a folder that exists.
    system : that moves. It has to be the same when the file is loaded.
    times : from when and until when it moves [s]; loads are not asked for at others.

    Raises
    ------
    StvkError
        if the file cannot be written, before any work.
    """

    def __init__(self, path: str | os.PathLike[str], system: System, times: tuple[float, float]) -> None:
        self.path = output_path(path, ".npz")
        self._moments = [times[0] + fraction * (times[1] - times[0]) for fraction in FRACTIONS]
        self._signature = _signature(system, self._moments)
        self._next = -np.inf

    def due(self, now: float) -> bool:
        """Whether it is time to write, at `now` of `time.perf_counter` [s]: at first, and then as often as costs little."""
        return now >= self._next

    def write(self, about: dict[str, Any], arrays: Mapping[str, Array], ledger: Ledger) -> None:
        """Replace the file.

        Raises
        ------
        OSError
            if the disk is full, for example; the file that was there is still there.
        """
        begin = time.perf_counter()
        header = {"format": FORMAT, "version": VERSION, "about": about, "columns": ledger.names}
        header |= {"moments": self._moments, "system": self._signature}
        packed: dict[str, Any] = {"header": np.array(json.dumps(header)), "ledger": ledger.rows()}
        packed |= {f"array {name}": array for name, array in arrays.items()}
        with replacing(self.path) as part, part.open("wb") as file:
            np.savez(file, **packed)
        end = time.perf_counter()
        self._next = end + max(EVERY, (end - begin) / SHARE)


def load(path: str | os.PathLike[str], system: System) -> Saved:
    """What the checkpoint holds, for the same system to go on from.

    Raises
    ------
    StvkError
        if there is no such file, it is incomplete or was not written here, or by another version, or for another system; it says what changed.
    """
    path = Path(path)
    header, packed = _read(path)
    if header.get("version") != VERSION:
        raise StvkError(
            f"{path} is of version {header.get('version')} of checkpoints; this release reads version {VERSION}. "
            "Resume it with the release that wrote it, or start anew."
        )
    other = changed(header["system"], _signature(system, header["moments"]))
    if other:
        raise StvkError(
            f"{path} holds the motion of another system: {', '.join(other)} changed. Resume with the same mesh, terms and supports, or start anew."
        )
    arrays = {name.removeprefix("array "): array for name, array in packed.items() if name.startswith("array ")}
    return Saved(header["about"], arrays, Ledger(header["columns"], packed["ledger"]))


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    if not path.exists():
        raise StvkError(f"There is no checkpoint {path}. Is the path relative to another folder? To begin anew, leave out resume.")
    try:
        if path.is_file() and not is_zipfile(path):
            raise ValueError("it is no whole .npz file")
        with np.load(path, allow_pickle=False) as file:
            packed = {name: file[name] for name in file.files}
        header = json.loads(str(packed["header"]))
        if header["format"] != FORMAT:
            raise ValueError(f"the format is {header['format']!r}")
    except (
        OSError,
        EOFError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RuntimeError,
        BadZipFile,
    ) as error:
        raise StvkError(
            f"{path} cannot be read as the checkpoint of a motion: it is incomplete, or was not written here ({type(error).__name__}: {error})."
        ) from error
    return header, packed


def _signature(system: System, times: list[float]) -> Signature:
    """That of the system, and its masses."""
    numbers = signature(system, {f"t = {t:g} s": Moment(t, 1.0) for t in times})
    return numbers | {"the masses": sums(system.mass().vertex)}
