"""Fast, large swings with eq. 9: number of blow-ups and of runs with inverted elements, with the exact and the clamped tangent.

The coarse bar of soft tissue of `swing`, with three stiffnesses, starts with four speeds. Steps are 1/60 s, with and without a
`VolumePenalty`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np

from skfem_stvk import System, VolumePenalty
from skfem_stvk.solvers.dynamics import LinearBackwardEuler, Run, Status, simulate

from ..statics.study import Study
from .scenes import expected
from .swing import PUSH, bar, push

#: Cells across the bar, stiffnesses [Pa], and initial speeds of its end [m/s].
CELLS, YOUNGS, SPEEDS = 3, (1e4, 3e4, 1e5), (2.0, 5.0, 10.0, 20.0)
QUICK_YOUNGS, QUICK_SPEEDS = (3e4,), (5.0, 10.0)
TANGENTS = "exact", "clamped"
DT, UNTIL = 1 / 60, 1.0


def fast_swings(quick: bool = False, folder: Path | None = None) -> Sequence[Study]:
    """Compare the number of fast, large swings with eq. 9 that blow up with the clamped and with the exact tangent."""
    swings = list(product(QUICK_YOUNGS if quick else YOUNGS, QUICK_SPEEDS if quick else SPEEDS))
    rows, blown = [], {}
    for volume, tangent in product((True, False), TANGENTS):
        runs = [swung(tangent, young, speed, volume) for young, speed in swings]
        blown[volume, tangent] = sum(run.status is Status.BLEW_UP for run in runs)
        inside_out = sum(bool(run.ledger["inside_out"].any()) for run in runs)
        rows.append((tangent, "yes" if volume else "no", str(len(runs)), str(blown[volume, tangent]), str(inside_out)))
    failures = [
        f"clamped, {'with' if volume else 'without'} the volume term: {blown[volume, 'clamped']} blew up; with the exact tangent "
        f"{blown[volume, 'exact']}"
        for volume in (True, False)
        if blown[volume, "clamped"] > blown[volume, "exact"]
    ]
    return (
        Study(
            "Fast, large swings with eq. 9",
            "at most as many swings blow up with the clamped tangent as with the exact tangent",
            ("tangent", "volume term", "swings", "blew up", "elements inside out on the way"),
            tuple(rows),
            tuple(failures),
            (
                f"{bar(CELLS)!r}; E = {', '.join(f'{young:g}' for young in YOUNGS)} Pa, pushed by "
                f"{', '.join(f'{speed:g}' for speed in SPEEDS)} m/s, steps of 1/60 s",
            ),
        ),
    )


def swung(tangent: str, young: float, speed: float, volume: bool) -> Run:
    """Return one swing until its end or blow-up."""
    plain = bar(CELLS, young)
    system = System(plain.mesh, [*plain.terms, VolumePenalty()], fixed={lambda x: x[2] == 0: "xyz"}) if volume else plain
    v0 = np.asarray(push(CELLS)) * speed / PUSH
    with expected():
        return simulate(system, LinearBackwardEuler(dt=DT, tangent=tangent), until=UNTIL, v0=v0, quiet=True, raise_on_failure=False)
