"""Integrators. Each declares its order and the quantities that it conserves."""

from .backward_euler import BackwardEuler, LinearBackwardEuler
from .energy_momentum import EnergyMomentum
from .explicit import Explicit, ForwardEuler, VelocityVerlet
from .implicit import Implicit
from .integrator import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM, Integrator, StepFailed, Stepper
from .newmark import GeneralizedAlpha, Newmark

#: All integrators, by the name of their class.
INTEGRATORS: dict[str, type[Integrator]] = {
    one.__name__: one
    for one in (ForwardEuler, VelocityVerlet, LinearBackwardEuler, BackwardEuler, Newmark, GeneralizedAlpha, EnergyMomentum)
}

__all__ = [
    "ANGULAR_MOMENTUM",
    "ENERGY",
    "INTEGRATORS",
    "LINEAR_MOMENTUM",
    "BackwardEuler",
    "EnergyMomentum",
    "Explicit",
    "ForwardEuler",
    "GeneralizedAlpha",
    "Implicit",
    "Integrator",
    "LinearBackwardEuler",
    "Newmark",
    "StepFailed",
    "Stepper",
    "VelocityVerlet",
]
