"""Removal of elements during a motion by a rule: a limit of stress, or a user-supplied function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import Array, own, real_array, shown, whole
from ...errors import StvkError, name_ids
from ...results import Fields, State
from ...system.bound import elements_to_remove
from .motion import Motion
from .record import RunRecord


@dataclass(frozen=True, eq=False)
class PrincipalStressLimit:
    """Rule that removes elements whose largest principal (Cauchy) stress exceeds a limit.

    This is Rankine's criterion, for brittle bodies. As with all rules by element, the crack depends on the mesh. The stress at the
    tip of a notch grows as elements get smaller, and the energy that a crack dissipates decreases. Calibrate the limit on the mesh
    that is used.

    Parameters
    ----------
    limit
        Largest principal stress [Pa], a number or one value for each element of the mesh; infinity for elements that are never
        removed.
    every
        Number of steps between two evaluations. One evaluation costs as much as many forces.

    Raises
    ------
    StvkError
        if the limit is not positive; in a run, if the number of values is not the number of elements.

    Examples
    --------
    >>> PrincipalStressLimit(2e6, every=10).limit
    array(2000000.)
    """

    limit: ArrayLike
    every: int = 1

    def __post_init__(self) -> None:
        limit = real_array(self.limit)
        if limit is None or limit.ndim > 1 or not limit.size or not (limit > 0).all():
            raise StvkError(
                f"PrincipalStressLimit: limit = {shown(self.limit)}; expected a positive number, or one for each element [Pa]."
            )
        object.__setattr__(self, "limit", limit)
        object.__setattr__(self, "every", whole("PrincipalStressLimit: every", self.every, "steps, at least 1", least=1))
        own(self)

    def above(self, state: State) -> NDArray[np.int64]:
        """Return the ids of the elements that exceed the limit at one of their points or more.

        Parameters
        ----------
        state
            State of the body, with its fields of stress.
        """
        stress = state.at_points("cauchy_stress")
        if np.shape(self.limit) not in ((), (len(stress),)):
            raise StvkError(
                f"PrincipalStressLimit: limit has shape {np.shape(self.limit)}; expected a number or ({len(stress)},), one for "
                "each element of the mesh."
            )
        largest = np.linalg.eigvalsh(np.ma.filled(stress, 0.0))[..., -1].max(axis=1)
        return np.flatnonzero(largest > np.asarray(self.limit))

    def __repr__(self) -> str:
        limit = np.asarray(self.limit)
        stated = f"{float(limit):g}" if limit.ndim == 0 else f"{len(limit)} numbers"
        return f"PrincipalStressLimit({stated}, every={self.every})"


#: A limit, or a function of the time [s] and the displacements (ndofs,) [m] that returns ids or a mask of elements, or None.
Rule: TypeAlias = PrincipalStressLimit | Callable[[float, Array], Any]


def checked_rule(rule: Any) -> Rule | None:
    """Return the rule; refuse anything else."""
    if rule is None or isinstance(rule, PrincipalStressLimit) or (callable(rule) and not isinstance(rule, type)):
        return rule
    raise StvkError(
        f"remove = {shown(rule)}; expected PrincipalStressLimit(limit), or a function of t and u that returns ids or a mask of the "
        "elements to remove. To remove elements before a run, use system.without(...)."
    )


def rule_text(rule: Rule) -> str:
    """Return the text by which the files of a run identify a rule."""
    if not isinstance(rule, PrincipalStressLimit):
        return "a function"
    limit = np.asarray(rule.limit)
    weights = 1.5 + np.cos(np.arange(limit.size))
    more = f" of sum {float(weights @ np.where(np.isfinite(limit), limit, -1.0)):.9g}" if limit.ndim else ""
    return f"{rule!r}{more}"


class Removal:
    """Selection of the elements to remove, by a rule."""

    def __init__(self, motion: Motion, rule: Rule) -> None:
        self._motion, self._rule = motion, rule
        self._fields: Fields | None = None

    def chosen(self, record: RunRecord) -> NDArray[np.int64]:
        """Return the ids of the elements to remove in the state of the record, after a whole step.

        Raises
        ------
        StvkError
            if the function of a rule fails, or returns neither ids nor a mask of elements nor None.
        """
        state, rule, system = record.state, self._rule, self._motion.system
        if not isinstance(rule, PrincipalStressLimit):
            found = rule(state.t, state.u.copy())
            return elements_to_remove(system, [] if found is None else found)
        if record.steps % rule.every:
            return np.empty(0, dtype=np.int64)
        if self._fields is None:
            self._fields = Fields.of(system)
        self._fields.leave_out(system.removed)
        return elements_to_remove(system, rule.above(self._fields.at(state.u, state.v)))


def removal_text(removed: NDArray[np.int64], removed_at: Array) -> str:
    """Return the part of the run's message about removed elements: how many, which and when. It is empty if there were none."""
    during = np.isfinite(removed_at)
    if not during.any():
        return ""
    first, last = removed_at[during][[0, -1]]
    when = f"at t = {first:.4g} s" if first == last else f"between t = {first:.4g} s and t = {last:.4g} s"
    return f"; {name_ids(removed[during], 'element')} removed {when}"
