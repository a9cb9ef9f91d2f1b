"""Options of a simulation, and the setup of a run, which is constant during the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...arguments import shown
from ...errors import StvkError
from ...linear.choose import is_auto
from ...mesh.displacements import by_vertex
from ...mesh.locations import Where
from ...system import System
from ...system.coordinates import Coordinates
from ...system.signature import Fingerprint, sums_of
from ...units import UnitSystem
from ..runs.outputs import NO_FILES, OutputFiles
from .damping import Damping
from .integrators import INTEGRATORS, Integrator
from .ledger_rows import LedgerLocations
from .motion import Motion
from .motion_checkpoint import MotionCheckpoint
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
    plain = {name: x if x is None or isinstance(x, str) else float(x) for name, x in options.items() if name not in objects}
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
