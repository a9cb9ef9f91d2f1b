"""A hard case: a body, the steps it is loaded in, and what the right outcome is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from skfem_stvk import ElementMesh, InvertibleStVK, StVK, System, VolumePenalty
from skfem_stvk.arguments import Array


@dataclass(frozen=True)
class Body:
    """What a system is made of, and where its solve starts.

    Parameters
    ----------
    mesh, fixed, prescribed : as of `System`.
    young, poisson : a number, or one per element [Pa].
    loads : what acts on it.
    u0 : (ndofs,) displacements to start from [m]; None for the body at rest.
    penalty : the volume term.
    density : of those that move [kg/m^3], a number, or one per element.
    v0 : (ndofs,) velocities to start from [m/s]; None for none.
    law : the class of its elastic law.
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
        """The system, with the volume term or without it."""
        terms = [self.law(young=self.young, poisson=self.poisson, density=self.density), *[self.penalty] * volume, *self.loads]
        return System(self.mesh, terms, self.fixed, self.prescribed)

    def quadratic(self) -> Body:
        """The same body of quadratic elements with straight edges; it starts from the same displacements and velocities."""
        mesh = self.mesh.with_degree(2)
        ends = mesh.ends()
        assert ends is not None
        u0, v0 = (None if x is None else x.reshape(-1, mesh.d)[ends].mean(axis=1).ravel() for x in (self.u0, self.v0))
        return replace(self, mesh=mesh, u0=u0, v0=v0)


def made(make: Callable[[], Body], degree: int) -> Body:
    """The body that is made, of elements of this degree."""
    return make().quadratic() if degree == 2 else make()


def invertible(make: Callable[[], Body]) -> Body:
    """Return the same body of `InvertibleStVK`."""
    return replace(make(), law=InvertibleStVK)


@dataclass(frozen=True)
class Truth:
    """The right outcome, and where it comes from.

    Parameters
    ----------
    source : in words, for the table.
    error : how far displacements of a system are from the right ones, relative; None where there is no right state, and a solver
        has to say so.
    limit : of the error, and of the step that Newton's method would take next, which rounding bounds from below.
    says : patterns (regular expressions) of which the message or a warning of `solve_static` must have all.
    refused : whether `solve_static` may end without the right state, as long as it `says` why: where a start is out of its reach.
    """

    source: str
    error: Callable[[System, Array], float] | None
    limit: float = 1e-6
    says: tuple[str, ...] = ()
    refused: bool = False


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Parameters
    ----------
    name : in words.
    body : makes it.
    steps : of the load, the same for all methods.
    truth, with_volume : the right outcome without and with the volume term.
    quick : whether it is part of the quick table.
    methods : names of those that are run; None for all.
    solver : the linear solver of the default.
    invertible : the right outcome of `InvertibleStVK` without the volume term; None if it is that of `StVK`, whose right state then
        has no principal stretch below the threshold or is homogeneous.
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
        """The truth of the system with the volume term or without it."""
        return self.with_volume if volume else self.truth

    def of_invertible(self) -> Case:
        """Return the same case of `InvertibleStVK`."""
        return replace(self, body=partial(invertible, self.body), truth=self.invertible or self.truth)
