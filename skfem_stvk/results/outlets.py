"""The files that an analysis is asked to write, or to go on from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..arguments import flag, path
from ..errors import StvkError
from .files import output_path


@dataclass(frozen=True)
class Outlets:
    """Files of an analysis, as `solve_static` and `simulate` are asked for them.

    Attributes
    ----------
    save : the .pvd file of a series of states, or None.
    checkpoint : the folder of a checkpoint, or None.
    resume : whether to go on with what the checkpoint holds.
    overwrite : whether to replace what belongs to another problem.
    """

    save: Path | None
    checkpoint: Path | None
    resume: bool
    overwrite: bool

    @classmethod
    def checked(cls, save: Any, checkpoint: Any, resume: Any, overwrite: Any) -> Outlets:
        """Those that were asked for.

        Raises
        ------
        StvkError
            if one is no path that can be written, or there is no checkpoint to resume.
        """
        if save is not None:
            save = output_path(path("save", save, "the path of a file such as 'flag.pvd'"), ".pvd")
        if checkpoint is not None:
            checkpoint = path("checkpoint", checkpoint, "the path of a folder such as 'flag'")
        if flag("resume", resume) and checkpoint is None:
            raise StvkError("resume=True without a checkpoint: from which folder? checkpoint='...'.")
        return cls(save, checkpoint, bool(resume), flag("overwrite", overwrite))
