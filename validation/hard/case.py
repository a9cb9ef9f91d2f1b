"""Hard case: a body, its load steps, and the right outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from skfem_stvk import ElementMesh, InvertibleStVK, StVK, System, VolumePenalty
from skfem_stvk.arguments import Array


@dataclass(frozen=True)
class Body:
    """Data of a system, and the initial state of its solve.

    Parameters
    ----------
    mesh, fixed, prescribed
        As in `System`.
    young, poisson
        Young's modulus [Pa], a number or one per element, and Poisson's ratio.
    loads
        Load terms.
    u0
        (ndofs,) initial displacements [m]; None for the body at rest.
    penalty
        The volume term.
    density
        Density of bodies in motion [kg/m^3], a number or one per element.
    v0
        (ndofs,) initial velocities [m/s]; None for zero.
    law
        Class of the elastic law.
    """

    mesh: ElementMesh
    young: float | Array
    poisson: float
    loads: tuple[Any, ...] = ()
    fixed: Any = None
    prescribed: Any = None
    u0: Array | None = None
    penalty: VolumePenalty = field(default_factory=VolumePenalty)
    density: float | Array | None = None
    v0: Array | None = None
    law: type[StVK] | type[InvertibleStVK] = StVK

    def system(self, volume: bool) -> System:
        """Return the system, with or without the volume term."""
        terms = [self.law(young=self.young, poisson=self.poisson, density=self.density), *[self.penalty] * volume, *self.loads]
        return System(self.mesh, terms, self.fixed, self.prescribed)

    def quadratic(self) -> Body:
        """Return the body with quadratic elements with straight edges, and with the same initial displacements and velocities."""
        mesh = self.mesh.with_degree(2)
        ends = mesh.ends()
        assert ends is not None
        u0, v0 = (None if x is None else x.reshape(-1, mesh.d)[ends].mean(axis=1).ravel() for x in (self.u0, self.v0))
        return replace(self, mesh=mesh, u0=u0, v0=v0)


def made(make: Callable[[], Body], degree: int) -> Body:
    """Return the body made by `make`, with elements of this degree."""
    return make().quadratic() if degree == 2 else make()


def invertible(make: Callable[[], Body]) -> Body:
    """Return the body made by `make` with the law `InvertibleStVK`."""
    return replace(make(), law=InvertibleStVK)


@dataclass(frozen=True)
class Truth:
    """Right outcome, and its source.

    Parameters
    ----------
    source
        In words, for the table.
    error
        Function that returns the relative error of displacements of a system; None if there is no right state, so that a solver
        must report a failure.
    limit
        Largest error, and largest next step of Newton's method. Rounding bounds this step from below.
    says
        Patterns (regular expressions) that the message or a warning of `solve_static` must contain.
    refused
        Whether `solve_static` may end without the right state if it `says` why, because the start is too far away.
    """

    source: str
    error: Callable[[System, Array], float] | None
    limit: float = 1e-6
    says: tuple[str, ...] = ()
    refused: bool = False


@dataclass(frozen=True)
class Case:
    """Row of the table.

    Parameters
    ----------
    name
        In words.
    body
        Function that returns the body.
    steps
        Number of load steps, the same for all methods.
    truth, with_volume
        Right outcome without and with the volume term.
    quick
        Whether the case is part of the quick table.
    methods
        Names of the methods that are run; None for all.
    solver
        Linear solver of the default method.
    invertible
        Right outcome of `InvertibleStVK` without the volume term. None: it is that of `StVK`, because the right state of `StVK` is
        homogeneous or has no principal stretch below the threshold.
    """

    name: str
    body: Callable[[], Body]
    steps: int
    truth: Truth
    with_volume: Truth
    quick: bool = True
    methods: tuple[str, ...] | None = None
    solver: str = "auto"
    invertible: Truth | None = None

    def truth_of(self, volume: bool) -> Truth:
        """Return the right outcome of the system with or without the volume term."""
        return self.with_volume if volume else self.truth

    def of_invertible(self) -> Case:
        """Return the same case with `InvertibleStVK`."""
        return replace(self, body=partial(invertible, self.body), truth=self.invertible or self.truth)
