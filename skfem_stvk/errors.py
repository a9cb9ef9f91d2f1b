"""The errors and warnings of the package, and how ids are named in them.

Every message says what it got, what was expected, the ids, the likely cause and the next step.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterable
from difflib import get_close_matches
from heapq import nsmallest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class Remark(NamedTuple):
    """A fault of a mesh or of a scene, or a doubt about it.

    Attributes
    ----------
    name : in a few words, such as "duplicates".
    ids : of the elements or nodes, ascending; empty if it is about none.
    text : with the first of these, the likely cause and the next step.
    refused : whether no body can be made of it; else it is probably not what was meant.
    """

    name: str
    ids: Any  # (n,) whole numbers
    text: str
    refused: bool = True


class StvkError(ValueError):
    """Base of all errors that this package raises."""


class MeshError(StvkError):
    """The mesh cannot carry an elastic body as it is."""


class MaterialError(StvkError):
    """A material constant is missing, out of range or of the wrong shape."""


class RegionError(StvkError):
    """A region is unknown, empty or out of range."""


class LoadError(StvkError):
    """A load has values of the wrong shape, or that are not finite, or acts where it has no meaning."""


class SupportError(StvkError):
    """A body is not held, or it is held in a way that contradicts itself."""


class StateError(StvkError):
    """A displacement vector has the wrong length or is not finite."""


class AnalysisError(StvkError, RuntimeError):
    """A solve or a motion did not end as it should: the base of `SolveError` and `SimulationError`.

    Its `__cause__` may be any exception that interrupted the analysis, also one that is no `StvkError`.
    """


class SceneError(StvkError):
    """A scene cannot be read, or does not say what can be built; with all that is wrong in it, one complaint per line.

    `complaints` are `(path, line, message)`: the path of a key as the scene writes it (`terms[1].g`, "" for the scene as a whole),
    the line of the scene, counted from 1 (None if there is none, as for what `--set` or a program gave), and what is wrong there.
    """

    def __init__(self, message: str, complaints: Iterable[tuple[str, int | None, str]] = ()) -> None:
        super().__init__(message)
        self.complaints = tuple(complaints)

    def __reduce__(self) -> tuple[type[SceneError], tuple[str, tuple[tuple[str, int | None, str], ...]]]:
        return SceneError, (str(self), self.complaints)


class StvkWarning(UserWarning):
    """The input can be used, but is probably not what was meant."""


#: The folder of this package and Python's name for the machinery of imports: warnings point at the first line outside of both.
_PACKAGE = str(Path(__file__).parent) + os.sep, "<frozen importlib"


def warn(text: str) -> None:
    """Issue a `StvkWarning` that points at the user's line, however deep in the package it was found."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(text, StvkWarning, stacklevel=level)


def name_ids(ids: ArrayLike, what: str, most: int = 5) -> str:
    """The first few of the ids and how many there are.

    >>> name_ids([3, 7], "element")
    '2 elements (3, 7)'
    >>> name_ids(range(9), "vertex", most=3)
    '9 vertices (0, 1, 2, ...)'
    """
    ids = np.atleast_1d(np.asarray(ids))
    plural = {"vertex": "vertices", "entry": "entries"}.get(what, what + "s")
    shown = ", ".join(str(i) for i in ids[:most].tolist()) + (", ..." if len(ids) > most else "")
    return f"{len(ids)} {what if len(ids) == 1 else plural} ({shown})"


def name_known(name: str, known: Iterable[str], most: int = 100) -> str:
    """The known names, the first of them if they are many, and the one that was probably meant.

    >>> name_known("tpi", ["wall", "tip"])
    "known: 'tip', 'wall'. Did you mean 'tip'?"
    >>> name_known("tip", [])
    'known: none.'
    """
    known = list(known)
    names = nsmallest(most, known)
    lower = {other.lower(): other for other in names} if len(known) <= most else {}
    near = get_close_matches(name[:100].lower(), lower, n=1)
    listed = ", ".join(map(repr, names)) + (f" and {len(known) - most} more" if len(known) > most else "")
    return f"known: {listed or 'none'}." + (f" Did you mean {lower[near[0]]!r}?" if near else "")
