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
    """Files of an analysis, as `solve_static` and `simulate` are asked for them."""

    save: Path | None  # the .pvd file of a series of states
    checkpoint: Path | None  # its folder
    resume: bool  # whether to go on with what the checkpoint holds
    overwrite: bool  # whether to replace what belongs to another problem

    @classmethod
    def checked(cls, save: Any, checkpoint: Any, resume: Any, overwrite: Any) -> Outlets:
        """Those that were asked for: paths that can be written, and a checkpoint if it is to be resumed."""
        if save is not None:
            save = output_path(path("save", save, "the path of a file such as 'flag.pvd'"), ".pvd")
        if checkpoint is not None:
            checkpoint = path("checkpoint", checkpoint, "the path of a folder such as 'flag'")
        if flag("resume", resume) and checkpoint is None:
            raise StvkError("resume=True without a checkpoint: from which folder? checkpoint='...'.")
        return cls(save, checkpoint, bool(resume), flag("overwrite", overwrite))
