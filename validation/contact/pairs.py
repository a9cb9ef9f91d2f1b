"""Contact between the surfaces of one mesh: a patch test of two blocks, and blocks that collide."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from skfem_stvk import EnergyMomentum, MeshContact, StVK, System, simulate, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh, box

from ..study import Study
from .check import Check, study_of

YOUNG, DENSITY = 3e4, 1e3
#: Patch test: edge and height of the blocks, distance of the barrier, travel of the lid [m], and cells of both blocks.
EDGE, HEIGHT, THIN, TRAVEL = 0.1, 0.05, 5e-4, 5e-3
CELLS = (((4, 4, 2), (3, 3, 2)), ((8, 8, 4), (5, 5, 3)))
#: Distance of elements from the side faces whose stress is compared [m]: the barrier also acts around the edges there.
SIDE = 0.02
#: Collision: distance of the barrier [m], step and duration [s], and velocity of the upper block [m/s].
DISTANCE, STEP, DURATION, VELOCITY = 3e-3, 1e-3, 0.025, (0.1, 0.0, -0.5)
STRESS_LIMIT, CLOSURE, ROUND_OFF, ORDER_LIMIT = 0.02, 1e-8, 1e-13, 0.2


def at_bottom(x: Array) -> Any:
    """Return whether points `x` (3, n) are at the bottom of the lower block."""
    return x[2] == 0


def stacked(
    sizes: tuple[tuple[float, float, float], ...],
    cells: tuple[tuple[int, int, int], ...],
    gap: float,
    shift: tuple[float, float] = (0.0, 0.0),
) -> ElementMesh:
    """Return boxes on top of each other, "body 0" and so on, with a `gap` between them; each is moved by `shift` from the last."""
    boxes = [box(size, n) for size, n in zip(sizes, cells, strict=True)]
    low = np.cumsum([0.0, *(size[2] + gap for size in sizes[:-1])])
    p = np.hstack([m.p + np.array([[i * shift[0]], [i * shift[1]], [z]]) for i, (m, z) in enumerate(zip(boxes, low, strict=True))])
    nodes, elements = (np.cumsum([0, *numbers]) for numbers in ([m.nv for m in boxes], [m.nt for m in boxes]))
    t = np.hstack([m.t + first for m, first in zip(boxes, nodes[:-1], strict=True)])
    bodies = {f"body {i}": np.arange(*ends) for i, ends in enumerate(pairwise(elements))}
    return ElementMesh(p, t, subdomains=bodies)


def nodes_of(mesh: ElementMesh, body: str) -> Array:
    """Return the nodes (n,) of a body."""
    return np.unique(mesh.t[:, mesh.elements(body)])


def pair(quick: bool) -> Study:
    """Compare the stress at the interface of two pressed blocks, whose meshes do not match, with its mean."""
    return study_of(
        "Patch test: two blocks whose meshes do not match, pressed by a lid",
        f"the stress of all elements at the interface, off the side faces, is the mean to {STRESS_LIMIT:.0%}",
        [check for cells in (CELLS[:1] if quick else CELLS) for check in _stresses(cells)],
        f"StVK with nu = 0; distance {THIN:g} m, edges from {EDGE / 8:g} to {EDGE / 3:.3g} m; nominal axial stress of the "
        "element with the largest error, divided by force/area",
        "tangential/normal: resultant of the contact, whose tangential part is zero for matching meshes",
    )


def _stresses(cells: tuple[tuple[int, int, int], ...]) -> Iterator[Check]:
    name = "cells " + " on ".join("x".join(map(str, n)) for n in reversed(cells))
    mesh = stacked(((EDGE, EDGE, HEIGHT),) * 2, cells, THIN)
    top = mesh.p[2].max()
    terms: list[Any] = [StVK(young=YOUNG, poisson=0.0), MeshContact("body 0", "body 1", distance=THIN, name="pair")]
    pressed: Any = {lambda x: x[2] == top: {"x": 0.0, "y": 0.0, "z": -TRAVEL}}
    result = solve_static(System(mesh, terms, {at_bottom: "xyz"}, pressed), steps=4, quiet=True)
    force, stress = result.contact("pair").resultant, result.stress("pk1")[:, 2, 2]
    middle = np.abs(mesh.p[:2, mesh.t].mean(axis=1) - EDGE / 2).max(axis=0) < EDGE / 2 - SIDE
    for body, face in (("lower", HEIGHT), ("upper", HEIGHT + THIN)):
        near = np.isclose(mesh.p[2, mesh.t], face, atol=1e-9).any(axis=0)
        ratios = stress[near & middle] * EDGE**2 / force[2]
        yield Check(f"{name}: stress in the {body} block", float(ratios[np.abs(ratios - 1).argmax()]), 1.0, STRESS_LIMIT)
    yield Check(f"{name}: tangential/normal", float(np.abs(force[:2] / force[2]).max()), 0.0, STRESS_LIMIT)


def collision(quick: bool) -> Study:
    """Check energy and momenta of a block that hits another one, which is free or stands on the ground."""
    free, finer, standing = collided(STEP), collided(STEP / 2), collided(STEP, {at_bottom: "xyz"})
    first, second = (_drift(run.ledger, "angular") for run in (free, finer))
    stored = free.ledger["strain_energy MeshContact 1"].max() / free.ledger["kinetic_energy"][0]
    return study_of(
        "A block hits another one, without friction",
        "the energy balance closes to 1e-8, linear momentum is kept to round-off, and angular momentum to O(dt^2)",
        [
            Check("two free blocks: lost energy/first kinetic energy", _lost(free.ledger), 0.0, CLOSURE),
            Check("two free blocks: drift of linear momentum", _drift(free.ledger, "linear"), 0.0, ROUND_OFF),
            Check("two free blocks: drift of angular momentum", first),
            Check("... with half the step", second),
            Check("... ratio of the two", first / second, 4.0, ORDER_LIMIT),
            Check("a standing block: lost energy/first kinetic energy", _lost(standing.ledger), 0.0, CLOSURE),
            Check("largest energy of the contact/first kinetic energy", float(stored)),
        ],
        f"StVK with nu = 0.3; EnergyMomentum with dt = {1e3 * STEP:g} ms over {DURATION:g} s; drifts in units of the largest "
        "component",
    )


def collided(dt: float, fixed: dict[Callable[[Array], Any], str] | None = None) -> Any:
    """Return the run of a block that falls obliquely, off the centre, on a larger one."""
    mesh = stacked(((0.1, 0.1, 0.05), (0.08, 0.07, 0.05)), ((3, 3, 2), (2, 3, 2)), DISTANCE, (0.013, 0.017))
    v0 = np.zeros((mesh.nv, 3))
    v0[nodes_of(mesh, "body 1")] = VELOCITY
    law = StVK(young=YOUNG, poisson=0.3, density=DENSITY)
    body = System(mesh, [law, MeshContact("body 0", "body 1", distance=DISTANCE)], fixed)
    return simulate(body, EnergyMomentum(dt), until=DURATION, v0=v0.ravel(), quiet=True)


def _lost(ledger: Any) -> float:
    return float(np.abs(ledger["closure_error"]).max() / ledger["kinetic_energy"][0])


def _drift(ledger: Any, kind: str) -> float:
    momentum = np.array([ledger[f"{kind}_momentum_{axis}"] for axis in "xyz"])
    return float(np.abs(momentum - momentum[:, :1]).max() / np.abs(momentum).max())
