"""Analyses of a scene: static, arc length, dynamic and modes; and the linear solver."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import create_model

from ...linear.choose import solver_names
from ...solvers.dynamics import EdgeDamping, Integrator, PrincipalStressLimit, Rayleigh
from ...solvers.dynamics.integrators import INTEGRATORS
from ...solvers.dynamics.step_matrix import StepTangent
from ...solvers.statics import Stop
from .derived import declared, type_of
from .places import PlaceOrName
from .quantities import OneOf, Part, key

if TYPE_CHECKING:
    from ...solvers.reduced import ReducedSystem
    from ...system import System


class Solver(Part):
    """Linear solver and the tolerance of equilibrium. Explicit integrators do not use it."""

    name: Annotated[Annotated[str, OneOf(solver_names)], key("Linear solver.")] = "auto"
    rtol: Annotated[
        float | None,
        key("Relative tolerance of the residual; by default 1e-8, or what the integrator needs.", gt=0, lt=1),
    ] = None
    tangent: Annotated[
        Literal[tuple(one.value for one in StepTangent)] | None,  # type: ignore[valid-type]
        key("Tangent that implicit integrators use; by default the exact tangent."),
    ] = None


class ReducedBasis(Part):
    """Few unknowns: the amounts of some fields of displacements, made of vibration modes. For statics, arc length and motion."""

    size: Annotated[int | None, key("Number of unknowns; by default 30, or as many as there are independent fields.", ge=1)] = None
    modes: Annotated[int | None, key("Number of the lowest modes in the basis; by default 20, or all modes.", ge=1)] = None
    derivatives: Annotated[bool, key("Whether modal derivatives are added; without them large rotations are not possible.")] = True

    def of_body(self, body: System, quiet: bool) -> ReducedSystem:
        """Return the body on this basis."""
        from ...solvers.reduced import ReducedSystem  # imported only on request

        return ReducedSystem(body, self.size, self.modes, self.derivatives, quiet=quiet)


class StaticAnalysis(Part):
    """Equilibrium at the full load, found in steps."""

    type: Literal["static"]
    steps: Annotated[int, key("The first step is this part of the load: 1/steps.", ge=1)] = 10
    stability: Annotated[bool, key("Compute the lowest eigenvalue of K at each state if the solver does not give it.")] = False


class DisplacementLevel(Part):
    """A mean displacement that ends a path."""

    at: Annotated[PlaceOrName, key("Where.")]
    component: Annotated[Literal["x", "y", "z"], key("Which component.")]
    value: Annotated[float, key("Its value at the end.", "length")]


class StopRule(Part):
    """Where a path by its length ends: at what is reached first."""

    load: Annotated[float | None, key("Load factor.")] = None
    displacement: Annotated[DisplacementLevel | None, key("A mean displacement.")] = None
    turns: Annotated[int | None, key("Number of limit points.", ge=1)] = None
    states: Annotated[int | None, key("Number of states.", ge=1)] = None


class ArcLengthAnalysis(Part):
    """The path of equilibria by its length, through limit points."""

    type: Literal["arc-length"]
    steps: Annotated[int, key("The first step is this part of the load: 1/steps.", ge=1)] = 10
    stop: Annotated[StopRule, key("The end of the path; by default load factor 1.")] = StopRule(load=1.0)
    stability: Annotated[bool, key("Compute the lowest eigenvalue of K at each state if the solver does not give it.")] = False


class Damping(Part):
    """Damping by mass, by the stiffness at rest, and by the rate of strain."""

    alpha: Annotated[float, key("Rayleigh's by mass.", "rate", ge=0)] = 0.0
    beta: Annotated[float, key("Rayleigh damping by the stiffness at rest.", "time", ge=0)] = 0.0
    tau: Annotated[float, key("Retardation time of edge damping.", "time", ge=0)] = 0.0

    def of_library(self) -> list[Rayleigh | EdgeDamping]:
        """Return the damping that `simulate` takes."""
        return [Rayleigh(self.alpha, self.beta), EdgeDamping(self.tau)]


class Tearing(Part):
    """Elements leave the body where their largest principal stress is above a limit."""

    stress: Annotated[float, key("The limit.", "stress", gt=0)]
    every: Annotated[int, key("Number of steps between checks.", ge=1)] = 1

    def rule(self) -> PrincipalStressLimit:
        """Return the rule that `simulate` takes."""
        return PrincipalStressLimit(self.stress, self.every)


def integrators() -> dict[str, type[Integrator]]:
    """Return all integrators by their name in a scene: "newmark" for `Newmark`.

    >>> list(integrators())[:3]
    ['forward-euler', 'velocity-verlet', 'linear-backward-euler']
    """
    return {re.sub(r"(?<!^)(?=[A-Z])", "-", name).lower(): one for name, one in INTEGRATORS.items()}


def options() -> dict[str, list[str]]:
    """Return the names of the integrators that have an option, by the name of the option."""
    found: dict[str, list[str]] = {}
    for name, integrator in integrators().items():
        for parameter, _, _ in declared(integrator):
            found.setdefault(parameter.name, []).append(name)
    return found


class MotionAnalysis(Part):
    """Motion from a first state."""

    type: Literal["dynamic"]
    integrator: Annotated[Annotated[str, OneOf(integrators)], key("Time integrator.")] = "energy-momentum"
    dt: Annotated[float | None, key("Time step; explicit integrators can do without: 0.85 of the critical one.", "time", gt=0)] = (
        None
    )
    until: Annotated[float, key("When it ends.", "time")]
    mass: Annotated[Literal["lumped", "consistent"], key("Mass matrix.")] = "lumped"
    damping: Annotated[Damping, key("Damping; by default none.")] = Damping()
    remove: Annotated[Tearing | None, key("Elements that tear; by default none.")] = None

    @property
    def explicit(self) -> bool:
        """Whether steps need forces alone."""
        return integrators()[self.integrator].explicit

    def method(self, solver: Solver) -> Integrator:
        """Return the integrator of the library."""
        own = self.model_dump(include={"dt", *options()}, exclude_none=True)
        if not self.explicit:
            own |= solver.model_dump(include={"rtol", "tangent"}, exclude_none=True) | {"solver": solver.name}
        return integrators()[self.integrator](**own)


def with_options(analysis: type[MotionAnalysis]) -> type[MotionAnalysis]:
    """Return the analysis with keys for the options of all integrators that are registered."""
    more: dict[str, Any] = {}
    for integrator in INTEGRATORS.values():
        for parameter, annotation, quantity in declared(integrator):
            if parameter.name not in analysis.model_fields:
                said = quantity.sentence[0].lower() + quantity.sentence[1:].rstrip(".")
                sentence = f"For {' and '.join(options()[parameter.name])}: {said}, by default {parameter.default}."
                kind, limits = type_of(parameter.name, annotation, quantity)
                more[parameter.name] = Annotated[kind | None, key(sentence, quantity.dimension, **limits)], None
    if not more:
        return analysis
    made = create_model("DynamicAnalysis", __base__=analysis, __module__=__name__, **more)
    made.__doc__ = analysis.__doc__
    return made


if TYPE_CHECKING:
    DynamicAnalysis: TypeAlias = MotionAnalysis
else:
    DynamicAnalysis = with_options(MotionAnalysis)


class ModesAnalysis(Part):
    """Natural modes about the first state, by default about rest."""

    type: Literal["modes"]
    n: Annotated[int, key("How many, rigid ones included.", ge=1)] = 10
    mass: Annotated[Literal["lumped", "consistent"], key("Mass matrix.")] = "lumped"
    load: Annotated[float, key("Load factor of the first state, for loads that depend on the displacements.")] = 1.0


def analyses() -> list[Any]:
    """Return all analyses."""
    return [StaticAnalysis, ArcLengthAnalysis, with_options(DynamicAnalysis), ModesAnalysis]


def stop_of(rule: StopRule, where: object) -> Stop:
    """Return the stop of the library; `where` is the place of its displacement as `System` takes it."""
    level = rule.displacement
    displacement = None if level is None else (where, level.component, level.value)
    return Stop(load=rule.load, displacement=displacement, turns=rule.turns, states=rule.states)
