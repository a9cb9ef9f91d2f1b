"""Study of the buckled column: the elastica under a dead load along the initial axis, in elliptic integrals.

With alpha the angle of the tangent at the head, k = sin(alpha/2), K and E the complete elliptic integrals of modulus k:

    P/P_E = (2 K/pi)^2        head at  x/L = 2 E/K - 1,  y/L = 2 k/K

The mesh contains a small part of the buckling mode as an imperfection, so that the path leads to the buckled states. A body of
height h differs from the elastica by the order (h/L)^2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ellipe, ellipk

from skfem_stvk import ElementMesh
from skfem_stvk.solvers.statics import StaticResult, Stop

from ..statics.meshes import Array
from ..statics.orders import extrapolated
from ..study import Study
from .column import LENGTH, Column
from .limit_points import Convergence, through

SLENDER, FINE = (20, 40), (2, 4, 8)
#: Angles of the head [degrees] for the comparison. Columns and elastica are compared at equal shortening.
ANGLES = (40, 80, 120)
#: Initial deflection of the head in the mesh [m]. The relative change of the loads on the branch has the same size.
IMPERFECTION = 1e-4
#: Limits for the more slender column after extrapolation over meshes, whose error is a few times (h/L)^2, and for the extrapolation
#: of both columns to a thin one.
LIMIT, THIN_LIMIT = 1e-2, 1e-3
LANDED = 1e-9  # tolerance of the shortening, relative to the length


class Head(NamedTuple):
    """State of the head: load divided by Euler's load, shortening and deflection divided by the length."""

    load: float
    shortening: float
    deflection: float


def elastica(angle: float) -> Head:
    """Return the state of the elastica with this angle of the tangent at the head [degrees].

    >>> elastica(60)
    Head(load=1.1517196204691387, shortening=0.258980393923673, deflection=0.5932076461648851)
    """
    k = np.sin(np.radians(angle) / 2)
    K, E = ellipk(k**2), ellipe(k**2)
    return Head(float((2 * K / np.pi) ** 2), float(2 - 2 * E / K), float(2 * k / K))


def post_buckling(quick: bool = False) -> Study:
    """buckled columns follow the elastica up to an angle of 120 degrees, within 1 % after extrapolation for L/h >= 40"""
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
    return Study(
        "Post-buckled column",
        f"extrapolated values within {LIMIT:.0%} of the elastica at L/h = {SLENDER[-1]}, within {THIN_LIMIT:.1%} for thin columns; "
        "errors of the load decrease under refinement",
        ("head's angle", "of head", *(f"{body.fine} through h" for body in bodies[0]), "extrapolated", "elastica", "off"),
        tuple(rows),
        tuple(failures),
        (
            "load divided by Euler's load, deflection divided by the length, at the elastica's shortening; imperfection: the mode "
            "times 1e-4 of the length",
        ),
    )


def _row(name: str, what: str, values: Sequence[str], limit: float, truth: float) -> tuple[str, ...]:
    return name, what, *values, f"{limit:.5f}", f"{truth:.5f}", f"{limit / truth - 1:+.3%}"


def _failures(what: str, found: Convergence, thin: float) -> Iterator[str]:
    """Yield messages about contradictions to the claims on the more slender column and on thin columns."""
    if not abs(found.limit / found.truth - 1) <= LIMIT:
        yield f"{what} = {found.limit:.5f}; expected {found.truth:.5f}, the elastica"
    if not abs(thin / found.truth - 1) <= THIN_LIMIT:
        yield f"{what} of thin columns = {thin:.5f}; expected {found.truth:.5f}, the elastica"
    errors = np.abs(np.asarray(found.values) - found.truth)
    if what == "load" and not (errors[1:] < errors[:-1]).all():
        yield "the error of the load does not decrease under refinement"


def branch(body: Column) -> list[StaticResult]:
    """Return the paths of a column with an imperfection to the shortenings, each starting at the end of the previous path."""
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
    """Return the state of the middle of the head."""
    x, y = u.reshape(-1, 2)[body.middle()[-1]] / LENGTH
    return Head(t, float(-x), float(y))
