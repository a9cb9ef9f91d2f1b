"""What a simulation starts from: a first state, or a checkpoint."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import number, plain_array, shown, whole
from ..errors import LoadError, StateError, StvkError, SupportError, name_ids
from ..results.files import output_path
from ..system import System
from ..terms import Load
from . import checkpoint as checkpoints
from .clock import Clock, Looks
from .counts import Counts
from .damping import Damping, EdgeDamping, Rayleigh
from .integrators import INTEGRATORS, Integrator
from .ledger import Ledger
from .motion import Motion
from .places import Places
from .state import State

Array = NDArray[Any]
PathLike = str | os.PathLike[str]

EVERY = 10
#: Of a state, that a checkpoint holds.
ARRAYS = ("u", "v", "a", "reaction")


@dataclass
class Outlets:
    """Where results go.

    Attributes
    ----------
    save, every, checkpoint : as of `simulate`.
    """

    save: PathLike | None
    every: int
    checkpoint: PathLike | None

    @classmethod
    def checked(cls, save: Any, every: Any, checkpoint: Any) -> Outlets:
        """Refuses what are no paths that can be written, and no number of steps."""
        for name, path, example in (("save", save, "flag.pvd"), ("checkpoint", checkpoint, "flag.npz")):
            if path is not None and not (isinstance(path, str | os.PathLike) and str(path)):
                raise StvkError(f"{name} = {shown(path)}; expected the path of a file such as {example!r}.")
        if save is not None:
            output_path(save, ".pvd")
        if checkpoint is not None:
            output_path(checkpoint, ".npz")
        return cls(save, whole("every", every, "a whole number of steps, at least 1", 1), checkpoint)


@dataclass
class Snapshot:
    """Where a run was after a whole step, and how many rows its ledger had."""

    state: State
    clock: Clock
    looks: Looks
    steps: int
    cuts: int
    rows: int


@dataclass
class Plan:
    """All that a run depends on, and where it is.

    Attributes
    ----------
    places : that the ledger follows.
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
    outlets: Outlets
    ledger: Ledger | None = None
    steps: int = 0
    cuts: int = 0
    looks: Looks = field(default_factory=Looks)
    counts: Counts = field(default_factory=Counts)
    seconds: dict[str, float] = field(default_factory=dict)
    good: Snapshot | None = None

    @classmethod
    def new(
        cls,
        system: System,
        integrator: Integrator | None,
        u0: ArrayLike | None,
        v0: ArrayLike | None,
        t0: float,
        mass: str,
        damping: Damping | None,
        places: Places | None,
        outlets: Outlets,
    ) -> Plan:
        """From a first state."""
        integrator = checked_integrator(integrator)
        motion = Motion(system, mass, damping)
        state = _first_state(motion, u0, v0, t0, integrator)
        return cls(motion, integrator, state, Clock(state.t, integrator.dt or 0.0), places or Places(), outlets)

    @classmethod
    def of_checkpoint(cls, path: PathLike, system: System, integrator: Integrator | None, outlets: dict[str, Any]) -> Plan:
        """From a checkpoint; `outlets` are those that are not None, in the place of those of the file."""
        about, arrays, ledger = checkpoints.load(path, system)
        integrator = _resumed_integrator(about["integrator"], integrator, path)
        factors = about["damping"]
        damping: Damping = [Rayleigh(factors["alpha"], factors["beta"]), EdgeDamping(factors["tau"])]
        motion = Motion(system, about["mass"], damping)
        now = _unpacked(about, arrays, "", ledger.steps)
        good = _unpacked(about["good"], arrays, "good ", about["good"]["rows"]) if about["good"] else None
        places = Places(*({name: arrays.pop(f"{kind} {name}") for name in about[kind]} for kind in Places._fields))
        kept = Outlets.checked(**(about["outlets"] | outlets))
        return cls(
            motion,
            integrator,
            now.state,
            now.clock,
            places,
            kept,
            ledger,
            now.steps,
            now.cuts,
            now.looks,
            Counts(**about["counts"]),
            about["seconds"],
            good,
        )

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

    def packed(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """What a checkpoint needs: what JSON can write, and arrays."""
        motion, outlets, good = self.motion, self.outlets, self.good
        paths = {
            name: None if path is None else os.path.abspath(path)
            for name, path in (("save", outlets.save), ("checkpoint", outlets.checkpoint))
        }
        about: dict[str, Any] = {
            "integrator": _described(self.integrator),
            "damping": {"alpha": motion.alpha, "beta": motion.beta, "tau": motion.tau},
            "mass": motion.mass.kind,
            "outlets": paths | {"every": outlets.every},
            "counts": vars(self.counts),
            "seconds": self.seconds,
            "good": None,
        }
        about |= _packed(self)
        arrays = {name: getattr(self.state, name) for name in ARRAYS}
        if good is not None and good.steps < self.steps and self.integrator.dt is None:  # others do not go on from there
            about["good"] = _packed(good) | {"rows": good.rows}
            arrays |= {f"good {name}": getattr(good.state, name) for name in ARRAYS}
        for kind, places in self.places._asdict().items():
            about[kind] = list(places)
            arrays |= {f"{kind} {name}": vertices for name, vertices in places.items()}
        return about, arrays


def _packed(moment: Plan | Snapshot) -> dict[str, Any]:
    """Where a run is or was, but for arrays."""
    clock, looks = vars(moment.clock).copy(), vars(moment.looks).copy()
    return {"t": moment.state.t, "clock": clock, "looks": looks, "steps": moment.steps, "cuts": moment.cuts}


def _unpacked(about: dict[str, Any], arrays: dict[str, Array], prefix: str, rows: int) -> Snapshot:
    state = State(about["t"], *(arrays.pop(prefix + name) for name in ARRAYS))
    return Snapshot(state, Clock(**about["clock"]), Looks(**about["looks"]), about["steps"], about["cuts"], rows)


def checked_integrator(integrator: Integrator | None) -> Integrator:
    """Refuses what is none."""
    if not isinstance(integrator, Integrator):
        given = f"the class {integrator.__name__}" if isinstance(integrator, type) else shown(integrator)
        raise StvkError(f"integrator is {given}; expected one of {', '.join(INTEGRATORS)}, such as EnergyMomentum(dt=1e-3).")
    return integrator


def checked_time(name: str, t: float) -> float:
    """Refuse a time that is none."""
    return number(name, t, "a time in seconds")


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


def _resumed_integrator(described: dict[str, Any], given: Integrator | None, path: PathLike) -> Integrator:
    if given is not None and _described(checked_integrator(given)) != described:
        raise StvkError(
            f"{path} is a motion with {described['name']}({_words(described)}); {given} came. Leave it out, or start anew."
        )
    if given is None and described["objects"]:
        raise StvkError(
            f"{path} is a motion with {described['name']}({_words(described)}), whose solver was an object: its options are not in the file. Give the "
            "same integrator again."
        )
    return given or INTEGRATORS[described["name"]](**described["options"])


def _words(described: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in (described["options"] | described["objects"]).items())


def _checked_vector(name: str, given: ArrayLike | None, system: System) -> Array:
    """(ndofs,) zeros, or a copy of what was given; refuses what is not one finite number a degree of freedom."""
    if given is None:
        return np.zeros(system.ndofs)
    x = plain_array(given)
    if x is None:
        raise StateError(f"{name} = {shown(given)}; expected ({system.ndofs},) numbers, one a degree of freedom, none masked.")
    if x.shape != (system.ndofs,) or x.dtype.kind not in "fiu":
        hint = (
            f" Flatten it: {name}.ravel()."
            if x.shape == (system.mesh.nv, system.mesh.d)
            else " Of a result, take its .u."
            if x.shape == ()
            else " Is it of another mesh?"
            if x.ndim == 1 and len(x) != system.ndofs
            else ""
        )
        raise StateError(
            f"{name} is a {type(given).__name__} of shape {x.shape}, dtype {x.dtype}; expected ({system.ndofs},) numbers, one a degree of freedom.{hint}"
        )
    bad = np.flatnonzero(~np.isfinite(x))
    if len(bad):
        raise StateError(f"{name} is not finite at {name_ids(bad, 'entry')} of {system.ndofs}.")
    return x.astype(np.float64)


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
    if not (state.u.any() or state.v.any() or motion.moving or any(isinstance(term, Load) for term in system.terms)):
        raise LoadError("Nothing moves the body: no load, nothing prescribed, u0 and v0 zero. Add Gravity(...), or give u0 or v0.")
    return state
