"""St. Venant-Kirchhoff elasticity on simplices from edges, and the referee for everybody else's: a plugin for scikit-fem."""

from .dynamics import (
    BackwardEuler,
    EdgeDamping,
    EnergyMomentum,
    ForwardEuler,
    GeneralizedAlpha,
    LinearBackwardEuler,
    Newmark,
    Rayleigh,
    Run,
    SimulationError,
    VelocityVerlet,
    critical_step,
    modes,
    simulate,
)
from .errors import LoadError, MaterialError, MeshError, RegionError, StateError, StvkError, StvkWarning, SupportError
from .materials import Anisotropic, Isotropic, Orthotropic, TransverselyIsotropic
from .mesh import ElementMesh, embedded_mesh, read_mesh
from .nonlinear.outcome import Interrupted
from .referee import Report, verify
from .results import compare_networks
from .statics import SolveError, StaticResult, Stop, solve_static
from .system import System
from .terms import (
    BodyForce,
    EdgeNetwork,
    ElasticFoundation,
    Gravity,
    LinearElastic,
    NeoHookean,
    NodalLoad,
    Pressure,
    SpringNetwork,
    StVK,
    Traction,
    VolumePenalty,
)

__version__ = "0.1.0"
__all__ = [
    "Anisotropic",
    "BackwardEuler",
    "BodyForce",
    "EdgeDamping",
    "EdgeNetwork",
    "ElasticFoundation",
    "ElementMesh",
    "EnergyMomentum",
    "ForwardEuler",
    "GeneralizedAlpha",
    "Gravity",
    "Interrupted",
    "Isotropic",
    "LinearBackwardEuler",
    "LinearElastic",
    "LoadError",
    "MaterialError",
    "MeshError",
    "NeoHookean",
    "Newmark",
    "NodalLoad",
    "Orthotropic",
    "Pressure",
    "Rayleigh",
    "RegionError",
    "Report",
    "Run",
    "SimulationError",
    "SolveError",
    "SpringNetwork",
    "StVK",
    "StateError",
    "StaticResult",
    "Stop",
    "StvkError",
    "StvkWarning",
    "SupportError",
    "System",
    "Traction",
    "TransverselyIsotropic",
    "VelocityVerlet",
    "VolumePenalty",
    "compare_networks",
    "critical_step",
    "embedded_mesh",
    "modes",
    "read_mesh",
    "simulate",
    "solve_static",
    "verify",
]
