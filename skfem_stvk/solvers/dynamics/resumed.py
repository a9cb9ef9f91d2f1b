"""Continuation of a run from a checkpoint, with the results of an uninterrupted run."""

from __future__ import annotations

import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import StvkError, StvkWarning, name_ids
from ...linear.choose import solver_names
from ...results.complete_files import ForeignFile
from ...system import System
from ...system.coordinates import Coordinates
from ...system.signature import Fingerprint
from ..runs.archive import refusing_damage
from .damping import Damping, EdgeDamping, Rayleigh
from .inputs import Inputs
from .integrators import INTEGRATORS, Integrator
from .ledger_rows import LedgerLocations
from .motion import Motion
from .motion_checkpoint import START_AGAIN, IntegratorOptions, ReadMotion, load, refuse_inconsistent
from .motion_outputs import Outputs
from .options import (
    BASIS,
    Options,
    Setup,
    basis_of,
    checked_integrator,
    method_options,
    refuse_unsupported,
    too_early,
)
from .record import SLACK, RunRecord


def resumed(body: System | Coordinates, options: Options, stack: ExitStack, file: Path) -> tuple[Setup, RunRecord, Outputs]:
    """Return a run that continues from a checkpoint. Arguments that describe its beginning must agree with the file."""
    read = load(file, body.space)
    saved = read.saved
    if saved.inputs.any() or saved.moved:
        moves = "moved contacts" if saved.moved else "inputs that are not zero"
        raise StvkError(f"{file} is of a Simulation with {moves}. Continue it with Simulation.load.")
    motion, integrator, locations, problem = restored(body, options, read, file)
    options.refuse_other_locations(file, problem.system, locations)
    record = saved.record(read.ledger)
    if options.until < record.state.t - (SLACK * record.clock.dt if record.steps else 0.0):
        raise too_early(options.until, record.state.t, motion.system.units)
    setup = Setup(motion, integrator, locations, options.until, options.remove)
    return setup, record, Outputs.opened(setup, record, options, stack, problem, saved)


def restored(
    body: System | Coordinates, options: Options, read: ReadMotion, file: Path, inputs: Inputs | None = None
) -> tuple[Motion, Integrator, LedgerLocations, Fingerprint]:
    """Return the motion of a checkpoint, its integrator, the locations in its ledger, and its problem.

    Refuse the checkpoint of another problem, and a damaged one.
    """
    signature, method, saved, _ = read
    supplied = options.integrator
    integrator = resumed_integrator(method.integrator, file) if supplied is None else checked_integrator(supplied)
    stored: Damping = [Rayleigh(method.damping.alpha, method.damping.beta), EdgeDamping(method.damping.tau)]
    damping = stored if options.damping is None else options.damping
    motion = Motion(body, method.mass if options.mass is None else options.mass, damping, inputs)
    refuse_unsupported(motion, integrator, options.remove is not None)
    system, then = motion.system, signature.numbers
    start = {name: then.get(name, []) for name in ("t0", "u0", "v0")} | options.start(system)
    start |= ({BASIS: []} if BASIS in then else {}) | basis_of(motion)
    removed, removed_at = saved.removed, saved.removed_at
    if not np.unique(removed).size == removed.size == removed_at.size:
        raise ForeignFile(f"{file} is damaged: its list of removed elements is invalid. {START_AGAIN}")
    first = system_at_first(system, removed, removed_at, file)
    problem = Fingerprint("motion", first, method_options(motion, integrator, options.remove), signature.moments, start)
    again = "Pass the same, or leave it out, to resume it. To start again: overwrite=True, without resume."
    problem.refuse_other(signature, file, again)
    if len(removed):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StvkWarning)  # about parts that came loose then
            motion.remove_elements(removed)
    with refusing_damage(file, START_AGAIN):
        if inputs is not None and saved.inputs.size:
            if saved.inputs.shape != inputs.values.shape:
                raise ValueError(f"it has {saved.inputs.size} inputs; expected {inputs.values.size}")
            inputs.stay(saved.inputs)
        return motion, integrator, refuse_inconsistent(read, motion, integrator), problem


def system_at_first(system: System, removed: NDArray[np.int64], removed_at: Array, file: Path) -> System:
    """Return the system at the beginning of a motion, in which these elements were removed before and during the run.

    Raises StvkError if the system has lost other elements, or still has elements that were removed before the run.
    """
    before, now = removed[np.isnan(removed_at)], system.removed
    if np.array_equal(now, np.sort(before)):
        return system
    if not np.isin(now, removed).all() or not np.isin(before, now).all():
        raise StvkError(
            f"The system lacks {name_ids(now, 'element')}; expected the system of {file}, which lacks "
            f"{name_ids(np.sort(removed), 'element')}, {len(before)} of them from the start. Pass the system with which the motion "
            "began, or run.system."
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StvkWarning)
        return System(system.made_from, **system.made_of).without(before)


def resumed_integrator(record: IntegratorOptions, file: Path) -> Integrator:
    """Return the integrator of a checkpoint. Refuse one whose solver was an object."""
    if record.objects:
        solver = ", ".join(f"{name}={value!r}" for name, value in record.objects.items())
        raise StvkError(
            f"{file} is a motion with {record.name}({solver}, ...), whose solver was an object: its options are not in the file. "
            "Pass the same integrator."
        )
    options: dict[str, Any] = dict(record.options)
    solvers = solver_names()
    try:
        if options.get("solver", "auto") not in solvers:
            raise ValueError(f"solver = {options['solver']!r}")
        return INTEGRATORS[record.name](**options)
    except (KeyError, TypeError, ValueError) as error:
        raise ForeignFile(
            f"{file} is damaged: there is no integrator {record.name!r} with its options ({error}). {START_AGAIN}"
        ) from None
