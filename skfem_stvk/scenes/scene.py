"""A scene: a whole job in one file, from the mesh to output files and expected results."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import cached_property, reduce
from operator import getitem
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import ValidationError

from ..arguments import path as checked_path
from ..errors import StvkError
from ..kernels.threads import threads
from ..results.complete_files import OneWriter, replacing
from ..solvers.state_files import parts_of_state
from ..system import System
from ..terminal import html_table
from .build import Built, build, check, partition_of
from .complaints import Complaints
from .folder import RESOLVED, Folder, PreviousRun, hash_of
from .run_scene import RTOL, solve
from .scene_outcome import MOST_DRAWN, SceneOutcome, gathered_outcome
from .scene_report import write_report
from .schema import SceneTables, scene_tables
from .schema.analyses import options
from .schema.quantities import input_files
from .source import SceneSource
from .syntax import written

Result = TypeVar("Result")


class Scene:
    """A whole job from one file: mesh, materials, terms, supports, an analysis, output files and expected results.

    A scene holds only the objects that its file names; nothing else is imported or computed. All keys are in
    `docs/reference/scene-keys.md`.

    Parameters
    ----------
    sections
        Tables and keys of the scene, checked.
    source
        Text of the scene, and the lines of its keys.
    comm
        MPI communicator of the ranks that solve the scene together; None for one machine.

    Attributes
    ----------
    sections
        Tables and keys of the scene, checked.
    source
        Text of the scene, and the lines of its keys.

    Examples
    --------
    >>> scene = Scene.of_data({
    ...     "mesh": {"type": "box", "size": [4.0, 1.0, 1.0], "cells": [8, 2, 2]},
    ...     "materials": {"rubber": {"model": "isotropic", "young": 1e6, "poisson": 0.45}},
    ...     "terms": [
    ...         {"type": "stvk", "material": "rubber"},
    ...         {"type": "traction", "on": "right", "traction": [0.0, 0.0, -2e3]},
    ...     ],
    ...     "fixed": {"left": "xyz"},
    ...     "analysis": {"type": "static", "steps": 4},
    ...     "output": {"reactions": {"wall": "left"}},
    ... })
    >>> outcome = scene.solve(quiet=True)
    >>> outcome.status, round(outcome.values["wall.z"])
    ('converged', 2000)
    """

    def __init__(self, sections: SceneTables, source: SceneSource, comm: Any = None) -> None:
        self.sections, self.source, self._comm = sections, source, comm

    @classmethod
    def read(cls, path: str | os.PathLike[str], set: Sequence[str] = (), comm: Any = None) -> Scene:
        """Return the scene in a TOML file.

        Parameters
        ----------
        path
            Path of the file.
        set
            Replacements of keys, such as "analysis.dt=1e-5" or "terms[1].g=[0,0,-1]".
        comm
            MPI communicator of the ranks that solve the scene together, such as `mpi4py.MPI.COMM_WORLD`; None for one machine. All
            of them call the methods of the scene together, and the first rank writes the files.

        Raises
        ------
        SceneError
            with all faults in it, each with its key and line.
        """
        source = SceneSource.read(checked_path("path", path, "the path of a scene file such as 'thrown.toml'"))
        return cls._checked(source.changed(set) if set else source, comm=comm)

    @classmethod
    def of_data(cls, data: dict[str, Any]) -> Scene:
        """Return the scene in tables and lists as a TOML file has them.

        Parameters
        ----------
        data
            Tables of the scene by name; paths are relative to the folder of the process.

        Raises
        ------
        SceneError
            with all faults in it, each with its key.
        """
        return cls._checked(SceneSource.of(data))

    @classmethod
    def _checked(cls, source: SceneSource, comm: Any = None) -> Scene:
        complaints = Complaints(source)
        schema = scene_tables()
        try:
            sections = schema.model_validate(source.data)
        except ValidationError as error:
            complaints.of_pydantic(error, schema)
            complaints.refuse()
            raise
        check(sections, source)
        return cls(sections, source, comm)

    @cached_property
    def built(self) -> Built:
        """System and first state.

        Raises
        ------
        SceneError
            with all faults that the mesh reveals.
        """
        return build(self.sections, self.source, self._comm)

    def system(self) -> System:
        """Return the body with its loads and supports.

        Raises
        ------
        SceneError
            as `built`.
        """
        return self.built.system

    @property
    def data(self) -> dict[str, Any]:
        """Tables of the scene with every default filled in, as a TOML file has them; keys without a value are left out."""
        return _tables(self.sections)

    def implausible(self) -> list[str]:
        """Return, in a sentence each, the Young's moduli that are implausible in the scene's units."""
        return self.sections.implausible(float(self.built.mesh.extent.max()))

    def solve(
        self, out: str | os.PathLike[str] | None = None, *, resume: bool = False, force: bool = False, quiet: bool = False
    ) -> SceneOutcome:
        """Solve the scene, and write results into the folder `out`, if one is passed.

        Parameters
        ----------
        out
            Folder of results, made if it is missing: summary.json, resolved.toml, report.html, pictures, states and a checkpoint.
        resume
            Continue from the checkpoint in it.
        force
            Replace the results of another run in it.
        quiet
            Print nothing.

        Raises
        ------
        SceneError
            if a part does not fit the mesh.
        StvkError
            if the folder holds other results, or the analysis refuses its input. The outcome says whether it converged and
            matches the expectations.
        """
        if out is None:
            if resume or force:
                raise StvkError("resume and force need a folder of results; pass out=...")
            return solve(self.built, quiet=quiet)
        folder = Folder(checked_path("out", out, "the path of a folder"), resume, force)
        self._first(lambda: folder.open(self.sections))
        with ExitStack() as stack:
            self._first(lambda: stack.enter_context(OneWriter(folder.path)))
            self._first(
                lambda: folder.refuse_other(self.sections)
            )  # another run may have ended between the first check and the lock
            built, previous_run = self.built, self._first(folder.previous_run)
            try:
                self._first(lambda: folder.begun(self.hash))
                self.write(folder.path / RESOLVED)
                outcome = solve(built, folder, quiet=quiet)
            except BaseException as error:
                if previous_run is not None:
                    folder.failed(self.hash, error, previous_run)
                raise
            self._first(lambda: folder.ended(self.hash, outcome, cast(PreviousRun, previous_run)))
            drawn = self._drawn(outcome)
            self._first(lambda: write_report(folder.path, drawn or outcome, draw=drawn is not None))
        return outcome

    def _first(self, work: Callable[[], Result]) -> Result | None:
        """Return the result of `work` on the first rank, and None on other ranks. Its errors are raised on all ranks."""
        if self._comm is None:
            return work()
        from ..ranks.job import on_first  # imports MPI

        return on_first(self._comm, work)

    def _drawn(self, outcome: SceneOutcome) -> SceneOutcome | None:
        """Return the outcome on the whole body for pictures, on the first rank; None on others, or if the body is too large."""
        if self._comm is None:
            return outcome
        if outcome.built.mesh.element_count > MOST_DRAWN or partition_of(self.sections, self.source) is not None:
            return None
        return gathered_outcome(outcome, self._first(lambda: build(self.sections, self.source)))

    def resolved(self, folder: Path | None = None) -> dict[str, Any]:
        """Return the data of the scene with the choice of "auto".

        Parameters
        ----------
        folder
            Folder to which paths are relative; None for that of the scene.
        """
        data, built = self.data, self.built
        data["threads"] = threads() if self.sections.threads is None else self.sections.threads
        if built.solver:
            data["solver"]["name"] = built.solver
        if built.integrator is not None:
            data["analysis"] |= {name: value for name, value in vars(built.integrator).items() if name in options()}
            data["solver"] |= {name: value for name, value in vars(built.integrator).items() if name in ("rtol", "tangent")}
        elif built.solver and self.sections.analysis.type != "modes":
            data["solver"].setdefault("rtol", RTOL)
        table: Any = data
        for loc, file in input_files(self.sections) if folder is not None else ():
            reduce(getitem, loc[:-1], table)[loc[-1]] = os.path.relpath(self.source.folder / file, folder)
        tables = _tables(scene_tables().model_validate(data))
        if not built.solver:
            del tables["solver"]  # explicit integrators solve no systems
        return tables

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the scene with every default filled in and "auto" resolved: a valid scene that gives the same results.

        Parameters
        ----------
        path
            Path of the TOML file.
        """
        target = checked_path("path", path, "the path of a scene file such as 'resolved.toml'")
        data = self.resolved(target.parent)
        self._first(lambda: self._write(target, data))
        return target

    def _write(self, target: Path, data: dict[str, Any]) -> None:
        with replacing(target) as part:
            part.write_text(written(data), encoding="utf-8")

    @property
    def folder_of_results(self) -> Path:
        """Default folder of results: next to the scene, with its name."""
        return self.source.folder / Path(self.source.name).stem

    @cached_property
    def hash(self) -> str:
        """Hash of the scene with the contents of its files; it does not depend on title, comments and the order of keys."""
        from ..mesh.content import parts_of  # meshio is imported only for mesh files

        files: list[Path] = []
        for loc, name in input_files(self.sections):
            path = self.source.folder / name
            files += parts_of_state(path, self.sections.initial.at) if loc == ("initial", "file") else parts_of(path)
        return hash_of(self.source.data, files)

    def _repr_html_(self) -> str:
        entries = [(name, one) for name, value in self.data.items() for one in (value if isinstance(value, list) else [value])]
        rows = [(name, _in_words(value)) for name, value in entries if value not in ({}, "")]
        return html_table(f"Scene {self.source.name}", rows)

    def __repr__(self) -> str:
        return f"Scene({self.source.name}: {self.sections.analysis.type}, {len(self.sections.terms)} terms)"


def _in_words(value: Any) -> str:
    """Return a table of the scene as one line of keys and values."""
    return ", ".join(f"{key} = {one}" for key, one in value.items()) if isinstance(value, dict) else str(value)


def _tables(sections: SceneTables) -> dict[str, Any]:
    """Return all tables in the order of the schema, with all keys that have a value, and the key of the kind first."""
    tables: dict[str, Any] = _kinds_first(sections.model_dump(exclude_none=True))
    return tables


def _kinds_first(data: Any) -> Any:
    """Return the same tables, each with the key of its kind first."""
    if isinstance(data, list):
        return [_kinds_first(one) for one in data]
    if not isinstance(data, dict):
        return data
    first = [name for name in KINDS if name in data]
    return {name: _kinds_first(data[name]) for name in (*first, *(name for name in data if name not in first))}


#: Keys that select the kind of a table.
KINDS = ("type", "model")
