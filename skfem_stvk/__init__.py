"""St. Venant-Kirchhoff elasticity on simplices from edges, and the referee for everybody else's: a plugin for scikit-fem."""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what is named like its file is imported from there: mypy may take it for the file otherwise
    from .dynamics import (
        BackwardEuler,
        EdgeDamping,
        EnergyMomentum,
        ForwardEuler,
        GeneralizedAlpha,
        LinearBackwardEuler,
        Newmark,
        PrincipalStressLimit,
        Rayleigh,
        Run,
        SimulationError,
        VelocityVerlet,
    )
    from .dynamics.critical_elements import critical_elements
    from .dynamics.critical_step import critical_step
    from .dynamics.modes import modes
    from .dynamics.simulate import simulate
    from .errors import (
        LoadError,
        MaterialError,
        MeshError,
        RegionError,
        SceneError,
        StateError,
        StvkError,
        StvkWarning,
        SupportError,
    )
    from .materials import Anisotropic, Isotropic, Orthotropic, TransverselyIsotropic, frames_along
    from .mesh import Box, ElementMesh, MeshQuality, NearestNode, Plane, embedded_mesh, mesh_quality, read_mesh
    from .nonlinear.outcome import Interrupted
    from .reduced import PrecomputedResponse, ReducedSystem
    from .referee import Report, verify
    from .referee.integrators import verify_integrator
    from .referee.law import verify_law
    from .referee.read_back import verify_results
    from .referee.solvers import verify_solver
    from .referee.vectors import export_vectors, published_vectors
    from .results import compare_networks, write_mesh
    from .results.state_files import read_state
    from .scene import Scene
    from .statics import SolveError, StaticResult, Stop, solve_static
    from .system import System
    from .terms import (
        BodyForce,
        Corotated,
        EdgeNetwork,
        ElasticFoundation,
        Gravity,
        InvertibleStVK,
        LinearElastic,
        NeoHookean,
        NodalLoad,
        Pressure,
        Ramp,
        Sine,
        SpringNetwork,
        StVK,
        Table,
        Traction,
        VolumePenalty,
    )

__version__ = "0.1.0"
__all__ = [
    "Anisotropic",
    "BackwardEuler",
    "BodyForce",
    "Box",
    "Corotated",
    "EdgeDamping",
    "EdgeNetwork",
    "ElasticFoundation",
    "ElementMesh",
    "EnergyMomentum",
    "ForwardEuler",
    "GeneralizedAlpha",
    "Gravity",
    "Interrupted",
    "InvertibleStVK",
    "Isotropic",
    "LinearBackwardEuler",
    "LinearElastic",
    "LoadError",
    "MaterialError",
    "MeshError",
    "MeshQuality",
    "NearestNode",
    "NeoHookean",
    "Newmark",
    "NodalLoad",
    "Orthotropic",
    "Plane",
    "PrecomputedResponse",
    "Pressure",
    "PrincipalStressLimit",
    "Ramp",
    "Rayleigh",
    "ReducedSystem",
    "RegionError",
    "Report",
    "Run",
    "Scene",
    "SceneError",
    "SimulationError",
    "Sine",
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
    "Table",
    "Traction",
    "TransverselyIsotropic",
    "VelocityVerlet",
    "VolumePenalty",
    "compare_networks",
    "critical_elements",
    "critical_step",
    "embedded_mesh",
    "export_vectors",
    "frames_along",
    "mesh_quality",
    "modes",
    "published_vectors",
    "read_mesh",
    "read_state",
    "simulate",
    "solve_static",
    "verify",
    "verify_integrator",
    "verify_law",
    "verify_results",
    "verify_solver",
    "write_mesh",
]

#: Where the public names stand: what a program does not name is not imported.
_PLACES = {
    "dynamics": (
        "BackwardEuler EdgeDamping EnergyMomentum ForwardEuler GeneralizedAlpha LinearBackwardEuler Newmark "
        "PrincipalStressLimit Rayleigh Run SimulationError VelocityVerlet critical_elements critical_step modes "
        "simulate"
    ),
    "errors": "LoadError MaterialError MeshError RegionError SceneError StateError StvkError StvkWarning SupportError",
    "materials": "Anisotropic Isotropic Orthotropic TransverselyIsotropic frames_along",
    "mesh": "Box ElementMesh MeshQuality NearestNode Plane embedded_mesh mesh_quality read_mesh",
    "nonlinear.outcome": "Interrupted",
    "reduced": "PrecomputedResponse ReducedSystem",
    "referee": "Report verify",
    "referee.integrators": "verify_integrator",
    "referee.law": "verify_law",
    "referee.read_back": "verify_results",
    "referee.solvers": "verify_solver",
    "referee.vectors": "export_vectors published_vectors",
    "results": "compare_networks write_mesh",
    "results.state_files": "read_state",
    "scene": "Scene",
    "statics": "SolveError StaticResult Stop solve_static",
    "system": "System",
    "terms": (
        "BodyForce Corotated EdgeNetwork ElasticFoundation Gravity InvertibleStVK LinearElastic NeoHookean NodalLoad "
        "Pressure Ramp Sine SpringNetwork StVK Table Traction VolumePenalty"
    ),
}

if not TYPE_CHECKING:  # with it a type checker would take any name for a public one

    def __getattr__(name: str) -> Any:
        """A public name, or a part of the package, imported when it is first asked for."""
        place = next((place for place, names in _PLACES.items() if name in names.split()), None)
        if place is not None:
            globals()[name] = getattr(import_module(f".{place}", __name__), name)
            return globals()[name]
        if not name.startswith("_") and find_spec(f"{__name__}.{name}"):
            return import_module(f".{name}", __name__)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
