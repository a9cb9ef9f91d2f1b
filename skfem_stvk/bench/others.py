"""scikit-fem's assembly, the textbook form and the peers that are installed: each on one thread."""

from __future__ import annotations

from functools import partial
from typing import Any

from ..mesh import SimplexMesh
from ..peers import load, module_of
from ..peers.peer import PACKAGES
from ..reference import ReferenceStVK, isotropic_tensor
from .case import POISSON, YOUNG, Case
from .contenders import METHODS
from .results import REFERENCE, TEXTBOOK, Benchmark
from .textbook import Textbook
from .timing import best_and_median, threads


def reference_on(mesh: SimplexMesh) -> ReferenceStVK:
    """scikit-fem's standard assembly of the benchmark's material."""
    return ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(YOUNG, POISSON, 3, False))


def time_reference(results: Benchmark, case: Case) -> None:
    """scikit-fem's W, F and K, and the textbook form's F in both precisions."""
    if case.size not in results.plan.referenced:
        return
    for dtype in ("float64", "float32"):
        form, u = Textbook(case.mesh, case.term, dtype), case.u.astype(dtype)
        (taken,) = best_and_median({"F": partial(form.internal_force, u)}, results.plan.seconds).values()
        results.add(case, TEXTBOOK, "F", taken, dtype=dtype)
    _time(results, case, REFERENCE, reference_on(case.mesh))


def time_peers(results: Benchmark, case: Case) -> None:
    """Each peer that the plan times on this mesh and that is installed."""
    for name, meshes in results.plan.peers.items():
        if case.name not in meshes or name in results.not_measured:
            continue
        results.attempt(f"{case.name}: {name}", partial(_time_peer, results, case, name))


def _time_peer(results: Benchmark, case: Case, name: str) -> None:
    model = results.optional(name, partial(peer_on, name, case.mesh))
    if model is not None:
        _time(results, case, name, model)


def peer_on(name: str, mesh: SimplexMesh) -> Any:
    """A peer of the benchmark's material.

    Raises
    ------
    StvkError
        if it is not installed.
    """
    return load(name)(mesh.p, mesh.t, YOUNG, POISSON)


def leave_out(results: Benchmark, names: list[str]) -> None:
    """Say which peers the plan does not time, and how those that are missing are installed."""
    for name in names:
        package = PACKAGES[module_of(name)]
        if package.version() is None:
            results.not_measured[name] = f"not installed: {package.install}"
        elif name not in results.plan.peers:
            results.not_measured[name] = "left to the full run"


def _time(results: Benchmark, case: Case, player: str, model: Any) -> None:
    calls = {what: partial(getattr(model, name), case.u) for what, name in METHODS.items() if hasattr(model, name)}
    with threads(1):
        for quantity, taken in best_and_median(calls, results.plan.seconds).items():
            results.add(case, player, quantity, taken)
