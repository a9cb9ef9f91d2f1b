"""Small bodies, good arguments and legal values for the tables of calls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from skfem_stvk import ElementMesh, Gravity, StVK, System, Traction
from skfem_stvk.mesh.element import ELEMENTS
from skfem_stvk.results import Fields, State

from .call import Call

#: Legal for optional arguments, and for flags.
OPTIONAL = frozenset({"None"})
FLAG = frozenset({"True"})
#: Legal for positive numbers, for non-negative numbers, and for all numbers.
POSITIVE = frozenset({"0.5"})
NOT_NEGATIVE = POSITIVE | {"0"}
NUMBER = NOT_NEGATIVE | {"-1"}
#: Legal for vectors that may be parts of complex modes.
COMPLEX = frozenset({"1j", "0-d complex", "complex", "complex without imaginary part"})
#: Legal for texts that are shown without a change.
TEXT = frozenset({"text", "number as text", "empty text", "long text", "NUL", "control characters", "lone surrogate"})
NOTHING_LISTED = frozenset({"empty list", "empty dict"})
#: Expression for the words by which messages name a location.
PLACE = r"where|no vertex|subdomain|the vertices|the place|There is|the predicate| on |names|boundary|region|Subdomain"


def call(
    title: str,
    function: Callable[..., Any],
    legal: dict[str, frozenset[str]] | None = None,
    called: dict[str, str] | None = None,
    /,
    **good: Any,
) -> Call:
    """Return a call with good values that the function does not change."""
    return Call(title, lambda: (function, dict(good)), legal or {}, called or {})


def costly(*given: Any, **good: Any) -> Call:
    """Return the same as `call`, marked as costly."""
    return replace(call(*given, **good), costly=True)


@cache
def mesh() -> ElementMesh:
    """Return four triangles in the plane, with named regions, boundaries and vertices."""
    p = np.array([[0.0, 1.0, 2.0, 0.0, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]])
    t = np.array([[0, 1, 1, 2], [1, 4, 2, 5], [3, 3, 4, 4]])
    return ElementMesh(
        p,
        t,
        subdomains={"half": np.array([0, 1], dtype=np.int32)},
        boundaries={"left": np.array([[0], [3]], dtype=np.int32), "right": np.array([[2], [5]], dtype=np.int32)},
        node_sets={"tip": np.array([5], dtype=np.int32)},
    )


@cache
def tetrahedra() -> ElementMesh:
    """Return two tetrahedra."""
    p = np.array([[0.0, 1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0, 1.0]])
    return ElementMesh(
        p, np.array([[0, 1], [1, 2], [2, 3], [3, 4]]), boundaries={"base": np.array([[0], [1], [2]], dtype=np.int32)}
    )


@cache
def square() -> ElementMesh:
    """Return one quadrilateral."""
    corners = np.array([[0.0, 1.0, 1.25, 0.0], [0.0, 0.0, 1.0, 1.0]])
    return ElementMesh(corners, np.arange(4, dtype=np.int32)[:, None], element=ELEMENTS["quadrilaterals"])


@cache
def system() -> System:
    """Return a body that is constrained on its left and loaded on its right."""
    terms: list[Any] = [StVK(young=2.0, poisson=0.25, density=1.0), Gravity(g=(0.0, -0.25)), Traction("right", (0.25, 0.0))]
    return System(mesh(), terms, fixed={"left": "xy"})


def displacements() -> Any:
    """Return displacements (ndofs,) that are exact in any precision."""
    return np.round(64 * 0.05 * np.cos(np.arange(12.0))) / 64


@cache
def state() -> State:
    """Return a state of the body with velocities."""
    return Fields(mesh(), list(system().elastic_terms)).at(displacements(), displacements())


def drawn(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that also returns the pictures, without drawing them, because drawing takes a second."""

    def without_drawing(**given: Any) -> Any:
        pictures: list[Any] = []

        def film(film: Any, part: Path, suffix: str, fps: float) -> None:
            pictures.extend([film.times, [film.picture(number) for number in range(len(film.times))], fps])
            part.touch()

        with (
            patch("skfem_stvk.referee.plots.page", lambda report: "page"),
            patch("skfem_stvk.solvers.runs.ledger._draw", lambda ledger, path: path),
            patch("skfem_stvk.results.matplotlib_plot.draw", lambda picture, path: picture),
            patch("skfem_stvk.results.matplotlib_plot.write_film", film),
        ):
            return function(**given), pictures

    return without_drawing
