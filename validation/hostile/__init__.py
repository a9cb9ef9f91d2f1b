"""Hostile inputs: files, names, commands, candidates and arguments. Each must end in a correct result or a readable error."""

from __future__ import annotations

from collections.abc import Sequence

#: Families of cases, and the modules whose function `cases()` yields them.
FAMILIES = {
    "meshes": "validation.hostile.meshes",
    "stores": "validation.hostile.stores",
    "names": "validation.hostile.names",
    "commands": "validation.hostile.commands",
    "candidates": "validation.hostile.candidates",
    "arguments": "validation.hostile.arguments",
}
NAMES = tuple(FAMILIES)


def main(quick: bool = False, only: Sequence[str] = (), case: Sequence[str] = ()) -> int:
    """run hostile inputs with limits of time and memory: no raw traceback, no silent acceptance, no hang, no loss"""
    from .runner import run

    return run(only or NAMES, case, quick)


__all__ = ["FAMILIES", "NAMES", "main"]
