"""What a simulation starts from: a first state, or a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arguments import Array, number, shown
from ..errors import LoadError, StvkError, SupportError, name_ids
from ..linear.choose import SOLVERS
from ..mesh.displacements import finite_vector
from ..mesh.places import Where
from ..results.archive import NotOurs
from ..system import System
from ..system.signature import Problem, sums
from . import checkpoint as checkpoints
from .checkpoint import ANEW, FRACTIONS, IntegratorRecord, MomentRecord, MotionHeader
from .clock import Clock, Looks
from .consistent import ARRAYS, refuse_inconsistent
from .counts import Counts
from .damping import Damping, EdgeDamping, Rayleigh
from .integrators import INTEGRATORS, Integrator
from .ledger import Ledger
from .motion import Motion
from .outlets import Outlets
from .places import Places
from .state import State


@dataclass
class Snapshot:
    """Where a run was after a whole step, and how many rows its ledger had."""

    state: State
    clock: Clock
    looks: Looks
    steps: int
    cuts: int
    rows: int


@dataclass(frozen=True)
class Beginning:
    """What a run begins with, as in `simulate`; of one that is resumed, what is given again."""

    integrator: Integrator | None
    u0: ArrayLike | None
    v0: ArrayLike | None
    t0: float
    mass: str | None
    damping: Damping | None
    probes: Mapping[str, Where] | None
    reactions: Mapping[str, Where] | None

    def numbers(self, system: System) -> dict[str, list[float]]:
        """Those by which a first state is known again, of what is given of it."""
        given = {"u0": self.u0, "v0": self.v0}
        found = {name: sums(_checked_vector(name, x, system)) for name, x in given.items() if x is not None}
        return found | ({"t0": [self.t0]} if self.t0 else {})

    def refuse_other_places(self, file: Path, system: System, kept: Places) -> None:
        """Refuse probes and reactions that are given again, but are not those of the file."""
        now = Places.checked(system, self.probes, self.reactions)
        for kind, given in (("probes", self.probes), ("reactions", self.reactions)):
            then, places = getattr(kept, kind), getattr(now, kind)
            same = list(then) == list(places) and all(np.array_equal(then[name], places[name]) for name in then)
            if given is not None and not same:
                raise StvkError(
                    f"{file} follows the {kind} {list(then)}, and they changed. Give the same again, or leave them out."
                )


@dataclass
class Plan:
    """All that a run depends on, and where it is.

    Attributes
    ----------
    places : that the ledger follows.
    outlets : what is written.
    clock : whose step is 0 until one is found.
    ledger : of the run that is resumed.
    steps, cuts : made so far, and how many of them in parts.
    counts, seconds : what the steps took, and how long by part [s], up to the last checkpoint.
    looks : at the critical step.
    good : the last good state, which a run that blows up goes back to.
    """

    motion: Motion
    integrator: Integrator
    state: State
    clock: Clock
    places: Places
    outlets: Outlets = field(default_factory=Outlets)
    ledger: Ledger | None = None
    steps: int = 0
    cuts: int = 0
    looks: Looks = field(default_factory=Looks)
    counts: Counts = field(default_factory=Counts)
    seconds: dict[str, float] = field(default_factory=dict)
    good: Snapshot | None = None

    @classmethod
    def new(cls, system: System, beginning: Beginning) -> Plan:
        """From a first state."""
        integrator = checked_integrator(beginning.integrator)
        places = Places.checked(system, beginning.probes, beginning.reactions)
        motion = Motion(system, "lumped" if beginning.mass is None else beginning.mass, beginning.damping)
        state = _first_state(motion, beginning.u0, beginning.v0, beginning.t0, integrator)
        return cls(motion, integrator, state, Clock(state.t, integrator.dt or 0.0), places)

    @classmethod
    def of_checkpoint(cls, file: Path, system: System, beginning: Beginning) -> tuple[Plan, Problem, MotionHeader]:
        """From a checkpoint, for the problem that it holds: what is given of the beginning has to be what it was.

        Raises
        ------
        StvkError
            if the file cannot be read, is of another problem, or says what cannot be.
        """
        saved = checkpoints.load(file)
        header, method = saved.header, saved.method
        integrator = _resumed_integrator(method.integrator, beginning.integrator, file)
        kept: Damping = [Rayleigh(method.damping.alpha, method.damping.beta), EdgeDamping(method.damping.tau)]
        damping = kept if beginning.damping is None else beginning.damping
        motion = Motion(system, method.mass if beginning.mass is None else beginning.mass, damping)
        start = {name: header.problem.numbers.get(name, []) for name in ("t0", "u0", "v0")} | beginning.numbers(system)
        problem = Problem("motion", system, described(motion, integrator), header.problem.moments, start)
        differences = problem.differences(header.problem)
        if differences:
            raise StvkError(
                f"{file} is of another problem: {differences}. Give the same again, or leave it out, to resume it. To start anew: overwrite=True, "
                "without resume."
            )
        try:
            places = refuse_inconsistent(saved, motion, integrator)
        except (ValueError, KeyError) as error:
            raise NotOurs(f"{file} is damaged: {error.args[0]}. {ANEW}") from None
        beginning.refuse_other_places(file, system, places)
        now = _unpacked(header.now, saved.arrays, "")
        good = _unpacked(header.good, saved.arrays, "good ") if header.good else None
        counts = Counts(**header.counts.model_dump())
        state, clock, looks = now.state, now.clock, now.looks
        plan = cls(
            motion,
            integrator,
            state,
            clock,
            places,
            ledger=saved.ledger,
            steps=now.steps,
            cuts=now.cuts,
            looks=looks,
            counts=counts,
            seconds=dict(header.seconds),
            good=good,
        )
        return plan, problem, header

    @property
    def at_a_step(self) -> bool:
        """Whether a whole step has led here: a run goes on from there only."""
        return self.state.t == self.clock.t

    def snapshot(self, rows: int) -> Snapshot:
        """Of what is now."""
        return Snapshot(self.state.copy(), replace(self.clock), replace(self.looks), self.steps, self.cuts, rows)

    def restore(self, then: Snapshot) -> None:
        """Be there again."""
        self.state.become(then.state)
        self.clock, self.looks, self.steps, self.cuts = replace(then.clock), replace(then.looks), then.steps, then.cuts

    def problem(self, beginning: Beginning, until: float) -> Problem:
        """What is to be simulated from its beginning, for files to be known by."""
        t0 = self.state.t
        start = {"t0": [t0], "u0": [0.0, 0.0], "v0": [0.0, 0.0]} | beginning.numbers(self.motion.system)
        moments = [t0 + fraction * (until - t0) for fraction in FRACTIONS]
        return Problem("motion", self.motion.system, described(self.motion, self.integrator), moments, start)

    def packed(self, rows: int) -> tuple[dict[str, Any], dict[str, Array]]:
        """What a checkpoint needs: what JSON can write, and arrays; `rows`: how many the ledger has."""
        outlets, good = self.outlets, self.good
        about: dict[str, Any] = {"now": _packed(self, rows), "good": None, "every": outlets.every}
        about |= {"counts": vars(self.counts), "seconds": self.seconds}
        about["save"] = None if outlets.series is None else str(outlets.series.path)
        arrays = {name: getattr(self.state, name) for name in ARRAYS}
        if good is not None and good.steps < self.steps and self.integrator.dt is None:  # others do not go on from there
            about["good"] = _packed(good, good.rows)
            arrays |= {f"good {name}": getattr(good.state, name) for name in ARRAYS}
        for kind, places in self.places._asdict().items():
            about[kind] = list(places)
            arrays |= {f"{kind} {name}": vertices for name, vertices in places.items()}
        return about, arrays


def _packed(moment: Plan | Snapshot, rows: int) -> dict[str, Any]:
    """Where a run is or was, but for arrays."""
    clock, looks = vars(moment.clock).copy(), vars(moment.looks).copy()
    return {"t": moment.state.t, "clock": clock, "looks": looks, "steps": moment.steps, "cuts": moment.cuts, "rows": rows}


def _unpacked(record: MomentRecord, arrays: dict[str, Array], prefix: str) -> Snapshot:
    state = State(record.t, *(arrays[prefix + name] for name in ARRAYS))
    clock, looks = Clock(**record.clock.model_dump()), Looks(**record.looks.model_dump())
    return Snapshot(state, clock, looks, record.steps, record.cuts, record.rows)


def checked_integrator(integrator: Integrator | None) -> Integrator:
    """Refuses what is none."""
    if not isinstance(integrator, Integrator):
        given = f"the class {integrator.__name__}" if isinstance(integrator, type) else shown(integrator)
        raise StvkError(f"integrator is {given}; expected one of {', '.join(INTEGRATORS)}, such as EnergyMomentum(dt=1e-3).")
    return integrator


def checked_time(name: str, t: float) -> float:
    """Refuse a time that is none."""
    return number(name, t, "a time in seconds")


def described(motion: Motion, integrator: Integrator) -> dict[str, Any]:
    """All options of the method, as `MethodRecord`."""
    damping = {"alpha": motion.alpha, "beta": motion.beta, "tau": motion.tau}
    return {"integrator": _described(integrator), "mass": motion.mass.kind, "damping": damping}


def _described(integrator: Integrator) -> dict[str, Any]:
    """By name and options; a solver that is an object by its name, with a mark that its options are not there."""
    options = {one.name: getattr(integrator, one.name) for one in fields(integrator)}
    plain = {
        name: value if value is None or isinstance(value, str) else float(value)
        for name, value in options.items()
        if not hasattr(value, "name")
    }
    return {
        "name": integrator.name,
        "options": plain,
        "objects": {name: value.name for name, value in options.items() if hasattr(value, "name")},
    }


def _resumed_integrator(kept: IntegratorRecord, given: Integrator | None, file: Path) -> Integrator:
    """The one that is given, or the one of the file."""
    if given is not None:
        return checked_integrator(given)
    if kept.objects:
        solver = ", ".join(f"{name}={value!r}" for name, value in kept.objects.items())
        raise StvkError(
            f"{file} is a motion with {kept.name}({solver}, ...), whose solver was an object: its options are not in the file. Give the same "
            "integrator again."
        )
    options: dict[str, Any] = dict(kept.options)
    solvers = ["auto", *(one.name for one in SOLVERS)]
    try:
        if options.get("solver", "auto") not in solvers:
            raise ValueError(f"solver = {options['solver']!r}")
        return INTEGRATORS[kept.name](**options)
    except (KeyError, TypeError, ValueError) as error:
        raise NotOurs(f"{file} is damaged: there is no integrator {kept.name!r} with its options ({error}). {ANEW}") from None


def _checked_vector(name: str, given: ArrayLike | None, system: System) -> Array:
    """(ndofs,) zeros, or a copy of what was given."""
    return np.zeros(system.ndofs) if given is None else finite_vector(name, given, system.ndofs).astype(np.float64)


def _first_state(motion: Motion, u0: ArrayLike | None, v0: ArrayLike | None, t0: float, integrator: Integrator) -> State:
    system = motion.system
    u, v = _checked_vector("u0", u0, system), _checked_vector("v0", v0, system)
    state = State.at(float(t0), u, v)
    fixed, held = motion.free.fixed, motion.held(t0)
    gap = np.abs(held - state.u[fixed])
    far = fixed[gap > 1e-9 * (1e-3 * np.ptp(system.mesh.p, axis=1).max() + np.abs(held).max(initial=0.0))]
    if len(far):
        raise SupportError(
            f"{name_ids(np.unique(far // system.mesh.d), 'vertex')}: at t0 = {t0:g} s the supports hold them up to {gap.max():.3g} m from where u0 has "
            "them. In dynamics constants do not ramp: prescribe a function of t that begins at u0, or begin in an equilibrium: u0=solve_static(...).u."
        )
    state.u[fixed] = held
    state.v[fixed] = motion.held_velocities(t0, integrator.dt or 1e-6)
    if not (state.u.any() or state.v.any() or motion.moving or system.loads):
        raise LoadError("Nothing moves the body: no load, nothing prescribed, u0 and v0 zero. Add Gravity(...), or give u0 or v0.")
    return state
