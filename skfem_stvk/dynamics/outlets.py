"""Where the results of a simulation go: what the caller asks for, and what is opened for it."""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..arguments import flag, path, whole
from ..errors import StvkError, warn
from ..results import Series
from ..results.files import output_path
from ..system.signature import Problem
from .checkpoint import Checkpoint, MotionHeader
from .ledger import Ledger

EVERY = 10


@dataclass(frozen=True)
class Asked:
    """What the caller asks for.

    Attributes
    ----------
    save, every, overwrite : as in `simulate`.
    checkpoint : what is written, and resumed.
    source : the file to go on from, None to begin anew.
    """

    save: Path | None
    every: int | None
    checkpoint: Checkpoint | None
    source: Path | None
    overwrite: bool

    @classmethod
    def checked(cls, save: Any, every: Any, checkpoint: Any, resume: Any, overwrite: Any) -> Asked:
        """Refuses what are no paths that can be written, and no number of steps."""
        if save is not None:
            save = output_path(path("save", save, "the path of a file such as 'flag.pvd'"), ".pvd")
        if every is not None:
            every = whole("every", every, "a whole number of steps, at least 1", least=1)
        overwrite = flag("overwrite", overwrite)
        kept = None if checkpoint is None else Checkpoint(path("checkpoint", checkpoint, "the path of a folder such as 'flag'"))
        if isinstance(resume, str | os.PathLike):
            source = Checkpoint(path("resume", resume, "True or False"), named="resume")
            return cls(save, every, kept or source, source.file, overwrite)
        if resume is None or not flag("resume", resume):
            return cls(save, every, kept, None, overwrite)
        if kept is None:
            raise StvkError("resume=True without a checkpoint: from which folder? checkpoint='...'.")
        return cls(save, every, kept, kept.file if kept.file.exists() else None, overwrite)


@dataclass
class Outlets:
    """What a run writes, opened.

    Attributes
    ----------
    series, checkpoint : None where there is none.
    every : steps from one saved state to the next.
    """

    series: Series | None = None
    every: int = EVERY
    checkpoint: Checkpoint | None = None

    @classmethod
    def opened(cls, stack: ExitStack, asked: Asked, problem: Problem | None) -> Outlets:
        """Of a run that begins; what belongs to another problem is refused."""
        if asked.checkpoint is not None and problem is not None:
            asked.checkpoint.belongs_to(problem, asked.overwrite)
        series = None
        if asked.save is not None:
            series = stack.enter_context(Series(asked.save, problem=problem, overwrite=asked.overwrite))
        return cls(series, asked.every or EVERY, asked.checkpoint)

    @classmethod
    def resumed(cls, stack: ExitStack, asked: Asked, problem: Problem, then: MotionHeader, ledger: Ledger) -> Outlets:
        """Of a run that goes on: the series is where the caller says, or beside the checkpoint.

        Raises
        ------
        StvkError
            if the run had a series that is not there.

        Warns
        -----
        StvkWarning
            where states are missing from the series, or a new one begins.
        """
        assert asked.checkpoint is not None
        asked.checkpoint.belongs_to(problem, overwrite=asked.overwrite or asked.source != asked.checkpoint.file)
        every, steps = asked.every or then.every, then.now.steps
        save = asked.save or _beside(then, asked.checkpoint.place)
        if save is None:
            return cls(None, every, asked.checkpoint)
        if then.save is not None and not save.exists():
            warn(
                f"{save} is not there, and begins at t = {then.now.t:g} s: the states before are in the series that was {then.save!r} when the "
                "checkpoint was written."
            )
        last = float(ledger["time"][steps - steps % every])
        series = stack.enter_context(Series(save, resume=True, until=last, problem=problem))
        if series.steps and series.steps[-1][0] < last < then.now.t and every == then.every:
            warn(
                f"{series.path} ends at t = {series.steps[-1][0]:g} s: its state at {last:g} s is missing, and cannot be had any more."
            )
        return cls(series, every, asked.checkpoint)


def _beside(then: MotionHeader, place: Path) -> Path | None:
    """The series of a run, by its name beside the checkpoint."""
    if then.save is None:
        return None
    save = Path(os.path.abspath(place)).parent / Path(then.save).name
    if not save.is_file() or save.suffix.lower() != ".pvd":
        raise StvkError(
            f"The checkpoint {place} is of a run that saved the series {then.save!r}: that is the checkpoint's path, and {save.name} is not beside it "
            f"in {save.parent}. Say where it is now, or where the states from t = {then.now.t:g} s on shall go: save=...; or move it there."
        )
    return save
