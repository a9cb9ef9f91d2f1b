"""Motions shared by the tests of dynamics.

The meshes are small and unstructured, with both orientations and nu != 0. Materials vary by element.
"""

from typing import Any, NamedTuple

import numpy as np
import skfem
from bodies import turned_round

from skfem_stvk import ElementMesh, Gravity, NodalLoad, StVK, System, Traction, simulate
from skfem_stvk.solvers.dynamics import EdgeDamping, Rayleigh, Status
from skfem_stvk.solvers.dynamics.ledger_rows import LedgerLocations, column_names
from skfem_stvk.solvers.dynamics.motion import Motion
from skfem_stvk.solvers.dynamics.motion_setup import Setup
from skfem_stvk.solvers.dynamics.record import MotionState, RunRecord
from skfem_stvk.solvers.runs.ledger import Ledger

BOTH = [Rayleigh(alpha=0.8, beta=4e-3), EdgeDamping(3e-3)]


def bar(d):
    """Return the mesh of a short bar along x, in the plane or in space, with randomly moved vertices."""
    rng = np.random.default_rng(d)
    make, cells = {2: (skfem.MeshTri, (4, 2)), 3: (skfem.MeshTet, (2, 1, 1))}[d]
    mesh = make.init_tensor(*(np.linspace(0, length, n + 1) for length, n in zip((1.0, 0.5, 0.4), cells, strict=False)))
    return with_ends(mesh, 0.04 * rng.uniform(-1, 1, mesh.p.shape), turned_round(mesh.t, rng))


def with_ends(mesh, moves=0.0, t=None):
    """Return the mesh with names for its ends."""
    ends = {name: mesh.facets[:, mesh.facets_satisfying(lambda x, at=at: x[0] == at)] for name, at in (("left", 0), ("right", 1))}
    return ElementMesh(mesh.p + moves, mesh.t if t is None else t, boundaries=ends)


MESHES = {d: bar(d) for d in (2, 3)}


def material(mesh, young=3.0, seed=5):
    """Return StVK with a different stiffness and density in each element."""
    rng = np.random.default_rng(seed)
    section = {"thickness": 0.7, "plane": "stress"} if mesh.d == 2 else {}
    return StVK(young=young * rng.uniform(0.7, 1.3, mesh.nt), poisson=0.3, density=rng.uniform(0.7, 1.3, mesh.nt), **section)


def velocities(mesh, spin=2.0, drift=0.5, strain=0.6):
    """Return velocities (ndofs,) of a body that rotates, translates and stretches smoothly."""
    x = mesh.p.T - mesh.p.mean(axis=1)
    axis = np.array([0.3, -0.4, 1.0])[3 - mesh.d if mesh.d == 3 else 0 :]
    turning = spin * (np.cross(axis, x) if mesh.d == 3 else np.stack([-x[:, 1], x[:, 0]], axis=1))
    flying = drift * np.array([1.0, -0.6, 0.8])[: mesh.d]
    return (turning + flying + strain * np.sin(3 * x + [0.2, 0.5, 0.9][: mesh.d])).ravel()


def reached(system, integrator=None, **options):
    """Return a run that reaches its end; elements may be inverted."""
    run = simulate(system, integrator, quiet=True, raise_on_failure=False, **options)
    assert run.status in (Status.FINISHED, Status.ENDED_INVERTED), run.message
    return run


class Scene(NamedTuple):
    """System with the initial state of its motion, and whether elements may be inverted at its end."""

    system: System
    v0: Any = None
    damping: Any = None
    u0: Any = None
    inverts: bool = False

    def run(self, integrator, until, **options):
        """Return a quiet run."""
        options = {"u0": self.u0, "v0": self.v0, "damping": self.damping} | options
        if self.inverts and "raise_on_failure" not in options:
            return reached(self.system, integrator, until=until, **options)
        return simulate(self.system, integrator, until=until, **({"quiet": True} | options))


def pushed(t):
    """Return a force or an acceleration that changes with time."""
    return (1.5 * np.sin(4 * t + 0.5), -2.0 * np.cos(3 * t), 1.0 + t * t)


def moved(x, t):
    """Return the displacement of a support that rotates, moves and stretches; at t = 0 it is zero, and its velocity is not."""
    return (0.3 * np.sin(2 * t) + 0.1 * t * x[1], 0.1 * (np.cos(5 * t) - 1) + 0.0 * x[0], 0.2 * t * x[0])


def clamped(d, **options):
    """Return a heavy body fixed at its left end, with a time-dependent traction at its right end."""
    mesh = MESHES[d]
    loads = [Traction("right", lambda t: pushed(t)[:d]), Gravity((0.3, -1.0, 0.5)[:d])]
    return Scene(System(mesh, [material(mesh), *loads], fixed={"left": "xyz"[:d]}), **options)


def driven(d, **options):
    """Return a body with prescribed displacements of its left end."""
    mesh = MESHES[d]
    return Scene(System(mesh, material(mesh), prescribed={"left": lambda x, t: moved(x, t)[:d]}), **options)


def spinning(d, **options):
    """Return a free body that rotates, translates and vibrates."""
    mesh = MESHES[d]
    return Scene(System(mesh, material(mesh)), **{"v0": velocities(mesh), **options})


def loaded(d, **options):
    """Return a free body with time-dependent forces on two vertices."""
    mesh = MESHES[d]
    pull = NodalLoad((1, 5), lambda t: [0.04 * f for f in pushed(t)[:d]])
    return Scene(System(mesh, [material(mesh), pull]), **{"v0": velocities(mesh), **options})


def released(d, by=0.5):
    """Return a body released from a compression by this fraction of its size.

    The first step size that is found makes it blow up, unless the compression is small.
    """
    mesh = MESHES[d]
    return Scene(System(mesh, material(mesh)), u0=-by * (mesh.p - mesh.p.mean(axis=1)[:, None]).ravel("F"), inverts=True)


def kicked(d):
    """Return a damped body that is compressed by a pulse at 2 s; it blows up there with the step size found before."""
    mesh, most = MESHES[d], {2: 6.0, 3: 16.0}[d]
    push = Traction("right", lambda t: np.multiply(0.1, pushed(t)[:d]) - most * np.exp(-(((t - 2) / 0.2) ** 2)) * np.eye(d)[0])
    return Scene(System(mesh, [material(mesh), push]), damping=BOTH, inverts=True)


def stretched(mesh):
    """Return a stiff body that stiffens as it is stretched, so that critical steps decrease."""
    ends = {"left": {"x": 0.0, "y": 0.0, "z": 0.0}, "right": {"x": lambda t: 0.8 * np.sin(t / 4) ** 2}}
    return Scene(System(mesh, [material(mesh, young=300.0)], prescribed=ends))


SCENES = {
    "clamped": clamped,
    "driven": driven,
    "driven and damped": lambda d: driven(d, damping=BOTH),
    "spinning": spinning,
    "loaded and damped": lambda d: loaded(d, damping=BOTH),
}


def begun(system, integrator, v0):
    """Return the setup and the initial record of a run, undeformed with velocities `v0`."""
    motion = Motion(system, "lumped", None)
    state = MotionState.at(0.0, np.zeros(system.ndofs), v0)
    state.v[motion.free.fixed] = 0
    record = RunRecord.at(state, Ledger(column_names(system)), system)
    return Setup(motion, integrator, LedgerLocations(), 1.0), record
