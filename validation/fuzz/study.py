"""Long run: families alternate in chunks with seeds of their own, so that each failure can be repeated."""

from __future__ import annotations

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

from ..limits import limited
from .bodies import check_body, recipes, touching
from .files import mesh_files, read_damaged_mesh, read_damaged_scene, scene_files
from .programs import programs, run_program
from .solves import check_motion, check_solve, motions, solves

#: Number of cases of a family per chunk, and the time limit of a case [s], most of which is the compilation of kernels.
CHUNK, LONGEST = 250, 120.0


def families(folder: Path) -> dict[str, tuple[Any, Callable[[Any], bool]]]:
    """Return strategies and checks by family.

    A check returns False if a case was refused with a clear error, and raises an exception if it is wrong.
    """
    return {
        "bodies": (recipes(), check_body),
        "larger bodies": (recipes(largest=8), check_body),
        "programs": (programs(), lambda drawn: run_program(*drawn)),
        "solves": (solves(), check_solve),
        "motions": (motions(), check_motion),
        "contacts": (touching(), check_body),
        "contact programs": (programs(touching(2)), lambda drawn: run_program(*drawn)),
        "contact solves": (solves(touching()), check_solve),
        "contact motions": (motions(touching()), check_motion),
        "mesh files": (mesh_files, lambda drawn: read_damaged_mesh(folder, *drawn)),
        "scene files": (scene_files, lambda drawn: read_damaged_scene(folder, *drawn)),
    }


#: Slow families run only in every n-th round; the other families run in each round.
EVERY = {"bodies": 2, "larger bodies": 10, "programs": 2, "solves": 10, "motions": 10}
EVERY |= {"contacts": 2, "contact programs": 10, "contact solves": 10, "contact motions": 10}


def run(cases: int, seconds: float | None, first: int) -> int:
    """Run chunks until the number of cases or the time is reached; print the counts and every failure."""
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
    """Run `size` cases; return the smallest wrong case in words, or an empty string."""
    smallest: dict[str, str] = {}

    def one(case: Any) -> None:
        counts["cases"] += not smallest  # without the cases with which Hypothesis shrinks a wrong one
        try:
            counts["went through" if limited(partial(check, case), LONGEST) else "refused"] += not smallest
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


def table(counts: dict[str, Counter[str]]) -> Table:
    """Return the table of counts by family."""
    heads = ("cases", "went through", "refused")
    shown = grid("How random cases ended", "family", *heads, right=heads)
    for name, count in counts.items():
        shown.add_row(name, *(f"{count[head]}" for head in heads))
    return shown
