"""Whether what a checkpoint says of a motion can be: lengths, times, rows and energies held against each other and the system."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..statics.checkpoint import numbers
from .checkpoint import MomentRecord, Saved
from .integrators import Integrator
from .ledger import Ledger, column_names
from .motion import Motion
from .places import Places

#: Of a state, what a checkpoint holds.
ARRAYS = ("u", "v", "a", "reaction")
#: Energies agree, but for this part of the largest.
ENERGY = 1e-6
#: Steps that are found do not shrink below this part of the first one.
SHORTEST = 1e-9
#: What the total energy and the closure error are sums of.
PARTS = "kinetic_energy", "strain_energy", "potential_energy", "external_work", "dissipated_work"


def refuse_inconsistent(saved: Saved, motion: Motion, integrator: Integrator) -> Places:
    """Refuse a checkpoint that contradicts itself or the system; the places that it follows.

    Raises
    ------
    ValueError, KeyError
        with what is wrong in words.
    """
    header, ledger, system = saved.header, saved.ledger, motion.system
    places = Places.checked(system, _vertices(saved, "probes", header.probes), _vertices(saved, "reactions", header.reactions))
    if ledger.names != column_names(system, *places):
        raise ValueError(f"its ledger has the columns {', '.join(ledger.names)}")
    if ledger.steps != header.now.rows:
        raise ValueError(f"its ledger has {ledger.steps} rows for {header.now.rows}")
    _check_balance(ledger)
    start = {name: header.problem.numbers.get(name, []) for name in ("t0", "u0", "v0")}
    if start["t0"] != [ledger["time"][0]] or len(start["u0"]) != 2 or len(start["v0"]) != 2:
        raise ValueError(f"it began with {start}, its ledger at t = {ledger['time'][0]:g}")
    _check_moment(saved, header.now, "", motion, integrator)
    if header.good is not None:
        if integrator.dt is not None or not header.good.steps < header.now.steps:
            raise ValueError(f"its last good state is that of step {header.good.steps} of {header.now.steps}")
        _check_moment(saved, header.good, "good ", motion, integrator)
    return places


def _vertices(saved: Saved, kind: str, names: list[str]) -> dict[str, Array]:
    """Places of a checkpoint by name; raises ValueError in words."""
    found = {name: saved.arrays.get(f"{kind} {name}", np.empty(0)) for name in names}
    wrong = [name for name, ids in found.items() if ids.ndim != 1 or ids.dtype.kind != "i"]
    if wrong or len(found) < len(names):
        raise ValueError(
            f"the vertices of its {kind} {', '.join(map(repr, wrong or names))} are missing, or are none, or come twice"
        )
    return found


def _check_moment(saved: Saved, moment: MomentRecord, prefix: str, motion: Motion, integrator: Integrator) -> None:
    """Refuse a moment whose steps, rows, clock, arrays and energies do not belong together; raises ValueError or KeyError in words."""
    clock, looks, times = moment.clock, moment.looks, saved.ledger["time"][: moment.rows]
    if moment.rows != moment.steps + 1 or moment.cuts > moment.steps or clock.count > moment.steps:
        raise ValueError(f"{moment.steps} steps, {moment.cuts} of them cut and {clock.count} of one length, for {moment.rows} rows")
    if moment.t != clock.start + clock.count * clock.dt or moment.t != times[-1]:
        raise ValueError(
            f"t = {moment.t!r}, but its clock has {clock.count} steps of {clock.dt!r} from {clock.start!r}, its ledger ends at {float(times[-1])!r}"
        )
    if not np.array_equal(times[moment.steps - clock.count :], clock.start + np.arange(clock.count + 1) * clock.dt):
        raise ValueError("the times of its ledger are not those of its clock")
    if integrator.dt is not None and clock.dt != integrator.dt:
        raise ValueError(f"its steps are of {clock.dt!r}, those of its integrator of {integrator.dt!r}")
    if integrator.dt is None and not SHORTEST * looks.largest <= clock.dt <= looks.largest:
        raise ValueError(f"its steps are of {clock.dt:g} s, and were {looks.largest:g} s at first")
    if looks.next > moment.steps + looks.interval:
        raise ValueError(f"after {moment.steps} steps it would look at the critical step after {looks.next} at first")
    state = {name: numbers(saved.arrays, prefix + name, (motion.system.ndofs,)) for name in ARRAYS}
    row = {name: float(saved.ledger[name][moment.rows - 1]) for name in ("kinetic_energy", "strain_energy")}
    kinetic = float(state["v"] @ motion.mass.multiply(state["v"])) / 2
    strain = motion.system.energy(state["u"])
    for name, energy in (("kinetic_energy", kinetic), ("strain_energy", strain)):
        if not np.isclose(row[name], energy, rtol=ENERGY, atol=ENERGY**2 * (kinetic + abs(strain))):
            raise ValueError(f"its ledger ends with a {name} of {row[name]:g} J; its state has {energy:g} J")


def _check_balance(ledger: Ledger) -> None:
    """Refuse rows that are not finite, not in order or do not add up; raises ValueError in words."""
    rows = ledger.rows()
    if not np.isfinite(rows).all():
        raise ValueError(f"row {int(np.argmin(np.isfinite(rows).all(axis=1)))} of its ledger is not finite")
    if not (np.diff(ledger["time"]) > 0).all():
        raise ValueError("the times of its ledger do not ascend")
    total = ledger["kinetic_energy"] + ledger["strain_energy"] + ledger["potential_energy"]
    closure = total - total[:1] - ledger["external_work"] + ledger["dissipated_work"]
    size = ENERGY * max(float(np.abs(ledger[name]).max()) for name in PARTS)
    for name, sums in (("total_energy", total), ("closure_error", closure)):
        if (np.abs(ledger[name] - sums) > size).any():
            raise ValueError(f"the {name} of row {int(np.argmax(np.abs(ledger[name] - sums)))} of its ledger does not add up")
