"""Contact between bodies against closed forms: two balls that are pressed together, and a half-ring that irons a slab."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import skfem

from skfem_stvk import LinearElastic, MeshContact, StVK, System, solve_static
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.results.contact_forces import contact_state

from ..study import Study
from .check import Check, study_of
from .hertz import ELEMENTS, POISSON, YOUNG, approach, ball, hertz_force

#: Contact radius of the balls in units of R, and distance of the barrier in units of the shortest edge of the facets' triangles.
SIZE, THIN = 0.1, 0.1
BALL_FORCE, BALL_RADIUS = 0.02, 0.1
#: The slab: length, width and height [m], and cells. The half-ring: radii [m], and cells along the radius, the width and the arc.
SLAB, SLAB_CELLS = (0.6, 0.05, 0.15), (24, 1, 6)
INNER, OUTER, RING_CELLS = 0.05, 0.1, (2, 1, 24)
#: The half-ring: how deep it is pressed, how far it slides [m], steps of the load, load factor at which it begins to slide.
DEPTH, WAY, STEPS, PRESSED = 0.01, 0.15, 60, 0.2
#: Distance of the barrier: a tenth of the edges of the slab, as docs/how-to/contact.md recommends [m].
DISTANCE = 0.1 * SLAB[0] / SLAB_CELLS[0]
SPREAD, TANGENTIAL, BALANCE = 0.015, 0.03, 1e-6


class Pressed(NamedTuple):
    """Result of two balls: force and contact radius, divided by Hertz's."""

    force: float
    radius: float


def balls(quick: bool) -> Study:
    """Compare the force and the contact radius of two pressed balls with those of Hertz and Tatara."""
    a, elements = SIZE, 2 if quick else ELEMENTS
    found = pressed_balls(a, elements)
    checks = [
        Check(f"a/R = {a:g}: force", hertz_force(a) * found.force, hertz_force(a), BALL_FORCE),
        Check(f"a/R = {a:g}: contact radius", a * found.radius, a, BALL_RADIUS),
    ]
    return study_of(
        "Hertz: two equal balls, with MeshContact",
        f"linear elasticity: the force to {BALL_FORCE:.0%}, the contact radius to {BALL_RADIUS:.0%}",
        checks,
        f"E = R = 1, nu = {POISSON:g}, so that E* = E/(2 (1 - nu^2)) and R* = R/2; quadratic tetrahedra, {elements} along a, "
        "whose meshes do not match",
        f"the distance of the barrier is {THIN:g} of the shortest edge of the surfaces",
    )


def pressed_balls(a: float, elements: int = ELEMENTS) -> Pressed:
    """Return the result of two balls that are pressed together until Hertz's contact radius is `a`.

    A plane of symmetry is between the balls. The centre of each approaches it as it would approach a rigid plate.
    """
    mesh, distance = _two_octants(a, elements)
    low, high = mesh.p[2].min(), mesh.p[2].max()
    terms: list[Any] = [LinearElastic(young=YOUNG, poisson=POISSON)]
    terms.append(MeshContact("lower side", "upper side", distance=distance, name="balls"))
    planes: Any = {(lambda x, i=i: np.abs(x[i]) < 1e-9): "xy"[i] for i in range(2)}
    held: Any = {lambda x: np.abs(x[2] - low) < 1e-9: "z"}
    moved: Any = {lambda x: np.abs(x[2] - high) < 1e-9: {"z": -2 * approach(a)}}
    result = solve_static(System(mesh, terms, planes | held, moved), steps=2, quiet=True)
    state = result.contact("balls")  # of a quarter of the contact
    upper = np.setdiff1d(np.arange(mesh.nv), state.nodes)
    touches = (state.pressure > 0.01 * state.pressure.max()) & (state.pressure > 0)
    touches[upper] = False
    radius = float(np.hypot(*mesh.p[:2, touches]).max())
    return Pressed(float(-4 * state.resultant[2] / hertz_force(a)), radius / a)


def _two_octants(a: float, elements: int) -> tuple[ElementMesh, float]:
    """Return octants of two balls, and the distance of the barrier, which is the gap between them at rest."""
    upper = ball(a, elements)
    near = upper.surface[:, (np.abs(np.linalg.norm(upper.p[:, upper.surface], axis=0) - 1) < 1e-6).all(axis=0)]
    corners = upper.p[:, near[:3]]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0)
    distance = THIN * float(edges.min()) / 2  # of the triangles between the nodes
    lower = upper.p[[1, 0, 2]] * [[1], [1], [-1]] - [[0], [0], [2 + distance]]  # the mirror image, with x and y exchanged
    n, more = int(upper.t[:4].max()) + 1, upper.nv
    p = np.hstack([lower[:, :n], upper.p[:, :n], lower[:, n:], upper.p[:, n:]])  # vertices come before the middles of edges
    t = np.hstack([np.where(upper.t < n, upper.t, upper.t + n), np.where(upper.t < n, upper.t + n, upper.t + more)])
    mesh = ElementMesh(p, t, element=upper.element)
    middle = -1 - distance / 2

    def near_contact(x: Array, side: int) -> Array:
        from_centre = np.linalg.norm(x - [[0], [0], [middle + side * (1 + distance / 2)]], axis=0)
        return (side * (x[2] - middle) > 0) & (from_centre > 0.98) & (np.hypot(x[0], x[1]) < 3 * a)

    sides = {"lower side": lambda x: near_contact(x, -1), "upper side": lambda x: near_contact(x, 1)}
    return mesh.with_boundaries(sides), distance


def ironing(quick: bool) -> Study:
    """Measure how far the normal force spreads while a half-ring slides over a slab without friction, at a constant depth."""
    normal, tangential, balance = ironed()
    mean = float(normal.mean())
    return study_of(
        "A half-ring irons a slab without friction, with MeshContact",
        f"the normal force stays within {SPREAD:.1%} of its mean, the tangential force within {TANGENTIAL:.0%} of it",
        [
            Check("mean of the normal force [N]", mean),
            Check("largest normal force/mean", float(normal.max()) / mean, 1.0, SPREAD),
            Check("smallest normal force/mean", float(normal.min()) / mean, 1.0, SPREAD),
            Check("largest tangential force/mean", float(np.abs(tangential).max()) / mean, 0.0, TANGENTIAL),
            Check("force of the contact/reaction of the slab", balance, 1.0, BALANCE),
        ],
        f"StVK, plane strain; pressed by {DEPTH:g} m, then it slides {WAY / SLAB[0] * SLAB_CELLS[0]:g} edges of the slab in "
        f"{round(STEPS * (1 - PRESSED))} static steps; the distance of the barrier is a tenth of these edges",
    )


def ironed() -> tuple[Array, Array, float]:
    """Return normal and tangential forces [N] at the steps in which the half-ring slides, and force over reaction at the end."""
    mesh = _slab_and_ring()
    terms: list[Any] = [
        StVK(young=1e5, poisson=0.3, region="slab"),
        StVK(young=1e6, poisson=0.3, region="ring"),
        MeshContact("slab top", "ring side", distance=DISTANCE, name="iron"),
    ]
    moved: Any = {
        "ring grip": {
            "x": lambda x, t: WAY * max(0.0, t - PRESSED) / (1 - PRESSED),
            "z": lambda x, t: -(DEPTH + DISTANCE) * min(1.0, t / PRESSED),
        }
    }
    body = System(mesh, terms, {lambda x: np.ones(x.shape[1:], dtype=bool): "y", "slab bottom": "xz"}, moved)
    result = solve_static(body, steps=STEPS, quiet=True)
    forces = np.array([contact_state(result.system, "iron", one.u, one.t).resultant for one in result.history if one.t > PRESSED])
    return -forces[:, 2], forces[:, 0], float(-forces[-1, 2] / result.reaction("slab bottom").resultant[2])


def _slab_and_ring() -> ElementMesh:
    """Return a slab and the lower half of a ring, with a gap of `DISTANCE` between them."""
    slab = skfem.MeshTet.init_tensor(*(np.linspace(0, length, n + 1) for length, n in zip(SLAB, SLAB_CELLS, strict=True)))
    r, y, angle = skfem.MeshTet.init_tensor(*(np.linspace(0, 1, n + 1) for n in RING_CELLS)).p
    r, angle = INNER + (OUTER - INNER) * r, np.pi * angle
    middle = 0.15, SLAB[2] + OUTER + DISTANCE
    ring = np.stack([middle[0] - r * np.cos(angle), 0.9 * SLAB[1] * y + 0.05 * SLAB[1], middle[1] - r * np.sin(angle)])
    cells = skfem.MeshTet.init_tensor(*(np.arange(n + 1.0) for n in RING_CELLS)).t
    t = np.hstack([slab.t, cells + slab.p.shape[1]])
    bodies = {"slab": np.arange(slab.t.shape[1]), "ring": np.arange(slab.t.shape[1], t.shape[1])}
    mesh = ElementMesh(np.hstack([slab.p, ring]), t, subdomains=bodies)

    def from_axis(x: Array) -> Array:
        return np.asarray(np.hypot(x[0] - middle[0], x[2] - middle[1]))

    return mesh.with_boundaries(
        {
            "slab bottom": lambda x: x[2] < 1e-9,
            "slab top": lambda x: np.abs(x[2] - SLAB[2]) < 1e-9,
            "ring side": lambda x: (from_axis(x) > 0.99 * OUTER) & (from_axis(x) < 1.01 * OUTER),
            "ring grip": lambda x: np.abs(from_axis(x) - INNER) < 0.01 * INNER,
        }
    )
