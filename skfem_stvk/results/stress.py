"""Stresses and strain energy density of elements. Each function takes a `State` and gives its values and where there are none."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import StvkWarning, name_ids
from .kinematics import Masked

if TYPE_CHECKING:
    from .state import State

Array = NDArray[np.float64]


def pk2_stress(state: State) -> Masked:
    """Second Piola-Kirchhoff stress `S = C : E` (nt, 3, 3) [Pa], on rest axes."""
    return state.globally(state.stress), state.fields.without_term


def pk1_stress(state: State) -> Masked:
    """First Piola-Kirchhoff (nominal) stress `P = F S` (nt, 3, 3) [Pa], force per rest area; not symmetric.

    There is no stress across where `F` may be missing, so `P` is there all the same.
    """
    P: Array = state.raw("deformation_gradient")[0] @ state.raw("pk2_stress")[0]
    return P, state.fields.without_term


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
    missing = missing | state.fields.without_term
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        stress = F @ state.raw("pk2_stress")[0] @ np.swapaxes(F, 1, 2) / np.abs(J)[:, None, None]
    infinite = ~np.isfinite(stress).all(axis=(1, 2))
    lost = np.flatnonzero(infinite & ~missing)
    if len(lost):
        warnings.warn(
            f"{name_ids(lost, 'element')}: shrunk to nothing (J = 0), so that the Cauchy stress is infinite; it is masked there. "
            "Did the solve converge, and do prescribed displacements put vertices in one place?",
            StvkWarning,
            stacklevel=2,
        )
    stress[infinite] = 0.0
    return stress, missing | infinite


def von_mises_stress(state: State) -> Masked:
    """Von Mises stress `sqrt(3/2 s : s)` (nt,) [Pa], `s` the deviator of the Cauchy stress."""
    stress, missing = state.raw("cauchy_stress")
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))), missing


def strain_energy_density(state: State) -> Masked:
    """Strain energy per rest volume `1/2 S : E` (nt,) [J/m^3], added up over the terms."""
    return state.energy_density, state.fields.without_term
