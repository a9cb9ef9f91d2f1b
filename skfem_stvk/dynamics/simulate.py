"""Simulations: from a first state or a checkpoint, through the loop over the steps, to the result."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, flag, number, path
from ..errors import LoadError, StvkError, SupportError, name_ids
from ..mesh.displacements import by_vertex
from ..mesh.places import Where
from ..results.files import Outlets
from ..system import System
from ..system.coordinates import Coordinates
from ..system.protocol import ReducedLike, checked_system
from ..terms.load import Moment
from .books import LedgerPlaces, column_names
from .damping import Damping
from .integrators import Integrator
from .ledger import Ledger
from .loop import Loop
from .motion import Motion
from .options import Options, Setup, checked_integrator, refuse_on_basis, too_early
from .outputs import Outputs
from .record import Clock, MotionState, RunRecord
from .removal import Rule, checked_rule
from .run import Run


def simulate(
    system: System | ReducedLike,
    integrator: Integrator | None = None,
    *,
    until: float,
    u0: ArrayLike | None = None,
    v0: ArrayLike | None = None,
    t0: float = 0.0,
    mass: str | None = None,
    damping: Damping | None = None,
    probes: Mapping[str, Where] | None = None,
    reactions: Mapping[str, Where] | None = None,
    remove: Rule | None = None,
    save: str | os.PathLike[str] | None = None,
    fields: Sequence[str] | None = None,
    every: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool | str | os.PathLike[str] = False,
    overwrite: bool = False,
    quiet: bool = False,
    raise_on_failure: bool = True,
) -> Run:
    """Motion `M v' + D v + F(u) = h(u, t)` from `t0` until a time.

    Loads and prescribed displacements that are given by constants are what they are from the beginning, they do not ramp; functions
    are functions of the time.

    Parameters
    ----------
    system : a body whose materials have densities. It may be free to move. Or a `ReducedSystem` of one that is held: it takes
        implicit integrators with their own tangents and solvers, and `Rayleigh` damping; nothing in a step depends on its mesh.
        Elements inside out are counted in saved states and at both ends, and `EnergyMomentum` keeps the energy, not the momenta.
    integrator : `ForwardEuler`, `VelocityVerlet`, `LinearBackwardEuler`, `BackwardEuler`, `Newmark`, `GeneralizedAlpha`,
        `EnergyMomentum`.
    until : the end [s]; if it is not a whole number of steps away, the last step is shorter.
    u0, v0 : (ndofs,) displacements [m] and velocities [m/s] to start from, by default none. What is held moves as the supports say.
    t0 : time to start from [s].
    mass : "lumped", the default, or "consistent".
    damping : `Rayleigh(alpha, beta)`, `EdgeDamping(tau)` or a list of them.
    probes : places by name, whose mean displacements stand in the ledger: `{"A": [17]}` gives the columns "A x", "A y".
    reactions : places with supports or foundations by name, whose forces stand in the ledger, for the price of one force per step:
        `{"B": "left"}` gives "reaction B x", "reaction B y". Of the last state alone there is `run.reaction("left")`.
    remove : a rule by which elements leave the body after whole steps, as by `System.without`: `PrincipalStressLimit(1e6)`, or a
        function of the time and the displacements (ndofs,) that returns ids or a mask of elements, or None. The ledger has the
        energy that goes with them as `removed_energy`; `run.removed` says which they are, and `run.system` is the torn body.
        `system` stays as it is.
    save : a .pvd file, with a .vtu file for each state that is saved, and the ledger as .csv beside it.
    fields : what these hold beside displacements and velocities, see `skfem_stvk.results.names()`; by default stresses and strains.
    every : steps from one saved state to the next, by default 10.
    checkpoint : a folder whose one file, `motion.npz`, is replaced every few seconds, and at the end.
    resume : go on with the motion that `checkpoint` holds, if any, bit for bit as if it had never stopped; one that is at its end
        is returned. What a run begins with (`integrator`, `u0`, `v0`, `t0`, `mass`, `damping`, `probes`, `reactions`) may be given
        again, and has to be the same, or is taken from there. So are `every`, and the name of the series: it goes on where `save`
        says, or beside the checkpoint.
    overwrite : let `save` and `checkpoint` replace what belongs to another problem, with another mesh, other terms, supports,
        options or beginnings. A run that is resumed needs its rule to remove elements again.
    quiet : print nothing.
    raise_on_failure : raise where the end is not reached, or elements are inside out there; otherwise look at `run.status`. What
        interrupts a run, such as Ctrl-C or a full disk, is raised in any case.

    Raises
    ------
    MaterialError, LoadError, SupportError, StateError
        if a density is missing, nothing acts on the body, or the first state is not one.
    SimulationError
        if the motion blew up, a step found no state, elements are inside out in the end, or something failed on the way, such as a
        load's function or the disk. It carries the run so far, with the last good state; what is inside out in the end is saved
        like any other.
    StvkError
        for other parameters that are not as they should be; where `save` or `checkpoint` belong to another problem, or are being
        written by another run; where a checkpoint or the series of a run that is resumed is damaged or missing.

    Warns
    -----
    StvkWarning
        if the step of an explicit integrator is above the critical one, or elements lock; where elements turn inside out; where a
        prescribed displacement jumps.

    >>> import skfem
    >>> from skfem_stvk import EnergyMomentum, Gravity, StVK, System, simulate
    >>> beam = skfem.MeshTri.init_tensor(np.linspace(0, 4, 17), np.linspace(0, 1, 5))
    >>> system = System(
    ...     beam,
    ...     [StVK(young=1e5, poisson=0.3, density=1000.0), Gravity(g=(0, -2.0))],
    ...     fixed={lambda x: x[0] == 0: "xy"},
    ... )
    >>> run = simulate(system, EnergyMomentum(dt=0.02), until=1.0, quiet=True)
    >>> run.status.value, bool(abs(run.ledger["closure_error"]).max() < 1e-8 * run.ledger["kinetic_energy"].max())
    ('finished', True)
    """
    quiet, raise_on_failure = flag("quiet", quiet), flag("raise_on_failure", raise_on_failure)
    body = system.in_coordinates if isinstance(system, ReducedLike) else checked_system(system)
    if isinstance(body, System) and body.dtype != np.float64:
        raise StvkError(f"The system is in {body.dtype}; expected float64: System(..., dtype=np.float64).")
    until, t0 = number("until", until, "a time in seconds"), number("t0", t0, "a time in seconds")
    older = path("resume", resume, "True or False") if isinstance(resume, str | os.PathLike) else None  # taken until 1.0
    outlets = Outlets.checked(
        save=save,
        fields=fields,
        checkpoint=older if checkpoint is None else checkpoint,
        resume=False if older or resume is None else resume,
        overwrite=overwrite,
        every=every,
    )
    rule, kept = checked_rule(remove), None
    with ExitStack() as stack:
        if outlets.checkpoint is not None:
            from .checkpoint import MotionCheckpoint  # and pydantic, only where there is one

            kept = stack.enter_context(MotionCheckpoint(outlets.checkpoint, outlets.resume, older))
        options = Options(
            until=until,
            integrator=integrator,
            u0=u0,
            v0=v0,
            t0=t0,
            mass=mass,
            damping=damping,
            probes=probes,
            reactions=reactions,
            remove=rule,
            outlets=outlets,
            checkpoint=kept,
        )
        if kept is None or kept.source is None:
            start = _begun(body, options, stack)
        else:
            from .resumed import resumed

            start = resumed(body, options, stack, kept.source)
        return Loop(*start, quiet).run(raise_on_failure)


def _begun(body: System | Coordinates, options: Options, stack: ExitStack) -> tuple[Setup, RunRecord, Outputs]:
    """A run from a first state."""
    integrator = checked_integrator(options.integrator)
    system = body.system if isinstance(body, Coordinates) else body
    places = LedgerPlaces.checked(system, options.probes, options.reactions)
    motion = Motion(body, options.mass, options.damping)
    refuse_on_basis(motion, integrator, options.remove is not None)
    if not options.until > options.t0:
        raise too_early(options.until, options.t0)
    dt = min(integrator.dt or 1e-6, options.until - options.t0)
    state = first_state(motion, options.u0, options.v0, options.t0, dt)
    setup = Setup(motion, integrator, places, options.until, options.remove)
    names = column_names(body, *places, removing=options.remove is not None)
    record = RunRecord(state, Clock(state.t, integrator.dt or 0.0), Ledger(names))
    record.take_out(system.removed, np.nan)
    return setup, record, Outputs.opened(setup, record, options, stack)


def first_state(motion: Motion, u0: ArrayLike | None, v0: ArrayLike | None, t0: float, dt: float) -> MotionState:
    """Return the first state. Constrained degrees of freedom are as prescribed, their velocities differences over a part of `dt`.

    Raises
    ------
    SupportError, LoadError
        if the supports do not start at `u0`, or if no load, support, displacement or velocity moves the body.
    """
    system = motion.system
    u, v = (_vector(name, x, system) for name, x in (("u0", u0), ("v0", v0)))
    fixed, held, moment = system.supports.held, system.supports.values(Moment(t0, 1.0)), motion.moment(t0)
    gap = np.abs(held - u[fixed])
    far = fixed[gap > 1e-9 * (1e-3 * np.ptp(system.mesh.p, axis=1).max() + np.abs(held).max(initial=0.0))]
    if len(far):
        raise SupportError(
            f"{name_ids(np.unique(far // system.mesh.d), 'vertex')}: at t0 = {t0:g} s the supports hold them up to "
            f"{gap.max():.3g} m from where u0 has them. In dynamics constants do not ramp: prescribe a function of t that begins "
            "at u0, or begin in an equilibrium: u0=solve_static(...).u."
        )
    body = motion.body
    if isinstance(body, Coordinates):
        u, v = body.state(u, moment), body.state(v, moment)
    state = MotionState.at(t0, body.prescribe(u, moment), v)
    state.v[motion.free.fixed] = motion.held_velocities(t0, dt)
    if not (state.u.any() or state.v.any() or motion.moving or system.loads):
        raise LoadError("Nothing moves the body: no load, nothing prescribed, u0 and v0 zero. Add Gravity(...), or give u0 or v0.")
    return state


def _vector(name: str, given: ArrayLike | None, system: System) -> Array:
    """(ndofs,) zeros, or what was given."""
    return np.zeros(system.ndofs) if given is None else by_vertex(system.mesh, given, name).astype(np.float64).ravel()
