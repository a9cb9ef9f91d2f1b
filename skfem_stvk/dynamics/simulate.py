"""Simulations: the loop over the steps, and what goes on around it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import flag
from ..errors import StvkError
from ..mesh.places import Where
from ..system import System
from ..system.system import checked_system
from .damping import Damping
from .integrators import Integrator
from .loop import Loop
from .outlets import Asked, Outlets
from .plan import Beginning, Plan, checked_time
from .run import Run


def simulate(
    system: System,
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
    save: str | os.PathLike[str] | None = None,
    every: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool | str | os.PathLike[str] = False,
    overwrite: bool = False,
    quiet: bool = False,
    raise_on_failure: bool = True,
) -> Run:
    """Motion `M v' + D v + F(u) = h(u, t)` from `t0` until a time.

    Loads and prescribed displacements that are given by constants are what they are from the beginning, they do not ramp; functions are
    functions of the time.

    Parameters
    ----------
    system : a body whose materials have densities. It may be free to move.
    integrator : `ForwardEuler`, `VelocityVerlet`, `LinearBackwardEuler`, `BackwardEuler`, `Newmark`, `GeneralizedAlpha`, `EnergyMomentum`.
    until : the end [s]; if it is not a whole number of steps away, the last step is shorter.
    u0, v0 : (ndofs,) displacements [m] and velocities [m/s] to start from, by default none. What is held moves as the supports say.
    t0 : time to start from [s].
    mass : "lumped", the default, or "consistent".
    damping : `Rayleigh(alpha, beta)`, `EdgeDamping(tau)` or a list of them.
    probes : places by name, whose mean displacements stand in the ledger: `{"A": [17]}` gives the columns "A x", "A y".
    reactions : places with supports or foundations by name, whose forces stand in the ledger, for the price of a force a step: `{"B": "left"}` gives "reaction B x",
        "reaction B y". Of the last state alone there is `run.reaction("left")`.
    save : a .pvd file, with a .vtu file for each state that is saved, displacements, velocities, stresses and strains, and the ledger as .csv beside it.
    every : steps from one saved state to the next, by default 10.
    checkpoint : a folder whose one file, `motion.npz`, is replaced every few seconds, and at the end.
    resume : go on with the motion that `checkpoint` holds, if any, bit for bit as if it had never stopped. What a run begins with (`integrator`,
        `u0`, `v0`, `t0`, `mass`, `damping`, `probes`, `reactions`) may be given again, and has to be the same, or is taken from there. So are
        `every`, and the name of the series: it goes on where `save` says, or beside the checkpoint.
    overwrite : let `save` and `checkpoint` replace what belongs to another problem, with another mesh, other terms, supports, options or beginnings.
    quiet : print nothing.
    raise_on_failure : raise where the end is not reached, or elements are inside out there; otherwise look at `run.status`. What interrupts a run, such as Ctrl-C or a full
        disk, is raised in any case.

    Raises
    ------
    MaterialError, LoadError, SupportError, StateError
        if a density is missing, nothing acts on the body, or the first state is not one.
    SimulationError
        if the motion blew up, a step found no state, elements are inside out in the end, or something failed on the way, such as a load's
        function or the disk. It carries the run so far, with the last good state; what is inside out in the end is saved like any other.
    StvkError
        for other parameters that are not as they should be; where `save` or `checkpoint` belong to another problem, or are being written by
        another run; where a checkpoint or the series of a run that is resumed is damaged or missing.

    Warns
    -----
    StvkWarning
        if the step of an explicit integrator is above the critical one, or elements lock; where elements turn inside out; where a prescribed
        displacement jumps.

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
    if checked_system(system).dtype != np.float64:
        raise StvkError(f"The system is in {system.dtype}; expected float64: System(..., dtype=np.float64).")
    end = checked_time("until", until)
    beginning = Beginning(integrator, u0, v0, checked_time("t0", t0), mass, damping, probes, reactions)
    asked = Asked.checked(save, every, checkpoint, resume, overwrite)
    with ExitStack() as stack:
        if asked.checkpoint is not None:
            stack.enter_context(asked.checkpoint)
        if asked.source is None:
            plan = Plan.new(system, beginning)
            _refuse_end(end, plan)
            problem = None if asked.save is None and asked.checkpoint is None else plan.problem(beginning, end)
            plan.outlets = Outlets.opened(stack, asked, problem)
        else:
            plan, problem, header = Plan.of_checkpoint(asked.source, system, beginning)
            _refuse_end(end, plan)
            assert plan.ledger is not None
            plan.outlets = Outlets.resumed(stack, asked, problem, header, plan.ledger)
        return Loop(plan, end, quiet).run(raise_on_failure)


def _refuse_end(end: float, plan: Plan) -> None:
    if not end > plan.state.t:
        raise StvkError(f"until = {end:g} s is not after t = {plan.state.t:g} s, where the motion is. Give a later end.")
