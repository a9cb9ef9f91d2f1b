"""A run of the benchmark, from first to last."""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from time import perf_counter

from ..arguments import flag, shown
from ..errors import StvkError
from ..peers import PEERS
from ..peers.peer import PACKAGES
from ..referee.header import PACKAGES as OWN
from ..referee.header import machine, versions
from ..referee.progress import Progress
from .case import Case
from .contenders import time_contenders
from .errors import compare_errors
from .holding import weigh
from .others import leave_out, time_peers, time_reference
from .plan import FULL, Plan
from .results import Benchmark
from .start import first_use, time_setup
from .traffic import copy_bandwidth

STEPS: dict[str, Callable[[Benchmark, Case], None]] = {
    "this package, the C loop, a CSR product": time_contenders,
    "setup": time_setup,
    "memory": weigh,
    "scikit-fem, the textbook form": time_reference,
    "peers": time_peers,
}


def bench(plan: Plan = FULL, quiet: bool = False) -> Benchmark:
    """Measure what the plan says.

    What is not to be had here is listed as not measured, what goes wrong as a failure; Ctrl-C leaves the steps that were finished.

    Raises
    ------
    StvkError
        if the plan is none.
    """
    if not isinstance(plan, Plan):
        raise StvkError(f"plan = {shown(plan)}; expected FULL, QUICK or a Plan(...).")
    quiet = flag("quiet", quiet)
    results = Benchmark(plan, _header())
    cases = [Case(kind, size) for kind, sizes in (("box", plan.boxes), ("part", plan.parts)) for size in sizes]
    begin = perf_counter()
    leave_out(results, list(PEERS))
    try:
        with Progress("bench", 3 + len(cases) * (1 + len(STEPS)) + plan.first_use, quiet) as progress:
            _run(results, cases, progress)
    except KeyboardInterrupt:
        results.interrupted = True
    results.seconds = perf_counter() - begin
    return results


def _run(results: Benchmark, cases: list[Case], progress: Progress) -> None:
    def attempt(what: str, step: Callable[[], None]) -> None:
        progress.step(what)
        results.attempt(what, step)

    attempt("speed of a copy", lambda: setattr(results, "bandwidth", copy_bandwidth()))
    for case in cases:
        attempt(f"{case.name}: mesh", partial(_mesh, results, case))
        for what, step in STEPS.items():
            if case.name in results.meshes:
                attempt(f"{case.name}: {what}", partial(step, results, case))
            else:
                progress.step(what)
    if "box" in {case.kind for case in cases}:
        attempt("errors", partial(compare_errors, results, cases[0]))
    if results.plan.first_use:
        attempt("first use", lambda: setattr(results, "first_use", first_use()))
    else:
        results.not_measured["first use"] = "left to the full run"


def _mesh(results: Benchmark, case: Case) -> None:
    mesh = results.optional(case.name, lambda: case.mesh)
    if mesh is not None:
        results.meshes[case.name] = {"nt": mesh.nt, "nv": mesh.nv}


def _header() -> dict[str, object]:
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "versions": versions((*OWN[:4], "numba", *(package.distribution for package in PACKAGES.values()))),
        "machine": machine(),
    }
