"""Hostile inputs: files, arguments, candidates, surroundings and kills that must end in a right result or an error in words."""

from __future__ import annotations

from collections.abc import Sequence

#: Families of cases, and the modules that have them as `cases()`.
FAMILIES = {
    "meshes": "validation.hostile.meshes",
    "physics": "validation.hostile.physics",
    "checkpoints": "validation.hostile.checkpoints",
    "interruptions": "validation.hostile.interruptions",
    "names": "validation.hostile.names",
    "commands": "validation.hostile.commands",
    "scenes": "validation.hostile.scenes",
    "candidates": "validation.hostile.candidates",
    "arguments": "validation.hostile.arguments",
}
NAMES = tuple(FAMILIES)


def main(quick: bool = False, only: Sequence[str] = (), case: Sequence[str] = ()) -> int:
    """hostile inputs in child processes: no raw traceback, no silent acceptance, no hang, no crash, no loss"""
    from .study import run

    return run(only or NAMES, case, quick)


__all__ = ["FAMILIES", "NAMES", "main"]
