"""Findings on the contacts of a motion, from the gaps in its ledger."""

from __future__ import annotations

from collections.abc import Iterator

from ...arguments import Array, shown
from ...mesh.displacements import by_vertex
from ...results.monitors import Finding
from ...results.penetration import DEEP, penetration, short_contacts
from ...system import System
from ...terms.loads.load import Time
from ...terms.loads.rigid_contact import BoundRigidContact
from ..runs.ledger import Ledger


def start_within(system: System, ledger: Ledger) -> str:
    """Return a sentence on rigid shapes in which the body is deep at the start; empty after the first step."""
    if len(ledger["time"]) != 1:
        return ""
    contacts = [term for term in system.contacts if isinstance(term, BoundRigidContact)]
    deep = [shown(one.name) for one in contacts if ledger[f"contact {one.name} gap"][0] < -DEEP * one.edge]
    return (
        f" The body starts within the shape of {', '.join(deep)}: check the position and the normal of the shape." if deep else ""
    )


def contact_findings(system: System, ledger: Ledger, u: Array, t: Time) -> Iterator[Finding]:
    """Yield the findings on rigid contacts of a motion with the last displacements `u` (ndofs,) at `t`."""
    times, x, s = ledger["time"], by_vertex(system.mesh, u), f" {system.units.of('s')}"
    remedy = "Steps do not resolve their forces. Take a smaller dt, a smaller stiffness, or an onset."
    for contact in (term for term in system.contacts_at(t) if isinstance(term, BoundRigidContact)):
        gaps = ledger[f"contact {contact.name} gap"]
        deepest = int(gaps.argmin())
        yield from penetration(system, contact, x, gaps[deepest], f", at t = {times[deepest]:.4g}{s}")
        yield from short_contacts(contact, gaps, times, s, "steps", remedy)
