"""A motion on disk: one file, in a folder of its own, from which a later run goes on, bit for bit."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AllowInfNan, Field, ValidationError

from ..arguments import Array
from ..errors import StvkError, warn
from ..results.archive import ArchiveHeader, NotOurs, read_archive, read_header, write_archive
from ..results.files import output_folder, output_path
from ..results.one_writer import OneWriter
from ..system.signature import Problem, Record, Signature, in_words
from . import clock as clocks
from .ledger import Ledger

FORMAT = "motion of skfem-stvk", 4
NAME = "motion.npz"
#: Where in the time of a run its loads and prescribed displacements are looked at.
FRACTIONS = (0.0, 0.31, 0.77, 1.0)
#: Time from one checkpoint to the next: at least that [s], and so long that writing takes no larger share of it.
EVERY, SHARE = 5.0, 0.05
#: What to do with a file that cannot be resumed.
ANEW = "Start anew: overwrite=True, without resume."

Count = Annotated[int, Field(ge=0)]
NotNegative = Annotated[float, Field(ge=0)]
#: A step, or its bound: infinite where nothing has stiffness.
Bound = Annotated[float, Field(ge=0), AllowInfNan(True)]


class ClockRecord(Record):
    """`Clock`."""

    start: float
    dt: Annotated[float, Field(gt=0)]
    count: Count


class LooksRecord(Record):
    """`Looks`."""

    next: Count
    interval: Annotated[int, Field(ge=clocks.FEWEST, le=clocks.MOST)]
    seen: Bound
    step: Bound
    bound: Bound
    largest: Bound
    halvings: Annotated[int, Field(ge=0, le=clocks.HALVINGS)]


class MomentRecord(Record):
    """Where a run is or was, but for the state's arrays."""

    t: float
    clock: ClockRecord
    looks: LooksRecord
    steps: Count
    cuts: Count
    rows: Annotated[int, Field(ge=1)]


class CountsRecord(Record):
    """`Counts`."""

    iterations: Count
    clamped: Count


class IntegratorRecord(Record):
    """An integrator: its options, and the names of solvers that are objects."""

    name: str
    options: dict[str, str | float | None]
    objects: dict[str, str]


class DampingRecord(Record):
    """Factors of damping."""

    alpha: NotNegative
    beta: NotNegative
    tau: NotNegative


class MethodRecord(Record):
    """The method of a motion's `Signature`."""

    integrator: IntegratorRecord
    mass: Literal["lumped", "consistent"]
    damping: DampingRecord


class MotionHeader(ArchiveHeader):
    """Of the file: of which problem it is, where the run is, its last good state, what it follows, and what it saved.

    Attributes
    ----------
    counts, seconds : what the steps took so far; "other" may be below zero by rounding.
    save : the name of its series, as the run was given it, or None. Nothing is written there: a checkpoint does not say where.
    every : steps from one saved state to the next.
    """

    problem: Signature
    now: MomentRecord
    good: MomentRecord | None
    counts: CountsRecord
    seconds: dict[str, Annotated[float, Field(ge=-1)]]
    probes: list[str]
    reactions: list[str]
    columns: list[str]
    save: str | None
    every: Annotated[int, Field(ge=1)]


class Saved(NamedTuple):
    """What a checkpoint holds: its header, arrays by name, and the ledger so far."""

    header: MotionHeader
    method: MethodRecord
    arrays: dict[str, Array]
    ledger: Ledger


class Checkpoint:
    """The file `motion.npz` in a folder, which is replaced as a motion goes on: a run that is killed finds the last one whole.

    It is used in a `with` block, during which nobody else can write it.

    Parameters
    ----------
    place : the folder, which is made if it is not there; until 1.0 also a .npz file in a folder that exists.
    named : the argument that gave it; until 1.0 also "resume".

    Raises
    ------
    StvkError
        if the file cannot be written, before any work; by `with`, if it has another writer.
    """

    def __init__(self, place: str | os.PathLike[str], named: str = "checkpoint") -> None:
        self.place = Path(place)
        self._is_file = self.place.suffix.lower() == ".npz" and not self.place.is_dir()
        self.file = self.place if self._is_file else self.place / NAME
        self._writer: OneWriter | None = None
        self._signature: Signature | None = None
        self._next = -np.inf
        if self._is_file:
            output_path(self.file, ".npz")
        if self._is_file or named == "resume":
            folder = str(self.place.with_suffix("") if self._is_file else self.place)
            warn(
                f"{named} = {str(self.place)!r} is taken until 1.0. Name a folder: checkpoint={folder!r}{', resume=True' * (named == 'resume')}; "
                f"what it holds is {NAME}."
            )

    def __enter__(self) -> Checkpoint:
        try:
            self._writer = OneWriter(self.file if self._is_file else output_folder(self.place))
            self._writer.__enter__()
            return self
        except BaseException:
            self.__exit__(None, None, None)
            raise

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._writer is not None:
            self._writer.__exit__(kind, error, trace)

    def belongs_to(self, problem: Problem, overwrite: bool) -> None:
        """Take the signature of the problem that is written from here on; refuse to replace what is of another one."""
        if self.file.exists() and not overwrite:
            header = read_header(self.file, MotionHeader, FORMAT, "Name another folder, or replace it with overwrite=True.")
            differences = problem.differences(header.problem)
            if differences:
                raise StvkError(
                    f"{self.file} is of another problem: {differences}. Name another folder, or replace it with overwrite=True."
                )
        self._signature = problem.signature

    def due(self, now: float) -> bool:
        """Whether it is time to write, at `now` of `time.perf_counter` [s]: at first, and then as often as costs little."""
        return now >= self._next

    def write(self, about: dict[str, Any], arrays: Mapping[str, Array], ledger: Ledger) -> None:
        """Replace the file.

        Parameters
        ----------
        about : what `MotionHeader` has beside the problem and the columns.

        Raises
        ------
        WriteError
            if the disk is full, for example; the file that was there is still there.
        """
        assert self._signature is not None
        begin = time.perf_counter()
        header = {"format": FORMAT[0], "version": FORMAT[1], "columns": ledger.names, **about}
        write_archive(self.file, header | {"problem": self._signature.model_dump()}, {**arrays, "ledger": ledger.rows()})
        end = time.perf_counter()
        self._next = end + max(EVERY, (end - begin) / SHARE)


def load(file: Path) -> Saved:
    """What the file holds, as far as it can be believed without the system.

    Raises
    ------
    StvkError
        if there is no such file, it is incomplete or was not written here, or by another version, or was changed, or does not hold what it should.
    """
    if not file.exists():
        raise StvkError(f"There is no checkpoint {file}. Is the path relative to another folder? To begin anew, leave out resume.")
    header, arrays = read_archive(file, MotionHeader, FORMAT, ANEW)
    try:
        method = MethodRecord.model_validate(header.problem.method)
        rows = arrays.pop("ledger")
        if rows.dtype != np.float64:
            raise ValueError(f"numbers of the type {rows.dtype}")
        return Saved(header, method, arrays, Ledger(header.columns, rows))
    except ValidationError as error:
        raise NotOurs(f"{file} is damaged: {in_words(error)}. {ANEW}") from None
    except (StvkError, KeyError, ValueError, TypeError) as error:
        raise NotOurs(f"{file} is damaged: its ledger is missing, or none ({error}). {ANEW}") from None
