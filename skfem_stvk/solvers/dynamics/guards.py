"""Checks of a motion: energy created numerically, inverted elements, and jumps of supports."""

from __future__ import annotations

from math import isfinite
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from ...arguments import Array
from ...errors import name_ids, warn
from ..runs.ledger import Ledger
from .ledger_rows import INSIDE_OUT, known_strain
from .motion import Motion
from .record import MotionState, RunRecord

#: A motion has blown up if the numerically created energy is more than this multiple of the initial or supplied energy.
TOO_MUCH = 20.0
#: A state is good if the created energy is at most `GOOD` times the initial or supplied one. It must also have grown by at most
#: `QUICKLY` times that energy within `EVERY` steps. One good state is retained every `EVERY` steps.
GOOD, QUICKLY, EVERY = 1.0, 0.1, 20
COLUMNS = "kinetic_energy", "potential_energy", "external_work", "closure_error"
#: Steps between two counts of inverted elements. A count costs half a force, so explicit integrators count less often.
EXPLICIT, IMPLICIT = 20, 1
#: A step is searched for a jump if a support moves `FASTER` times as fast as in any step before. The search halves the step
#: `HALVINGS` times. The motion is a jump if the part `REMAINING` of it still remains. For smooth motions and kinks almost nothing
#: remains. A motion within a thousandth of a step is a jump.
FASTER, HALVINGS, REMAINING = 2.0, 10, 0.25
#: Smaller jumps, as a part of the body's size, are ignored.
SMALL = 1e-9
#: Number of steps over which a jump should be spread.
STEPS = 20


class Guard:
    """Comparison of the closure error in the last row of a run's ledger with the available energy."""

    def __init__(self, record: RunRecord) -> None:
        self._record, ledger = record, record.ledger
        self._pick = itemgetter(*map(ledger.names.index, COLUMNS))
        self._potential = float(ledger["potential_energy"][0])
        self._most = reference_energy(ledger)

    def blown_up(self) -> bool:
        """Return whether the last row shows energy that was created numerically."""
        kinetic, excess, available = self._last_row()
        return not isfinite(kinetic + excess) or excess > TOO_MUCH * available > 0

    def is_good(self) -> bool:
        """Return whether to retain the state of the last row.

        The state must be good, and the retained state must be at least `EVERY` steps old.
        """
        good = self._record.good
        assert good is not None
        since = (self._record.steps - good.steps) / EVERY
        if since < 1:
            return False
        _, excess, available = self._last_row()
        if excess > available * GOOD:
            return False
        return bool(excess - self._record.ledger["closure_error"][good.steps] <= available * QUICKLY * since)

    def _last_row(self) -> tuple[float, float, float]:
        """Return the kinetic energy, the closure error and the largest available energy so far [J]."""
        ledger = self._record.ledger
        kinetic, potential, external, excess = self._pick(ledger.rows(ledger.steps - 1)[0].tolist())
        self._most = max(self._most, abs(potential - self._potential), abs(external))
        return kinetic, excess, self._most


def relative_closure_error(ledger: Ledger) -> float:
    """Return the final closure error as a part of the initial or supplied energy. It is negative if the steps lost energy.

    Lost energy is a part of the sum of both, of which steps lose at most all.
    """
    error, most = float(ledger["closure_error"][-1]), reference_energy(ledger)
    if error < 0:
        kinetic, potential, external = (ledger[name] for name in COLUMNS[:-1])
        supplied = float((external - potential).max() - (external - potential)[0])
        most = max(most, float(kinetic[0] + known_strain(ledger)[0]) + supplied)
    return error / most if most > 0 else 0.0


def reference_energy(ledger: Ledger) -> float:
    """Return the larger of the initial energy and the energy supplied since [J].

    Damping can dissipate more than this only if energy was created numerically.
    """
    kinetic, *changing = (ledger[name] for name in COLUMNS[:-1])
    return max(float(kinetic[0] + known_strain(ledger)[0]), *(float(max(x.max() - x[0], x[0] - x.min())) for x in changing))


class Inversions:
    """Counter of inverted elements, which warns of the first ones.

    Rows between two counts repeat the number of the last count. Hence a run that is resumed has the same ledger as an uninterrupted
    one.
    """

    def __init__(self, motion: Motion, every: int) -> None:
        self._motion, self._every, self._warned = motion, every, False

    def at_first(self, record: RunRecord) -> float:
        """Return the number to enter for the state from which a run begins or continues."""
        between_counts = record.steps % self._every  # the last row was counted only because the earlier run ended there
        return float(record.ledger[INSIDE_OUT][-2]) if between_counts else len(self._elements(record.state))

    def count(self, record: RunRecord, last: bool) -> int | None:
        """Return the number of inverted elements, or None if no count is due. In the `last` state a count is always due."""
        if record.steps % self._every and not last:
            return None
        inverted = self._elements(record.state)
        if len(inverted) and not self._warned:
            self._warned = True
            text = f"t = {record.state.t:.4g} s: {name_ids(inverted, 'element')} inverted. {self._advice()}"
            warn(self._motion.system.units.text(text))
        return len(inverted)

    @property
    def resisted(self) -> bool:
        """Whether a term resists the inversion of elements."""
        return self._motion.system.resists_inversion

    def _elements(self, state: MotionState) -> NDArray[np.int64]:
        return self._motion.body.inside_out(state.u)

    def _advice(self) -> str:
        if self.resisted:
            return "Take smaller steps, or a stiffer VolumePenalty."
        return "St. Venant-Kirchhoff does not resist inversion: add VolumePenalty() to the terms, or take smaller steps."


def inversion_text(ledger: Ledger) -> str:
    """Return the part of the run's message about inverted elements: how many, and when. It is empty if there were none."""
    counts, times = ledger[INSIDE_OUT], ledger["time"]
    seen = np.flatnonzero(counts)
    if not len(seen):
        return ""
    first, last = times[seen[[0, -1]]]
    return f"; elements were inverted on the way, up to {counts.max():.0f} at once, between t = {first:.4g} s and t = {last:.4g} s"


class Jumps:
    """Detector of jumps of prescribed displacements, which compares consecutive steps and warns of the first jump.

    The functions of the supports are evaluated at the ends of steps and at bisection points, never beyond the run.
    """

    def __init__(self, motion: Motion, state: MotionState) -> None:
        self._motion, self._t = motion, state.t
        self._before, self._speed = state.u[motion.free.fixed], np.abs(state.v[motion.free.fixed])
        self._small = SMALL * float(motion.system.mesh.extent.max())
        self._active = motion.moving

    def check(self, t: float, prescribed: Array | None = None) -> None:
        """Compare with the previous step. At time `t` the supports are at `prescribed`, by default the value of their functions."""
        if not self._active or t == self._t:
            return
        prescribed = self._motion.constrained_displacements(t) if prescribed is None else prescribed
        moved, h = np.abs(prescribed - self._before), t - self._t
        fast = np.flatnonzero(moved > FASTER * h * self._speed + self._small)
        if len(fast):
            self._search((self._t, t), (self._before[fast], prescribed[fast]), fast)
        np.maximum(self._speed, moved / h, out=self._speed)
        self._t, self._before = t, prescribed

    def _search(self, times: tuple[float, float], ends: tuple[Array, Array], fast: NDArray[np.intp]) -> None:
        """Warn if the fast supports jump between the two `times`; `ends` are their displacements at these times."""
        found = self._first_jump(times, ends, fast, np.zeros(len(fast)), HALVINGS)
        if found is None:
            return
        t, sizes = found
        self._active = False
        vertices = self._vertices(fast[sizes > 0])
        text = (
            f"t = {t:.6g} s: the supports of {name_ids(vertices, 'vertex')} jump by up to {sizes.max():.3g} m. The energy of "
            f"a jump depends on dt. Move them by a ramp over {STEPS} steps or more, or start from a deformed state: "
            "u0=solve_static(...).u."
        )
        warn(self._motion.system.units.text(text))

    def _vertices(self, jumping: NDArray[np.intp]) -> NDArray[np.int64]:
        """Return the vertices that the jumping constrained degrees of freedom move."""
        motion, constrained = self._motion, self._motion.system.supports.held
        unit = np.zeros(motion.states.n)
        unit[motion.free.fixed[jumping]] = 1
        mesh = motion.system.mesh
        vertices = np.unique(constrained[motion.states.expand(unit)[constrained] != 0] // mesh.d)
        return np.sort(mesh.node_numbers[vertices])

    def _first_jump(
        self, times: tuple[float, float], ends: tuple[Array, Array], fast: NDArray[np.intp], most: Array, halvings: int
    ) -> tuple[float, Array] | None:
        """Return the end of the first jump [s], and the displacement of each fast support in it, 0 for those that do not jump.

        `most` is the largest motion of each support that was seen. The remaining motion is compared with it.
        """
        moved = np.abs(ends[1] - ends[0])
        np.maximum(most, moved, out=most)
        moved[moved < REMAINING * most] = 0
        if not moved.any() or not halvings:
            return (times[1], moved) if moved.any() else None
        middle = (times[0] + times[1]) / 2
        halfway = self._motion.constrained_displacements(middle)[fast]
        early = self._first_jump((times[0], middle), (ends[0], halfway), fast, most, halvings - 1)
        return early or self._first_jump((middle, times[1]), (halfway, ends[1]), fast, most, halvings - 1)
