"""Closed homogeneous states at finite strain, by prescribed boundaries and by tractions, on all kinds of simplices."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from skfem_stvk import System, Traction, solve_static
from skfem_stvk.statics import StaticResult

from .closed_states import STATES, Array, ClosedForm
from .kinds import KINDS, Kind
from .study import Study

LIMIT = 1e-10
DRIVEN, PARTS = ("boundary", "tractions"), ("u", "stress", "reaction")

#: From t to the deformation gradient and the nominal stress.
Path = Callable[[float], tuple[Array, Array]]


def homogeneous(quick: bool = False) -> Study:
    """closed homogeneous states come out to 1e-10, whatever the simplices and however they are driven"""
    found = {place: _errors_of(*place, n=3 if quick else 6) for place in _places()}
    return Study(
        "Homogeneous states",
        f"displacements, stresses and reactions agree with closed forms to {LIMIT:g}",
        ("simplices", "state", *(f"{driven}: u" if part == "u" else part for driven in DRIVEN for part in PARTS)),
        tuple((*place, *(f"{error:.1e}" for error in errors)) for place, errors in found.items()),
        tuple(f"{', '.join(place)}: off by {max(errors):.1e}" for place, errors in found.items() if not max(errors) <= LIMIT),
        ("relative to the largest displacement, to the largest nominal stress, and to that times the volume or an area",),
    )


def _places() -> list[tuple[str, str]]:
    states = {name: dimensions for name, (_, dimensions) in STATES.items()}
    return [(name, state) for name, kind in KINDS.items() for state, dimensions in states.items() if kind.k in dimensions]


def _errors_of(kind: str, state: str, n: int) -> list[float]:
    """Errors of displacement, stress and reactions: by prescribed boundaries, then by tractions."""
    return [error for study in (by_boundary, by_tractions) for error in study(KINDS[kind], STATES[state][0], n)]


def by_boundary(kind: Kind, form: ClosedForm, n: int) -> tuple[float, float, float]:
    """Errors of displacement, stress and reactions where the whole boundary is displaced as in the closed form."""
    path = partial(form, kind.k, *kind.lame)
    components = {"xyz"[i]: partial(_displacement, kind, path, i) for i in range(kind.k)}
    system = System(kind.mesh(n), kind.term(), fixed=kind.across, prescribed={partial(_on_boundary, kind.k): components})
    result = solve_static(system, steps=2, rtol=1e-13, quiet=True)
    P, reaction = path(1.0)[1], result.reaction()
    moment = reaction.by_node[:, : kind.k].T @ reaction.rest[:, : kind.k] / kind.section  # sum f (x) X = V P
    return *_errors(kind, result, path), float(np.abs(moment - P).max() / np.abs(P).max())


def by_tractions(kind: Kind, form: ClosedForm, n: int) -> tuple[float, float, float]:
    """Errors where the nominal stress pulls at all faces and no more than rigid motions is held: then reactions vanish."""
    path = partial(form, kind.k, *kind.lame)
    faces = [(axis, side) for axis in range(kind.k) for side in (0.0, 1.0)]
    loads = [Traction(partial(_on_face, axis, side), partial(_traction, kind, path, axis, side)) for axis, side in faces]
    system = System(kind.mesh(n), [kind.term(), *loads], fixed=kind.statically_determinate)
    result = solve_static(system, steps=2, rtol=1e-13, quiet=True)
    largest = np.abs(path(1.0)[1]).max() * kind.section
    return *_errors(kind, result, path), float(np.abs(result.reaction().by_node).max() / largest)


def _errors(kind: Kind, result: StaticResult, path: Path) -> tuple[float, float]:
    """Errors of displacement and stress."""
    (F, P), x = path(1.0), result.system.mesh.p
    u = np.zeros_like(x)
    u[: kind.k] = (F - np.eye(kind.k)) @ x[: kind.k]
    off, stress = result.u.reshape(-1, kind.d).T - u, result.stress("pk1")[:, : kind.k, : kind.k]
    return float(np.abs(off).max() / np.abs(u).max()), float(np.abs(stress - P).max() / np.abs(P).max())


def _displacement(kind: Kind, path: Path, component: int, x: Array, t: float) -> Array:
    moved: Array = ((path(t)[0] - np.eye(kind.k)) @ x[: kind.k])[component]
    return moved


def _traction(kind: Kind, path: Path, axis: int, side: float, t: float) -> Array:
    return np.pad(path(t)[1][:, axis] * (1 if side else -1), (0, kind.d - kind.k))


def _on_face(axis: int, side: float, x: Array) -> Any:
    return x[axis] == side


def _on_boundary(k: int, x: Array) -> Any:
    return ((x[:k] == 0) | (x[:k] == 1)).any(axis=0)
