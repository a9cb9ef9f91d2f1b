"""Findings on the contacts of a motion: deep penetrations, and contacts that few steps resolve."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..arguments import shown
from ..results.monitors import Finding
from ..system import System
from ..terms.protocols import CanPenetrate
from .ledger import Ledger

#: Depth in mean edges of the facets above which a contact is too soft: a pressed ball then has lost 10 % of its force.
DEEP = 0.05
#: Number of steps below which a contact is too short: energy-momentum has the largest depth to 3 % in 5 steps, to 17 % in 2.
SHORT = 5


def start_within(system: System, ledger: Ledger) -> str:
    """Return a sentence on rigid shapes in which the body is deep at the start; empty after the first step."""
    if len(ledger["time"]) != 1:
        return ""
    contacts = [term for term in system.contacts if isinstance(term, CanPenetrate)]
    deep = [shown(one.name) for one in contacts if ledger[f"contact {one.name} gap"][0] < -DEEP * one.edge]
    return (
        f" The body starts within the shape of {', '.join(deep)}: check the position and the normal of the shape." if deep else ""
    )


def contact_findings(system: System, ledger: Ledger) -> Iterator[Finding]:
    """Yield the findings "deep contact" and "short contact" on rigid contacts, from the gaps in the ledger of a motion."""
    times, m, s = ledger["time"], system.units.of("m"), system.units.of("s")
    for contact in (term for term in system.contacts if isinstance(term, CanPenetrate)):
        gaps = ledger[f"contact {contact.name} gap"]
        deepest = int(gaps.argmin())
        if (depth := -gaps[deepest] / contact.edge) > DEEP:
            what = (
                f"points are up to {-gaps[deepest]:.3g} {m} deep in the shape, at t = {times[deepest]:.4g} {s}: {depth:.2g} of the "
                f"mean edge of the facets; expected at most {DEEP:g}, because forces are too small and last too long. Take a "
                "larger stiffness."
            )
            yield _finding("deep contact", contact.name, depth, what)
        change = np.diff((gaps < 0).astype(np.int8))
        begin, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        end = end[end > begin[0]] if len(begin) else end[:0]  # of contacts that begin and end during the motion
        begin = begin[: len(end)]
        lengths = end - begin
        if len(short := np.flatnonzero(lengths < SHORT)):
            what = (
                f"{len(short)} of {len(lengths)} contacts last fewer than {SHORT} steps, the first from t = "
                f"{times[begin[short[0]] + 1]:.4g} {s} on; the shortest has {lengths.min()}. Steps do not resolve their forces. "
                "Take a smaller dt, a smaller stiffness, or an onset."
            )
            yield _finding("short contact", contact.name, float(lengths.min()), what)


def _finding(name: str, contact: str, extreme: float, what: str) -> Finding:
    return Finding(name, np.empty(0, dtype=np.int64), float(extreme), f"contact {contact!r}: {what}")
