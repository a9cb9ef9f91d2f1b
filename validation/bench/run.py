"""Execution of a benchmark plan."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter

from skfem_stvk.about import PACKAGES, circumstances
from skfem_stvk.referee.peers import PEERS
from skfem_stvk.terminal import CountedProgress

from .contenders import compare_errors, leave_out, time_contenders, time_models, time_peers, time_reference
from .costs import copy_bandwidth, first_use, time_setup, weigh
from .meshes import Specimen
from .results import FULL, Benchmark, Plan

STEPS: dict[str, Callable[[Benchmark, Specimen], None]] = {
    "this package, the C loop, a CSR product": time_contenders,
    "setup": time_setup,
    "memory": weigh,
    "scikit-fem, the textbook form": time_reference,
    "models": time_models,
    "peers": time_peers,
}


def bench(plan: Plan = FULL, quiet: bool = False) -> Benchmark:
    """Run all measurements of the plan and return the results.

    Codes that are not available on this machine are listed as not measured, and errors as failures. Ctrl-C ends the run and keeps
    the results of finished steps.
    """
    results = Benchmark(plan, circumstances((*PACKAGES[:5], *(package.distribution for package in PEERS.values()))))
    specimens = [Specimen(kind, size) for kind, sizes in (("box", plan.boxes), ("part", plan.parts)) for size in sizes]
    begin = perf_counter()
    leave_out(results)
    try:
        with CountedProgress("bench", 3 + len(specimens) * (1 + len(STEPS)) + plan.first_use, quiet) as progress:
            _run(results, specimens, progress)
    except KeyboardInterrupt:
        results.interrupted = True
    results.seconds = perf_counter() - begin
    return results


def _run(results: Benchmark, specimens: list[Specimen], progress: CountedProgress) -> None:
    def attempt(what: str, step: Callable[[], None]) -> None:
        progress.step(what)
        results.attempt(what, step)

    attempt("speed of a copy", lambda: setattr(results, "bandwidth", copy_bandwidth()))
    for specimen in specimens:
        attempt(f"{specimen.name}: mesh", partial(_mesh, results, specimen))
        for what, step in STEPS.items():
            if specimen.name in results.meshes:
                attempt(f"{specimen.name}: {what}", partial(step, results, specimen))
            else:
                progress.step(what)
    if "box" in {specimen.kind for specimen in specimens}:
        attempt("errors", partial(compare_errors, results, specimens[0]))
    if results.plan.first_use:
        attempt("first use", lambda: setattr(results, "first_use", first_use()))
    else:
        results.not_measured["first use"] = "left to the full run"


def _mesh(results: Benchmark, specimen: Specimen) -> None:
    mesh = results.optional(specimen.name, lambda: specimen.mesh)
    if mesh is not None:
        results.meshes[specimen.name] = {"nt": mesh.nt, "nv": mesh.nv}
