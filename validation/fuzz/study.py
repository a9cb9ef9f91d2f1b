"""The long run: families in turn, in chunks with seeds of their own, so that each failure can be run again."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from rich.console import Console
from rich.table import Table

from skfem_stvk.terminal import WIDTH, grid

from .bodies import check_body, recipes
from .files import mesh_files, read_damaged_mesh, read_damaged_scene, scene_files
from .programs import programs, run_program
from .solves import check_motion, check_solve, motions, solves

#: Cases of a family at a time, and how long one may take [s]: the first ones compile kernels, which is most of it.
CHUNK, LONGEST = 250, 120.0


class Hang(Exception):
    """A case took too long."""


def families(folder: Path) -> dict[str, tuple[Any, Callable[[Any], bool]]]:
    """What is drawn, and what is asked of it: False if it was refused with a clear error, an exception if it is wrong."""
    return {
        "bodies": (recipes(), check_body),
        "larger bodies": (recipes(largest=8), check_body),
        "programs": (programs(), lambda drawn: run_program(*drawn)),
        "solves": (solves(), check_solve),
        "motions": (motions(), check_motion),
        "mesh files": (mesh_files, lambda drawn: read_damaged_mesh(folder, *drawn)),
        "scene files": (scene_files, lambda drawn: read_damaged_scene(folder, *drawn)),
    }


#: Of a family that is slow only every so many chunks.
EVERY = {"bodies": 2, "larger bodies": 10, "programs": 2, "solves": 10, "motions": 10}


def run(cases: int, seconds: float | None, first: int) -> int:
    """Run chunks until there are so many cases, or the time is over; print the counts and every failure."""
    console, begin = Console(width=WIDTH, highlight=False), perf_counter()
    counts: dict[str, Counter[str]] = {}
    failures: list[str] = []
    with TemporaryDirectory() as folder:
        todo, number = families(Path(folder)), 0
        for name in todo:
            counts[name] = Counter()
        while not (sum(c["cases"] for c in counts.values()) >= cases or (seconds and perf_counter() - begin > seconds)):
            for name, (drawn, check) in todo.items():
                if number % EVERY.get(name, 1) == 0:
                    failure = chunk(drawn, check, first + number, min(CHUNK, max(1, cases // len(todo))), counts[name])
                    if failure:
                        failures.append(f"{name}, seed {first + number}: {failure}")
                        console.print(f"[bold red]wrong[/] {name}, seed {first + number}", soft_wrap=True)
                        console.print(failure, markup=False, soft_wrap=True)
            number += 1
            console.print(f"[dim]{perf_counter() - begin:6.0f} s, {sum(c['cases'] for c in counts.values())} cases[/]")
    console.print(table(counts))
    total = sum(c["cases"] for c in counts.values())
    console.print(f"{total} cases in {perf_counter() - begin:.0f} s from seed {first}: {len(failures) or 'none'} wrong")
    return 1 if failures else 0


def chunk(drawn: Any, check: Callable[[Any], bool], number: int, size: int, counts: Counter[str]) -> str:
    """Run so many cases; the smallest one that is wrong, in words, or nothing."""
    smallest: dict[str, str] = {}

    def one(case: Any) -> None:
        counts["cases"] += not smallest  # not those that Hypothesis makes to shrink one that is wrong
        try:
            counts["went through" if limited(partial(check, case)) else "refused"] += not smallest
        except Exception as error:
            smallest["case"] = f"{case!r}\n{type(error).__name__}: {error}"
            raise

    asked = settings(
        max_examples=size,
        database=None,
        deadline=None,
        derandomize=False,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )
    try:
        seed(number)(asked(given(drawn)(one)))()
    except Exception as error:
        return smallest.get("case", f"{type(error).__name__}: {error}")
    return ""


def limited(call: Callable[[], bool]) -> bool:
    """The call, ended by an exception if it takes too long, where the system has alarms."""
    if not hasattr(signal, "SIGALRM"):
        return call()
    before = signal.signal(signal.SIGALRM, _alarm)
    signal.setitimer(signal.ITIMER_REAL, LONGEST, LONGEST)  # again: an exception in a callback of the garbage collector is lost
    try:
        return call()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _alarm(*_: Any) -> None:
    raise Hang(f"no answer within {LONGEST:g} s")


def table(counts: dict[str, Counter[str]]) -> Table:
    """Counts by family."""
    heads = ("cases", "went through", "refused")
    shown = grid("How random cases ended", "family", *heads, right=heads)
    for name, count in counts.items():
        shown.add_row(name, *(f"{count[head]}" for head in heads))
    return shown
