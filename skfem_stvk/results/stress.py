"""Stresses and strain energy density of elements. Each function takes a `State` and gives its values and where there are none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..arguments import Array
from ..errors import name_ids, warn
from .kinematics import Masked

if TYPE_CHECKING:
    from .state import State


def pk2_stress(state: State) -> Masked:
    """Second Piola-Kirchhoff stress (nt, 3, 3) [Pa], on rest axes: `S = C : E`, and `psi'(J) J (F'F)^-1` of a `VolumePenalty`.

    Warns
    -----
    StvkWarning
        with the ids of the elements of a `VolumePenalty` that have shrunk to nothing (`J = 0`); they are masked.
    """
    lost = np.flatnonzero(state.shrunk)
    if len(lost):
        _warn_of_shrunk(lost, "stress is infinite")
    return state.globally(state.stress), state.fields.without_term | state.shrunk


def pk1_stress(state: State) -> Masked:
    """First Piola-Kirchhoff (nominal) stress `P = F S` (nt, 3, 3) [Pa], force per rest area; not symmetric.

    There is no stress across where `F` may be missing, so `P` is there all the same.
    """
    S, missing = state.raw("pk2_stress")
    P: Array = state.raw("deformation_gradient")[0] @ S
    return P, missing


def cauchy_stress(state: State) -> Masked:
    """Cauchy (true) stress `F S F'/|J|` (nt, 3, 3) [Pa], force per current area, on current axes.

    `|J|`, so that tension stays tension in elements that are turned inside out.

    Warns
    -----
    StvkWarning
        with the ids of the elements that have shrunk to nothing (`J = 0`); they are masked.
    """
    F, _ = state.raw("deformation_gradient")
    J, missing = state.raw("volume_ratio")
    S, without = state.raw("pk2_stress")
    missing = missing | without
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        stress = F @ S @ np.swapaxes(F, 1, 2) / np.abs(J)[:, None, None]
    infinite = ~np.isfinite(stress).all(axis=(1, 2))
    lost = np.flatnonzero(infinite & ~missing)
    if len(lost):
        _warn_of_shrunk(lost, "the Cauchy stress is infinite")
    stress[infinite] = 0.0
    return stress, missing | infinite


def _warn_of_shrunk(ids: NDArray[np.int64], what: str) -> None:
    warn(
        f"{name_ids(ids, 'element')}: shrunk to nothing (J = 0), so that {what}; it is masked there. "
        "Did the solve converge, and do prescribed displacements put vertices in one place?"
    )


def von_mises_stress(state: State) -> Masked:
    """Von Mises stress `sqrt(3/2 s : s)` (nt,) [Pa], `s` the deviator of the Cauchy stress."""
    stress, missing = state.raw("cauchy_stress")
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))), missing


def strain_energy_density(state: State) -> Masked:
    """Strain energy per rest volume (nt,) [J/m^3], added up over the terms: `1/2 E : C : E`, and `psi(J)` of a `VolumePenalty`."""
    return state.energy_density, state.fields.without_term
