"""Verdict on a motion from its final state and energy, independent of the message of the method."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from skfem_stvk import System

from ..case import Array
from ..judge import FLAT, Judgement, Verdict, volume_ratios
from .endings import LIMIT
from .scene import Ending

#: Patterns of messages that report inverted elements on the way, or a loss or gain of energy; a pattern that never matches.
INSIDE_OUT, ENERGY, NOTHING = "inverted", r"(lost|gained) \d+ % of the energy", r"(?!)"


class Fault(NamedTuple):
    """Fault of a state, and the pattern of a message that reports it."""

    what: str
    words: str


def judged(system: System, u: Array, v: Array, claims_success: bool, said: str, ending: Ending) -> Judgement:
    """Return the verdict on the last state (ndofs,) of a method. `said` is its message.

    `claims_success` means that the method reached the end. A fault that the message reports is not counted as wrong. Inverted
    elements in the final state are an exception: no message makes them a success.
    """
    if not claims_success:
        return Judgement(Verdict.REPORTED, said)
    faults = faults_of(system, u, v, ending)
    if not faults:
        return Judgement(Verdict.RIGHT, "")
    admitted = all(re.search(fault.words, said) for fault in faults)
    why = ", ".join(fault.what for fault in faults)
    return Judgement(Verdict.REPORTED if admitted else Verdict.WRONG, why)


def faults_of(system: System, u: Array, v: Array, ending: Ending) -> list[Fault]:
    """Return the faults of a final state."""
    if not (np.isfinite(u).all() and np.isfinite(v).all()):
        return [Fault("not finite", NOTHING)]
    inverted = int((volume_ratios(system, u) <= FLAT).sum())
    if inverted:
        return [Fault(f"{inverted} elements inside out", NOTHING)]
    if ending.error is None:
        return [Fault("no right motion", f"{INSIDE_OUT}|{ENERGY}")]
    faults: list[Fault] = []
    if ending.energy is not None and not abs(excess := ending.energy(system, u, v)) <= LIMIT:
        faults.append(Fault(f"energy {excess:+.0%}", ENERGY))
    if not (error := ending.error(system, u)) <= ending.limit:
        faults.append(Fault(f"off by {error:.0%}", f"{INSIDE_OUT}|{ENERGY}"))
    return faults
