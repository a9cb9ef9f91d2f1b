"""Errors, warnings and the log of the package, and the description of ids in them.

Every message says what was given, what was expected, the ids, the likely cause and the next step.
"""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import get_close_matches
from heapq import nsmallest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Remark(NamedTuple):
    """Fault of a mesh or of a scene, or a doubt about it.

    Attributes
    ----------
    name
        Name of the fault in a few words, such as "duplicates".
    ids
        Ids of the elements or nodes, ascending; empty if the remark concerns none.
    text
        Message with the first of these ids, the likely cause and the next step.
    refused
        Whether the input is unusable; if False, it is usable but probably unintended.
    """

    name: str
    ids: Any  # (n,) whole numbers
    text: str
    refused: bool = True


class StvkError(ValueError):
    """Base class of all errors of this package.

    Examples
    --------
    >>> from skfem_stvk import Isotropic, StVK
    >>> try:
    ...     StVK(young=-1.0, poisson=0.3)
    ... except StvkError as error:
    ...     print(type(error).__name__, isinstance(error, ValueError))
    MaterialError True
    """


class MeshError(StvkError):
    """Error of a mesh that cannot carry an elastic body in its present form.

    Examples
    --------
    >>> from skfem_stvk import ElementMesh
    >>> ElementMesh(p=[[0.0, 1.0]], t=[[0], [2]])               # there is no node 2
    Traceback (most recent call last):
    skfem_stvk.errors.MeshError: ...
    """


class MaterialError(StvkError):
    """Error of a material constant that is missing, out of range or of the wrong shape.

    Examples
    --------
    >>> from skfem_stvk import Isotropic
    >>> Isotropic(young=-1.0, poisson=0.3)
    Traceback (most recent call last):
    skfem_stvk.errors.MaterialError: ...
    """


class RegionError(StvkError):
    """Error of a region that is unknown, empty or out of range.

    Examples
    --------
    >>> from skfem_stvk import ElementMesh
    >>> ElementMesh(p=[[0.0, 1.0]], t=[[0], [1]]).elements("wall")
    Traceback (most recent call last):
    skfem_stvk.errors.RegionError: ...
    """


class LoadError(StvkError):
    """Error of a load with values of the wrong shape, values that are not finite, or a location where it is not defined.

    Examples
    --------
    >>> from skfem_stvk import Ramp
    >>> Ramp(5.0, until=0.0)
    Traceback (most recent call last):
    skfem_stvk.errors.LoadError: ...
    """


class ContactError(StvkError):
    """Contact with invalid parameters, or that does not fit the body or the analysis.

    Examples
    --------
    >>> from skfem_stvk import RigidSphere
    >>> RigidSphere((0, 0, 0), -1.0)
    Traceback (most recent call last):
    skfem_stvk.errors.ContactError: RigidSphere: radius = -1.0; expected a positive length.
    """


class SupportError(StvkError):
    """Error of a body with insufficient or contradictory supports.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> System(skfem.MeshLine(), StVK(young=1.0, poisson=0.3)).check_held()         # it can move along x
    Traceback (most recent call last):
    skfem_stvk.errors.SupportError: ...
    """


class StateError(StvkError):
    """Error of a displacement vector that has the wrong length or is not finite.

    Examples
    --------
    >>> import skfem
    >>> from skfem_stvk import StVK, System
    >>> System(skfem.MeshLine(), StVK(young=1.0, poisson=0.3)).energy([0.0])        # of two degrees of freedom
    Traceback (most recent call last):
    skfem_stvk.errors.StateError: ...
    """


class AnalysisError(StvkError, RuntimeError):
    """Base class of `SolveError` and `SimulationError`: a solve or a motion did not end successfully.

    The `__cause__` is the exception that interrupted the analysis, if any. It may be of any type, not only `StvkError`.
    """


class SceneError(StvkError):
    """Error of a scene that cannot be read, or does not describe a valid model.

    The message has one line per complaint.

    Parameters
    ----------
    message
        Summary of the complaints, one line for each.
    complaints
        Tuples `(path, line, message)`. `path` is the path of a key in the scene (`terms[1].g`, "" for the whole scene). `line` is
        its line in the scene, counted from 1. The line is None for values that do not come from a file, such as those of `--set` or
        of a program. `message` is the complaint.

    Attributes
    ----------
    complaints
        The complaints, as a tuple.

    Examples
    --------
    >>> from skfem_stvk import Scene
    >>> try:
    ...     Scene.of_data({"mesh": {"type": "box", "size": [1.0, 1.0], "cells": [1, 1]}})
    ... except SceneError as error:
    ...     print([(path, line) for path, line, message in error.complaints])
    [('terms', None), ('analysis', None)]
    """

    def __init__(self, message: str, complaints: Iterable[tuple[str, int | None, str]] = ()) -> None:
        super().__init__(message)
        self.complaints = tuple(complaints)

    def __reduce__(self) -> tuple[type[SceneError], tuple[str, tuple[tuple[str, int | None, str], ...]]]:
        return SceneError, (str(self), self.complaints)


class StvkWarning(UserWarning):
    """Warning about input that can be used, but is probably not intended.

    Examples
    --------
    >>> import warnings
    >>> from skfem_stvk import ElementMesh
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     ElementMesh(p=[[0, 1, 0], [0, 0, 1]], t=[[0], [1], [2]]).with_degree(2).with_degree(1)
    ElementMesh: 1 triangles in 2D, 3 vertices
    >>> [warning.category.__name__ for warning in found]
    ['StvkWarning']
    """


#: Folder of this package, and Python's name for its import machinery: warnings point at the first line outside of both.
_PACKAGE = str(Path(__file__).parent) + os.sep, "<frozen importlib"


@dataclass
class RankWarnings:
    """Warnings of one rank since the ranks compared theirs; see `space.Communicator.end_step`.

    Attributes
    ----------
    prints
        Whether this rank prints its warnings and its progress: the first rank does, or all do, each into a log of its own.
    texts
        Texts of the warnings.
    """

    prints: bool
    texts: list[str] = field(default_factory=list)


#: Warnings of this rank; None on one machine.
on_rank: RankWarnings | None = None


#: Lines that are printed, and those that `quiet` hides, at the level INFO, which Python's `logging` leaves out unless it is set up.
LOG = logging.getLogger(__package__)


def prints() -> bool:
    """Return whether this rank prints its warnings and its progress."""
    return on_rank is None or on_rank.prints


def logs() -> bool:
    """Return whether lines are logged, by this rank."""
    return LOG.isEnabledFor(logging.INFO) and prints()


def log(line: str) -> None:
    """Log a line."""
    if logs():
        LOG.info(line)


def warn(text: str) -> None:
    """Issue a `StvkWarning` that points at the user's line, at any depth of calls inside the package.

    On several ranks, the first one issues the warnings of all, each once: its own at once, those of the others after the step.
    """
    if on_rank is not None:
        on_rank.texts.append(text)
    if prints():
        issue(text)


def issue(text: str) -> None:
    """Issue a `StvkWarning`, on any rank."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, StvkWarning, stacklevel=level)


def name_ids(ids: ArrayLike, what: str, most: int = 5, count: int | None = None) -> str:
    """Return a description of ids: their number and the first few; `count` is the number if `ids` are only the first of them.

    >>> name_ids([3, 7], "element")
    '2 elements (3, 7)'
    >>> name_ids(range(9), "vertex", most=3)
    '9 vertices (0, 1, 2, ...)'
    """
    ids = np.atleast_1d(np.asarray(ids))
    count = len(ids) if count is None else count
    plural = {"vertex": "vertices", "entry": "entries"}.get(what, what + "s")
    shown = ", ".join(str(i) for i in ids[:most].tolist()) + (", ..." if count > most else "")
    return f"{count} {what if count == 1 else plural} ({shown})"


def name_known(name: str, known: Iterable[str], most: int = 100) -> str:
    """Return a list of the known names as text, at most `most` of them, and the name that is most similar to `name`.

    >>> name_known("tpi", ["wall", "tip"])
    "known: 'tip', 'wall'. Did you mean 'tip'?"
    >>> name_known("tip", [])
    'known: none.'
    """
    known = list(known)
    names = nsmallest(most, known)
    near = nearest(name, names) if len(known) <= most else None
    listed = ", ".join(map(repr, names)) + (f" and {len(known) - most} more" if len(known) > most else "")
    return f"known: {listed or 'none'}." + (f" Did you mean {near!r}?" if near else "")


#: Symbols in books and other codes, in small letters, and their names here.
SYMBOLS = {"e": "young", "nu": "poisson", "rho": "density", "mu": "coefficient", "r": "radius", "origin": "point"}


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that `name` probably means: by its spelling, its beginning, or as a symbol of books; None if none.

    >>> constants = ["density", "poisson", "young"]
    >>> [nearest(name, constants) for name in ("poison", "youngs_modulus", "E", "color")]
    ['poisson', 'young', 'young', None]
    """
    lower, given = {other.lower(): other for other in known}, name[:100].lower()
    beginnings = [one for one in lower if len(one) > 2 and given.startswith(one)]
    near = [one for one in (SYMBOLS.get(given), *get_close_matches(given, lower, n=1), *beginnings) if one in lower]
    return lower[near[0]] if near else None
