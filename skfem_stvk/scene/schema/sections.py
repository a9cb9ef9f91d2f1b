"""The whole schema of a scene."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ..units import UNITS
from .analyses import Analysis, ReducedBasis, Solver
from .materials import Material
from .mesh import Mesh
from .outputs import Expect, Initial, Output
from .places import Place, PlaceOrName
from .quantities import Name, Part, key
from .terms import Term, Time


class Prescribed(Part):
    """Displacements that are prescribed at a place."""

    x: Annotated[float | None, key("Along x, at the full load or at all times.", "length")] = None
    y: Annotated[float | None, key("Along y.", "length")] = None
    z: Annotated[float | None, key("Along z.", "length")] = None
    time: Annotated[
        Time | None, key("Factor of time; by default it grows with the load factor in statics, and is 1 in motion.")
    ] = None


class SceneTables(Part):
    """A scene: the tables and keys of its file."""

    title: Annotated[str, key("What it is, for reports.")] = ""
    units: Annotated[
        Literal[tuple(UNITS)],  # type: ignore[valid-type]
        key("System of units that all values are in: said in outputs, and used to judge whether values are plausible."),
    ] = "SI"
    threads: Annotated[int | None, key("Threads that kernels run on; by default one for each core.", ge=1)] = None
    mesh: Annotated[Mesh, key("The mesh: a file, or one that is generated.")]
    places: Annotated[dict[Name, Place], key("Places by name, beside the boundaries and node sets of the mesh.")] = {}
    materials: Annotated[dict[Name, Material], key("Materials by name.")] = {}
    terms: Annotated[list[Term], key("What the body is made of, and what acts on it.", min_length=1)]
    fixed: Annotated[
        dict[Name, Annotated[str, Field(pattern="^[xyz]+$")]], key("Components that do not move, by name of the place.")
    ] = {}
    prescribed: Annotated[dict[Name, Prescribed], key("Displacements, by name of the place.")] = {}
    initial: Annotated[Initial, key("The first state; by default rest.")] = Initial()
    analysis: Annotated[Analysis, key("What is solved.")]
    reduced: Annotated[ReducedBasis | None, key("A basis of few unknowns, on which that is solved; by default none.")] = None
    solver: Annotated[Solver, key("How linear systems are solved, and to which residual.")] = Solver()
    output: Annotated[Output, key("What is written.")] = Output()
    expect: Annotated[Expect, key("Results that the scene is expected to give; the command fails if it does not.")] = {}


#: Places that keys of a scene take.
__all__ = ["PlaceOrName", "Prescribed", "SceneTables"]
