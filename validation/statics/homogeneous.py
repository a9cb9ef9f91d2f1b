"""Closed homogeneous states at finite strain on all kinds of simplices, by prescribed boundary displacements and by tractions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from skfem_stvk import System, Traction, solve_static
from skfem_stvk.solvers.statics import StaticResult

from ..study import Study
from .closed_states import STATES, Array, ClosedForm
from .kinds import KINDS, Kind

LIMIT = 1e-10
DRIVEN, PARTS = ("boundary", "tractions"), ("u", "stress", "reaction")

#: Function of t that returns the deformation gradient and the nominal stress.
Path = Callable[[float], tuple[Array, Array]]


def homogeneous(quick: bool = False) -> Study:
    """Compare homogeneous states with closed forms to 1e-10, on all kinds of simplices and for both ways of loading."""
    found = {case: _errors_of(*case, n=3 if quick else 6) for case in _cases()}
    return Study(
        "Homogeneous states",
        f"displacements, stresses and reactions agree with closed forms to {LIMIT:g}",
        ("simplices", "state", *(f"{driven}: u" if part == "u" else part for driven in DRIVEN for part in PARTS)),
        tuple((*case, *(f"{error:.1e}" for error in errors)) for case, errors in found.items()),
        tuple(f"{', '.join(case)}: off by {max(errors):.1e}" for case, errors in found.items() if not max(errors) <= LIMIT),
        ("errors relative to the largest displacement, the largest nominal stress, and this stress times the volume or an area",),
    )


def _cases() -> list[tuple[str, str]]:
    states = {name: dimensions for name, (_, dimensions) in STATES.items()}
    return [(name, state) for name, kind in KINDS.items() for state, dimensions in states.items() if kind.k in dimensions]


def _errors_of(kind: str, state: str, n: int) -> list[float]:
    """Return the errors of displacement, stress and reactions: first by prescribed boundaries, then by tractions."""
    return [error for study in (by_boundary, by_tractions) for error in study(KINDS[kind], STATES[state][0], n)]


def by_boundary(kind: Kind, form: ClosedForm, n: int) -> tuple[float, float, float]:
    """Return the errors of displacement, stress and reactions if the whole boundary has the displacements of the closed form."""
    path = partial(form, kind.k, *kind.lame)
    components = {"xyz"[i]: partial(_displacement, kind, path, i) for i in range(kind.k)}
    system = System(kind.mesh(n), kind.term(), fixed=kind.across, prescribed={partial(_on_boundary, kind.k): components})
    result = solve_static(system, steps=2, rtol=1e-13, quiet=True)
    P, reaction = path(1.0)[1], result.reaction()
    moment = reaction.by_node[:, : kind.k].T @ reaction.rest[:, : kind.k] / kind.section  # sum f (x) X = V P
    return *_errors(kind, result, path), float(np.abs(moment - P).max() / np.abs(P).max())


def by_tractions(kind: Kind, form: ClosedForm, n: int) -> tuple[float, float, float]:
    """Return the errors if the nominal stress acts on all faces. Only rigid motions are constrained, so reactions vanish."""
    path = partial(form, kind.k, *kind.lame)
    faces = [(axis, side) for axis in range(kind.k) for side in (0.0, 1.0)]
    loads = [Traction(partial(_on_face, axis, side), partial(_traction, kind, path, axis, side)) for axis, side in faces]
    system = System(kind.mesh(n), [kind.term(), *loads], fixed=kind.statically_determinate)
    result = solve_static(system, steps=2, rtol=1e-13, quiet=True)
    largest = np.abs(path(1.0)[1]).max() * kind.section
    return *_errors(kind, result, path), float(np.abs(result.reaction().by_node).max() / largest)


def _errors(kind: Kind, result: StaticResult, path: Path) -> tuple[float, float]:
    """Return the errors of displacement and stress."""
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
