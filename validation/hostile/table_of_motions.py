"""Calls of motions in time: integrators, damping, critical steps, modes, ledgers."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from skfem_stvk import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    PrincipalStressLimit,
    Rayleigh,
    RigidContact,
    RigidPlane,
    Run,
    Simulation,
    StVK,
    System,
    VelocityVerlet,
    critical_elements,
    critical_step,
    modes,
    simulate,
)
from skfem_stvk.solvers.dynamics import LargestFrequency, Ledger, Modes

from .call import Call
from .small_bodies import FLAG, NOT_NEGATIVE, NUMBER, OPTIONAL, PLACE, POSITIVE, TEXT, call, displacements, drawn, mesh, system

IMPLICIT = (BackwardEuler, LinearBackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)
MORE: dict[type, dict[str, Any]] = {Newmark: {"beta": 0.5, "gamma": 0.5}, GeneralizedAlpha: {"rho": 0.5}}
NAMES = ["time", "a"]
#: Legal in ledgers, because a diverging motion writes them.
NOT_FINITE = frozenset({"NaN in it", "inf in it"})


@cache
def vibrations() -> Modes:
    """Return the modes of the body."""
    return modes(system(), 3)


@cache
def motion() -> Run:
    """Return a motion of two steps."""
    return simulate(system(), EnergyMomentum(0.25), until=0.5, quiet=True)


def calls() -> list[Call]:
    """Return the calls of this table."""
    u = displacements()
    options = {"dt": POSITIVE, "rtol": POSITIVE, "rho": NOT_NEGATIVE, "beta": POSITIVE, "gamma": POSITIVE}
    damping = [EdgeDamping(0.5)]
    return [
        *(
            call(
                kind.__name__,
                _run_with(kind),
                options,
                {"solver": "solver"},
                dt=0.125,
                tangent="exact",
                solver="superlu",
                rtol=0.0009765625,
                **MORE.get(kind, {}),
            )
            for kind in IMPLICIT
        ),
        *(call(kind.__name__, kind, {"dt": POSITIVE | OPTIONAL}, dt=0.125) for kind in (ForwardEuler, VelocityVerlet)),
        call("Rayleigh", Rayleigh, dict.fromkeys(("alpha", "beta"), NOT_NEGATIVE), alpha=0.5, beta=0.25),
        call("EdgeDamping", EdgeDamping, {"tau": NOT_NEGATIVE}, tau=0.5),
        call(
            "PrincipalStressLimit",
            PrincipalStressLimit,
            {"limit": POSITIVE | {"inf", "inf in it", "one longer"}},
            {"limit": "limit", "every": "every"},
            limit=[0.5, 2.0],
            every=2,
        ),
        call(
            "critical_step",
            critical_step,
            {"u": OPTIONAL, "damping": OPTIONAL | {"empty list"}},
            {"system": "System"},
            system=system(),
            u=u,
            damping=damping,
        ),
        call(
            "critical_elements",
            lambda **given: critical_elements(**given).steps,
            {"u": OPTIONAL},
            {"system": "System"},
            system=system(),
            n=2,
            u=u,
        ),
        call(
            "LargestFrequency",
            LargestFrequency,
            {"damping": OPTIONAL | {"empty list"}},
            {"system": "System"},
            system=system(),
            damping=damping,
        ),
        call("LargestFrequency.at", LargestFrequency(system()).at, u=u),
        call("LargestFrequency.bound", LargestFrequency(system()).bound, u=u),
        call(
            "modes",
            lambda **given: modes(**given).eigenvalues,
            {"u": OPTIONAL},
            {"system": "System"},
            system=system(),
            n=2,
            u=u,
            mass="lumped",
            solver="superlu",
        ),
        call(
            "Modes.state",
            vibrations().state,
            {"number": frozenset({"0", "-1"}), "scale": NUMBER | OPTIONAL},
            {"number": "[Mm]ode"},
            number=1,
            scale=0.5,
        ),
        call(
            "Modes.plot",
            drawn(lambda **given: vibrations().plot(**given, backend="matplotlib")),
            {"number": frozenset({"0", "-1"}), "scale": NUMBER | OPTIONAL},
            {"number": "[Mm]ode"},
            number=1,
            scale=0.5,
        ),
        call("Modes.save", vibrations().save, {"scale": NUMBER | OPTIONAL}, path="modes.pvd", scale=0.5),
        call("Ledger", Ledger, {"rows": OPTIONAL | {"one longer"} | NOT_FINITE}, names=NAMES, rows=[[0.0, 1.0], [1.0, 2.0]]),
        Call("Ledger.append", lambda: (_ledger().append, {"values": [2.0, 3.0]}), {"values": NOT_FINITE}),
        Call("Ledger.truncate", lambda: (_ledger().truncate, {"steps": 1}), {"steps": frozenset({"0"})}),
        Call("Ledger.rows", lambda: (_ledger().rows, {"first": 1}), {"first": frozenset({"0"})}),
        Call("Ledger.plot", lambda: (drawn(motion().ledger.plot), {"path": "ledger.svg"}), {"path": OPTIONAL}),
        Call("Ledger.save", lambda: (_ledger().save, {"path": "ledger.csv"})),
        Call(
            "Ledger of a name",
            lambda: (lambda name: _ledger()[name], {"name": "a"}),
            {"name": frozenset({"text"})},
            {"name": "column"},
        ),
        call(
            "Simulation",
            _driven,
            {
                "t0": NUMBER,
                "u0": OPTIONAL,
                "v0": OPTIONAL,
                "mass": OPTIONAL,
                "damping": OPTIONAL | {"empty list"},
                "halvings": OPTIONAL | {"0"},
                "ledger": FLAG,
                "pushed": frozenset({"empty list"}),
                "moved": frozenset({"empty list"}),
            },
            {"t0": r"\bt0\b|after t ="},
            system=system(),
            integrator=EnergyMomentum(0.125),
            pushed=["tip"],
            moved=[],
            u0=np.zeros(12),
            v0=np.zeros(12),
            t0=0.0,
            mass="lumped",
            damping=[],
            halvings=1,
            on_failure="raise",
            ledger=True,
        ),
        call("Simulation.step", _stepped, {"until": POSITIVE | OPTIONAL}, until=0.25, tip=np.array([0.25, -0.5])),
        Call("Simulation.u_at", lambda: (_simulation().u_at, {"nodes": "left"}), {}, {"nodes": PLACE}),
        Call("Simulation.mean", lambda: (_simulation().mean, {"name": "left"}), {}, {"name": rf"\bname\b|{PLACE}"}),
        Call("Simulation.reaction", lambda: (_simulation().reaction, {"name": "left"}), {}, {"name": rf"\bname\b|{PLACE}"}),
        Call("Simulation.contact", lambda: (_touching().contact, {"name": "floor"}), {}, {"name": r"\bname\b|contact"}),
        Call("Simulation.restore", _restored, {}, {"saved": "restore"}),
        call("Simulation.save", _saved, {"path": TEXT - {"empty text", "long text", "NUL"}}, path="simulation"),
        call(
            "Simulation.remove",
            _removed,
            {"elements": frozenset({"empty list", "empty array"})},
            {"elements": "region|subdomain|elements"},
            elements=np.array([3]),
        ),
        Call("Run.reaction", lambda: (motion().reaction, {"where": "left"}), {"where": OPTIONAL}, {"where": PLACE}),
        Call(
            "Run.plot",
            lambda: (drawn(motion().plot), {"field": "von_mises_stress", "backend": "matplotlib"}),
            {"backend": OPTIONAL},
        ),
        Call("Run.save", lambda: (motion().save, {"path": "run.vtu", "fields": ["cauchy"]}), {"fields": frozenset({"empty list"})}),
    ]


def _run_with(kind: type) -> Any:
    """Return a function that runs two steps of an integrator and returns status and displacements."""

    def run(**given: Any) -> Any:
        found = simulate(system(), kind(**given), until=0.25, quiet=True, raise_on_failure=False)
        return found.status.value, found.u

    return run


@cache
def _restored() -> tuple[Any, dict[str, Any]]:
    sim = _simulation()
    return sim.restore, {"saved": sim.copy_state()}


def _simulation() -> Simulation:
    """Return a driven motion after one step."""
    sim = Simulation(system(), EnergyMomentum(0.125), pushed=["tip"])
    sim.step()
    return sim


@cache
def _touching() -> Simulation:
    """Return a driven motion with a contact."""
    floor = RigidContact(RigidPlane((0.0, 0.1), (0.0, 1.0)), stiffness=1.0, name="floor")
    return Simulation(System(mesh(), [StVK(young=2.0, poisson=0.25, density=1.0), floor]), EnergyMomentum(0.125))


def _driven(**given: Any) -> Any:
    sim = Simulation(**given)
    sim.step()
    return sim.t, sim.u


def _stepped(**given: Any) -> Any:
    sim = Simulation(system(), EnergyMomentum(0.125), pushed=["tip"])
    sim.step(**given)
    return sim.t, sim.u


def _saved(path: Any) -> None:
    _simulation().save(path, overwrite=True)


def _removed(elements: Any) -> Any:
    sim = Simulation(system(), EnergyMomentum(0.125))
    sim.remove(elements)
    return sim.system.mesh.nt


def _ledger() -> Ledger:
    return Ledger(NAMES, [[0.0, 1.0], [1.0, 2.0]])
