"""Motion in time: masses, damping, integrators, modes."""

from ..newton.outcome import Interrupted, Status
from ..runs.ledger import Ledger
from .critical_step import CriticalElements, CriticalStep, LargestFrequency, critical_elements, critical_step
from .damping import EdgeDamping, Rayleigh
from .integrators import (
    INTEGRATORS,
    BackwardEuler,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    Integrator,
    LinearBackwardEuler,
    Newmark,
    VelocityVerlet,
)
from .modes import Modes, modes
from .removal import PrincipalStressLimit
from .run import Run, SimulationError
from .simulate import simulate
from .simulation import Simulation

__all__ = [
    "INTEGRATORS",
    "BackwardEuler",
    "CriticalElements",
    "CriticalStep",
    "EdgeDamping",
    "EnergyMomentum",
    "ForwardEuler",
    "GeneralizedAlpha",
    "Integrator",
    "Interrupted",
    "LargestFrequency",
    "Ledger",
    "LinearBackwardEuler",
    "Modes",
    "Newmark",
    "PrincipalStressLimit",
    "Rayleigh",
    "Run",
    "Simulation",
    "SimulationError",
    "Status",
    "VelocityVerlet",
    "critical_elements",
    "critical_step",
    "modes",
    "simulate",
]
