"""A path on disk: every accepted state as it is found, from which a later call goes on."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkError
from ..results.files import replacing
from ..system import System
from ..system.signature import changed, signature, sums
from .history import Step
from .monitors import Finding
from .newton import End, Iterations
from .path.critical import CriticalPoint
from .status import Status

Array = NDArray[Any]

ABOUT, VERSION = "path.json", 1


class Checkpoint:
    """A folder with a file for each state, written beside and renamed into place: a run that is killed keeps all that it found.

    Parameters
    ----------
    folder : is made if it is not there; its parent must be.
    about : what the path depends on, such as the method and the first step.
    system : of the path.
    resume : go on with the states that are there, if any.

    Raises
    ------
    StvkError
        if there are states and they are not to be resumed, or those of another path; if the folder cannot be made.
    """

    def __init__(self, folder: str | os.PathLike[str], about: dict[str, Any], system: System, start: Array, resume: bool) -> None:
        self.folder = Path(folder)
        now = {"version": VERSION} | about | {"u0": sums(start), "system": signature(system, {f"t = {t:g}": t for t in (0.5, 1.0)})}
        files = self._files()
        self._refuse_gaps(files)
        if files and not resume:
            raise StvkError(
                f"{self.folder} holds {len(files)} states of a path. Go on with them with resume=True, or name another folder, or remove it."
            )
        try:
            self.folder.mkdir(exist_ok=True)
            if files:
                self._refuse_other(now)
            else:
                with replacing(self.folder / ABOUT) as part:
                    part.write_text(json.dumps(now, indent=1))
        except OSError as error:
            raise StvkError(
                f"The checkpoint {self.folder} cannot be written: {error}. Does its parent exist, and is it a folder?"
            ) from error
        self._count = len(files)

    def load(self) -> tuple[list[Step], dict[str, Any]]:
        """The states, and what the walk was about to do after the last one; none and nothing if there are none."""
        steps: list[Step] = []
        saved: dict[str, Any] = {}
        for file in self._files():
            try:
                with np.load(file, allow_pickle=False) as arrays:
                    step, saved = _unpacked(dict(arrays))
            except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
                raise StvkError(
                    f"{file} cannot be read: it is incomplete, or was not written here. Remove it and those after it, and resume from the one before."
                ) from error
            steps.append(step)
        return steps, saved

    def add(self, step: Step, saved: dict[str, Any]) -> None:
        """Write a state, and what the walk will do next."""
        with replacing(self.folder / _name(self._count)) as part, part.open("wb") as file:
            np.savez(file, **_packed(step, saved))
        self._count += 1

    def _files(self) -> list[Path]:
        return sorted(self.folder.glob("state_*.npz"))

    def _refuse_gaps(self, files: list[Path]) -> None:
        for number, file in enumerate(files):
            if file.name != _name(number):
                raise StvkError(
                    f"{self.folder} has {file.name}, but no {_name(number)} before it. Remove {file.name} and those after it, and resume from the "
                    "one before."
                )

    def _refuse_other(self, now: dict[str, Any]) -> None:
        try:
            then = dict(json.loads((self.folder / ABOUT).read_text()))
        except (OSError, ValueError, TypeError) as error:
            raise StvkError(
                f"{self.folder / ABOUT} cannot be read ({error}): is {self.folder} the checkpoint of a path?"
            ) from error
        different = [name for name in now if name != "system" and then.get(name) != now[name]]
        if different:
            pairs = ", ".join(
                "u0 changed" if name == "u0" else f"{name} was {then.get(name)!r} and is {now[name]!r}" for name in different
            )
            raise StvkError(f"{self.folder} holds another path: {pairs}. Give the same again, or name another folder.")
        other = changed(then.get("system", {}), now["system"])
        if other:
            raise StvkError(
                f"{self.folder} holds the path of another system: {', '.join(other)} changed. Give the same mesh, terms and supports, or name "
                "another folder."
            )


def _name(number: int) -> str:
    return f"state_{number:05d}.npz"


def _packed(step: Step, saved: dict[str, Any]) -> dict[str, Any]:
    """Arrays, and all else as JSON."""
    plain = {field.name: getattr(step, field.name) for field in fields(step) if field.name not in ("u", "findings", "critical")}
    plain |= {"status": step.status.name, "end": step.end.name, "iterations": asdict(step.iterations), "saved": saved}
    plain["findings"] = [{"name": one.name, "extreme": one.extreme, "text": one.text} for one in step.findings]
    plain["critical"] = [{"kind": one.kind, "t": one.t, "resolved": one.resolved} for one in step.critical]
    arrays = {"u": step.u, "plain": np.array(json.dumps(plain))}
    arrays |= {f"finding_{i}": one.elements for i, one in enumerate(step.findings)}
    arrays |= {f"critical_{i}": np.stack([one.u, one.mode]) for i, one in enumerate(step.critical)}
    return arrays


def _unpacked(arrays: dict[str, Array]) -> tuple[Step, dict[str, Any]]:
    plain = json.loads(str(arrays["plain"]))
    saved = plain.pop("saved")
    plain |= {"status": Status[plain["status"]], "end": End[plain["end"]], "iterations": Iterations(**plain["iterations"])}
    plain["findings"] = tuple(Finding(elements=arrays[f"finding_{i}"], **one) for i, one in enumerate(plain["findings"]))
    critical = []
    for i, one in enumerate(plain["critical"]):
        u, mode = arrays[f"critical_{i}"]
        critical.append(CriticalPoint(one["kind"], one["t"], u, mode, one["resolved"]))
    return Step(u=arrays["u"], **(plain | {"critical": tuple(critical)})), saved
