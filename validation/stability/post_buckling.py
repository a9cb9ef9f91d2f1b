"""Euler's column after it has buckled: the elastica under a dead load along its axis, in elliptic integrals.

With alpha the angle of its head's tangent, k = sin(alpha/2), K and E the complete elliptic integrals of modulus k:

    P/P_E = (2 K/pi)^2        head at  x/L = 2 E/K - 1,  y/L = 2 k/K

A small part of the buckling mode, added to the mesh, leads from the straight path to this one. A body of height h differs by
(h/L)^2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import ellipe, ellipk

from skfem_stvk import ElementMesh
from skfem_stvk.statics import StaticResult, Stop

from ..statics.meshes import Array
from ..statics.orders import extrapolated
from .column import LENGTH, Column
from .limit_points import Convergence, through
from .picture import Curve, Drawn, Panel

SLENDER, FINE = (20, 40), (2, 4, 8)
#: Angles of the head [degrees] at which columns and elastica are compared, by the shortening.
ANGLES = (40, 80, 120)
#: Deflection of the head that the mesh begins with [m]: on the branch it changes loads by as much, relatively.
IMPERFECTION = 1e-4
#: The more slender one, extrapolated over meshes: (h/L)^2 times a few is left. And both, extrapolated to a thin one.
LIMIT, THIN_LIMIT = 1e-2, 1e-3
LANDED = 1e-9  # how well the shortening is met, by length


class Head(NamedTuple):
    """A point of the elastica: load in Euler's, shortening and deflection of the head by length."""

    load: float
    shortening: float
    deflection: float


def elastica(angle: float) -> Head:
    """With the head's tangent at this angle [degrees].

    >>> elastica(60)
    Head(load=1.1517196204691387, shortening=0.258980393923673, deflection=0.5932076461648851)
    """
    k = np.sin(np.radians(angle) / 2)
    K, E = ellipk(k**2), ellipe(k**2)
    return Head(float((2 * K / np.pi) ** 2), float(2 - 2 * E / K), float(2 * k / K))


def post_buckling(quick: bool = False) -> Drawn:
    """buckled columns follow the elastica up to an angle of 120 degrees, extrapolated within 1 % from L/h = 40 on"""
    bodies = [[Column(slenderness, n) for n in (FINE[:2] if quick else FINE)] for slenderness in SLENDER]
    paths = [[branch(body) for body in several] for several in bodies]
    rows, failures = [], []
    for i, angle in enumerate(ANGLES):
        exact = elastica(angle)
        heads = [
            [head(body, path[i].u, path[i].t) for body, path in zip(*both, strict=True)] for both in zip(bodies, paths, strict=True)
        ]
        if not all(abs(one.shortening - exact.shortening) <= LANDED for several in heads for one in several):
            failures.append(f"{angle} degrees: not all paths end at the shortening {exact.shortening:.5f}")
        for what in ("load", "deflection"):
            truth = getattr(exact, what)
            found = [Convergence([getattr(one, what) for one in several], truth) for several in heads]
            thin = extrapolated([one.limit for one in found])
            for slenderness, one in zip(SLENDER, found, strict=True):
                rows.append(
                    _row(f"{angle}°, L/h = {slenderness}", what, [f"{value:.5f}" for value in one.values], one.limit, truth)
                )
            rows.append(_row(f"{angle}°, thin", what, [""] * len(bodies[0]), thin, truth))
            failures += [f"{angle} degrees: {problem}" for problem in _failures(what, found[-1], thin)]
    return Drawn(
        "Post-buckled column",
        f"extrapolated within {LIMIT:.0%} of the elastica at L/h = {SLENDER[-1]}, within {THIN_LIMIT:.1%} for thin ones; finer "
        "meshes are closer",
        ("head's angle", "of head", *(f"{body.fine} through h" for body in bodies[0]), "extrapolated", "elastica", "off"),
        tuple(rows),
        tuple(failures),
        (
            "load in Euler's, deflection by length, at the elastica's shortening; imperfection: 1e-4 of the length in the mode's "
            "shape",
        ),
        panel=partial(_panel, bodies[-1][-1], paths[-1][-1]),
    )


def _row(name: str, what: str, values: Sequence[str], limit: float, truth: float) -> tuple[str, ...]:
    return name, what, *values, f"{limit:.5f}", f"{truth:.5f}", f"{limit / truth - 1:+.3%}"


def _failures(what: str, found: Convergence, thin: float) -> Iterator[str]:
    """What contradicts the claims on the more slender column and on thin ones."""
    if not abs(found.limit / found.truth - 1) <= LIMIT:
        yield f"{what} {found.limit:.5f}, elastica {found.truth:.5f}"
    if not abs(thin / found.truth - 1) <= THIN_LIMIT:
        yield f"{what} of thin columns {thin:.5f}, elastica {found.truth:.5f}"
    errors = np.abs(np.asarray(found.values) - found.truth)
    if what == "load" and not (errors[1:] < errors[:-1]).all():
        yield "the load does not come closer on finer meshes"


def branch(body: Column) -> list[StaticResult]:
    """The paths to each of the shortenings, one after the other, and before them to a slightly bent column."""
    mesh, critical = body.mesh(), body.buckled()
    bent = ElementMesh(mesh.p + IMPERFECTION * critical.mode.reshape(-1, 2).T, mesh.t)
    system, end = body.system(bent), [int(body.middle()[-1])]
    parts: list[StaticResult] = []
    for angle in ANGLES:
        stop = Stop(displacement=(end, "x", -elastica(angle).shortening * LENGTH))
        start = {"u0": parts[-1].u, "t0": parts[-1].t} if parts else {}
        parts.append(through(system, stop, steps=12, **start))
    return parts


def head(body: Column, u: Array, t: float) -> Head:
    """The middle of the head."""
    x, y = u.reshape(-1, 2)[body.middle()[-1]] / LENGTH
    return Head(t, float(-x), float(y))


def _panel(body: Column, parts: list[StaticResult]) -> Panel:
    exact = [elastica(angle) for angle in np.linspace(0.1, 125, 100)]
    buckles = body.buckled().t
    found = [head(body, step.u, step.t) for part in parts for step in part.history]
    loads = [one.load / buckles for one in found]
    return Panel(
        f"Euler's column, L/h = {body.slenderness}",
        ("deflection y/L and shortening u/L of the head", "P / load of the bifurcation"),
        (
            Curve([one.deflection for one in exact], [one.load for one in exact], "elastica: y/L"),
            Curve([one.shortening for one in exact], [one.load for one in exact], "elastica: u/L"),
        ),
        (
            Curve([one.deflection for one in found], loads, f"{body.mesh().nt} triangles, arc length: y/L"),
            Curve([one.shortening for one in found], loads, "u/L"),
        ),
        Curve([0.0], [1.0], "bifurcation"),
    )
