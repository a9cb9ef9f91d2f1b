"""Options of a simulation, and the setup of a run, which is constant during the run: from a user's arguments or a checkpoint."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, shown
from ...errors import StvkError, StvkWarning, name_ids
from ...linear.choose import is_auto, solver_names
from ...mesh.displacements import by_vertex
from ...mesh.locations import Where
from ...results.complete_files import ForeignFile
from ...system import System
from ...system.coordinates import Coordinates
from ...system.signature import Fingerprint, sums_of
from ...units import UnitSystem
from ..runs.archive import refusing_damage
from ..runs.outputs import NO_FILES, OutputFiles
from .damping import Damping, EdgeDamping, Rayleigh
from .inputs import Inputs
from .integrators import INTEGRATORS, Integrator
from .ledger_rows import LedgerLocations
from .motion import Motion
from .motion_checkpoint import START_AGAIN, IntegratorOptions, MotionCheckpoint, ReadMotion, refuse_inconsistent
from .removal import Rule, rule_text

#: Name in files of the numbers that identify the basis of a motion.
BASIS = "the basis"
#: Fractions of the run time at which loads and prescribed displacements are evaluated for its signature.
FRACTIONS = (0.0, 0.31, 0.77, 1.0)


@dataclass(frozen=True)
class Options:
    """Arguments of `simulate` for the run. The arguments of a run's beginning may be passed again when it is resumed."""

    until: float
    integrator: Integrator | None
    u0: ArrayLike | None = None
    v0: ArrayLike | None = None
    t0: float = 0.0
    mass: str | None = None
    damping: Damping | None = None
    probes: Mapping[str, Where] | None = None
    reactions: Mapping[str, Where] | None = None
    remove: Rule | None = None
    output_files: OutputFiles = NO_FILES
    checkpoint: MotionCheckpoint | None = None

    def start(self, system: System) -> dict[str, list[float]]:
        """Return numbers that identify the user-supplied parts of an initial state."""
        supplied = {"u0": self.u0, "v0": self.v0}
        found = {name: sums_of(by_vertex(system.mesh, x, name), system.space) for name, x in supplied.items() if x is not None}
        return found | ({"t0": [self.t0]} if self.t0 else {})

    def refuse_other_locations(self, file: Path, system: System, stored: LedgerLocations) -> None:
        """Refuse probes and reactions that are passed again but differ from those of the file."""
        now = LedgerLocations.checked(system, self.probes, self.reactions)
        for kind, supplied in (("probes", self.probes), ("reactions", self.reactions)):
            then, requested = ({x: getattr(ids, "vertices", ids) for x, ids in getattr(one, kind).items()} for one in (stored, now))
            same = list(then) == list(requested) and all(np.array_equal(np.sort(then[x]), np.sort(requested[x])) for x in then)
            if supplied is not None and not same:
                raise StvkError(
                    f"{kind} = {list(requested)}; expected those of {file}, {list(then)}, at the same vertices. Leave them out to "
                    "resume it."
                )


@dataclass(frozen=True)
class Setup:
    """Setup of a run, constant from its beginning to its end."""

    motion: Motion
    integrator: Integrator
    locations: LedgerLocations  # locations that the ledger records
    until: float  # the end [s]
    rule: Rule | None = None  # rule that removes elements

    def problem(self, t0: float, start: Mapping[str, list[float]]) -> Fingerprint:
        """Return the problem from `t0` on, in the form in which files identify it.

        `start`: numbers of the initial state that are not zero.
        """
        moments = [t0 + fraction * (self.until - t0) for fraction in FRACTIONS]
        at_rest = {"t0": [t0], "u0": [0.0, 0.0], "v0": [0.0, 0.0]} | basis_of(self.motion)
        method = method_options(self.motion, self.integrator, self.rule)
        return Fingerprint("motion", self.motion.system, method, moments, at_rest | dict(start))


def basis_of(motion: Motion) -> dict[str, list[float]]:
    """Return numbers that identify the basis of a motion, if it has one."""
    return {BASIS: motion.body.signature} if isinstance(motion.body, Coordinates) else {}


def refuse_unsupported(motion: Motion, integrator: Integrator, removing: bool) -> None:
    """Refuse integrators that terms of the body do not support, and on a basis also damping and removal rules."""
    names = [contact.name for contact in motion.system.contacts if contact.is_barrier]
    if names and (integrator.explicit or getattr(integrator, "starts_near", False)):
        raise StvkError(
            f"integrator = {integrator.name}(...) with the MeshContact {names[0]!r}; expected an implicit integrator with Newton's "
            "method, such as BackwardEuler or EnergyMomentum: others would step through the barrier."
        )
    if not isinstance(motion.body, Coordinates):
        return
    if motion.tau:
        raise StvkError("damping: EdgeDamping acts on edges, which a reduced system does not have; expected Rayleigh(alpha, beta).")
    if integrator.conserves_reduced is None:
        known = ", ".join(name for name, one in INTEGRATORS.items() if one.conserves_reduced is not None)
        raise StvkError(f"integrator = {integrator.name}(...); expected one of {known} for a reduced system.")
    tangent, solver = getattr(integrator, "tangent", "exact"), getattr(integrator, "solver", "auto")
    if tangent != "exact" or not is_auto(solver):
        raise StvkError(
            f"{integrator.name}(tangent={tangent!r}, solver={solver!r}); expected the defaults for a reduced system, whose tangent "
            "is exact, small and dense."
        )
    if removing:
        raise StvkError(
            "remove: expected None for a reduced system, which is made of all its elements. Simulate its body: reduced.body."
        )


def method_options(motion: Motion, integrator: Integrator, rule: Rule | None = None) -> dict[str, Any]:
    """Return all options of the method, in the form of `MotionMethod`. A solver object is stored by its name."""
    options = {one.name: getattr(integrator, one.name) for one in fields(integrator)}
    objects = {name: value.name for name, value in options.items() if hasattr(value, "name")}
    others = {name: x for name, x in options.items() if name not in objects and (name != "solver" or isinstance(x, str))}
    plain = {name: x if x is None or isinstance(x, str) else float(x) for name, x in others.items()}  # `choose` refuses solvers
    return {
        "integrator": {"name": integrator.name, "options": plain, "objects": objects},
        "mass": motion.mass.kind,
        "damping": {"alpha": motion.alpha, "beta": motion.beta, "tau": motion.tau},
    } | ({} if rule is None else {"remove": rule_text(rule)})


def checked_integrator(integrator: Integrator | None) -> Integrator:
    """Return the integrator; refuse anything else."""
    if not isinstance(integrator, Integrator):
        supplied = f"the class {integrator.__name__}" if isinstance(integrator, type) else shown(integrator)
        raise StvkError(f"integrator is {supplied}; expected one of {', '.join(INTEGRATORS)}, such as EnergyMomentum(dt=1e-3).")
    return integrator


def too_early(until: float, t: float, units: UnitSystem) -> StvkError:
    """Return the error for an end `until` that is not after the present time `t`."""
    return StvkError(units.text(f"until = {until:g} s; expected an end after t = {t:g} s, the time of the motion."))


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
