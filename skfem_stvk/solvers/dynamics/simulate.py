"""Simulations: from an initial state or a checkpoint, through the loop over the steps, to the result."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import Array, flag, number
from ...errors import LoadError, StvkError, SupportError, name_ids
from ...mesh.displacements import by_vertex
from ...mesh.locations import Where
from ...system import System
from ...system.coordinates import Coordinates, ReducedLike, checked_system
from ...system.system import for_analysis
from ...terms.loads.load import Moment
from ..runs.ledger import Ledger
from ..runs.outputs import OutputFiles
from .damping import Damping
from .integrators import Integrator
from .ledger_rows import LedgerLocations, column_names
from .loop import Loop
from .motion import Motion
from .motion_checkpoint import MotionCheckpoint
from .motion_outputs import Outputs
from .options import Options, Setup, checked_integrator, refuse_unsupported, too_early
from .record import MotionState, RunRecord
from .removal import Rule, checked_rule
from .resumed import resumed
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
    resume: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
    raise_on_failure: bool = True,
) -> Run:
    """Simulate a motion from `t0` until a time.

    ::

        M v' + D v + F(u) = h(u, t)

    Constant loads and prescribed displacements act in full from the beginning; they do not ramp. Functions are evaluated at the
    time `t` [s].

    Parameters
    ----------
    system
        A body whose materials have densities. It may be free to move. It may also be a `ReducedSystem` of a constrained body. Such
        a system requires an implicit integrator with its default tangent and solver, and allows `Rayleigh` damping. The cost of a
        step is then independent of the mesh. Inverted elements are counted in saved states and at both ends, and `EnergyMomentum`
        conserves the energy, but not the momenta.
    integrator
        Time integrator: `ForwardEuler`, `VelocityVerlet`, `LinearBackwardEuler`, `BackwardEuler`, `Newmark`, `GeneralizedAlpha`,
        `EnergyMomentum`.
    until
        End of the run [s]. If it is not a whole number of steps away, the last step is shorter.
    u0, v0
        (ndofs,) initial displacements [m] and velocities [m/s], by default zero. Constrained degrees of freedom move as the
        supports prescribe.
    t0
        Initial time [s].
    mass
        Kind of the mass, "lumped", the default, or "consistent".
    damping
        `Rayleigh(alpha, beta)`, `EdgeDamping(tau)` or a list of them.
    probes
        Locations by name, whose mean displacements are recorded in the ledger: `{"A": [17]}` adds the columns "A x", "A y".
    reactions
        Locations with supports or foundations by name, whose forces are recorded in the ledger: `{"B": "left"}` adds
        "reaction B x", "reaction B y". This costs one force per step. For the last state alone use `run.reaction("left")`.
    remove
        Rule that removes elements from the body after whole steps, as `System.without` does: `PrincipalStressLimit(1e6)`, or a
        function of the time and the displacements (ndofs,) that returns ids or a mask of elements, or None. The ledger records the
        lost energy as `removed_energy`. `run.removed` has the ids of removed elements, and `run.system` is the remaining body.
        `system` itself does not change.
    save
        Path of a .pvd file, with a .vtu file for each saved state, and the ledger as .csv next to it. On several ranks, each state
        has a .pvtu file, and a .vtu file of each rank.
    fields
        Fields of the .vtu files in addition to displacements and velocities, see `skfem_stvk.results.names()`; by default stresses
        and strains.
    every
        Number of steps from one saved state to the next, by default 10.
    checkpoint
        Path of a folder whose one file, `motion.npz`, is replaced every few seconds, and at the end. On several ranks, each rank
        has another file there.
    resume
        Continue the motion of `checkpoint`, if there is one, with bitwise the same results as without interruption. If the body is
        divided in another way, the results are the same within the tolerance of linear solves. A motion that is at its end is
        returned. Arguments of the beginning (`integrator`, `u0`, `v0`, `t0`, `mass`, `damping`, `probes`,
        `reactions`) are read from the checkpoint. If they are passed again, they must be the same. `every` and the name of the
        series are read as well. The series continues at `save`, or by default next to the checkpoint.
    overwrite
        Let `save` and `checkpoint` replace files of another problem, with another mesh, other terms, supports, options or initial
        states. A run that is resumed needs its rule `remove` again.
    quiet
        Print nothing.
    raise_on_failure
        Raise an error if the end is not reached, or elements are inverted there; otherwise see `run.status`. An interruption, such
        as Ctrl-C or a full disk, is always raised.

    Returns
    -------
    Run
        The last state, the `ledger` with one value per step, and the `status` of the run.

    Raises
    ------
    MaterialError, LoadError, SupportError, StateError, ContactError
        if a density is missing, nothing acts on the body, or the initial state is not valid.
    SimulationError
        if the motion blew up, a step found no state, elements are inverted at the end, or something failed during the run, such as
        a load's function or the disk. The error contains the run so far, with the last good state. A last state with inverted
        elements is saved like any other.
    StvkError
        if another parameter is not valid. If `save` or `checkpoint` belong to another problem, or another run is writing them. If a
        checkpoint or the series of a run that is resumed is damaged or missing.

    Warns
    -----
    StvkWarning
        if the step of an explicit integrator is above the critical one, elements lock or become inverted, or a prescribed
        displacement jumps.

    Examples
    --------
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
    body = checked_body(system)
    until, t0 = number("until", until, "a time in seconds"), number("t0", t0, "a time in seconds")
    output_files = OutputFiles.checked(
        save=save, fields=fields, checkpoint=checkpoint, resume=resume, overwrite=overwrite, every=every
    )
    rule, checkpoint_file = checked_rule(remove), None
    if rule is not None:
        body.space.comm.refuse_divided("remove = a rule", "None", "elements can be removed from a body on one machine only.")
    with ExitStack() as stack:
        if output_files.checkpoint is not None:
            checkpoint_file = stack.enter_context(MotionCheckpoint(output_files.checkpoint, body.space))
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
            output_files=output_files,
            checkpoint=checkpoint_file,
        )
        if checkpoint_file is not None and output_files.resume and checkpoint_file.exists:
            start = resumed(body, options, stack, checkpoint_file.file)
        else:
            start = _new_run(body, options, stack)
        return Loop(*start, quiet).run(raise_on_failure)


def checked_body(system: System | ReducedLike) -> System | Coordinates:
    """Return the body whose states a motion has, with a history of its own; refuse one in single precision, and other objects."""
    body = system.in_coordinates if isinstance(system, ReducedLike) else checked_system(system)
    if not isinstance(body, System):
        return body
    if body.dtype != np.float64:
        raise StvkError(f"dtype = {body.dtype} of the system; expected float64: System(..., dtype=np.float64).")
    return for_analysis(body, in_time=True)


def _new_run(body: System | Coordinates, options: Options, stack: ExitStack) -> tuple[Setup, RunRecord, Outputs]:
    """Return a run that begins with an initial state."""
    integrator = checked_integrator(options.integrator)
    system = body.system if isinstance(body, Coordinates) else body
    locations = LedgerLocations.checked(system, options.probes, options.reactions)
    motion = Motion(body, options.mass, options.damping)
    refuse_unsupported(motion, integrator, options.remove is not None)
    if not options.until > options.t0:
        raise too_early(options.until, options.t0, motion.system.units)
    dt = min(integrator.dt or 1e-6, options.until - options.t0)
    state = first_state(motion, options.u0, options.v0, options.t0, dt)
    setup = Setup(motion, integrator, locations, options.until, options.remove)
    names = column_names(body, *locations, removing=options.remove is not None)
    record = RunRecord.at(state, Ledger(names), body)
    record.add_removed(system.removed, np.nan)
    return setup, record, Outputs.opened(setup, record, options, stack)


def first_state(motion: Motion, u0: ArrayLike | None, v0: ArrayLike | None, t0: float, dt: float) -> MotionState:
    """Return the initial state.

    Constrained degrees of freedom have their prescribed displacements. Their velocities are differences over a part of `dt`.

    Raises
    ------
    SupportError, LoadError, ContactError
        if the supports do not start at `u0`, if no load, support, displacement or velocity moves the body, or if it starts within
        another body or on the wrong side of a shape.
    """
    system = motion.system
    u, v = (_vector(name, x, system) for name, x in (("u0", u0), ("v0", v0)))
    fixed, prescribed, moment = system.supports.held, system.supports.values(Moment(t0, 1.0)), motion.moment(t0)
    gap = np.abs(prescribed - u[fixed])
    mesh, space = system.mesh, system.space
    far = fixed[gap > 1e-9 * (1e-3 * mesh.extent.max() + space.comm.most(float(np.abs(prescribed).max(initial=0.0))))]
    if len(far):
        vertices = name_ids(np.unique(mesh.node_numbers[far // mesh.d]), "vertex")
        text = (
            f"{vertices}: u0 differs from the supports at t0 = {t0:g} s by up to {gap.max():.3g} m. In dynamics constants do not "
            "ramp. Prescribe a function of t that starts at u0, or start from an equilibrium: u0=solve_static(...).u."
        )
        raise SupportError(system.units.text(text))
    with system.units.of_errors():
        for contact in system.contacts_at(moment):
            contact.refuse_start(u.reshape(-1, mesh.d))
    body = motion.body
    if isinstance(body, Coordinates):
        u, v = body.state(u, moment), body.state(v, moment)
    state = MotionState.at(t0, body.prescribe(u, moment), v, motion.force_rows)
    state.v[motion.free.fixed] = motion.constrained_velocities(t0, dt)
    if not (
        space.comm.any(bool(state.u.any() or state.v.any())) or motion.moving or motion.pushed or system.loads or system.contacts
    ):
        raise LoadError("Nothing moves the body: no load, nothing prescribed, u0 and v0 zero. Add Gravity(...), or give u0 or v0.")
    motion.store_forces(state)
    return state


def _vector(name: str, value: ArrayLike | None, system: System) -> Array:
    """Return the user-supplied vector (ndofs,), or zeros."""
    return np.zeros(system.ndofs) if value is None else by_vertex(system.mesh, value, name).astype(np.float64).ravel()
