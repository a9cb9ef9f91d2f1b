"""Random contacts of a body with a rigid shape, of two bodies, or of a body with itself, and properties of all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from skfem_stvk import Friction, MeshContact, RigidBox, RigidContact, RigidCylinder, RigidPlane, RigidSphere, System
from skfem_stvk.arguments import Array
from skfem_stvk.errors import StvkError
from skfem_stvk.mesh import ElementMesh
from skfem_stvk.system.system import for_analysis
from skfem_stvk.terms.loads.load import Moment, StepStart

RIGID = ("plane", "sphere", "inside a sphere", "cylinder", "inside a cylinder", "box", "rounded box")
KINDS = (*RIGID, "plane", *("two bodies",) * 6, "itself")
MOTIONS = ("rests", "rests", "ramp", "function")
#: Arguments that may be wrong, and wrong values.
NAMES = ("stiffness", "distance", "onset", "friction", "motion", "where", "first", "name", "shape")
WRONG = (float("nan"), float("inf"), -1.0, 0.0, 1e300, 1e-300, "nowhere", (), (1.0, 2.0), [[1.0]], True, None, np.array([1e9, 2]))
#: Largest error of a work relative to its summands, and of a derivative by differences over `STEPS` edge lengths.
WORK, SLOPE, STEPS = 1e-6, 1e-3, (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


@dataclass(frozen=True)
class Touch:
    """Parameters of a contact: the gap in edge lengths, the stiffness in units of E/edge or E, the distance in shortest edges.

    `wrong` is the name of an argument and an index in `WRONG`, for a wrong value.
    """

    kind: str
    gap: float
    stiffness: float | None
    distance: float
    friction: float
    onset: float
    motion: str
    where: str
    wrong: tuple[str, int] | None

    @property
    def is_rigid(self) -> bool:
        """Whether the body touches a rigid shape."""
        return self.kind in RIGID


@st.composite
def touches(draw: st.DrawFn) -> Touch:
    """Draw all kinds of contact, one of ten with a wrong argument."""
    wrong = draw(st.sampled_from((False,) * 9 + (True,)))
    return Touch(
        kind=draw(st.sampled_from(KINDS)),
        gap=draw(st.sampled_from((1e-3, 1e-3, -0.05, -0.05, 0.05, 0.05, 0.0, 0.3, -1e-6, -1.0))),
        stiffness=draw(st.sampled_from((None, None, 1e-3, 1.0, 100.0, 1e5))),
        distance=draw(st.sampled_from((0.1, 0.1, 0.1, 0.1, 0.01, 0.5, 0.5, 1e-4, 1.0, 2.0))),
        friction=draw(st.sampled_from((0.0, 0.3, 2.0))),
        onset=draw(st.sampled_from((0.0, 0.0, 0.05))),
        motion=draw(st.sampled_from(MOTIONS)),
        where=draw(st.sampled_from(("all", "all", "half"))),
        wrong=(draw(st.sampled_from(NAMES)), draw(st.integers(0, len(WRONG) - 1))) if wrong else None,
    )


def shortest_edge(mesh: ElementMesh) -> float:
    """Return the smallest distance of two nodes of an element [m]."""
    i, j = np.triu_indices(len(mesh.t), 1)
    return float(np.linalg.norm(mesh.p[:, mesh.t[i]] - mesh.p[:, mesh.t[j]], axis=0).min())


def two_bodies(touch: Touch, mesh: ElementMesh) -> ElementMesh:
    """Return a mesh, "lower", and above it "upper", its copy or mirror image, moved sideways so that the nodes do not match."""
    shortest, degree, mirrored = shortest_edge(mesh), mesh.element.degree, mesh.element.is_simplex
    if mirrored:
        mesh = ElementMesh(mesh.p[:, : mesh.t[: mesh.k + 1].max() + 1], mesh.t[: mesh.k + 1])
    p = mesh.p.copy()
    low, high = p[-1].min(), p[-1].max()
    p[-1] = (2 * high - p[-1] if mirrored else p[-1] + high - low) + touch.gap * shortest
    p[:-1] += 0.1 * shortest
    bodies = dict(zip(("lower", "upper"), np.split(np.arange(2 * mesh.nt, dtype=np.int32), 2), strict=True))
    both = ElementMesh(np.hstack([mesh.p, p]), np.hstack([mesh.t, mesh.t + mesh.nv]), subdomains=bodies, element=mesh.element)
    return both.with_degree(degree) if mirrored else both


def contact_of(touch: Touch, mesh: ElementMesh, young: float, rng: np.random.Generator) -> Any:
    """Return the specification of a contact on this mesh, whose material has about this Young's modulus."""
    size, shortest = float(np.ptp(mesh.p)), shortest_edge(mesh)
    friction = Friction(touch.friction, slip_speed=10.0 ** rng.uniform(-6, 3), slip_length=1e-3 * size) if touch.friction else None
    given: dict[str, Any] = {"friction": friction, "name": "touch"}
    if touch.is_rigid:
        h = size / max(1.0, mesh.nt ** (1 / mesh.k))
        way = 0.1 * h * rng.standard_normal(mesh.d)
        middle, half = mesh.p.mean(axis=1), rng.random(mesh.t.shape[1]) < 0.5
        given |= {
            "shape": _shape(touch, mesh, h, rng),
            "stiffness": touch.stiffness and touch.stiffness * young / h,
            "onset": touch.onset * h,
            "motion": {"rests": None, "ramp": way, "function": lambda t: way * np.sin(1e3 * t)}[touch.motion],
            "where": None if touch.where == "all" else half if mesh.k < mesh.d else lambda x: x[0] < middle[0],
        }
    else:
        given |= {
            "first": "lower" if touch.kind == "two bodies" else None,
            "second": "upper" if touch.kind == "two bodies" else None,
            "distance": touch.distance * shortest,
            "stiffness": touch.stiffness and min(touch.stiffness, 100.0) * young,
        }
    if touch.wrong is not None and touch.wrong[0] in given:
        given[touch.wrong[0]] = WRONG[touch.wrong[1]]
    return (RigidContact if touch.is_rigid else MeshContact)(**given)


def _shape(touch: Touch, mesh: ElementMesh, h: float, rng: np.random.Generator) -> Any:
    """Return a shape below the lowest point of the mesh, or around the mesh, with the gap of the contact."""
    low, high, d = mesh.p.min(axis=1), mesh.p.max(axis=1), mesh.d
    middle, size, up = (low + high) / 2, float(np.ptp(mesh.p)), np.eye(d)[-1]
    below = middle + (low[-1] - middle[-1] - touch.gap * h) * up
    radius = size * 10.0 ** rng.uniform(-1, 0.5)
    around = float(np.linalg.norm(mesh.p - middle[:, None], axis=0).max()) + touch.gap * h
    axis = np.append(rng.standard_normal(d - 1), 0.0)
    if touch.kind == "plane":
        return RigidPlane(below, up + 0.2 * rng.standard_normal(d))
    if touch.kind == "sphere":
        return RigidSphere(below - radius * up, radius)
    if touch.kind == "inside a sphere":
        return RigidSphere(middle, around, inside=True)
    if touch.kind == "cylinder":
        return RigidCylinder(below - radius * up, tuple(axis), radius)
    if touch.kind == "inside a cylinder":
        return RigidCylinder(middle, tuple(axis), around, inside=True)
    corner = below + radius * (1 - up)
    return RigidBox(below - radius, corner, radius=0.9 * radius / 2 if touch.kind == "rounded box" else 0.0)


def approach(touch: Touch, mesh: ElementMesh) -> Array:
    """Return the velocity (nv, d) with which a body of size 1 approaches what it touches."""
    v = np.zeros((mesh.nv, mesh.d))
    v[np.unique(mesh.t[:, mesh.elements("upper")]) if touch.kind == "two bodies" else slice(None), -1] = -1.0
    return v


def check_refusal(touch: Touch | None, error: StvkError) -> None:
    """Check that an error explains itself, and that the error of a wrong argument of a contact names the contact."""
    assert len(str(error)) > 20, f"error = {error!r}; expected an explanation"
    if touch is not None and touch.wrong is not None and "Contact" in type(error).__name__:
        assert any(name in str(error) for name in ("Contact", "Friction", "Rigid")), f"error = {error!r}; expected its argument"


def check_contact(touch: Touch, system: System, u: Array, v: Array, edge: float, limit: float) -> None:
    """Check force, stiffness, work, friction, balance and the step limit of a contact at `u` with directions `v` of size 1."""
    term: Any = system.contacts[0]
    x, w = u.reshape(-1, system.mesh.d), v.reshape(-1, system.mesh.d)
    W, F = term.energy_and_force(x), force_of(term, x)
    assert W >= 0 and np.isfinite(W) and np.isfinite(F).all(), f"an energy of {W}, or a force that is no number"
    noise = np.zeros_like(x)
    term.add_round_off(x, noise)
    noise = 10 * max(limit, 1e-15) * noise
    _check_slopes(term, x, w, edge, noise)
    for size in (1.0, 1e-3, 1e-9):
        _check_work(term, x, x + size * min(edge, _free(term, x, edge * w)) * w, limit, noise)
    if not touch.is_rigid:
        total, torque = F.sum(axis=0), np.cross(system.mesh.p.T + x, F).sum(axis=0)
        arm = float(np.abs(system.mesh.p.T + x).max())
        assert np.abs(total).max() <= noise.sum(), f"the forces of the contact have the sum {np.abs(total).max():g}"
        assert np.abs(torque).max() <= arm * noise.sum(), f"the torques of the contact have the sum {np.abs(torque).max():g}"
    pressure, gap, area = term.evaluated(x)
    assert np.isfinite(pressure).all() and (pressure >= 0).all() and area >= 0, "a pressure or an area that is negative"
    assert (W > 0) == bool(F.any()) or W < 1e-250 or not (gap < 0).any(), "a contact with an energy has no force"
    _check_friction(system, x, 1e-3 * edge * w)


def force_of(term: Any, x: Array) -> Array:
    """Return the force (nv, d) of a term at displacements `x` (nv, d) [N]."""
    force = np.zeros_like(x)
    term.energy_and_force(x, force)
    return force


def _free(term: Any, x: Array, way: Array) -> float:
    """Return a part of the way at which nothing is passed, and check that the limit of the contact says so."""
    s = min(1.0, 0.9 * term.contact_limit(x, way))
    assert s > 0 and not term.passes(x, x + s * way), f"a contact is passed at 0.9 of its limit {s / 0.9:g}"
    return s


def _check_slopes(term: Any, x: Array, w: Array, edge: float, noise: Array) -> None:
    """Check by central differences that the force is the derivative of the energy, and the stiffness that of the force.

    Both have kinks, where a point begins to touch, so that one of several differences has to agree, and none is taken at a kink.
    """
    if (np.abs(term.evaluated(x)[1]) < 1e-9 * edge).any():
        return
    if hasattr(term, "look"):
        term.look(x)
    F, Kw = force_of(term, x), np.zeros_like(x)
    paired = term.with_blocks(len(x), x.shape[1], np.float64)
    paired.pairs.add_product(paired.blocks(x)[1], w, Kw)
    errors = []
    for step in edge * np.array(STEPS):
        (low, f), (high, g) = ((term.energy_and_force(x + s * w), force_of(term, x + s * w)) for s in (-step, step))
        of_energy = abs((high - low) / (2 * step) - np.vdot(F, w))
        of_force = np.abs((g - f) / (2 * step) - Kw).max()
        some = float(noise.sum())
        errors.append(
            (
                of_energy / (SLOPE * float((np.abs(F) * np.abs(w)).sum()) + some + 1e-14 * (abs(low) + abs(high)) / step + 1e-250),
                of_force / (SLOPE * np.abs(Kw).max() + float(noise.max()) / step + 1e-250),
            )
        )
    of_energy, of_force = np.min(errors, axis=0)
    assert of_energy <= 1, f"the force of a contact is not the derivative of its energy: {of_energy:g} times the limit"
    assert of_force <= 1, f"the stiffness of a contact is not the derivative of its force: {of_force:g} times the limit"


def _check_work(term: Any, x0: Array, x1: Array, limit: float, noise: Array) -> None:
    if term.passes(x0, x1):
        return
    before, after = term.energy_and_force(x0), term.energy_and_force(x1)
    force = np.zeros_like(x0)
    term.mean_force(x0, x1, (0.5, 0.5), 0.5, force)
    work, size = float(np.vdot(force, x1 - x0)), float((np.abs(force) + noise).ravel() @ np.abs(x1 - x0).ravel())
    allowed = WORK * size + limit * (before + after) + float(noise.sum() * np.abs(x1 - x0).max())
    assert np.isfinite(work) and abs(work - (after - before)) <= allowed, f"a work of {work:g}; expected {after - before:g}"


def _check_friction(system: System, x: Array, slip: Array) -> None:
    """Check that friction takes energy, that other states do not change it, and that its history can be restored."""
    body = for_analysis(system, in_time=True)
    start = StepStart(body.advanced(body.first_history(), x.ravel(), Moment(0.0, 1.0)), in_time=True)
    (term,) = body.contacts_at(Moment(1e-3, 1.0, step=start))
    found = force_of(term, x + slip)
    if term.has_friction:
        lost = term.work(x, x + slip)[1]
        assert np.isfinite(lost) and lost >= 0, f"friction takes {lost:g} J"
    force_of(term, x)
    body.look((x + slip).ravel())
    body.return_to(start.history)
    (again,) = body.contacts_at(Moment(1e-3, 1.0, step=start))
    assert np.array_equal(force_of(again, x + slip), found), "the same history gives another force"


def with_touch(recipe: Any, touch: Touch) -> Any:
    """Return a recipe with a contact: a solid or a surface, as a rule in space, whose states do not reach far."""
    k = max(recipe.k, 2)
    return replace(recipe, k=k, d=3 if recipe.seed % 8 else max(recipe.d, k), amount=min(recipe.amount, 0.1), touch=touch)
