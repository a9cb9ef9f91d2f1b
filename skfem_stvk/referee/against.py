"""Another code as the candidate of a verification: a peer in this or another environment, a user's function, or a library in C."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from ..arguments import Array
from ..edges.materials import Isotropic
from ..errors import StvkError, name_known
from ..mesh import ElementMesh
from ..mesh.diagnostics import check_mesh
from ..terms import StVK
from .implementations import make_candidate, users_function
from .peers import PEERS, load
from .peers.elsewhere import Elsewhere
from .peers.library import SharedLibrary

ARGUMENT = "--against"
#: Peers that take the user's own energy density.
OF_DENSITIES = ("JAX", "PyTorch")


@contextmanager
def peer_candidate(
    name: str, mesh: ElementMesh, young: float, poisson: float, python: str | None = None
) -> Iterator[tuple[Any, str]]:
    """Yield another code on this body as a candidate, with a line that describes the code and its known deviations.

    The candidate is a function of a mesh, so that the smallest piece on which it fails can be found. A peer of another environment
    is a model of the whole body instead.

    Parameters
    ----------
    name
        Name of a peer, in upper or lower case; every version is accepted. `jax:module:function` or `torch:module:function` is an
        energy density W(F) that the user has written for this peer. `module:function` is a function of `p` (d, nv), `t` (n, nt),
        `young` and `poisson` that returns an object with any of `energy`, `internal_force` and `tangent`.
    mesh, young, poisson
        Mesh of the body, Young's modulus [Pa] and Poisson's ratio of its one material.
    python
        Path of the Python executable of another environment in which the peer is installed.

    Raises
    ------
    MeshError, MaterialError
        if the mesh or the material does not define an elastic body.
    StvkError
        if there is no such peer or function, it is not installed, or it does not support these elements.
    """
    check_mesh(mesh)
    StVK(young=young, poisson=poisson).stiffness(mesh)  # check both first, because the messages of other codes may be unclear
    first, _, function = name.partition(":")
    peer = next((one for one, package in PEERS.items() if first.lower() in (one.lower(), package.module)), None)
    if peer is None:
        if not function:
            raise StvkError(f"{ARGUMENT} = {name[:80]!r}; {name_known(name[:80], PEERS)} Or name a function: module:function.")
        yield _users(name, mesh, young, poisson, python)
        return
    package = PEERS[peer]
    if mesh.element.name not in package.elements or mesh.d != 3:
        raise StvkError(
            f"{ARGUMENT} = {peer}: the mesh has {mesh.kind}; expected {' or '.join(package.elements)} in 3D. Use another "
            f"mesh{', or --degree 1' if mesh.element.degree == 2 else ''}."
        )
    if function and (peer not in OF_DENSITIES or python is not None):
        where = "for another environment" if peer in OF_DENSITIES else f"for {peer}"
        raise StvkError(
            f"{ARGUMENT} = {name[:80]!r}; expected no function {where}: only {' and '.join(OF_DENSITIES)} of this environment take "
            "one."
        )
    known = f"known differences: {package.deviates}; tried {package.tried}" + (f"; {package.why}" if package.why else "")
    if python is not None:
        with Elsewhere(python, peer, mesh.p, mesh.t, young, poisson) as model:
            yield model, f"{model.name} {model.version} of {python}, {package.gives}; {known}"
        return
    options: dict[str, Any] = {"any_version": True} if package.least else {}
    if function:
        options["density"] = users_function(ARGUMENT, function)
    make: Any = load(peer)
    of = partial(make, young=young, poisson=poisson, **options)
    model = _make(peer, of, mesh)
    yield (
        _adapted(mesh, model, of),
        f"{f'{function} in ' if function else ''}{model.name} {model.version}, {package.gives}; {known}",
    )


@contextmanager
def library_candidate(file: str, functions: dict[str, str], mesh: ElementMesh, terms: Sequence[StVK]) -> Iterator[tuple[Any, str]]:
    """Yield the functions of a shared library as a candidate, with a line that describes them.

    The candidate is a function of a mesh if the library has a function of the body, and else the model of the whole body.

    Parameters
    ----------
    file, functions
        Path of the library, and names of its functions by role, as in `SharedLibrary`.
    mesh, terms
        Mesh of the body, and its isotropic materials.

    Raises
    ------
    StvkError
        if the library cannot be loaded or lacks a function. The candidate raises it if the function of the body fails.
    """
    with SharedLibrary(file, functions) as library:

        def of(body: ElementMesh) -> Any:
            young, poisson = np.zeros((2, body.nt))
            for term in terms:
                ids, material = body.elements(term.region), term.material
                assert isinstance(material, Isotropic)
                young[ids], poisson[ids] = material.young, material.poisson
            return library.candidate(body, young, poisson)

        names = ", ".join(functions.values())
        yield of if "body" in functions else of(mesh), f"{names} of {file}, in a process of its own with one thread"


def _users(name: str, mesh: ElementMesh, young: float, poisson: float, python: str | None) -> tuple[Any, str]:
    if python is not None:
        raise StvkError(f"--python is for peers, {', '.join(PEERS)}; run the function {name[:80]!r} in this environment.")
    make = users_function(ARGUMENT, name)

    def of(p: Array, t: Array) -> Any:
        return make(p, t, young, poisson)

    return _adapted(mesh, _make(name, of, mesh), of), f"the result of {name}"


def _adapted(mesh: ElementMesh, model: Any, of: Callable[[Array, Array], Any]) -> Callable[[ElementMesh], Any]:
    """Return a function of a mesh that returns `model` for the whole mesh, and a new candidate for a piece of it.

    Pieces are needed if no hypothesis explains a failure.
    """
    return lambda piece: model if piece is mesh else of(piece.p.copy(), piece.t.copy())


def _make(name: str, of: Callable[[Array, Array], Any], mesh: ElementMesh) -> Any:
    """Return the candidate that `of` makes from copies of `p` and `t`, because `of` may change them."""
    return make_candidate(name, lambda: of(mesh.p.copy(), mesh.t.copy()), " Expected a function of (p, t, young, poisson).")
