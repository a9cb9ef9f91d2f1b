"""Benchmark of time, memory and errors: this package and other codes in one run, judged by targets."""

from __future__ import annotations

import sys
from functools import partial

from skfem_stvk.errors import StvkError
from skfem_stvk.scenes.commands.referee import print_and_save, refuse_unwritable

from . import page
from .results import FULL, QUICK, Benchmark, Plan
from .run import bench

__all__ = ["FULL", "QUICK", "Benchmark", "Plan", "bench", "main"]


def main(quick: bool = False, out: str | None = None) -> int:
    """measure time, memory and errors of W, F, K and K v for this package and other installed codes; exit code 0 if all ran"""
    try:
        if out is not None:
            refuse_unwritable(out)
        return _measure(QUICK if quick else FULL, out)
    except (StvkError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _measure(plan: Plan, out: str | None) -> int:
    results = bench(plan)
    files = "benchmark.md, its pictures and benchmark.json"
    print_and_save(lambda width: page.rendered(results), page.WIDTH, partial(page.save, results), out, files)
    return 130 if results.interrupted else 1 if results.failures else 0
