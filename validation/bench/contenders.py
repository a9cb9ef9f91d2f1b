"""Implementations of W, F, K and K v that one run compares: this package, a C loop, scikit-fem, the textbook form and other codes.

The timed calls alternate. The errors are relative to a computation in 50 digits.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from operator import matmul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skfem_stvk.errors import StvkError, StvkWarning
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.referee.checks.precision import Textbook, patch, relative_error
from skfem_stvk.referee.discretisation import Discretisation, Shape
from skfem_stvk.referee.exact import ExactStVK
from skfem_stvk.referee.implementations import METHODS
from skfem_stvk.referee.peers import PEERS, lame, load
from skfem_stvk.referee.reference import ReferenceStVK, isotropic_tensor
from skfem_stvk.system import System
from skfem_stvk.terms import Corotated, EdgeNetwork, InvertibleStVK, LinearElastic, NeoHookean, SpringNetwork

from .control import Control
from .costs import best_and_median, least_bytes, most_threads, threads
from .meshes import POISSON, YOUNG, Specimen
from .results import CONTROL, CSR, MODELS, OURS, REFERENCE, TEXTBOOK, Benchmark, ErrorOf

Calls = dict[tuple[str, str], Callable[[], Any]]

STRAINS = (1e-3, 1e-6)
#: Fraction of the specimen's deformation at which the models are timed. No element is inverted there.
MODEST = 0.2


def time_contenders(results: Benchmark, specimen: Specimen) -> None:
    """Time this package, the C loop and one CSR product with the same K.

    This package runs in both precisions, on one and two threads; the others run on one thread.
    """
    control = results.optional(CONTROL, partial(_control_calls, specimen))
    for dtype in ("float64", "float32"):
        body, u, v = System(specimen.mesh, specimen.term, dtype=dtype), specimen.u.astype(dtype), specimen.v.astype(dtype)
        for count in (1, 2):
            if count > most_threads():
                results.not_measured["2 threads"] = "numba has one thread here"
                continue
            with threads(count):
                calls, K = our_calls(body, u, v)
                if count == 1:
                    calls[CSR, "K v"] = partial(matmul, K, v)
                if count == 1 and dtype == "float64":
                    calls |= control or {}
                for (implementation, quantity), taken in best_and_median(calls, results.plan.seconds).items():
                    results.add(specimen, implementation, quantity, taken, count, dtype)
                if count == 1 and dtype == "float64":
                    results.least_bytes[specimen.name] = {what: n / specimen.mesh.nt for what, n in least_bytes(body, K).items()}


def our_calls(body: System, u: NDArray[Any], v: NDArray[Any]) -> tuple[Calls, Any]:
    """Return the calls of a system, and the matrix K that they overwrite."""
    K, operator = body.tangent(u), body.linear_operator(u)
    calls: dict[str, Callable[[], Any]] = {
        "W": partial(body.energy, u),
        "F": partial(body.internal_force, u),
        "W+F": partial(body.energy_and_force, u),
        "K": partial(body.tangent, u, out=K),
        "W+F+K": partial(body.linearize, u, out=K),
        "K v: prepare": partial(operator.prepare, u),
        "K v": partial(operator.matvec, v),
    }
    return {(OURS, quantity): call for quantity, call in calls.items()}, K


def _control_calls(specimen: Specimen) -> Calls:
    """Return the calls of the C loop. Raise StvkError if there is no compiler, or if the compiled loop cannot be used."""
    try:
        loop = Control(specimen.mesh.p, specimen.mesh.t, *lame(YOUNG, POISSON))
    except (OSError, np.linalg.LinAlgError) as error:
        raise StvkError(f"the C loop cannot be used ({error})") from error
    return {(CONTROL, quantity): partial(getattr(loop, method), specimen.u) for quantity, method in METHODS.items()}


def reference_on(mesh: ElementMesh) -> ReferenceStVK:
    """Return scikit-fem's standard assembly of the benchmark's material."""
    return ReferenceStVK(mesh.p, mesh.t, isotropic_tensor(YOUNG, POISSON, 3, False))


def time_reference(results: Benchmark, specimen: Specimen) -> None:
    """Time W, F and K of scikit-fem, and F of the textbook form in both precisions, on one thread."""
    if specimen.size not in results.plan.referenced:
        return
    for dtype in ("float64", "float32"):
        form, u = Textbook(specimen.term.bind(specimen.mesh).form, dtype), specimen.u.astype(dtype)
        (taken,) = best_and_median({"F": partial(form.internal_force, u)}, results.plan.seconds).values()
        results.add(specimen, TEXTBOOK, "F", taken, dtype=dtype)
    _time(results, specimen, REFERENCE, reference_on(specimen.mesh))


def time_peers(results: Benchmark, specimen: Specimen) -> None:
    """Time each peer that the plan names for this mesh and that is installed, on one thread."""
    for name, meshes in results.plan.peers.items():
        if specimen.name not in meshes or name in results.not_measured:
            continue
        results.attempt(f"{specimen.name}: {name}", partial(_time_peer, results, specimen, name))


def _time_peer(results: Benchmark, specimen: Specimen, name: str) -> None:
    model = results.optional(name, partial(peer_on, name, specimen.mesh))
    if model is not None:
        _time(results, specimen, name, model)


def peer_on(name: str, mesh: ElementMesh) -> Any:
    """Return a peer with the benchmark's material. Raise StvkError if the peer is not installed."""
    return load(name)(mesh.p, mesh.t, YOUNG, POISSON)


def time_models(results: Benchmark, specimen: Specimen) -> None:
    """Time W and F, and K, of other models of the same material on one thread, alternating with St. Venant-Kirchhoff's."""
    if specimen.size not in results.plan.referenced:
        return
    u = MODEST * specimen.u
    calls: Calls = {}
    with threads(1):
        for name, term in models_of(specimen).items():
            system = System(specimen.mesh, term)
            calls[name, "W+F"] = partial(system.energy_and_force, u)
            calls[name, "K"] = partial(system.tangent, u, out=system.tangent(u))
        for (name, quantity), taken in best_and_median(calls, results.plan.seconds).items():
            results.add(specimen, name, quantity, taken)


def models_of(specimen: Specimen) -> dict[str, Any]:
    """Return the timed models by the names in `MODELS`."""
    material: dict[str, Any] = {"young": YOUNG, "poisson": POISSON}
    network = EdgeNetwork.of(specimen.mesh, specimen.term)
    made = {
        "StVK": specimen.term,
        "linear": LinearElastic(**material),
        "edges and TSEPs": network,
        "quartic springs": network.diagonal(),
        "Hookean springs": SpringNetwork(rule="van-gelder", **material),
        "neo-Hookean": NeoHookean(**material),
        "corotated": Corotated(**material),
        "invertible StVK": InvertibleStVK(**material),
    }
    return {name: made[name] for name in MODELS}


def leave_out(results: Benchmark) -> None:
    """Record the peers that the plan does not time, and the install command of missing peers."""
    for name, package in PEERS.items():
        if package.version() is None:
            results.not_measured[name] = f"not installed: {package.install}"
        elif name not in results.plan.peers:
            results.not_measured[name] = "left to the full run"


def _time(results: Benchmark, specimen: Specimen, implementation: str, model: Any) -> None:
    calls = {what: partial(getattr(model, name), specimen.u) for what, name in METHODS.items() if hasattr(model, name)}
    with threads(1):
        for quantity, taken in best_and_median(calls, results.plan.seconds).items():
            results.add(specimen, implementation, quantity, taken)


def compare_errors(results: Benchmark, specimen: Specimen) -> None:
    """Record the errors of all implementations on 64 tetrahedra from the middle of a mesh, strained at random without rotation.

    The displacements are exact in single precision, so that only errors of the computation are measured.
    """
    shape = patch(Shape(specimen.mesh, Discretisation(specimen.mesh.element.name)))
    piece = shape.mesh
    noise = shape.node_size[:, None] * np.random.default_rng(2).standard_normal((2, piece.nv, 3))
    exact = ExactStVK(piece.p, piece.t, lame(YOUNG, POISSON))
    models = _models(results, specimen, piece)
    for strain in STRAINS:
        u, v = (strain * noise).astype(np.float32).astype(float).reshape(2, -1)
        F, Kv = exact.internal_force(u), exact.product(u, v)
        for (implementation, dtype), model in models.items():
            at = u.astype(dtype)
            results.errors.append(ErrorOf(implementation, dtype, "F", strain, relative_error(model.internal_force(at), F)))
            if hasattr(model, "tangent"):
                product = model.tangent(at) @ v.astype(dtype)
                results.errors.append(ErrorOf(implementation, dtype, "K", strain, relative_error(product, Kv)))


def _models(results: Benchmark, specimen: Specimen, piece: ElementMesh) -> dict[tuple[str, str], Any]:
    """Return the implementations that were timed, by name and precision."""
    models: dict[tuple[str, str], Any] = {(REFERENCE, "float64"): reference_on(piece)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)  # the patch may be disconnected
        for dtype in ("float64", "float32"):
            models[OURS, dtype] = System(piece, specimen.term, dtype=dtype)
            models[TEXTBOOK, dtype] = Textbook(specimen.term.bind(piece).form, dtype)
    for name in dict.fromkeys(timing.implementation for timing in results.timings if timing.implementation in results.plan.peers):
        models[name, "float64"] = peer_on(name, piece)
    return models
