"""Reduced models against full models, and membranes and cables against closed forms."""

from __future__ import annotations

from collections.abc import Sequence

from ..study import run

#: Modules and functions of the studies by name.
STUDIES = {
    "statics": "against_full.at_rest",
    "motion": "against_full.in_motion",
    "energy": "against_full.conserved_energy",
    "cable": "cables.hanging_cable",
    "net": "cables.cable_net",
    "sphere": "cables.inflated_sphere",
    "disc": "membranes.clamped_disc",
    "wrinkles": "membranes.sheared_sheet",
}
NAMES = tuple(STUDIES)


def main(quick: bool = False, only: Sequence[str] = ()) -> int:
    """Compare reduced bodies with full ones, and membranes and cables with closed forms."""
    return run(__name__, STUDIES, only or NAMES, quick)


__all__ = ["NAMES", "STUDIES", "main"]
