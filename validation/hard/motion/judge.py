"""Whether a method was right about a motion: by where the body is and what energy it has, whatever the method says of it."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from skfem_stvk import System

from ..case import Array
from ..judge import FLAT, Judgement, Verdict, volume_ratios
from .endings import LIMIT
from .scene import Ending

#: How a method says that elements were inside out on the way, and that its steps lost or gained energy; what no words admit.
INSIDE_OUT, ENERGY, NOTHING = "inside out", r"(lost|gained) \d+ % of the energy", r"(?!)"


class Fault(NamedTuple):
    """What speaks against a state, and a pattern of the words that admit it."""

    what: str
    words: str


def judged(system: System, u: Array, v: Array, claims_success: bool, said: str, ending: Ending) -> Judgement:
    """The verdict on the last state (ndofs,) of a method that reached the end, or did not; `said` is its message: a warning is
    gone by then.

    A fault that it has said itself is none of being wrong, but for elements that are inside out in the end: no words make that a
    success.
    """
    if not claims_success:
        return Judgement(Verdict.SAID_SO, said)
    faults = faults_of(system, u, v, ending)
    if not faults:
        return Judgement(Verdict.RIGHT, "")
    admitted = all(re.search(fault.words, said) for fault in faults)
    why = ", ".join(fault.what for fault in faults)
    return Judgement(Verdict.SAID_SO if admitted else Verdict.WRONG, why)


def faults_of(system: System, u: Array, v: Array, ending: Ending) -> list[Fault]:
    """What speaks against a last state."""
    if not (np.isfinite(u).all() and np.isfinite(v).all()):
        return [Fault("not finite", NOTHING)]
    turned = int((volume_ratios(system, u) <= FLAT).sum())
    if turned:
        return [Fault(f"{turned} elements inside out", NOTHING)]
    if ending.error is None:
        return [Fault("no right motion", f"{INSIDE_OUT}|{ENERGY}")]
    faults: list[Fault] = []
    if ending.energy is not None and not abs(excess := ending.energy(system, u, v)) <= LIMIT:
        faults.append(Fault(f"energy {excess:+.0%}", ENERGY))
    if not (error := ending.error(system, u)) <= ending.limit:
        faults.append(Fault(f"off by {error:.0%}", f"{INSIDE_OUT}|{ENERGY}"))
    return faults
