"""Integrators, one a file; each declares its order and what it conserves."""

from .backward_euler import BackwardEuler
from .energy_momentum import EnergyMomentum
from .explicit import Explicit
from .forward_euler import ForwardEuler
from .generalized_alpha import GeneralizedAlpha
from .implicit import Implicit
from .integrator import ANGULAR_MOMENTUM, ENERGY, LINEAR_MOMENTUM, Integrator, StepFailed, Stepper
from .linear_backward_euler import LinearBackwardEuler
from .newmark import Newmark
from .velocity_verlet import VelocityVerlet

#: All there are, by the name of their class.
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
