"""Hostile inputs: files, arguments, candidates, environments and kills. Each must end in a correct result or a readable error."""

from __future__ import annotations

from collections.abc import Sequence

#: Families of cases, and the modules whose function `cases()` yields them.
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
    """run hostile inputs in child processes: no raw traceback, no silent acceptance, no hang, no crash, no loss"""
    from .study import run

    return run(only or NAMES, case, quick)


__all__ = ["FAMILIES", "NAMES", "main"]
