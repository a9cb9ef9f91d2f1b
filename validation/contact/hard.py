"""Hard scenes of contact: each ends right, or with a message that says why it stopped; none passes through a surface unnoticed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from skfem_stvk import (
    BackwardEuler,
    EnergyMomentum,
    Friction,
    Gravity,
    MeshContact,
    NeoHookean,
    Rayleigh,
    RigidBox,
    RigidContact,
    RigidPlane,
    StVK,
    StvkError,
    System,
    simulate,
    solve_static,
)
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh, box

from ..statics.meshes import strip
from ..study import Study
from .pairs import at_bottom, nodes_of, stacked

GRAVITY = 9.81
#: Soft law, and that of the fast bodies, whose speed of sound is 10 m/s.
SOFT = NeoHookean(young=3e4, poisson=0.3, density=1e3)
FASTER = NeoHookean(young=1e5, poisson=0.3, density=1e3)
#: Limit of the error of the energy balance in units of the largest kinetic energy, for runs of `EnergyMomentum`.
CLOSURE = 1e-8


class Outcome(NamedTuple):
    """Result of a scene: whether it finished, the message if not, contradictions, and measured numbers in words."""

    finished: bool
    message: str
    wrong: Sequence[str]
    measured: str

    def also(self, measured: str, *failures: tuple[bool, str]) -> Outcome:
        """Return the outcome with more numbers, and the contradictions whose condition is true, if the run is finished."""
        more = [why for condition, why in failures if condition and self.finished]
        return self._replace(measured=f"{measured}, {self.measured}", wrong=[*self.wrong, *more])


def hard(quick: bool) -> Study:
    """Run all scenes. A scene fails if a body is inside another one, if a balance is off, or without a message."""
    rows, failures = [], []
    for name, run in SCENES.items():
        start = perf_counter()
        try:
            outcome = run()
        except StvkError as error:
            outcome = Outcome(False, str(error), (), "")
        verdict = "WRONG" if outcome.wrong else "right" if outcome.finished else "stopped"
        failures += [f"{name}: {why}" for why in outcome.wrong]
        failures += [f"{name}: stopped without a message"] if not (outcome.finished or outcome.message) else []
        measured = outcome.measured if outcome.finished else f"{outcome.measured}: {outcome.message}"
        rows.append((name, verdict, measured, f"{perf_counter() - start:.0f}"))
    return Study(
        "Hard scenes of contact",
        "no body is inside another one, balances close, and a run that stops says why",
        ("scene", "verdict", "measured", "s"),
        tuple(rows),
        tuple(failures),
        ("stopped: the run did not reach its end, and its message says why",),
    )


def crosses(mesh: ElementMesh, u: Array) -> bool:
    """Return whether an edge of the surface crosses a triangle of the surface without a common node; brute force."""
    x = (mesh.p + u.reshape(-1, 3).T).T
    triangles = (mesh.surface if mesh.k == 3 else mesh.t).T
    edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0)
    low, high = (np.stack([f(x[sides], axis=1) for f in (np.min, np.max)]) for sides in (edges, triangles))
    e, f = np.nonzero((low[0][:, None] <= high[1]).all(axis=2) & (low[1][:, None] >= high[0]).all(axis=2))
    apart = (edges[e][:, :, None] != triangles[f][:, None]).all(axis=(1, 2))
    (p, q), (a, b, c) = np.moveaxis(x[edges[e[apart]]], 1, 0), np.moveaxis(x[triangles[f[apart]]], 1, 0)

    def side(i: Array, j: Array, k: Array, m: Array) -> Array:
        return np.sign(np.einsum("nd,nd->n", np.cross(j - i, k - i), m - i))

    through = side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)
    return bool(((side(a, b, c, p) * side(a, b, c, q) < 0) & (through[0] == through[1]) & (through[1] == through[2])).any())


def moved(system: System, integrator: Any, until: float, v0: Array | None = None, *, floor: float = -np.inf, **options: Any) -> Any:
    """Return the run and its outcome; look at the surfaces, and at the lowest node, after every step."""
    crossed, deep, pairs = [], [], any(isinstance(term, MeshContact) for term in system.terms)

    def look(t: float, u: Array) -> None:
        crossed.extend([t] * (pairs and crosses(system.mesh, u)))
        deep.extend([t] * bool((system.mesh.p[2] + u[2::3]).min() < floor))

    look(0.0, np.zeros(system.ndofs))
    start = None if v0 is None else v0.ravel()
    run = simulate(system, integrator, until=until, v0=start, remove=look, quiet=True, raise_on_failure=False, **options)
    wrong = [f"surfaces intersect at t = {t:.4g} s" for t in crossed[:1]]
    kinetic = run.ledger["kinetic_energy"].max()
    lost = float(np.abs(run.ledger["closure_error"]).max() / kinetic)
    if isinstance(integrator, EnergyMomentum) and not lost <= CLOSURE:
        wrong.append(f"the ledger lost {lost:.1e} of the largest kinetic energy")
    finished = run.status.value == "finished"
    wrong += [f"deep in the floor at t = {t:.4g} s" for t in deep[:finished]]
    closure = f", closure {lost:.1e}" if isinstance(integrator, EnergyMomentum) else ""
    return run, Outcome(finished, run.message, wrong, f"{len(run.ledger['time']) - 1} steps{closure}")


def thrown(mesh: ElementMesh, body: str, velocity: Sequence[float]) -> Array:
    """Return velocities (nv, 3) of a mesh with one body that moves."""
    v0 = np.zeros((mesh.nv, 3))
    v0[nodes_of(mesh, body)] = velocity
    return v0


PLANE = RigidPlane((0, 0, 0), (0, 0, 1))
DOWN = Gravity((0, 0, -GRAVITY))


def flights(run: Any, contact: str) -> int:
    """Return how often the body leaves after it touched, for five steps or more."""
    touching = run.ledger[f"strain_energy {contact} 2"] > 0
    edges = np.flatnonzero(np.diff(touching.astype(int)))
    return int((np.diff(edges)[int(~touching[edges[0]]) :: 2] >= 5).sum())


def bounces_on_a_plane() -> Outcome:
    """Drop a soft block on a plane."""
    mesh = box((0.1, 0.1, 0.1), (2, 2, 2))
    mesh = ElementMesh(mesh.p + np.array([[0.0], [0.0], [0.02]]), mesh.t)
    body = System(mesh, [SOFT, DOWN, RigidContact(PLANE)])
    run, outcome = moved(body, EnergyMomentum(2e-3), 1.2, floor=-0.02)
    return bounced(run, outcome, "RigidContact")


def bounces_on_a_block() -> Outcome:
    """Drop a soft block on another one."""
    mesh = stacked(((0.14, 0.14, 0.06), (0.1, 0.1, 0.1)), ((3, 3, 1), (2, 2, 1)), 0.02, (0.02, 0.02))
    body = System(mesh, [SOFT, DOWN, MeshContact("body 0", "body 1", distance=4e-3)], {at_bottom: "xyz"})
    run, outcome = moved(body, EnergyMomentum(2e-3), 1.2)
    return bounced(run, outcome, "MeshContact")


def bounced(run: Any, outcome: Outcome, contact: str) -> Outcome:
    """Return the outcome of a body that must bounce five times."""
    count = flights(run, contact)
    return outcome.also(f"{count} bounces", (count < 5, f"{count} bounces; expected 5"))


def pressed_between_plates() -> Outcome:
    """Press a block by 60 % between two plates with friction."""
    mesh, friction, k = box((0.1, 0.1, 0.1), (4, 4, 4)), Friction(0.3, slip_length=1e-4), 1e8
    top = RigidPlane((0, 0, 0.1), (0, 0, -1))
    floor = RigidContact(PLANE, at_bottom, stiffness=k, friction=friction, name="floor")
    lid = RigidContact(top, lambda x: x[2] == 0.1, stiffness=k, friction=friction, motion=(0, 0, -0.062), name="lid")
    corner, edge = (lambda x: (x[2] == 0) & (x[0] == 0) & (x[1] == 0)), (lambda x: (x[2] == 0) & (x[0] == 0.1) & (x[1] == 0))
    body = System(mesh, [SOFT, floor, lid], {corner: "xy", edge: "y"})
    result = solve_static(body, steps=20, quiet=True, raise_on_failure=False)
    forces = [result.contact(name).resultant[2] for name in ("floor", "lid")]
    height = np.ptp(mesh.p[2] + result.u[2::3])
    outcome = Outcome(result.success, result.message, [], f"height {height / 0.1:.1%}")
    return outcome.also(
        f"force {forces[0]:.4g} N",
        (abs(sum(forces)) > 1e-6 * abs(forces[0]), "the forces of the plates differ"),
        (len(body.inside_out(result.u)) > 0, "elements are inverted"),
        (height > 0.0401, f"height {height:.4g} m"),
    )


def stack() -> Outcome:
    """Let a stack of five blocks come to rest on a floor."""
    mesh = stacked(((0.1, 0.1, 0.05),) * 5, ((2, 2, 1), (3, 3, 1)) * 2 + ((2, 2, 1),), 2e-3)
    friction = Friction(0.5, slip_speed=1e-3)
    pairs = [MeshContact(f"body {i}", f"body {i + 1}", distance=2e-3, friction=friction, name=f"pair {i}") for i in range(4)]
    floor = RigidContact(PLANE, at_bottom, friction=friction, name="floor")
    body = System(mesh, [SOFT, DOWN, floor, *pairs])
    run, outcome = moved(body, BackwardEuler(5e-3), 1.0, damping=Rayleigh(5.0, 0.0), floor=-0.01)
    weight = 1e3 * GRAVITY * 0.1 * 0.1 * 0.05 * np.arange(5, 0, -1)
    names = ["floor", *(pair.name for pair in pairs)]
    ratios = np.abs([run.contact(name).resultant[2] for name in names]) / weight
    speed = np.abs(run.v).max()
    return outcome.also(
        f"forces/weights {ratios.min():.4f} to {ratios.max():.4f}, speed {speed:.1e} m/s",
        (np.abs(ratios - 1).max() > 1e-2, f"forces/weights {ratios}"),
    )


def whip() -> Outcome:
    """Throw both halves of a slender bar at each other."""
    mesh = box((1.0, 0.05, 0.05), (20, 1, 1))
    body = System(mesh, [NeoHookean(young=2e5, poisson=0.3, density=1e3), MeshContact(None, distance=5e-3)])
    x = mesh.p[0] - 0.5
    v0 = np.stack([0 * x, 0 * x, 40 * np.abs(x)], axis=1)
    run, outcome = moved(body, EnergyMomentum(5e-4), 0.15, v0)
    stored = run.ledger["strain_energy MeshContact 1"].max() / run.ledger["kinetic_energy"].max()
    return outcome.also(f"largest energy of the contact {stored:.1%}", (not stored > 1e-3, "it does not hit itself"))


def sheet_on(solid: str) -> Outcome:
    """Let a sheet fall over the edge of a rigid box, or of a block."""
    sheet = strip(8, 4, lambda a, b: (0.4 * a - 0.1, 0.2 * b, 0.005 + 0 * a))
    law = StVK(young=1e5, poisson=0.3, thickness=2e-3, density=1e3)
    if solid == "rigid":
        block = RigidBox((-0.3, -0.1, -0.2), (0.1, 0.3, 0.0), radius=0.01)
        body = System(sheet, [law, DOWN, RigidContact(block, stiffness=1e6)])
    else:
        low = box((0.4, 0.4, 0.2), (4, 4, 2))
        used, facets = np.unique(low.surface, return_inverse=True)
        p = np.hstack([sheet.p, low.p[:, used] + np.array([[-0.3], [-0.1], [-0.2]])])
        t = np.hstack([sheet.t, facets.reshape(3, -1) + sheet.nv])
        sheet_ids, block_ids = np.split(np.arange(t.shape[1], dtype=np.int32), [sheet.nt])
        mesh = ElementMesh(p, t, subdomains={"sheet": sheet_ids, "block": block_ids})
        body = System(mesh, [law, DOWN, MeshContact("block", "sheet", distance=4e-3)], {tuple(range(sheet.nv, mesh.nv)): "xyz"})
    run, outcome = moved(body, BackwardEuler(2e-3), 0.3, damping=Rayleigh(2.0, 0.0))
    x = sheet.p + run.u.reshape(-1, 3)[: sheet.nv].T
    deep = max(0.0, float(np.min([0.1 - x[0], -x[2], x[2] + 0.2], axis=0).max()))
    return outcome.also(f"falls {-run.u[2::3].min():.3g} m, {deep:.1e} m deep", (deep > 2e-3, f"{deep:.2g} m deep in the box"))


def touching_blocks() -> Outcome:
    """Let blocks go that are closer than the distance of the barrier at the start: it pushes them apart."""
    mesh = stacked(((0.1, 0.1, 0.05),) * 2, ((3, 3, 2), (2, 2, 2)), 1e-3)
    body = System(mesh, [SOFT, MeshContact("body 0", "body 1", distance=2e-3)])
    start = body.energy(np.zeros(body.ndofs))
    run, outcome = moved(body, EnergyMomentum(1e-3), 0.05)
    kept = abs(run.ledger["total_energy"][-1] / start - 1)
    return outcome.also(f"energy at the start {start:.3g} J", (not kept <= CLOSURE, f"the energy changed by {kept:.1e}"))


def touching_a_plane() -> Outcome:
    """Find the equilibrium of a heavy block whose bottom is on a plane at the start, and its motion from there."""
    mesh = box((0.1, 0.1, 0.1), (3, 3, 3))
    corner, edge = (lambda x: (x[2] == 0) & (x[0] == 0) & (x[1] == 0)), (lambda x: (x[2] == 0) & (x[0] == 0.1) & (x[1] == 0))
    body = System(mesh, [SOFT, DOWN, RigidContact(PLANE, at_bottom, name="floor")], {corner: "xy", edge: "y"})
    result = solve_static(body, quiet=True)
    ratio = result.contact("floor").resultant[2] / (1e3 * GRAVITY * 1e-3)
    _, outcome = moved(body, EnergyMomentum(1e-3), 0.1, floor=-0.01)
    return outcome.also(f"force/weight - 1 = {ratio - 1:.1e}", (not abs(ratio - 1) < 1e-6, "the plane does not carry the weight"))


def impact(integrator: Any, on_plane: bool, speed: float) -> Outcome:
    """Throw a block, whose speed of sound is 10 m/s, on a plane or on a block that stands."""
    if on_plane:
        mesh = box((0.1, 0.1, 0.1), (3, 3, 3))
        mesh = ElementMesh(mesh.p + np.array([[0.0], [0.0], [0.02]]), mesh.t)
        plane = RigidContact(
            PLANE, stiffness=1e3 * 10.0 * speed / 3e-3
        )  # pressure density times sound speed times speed: 3 mm deep
        body, v0 = System(mesh, [FASTER, plane]), np.tile([0.0, 0.0, -speed], (mesh.nv, 1))
    else:
        mesh = stacked(((0.12, 0.12, 0.05), (0.1, 0.1, 0.05)), ((3, 3, 2), (2, 2, 2)), 0.02, (0.01, 0.01))
        body = System(mesh, [FASTER, MeshContact("body 0", "body 1", distance=4e-3)], {at_bottom: "xyz"})
        v0 = thrown(mesh, "body 1", (0, 0, -speed))
    return moved(body, integrator, 0.5 / speed, v0, floor=-0.05 if on_plane else -1e-9)[1]


def slide(steps: int) -> Outcome:
    """Let a heavy block slide without friction over the facets of a plate."""
    mesh = stacked(((0.6, 0.1, 0.02), (0.06, 0.05, 0.04)), ((18, 3, 1), (2, 2, 1)), 1.5e-3, (0.02, 0.025))
    body = System(mesh, [SOFT, DOWN, MeshContact("body 0", "body 1", distance=2e-3)], {at_bottom: "xyz"})
    run, outcome = moved(body, EnergyMomentum(5e-4), 5e-4 * steps, thrown(mesh, "body 1", (0.5 / (5e-4 * steps), 0, 0)))
    total = run.ledger["total_energy"]
    drift = float(np.abs(total - total[0]).max() / run.ledger["kinetic_energy"][0])
    slid = run.u.reshape(-1, 3)[nodes_of(mesh, "body 1"), 0].mean()
    return outcome.also(f"slides {slid:.3g} m, drift of energy {drift:.1e}", (not drift <= CLOSURE, f"energy off by {drift:.1e}"))


SCENES: dict[str, Callable[[], Outcome]] = {
    "a soft block bounces five times on a plane": bounces_on_a_plane,
    "a soft block bounces five times on a block": bounces_on_a_block,
    "a block pressed by 60 % between two plates with friction": pressed_between_plates,
    "a stack of five blocks comes to rest": stack,
    "a whip hits itself": whip,
    "a sheet falls over the edge of a rigid box": partial(sheet_on, "rigid"),
    "a sheet falls over the edge of a block": partial(sheet_on, "block"),
    "blocks that start in the barrier": touching_blocks,
    "a block that starts on a plane": touching_a_plane,
    "a block slides from facet to facet, 800 steps": partial(slide, 800),
}
for _speed, _dt in ((10.0, 1e-4), (100.0, 1e-3)):
    for _integrator in (BackwardEuler(_dt), EnergyMomentum(_dt)):
        for _on_plane in (True, False):
            _name = f"{_speed:g} m/s on a {'plane' if _on_plane else 'block'}, {type(_integrator).__name__}, dt = {_dt:g} s"
            SCENES[_name] = partial(impact, _integrator, _on_plane, _speed)
