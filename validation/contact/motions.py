"""Motions with contact: a block on a slope, a bar that hits a wall, and a ball that bounces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import skfem

from skfem_stvk import (
    BackwardEuler,
    EnergyMomentum,
    Friction,
    Gravity,
    NeoHookean,
    RigidContact,
    RigidPlane,
    StVK,
    System,
    simulate,
)
from skfem_stvk.arguments import Array
from skfem_stvk.mesh import ElementMesh, box

from ..study import Study
from .check import Check, study_of

#: The slope: coefficient of friction, gravity [m/s^2], speed up to which friction rises [m/s], and angles in friction angles.
FRICTION, GRAVITY, SLIP_SPEED, ANGLES = 0.3, 9.81, 1e-3, (1.01, 1.1, 1.3)
#: The bar: length and width [m], Young's modulus [Pa], density [kg/m^3], elements along, and speed in units of its sound's.
LENGTH, WIDTH, YOUNG, DENSITY, ELEMENTS, SPEED = 1.0, 0.1, 1e6, 1e3, 80, 1e-3
SOUND = float(np.sqrt(YOUNG / DENSITY))
#: Limit of the energy that the ledger of `EnergyMomentum` loses, in units of the first kinetic energy.
CLOSURE = 1e-12

FLOOR = RigidPlane((0, 0, 0), (0, 0, 1))


def slope(quick: bool) -> Study:
    """Compare a block on a slope with Coulomb's law: it creeps below the friction angle, and slides above it."""
    angle = 0.99 * np.arctan(FRICTION)
    creeping = 1 - np.sqrt(1 - np.tan(angle) / FRICTION)
    checks = [Check("angle 0.99: speed of creep/slip_speed", slid(angle)[1][-1] / SLIP_SPEED, float(creeping), 1e-3)]
    for part in ANGLES:
        angle = part * np.arctan(FRICTION)
        t, speed = slid(angle)
        half = len(t) // 2
        measured = float((speed[-1] - speed[half]) / (t[-1] - t[half]))
        expected = GRAVITY * (np.sin(angle) - FRICTION * np.cos(angle))
        checks.append(Check(f"angle {part:g}: acceleration [m/s^2]", measured, float(expected), 1e-3))
    return study_of(
        "A block on a slope, by its angle in friction angles",
        "speed of creep and acceleration agree with Coulomb's law to 1e-3",
        checks,
        f"mu = {FRICTION:g}; BackwardEuler with dt = 2 ms over 0.2 s, acceleration over the second half",
    )


def slid(angle: float) -> tuple[Array, Array]:
    """Return times and mean speeds of a block that starts at rest on a slope."""
    mesh, k = box((0.1, 0.1, 0.05), (2, 2, 1)), 4e8
    friction = Friction(FRICTION, slip_speed=SLIP_SPEED)
    plane = RigidContact(FLOOR, lambda x: x[2] == 0, stiffness=k, friction=friction)
    down = Gravity((GRAVITY * np.sin(angle), 0, -GRAVITY * np.cos(angle)))
    depth = DENSITY * GRAVITY * np.cos(angle) * 0.05 / k
    body = System(mesh, [StVK(young=YOUNG, poisson=0.2, density=DENSITY), plane, down])
    run = simulate(body, BackwardEuler(2e-3), until=0.2, u0=np.tile([0, 0, -depth], mesh.nv), quiet=True)
    return run.ledger["time"], run.ledger["linear_momentum_x"] / (DENSITY * 0.1 * 0.1 * 0.05)


def bar(quick: bool) -> Study:
    """Compare a bar that hits a wall with the solution of the wave equation."""
    checks = [check for k in (1.0, 10.0) for check in impact(k)]
    soft = list(impact(10.0, onset=0.05))
    return study_of(
        "A bar hits a wall, by stiffness of the contact",
        "the impact lasts 2 L/c to 3 %, its force is rho c A v to 0.5 %, and the energy is kept to 1e-12",
        [*checks, soft[2]],
        f"nu = 0, v/c = {SPEED:g}, {ELEMENTS} elements along; EnergyMomentum with c dt/h = 0.5",
        "force: mean over 0.3 to 1.7 L/c after the first touch",
    )


def impact(k: float, onset: float = 0.0) -> Iterator[Check]:
    """Yield duration, force and lost energy of a bar that hits a wall of stiffness `k` [E/h] and of this onset [h]."""
    name = f"k = {k:g} E/h" + f", onset {onset:g} h" * (onset > 0)
    mesh, h, v = box((WIDTH, WIDTH, LENGTH), (1, 1, ELEMENTS)), LENGTH / ELEMENTS, SPEED * SOUND
    wall = RigidContact(FLOOR, lambda x: x[2] == 0, stiffness=k * YOUNG / h, onset=onset * h)
    body = System(mesh, [StVK(young=YOUNG, poisson=0.0, density=DENSITY), wall])
    travel = LENGTH / SOUND
    v0 = np.tile([0, 0, -v], mesh.nv)
    ledger = simulate(body, EnergyMomentum(h / SOUND / 2), until=3 * travel, v0=v0, quiet=True).ledger
    t = ledger["time"] / travel
    force = np.diff(ledger["linear_momentum_z"]) / np.diff(t) / travel / (DENSITY * SOUND * WIDTH**2 * v)
    touches = np.flatnonzero(force > 0.05)
    middle = (t[1:] + t[:-1]) / 2
    plateau = force[(middle > 0.3) & (middle < 1.7)].mean()
    yield Check(f"{name}: duration/(2 L/c)", float(t[touches[-1] + 1] - t[touches[0]]) / 2, 1.0, 0.03)
    yield Check(f"{name}: force/(rho c A v)", float(plateau), 1.0, 5e-3)
    yield Check(f"{name}: largest force/(rho c A v)", float(force.max()))
    yield Check(f"{name}: lost energy/first kinetic energy", _lost(ledger), 0.0, CLOSURE)


def bounce(quick: bool) -> Study:
    """Check the energy of a ball that bounces on a plane without friction."""
    mesh = ElementMesh.of(skfem.MeshTet.init_ball(2))
    plane = RigidContact(RigidPlane((0, 0, -1.05), (0, 0, 1)))
    body = System(mesh, [NeoHookean(young=1e3, poisson=0.3, density=1.0), plane])
    v0 = np.tile([0.3, 0, -2.0], mesh.nv)
    ledger = simulate(body, EnergyMomentum(2e-3), until=0.4, v0=v0, quiet=True).ledger
    speed = ledger["linear_momentum_z"] / -ledger["linear_momentum_z"][0]
    kinetic, stored = ledger["kinetic_energy"][0], ledger["strain_energy RigidContact 1"].max()
    return study_of(
        "A ball bounces on a plane without friction",
        "the energy is kept to 1e-12, and the ball leaves with its speed to 5 %",
        [
            Check("lost energy/first kinetic energy", _lost(ledger), 0.0, CLOSURE),
            Check("speed after/speed before", float(speed[-1]), 1.0, 0.05),
            Check("largest energy of the contact/first kinetic energy", float(stored / kinetic)),
        ],
        f"{mesh.nt} tetrahedra, NeoHookean with nu = 0.3; EnergyMomentum with dt = 2 ms over 0.4 s",
    )


def _lost(ledger: Mapping[str, Array]) -> float:
    """Return the largest error of the balance of energy in units of the first kinetic energy."""
    return float(np.abs(ledger["closure_error"]).max() / ledger["kinetic_energy"][0])
