"""Findings on contacts: points deep in a shape, bodies on its wrong side, thin shapes, short contacts, and friction that lags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ..arguments import Array, shown
from ..mesh.displacements import by_vertex
from ..system import System
from ..terms.loads.load import Moment, Time
from ..terms.loads.rigid_contact import BoundRigidContact, rigid
from .monitors import Finding

#: Depth in mean edges of the facets above which a contact is too soft: a pressed ball then has lost 10 % of its force.
DEEP = 0.05
#: Number of steps below which a contact is too short: energy-momentum has the largest depth to 3 % in 5 steps, to 17 % in 2.
SHORT = 5
#: Part of the largest friction that a change of the normal forces may add, and part of it in one direction if a body is dragged.
LAG, DRAGGED = 0.05, 0.5


def contact_findings_at(system: System, u: Array, t: Time) -> Iterator[Finding]:
    """Yield the findings on contacts at displacements `u` (ndofs,) and load factor `t`."""
    x = by_vertex(system.mesh, u)
    for contact in system.contacts_at(t):
        for one in rigid([contact]):
            yield from penetration(system, one, x, one.smallest_gap(x), "")
        if contact.has_friction:
            missing, largest = contact.missing_friction(x)
            resultant = float(np.linalg.norm(missing.sum(axis=0)))
            if resultant > max(LAG * largest, DRAGGED * np.linalg.norm(missing, axis=1).sum()):
                what = (
                    "friction in this state has the normal forces of the state before, and those of this state would change it by "
                    f"{resultant / largest:.2g} of its limit; expected at most {LAG:g}. Press first and drag in later steps, or "
                    "take more steps."
                )
                yield _finding("lagging friction", contact.name, resultant / largest, what)


def penetration(system: System, contact: BoundRigidContact, x: Array, gap: float, when: str) -> Iterator[Finding]:
    """Yield the findings "wrong side" at displacements `x` (nv, d), "deep contact" and "thin shape" at the smallest gap `gap` [m].

    `when` is the moment of this gap in words.
    """
    thickness, depth, m = contact.shape.thickness, -gap / contact.edge, system.units.of("m")
    if depth > DEEP and (within := contact.depth_within(x)) > 0:
        what = (
            f"no node of the body is outside the shape, and the deepest is {within:.3g} {m} within: the body is on the wrong side. "
            "Reverse the normal (inside=... of spheres and cylinders), or move the body."
        )
        yield _finding("wrong side", contact.name, within / contact.edge, what)
    elif depth > DEEP:
        what = (
            f"points are up to {-gap:.3g} {m} deep in the shape{when}: {depth:.2g} of the mean edge of the facets; expected at "
            f"most {DEEP:g}, because forces are then too small, and impacts too long. Take a larger stiffness."
        )
        yield _finding("deep contact", contact.name, depth, what)
    if thickness < contact.shortest_edge:
        what = (
            f"the shape is {thickness:.3g} {m} thin; expected at least the edges of the facets, {contact.shortest_edge:.3g} {m} "
            "for the smallest one, because a thinner shape may slip into the body between their points. Refine the surface there."
        )
        yield _finding("thin shape", contact.name, thickness / contact.shortest_edge, what)


def short_on_path(system: System, times: Array, states: Array) -> Iterator[Finding]:
    """Yield the findings on contacts that begin and end among `states` (n, ndofs) at load factors `times` (n,).

    Only shapes with another side count, because a body leaves the others where it came from.
    """
    remedy = "The body may have passed the shape: take more steps, a finer surface, or a larger stiffness."
    for contact in (one for one in rigid(system.contacts) if np.isfinite(one.shape.thickness)):
        at = (contact.at(Moment.of(t), None) for t in times)
        gaps = np.array([one.smallest_gap(by_vertex(system.mesh, u)) for one, u in zip(at, states, strict=True)])
        yield from short_contacts(contact, gaps, times, "", "states of the path", remedy)


def short_contacts(contact: BoundRigidContact, gaps: Array, times: Array, s: str, steps: str, remedy: str) -> Iterator[Finding]:
    """Yield the finding "short contact" on contacts that begin and end, from the smallest gaps (n,) [m] at `times` (n,) in `s`."""
    change = np.diff((gaps < 0).astype(np.int8))
    begin, end = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    end = end[end > begin[0]] if len(begin) else end[:0]
    begin = begin[: len(end)]
    lengths = end - begin
    if len(short := np.flatnonzero(lengths < SHORT)):
        what = (
            f"{len(short)} of {len(lengths)} contacts last fewer than {SHORT} {steps}, the first from t = "
            f"{times[begin[short[0]] + 1]:.4g}{s} on; the shortest has {lengths.min()}. {remedy}"
        )
        yield _finding("short contact", contact.name, float(lengths.min()), what)


def start_within(system: System, ledger: Mapping[str, Array]) -> str:
    """Return a sentence on rigid shapes in which the body is deep at the start; empty after the first step."""
    if len(ledger["time"]) != 1:
        return ""
    deep = [shown(one.name) for one in rigid(system.contacts) if ledger[f"contact {one.name} gap"][0] < -DEEP * one.edge]
    return (
        f" The body starts within the shape of {', '.join(deep)}: check the position and the normal of the shape." if deep else ""
    )


def contact_findings(system: System, ledger: Mapping[str, Array], u: Array, t: Time) -> Iterator[Finding]:
    """Yield the findings on rigid contacts of a motion with the last displacements `u` (ndofs,) at `t`."""
    times, x, s = ledger["time"], by_vertex(system.mesh, u), f" {system.units.of('s')}"
    remedy = "Steps do not resolve their forces. Take a smaller dt, a smaller stiffness, or an onset."
    for contact in rigid(system.contacts_at(t)):
        gaps = ledger[f"contact {contact.name} gap"]
        deepest = int(gaps.argmin())
        yield from penetration(system, contact, x, gaps[deepest], f", at t = {times[deepest]:.4g}{s}")
        yield from short_contacts(contact, gaps, times, s, "steps", remedy)


def _finding(name: str, contact: str, extreme: float, what: str) -> Finding:
    return Finding(name, np.empty(0, dtype=np.int64), float(extreme), f"contact {contact!r}: {what}")
