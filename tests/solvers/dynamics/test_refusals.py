"""Wrong arguments of motions, integrators, damping, modes and critical steps are refused, with their names and before any work."""

from dataclasses import FrozenInstanceError
from functools import partial

import numpy as np
import pytest
from motions import MESHES, clamped, spinning, velocities
from springs import PointSpring

from skfem_stvk import (
    BackwardEuler,
    ContactError,
    ElementMesh,
    LoadError,
    MaterialError,
    Pressure,
    PrincipalStressLimit,
    ReducedSystem,
    RegionError,
    RigidContact,
    RigidSphere,
    Simulation,
    StateError,
    StVK,
    StvkError,
    SupportError,
    System,
    critical_elements,
    critical_step,
    modes,
    simulate,
)
from skfem_stvk.solvers.dynamics import (
    EdgeDamping,
    EnergyMomentum,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Rayleigh,
    VelocityVerlet,
)

SYSTEM = spinning(2).system
V0, N = velocities(SYSTEM.mesh), SYSTEM.ndofs
PRESSED = Pressure("right", 0.3)
TANGENTS = "'clamped', 'diagonal', 'exact', 'gauss-newton', 'rest', 'warped'"


def call(system=SYSTEM, integrator=None, **options):
    options = {"until": 0.1, "v0": V0, "quiet": True} | options
    return simulate(system, integrator or VelocityVerlet(0.01), **options)


def ran():
    return clamped(2).run(EnergyMomentum(0.02), 0.04)


def crude(tangent):
    return LinearBackwardEuler(1e-3, tangent=tangent)


def strip(density=1.0, more=(), **options):
    mesh = MESHES[2]
    return System(mesh, [StVK(young=3.0, poisson=0.3, density=density), *more], **options)


def gripped(**options):
    return strip(fixed={"left": "xy"}, prescribed={"right": "xy"}, **options)


def driven_by(system, **options):
    return Simulation(system, LinearBackwardEuler(0.01), **options)


def stepped(sim):
    sim.step()
    return sim


def balls(moved, name="ball", **options):
    """Return a simulation of a body with a disc of this name, whose displacement is an input."""
    disc = RigidContact(RigidSphere((0.5, 2.0), 0.5), name=name, **options)
    return Simulation(gripped(more=[disc]), BackwardEuler(0.01), moved=moved)


def right(x):
    return x[0] > 0.9


MESH = MESHES[2]
NAMED = ElementMesh(MESH.p, MESH.t, boundaries=MESH.boundaries | {"until": MESH.boundaries["right"]})
HELD = System(NAMED, StVK(young=3.0, poisson=0.3, density=1.0), fixed={"left": "xy"})
SPRUNG = strip(more=[PointSpring(np.arange(3), (1.5, 0.8), 0.05)])
#: Errors, their messages, and the calls that raise them; options are those of `call`.
REFUSALS = [
    (StvkError, "system = ElementMesh: .*; expected a System", {"system": MESHES[2]}),
    (StvkError, "dtype = float32 of the system; expected float64: System", {"system": strip(dtype=np.float32)}),
    (
        StvkError,
        r"integrator is the class EnergyMomentum; expected one of .*, such as EnergyMomentum\(dt",
        {"integrator": EnergyMomentum},
    ),
    (StvkError, "integrator is 'Newmark'; expected one of ForwardEuler", {"integrator": "Newmark"}),
    (StateError, rf"u0 has shape \({N // 2}, 2\); expected \({N},\), .*u0.ravel\(\)", {"u0": np.zeros((N // 2, 2))}),
    (StvkError, "mass = ''; known: 'consistent', 'lumped'", {"mass": ""}),
    (StateError, r"v0 has shape \(3,\).* The mesh or its degree may differ", {"v0": np.zeros(3)}),
    (StateError, "u0 = 'zero'; expected .* take its .u", {"u0": "zero"}),
    (StateError, r"u0 = \[\[1\], \[1, 2\]\]; expected", {"u0": [[1], [1, 2]]}),
    (StateError, rf"v0 is not finite in {N} entries", {"v0": np.full(N, np.nan)}),
    (StateError, "v0 .* complex128; expected", {"v0": np.zeros(N, dtype=complex)}),
    (StvkError, "until = 0 s; expected an end after t = 0 s, the time of the motion", {"until": 0.0}),
    (StvkError, "until = 0.1 s; expected an end after t = 0.2 s", {"t0": 0.2}),
    (StvkError, "until = nan; expected a time in seconds", {"until": np.nan}),
    (StvkError, "t0 = '0'; expected a time in seconds", {"t0": "0"}),
    (StvkError, "mass = 'consistent'; expected 'lumped' for VelocityVerlet", {"mass": "consistent"}),
    (MaterialError, "density", {"system": strip(density=None)}),
    (StvkError, r"probes = \[17\]; expected locations by name, such as \{'tip': \[17\]\}", {"probes": [17]}),
    (RegionError, "probe 'A': no vertex there", {"probes": {"A": []}}),
    (RegionError, r"probe 'A': the vertices name 1 vertex \(99\) outside", {"probes": {"A": [99]}}),
    (StvkError, "expected locations by name", {"probes": {"": [1]}}),
    (StvkError, "probe 'A'", {"probes": {"A": "no such place"}}),
    (StvkError, "save = True; expected the path of a file such as 'flag.pvd'", {"save": True}),
    (StvkError, "checkpoint = 3; expected the path of a folder such as 'flag'", {"checkpoint": 3}),
    (StvkError, "every = 0; expected a whole number of steps, at least 1", {"every": 0}),
    (StvkError, "every = 0.5; expected a whole number", {"every": 0.5}),
    (StvkError, "every = -1; expected a whole number", {"every": -1}),
    (StvkError, "'flag.xdmf'; expected a path that ends in .pvd, such as flag.pvd", {"save": "flag.xdmf"}),
    (StvkError, "The checkpoint no/flag cannot be written", {"checkpoint": "no/flag"}),
    (StvkError, "resume = True; expected a checkpoint", {"resume": True, "v0": None}),
    (LoadError, "Nothing moves the body: .* Add Gravity", {"v0": None}),
    (
        SupportError,
        r"3 vertices \(0, 1, 2\): u0 differs from the supports at t0 = 0 s by up to 0\.1 m\..* starts at u0, "
        r"or start from an equilibrium",
        {"system": strip(prescribed={"left": {"x": 0.1}})},
    ),
    (SupportError, "at t0 = 0 s", {"system": strip(prescribed={"left": {"x": lambda t: 0.01 + t}})}),
    (
        StvkError,
        "dt = 1e-170; expected a time step between 1e-150 s and 1e150 s: choose other units",
        lambda: EnergyMomentum(1e-170),
    ),
    (StvkError, "dt = 0.0; expected a time step in seconds, a positive number[.]$", lambda: EnergyMomentum(0.0)),
    (StvkError, "dt = None; expected a time step", lambda: EnergyMomentum(None)),
    (StvkError, "dt = -1.0; .* or None for a stable one", lambda: VelocityVerlet(-1.0)),
    (StvkError, "dt = True", lambda: VelocityVerlet(True)),
    (StvkError, f"tangent = 'newton'; known: {TANGENTS}", lambda: Newmark(1.0, tangent="newton")),
    (StvkError, "rtol = 1; expected a number between 0 and 1", lambda: Newmark(1.0, rtol=1)),
    (StvkError, "Newmark: beta = 'a'", lambda: Newmark(1.0, beta="a")),
    (StvkError, r"beta = 0.2, gamma = 0.5; expected .*beta >= gamma/2", lambda: Newmark(1.0, beta=0.2)),
    (StvkError, "expected gamma >= 1/2", lambda: Newmark(1.0, gamma=0.4)),
    (StvkError, "rho = 1.1; expected a spectral radius from 0", lambda: GeneralizedAlpha(1.0, rho=1.1)),
    (StvkError, "rho = True", lambda: GeneralizedAlpha(1.0, rho=True)),
    *(
        (StvkError, f"LinearBackwardEuler: tangent='{tangent}' would .*{what}.*Take", {"integrator": crude(tangent), **options})
        for tangent, what, options in (
            ("diagonal", "masses between vertices", {"mass": "consistent"}),
            ("diagonal", "damping between vertices", {"damping": Rayleigh(beta=0.1)}),
            ("diagonal", "damping between vertices", {"damping": EdgeDamping(0.1)}),
            ("rest", "as if the body had not rotated", {"damping": EdgeDamping(0.1)}),
        )
    ),
    (StvkError, "would also damp PointSpring", {"system": SPRUNG, "integrator": crude("exact"), "damping": EdgeDamping(1e-3)}),
    *(
        (StvkError, rf"{name} = .*; expected a number \[.*s\], not negative", partial(make, **{name: value}))
        for make, name in ((Rayleigh, "alpha"), (Rayleigh, "beta"), (EdgeDamping, "tau"))
        for value in (-1e-9, np.nan, np.inf, "0.1", None, np.ones(2), 1j)
    ),
    *(
        (StvkError, r"damping = .*; expected Rayleigh\(alpha=..., beta=...\), EdgeDamping\(tau\), or a list", {"damping": damping})
        for damping in (0.1, "Rayleigh", Rayleigh, [0.1], [Rayleigh(alpha=0.1), 0.2], [[EdgeDamping(1.0)]])
    ),
    *((StvkError, "remove = ", {"remove": rule}) for rule in ("stress", PrincipalStressLimit, 1e6)),
    *(
        (StvkError, "PrincipalStressLimit: limit", partial(PrincipalStressLimit, limit))
        for limit in (0.0, -1.0, np.nan, "high", [[1.0]])
    ),
    *((StvkError, f"expected a number of modes, from 1 to {N}", partial(modes, SYSTEM, n)) for n in (0, -1, 2.0, True, None, "10")),
    (StvkError, "number = 3; expected a mode from 0 to 2", lambda: modes(SYSTEM, 3).state(3)),
    (StvkError, "t = 'a'; expected the load factor", lambda: modes(SYSTEM, t="a")),
    (StvkError, "solver = 'lanczos'; expected", lambda: modes(SYSTEM, solver="lanczos")),
    (StvkError, "mass = 'heavy'; known: 'consistent', 'lumped'", lambda: modes(SYSTEM, mass="heavy")),
    (StvkError, "forms no matrix; expected 'lumped'", lambda: modes(SYSTEM, 8, mass="consistent", solver="block-jacobi-cg")),
    (StvkError, "forms no matrix; expected 'lumped'", lambda: modes(SYSTEM, 8, mass="consistent", solver="ssor-cg")),
    (StvkError, "Follower loads make K unsymmetric", lambda: modes(strip(more=[PRESSED]), 3, u=0.01 * V0, solver="amg-cg")),
    *((MaterialError, "density", partial(analysis, strip(density=None))) for analysis in (modes, critical_step, critical_elements)),
    *((StateError, "u has shape", partial(analysis, SYSTEM, u=np.zeros(3))) for analysis in (modes, critical_step)),
    (StvkError, "expected Rayleigh", lambda: critical_step(SYSTEM, damping=0.1)),
    (
        SupportError,
        "reaction: no support and no foundation acts at 'right', so there is no reaction",
        lambda: ran().reaction("right"),
    ),
    (RegionError, r"reaction: the mesh has no boundary .* 'lef'.*Did you mean 'left'", lambda: ran().reaction("lef")),
    (SupportError, "the body has no supports", lambda: call().reaction()),
    (SupportError, r"components without a value.*with_boundaries", lambda: strip(prescribed=[(lambda x: x[0] > 0.9, "xy")])),
    (SupportError, "components of this mesh", lambda: strip(prescribed={"right": "xw"})),
    (
        SupportError,
        "Prescribed twice, once as an input at 'right'",
        lambda: strip(prescribed=[("right", "xy"), (right, {"x": 0.1})]),
    ),
    (SupportError, "Both fixed and prescribed", lambda: strip(fixed={"right": "x"}, prescribed={"right": "xy"})),
    (LoadError, "pushed = 'right'", lambda: driven_by(gripped(), pushed=["right"])),
    (StvkError, "pushed = 'right'; expected a list", lambda: driven_by(HELD, pushed="right")),
    (StvkError, r"An input is named 'until', as an argument of step\(\)", lambda: driven_by(HELD, pushed=["until"])),
    (LoadError, "Nothing moves the body", lambda: driven_by(HELD)),
    (StvkError, "before the first step", lambda: driven_by(gripped()).reaction("right")),
    (StvkError, "expected a result of copy_state", lambda: driven_by(gripped()).restore(None)),
    (SupportError, "no support acts at 'right'", lambda: stepped(driven_by(HELD, pushed=["right"])).reaction("right")),
    (StateError, "u0", lambda: driven_by(gripped(), u0=[np.nan])),
    (StvkError, "made of all its elements", lambda: driven_by(ReducedSystem(gripped(), 6, 3, quiet=True)).remove([1])),
    (MaterialError, "density", lambda: driven_by(gripped(density=None))),
    (
        ContactError,
        "moved = 'bal'; expected a RigidContact of the body; known: 'ball'. Did you mean 'ball'",
        lambda: balls(["bal"]),
    ),
    (
        ContactError,
        "moved = 'ball': RigidContact 'ball' has a motion; expected motion=None",
        lambda: balls(["ball"], motion=(0, 0)),
    ),
    (StvkError, r"moved = 'ball'; expected a list of different names, such as \['ball'\]. Name a contact", lambda: balls("ball")),
    (StvkError, "moved = 'right': a location is an input of this name", lambda: balls(["right"], name="right")),
    (
        StvkError,
        r"ball has shape \(1,\); expected \(2,\) components of the displacement of",
        lambda: balls(["ball"]).step(ball=(0,)),
    ),
    (
        StvkError,
        r"bal = \(0, 0\); expected an input .*Did you mean 'ball'\?.*moved=\['ball'\]",
        lambda: balls(["ball"]).step(bal=(0, 0)),
    ),
    (FrozenInstanceError, "alpha", lambda: setattr(Rayleigh(0.1, np.float64(0.2)), "alpha", 3.0)),
]


@pytest.mark.parametrize(("error", "message", "what"), REFUSALS, ids=[f"{i}, {row[1][:40]}" for i, row in enumerate(REFUSALS)])
def test_wrong_arguments_are_refused(error, message, what, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=message):
        what() if callable(what) else call(**what)
    assert not list(tmp_path.iterdir())
