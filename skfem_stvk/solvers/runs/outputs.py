"""Output files of a run: a series of states that ParaView opens, and a folder from which a later run continues."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...arguments import Array, flag, whole
from ...arguments import path as path_of
from ...errors import StvkError
from ...results import Fields, Series
from ...results.complete_files import output_path
from ...results.contact_forces import contact_states
from ...system import System
from ...system.signature import Fingerprint
from ...terms.loads.load import Time


@dataclass(frozen=True)
class OutputFiles:
    """Options of `solve_static` and `simulate` for their files."""

    save: Path | None = None  # the .pvd file of a series of states
    checkpoint: Path | None = None  # its folder
    resume: bool = False  # whether to continue from the checkpoint
    overwrite: bool = False  # whether to replace files of another problem
    fields: Any = None  # names of further fields of its states, None for the usual ones
    every: int | None = None  # steps from one state of the series to the next, None for the usual number

    @classmethod
    def checked(cls, *, save: Any, fields: Any, checkpoint: Any, resume: Any, overwrite: Any, every: Any = None) -> OutputFiles:
        """Return the options of these keywords: paths that can be written, and a checkpoint if it is to be resumed."""
        if every is not None:
            every = whole("every", every, "a whole number of steps, at least 1", least=1)
        if save is not None:
            save = output_path(path_of("save", save, "the path of a file such as 'flag.pvd'"), ".pvd")
        if checkpoint is not None:
            checkpoint = path_of("checkpoint", checkpoint, "the path of a folder such as 'flag'")
        if flag("resume", resume) and checkpoint is None:
            raise StvkError("resume = True; expected a checkpoint to resume: pass checkpoint='FOLDER'.")
        return cls(save, checkpoint, bool(resume), flag("overwrite", overwrite), fields, every)


#: Options of a motion without files.
NO_FILES = OutputFiles()


class StateSeries(Series):
    """Series of the states of a run at a path, with their fields and contacts. `resumed` are options of `Series`."""

    def __init__(self, path: Path, system: System, problem: Fingerprint, files: OutputFiles, **resumed: Any) -> None:
        super().__init__(path, files.fields, problem=problem, overwrite=files.overwrite, space=system.space, **resumed)
        self._states = Fields.of(system)

    def add_state(
        self, t: float, system: System, u: Array, moment: Time, v: Array | None = None, forces: Array | None = None
    ) -> None:
        """Write a state of the system as the next step, at the load factor or time `t`.

        A motion has velocities `v` and `forces` (n, ndofs) of all contacts on the body [N].
        """
        self._states.leave_out(system.removed)
        self.add(self._states.at(u, v, contact_states(system, u, moment, forces)), t)
