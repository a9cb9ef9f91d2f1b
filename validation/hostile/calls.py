"""Calls of the public names with good arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

import skfem_stvk as stvk

#: A function, and good values of its arguments by name.
Made = tuple[Callable[..., Any], dict[str, Any]]


@dataclass(frozen=True)
class Call:
    """Function to call.

    Attributes
    ----------
    name
        Name of the function; what follows a space distinguishes calls of one function.
    make
        Returns the function and good values of its arguments. The values are new objects if the function changes them.
    """

    name: str
    make: Callable[[], Made]


@cache
def mesh() -> stvk.ElementMesh:
    """Return four triangles in the plane, with named regions, boundaries and vertices."""
    p = np.array([[0.0, 1.0, 2.0, 0.0, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]])
    return stvk.ElementMesh(
        p,
        np.array([[0, 1, 1, 2], [1, 4, 2, 5], [3, 3, 4, 4]]),
        subdomains={"half": np.array([0, 1])},
        boundaries={"left": np.array([[0], [3]]), "right": np.array([[2], [5]])},
        node_sets={"tip": np.array([5])},
    )


@cache
def tetrahedra() -> stvk.ElementMesh:
    """Return two tetrahedra."""
    p = np.array([[0.0, 1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0, 1.0]])
    return stvk.ElementMesh(p, np.array([[0, 1], [1, 2], [2, 3], [3, 4]]))


def on_body(*terms: Any) -> stvk.System:
    """Return the system of a material and these terms or loads, constrained on its left."""
    return stvk.System(mesh(), [stvk.StVK(young=2.0, poisson=0.25, density=1.0), *terms], fixed={"left": "xy"})


@cache
def system() -> stvk.System:
    """Return a body that is loaded on its right."""
    return on_body(stvk.Gravity(g=(0.0, -0.25)), stvk.Traction("right", (0.25, 0.0)))


@cache
def solved() -> stvk.StaticResult:
    """Return a static result."""
    return stvk.solve_static(system(), quiet=True)


def driven(integrator: Any = None) -> stvk.Simulation:
    """Return a driven motion."""
    return stvk.Simulation(system(), integrator or stvk.EnergyMomentum(0.125), pushed=["tip"])


CONSTANTS: dict[str, Any] = {"young": 2.0, "poisson": 0.25}
MATERIAL = CONSTANTS | {"density": 4.0}
FRAME = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
U = np.round(64 * 0.05 * np.cos(np.arange(12.0))) / 64  # exact in any precision

#: Functions that make an object or a result alone, with good arguments.
FUNCTIONS: dict[str, dict[str, Any]] = {
    "Isotropic": MATERIAL,
    "Anisotropic": {"voigt": np.diag([4.0, 5.0, 6.0, 1.0, 2.0, 3.0]), "density": 4.0, "frame": FRAME},
    "TransverselyIsotropic": {
        **{"young_axial": 4.0, "young_transverse": 2.0, "poisson_axial": 0.25, "poisson_transverse": 0.25, "shear_axial": 1.0},
        "density": 4.0,
    },
    "frames_along": {"mesh": tetrahedra(), "directions": [0.5, 0.25, 1.0]},
    "Ramp": {"value": 2.0, "until": 1.0, "start": 0.0},
    "Sine": {"value": 2.0, "frequency": 1.0, "phase": 0.5},
    "Table": {"value": 2.0, "times": [0.0, 1.0], "factors": [0.0, 1.0]},
    "RigidPlane": {"point": (0.0, -0.5), "normal": (0.0, 2.0)},
    "RigidSphere": {"centre": (0.0, -0.5), "radius": 2.0, "inside": False},
    "RigidCylinder": {"point": (0.0, -0.5, 0.0), "axis": (0.0, 0.5, 0.0), "radius": 2.0, "inside": True},
    "RigidBox": {"low": (0.0, -0.5), "high": (2.0, 1.5), "radius": 0.25},
    "RigidMesh": {"file": (tetrahedra().p, tetrahedra().surface)},
    "Friction": {"coefficient": 0.25, "slip_speed": 0.5, "slip_length": 0.5},
    "Rayleigh": {"alpha": 0.5, "beta": 0.25},
    "EdgeDamping": {"tau": 0.5},
    "PrincipalStressLimit": {"limit": 2.0, "every": 2},
    "ForwardEuler": {"dt": 0.125},
    "VelocityVerlet": {"dt": 0.125},
    "Box": {"low": (0.0, 0.0), "high": (1.0, 1.0)},
    "Plane": {"point": (0.0, 0.0), "normal": (1.0, 0.5), "within": 0.25},
    "NearestNode": {"point": (1.0, 0.75)},
    "Stop": {"load": 0.25, "turns": 2, "states": 2},
    "mesh_quality": {"mesh": (mesh().p, mesh().t)},
    "critical_step": {"system": system(), "u": U},
    "critical_elements": {"system": system(), "n": 2, "u": U},
    "write_mesh": {"path": "mesh.vtu", "mesh": mesh()},
    "System": {"mesh": mesh(), "terms": [stvk.StVK(**CONSTANTS)], "fixed": {"left": "xy"}, "prescribed": {"right": {"x": 0.25}}},
}
#: Terms and loads, which are checked when a body is made of them.
TERMS: dict[str, dict[str, Any]] = {
    "StVK": MATERIAL | {"region": [0, 1], "plane": "stress", "thickness": 2.0},
    "NeoHookean": MATERIAL | {"region": [0, 1], "plane": "stress", "thickness": 2.0},
    "LinearElastic": MATERIAL | {"region": [0, 1]},
    "Corotated": MATERIAL | {"region": [0, 1], "rotation": "vertex"},
    "InvertibleStVK": MATERIAL | {"region": [0, 1], "threshold": 0.75, "extend": "stress"},
    "SpringNetwork": MATERIAL | {"region": [0, 1], "rule": "van-gelder", "thickness": 2.0},
    "VolumePenalty": {"stiffness": 2.0, "kind": "quadratic", "region": "half"},
    "ElasticFoundation": {"where": "left", "stiffness": 2.0},
    "Gravity": {"g": (0.0, -8.0)},
    "BodyForce": {"force": (0.0, -8.0), "region": "half"},
    "NodalLoad": {"where": [2, 5], "force": (0.0, -8.0)},
    "Traction": {"where": "right", "traction": (0.0, -8.0)},
    "Pressure": {"where": "right", "pressure": 2.0},
    "RigidContact": {
        "shape": stvk.RigidPlane((0.0, -0.5), (0.0, 2.0)),
        **{"where": "left", "stiffness": 2.0, "friction": stvk.Friction(0.25, slip_speed=0.5), "onset": 0.25, "motion": (0.0, 0.5)},
    },
}
#: Implicit integrators, which are checked in a short motion.
INTEGRATORS = ("LinearBackwardEuler", "BackwardEuler", "Newmark", "GeneralizedAlpha", "EnergyMomentum")
#: Methods of a system.
METHODS: dict[str, dict[str, Any]] = {
    **{
        name: {"u": U} for name in ("energy", "internal_force", "energy_and_force", "tangent", "linearize", "smallest_volume_ratio")
    },
    **{name: {"u": U, "t": 0.5} for name in ("external_force", "residual", "jacobian", "energies")},
    "product": {"u": U, "v": U[::-1].copy()},
    "mass": {"kind": "consistent"},
    "free_dofs": {"fixed": [0, 1, 4]},
    "without": {"elements": [0, 3]},
}


def calls() -> Iterator[Call]:
    """Yield the calls of this table."""

    def call(name: str, function: Callable[..., Any], good: dict[str, Any]) -> Call:
        return Call(name, lambda: (function, dict(good)))

    for name, good in FUNCTIONS.items():
        yield call(name, getattr(stvk, name), good)
    for name, good in TERMS.items():
        yield call(name, partial(_of_term, getattr(stvk, name)), good)
    for name in INTEGRATORS:
        good = {"dt": 0.125, "tangent": "exact", "solver": "superlu", "rtol": 0.5**10}
        yield call(name, partial(_of_integrator, getattr(stvk, name)), good)
    for name, good in METHODS.items():
        yield call(f"System.{name}", getattr(system(), name), good)
    yield from (call(name, function, good) for name, function, good in _others())


def _of_term(term: Any, /, **given: Any) -> Any:
    body = on_body(term(**given))
    return body.residual(U, 0.5), body.jacobian(U, 0.5)


def _of_contact(**given: Any) -> Any:
    body = stvk.System(tetrahedra(), [stvk.StVK(**CONSTANTS), stvk.MeshContact(**given)])
    return body.internal_force(np.zeros(body.ndofs))


def _of_integrator(kind: Any, /, **given: Any) -> Any:
    run = stvk.simulate(system(), kind(**given), until=0.25, quiet=True)
    return run.u, run.v


def _static(**given: Any) -> Any:
    result = stvk.solve_static(system(), overwrite=True, quiet=True, **given)
    return result.t, result.u


def _motion(**given: Any) -> Any:
    run = stvk.simulate(system(), overwrite=True, quiet=True, **given)
    return run.t, run.u


def _steps(until: Any, tip: Any, **given: Any) -> Any:
    sim = stvk.Simulation(system(), stvk.EnergyMomentum(0.125), pushed=["tip"], **given)
    sim.step(until=until, tip=tip)
    return sim.t, sim.u


def _removed(elements: Any) -> Any:
    sim = driven()
    sim.remove(elements)
    return sim.system.mesh.nt


def _response(**given: Any) -> Any:
    return stvk.PrecomputedResponse(system(), quiet=True, **given)((0.0, 0.0625))


def _read_state(mesh: Any) -> Any:
    solved().save("state.vtu")
    return stvk.read_state("state.vtu", mesh)[0]


def _others() -> Iterator[tuple[str, Callable[..., Any], dict[str, Any]]]:
    orthotropic = {"young": (4.0, 2.0, 1.0), "poisson": (0.25, 0.25, 0.125), "shear": (1.0, 2.0, 0.5), "density": 4.0}
    yield "Orthotropic", stvk.Orthotropic, orthotropic
    yield "ElementMesh", stvk.ElementMesh, {"p": mesh().p, "t": mesh().t, "subdomains": {"a": [0]}, "boundaries": {"b": [[0], [3]]}}
    yield "EdgeNetwork", lambda **given: stvk.EdgeNetwork.of(**given).L, {"mesh": tetrahedra(), "law": stvk.StVK(**CONSTANTS)}
    blocks = {"first": list(range(5)), "distance": 0.5, "stiffness": 2.0, "friction": stvk.Friction(0.25, slip_speed=0.5)}
    yield "MeshContact", _of_contact, blocks
    yield "verify", lambda **given: stvk.verify(**given).passed, {"mesh": tetrahedra(), **CONSTANTS, "seed": 1, "quiet": True}
    compared = {"mesh": mesh(), "law": stvk.StVK(**CONSTANTS), "u": U}
    yield "compare_networks", lambda **given: stvk.compare_networks(**given).shares, compared
    yield (
        "modes",
        lambda **given: stvk.modes(system(), **given).eigenvalues,
        {"n": 2, "u": U, "mass": "lumped", "solver": "superlu"},
    )
    statics = {
        "steps": 2,
        "solver": "superlu",
        "rtol": 0.5**10,
        "u0": np.zeros(12),
        "t0": 0.0,
        "save": "a.pvd",
        "fields": ["cauchy"],
    }
    yield "solve_static", _static, statics | {"method": "load-steps", "stability": False}
    start = {"u0": np.zeros(12), "v0": np.zeros(12), "t0": 0.0, "mass": "lumped", "damping": [stvk.Rayleigh(0.5)]}
    motion = {"integrator": stvk.EnergyMomentum(0.125), "until": 0.25, "every": 1, "save": "a.pvd", "fields": ["cauchy"]}
    yield "simulate", _motion, start | motion | {"probes": {"middle": [1]}, "reactions": {"left": [0]}}
    yield "Simulation", _steps, start | {"halvings": 1, "until": 0.25, "tip": np.array([0.25, -0.5])}
    yield "Simulation.mean", lambda name: driven().mean(name), {"name": "left"}
    yield "Simulation.remove", _removed, {"elements": np.array([3])}
    yield "ReducedSystem", lambda **given: stvk.ReducedSystem(system(), quiet=True, **given).size, {"size": 3, "modes": 2}
    response = {"handle": "tip", "displacements": ([0.0], [-0.125, 0.0, 0.125]), "tolerance": 0.5**10, "checks": 1, "steps": 2}
    yield "PrecomputedResponse", _response, response
    yield "published_vectors", lambda name: stvk.published_vectors(name).arrays["W"], {"name": "tetrahedron"}
    exported = {"mesh": mesh(), **CONSTANTS, "seed": 1, "quiet": True}
    yield "export_vectors", lambda **given: stvk.export_vectors(**given).arrays["F"], exported
    yield "StaticResult.stress", solved().stress, {"measure": "pk2", "at": "nodes"}
    yield "StaticResult.reaction", lambda where: solved().reaction(where).resultant, {"where": "left"}
    yield "StaticResult.save", solved().save, {"path": "static.vtu", "fields": ["cauchy"]}
    yield "read_state", _read_state, {"mesh": (mesh().p, mesh().t)}
